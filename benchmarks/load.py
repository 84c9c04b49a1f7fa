"""Busy processes beside a measurement."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator

BUSY = "while True: sum(i * i for i in range(100000))"


@contextlib.contextmanager
def load(number: int) -> Iterator[None]:
    """So many processes that never rest."""
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(number)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()
