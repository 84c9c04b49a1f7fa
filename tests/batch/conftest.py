"""Toy FMUs of tests/master, one that misbehaves as asked, and our packages with a short command inside."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

TOP = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(TOP / "tests" / "master"))
import toy_fmus  # noqa: E402
from conftest_toys import build_toy, toys  # noqa: E402, F401

# y = k t^2; may abort its process, take its time and leave a file first, wait while one is there, or keep memory for ever
toy_fmus.BODIES["rogue"] = """
        self.declare(k=(Real, C.parameter, V.fixed, 1.0), b=(Real, C.parameter, V.fixed, 0.0),
                     die=(Real, C.parameter, V.fixed, 0.0), nap=(Real, C.parameter, V.fixed, 0.0),
                     leak=(Real, C.parameter, V.fixed, 0.0), n=(Integer, C.parameter, V.fixed, 1),
                     y=(Real, C.output, V.continuous, 0.0))

    def exit_initialization_mode(self):
        import os, sys, time
        if self.nap and "ROGUE_NAPS" in os.environ:
            open(os.environ["ROGUE_NAPS"], "w").close()
        time.sleep(self.nap)
        while self.k > 8.0 and os.path.exists(os.environ.get("ROGUE_WAITS_FOR_THE_END_OF", "")):
            time.sleep(0.01)
        if self.leak:
            sys.kept = [*getattr(sys, "kept", []), b"x" * int(self.leak)]
        self.y = self.b

    def do_step(self, t, h):
        import os
        if self.die > 0.5 and t > 0.04:
            os.abort()
        self.y = self.n * self.k * (t + h) ** 2 + self.b
        return True
"""


@pytest.fixture(scope="session")
def rogue(toys: Any) -> Path:  # noqa: F811
    """A system of the FMU that misbehaves as asked, 0.1 s long."""
    return toys.ssp({"r": "rogue"}, [], stop=0.1)


@pytest.fixture(scope="session")
def packages(made_once: Any) -> dict[str, Path]:
    """Our closed packages with 3 s of command, and the open ones, by name and ``name_open``."""
    from cosim.paths import ssp_folder
    from cosim.ssp.stimulus import stimulus_csv
    from cosim.ssp.write import write_ssp

    time = np.arange(3001) * 1e-3
    played = stimulus_csv(time, 0.9 * np.sin(3.0 * time) + 0.2 * np.sign(np.sin(11.0 * time)))

    def make(folder: Path) -> None:
        for name in ("simplified", "full_order", "physical"):
            ssd = ssp_folder() / f"{name}.ssd"
            write_ssp(ssd, folder / f"{name}.ssp", stimulus=played)
            write_ssp(ssd, folder / f"{name}_open.ssp", open=True)

    return {file.stem: file for file in made_once("batch_packages", make).glob("*.ssp")}


@pytest.fixture
def run_cosim() -> Any:
    """Runs the command line in a process of its own: (exit code, JSON or None, stderr)."""

    def run(*words: object, **options: Any) -> tuple[int, Any, str]:
        command = [sys.executable, "-m", "cosim", *map(str, words)]
        done = subprocess.run(command, cwd=TOP, capture_output=True, text=True, check=False, **options)
        found = json.loads(done.stdout) if "--json" in words else None
        return done.returncode, found, done.stderr

    return run
