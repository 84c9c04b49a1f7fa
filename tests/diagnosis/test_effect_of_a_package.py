"""A hypothesis in one file: that of docs/effects.md, offered by a package, names what is unexplained without it."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fmus import registry

TOP = Path(__file__).resolve().parents[2]
EXAMPLE = TOP / "examples" / "mechanical_quadratic_drag.py"
ASK = """
import json
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import make_log
from cosim.rig.write import as_log
found = diagnose(as_log(make_log("mixed", 24.0, ("unknown.quadratic_drag",), seed=7)))
print(json.dumps([found.verdict, {c.effect.name: c.parameters for c in found.causes}, [r.block for r in found.rests]]))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder like one into which pip has installed a package with the example."""
    shutil.copy(EXAMPLE, tmp_path)
    info = tmp_path / "drag-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: drag\nVersion: 1.0\n", encoding="utf-8")
    point = f"[cosim.effects]\ndrag = {EXAMPLE.stem}:EFFECT\n"
    (info / "entry_points.txt").write_text(point, encoding="utf-8")
    return tmp_path


def asked(*folders: Path) -> list:
    """Verdict, causes with their sizes, and blocks with a rest, by a process that finds packages in these folders."""
    path = os.pathsep.join(map(str, (TOP, *folders)))
    run = subprocess.run(
        [sys.executable, "-c", ASK],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(run.stdout)


@pytest.mark.slow
def test_a_file_in_a_package_names_what_was_unexplained(package: Path) -> None:
    verdict, causes, rests = asked(package)
    assert (verdict, list(causes), rests) == ("explained", ["mechanical.quadratic_drag"], [])
    value, deviation = causes["mechanical.quadratic_drag"]["q_drag"]
    assert value == pytest.approx(1.5e5, rel=0.05)
    assert abs(value - 1.5e5) < 4.0 * deviation


@pytest.mark.slow
def test_without_it_the_same_log_is_unexplained_in_its_block() -> None:
    assert asked() == ["unexplained", {}, ["mechanical"]]


def test_the_page_shows_the_file_as_it_is() -> None:
    page = (TOP / "docs" / "effects.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert EXAMPLE.read_text(encoding="utf-8") in blocks
    assert "mechanical.quadratic_drag" not in registry.effects()
