"""Calls that libFuzzer looks for, and any calls under valgrind, on native FMUs of FMI 2.0 and 3.0.

``COSIM_FUZZ=300 python -m pytest -m slow tests/native/test_native_fuzz.py`` searches 300 s on each FMU.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from fmu_raw import STIMULUS
from test_native_sequences import built

from cosim.native.build import build_native, write_fmu
from cosim.native.container import container
from cosim.paths import ssp_folder
from fmus import registry
from fmus.build import composed_block

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="libFuzzer and valgrind of Linux"),
]
SECONDS = float(os.environ.get("COSIM_FUZZ", "20"))  # that libFuzzer searches, one FMU
FUZZER = [
    "-fsanitize=fuzzer,address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
    "-DFUZZED",
]
FEWEST = 100  # inputs that a search must have kept: with fewer it has seen nothing of the FMU
CALLS = 3000  # under valgrind, which is fifty times slower
CHAINS = ("full_order", "physical", "simplified")
FMUS = [
    *((name, fmi) for name in registry.BLOCKS for fmi in ("2.0", "3.0")),
    *((f"{name}_chain", fmi) for name in CHAINS for fmi in ("2.0", "3.0")),
]


@pytest.fixture(params=FMUS, ids="-".join)
def fmu(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Each native FMU of each standard."""
    name, fmi = request.param
    path = tmp_path / f"{name}.fmu"
    if name.endswith("_chain"):
        return write_fmu(container(ssp_folder() / f"{name.removesuffix('_chain')}.ssd"), path, fmi=fmi)
    played = {"stimulus.csv": STIMULUS} if name == "stimulus" else None
    return build_native(composed_block(name), path, resources=played, fmi=fmi)


@pytest.fixture
def clang(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The compiler that has libFuzzer."""
    found = shutil.which("clang") or shutil.which("clang-14")
    if found is None:
        pytest.skip("libFuzzer is part of clang, which is not installed")
    empty = tmp_path / "empty.c"
    empty.write_text(
        "int LLVMFuzzerTestOneInput(const void *data, unsigned long size) { return data == (void *)size; }\n"
    )
    made = subprocess.run(
        [found, *FUZZER, str(empty), "-o", str(tmp_path / "empty")], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("this clang has no libFuzzer (Debian: libclang-rt-14-dev)")
    monkeypatch.setenv("CC", found)


def test_no_sequence_of_calls_that_libfuzzer_finds_does_harm(fmu: Path, clang: None, tmp_path: Path) -> None:
    program, resources, token = built(fmu, FUZZER, tmp_path / "unpacked")
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    options = [f"-max_total_time={SECONDS:.0f}", "-max_len=8000", "-len_control=0", "-print_final_stats=1"]
    done = subprocess.run(
        [program, *options, str(corpus)],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60.0 + 3.0 * SECONDS,
        env=os.environ | {"FMU_RESOURCES": resources, "FMU_TOKEN": token, "LC_ALL": "C"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    ran = re.search(r"number_of_executed_units: *([0-9]+)", done.stderr)
    covered = re.findall(r"cov: ([0-9]+)", done.stderr)
    assert ran is not None
    print(f"{fmu.stem}: {ran[1]} inputs, {covered[-1]} edges, {len(list(corpus.iterdir()))} kept")
    assert len(list(corpus.iterdir())) >= FEWEST


def test_any_calls_are_clean_under_valgrind(fmu: Path, tmp_path: Path) -> None:
    """What the sanitizers do not see: numbers that were never set."""
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        pytest.skip("valgrind is not installed")
    command = built(fmu, [], tmp_path / "unpacked")
    checked = [valgrind, "-q", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=all"]
    done = subprocess.run(
        [*checked, *command, "77", str(CALLS)], capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout == f"{CALLS}\n"
