"""Every benchmark finds what it takes from the package: nothing else runs them between releases."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.mark.parametrize("name", sorted(p.stem for p in FOLDER.glob("*.py") if p.stem != "__init__"))
def test_a_benchmark_imports(name: str) -> None:
    importlib.import_module(f"benchmarks.{name}")


@pytest.mark.slow
def test_one_command_prints_all_peers(tmp_path: Path) -> None:
    figures, page = tmp_path / "figures.json", tmp_path / "speed.md"
    command = [sys.executable, FOLDER / "peers.py", "--quick", "--json", figures, "--page", page]
    done = subprocess.run(command, cwd=FOLDER.parent, capture_output=True, text=True, check=True)
    peers = ("fmpy simulate_ssp", "ecos", "libcosim", "simulate_fmu, Dask", "scipy around fmpy", "C loop")
    for peer in peers:
        assert peer in page.read_text(encoding="utf-8")
    assert "Ours and the peers" in done.stdout
    assert set(json.loads(figures.read_text(encoding="utf-8"))) == {"runner", "batch", "fit", "native"}
