"""The loop's clock: wakes once a period, tells how late, and follows the other side's clock slowly.

A sleep is ended `SPIN` before its time and the rest is spent looking at the clock. docs/live.md says what each part costs.
"""

import contextlib
import ctypes
import gc
import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from socket import socket
from typing import Any

from cosim import console

PERIOD = 1e-3  # s, one datagram a sample at 1 kHz
SPIN = 1e-4  # s of looking at the clock at the end of a wait
STEER = 2e-4  # of a period, the most that the grid moves a slot: the other clock may run 200 ppm off
FIRST = 500  # arrivals in which it moves faster, since the first one may have come late
GAIN = 2e-3  # part of the arrivals' distance from mid-slot taken back a slot
SWITCH = (
    1e-4  # s after which another thread of ours gives the interpreter back to the loop; Python's own is 5 ms
)
FIRST_IN_LINE = 50  # of SCHED_FIFO, for the loop; our other threads come right behind it
BIN = 1e-6  # s
BINS = 20_000
_SET_TIMER_SLACK = 29  # prctl(2)
_ALL_PAGES = 3  # mlockall(2): MCL_CURRENT | MCL_FUTURE


class Lateness:
    """A histogram of delays, of fixed size.

    Attributes:
        count: delays counted.
        worst: the largest, s.
    """

    def __init__(self) -> None:
        self._bins = [0] * (BINS + 1)
        self.count, self.worst = 0, 0.0

    def add(self, delay: float) -> None:
        """Counts a delay, s."""
        self.count += 1
        self.worst = max(self.worst, delay)
        self._bins[min(BINS, int(delay / BIN))] += 1

    def quantile(self, share: float) -> float:
        """The delay, s, that this share of all does not exceed, rounded up to a bin; 0 where there is none."""
        wanted, seen = share * self.count, 0
        for k, number in enumerate(self._bins[:-1]):
            seen += number
            if number and seen >= wanted:
                return min((k + 1) * BIN, self.worst)
        return self.worst

    def facts(self) -> dict[str, float | str]:
        """As plain data, in s."""
        found: dict[str, float | str] = {"unit": "s"}
        found |= {f"p{100 * q:g}": self.quantile(q) for q in (0.5, 0.99, 0.999)}
        return found | {"worst": self.worst}


class Pace:
    """The grid of slots.

    Attributes:
        period: s.
        due: when the next slot is due, on `clock`.
        aligned: arrivals have placed the grid; where that is False the next one does.
    """

    def __init__(
        self,
        period: float = PERIOD,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
        spin: float = SPIN,
    ) -> None:
        self.period, self.aligned = period, False
        self._clock, self._sleep, self._spin = clock, sleep, spin
        self.due, self._steered = clock() + period, 0

    def wait(self, incoming: socket | None = None) -> float:
        """Waits until the slot is due.

        Args:
            incoming: the socket whose arrivals place and steer the grid, half a period before each slot; or None.

        Returns:
            How late it is, s.
        """
        now = self._clock()
        if incoming is not None and now < self.due - self._spin:
            arrived, _, _ = select.select((incoming,), (), (), self.due - self._spin - now)
            now = self._clock()
            if arrived:
                self._steer(now)
        if now < self.due - self._spin:
            self._sleep(self.due - self._spin - now)
        while (now := self._clock()) < self.due:
            pass
        return now - self.due

    def behind(self) -> float:
        """By how many periods the slot after this one is overdue; negative where it is still to come."""
        return (self._clock() - self.due) / self.period - 1.0

    def next(self, slots: int = 1) -> None:
        """Goes on to the next slot, or past several."""
        self.due += slots * self.period

    def _steer(self, arrival: float) -> None:
        if not self.aligned:
            self.due, self.aligned, self._steered = arrival + 0.5 * self.period, True, 0
            return
        self._steered += 1
        faster = max(1.0, 5.0 * FIRST / self._steered) if self._steered < FIRST else 1.0
        most = STEER * faster * self.period
        self.due += max(-most, min(most, GAIN * faster * (arrival + 0.5 * self.period - self.due)))


@contextlib.contextmanager
def steady() -> Iterator[None]:
    """Keeps pauses out of a loop.

    No garbage collection, threads that give the interpreter back soon, and timers that do not wait for each other (Linux).
    """
    running, interval = gc.isenabled(), sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    gc.disable()
    slack = _timer_slack(1)
    try:
        yield
    finally:
        if slack:
            _timer_slack(slack)
        gc.unfreeze()
        if running:
            gc.enable()
        sys.setswitchinterval(interval)


@contextlib.contextmanager
def priority(wanted: bool) -> Iterator[None]:
    """Real-time priority (SCHED_FIFO) and memory that stays, where wanted; a warning where the system does not give it.

    Our other threads come right behind the loop: one that holds the interpreter and waits for a processor holds the loop up.
    """
    if not wanted:
        yield
        return
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIRST_IN_LINE))
    except (AttributeError, OSError) as error:
        console.warn(f"no real-time priority: {getattr(error, 'strerror', None) or 'this system has none'}")
        yield
        return
    behind = _behind(FIRST_IN_LINE - 1)
    library = ctypes.CDLL(None)
    locked = library.mlockall(_ALL_PAGES) == 0
    if not locked:
        console.warn("the loop's memory is not locked: the system may take a page away while it runs")
    try:
        yield
    finally:
        if locked:
            library.munlockall()
        for thread, scheduling in behind.items():
            with contextlib.suppress(OSError):  # it has ended
                os.sched_setscheduler(thread, *scheduling)
        os.sched_setscheduler(0, *before)


def _behind(place: int) -> dict[int, tuple[int, Any]]:
    """Gives our other threads a place in SCHED_FIFO (Linux); returns thread -> what it had."""
    before = {}
    threads = [int(task.name) for task in Path("/proc/self/task").glob("*")]
    for thread in threads:
        if thread == threading.get_native_id():
            continue
        with contextlib.suppress(OSError):  # it has just ended
            had = os.sched_getscheduler(thread), os.sched_getparam(thread)
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(place))
            before[thread] = had
    return before


def _timer_slack(nanoseconds: int) -> int:
    """Sets the calling thread's timer slack; returns what it was, usually 50 000 ns, or 0 where there is no such thing."""
    if not sys.platform.startswith("linux"):
        return 0
    library = ctypes.CDLL(None)
    before = int(library.prctl(_SET_TIMER_SLACK + 1, 0, 0, 0, 0))
    library.prctl(_SET_TIMER_SLACK, nanoseconds, 0, 0, 0)
    return max(before, 0)
