"""The toy FMUs of tests/master serve here too."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "master"))
from conftest_toys import build_toy, toys  # noqa: F401
