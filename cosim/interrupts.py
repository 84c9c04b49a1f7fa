"""Ctrl-C that waits for compiled code.

numba looks at named tuples with calls of Python when a compiled function is entered; where the handler of a signal raises
within one of them, numba goes on with no object at all and the process dies.
"""

import inspect
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType

HANDLED = (signal.SIGINT, signal.SIGTERM)
AGAIN = 0.02  # s between looks whether an import or an FMU's call has ended
POSTPONING: set[str] = {tempfile.__file__}
"""Files of Python, or folders of them with a separator at the end, from which FMUs are called, in which a file has been made
whose name nobody knows yet, or which leave work to a loop of events that would go on without them."""


class _Struck:
    """What the handlers of `stoppable` and `often_uninterrupted` know; only the main thread gets signals.

    Attributes:
        waits: they are set, and wait for compiled code by themselves.
        inside: compiled code runs.
        came: what is to be done once it ends, for the first signal that came meanwhile.
        raised: the last signal that raised a KeyboardInterrupt.
    """

    waits = False
    inside = False
    came: Callable[[], object] | None = None
    raised: int | None = None


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back until the block ends; the first one's handler is called then."""
    # other threads get no signals, and one that nobody handles in Python raises nothing
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if _Struck.waits:
        before, _Struck.inside = _Struck.inside, True
        try:
            yield
        finally:
            _Struck.inside = before
            if not before and (strike := _Struck.came) is not None:
                _Struck.came = None
                strike()
        return
    handlers = {s: h for s in HANDLED if callable(h := signal.getsignal(s))}
    came: list[int] = []
    try:
        with ExitStack() as stack:  # a signal may strike between any two of these
            for number, handler in handlers.items():
                stack.callback(signal.signal, number, handler)
                signal.signal(number, lambda number, frame: came.append(number))
            yield
    finally:
        if came:
            # the frame of now, when nothing is in the way any more
            handlers[signal.Signals(came[0])](came[0], inspect.currentframe())


@contextmanager
def often_uninterrupted() -> Iterator[None]:
    """Within this context `uninterrupted` takes next to no time: handlers are set once, not around each of many runs."""
    if threading.current_thread() is not threading.main_thread() or _Struck.waits:
        yield
        return
    handlers = {s: h for s in HANDLED if callable(h := signal.getsignal(s))}

    def struck(number: int, frame: FrameType | None) -> None:
        handler = handlers[signal.Signals(number)]
        if not _Struck.inside:
            handler(number, frame)
        elif _Struck.came is None:
            # the frame of then, when nothing is in the way any more
            _Struck.came = lambda: handler(number, inspect.currentframe())

    try:
        with ExitStack() as stack:  # a signal may strike between any two of these
            for number, handler in handlers.items():
                stack.callback(signal.signal, number, handler)
                signal.signal(number, struck)
            _Struck.waits = True
            yield
    finally:
        _Struck.waits, _Struck.came = False, None


def _interrupt() -> None:
    raise KeyboardInterrupt


@contextmanager
def stoppable(stop: Callable[[], bool]) -> Iterator[None]:
    """Treat SIGTERM, which ends a job in a queue or a container, as Ctrl-C, and either as a request before it is an order.

    Args:
        stop: called when one comes; True if what runs will end by itself soon. Otherwise a
            KeyboardInterrupt is raised.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def struck(number: int, frame: FrameType | None) -> None:
        if stop():
            return
        if _Struck.inside:
            _Struck.came = _interrupt
            return
        _Struck.raised = number
        raise KeyboardInterrupt

    # a signal that is ignored stays ignored (nohup, a job in the background)
    before = {s: signal.signal(s, struck) for s in HANDLED if signal.getsignal(s) is not signal.SIG_IGN}
    _Struck.waits = True
    try:
        yield
    finally:
        _Struck.waits, _Struck.came = False, None
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ended_in_order(came: list[int] | None = None) -> Iterator[None]:
    """Within this context SIGTERM is a Ctrl-C, so that temporary folders and halves of files are cleared up.

    Neither strikes within an import or a call of an FMU, whose C makes another error of it, nor while a temporary file is
    made, which would stay, or zarr writes, which prints what it has not done, but right after. Where Python
    drops what is raised (a finaliser, the callback of a weak reference) it strikes again, soon. The second SIGTERM ends the
    process at once. A signal that is ignored or handled already stays so.

    Args:
        came: takes the number of what came.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def struck(number: int, frame: FrameType | None) -> None:
        if leaving:
            return
        if _untimely(frame):
            later(number)
            return
        if number == signal.SIGTERM:
            signal.signal(number, signal.SIG_DFL)
        if came is not None:
            came.append(number)
        _Struck.raised = number
        raise KeyboardInterrupt

    def later(number: int) -> None:
        waiting.append(threading.Timer(AGAIN, _send, (number,)))
        waiting[-1].daemon = True
        waiting[-1].start()

    def dropped(event: "sys.UnraisableHookArgs") -> None:
        number = _Struck.raised
        if not isinstance(event.exc_value, KeyboardInterrupt) or number is None or leaving:
            usual_hook(event)
            return
        if signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, struck)
        later(number)

    waiting: list[threading.Timer] = []
    leaving: list[bool] = []
    usual = (signal.SIG_DFL, signal.default_int_handler)
    before = {s: signal.signal(s, struck) for s in HANDLED if signal.getsignal(s) in usual}
    usual_hook, sys.unraisablehook = sys.unraisablehook, dropped
    try:
        yield
    finally:
        sys.unraisablehook = usual_hook
        leaving.append(True)  # what comes from here on, or was still to come again, strikes nobody
        for again in waiting:
            again.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def _send(number: int) -> None:
    """Send a signal to the main thread, which may be asleep: one that comes to another thread does not wake it."""
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)
    else:
        signal.raise_signal(number)


def _untimely(frame: FrameType | None) -> bool:
    """Whether an import or what POSTPONING names is going on in a frame or one that called it."""
    places = tuple(POSTPONING)
    while frame is not None:
        name = frame.f_code.co_filename
        if name.startswith("<frozen importlib") or name.startswith(places):
            return True
        frame = frame.f_back
    return False
