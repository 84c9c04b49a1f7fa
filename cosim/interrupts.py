"""Ctrl-C that waits for compiled code.

numba looks at named tuples with calls of Python when a compiled function is entered; where the handler of a signal raises
within one of them, numba goes on with no object at all and the process dies.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

HANDLED = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back until the block ends; the first one's handler is called then."""
    # other threads get no signals, and one that nobody handles in Python raises nothing
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {s: h for s in HANDLED if callable(h := signal.getsignal(s))}
    came: list[tuple[int, FrameType | None]] = []
    for number in handlers:
        signal.signal(number, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if came:
            handlers[signal.Signals(came[0][0])](*came[0])


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Treat SIGTERM, which ends a job in a queue or a container, as Ctrl-C: what was found is written first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
