"""Format, lint, types and tests in one command: ``python check.py``. The CI runs the same.

Every step runs even when an earlier one failed; pytest comes last, so that its closing line ends the output. The exit
code is 0 only when all steps passed.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).resolve().parent


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
        # a file stays with one of the two workers, as do its fixtures; tests/conftest.py orders the files
        "tests": [
            "pytest",
            "-n",
            "2",
            "--dist",
            "loadfile",
            "--no-loadscope-reorder",
            *selection,
            *pytest_arguments,
        ],
    }


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
    for name, command in steps(options.fix, options.slow, rest).items():
        if name == "tests" and failed:
            print(f"== failed before the tests: {', '.join(failed)}", flush=True)
        print(f"== {name}: {' '.join(command)}", flush=True)
        if subprocess.run([sys.executable, "-m", *command], cwd=TOP, env=environment, check=False).returncode:
            failed.append(name)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
