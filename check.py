"""Format, lint, types and tests in one command: ``python check.py``. The CI runs the same.

Every step runs even when an earlier one failed. Types are checked while the tests begin, so that both cores are busy,
and said as soon as they are known; what failed before the tests end is said again at the end. The exit code is 0 only
when all steps passed.
"""

import argparse
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

TOP = Path(__file__).resolve().parent
ROOM = 4 * 2**30  # bytes: several times what the tests write


def steps(fix: bool, slow: bool, pytest_arguments: list[str]) -> dict[str, list[str]]:
    """The commands to run, by name, in order; each is the argument list of a Python module.

    Args:
        fix: repair format and lint instead of only reporting them.
        slow: run the tests marked slow too.
        pytest_arguments: handed on to pytest.
    """
    selection = ["-m", "slow or not slow"] if slow else []
    return {
        "format": ["ruff", "format", *([] if fix else ["--check"]), "."],
        "lint": ["ruff", "check", *(["--fix"] if fix else []), "."],
        "types": ["mypy"],
        # three for two cores, because some tests wait. A file stays with one of them, as do its fixtures;
        # tests/conftest.py orders the files
        "tests": [
            "pytest",
            "-n",
            "3",
            "--dist",
            "loadfile",
            "--no-loadscope-reorder",
            *selection,
            *pytest_arguments,
        ],
    }


def in_memory() -> str | None:
    """A folder for temporary files that no disk slows down: FMUs are unpacked and removed a thousand times over."""
    folder = "/dev/shm"
    if not os.access(folder, os.W_OK) or shutil.disk_usage(folder).free < ROOM:
        return None
    # libraries are loaded from there
    return None if os.statvfs(folder).f_flag & os.ST_NOEXEC else folder


def checked(
    name: str, command: list[str], environment: dict[str, str], failed: list[str]
) -> threading.Thread:
    """A step that runs beside the next ones; all that it says is printed at once when it ends."""

    def run() -> None:
        done = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=TOP,
            env=environment,
            check=False,
            capture_output=True,
            text=True,
        )
        print(f"\n== {name}: {' '.join(command)}\n{done.stdout}{done.stderr}", end="", flush=True)
        if done.returncode:
            failed.append(name)

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def compiled_once(pytest_arguments: list[str], environment: dict[str, str]) -> None:
    """Collect the tests once by themselves: what they import is compiled then, not by each process at the same time.

    Nothing is said of it: what cannot be collected is told by the tests themselves.
    """
    subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-qq", *pytest_arguments],
        cwd=TOP,
        env=environment,
        check=False,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def main() -> int:
    """Runs the steps and returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fix", action="store_true", help="repair format and lint where ruff can")
    parser.add_argument("--slow", action="store_true", help="run the tests marked slow too")
    options, rest = parser.parse_known_args()
    failed: list[str] = []
    # small matrices beside another worker: more threads only wait for one another
    environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"} | os.environ
    # tests begin hundreds of processes: each module is compiled once for all of them
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if (memory := in_memory()) is not None:
        environment.setdefault("TMPDIR", memory)
    wanted = steps(options.fix, options.slow, rest)
    types = wanted.pop("types")
    beside = None
    for name, command in wanted.items():
        if name == "tests":
            beside = checked("types", types, environment, failed)
            compiled_once(rest, environment)
        print(f"== {name}: {' '.join(command)}", flush=True)
        if subprocess.run([sys.executable, "-m", *command], cwd=TOP, env=environment, check=False).returncode:
            failed.append(name)
    if beside is not None:
        beside.join()
    if failed:
        print(f"== failed: {', '.join(failed)}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
