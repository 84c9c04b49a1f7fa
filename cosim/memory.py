"""Memory that is free, handed back to the system.

glibc keeps what a diagnosis freed, as many small objects lie between, and asks for more before it uses all of that again:
the process looks as if it grew, though nothing is kept.
"""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@cache
def _trim() -> Any:
    """Glibc's function that does it; None elsewhere: Windows does so by itself, and musl has none."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform.startswith("linux") else None


@contextmanager
def returned() -> Iterator[None]:
    """Hand free memory back when the block ends."""
    try:
        yield
    finally:
        if (trim := _trim()) is not None:
            trim(0)
