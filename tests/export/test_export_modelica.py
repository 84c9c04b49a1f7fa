"""The Modelica package: a Modelica compiler resolves it, and run through its C functions it gives our runner's numbers."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from modelica_events import read_package

from cosim.cli import main
from cosim.errors import ModelError
from cosim.export import prepare, write_modelica, write_simulink
from cosim.master import Runner
from cosim.ssp.read import read_system
from cosim.ssp.system import Wire

HERE = Path(__file__).parent
STEPS = 400
LEVEL = 0.6


def export(package, folder, change=lambda system: None, **options):
    """The exported package.mo."""
    with read_system(package) as system:
        change(system)
        return write_modelica(prepare(system, **options), folder)[0]


@pytest.fixture(scope="session")
def shim(built, tmp_path_factory):
    """The exported C header as a library; it compiles without a warning."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder = tmp_path_factory.mktemp("shim")
    header = export(built["simplified"], folder / "out").parent / "Resources" / "Include"
    command = ["gcc", "-shared", "-fPIC", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    command += [
        f"-I{HERE / 'include'}",
        f"-I{header}",
        str(HERE / "modelica_shim.c"),
        "-o",
        str(folder / "shim.so"),
        "-ldl",
    ]
    subprocess.run([*command, "-D_GNU_SOURCE"], check=True, capture_output=True, text=True)
    return folder / "shim.so"


def events(shim, package, out, level=0.0, steps=STEPS):
    return subprocess.run(
        [sys.executable, str(HERE / "modelica_events.py"), str(shim), str(package), str(steps), str(out), str(level)],
        capture_output=True, text=True, timeout=600, check=False, env=os.environ | {"PYTHONPATH": ""},
    )  # fmt: skip


@pytest.mark.parametrize("name", ["full_order", "simplified", "physical", "full_order_open", "physical_open"])
def test_events_give_the_numbers_of_our_runner(name, built, shim, tmp_path):
    package = export(built[name], tmp_path / "out")
    done = events(shim, package, tmp_path / "out.npz", LEVEL)
    assert done.returncode == 0, done.stderr
    times = np.arange(STEPS + 1) * 1e-3
    inputs = {"u": (times, LEVEL * np.cos(3.0 * times))} if name.endswith("_open") else {}
    with Runner(built[name]) as runner:
        expected = runner.run(STEPS * 1e-3, 1e-3, inputs=inputs)
    with np.load(tmp_path / "out.npz") as found:
        outputs = set(expected.signals) - {"u"}
        assert outputs <= set(found.files)
        assert np.ptp(found["sensor.slew"]) > 1e-4  # it moves
        for signal in outputs:
            # the same calls with the same numbers
            np.testing.assert_array_equal(found[signal], expected.signals[signal], err_msg=signal)


def test_package_holds_every_connection_and_parameter(built, tmp_path):
    for name in ("full_order", "simplified_open", "physical_open"):
        file = built[name]
        parts = read_package(export(file, tmp_path / name).read_text())
        with read_system(file) as system:
            model = prepare(system)
            assert set(parts["instances"]) == set(system.components)
            for component in system.components.values():
                given = dict(parts["instances"][component.name][1])
                assert given.pop("instanceName") == f'"{component.name}"'
                assert {k: float(v) for k, v in given.items()} == model.values(component)
            fed = {target: source for source, target in parts["connections"]}
            through = {
                t: fed.get(f"{s.removesuffix('.y')}.u", s)
                for t, s in fed.items()
                if not t.endswith("_hold.u")
            }
            wires = {str(w.target): str(w.source) for w in system.wires}
            wires |= {str(w.target): i.name for i in system.inputs.values() for w in i.targets}
            assert through == wires
            held = {t for t, s in fed.items() if s.endswith("_hold.y")}
            late = {str(w.target) for w in model.delayed | model.late}
            late |= {str(w.target) for i in system.inputs.values() for w in i.targets}
            assert held == late


def test_scaled_and_open_inputs_become_equations(built, shim, tmp_path):
    def change(system):
        scaled = [w for w in system.wires if w.target.component == "observer" and w.target.variable == "slew"]
        kept = [w for w in system.wires if w not in scaled and w.target.component != "continuity"]
        system.wires = (*kept, Wire(scaled[0].source, scaled[0].target, 2.0, -0.25))

    package = export(built["full_order"], tmp_path / "out", change)
    assert dict(read_package(package.read_text())["equations"]) == {
        "observer.slew": "(2.0) * sensor.slew + (-0.25)",
        "continuity.spool": "0.0",
    }
    done = events(shim, package, tmp_path / "out.npz")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "out.npz") as found:
        assert np.ptp(found["sensor.slew"]) == 0.0  # the valve is cut off
        assert found["observer.slew_estimate"][-1] < -1e-3  # the observer sees the offset


def compiles(text, model):
    """What a Modelica compiler says against a model: nothing if it has as many equations as unknowns, of fitting types."""
    rumoca = pytest.importorskip("rumoca")
    session = rumoca.Session(roots=[str(HERE / "modelica_stub.mo")])
    try:
        session.loads(stand_in(text), model=model)
    except rumoca.RumocaError as error:
        return str(error)
    return ""


def stand_in(text):
    """The package as Rumoca takes it.

    It has no external objects (here a handle is a number), no bodies in C that give an array (here zeros), and no
    functions of several results at events (here one after the other); it checks the arguments of a function only where
    that has a simple name (here there is no package Internal).
    """
    open_ = "".join(f" input String {n};" for n in ("folder", "identifier", "guid", "name"))
    handle = f"function Instance{open_} output Integer fmu; algorithm fmu := 1; end Instance;\n"
    pick = "function one input Real y[:]; input Integer k; output Real v; algorithm v := y[k]; end one;\n"
    text = re.sub(r"    class Instance .*?    end Instance;\n", handle + pick, text, flags=re.S)
    text = re.sub(r"\b(Internal\.)?Instance fmu\b", "Integer fmu", text).replace("impure ", "")

    def body(found):
        name, size = re.search(r"output \w+ (\w+)(?:\[(.*)\])?", found[0]).groups()
        value = f"zeros({size})" if size else "1"
        return re.sub(r'external "C".*?;\n', f"algorithm\n {name} := {value};\n", found[0], flags=re.S)

    def each(found):
        return "".join(f"{n} = one({found[2]}, {k});\n" for k, n in enumerate(found[1].split(", "), 1))

    text = re.sub(r"    function (\w+) .*?    end \1;\n", body, text, flags=re.S)
    text = re.sub(r"^ *\(([\w, ]+)\) = named\((.*)\);\n", each, text, flags=re.M)
    text = re.sub(r'^  package Internal ".*\n|^  end Internal;\n', "", text, flags=re.M)
    return text.replace("Internal.", "")


@pytest.fixture(scope="module")
def exported(built, tmp_path_factory):
    """Text of the package of full_order."""
    return export(built["full_order"], tmp_path_factory.mktemp("exported") / "out").read_text()


@pytest.mark.parametrize("name", ["full_order", "simplified", "physical", "full_order_open", "physical_open"])
def test_compiler_checks_the_package(name, built, tmp_path):
    text = export(built[name], tmp_path).read_text()
    system = name.removesuffix("_open")
    for model in [f"{system}.System"] + [f"{system}.Driven"] * name.endswith("_open"):
        assert compiles(text, model) == ""
    # one vector of outputs of several units is no vector: OpenModelica says that its units are inconsistent
    assert all(re.match(r" +(in|out)put ", line) for line in text.splitlines() if "Real y[" in line)


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ("connect(sensor.slew,", "connect(sensor.slow,", "slow"),
        ("      J = ", "      JJ = ", "JJ"),
        ("Internal.Hold ", "Internal.Holt ", "Holt"),
        ("input Real y[:]", "input Rael y[:]", "Rael"),
        ("end System;", "end Sistem;", "parse failed"),
        # what OpenModelica refused in November 2026: an empty list of Integer values that was one of Real
        (
            "fill(0, 0), fill(0, 0), fill(0, 0));",
            "fill(0.0, 0), fill(0, 0), fill(0, 0));",
            "expected `Integer`",
        ),
        ("{2}, {form}", "{2}, {m_r}", "expected `Integer`"),
        ("      form = 3,", "      form = 3.5,", "expected `Integer`"),
        ("connect(sensor.slew, observer.slew);", "", "unbalanced"),
    ],
)
def test_compiler_sees_a_fault(replaced, by, message, exported):
    assert replaced in exported
    assert message in compiles(exported.replace(replaced, by, 1), "full_order.System")


def test_script_and_table_fit_the_package(built, tmp_path):
    package = export(built["full_order_open"], tmp_path, stop=5.0)
    script = (tmp_path / "simulate.mos").read_text()
    assert f'loadFile("{package.relative_to(tmp_path).as_posix()}")' in script
    # a check that fails gives an empty text
    assert "checked := checkModel(full_order.Driven);" in script
    assert script.index('if checked == "" then\n  exit(1);') < script.index("\nsimulate(")
    assert "simulate(full_order.Driven, startTime = 0.0, stopTime = 5.0, numberOfIntervals = 5000" in script
    table = (package.parent / "Resources" / "inputs.txt").read_text().splitlines()
    assert table == ["#1", "# time [s], u [1]", "double inputs(2, 2)", "0.0 0.0", "5.0 0.0"]
    assert "experiment(StartTime = 0.0, StopTime = 5.0, Interval = 0.001" in package.read_text()
    for stem in ("dcv", "sensor"):
        folder = package.parent / "Resources" / "FMUs" / stem
        assert (folder / "modelDescription.xml").is_file()
        assert re.search(rf'"{stem}", "{{[-0-9a-f]+}}", instanceName', package.read_text())


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ('"dcv", "{', '"nothing", "{', "nothing.so cannot be loaded"),
        ("w0 = 25.23", "w0 = -1.0", "w0 = -1"),
    ],
)
def test_c_functions_name_what_fails(replaced, by, message, built, shim, tmp_path):
    package = export(built["full_order"], tmp_path / "out")
    text = package.read_text()
    assert replaced in text
    package.write_text(text.replace(replaced, by))
    done = events(shim, package, tmp_path / "out.npz", steps=5)
    assert (done.returncode, message in done.stderr, "FMU 'dcv'" in done.stderr) == (9, True, True), (
        done.stderr
    )


def test_types_that_cannot_be_written_are_refused(built, tmp_path):
    import dataclasses

    def change(system):
        dcv = system.components["dcv"]
        text = dataclasses.replace(dcv.fmu.variables["K"], name="label", kind="String", start="x")
        fmu = dataclasses.replace(dcv.fmu, variables={**dcv.fmu.variables, "label": text})
        system.components["dcv"] = dataclasses.replace(dcv, fmu=fmu)

    with pytest.raises(ModelError, match="the parameter 'label' is of type String"):
        export(built["full_order"], tmp_path / "out", change)
    assert not (tmp_path / "out").exists()


def test_command_writes_package_and_script(built, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(
            [
                "export-modelica",
                str(built["simplified"]),
                "-o",
                str(tmp_path / "m"),
                "--set",
                "simplified.a=5",
                "--step-size",
                "2 ms",
            ]
        )
    assert stop.value.code == 0
    assert "omc simulate.mos" in capsys.readouterr().out
    text = (tmp_path / "m" / "simplified" / "package.mo").read_text()
    assert "      a = 5.0," in text
    assert "step = 0.002" in text


@pytest.fixture(scope="session")
def native(tmp_path_factory):
    """A closed package of native FMUs, which need no Python."""
    from cosim.native.package import write_native_ssp
    from cosim.paths import ssp_folder
    from cosim.ssp.stimulus import stimulus_csv

    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    times = np.arange(401) * 1e-3
    stimulus = stimulus_csv(times, LEVEL * np.cos(3.0 * times))
    file = tmp_path_factory.mktemp("native") / "simplified.ssp"
    return write_native_ssp(ssp_folder() / "simplified.ssd", file, stimulus=stimulus)


def test_native_fmus_run_and_need_no_precaution(native, shim, tmp_path):
    package = export(native, tmp_path / "m")
    done = events(shim, package, tmp_path / "out.npz")
    assert done.returncode == 0, done.stderr
    with Runner(native) as runner:
        expected = runner.run(STEPS * 1e-3, 1e-3)
    with np.load(tmp_path / "out.npz") as found:
        for signal, values in expected.signals.items():
            np.testing.assert_array_equal(found[signal], values, err_msg=signal)
    with read_system(native) as system:
        script = write_simulink(prepare(system), tmp_path / "s")[0].read_text()
    assert "ython" not in script
    assert "DebugExecutionForFMUViaOutOfProcess" not in script


def test_fmu_that_is_another_one_is_named(native, shim, tmp_path):
    package = export(native, tmp_path / "m")
    package.write_text(package.read_text().replace('"sensor", "{', '"sensor", "{0'))
    done = events(shim, package, tmp_path / "out.npz", steps=5)
    assert (done.returncode, "FMU 'sensor' cannot be instantiated" in done.stderr) == (9, True), done.stderr


def test_single_fmu_is_a_system_of_one_component(built, shim, tmp_path):
    import zipfile

    with zipfile.ZipFile(built["full_order"]) as archive:
        (tmp_path / "dcv.fmu").write_bytes(archive.read("resources/dcv.fmu"))
    package = export(tmp_path / "dcv.fmu", tmp_path / "m")
    parts = read_package(package.read_text())
    assert (list(parts["instances"]), parts["inputs"]) == (["dcv"], ["demand"])
    done = events(shim, package, tmp_path / "out.npz", LEVEL, steps=100)
    assert done.returncode == 0, done.stderr
    times = np.arange(101) * 1e-3
    with Runner(tmp_path / "dcv.fmu") as runner:
        expected = runner.run(0.1, 1e-3, inputs={"demand": (times, LEVEL * np.cos(3.0 * times))})
    with np.load(tmp_path / "out.npz") as found:
        np.testing.assert_allclose(found["dcv.spool"], expected.signals["dcv.spool"], rtol=0.0, atol=1e-15)
