"""FMUs of other exporters are run as fmpy runs them: order of calls, steps to the last bit, no reset."""

import subprocess
import sys
import zipfile
from pathlib import Path

import bad_fmus
import fmpy
import numpy as np
import pytest

from cosim.master import Runner
from cosim.ssp import check_fmu

pytestmark = pytest.mark.skipif(
    bad_fmus.COMPILER is None or not sys.platform.startswith("linux"), reason="needs Linux and a C compiler"
)
SOURCE = Path(__file__).resolve().parent / "clock_fmu.c"
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="clock" guid="{guid}" numberOfEventIndicators="0">
<CoSimulation modelIdentifier="NAME" canHandleVariableCommunicationStepSize="true"/>
<DefaultExperiment startTime="0" stopTime="20" stepSize="0.01" tolerance="1e-4"/>
<ModelVariables>
<ScalarVariable name="x" valueReference="0" causality="output" initial="calculated"><Real/></ScalarVariable>
<ScalarVariable name="u" valueReference="1" causality="input"><Real start="0.0"/></ScalarVariable>
<ScalarVariable name="k" valueReference="2" causality="parameter" variability="tunable"><Real start="1.0"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="1" dependencies=""/></Outputs>
<InitialUnknowns><Unknown index="1" dependencies=""/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def build(folder: Path, name: str = "clock", failing: bool = False) -> Path:
    """Compile the FMU of the folder."""
    library = folder / f"{name}.so"
    command = [
        str(bad_fmus.COMPILER),
        "-shared",
        "-fPIC",
        "-O1",
        f"-DFAILING={int(failing)}",
        "-o",
        str(library),
    ]
    subprocess.run([*command, str(SOURCE)], check=True)
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION.replace("NAME", name))
        archive.write(library, f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}")
    return path


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_a_run_equals_that_of_fmpy_up_to_the_stop_time(tmp_path: Path, engine: str) -> None:
    path = build(tmp_path)
    theirs = fmpy.simulate_fmu(
        str(path), stop_time=20.0, output_interval=0.01, start_values={"k": 0.5}, output=["x"]
    )
    with Runner(path) as runner:
        ours = runner.run(20.0, 0.01, parameters={"clock.k": 0.5}, engine=engine)  # type: ignore[arg-type]
    assert np.array_equal(ours["clock.x"], theirs["x"])
    assert ours["clock.x"][100] == pytest.approx(0.995**100)


@pytest.mark.parametrize("failing", [False, True])
def test_an_fmu_that_no_reset_brings_back_runs_anew_each_time(tmp_path: Path, failing: bool) -> None:
    path = build(tmp_path, failing=failing)
    step = (np.array([0.0, 3.0, 3.01, 5.0]), np.array([0.0, 0.0, 1.0, 1.0]))
    with Runner(path) as runner:
        runs = [
            runner.run(5.0, 0.01, parameters={"clock.k": 0.0}, inputs={"clock.u": step}) for _ in range(3)
        ]
    assert runs[0]["clock.x"][-1] == pytest.approx(3.0, abs=0.02)
    for again in runs[1:]:
        assert np.array_equal(again["clock.x"], runs[0]["clock.x"])


def test_a_library_whose_name_is_no_c_name_runs_with_a_warning(tmp_path: Path) -> None:
    path = build(tmp_path, "water-tank")
    with Runner(path) as runner:
        found = runner.run(1.0, 0.01)
    assert found["water-tank.x"][-1] == pytest.approx(0.99**100)
    assert [n for n in found.notes if "modelIdentifier='water-tank' is no C identifier" in n]
    assert [p for p in check_fmu(path) if p.severity == "error" and "no C identifier" in p.text]
