"""FMUs of FMI 3.0 made by others: all types of numbers, what is left out, how a step may end, and what is said of them."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import bad_fmus
import fmpy
import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.errors import ModelError, SimulationError, UsageError
from cosim.master import Runner
from cosim.ssp import check_fmu
from cosim.ssp.fmu import KIND_OF

pytestmark = pytest.mark.skipif(
    bad_fmus.COMPILER is None or not sys.platform.startswith("linux"), reason="needs Linux and a C compiler"
)
TYPES = (
    "Float64",
    "Float32",
    "Int8",
    "UInt8",
    "Int16",
    "UInt16",
    "Int32",
    "UInt32",
    "Int64",
    "UInt64",
    "Boolean",
)
# of each type numbers at its ends and beyond, and what arrives
SENT = {
    "Float64": ([0.1, -1e300], [0.1, -1e300]),
    "Float32": ([0.1, -3e38], [float(np.float32(0.1)), float(np.float32(-3e38))]),
    "Int8": ([-3.4, 300.0], [-3.0, 127.0]),
    "UInt8": ([200.0, -5.0], [200.0, 0.0]),
    "Int16": ([-32768.0, 1e5], [-32768.0, 32767.0]),
    "UInt16": ([65535.0, -1.0], [65535.0, 0.0]),
    "Int32": ([-2147483648.0, 3e9], [-2147483648.0, 2147483647.0]),
    "UInt32": ([4294967295.0, -1.0], [4294967295.0, 0.0]),
    "Int64": ([-(2.0**53), 2.0**60], [-(2.0**53), 2.0**60]),
    "UInt64": ([2.0**53, 2.0**62], [2.0**53, 2.0**62]),
    "Boolean": ([0.7, 0.2], [1.0, 0.0]),
    "Enumeration": ([2.0, 1.0], [2.0, 1.0]),
}


def variables() -> str:
    """The variables of types_fmu3.c, and those that are left out."""
    lines = ['<Float64 name="time" valueReference="299" causality="independent" variability="continuous"/>']
    for code, name in enumerate((*TYPES, "Enumeration")):
        more = f' variability="{"continuous" if name.startswith("Float") else "discrete"}"'
        more += ' declaredType="Choice"' if name == "Enumeration" else ""
        start = {"Boolean": "false", "Enumeration": "1", "Float64": "0.5"}.get(name, "0")
        lines += [
            f'<{name} name="in_{name}" valueReference="{10 * code}" causality="input" start="{start}"{more}/>',
            f'<{name} name="out_{name}" valueReference="{10 * code + 1}" causality="output"{more}/>',
        ]
    parameter = 'causality="parameter" variability="tunable"'
    lines += [
        f'<Float64 name="ends" valueReference="200" {parameter} start="1e9" unit="Hz" displayUnit="kHz"/>',
        f'<Float64 name="early" valueReference="201" {parameter} start="1e9" unit="Hz" displayUnit="ms"/>',
        f'<Float64 name="table" valueReference="202" {parameter} start="1 2 3"><Dimension start="3"/></Float64>',
        '<Clock name="tick" valueReference="203" causality="input" intervalVariability="triggered"/>',
        f'<String name="text" valueReference="204" {parameter}><Start value="none"/></String>',
    ]
    return "\n".join(lines)


def structure() -> str:
    codes = range(0, 10 * len(TYPES) + 1, 10)
    outputs = [f'<Output valueReference="{k + 1}" dependencies=""/>' for k in codes]
    return "\n".join(outputs + [line.replace("<Output", "<InitialUnknown") for line in outputs])


DESCRIPTION = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0.1" modelName="types" instantiationToken="{{types}}">
<CoSimulation modelIdentifier="types" canHandleVariableCommunicationStepSize="true" hasEventMode="true"/>
<UnitDefinitions><Unit name="Hz"><BaseUnit s="-1"/>
<DisplayUnit name="ms" factor="1000.0" inverse="true"/><DisplayUnit name="kHz" factor="0.001"/>
</Unit></UnitDefinitions>
<TypeDefinitions><EnumerationType name="Choice">
<Item name="a" value="1"/><Item name="b" value="2"/>
</EnumerationType></TypeDefinitions>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.1" tolerance="1e-4"/>
<ModelVariables>
{variables()}
</ModelVariables>
<ModelStructure>
{structure()}
</ModelStructure>
</fmiModelDescription>
"""


@pytest.fixture(scope="module")
def fmu(tmp_path_factory) -> Path:
    """The FMU, compiled."""
    folder = tmp_path_factory.mktemp("types")
    library = folder / "types.so"
    headers = Path(fmpy.__file__).parent / "c-code"
    source = Path(__file__).resolve().parent / "types_fmu3.c"
    command = [
        str(bad_fmus.COMPILER),
        "-shared",
        "-fPIC",
        "-O1",
        "-std=c99",
        f"-I{headers}",
        "-o",
        str(library),
    ]
    subprocess.run([*command, str(source)], check=True)
    path = folder / "types.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        archive.write(library, f"binaries/{fmpy.platform_tuple}/types{fmpy.sharedLibraryExtension}")
    return path


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_numbers_of_every_type_arrive(fmu, engine) -> None:
    with Runner(fmu) as runner:
        inputs = {f"in_{n}": (np.array([0.0, 0.3]), np.array(sent)) for n, (sent, _) in SENT.items()}
        record = [f"types.out_{n}" for n in SENT]
        found = runner.run(0.5, 0.1, inputs=inputs, hold=list(inputs), record=record, engine=engine)
    for name, (_, arrived) in SENT.items():
        first, second = arrived
        assert list(found.signals[f"types.out_{name}"]) == [first] * 4 + [second] * 2, name


def test_start_values_and_text(fmu) -> None:
    with Runner(fmu) as runner:
        assert runner.run(0.2, 0.1).signals["types.out_Float64"][-1] == 0.5
        parameters = {
            "types.text": "minus",
            "types.in_Int64": 7,
            "types.in_Boolean": True,
            "types.in_Enumeration": 2,
        }
        record = [f"types.out_{n}" for n in ("Float64", "Int64", "Boolean", "Enumeration")]
        found = runner.run(0.2, 0.1, parameters=parameters, record=record)
        assert [values[-1] for values in found.signals.values()] == [-0.5, 7.0, 1.0, 2.0]
        assert runner.run(0.2, 0.1).signals["types.out_Float64"][-1] == 0.5, (
            "a run begins from the start values"
        )


@pytest.mark.parametrize("engine", ["compiled", "python"])
@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        ("ends", r"failed in fmi3DoStep at t = 0\.3 s \(status OK, but it asks to end the simulation\)"),
        ("early", r"failed in fmi3DoStep at t = 0\.3 s \(status OK, but before the step's end\)"),
    ],
)
def test_how_a_step_may_end(fmu, engine, parameter, text) -> None:
    with Runner(fmu) as runner, pytest.raises(SimulationError, match=text):
        runner.run(1.0, 0.1, parameters={f"types.{parameter}": 0.35}, engine=engine)


def test_what_it_says_is_heard_and_no_format(fmu) -> None:
    with Runner(fmu) as runner:
        with pytest.raises(SimulationError, match=r"refuses in_Float64 = 100\.0: 100 %s is too much"):
            runner.run(0.2, 0.1, parameters={"types.in_Float64": 100.0})
        with pytest.raises(
            SimulationError, match=r"fmi3SetFloat64 at t = 0\.1 s \(status Error\): 100 %s is too much"
        ):
            runner.run(
                0.5,
                0.1,
                inputs={"in_Float64": (np.array([0.0, 0.1, 1.0]), np.array([0.0, 100.0, 0.0]))},
                hold=["in_Float64"],
            )


def test_arrays_and_clocks_are_left_out_and_said(fmu) -> None:
    with Runner(fmu) as runner:
        notes = runner.system.notes
        assert notes == [
            "types.fmu: arrays, clocks and binary data are left out and keep their start values: table, tick"
        ]
        with pytest.raises(UsageError, match="table"):
            runner.run(0.2, 0.1, parameters={"types.table": 1.0})
        fmu_read = runner.system.components["types"].fmu
    shown = [(v.display_unit, v.display_factor) for v in map(fmu_read.variables.get, ("ends", "early")) if v]
    assert shown == [("kHz", 0.001), ("", 1.0)], "the inverse of a unit is not shown as a multiple of it"
    assert (fmu_read.version, fmu_read.guid) == ("3.0", "{types}")
    assert {fmu_read.variables[f"in_{n}"].kind for n in SENT} == set(KIND_OF.values()) - {"String"}


def test_info_and_validate(fmu) -> None:
    app, run = make_app(), CliRunner()
    facts = json.loads(run.invoke(app, ["info", str(fmu), "--json"]).stdout)
    assert (facts["fmi_version"], facts["type"], facts["guid"]) == ("3.0.1", "co-simulation", "{types}")
    assert facts["platforms"] == fmpy.platform
    assert run.invoke(app, ["validate", str(fmu)]).exit_code == 3
    missing, note = check_fmu(fmu)
    assert "exports no fmi3ActivateModelPartition, fmi3CompletedIntegratorStep, " in missing.text
    assert missing.text.endswith("which FMI 3.0 demands of every FMU; it is run all the same")
    assert (missing.severity, note.severity) == ("error", "warning")


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('start="1 2 3"', 'start="1 1e999 3"', "'table' has a bad number: start='1e999' is no finite number"),
        ('start="1 2 3"', 'start="1 nan 3"', "'table' has a bad number: start='nan'"),
        ('start="1 2 3"', 'start="1 2 3" max="inf"', "'table' has a bad number: max='inf'"),
        ('start="1 2 3"', 'start="1 b 3"', "'table' has a bad number: start='b' is no number"),
        (
            '"in_Float32" valueReference="10" causality="input" start="0"',
            '"in_Float32" valueReference="10" causality="input" start="1e39"',
            "'in_Float32' has a bad number: start='1e39' is no finite number",
        ),
        (
            "<TypeDefinitions>",
            '<TypeDefinitions><Float64Type name="T" nominal="-Infinity"/>',
            "the type 'T' has a bad number: nominal='-Infinity'",
        ),
    ],
)
def test_numbers_that_are_not_finite_are_invalid(fmu, tmp_path, old, new, place) -> None:
    bad, description = tmp_path / "bad.fmu", DESCRIPTION.replace(old, new)
    assert description != DESCRIPTION
    with zipfile.ZipFile(fmu) as archive, zipfile.ZipFile(bad, "w") as other:
        for name in archive.namelist():
            text = description if name == "modelDescription.xml" else archive.read(name)
            other.writestr(name, text)
    assert place in check_fmu(bad)[0].text
    with pytest.raises(ModelError, match="has a bad number"):
        Runner(bad)


def test_a_library_without_functions_of_fmi_3_is_refused(fmu, tmp_path) -> None:
    library = tmp_path / "empty.so"
    (tmp_path / "empty.c").write_text("int nothing(void) { return 0; }\n")
    subprocess.run(
        [str(bad_fmus.COMPILER), "-shared", "-fPIC", "-o", library, tmp_path / "empty.c"], check=True
    )
    path = tmp_path / "types.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        archive.write(library, f"binaries/{fmpy.platform_tuple}/types{fmpy.sharedLibraryExtension}")
    with pytest.raises(
        ModelError, match=r"exports no fmi3InstantiateCoSimulation, .* more functions of FMI 3\.0"
    ):
        Runner(path)
