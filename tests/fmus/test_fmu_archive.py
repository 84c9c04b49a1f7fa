"""What lies in an FMU: valid, reproducible byte for byte, nothing of the machine that built it."""

import hashlib
import os
import re
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu
from fmu_raw import STIMULUS

from cosim.errors import UsageError
from fmus import registry
from fmus.build import PICTURES, build_blocks, build_fmu, composed_block

TOP = Path(__file__).resolve().parents[2]
SCRIPT = """
import sys, pathlib
sys.path.insert(0, sys.argv[1])
from fmus.build import build_blocks
build_blocks(pathlib.Path(sys.argv[2]), sys.argv[3].encode())
"""


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_fmpy_finds_nothing_wrong(fmu_files, name) -> None:
    assert validate_fmu(str(fmu_files[name])) == []


@pytest.mark.slow
def test_building_again_gives_the_same_bytes(fmu_files, tmp_path) -> None:
    again = build_blocks(tmp_path / "a folder with spaces", STIMULUS)
    assert {p.stem: digest(p) for p in again} == {n: digest(p) for n, p in fmu_files.items()}


def test_another_process_with_another_hash_seed_gives_the_same_bytes(fmu_files, tmp_path) -> None:
    """In a folder of another name, too."""
    environment = os.environ | {"PYTHONHASHSEED": "4711", "TZ": "Asia/Tokyo", "LC_ALL": "C"}
    folder = tmp_path / "a folder with spaces"
    command = [sys.executable, "-c", SCRIPT, str(TOP), str(folder), STIMULUS.decode()]
    subprocess.run(command, check=True, env=environment, cwd=tmp_path)
    assert {n: digest(folder / f"{n}.fmu") for n in fmu_files} == {n: digest(p) for n, p in fmu_files.items()}


def test_any_change_of_content_gives_another_guid_and_module(fmu_files, tmp_path) -> None:
    changed = build_fmu(composed_block("dcv"), tmp_path / "dcv.fmu", {"K": 2.4e-3})
    old, new = (read_model_description(str(p)).guid for p in (fmu_files["dcv"], changed))
    assert old != new
    assert module_name(fmu_files["dcv"]) != module_name(changed)
    other = build_fmu(
        composed_block("stimulus"), tmp_path / "s.fmu", resources={"stimulus.csv": b"time,u\n0,1\n"}
    )
    assert read_model_description(str(other)).guid != read_model_description(str(fmu_files["stimulus"])).guid


def module_name(fmu: Path) -> str:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read("resources/slavemodule.txt").decode().strip()


def test_module_names_are_unique(fmu_files) -> None:
    """pythonfmu shares modules by name within a process: a digest in the name keeps two FMUs apart (PITFALLS)."""
    names = {n: module_name(p) for n, p in fmu_files.items()}
    assert len(set(names.values())) == len(names)
    for name, module in names.items():
        assert re.fullmatch(f"{name}_[0-9a-f]{{12}}", module)


def test_what_belongs_in_it_is_in_it(fmu_files, name) -> None:
    with zipfile.ZipFile(fmu_files[name]) as archive:
        assert archive.testzip() is None
        files = archive.namelist()
        assert files == sorted(files)
        page = archive.read("documentation/index.html").decode()
        assert "../model.png" in page
        for variable in read_model_description(str(fmu_files[name])).modelVariables:
            assert variable.name in page
        picture = archive.read("model.png")
        assert picture == (PICTURES / f"{name}.png").read_bytes()
        width, height = struct.unpack(">II", picture[16:24])
        assert picture[:8] == b"\x89PNG\r\n\x1a\n"
        assert min(width, height) >= 100
        assert len(picture) < 15_000
        assert {f"binaries/linux64/{name}.so", f"binaries/win64/{name}.dll"} <= set(files)
        assert "resources/model_description.xml" not in files
        assert {i.date_time for i in archive.infolist()} == {(2026, 1, 1, 0, 0, 0)}


def test_nothing_of_one_machine_is_in_it(fmu_files, name) -> None:
    """No path of this checkout, of the temporary folder or of the interpreter, in any file."""
    with zipfile.ZipFile(fmu_files[name]) as archive:
        for file in archive.namelist():
            if file.startswith("binaries/"):
                continue  # pythonfmu's own, the same for everybody
            content = archive.read(file)
            for path in (TOP, Path(sys.prefix), fmu_files[name].parent):
                assert str(path).encode() not in content, file
            assert not re.search(rb"(?<![\w.:/<])/(?:tmp|home|root|usr|work)/", content), file


def test_description_says_what_clients_need(fmu_files, name) -> None:
    """PITFALLS: units, bounds, explicit variability, outputs calculated and among InitialUnknowns, a date in UTC."""
    description = read_model_description(str(fmu_files[name]))
    block = registry.block(name)
    assert description.coSimulation.canHandleVariableCommunicationStepSize
    assert description.coSimulation.canGetAndSetFMUstate
    assert description.coSimulation.canSerializeFMUstate
    assert not description.coSimulation.needsExecutionTool
    assert description.generationDateAndTime.endswith("Z")
    assert float(description.defaultExperiment.stepSize) == pytest.approx(block.step_size)
    known = {u.name for u in description.unitDefinitions}
    for v in description.modelVariables:
        assert v.variability in ("continuous", "discrete", "fixed"), v.name
        assert v.description, v.name
        assert (v.start is not None) == (v.causality != "output"), v.name
        if v.type == "Real":
            assert v.unit in known, v.name
        if v.causality == "parameter":
            assert v.min is not None or v.max is not None or v.name == "", v.name
    outputs = {v.name for v in description.modelVariables if v.causality == "output"}
    assert {u.variable.name for u in description.initialUnknowns} == outputs == set(block.outputs)


def test_a_bad_start_value_is_refused(tmp_path) -> None:
    mechanical = composed_block("mechanical")
    with pytest.raises(UsageError, match=r"mechanical has no 'j_total'"):
        build_fmu(mechanical, tmp_path / "m.fmu", {"j_total": 1.0})
    with pytest.raises(UsageError, match=r"mechanical\.J = -1\.0 kg\.m2 is not within"):
        build_fmu(mechanical, tmp_path / "m.fmu", {"J": -1.0})
    with pytest.raises(UsageError, match=r"nan"):
        build_fmu(mechanical, tmp_path / "m.fmu", {"J": float("nan")})
    with pytest.raises(UsageError, match=r"form = 1\.5 is not a whole number"):
        build_fmu(composed_block("dead_zone"), tmp_path / "d.fmu", {"form": 1.5})
    assert not list(tmp_path.glob("*.fmu"))
