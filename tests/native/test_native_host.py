"""The C sources in a host that is not Python, under the address and undefined-behaviour sanitizers, without a warning."""

import os
import subprocess
import zipfile
from pathlib import Path

import pytest
from fmpy import read_model_description

from cosim.native.build import compiler

HOST = Path(__file__).resolve().parent / "host.c"
CHECKED = ["-std=c99", "-O1", "-g", "-ffp-contract=off", "-Wall", "-Wextra", "-pedantic", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]


@pytest.fixture(scope="session")
def sanitizers(tmp_path_factory) -> list[str]:
    """Options that this compiler has and this system can run."""
    folder = tmp_path_factory.mktemp("sanitizers")
    (folder / "a.c").write_text("int main(void) { return 0; }\n")
    command = [*compiler(), *SANITIZERS, "a.c", "-o", "a"]
    built = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    if built.returncode or subprocess.run([folder / "a"], capture_output=True, check=False).returncode:
        pytest.skip("this compiler has no address and undefined-behaviour sanitizers")
    return SANITIZERS


@pytest.mark.parametrize(
    "which",
    [
        "mechanical",
        "physical",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("stimulus", "sensor", "full_order")),
    ],
)
def test_clean_under_the_sanitizers(fmu_files, chains, sanitizers, tmp_path, which) -> None:
    """The chains hold every block but stimulus and simplified; mechanical and sensor are driven by model exchange too."""
    fmu = chains.get(which) or fmu_files[which]
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    program = tmp_path / "host"
    command = [
        *compiler(),
        *CHECKED,
        *sanitizers,
        f"-I{tmp_path / 'sources'}",
        str(HOST),
        "-lm",
        "-o",
        str(program),
    ]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    guid = read_model_description(str(fmu), validate=False).guid
    uri = (tmp_path / "resources").as_uri()
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=1", "LC_ALL": "C"}
    done = subprocess.run([program, uri, guid], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "done\n"
    assert "runtime error" not in done.stderr
