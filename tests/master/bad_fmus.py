"""FMUs that do harm, compiled from bad_fmu.c: what a stranger's native code can do to the process that runs it."""

import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy

HERE = Path(__file__).resolve().parent
COMPILER = shutil.which("cc")

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="bad" guid="{guid}" numberOfEventIndicators="0">
<CoSimulation modelIdentifier="bad"/>
<UnitDefinitions><Unit name="m"><BaseUnit m="1" factor="1"/></Unit></UnitDefinitions>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.01"/>
<ModelVariables>
<ScalarVariable name="y" valueReference="0" causality="output" initial="calculated"><Real unit="m"/></ScalarVariable>
<ScalarVariable name="u" valueReference="1" causality="input"><Real start="0.0"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="1" dependencies=""/></Outputs>
<InitialUnknowns><Unknown index="1" dependencies=""/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def build(mischief: str, folder: Path) -> Path:
    """Compile ``folder/MISCHIEF.fmu``."""
    library = folder / f"{mischief}.so"
    source = HERE / "bad_fmu.c"
    subprocess.run(
        [str(COMPILER), "-shared", "-fPIC", "-O1", f"-DMISCHIEF={mischief}", "-o", str(library), str(source)],
        check=True,
        capture_output=True,
    )
    return pack(folder / f"{mischief.lower()}.fmu", library.read_bytes())


def pack(
    path: Path,
    library: bytes | None,
    change: Callable[[str], str] = str,
    others: dict[str, bytes] | None = None,
) -> Path:
    """An FMU of a library (None leaves it out) and the description, changed; `others` are further entries."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", change(DESCRIPTION))
        if library is not None:
            archive.writestr(f"binaries/{fmpy.platform}/bad{fmpy.sharedLibraryExtension}", library)
        for name, content in (others or {}).items():
            archive.writestr(name, content)
    return path
