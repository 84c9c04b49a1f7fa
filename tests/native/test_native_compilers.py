"""The sources compile as C99 and as C++17, need no complex numbers, and give the same numbers bit for bit."""

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmu_raw import OK, Instance

from fmus import registry

STRICT = ("-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off")
COMPILERS = {
    "gcc": ("gcc", "-std=c99", *STRICT),
    "clang": ("clang", "-std=c99", *STRICT),
    "g++": ("g++", "-std=c++17", "-x", "c++", *STRICT),
    "clang++": ("clang++", "-std=c++17", "-x", "c++", *STRICT),
    "tcc": ("tcc", "-Wall", "-Werror"),
}


@pytest.fixture(params=[pytest.param(c, marks=pytest.mark.slow if c == "clang++" else ()) for c in COMPILERS])
def command(request) -> tuple[str, ...]:
    """A compiler's command."""
    if shutil.which(request.param) is None:
        pytest.skip(f"{request.param} is not installed")
    return COMPILERS[request.param]


@pytest.fixture(scope="module")
def folders(fmu_files, chains, tmp_path_factory) -> list[Path]:
    """Every block and every chain, unpacked."""
    top = tmp_path_factory.mktemp("sources")
    for file in (*fmu_files.values(), *chains.values()):
        with zipfile.ZipFile(file) as archive:
            archive.extractall(top / file.stem)
    return sorted(top.iterdir())


def compiled(command: tuple[str, ...], folder: Path, *options: str) -> None:
    done = subprocess.run(
        [*command, *options],
        cwd=folder / "sources",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_every_source_compiles(folders, command, tmp_path) -> None:
    assert len(folders) == len(registry.BLOCKS) + 3
    for folder in folders:
        quick = (
            ("-c", "fmu.c", "-o", str(tmp_path / "object.o"))
            if command[0] == "tcc"
            else ("-fsyntax-only", "fmu.c")
        )
        compiled(command, folder, *quick)


def test_no_source_needs_complex_numbers(folders) -> None:
    for folder in folders:
        for source in (folder / "sources").glob("*.[ch]"):
            text = re.sub(r"/\*.*?\*/", "", source.read_text(), flags=re.S)
            assert not re.search(r"\bcomplex\b|\b_Complex\b|\bcreal\b", text), source.name


def run(folder: Path) -> np.ndarray:
    """Outputs over a second at 1 kHz under a moving input."""
    slave = Instance(folder).initialise()
    rows = []
    for k in range(1000):
        for n, name in enumerate(slave.inputs):
            slave.set(**{name: 0.9 * np.sin(5e-3 * k + n)})
        assert slave.step(k * 1e-3) == OK
        rows.append(slave.get(*slave.outputs))
    slave.close()
    return np.array(rows)


def test_other_compilers_give_the_same_numbers(folders, command, tmp_path) -> None:
    chain = next(f for f in folders if f.name == "full_order_chain")
    other = tmp_path / chain.name
    shutil.copytree(chain, other)
    library = other / "binaries" / fmpy.platform / f"{chain.name}{fmpy.sharedLibraryExtension}"
    library.unlink()
    compiled(command, other, "-O0", "-fPIC", "-shared", "fmu.c", "-o", str(library), "-lm")
    expected = run(chain)
    assert np.ptp(expected[:, -1]) > 0.0
    np.testing.assert_array_equal(run(other), expected)
