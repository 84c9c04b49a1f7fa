"""S-functions for Simulink: compiled against a stand-in for its header, they give the numbers of our own master."""

import ctypes
import dataclasses
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from test_export_simulink import octave

from cosim.cli import main
from cosim.errors import ModelError, UsageError
from cosim.export import prepare, write_simulink
from cosim.master.runner import Runner
from cosim.native.package import write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.stimulus import stimulus_csv

HOST = Path(__file__).parent / "simulink_host"
STEPS, STEP = 400, 1e-3
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
LIST = re.compile(r"'((?:[^']|'')*)'")


@pytest.fixture(scope="session")
def native(made_once):
    """Packages of native FMUs: name -> file."""
    stimulus = stimulus_csv(np.array([0.0, 0.2, 0.21, 0.5]), np.array([0.1, 0.4, -0.5, -0.5]))
    names = ("full_order", "full_order_open", "physical", "position_loop")

    def make(folder):
        for name in names:
            is_open = name.endswith("_open")
            ssd = ssp_folder() / f"{name.removesuffix('_open')}.ssd"
            write_native_ssp(
                ssd, folder / f"{name}.ssp", stimulus=None if is_open else stimulus, open=is_open
            )

    folder = made_once("exported_native", make)
    return {name: folder / f"{name}.ssp" for name in names}


def export(package, folder):
    with read_system(package) as system:
        return write_simulink(prepare(system), folder, blocks="s-function")[0]


def read_script(script):
    """Of the script: what is compiled, blocks, wires (source, output, target, input, factor, offset, initial), inputs."""
    text = script.read_text().replace("...\n", " ")
    calls = {"compile": [], "add_sfunction": [], "add_wire": [], "add_input": []}
    body = text[: text.index("save_system(")]
    for name, given in re.findall(
        r"^(compile|add_sfunction|add_wire|add_input)\((.*?)\);$", body, re.M | re.S
    ):
        calls[name].append(LIST.findall(given))
    return calls


class Block:
    """One S-function of the script, compiled as mex would, in a library of its own."""

    def __init__(self, folder, call, compiled, library):
        name, function, held, resources, *own = call
        _, sources, prefix, *files = compiled[function]
        shutil.copy(build(folder, function, sources, prefix, files), library)
        self.c = ctypes.CDLL(str(library))
        self.c.host_size.restype = ctypes.c_double
        for named in ("host_start", "host_outputs"):
            getattr(self.c, named).restype = ctypes.c_char_p
        self.values = {key: float(value) for key, value in zip(own[::3], own[2::3], strict=True)}
        self.kept = [
            name.encode(),
            f"file://{folder / resources}".encode(),
        ]  # as long as the host points to it
        marks = [float(x) for x in held.strip("[]").split()]
        self.c.host_begin(self.kept[0], ctypes.c_double(0.0))
        self.give([STEP])
        self.give(marks)
        self.c.host_give(None, 0, self.kept[1])
        for value in self.values.values():
            self.give([value])
        counts = ctypes.c_int(), ctypes.c_int()
        assert self.c.host_size(*map(ctypes.byref, counts)) == STEP
        self.n_inputs, self.n_outputs = (c.value for c in counts)
        self.inputs, self.outputs = np.zeros(max(1, self.n_inputs)), np.zeros(max(1, self.n_outputs))

    def give(self, values):
        numbers = (ctypes.c_double * max(1, len(values)))(*values)
        self.kept.append(numbers)
        self.c.host_give(numbers, len(values), None)

    def start(self):
        return self.c.host_start()

    def output(self, now):
        ends = (self.inputs.ctypes.data_as(ctypes.c_void_p), self.outputs.ctypes.data_as(ctypes.c_void_p))
        return self.c.host_outputs(ctypes.c_double(now), *ends)

    def update(self):
        self.c.host_update(self.inputs.ctypes.data_as(ctypes.c_void_p))


def build(folder, function, sources, prefix, files):
    library = folder / f"{function}.so"
    if not library.exists():
        command = "cc -std=c99 -O0 -ffp-contract=off -fPIC -shared -Wall -Wextra -Werror -DMATLAB_MEX_FILE"
        places = (folder / sources, folder / "sources/fmi2", HOST)
        words = [f"-DFMI2_FUNCTION_PREFIX={prefix}_", *(f"-I{place}" for place in places)]
        parts = [folder / f"{function}.c", *(folder / sources / f for f in files)]
        done = subprocess.run(
            [*command.split(), *words, *map(str, parts), "-o", str(library), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
    return library


def simulate(script, package, command=None):
    """Signals of the script's model over `STEPS` steps: Simulink's order, Unit Delays where the script has them."""
    folder, calls = script.parent, read_script(script)
    compiled = {call[0]: call for call in calls["compile"]}
    blocks = {
        call[0]: Block(folder, call, compiled, folder / f"block_{call[0]}.so")
        for call in calls["add_sfunction"]
    }
    with read_system(package) as system:
        model = prepare(system)
        ports = {
            c: ([v.name for v in model.fmus[system.components[c].fmu.source].inputs],
                [v.name for v in model.fmus[system.components[c].fmu.source].outputs])
            for c in blocks
        }  # fmt: skip
    wires = [
        (*w[:4], float(w[4]), float(w[5]), w[6]) if len(w) > 4 else (*w, 1.0, 0.0, "")
        for w in calls["add_wire"]
    ]
    direct = {(w[0], w[2]) for w in wires if not w[6] and w[0] in blocks}
    order, waiting = [], list(blocks)
    while waiting:  # an algebraic loop has no next block
        ready = next(b for b in waiting if not any((other, b) in direct for other in waiting))
        order.append(ready)
        waiting.remove(ready)
    memory = {w: float(w[6]) for w in wires if w[6]}
    for block in blocks.values():
        assert block.start() is None
    shown = {f"{b}.{name}": np.zeros(STEPS + 1) for b in order for name in ports[b][1]}

    def now(wire, k):
        if wire[0] not in blocks:
            return command[k]
        return blocks[wire[0]].outputs[ports[wire[0]][1].index(wire[1])]

    for k in range(STEPS + 1):
        for name in order:
            block = blocks[name]
            for wire in (w for w in wires if w[2] == name):
                value = memory[wire] if wire in memory else wire[4] * now(wire, k) + wire[5]
                block.inputs[ports[name][0].index(wire[3])] = value
            assert block.output(k * STEP) is None
            for place, port in enumerate(ports[name][1]):
                shown[f"{name}.{port}"][k] = block.outputs[place]
        memory = {w: w[4] * now(w, k) + w[5] for w in memory}
        for block in blocks.values():
            block.update()
    for block in blocks.values():
        block.c.host_end()
    return shown


@pytest.mark.parametrize(
    "name",
    [
        "full_order_open",
        "physical",
        pytest.param("full_order", marks=pytest.mark.slow),
        pytest.param("position_loop", marks=pytest.mark.slow),
    ],
)
def test_s_functions_give_the_numbers_of_our_runner(name, native, tmp_path):
    times = np.arange(STEPS + 1) * STEP
    command = 0.3 * np.cos(3.0 * times)
    inputs = {"u": (times, command)} if name.endswith("_open") else {}
    shown = simulate(export(native[name], tmp_path / "out"), native[name], command)
    with Runner(native[name]) as runner:
        expected = runner.run(STEPS * STEP, STEP, inputs=inputs)
    signals = set(expected.signals) - {"u"}
    assert signals <= set(shown)
    assert max(np.ptp(x) for x in shown.values()) > 1e-3, "it moves"
    for signal in signals:
        # the same calls with the same numbers
        np.testing.assert_array_equal(shown[signal], expected.signals[signal], err_msg=signal)


def test_what_an_fmu_refuses_stops_simulink_with_its_words(native, tmp_path):
    script = export(native["full_order_open"], tmp_path / "out")
    calls = read_script(script)
    compiled = {call[0]: call for call in calls["compile"]}
    call = next(c for c in calls["add_sfunction"] if c[0] == "mechanical")
    call[call.index("J") + 2] = "-1.0"
    block = Block(script.parent, call, compiled, script.parent / "block.so")
    assert b"mechanical: J = -1.0 is refused: it must be a number from" in block.start()
    block.c.host_end()
    call[call.index("J") + 2] = "800.0"
    block = Block(script.parent, call, compiled, script.parent / "other.so")
    assert block.start() is None
    assert block.output(0.0) is None
    block.inputs[:] = np.nan
    assert b"is refused: it must be a number" in block.output(STEP)
    block.c.host_end()


def test_python_fmus_have_no_c_sources_and_other_blocks_are_unknown(built, tmp_path):
    with read_system(built["simplified"]) as system:
        model = prepare(system)
        with pytest.raises(ModelError, match="brings no C sources"):
            write_simulink(model, tmp_path / "out", blocks="s-function")
        with pytest.raises(UsageError, match="take fmu or s-function"):
            write_simulink(model, tmp_path / "out", blocks="subsystem")
    assert not (tmp_path / "out").exists()


def test_fmus_whose_functions_would_be_one_are_named(native, tmp_path):
    with read_system(native["full_order_open"]) as system:
        model = prepare(system)
        fmus = {
            key: dataclasses.replace(item, stem={"dcv": "a-b", "sensor": "a_b"}.get(item.stem, item.stem))
            for key, item in model.fmus.items()
        }
        with pytest.raises(
            ModelError, match=r"'a-b.fmu' and the S-function of 'a_b.fmu' would both be named"
        ):
            write_simulink(dataclasses.replace(model, fmus=fmus), tmp_path / "out", blocks="s-function")


def test_script_is_matlab_and_builds_the_blocks_in_a_stand_in(native, tmp_path):
    matlab = pytest.importorskip("tree_sitter_matlab")
    import tree_sitter

    script = export(native["physical"], tmp_path / "out")
    parser = tree_sitter.Parser(tree_sitter.Language(matlab.language()))
    assert parser.parse(script.read_bytes()).root_node.has_error is False
    state, err = octave(script, "build_physical()", tmp_path, native["physical"])
    assert state is not None, err
    assert "warning" not in err
    into = {(target, port): (source, out) for source, out, target, port in state["lines"]}
    given = {b["name"]: dict(b["parameters"]) for b in state["blocks"]}
    with read_system(native["physical"]) as system:
        model = prepare(system)
        assert set(state["compiled"]) == {f"{item.stem}_sfun" for item in model.fmus.values()}
        for wire in system.wires:
            source = into[tuple(wire.target)]
            if wire in model.delayed:
                assert given[source[0]]["InitialCondition"] == repr(float(model.start_of(wire.target)))
                source = into[source[0], 1]
            assert source == tuple(wire.source)
        for component in system.components.values():
            mask = given[component.name]
            names = re.findall(r"(\w+)=@\d+;", mask["MaskVariables"])
            values = dict(zip(names, map(float, mask["MaskValues"]), strict=True))
            assert values == {
                **{n: float(component.fmu.variables[n].start) for n in names},
                **model.values(component),
            }
            assert mask["Parameters"].endswith(", ".join(["", *names]))


def test_a_package_of_python_fmus_becomes_s_functions_too(built, tmp_path, capsys):
    words = ["export-simulink", str(built["simplified_open"]), "--blocks", "s-function"]
    with pytest.raises(SystemExit) as stop:
        main([*words, "--out", str(tmp_path / "s"), "--set", "simplified.k=0.7", "--json"])
    assert stop.value.code == 0, capsys.readouterr().err
    found = {Path(file).name for file in json.loads(capsys.readouterr().out)["files"]}
    assert {"build_simplified.m", "simplified_sfun.c", "model.h", "fmi2Functions.h"} <= found
    assert "'k', 'k [rad/s2]', '0.7'" in (tmp_path / "s" / "build_simplified.m").read_text()
