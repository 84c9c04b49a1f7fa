"""Any FMI calls in any order on every native FMU, under the address and undefined-behaviour sanitizers."""

import os
import subprocess
import zipfile
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmu_raw import STIMULUS
from test_native_host import CHECKED, sanitizers

from cosim.native.build import build_native, compiler
from fmus import registry
from fmus.build import composed_block

HERE = Path(__file__).resolve().parent
CALLS = 20_000
SEEDS = int(os.environ.get("COSIM_SEQUENCES", "5"))  # of CALLS calls each, one FMU

__all__ = ["sanitizers"]


def built(fmu: Path, options: list[str], folder: Path) -> list[str]:
    """The program with an FMU's sources inside, and what it is told of the FMU."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    description = read_model_description(str(fmu), validate=False)
    third = description.fmiVersion == "3.0"
    program = folder / "sequences"
    source = HERE / ("sequences3.c" if third else "sequences.c")
    inside = [f"-I{folder / 'sources'}", str(source), "-lm", "-o", str(program)]
    command = [*compiler(), *CHECKED, *options, *inside]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    resources = folder / "resources"
    return [str(program), f"{resources}/" if third else resources.as_uri(), description.guid]


def ran(command: list[str], seed: int, calls: int) -> None:
    """One sequence of calls, without an error of memory, an undefined operation or a leak."""
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=1", "LC_ALL": "C"}
    done = subprocess.run(
        [*command, str(seed), str(calls)], capture_output=True, text=True, env=environment, check=False, timeout=900
    )  # fmt: skip
    assert done.returncode == 0, f"seed {seed}: {done.stderr[-3000:]}"
    assert done.stdout == f"{calls}\n"
    assert "runtime error" not in done.stderr


@pytest.mark.parametrize("which", [pytest.param("mechanical", marks=pytest.mark.slow), "full_order"])
def test_some_calls_in_any_order_do_no_harm(fmu_files, chains, sanitizers, tmp_path, which) -> None:
    """The chain holds the mechanics; a block by itself is called in any order below, by FMI 3."""
    ran(built(chains.get(which) or fmu_files[which], sanitizers, tmp_path), 1, CALLS)


def test_some_calls_of_fmi_3_in_any_order_do_no_harm(sanitizers, tmp_path) -> None:
    fmu = build_native(composed_block("mechanical"), tmp_path / "mechanical.fmu", fmi="3.0")
    ran(built(fmu, sanitizers, tmp_path / "unpacked"), 1, CALLS)


@pytest.mark.slow
@pytest.mark.parametrize("which", registry.BLOCKS)
def test_many_calls_of_fmi_3_in_any_order_do_no_harm(sanitizers, tmp_path, which) -> None:
    played = {"stimulus.csv": STIMULUS} if which == "stimulus" else None
    fmu = build_native(composed_block(which), tmp_path / f"{which}.fmu", resources=played, fmi="3.0")
    command = built(fmu, sanitizers, tmp_path / "unpacked")
    for seed in range(2, 2 + SEEDS):
        ran(command, seed, CALLS)


@pytest.mark.slow
@pytest.mark.parametrize("which", [*registry.BLOCKS, "full_order", "physical", "simplified_chain"])
def test_many_calls_in_any_order_do_no_harm(fmu_files, chains, sanitizers, tmp_path, which) -> None:
    fmu = chains.get(which.removesuffix("_chain")) if which not in registry.BLOCKS else fmu_files[which]
    command = built(fmu, sanitizers, tmp_path)
    for seed in range(2, 2 + SEEDS):
        ran(command, seed, CALLS)
