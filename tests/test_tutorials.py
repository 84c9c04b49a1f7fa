"""The tutorials in docs/ do what they say: their blocks are run in order, in one folder, and what they show is compared.

A block ```console holds lines ``$ command`` and lines that must be among what the command prints, in this order.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```(python|console)\n(.*?)^```$", re.M | re.S)
TUTORIALS = ["own_log.md", "python.md", "public_fmu.md", "check.md"]
SLOW = ("cosim diagnose", "cosim.diagnose", "cosim demo", "found.extended", "cosim simulate found")


def blocks(name):
    found = BLOCK.findall((TOP / "docs" / name).read_text(encoding="utf-8"))
    assert found
    return found


def script_of(text, folder):
    done = subprocess.run(
        [sys.executable, "-c", text],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=900,
    )
    assert done.returncode == 0, f"{text}: {done.stderr}"


def console(text, finished, slow):
    """Run the commands of a block; each must print the lines below it."""
    for part in re.split(r"^\$ ", text, flags=re.M)[1:]:
        command, *wanted = part.strip().splitlines()
        if command.startswith(SLOW) and not slow:
            continue
        program, *words = command.split()
        assert program == "cosim"
        done = finished(*words)
        assert done.returncode == 0, f"{words}: {done.stderr}"
        said = iter(done.stdout.splitlines())
        for line in wanted:
            assert any(line == other.rstrip() for other in said), f"{command} does not say: {line}"


def follow(name, folder, finished, slow):
    shutil.copytree(TOP / "examples", folder / "examples")
    script = ""  # blocks of Python go into one program: later ones use the names of earlier ones
    for kind, text in [*blocks(name), ("console", "")]:
        if kind == "python":
            script += text if slow or not any(word in text for word in SLOW) else ""
        elif script:
            script_of(script, folder)
            script = ""
        if kind == "console":
            console(text, finished, slow)


@pytest.mark.parametrize("name", TUTORIALS)
def test_a_tutorial_runs(name, tmp_path, finished, monkeypatch):
    monkeypatch.chdir(tmp_path)
    follow(name, tmp_path, finished, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", TUTORIALS)
def test_a_tutorial_runs_to_its_end(name, tmp_path, finished, monkeypatch):
    monkeypatch.chdir(tmp_path)
    follow(name, tmp_path, finished, slow=True)
