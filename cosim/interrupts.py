"""Ctrl-C that waits for compiled code.

numba looks at named tuples with calls of Python when a compiled function is entered; where the handler of a signal raises
within one of them, numba goes on with no object at all and the process dies.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C back until the block ends; its handler is called then."""
    handler = signal.getsignal(signal.SIGINT)
    # other threads get no signals, and one that nobody handles in Python raises nothing
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came:
            handler(*came[0])
