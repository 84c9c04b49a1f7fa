"""The MATLAB script: it parses as MATLAB, and builds the package's system in a Simulink that only keeps the books."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from cosim.cli import main
from cosim.errors import ModelError
from cosim.export import prepare, write_simulink
from cosim.ssp.read import read_system
from cosim.ssp.system import Wire

MOCK = Path(__file__).parent / "simulink_mock"
FMU_BLOCK = "simulink_extras/FMU Import/FMU"


def export(package, folder, **options):
    with read_system(package) as system:
        return write_simulink(prepare(system, **options), folder)[0]


def octave(script, words, tmp_path, package, labelled=True, **environment):
    """Run a line of Octave beside the script; the ports of each FMU come in reverse order."""
    if shutil.which("octave-cli") is None:
        pytest.skip("GNU Octave is not installed: apt-get install octave")
    with read_system(package) as system:
        fmus = {
            item.stem: {
                "inputs": [v.name for v in item.inputs][::-1],
                "outputs": [v.name for v in item.outputs][::-1],
                "parameters": [v.name for v in item.parameters],
                "labelled": labelled,
            }
            for item in prepare(system).fmus.values()
        }
    ports, out = tmp_path / "ports.json", tmp_path / "books.json"
    ports.write_text(json.dumps(fmus))
    settings = {"SIMULINK_MOCK": str(ports), "MOCK_MATLAB": "9.6", "MOCK_COMPUTER": "GLNXA64"}
    line = "warning('off', 'Octave:shadowed-function'); "
    line += (
        f"setenv('LD_PRELOAD', 'libpython3.so'); addpath('{MOCK}'); {words}; mock_simulink('dump', '{out}');"
    )
    done = subprocess.run(
        ["octave-cli", "--norc", "--quiet", "--eval", line],
        cwd=script.parent, env=os.environ | settings | environment, capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    return json.loads(out.read_text()) if out.exists() else None, done.stderr


def books(state):
    """What was built: FMU blocks with their parameters, wires between FMU ports, the ports that are logged."""
    blocks = {b["name"]: b for b in state["blocks"]}
    given = {name: dict(b["parameters"]) for name, b in blocks.items()}
    into = {(target, port): (source, out) for source, out, target, port in state["lines"]}

    def origin(port):
        """The FMU port or source block behind a wire, and the blocks between."""
        source, between = into[port], []
        while blocks[source[0]]["kind"].split("/")[1] in ("Discrete", "Math Operations"):
            between.append(source[0])
            source = into[source[0], 1]
        return source, between

    fmus = {name: given[name] for name, b in blocks.items() if b["kind"] == FMU_BLOCK}
    wires = {port: origin(port) for port in into if port[0] in fmus}
    logged = {
        given[name]["VariableName"]: into[name, 1]
        for name, b in blocks.items()
        if b["kind"] == "simulink/Sinks/To Workspace"
    }
    return fmus, wires, logged, given


@pytest.mark.parametrize("name", ["full_order", "simplified_open", "physical"])
def test_script_is_matlab_without_an_error(name, built, tmp_path):
    matlab = pytest.importorskip("tree_sitter_matlab")
    import tree_sitter

    parser = tree_sitter.Parser(tree_sitter.Language(matlab.language()))
    tree = parser.parse(export(built[name], tmp_path).read_bytes())
    assert tree.root_node.has_error is False
    functions = [n for n in tree.root_node.children if n.type == "function_definition"]
    assert len(functions) > 10
    broken = parser.parse(
        export(built[name], tmp_path / "b").read_bytes().replace(b"end\nend", b"end end)", 1)
    )
    assert broken.root_node.has_error is True


@pytest.mark.parametrize("name", ["full_order", "simplified", "physical"])
def test_script_builds_the_system_of_the_package(name, built, tmp_path):
    script = export(built[name], tmp_path / "out")
    state, err = octave(script, f"build_{name}()", tmp_path, built[name])
    assert state is not None, err
    assert "warning" not in err
    fmus, wires, logged, _ = books(state)
    with read_system(built[name]) as system:
        model = prepare(system)
        assert set(fmus) == set(system.components)
        for component in system.components.values():
            found = dict(fmus[component.name])
            assert found.pop("FMUName") == Path(component.fmu.source).name
            assert (tmp_path / "out" / Path(component.fmu.source).name).stat().st_size > 0
            assert float(found.pop("FMUSampleTime")) == 1e-3
            assert found.pop("Position")
            assert {k: float(v) for k, v in found.items()} == model.values(component)  # every digit
        assert {port: source for port, (source, _) in wires.items()} == {
            tuple(w.target): tuple(w.source) for w in system.wires
        }
        delayed = {tuple(w.target) for w in model.delayed}
        assert {port for port, (_, between) in wires.items() if between} == delayed
        assert len(delayed) == (1 if name == "physical" else 0)
        outputs = {
            (c.name, v.name) for c in system.components.values() for v in model.fmus[c.fmu.source].outputs
        }
        assert set(logged.values()) == outputs
        assert state["settings"] == {
            "SolverType": "Fixed-step", "Solver": "FixedStepDiscrete", "FixedStep": "0.001", "StartTime": "0.0",
            "StopTime": "0.5", "ReturnWorkspaceOutputs": "on", "DebugExecutionForFMUViaOutOfProcess": "on",
        }  # fmt: skip
    assert state["saved"] == str(tmp_path / "out" / f"{name}.slx")


def test_open_input_follows_what_it_is_given(built, tmp_path):
    script = export(built["full_order_open"], tmp_path / "out", stop=3.0)
    words = "build_full_order(struct('u', [0 0.5; 1 -0.5]), 2)"
    state, err = octave(script, words, tmp_path, built["full_order_open"])
    assert state is not None, err
    _, wires, _, given = books(state)
    assert state["workspace"]["u"] == [[0, 0.5], [1, -0.5]]
    assert {port for port, (source, _) in wires.items() if source == ("u", 1)} == {
        ("compensator", "command"),
        ("observer", "u"),
    }
    assert given["u"]["Interpolate"] == "off"  # our master holds u over each step
    assert state["settings"]["StopTime"] == "2"
    kept, _ = octave(script, "build_full_order()", tmp_path, built["full_order_open"])
    assert kept["workspace"]["u"] == [0, 0]
    assert kept["settings"]["StopTime"] == "3"


def test_blocks_without_labels_are_wired_by_declaration_and_said_to_be(built, tmp_path):
    """The mock reverses the ports, so what is wired without labels is not right; the script says that it cannot know."""
    script = export(built["full_order"], tmp_path / "out")
    state, err = octave(script, "build_full_order()", tmp_path, built["full_order"], labelled=False)
    assert state is not None, err
    assert "shows no port labels: port demand is taken in the order of the model description" in err


REFUSALS = [
    ("setenv('MOCK_MATLAB', '9.5')", "build_full_order()", "MATLAB R2019a or newer is needed"),
    ("setenv('MOCK_NO_SIMULINK', '1')", "build_full_order()", "Simulink is not installed"),
    (
        "setenv('MOCK_COMPUTER', 'MACA64')",
        "build_full_order()",
        "linux64, win64 only, not for this computer (darwin64)",
    ),
    ("setenv('LD_PRELOAD', '')", "build_full_order()", "Start MATLAB with it: LD_PRELOAD="),
    ("setenv('PATH', '/nowhere')", "build_full_order()", "The FMUs need Python 3"),
    ("mkdir('a+b'); cd('a+b')", "build_full_order()", 'crash in folders with a "+"'),
    ("new_system('full_order')", "build_full_order()", "The model full_order is open. Close it first"),
    ("", "build_full_order(struct('v', [0 1]))", "There is no open input v; the open inputs are: u"),
    ("", "build_full_order(struct('u', 1:3))", "u has to be a matrix with the columns time and value"),
]


def test_script_says_what_is_missing_before_it_builds(built, tmp_path):
    script = export(built["full_order_open"], tmp_path / "out")
    known = ("MOCK_MATLAB", "MOCK_NO_SIMULINK", "MOCK_COMPUTER", "LD_PRELOAD", "PATH")
    save = " ".join(f"{name}_ = getenv('{name}');" for name in known)
    restore = " ".join(f"setenv('{name}', {name}_);" for name in known)
    cases = [
        f"try, {before}; {call}; disp('BUILT'); catch e, disp(e.message); end; cd('{script.parent}'); {restore}"
        " mock_simulink('close_system');"
        for before, call, _ in REFUSALS
    ]
    words = f"addpath(pwd); {save} diary('{tmp_path / 'said.txt'}'); {' '.join(cases)} diary('off')"
    state, err = octave(script, words, tmp_path, built["full_order_open"])
    said = (tmp_path / "said.txt").read_text().splitlines()
    assert len(said) == len(REFUSALS), (said, err)
    for (_, _, message), text in zip(REFUSALS, said, strict=True):
        assert message in text
    assert state["blocks"] == []


def test_fmu_of_another_version_is_named(built, tmp_path):
    script = export(built["full_order"], tmp_path / "out")
    text = script.read_text().replace("'dcv', 'spool', 'continuity'", "'dcv', 'spoon', 'continuity'")
    script.write_text(text)
    state, err = octave(script, "build_full_order()", tmp_path, built["full_order"])
    assert state is None
    assert "The FMU block dcv has no output port spoon; it has: spool_rate, spool." in err


def test_scaled_wire_gets_gain_and_bias(built, tmp_path):
    with read_system(built["full_order"]) as system:
        wire = next(w for w in system.wires if w.target.component == "mechanical")
        system.wires = tuple(Wire(w.source, w.target, 2.0, -1.0) if w is wire else w for w in system.wires)
        script = write_simulink(prepare(system), tmp_path / "out")[0]
    state, err = octave(script, "build_full_order()", tmp_path, built["full_order"])
    assert state is not None, err
    _, wires, _, given = books(state)
    source, between = wires["mechanical", "p_load"]
    assert source == ("continuity", "p_load")
    assert {given[b].get("Gain") or given[b].get("Bias") for b in between} == {"2.0", "-1.0"}


def test_parameter_that_simulink_cannot_name_is_refused(built, tmp_path):
    import dataclasses

    with read_system(built["full_order"]) as system:
        dcv = system.components["dcv"]
        for name in ("x" * 56, "a.b"):
            variable = dataclasses.replace(dcv.fmu.variables["K"], name=name)
            fmu = dataclasses.replace(dcv.fmu, variables={**dcv.fmu.variables, name: variable})
            system.components["dcv"] = dataclasses.replace(dcv, fmu=fmu, starts={name: 1.0})
            with pytest.raises(ModelError, match="at most 55 characters"):
                write_simulink(prepare(system), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_command_writes_script_and_fmus(built, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(
            [
                "export-simulink",
                str(built["full_order"]),
                "--out",
                str(tmp_path / "s"),
                "--set",
                "mechanical.J=900 kg.m2",
                "--json",
            ]
        )
    assert stop.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert Path(found["files"][0]).name == "build_full_order.m"
    assert "'J', '900.0'" in Path(found["files"][0]).read_text()
