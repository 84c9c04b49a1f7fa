"""The grid of slots on a clock that the test turns."""

import gc
import random
import select
import socket
import subprocess
import sys

import pytest

from cosim.live.pace import BIN, BINS, STEER, Lateness, Pace, steady


class Clock:
    """Time that goes on by sleeping, and a little at each look."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 1e-7
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + 5e-5


def test_slots_stand_on_a_grid_whatever_each_of_them_takes() -> None:
    clock = Clock()
    pace = Pace(1e-3, clock, clock.sleep)
    first = pace.due
    for k in range(1000):
        late = pace.wait()
        assert 0.0 <= late < 1e-6
        assert pace.due == pytest.approx(first + k * 1e-3, abs=1e-9)
        clock.now += 4e-4 * (k % 3)
        pace.next()


def test_a_pause_shows_as_lateness_and_as_slots_behind() -> None:
    clock = Clock()
    pace = Pace(1e-3, clock, clock.sleep)
    pace.wait()
    assert pace.behind() < 0.0
    clock.now += 7.5e-3
    pace.next()
    assert pace.wait() == pytest.approx(6.5e-3, abs=1e-5)
    assert pace.behind() == pytest.approx(5.5, abs=0.01)


@pytest.fixture
def pair():
    """A socket that is written to and one that is waited at."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as incoming:
        incoming.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outgoing:
            outgoing.connect(incoming.getsockname())
            yield incoming, outgoing


def test_the_first_arrival_places_the_grid_and_the_next_ones_steer_it_slowly(pair) -> None:
    incoming, outgoing = pair
    clock = Clock()
    pace = Pace(1e-3, clock, clock.sleep)
    outgoing.send(b"x")
    assert select.select([incoming], [], [], 60.0)[0], "a busy system delivers when it likes"
    arrival = clock.now
    pace.wait(incoming)
    assert pace.aligned
    assert pace.due == pytest.approx(arrival + 0.5e-3, abs=1e-5)
    # a crane whose clock runs 100 ppm slow, and whose datagrams come up to 0.2 ms late
    random.seed(1)
    moves = []
    for k in range(1, 20_000):
        pace.next()
        sent = arrival + k * 1.0001e-3 + random.choice([0.0] * 9 + [2e-4])
        clock.now = max(clock.now, sent)
        before = pace.due
        pace.wait(incoming)  # what came is never read, so that every wait finds it at once
        moves.append(abs(pace.due - before))
    assert max(moves[600:]) <= STEER * 1e-3 * (1 + 1e-6)  # the clock itself is rounded
    assert pace.due - (arrival + 19_999 * 1.0001e-3) == pytest.approx(0.5e-3, abs=1.5e-4)


def test_quantiles_of_delays_are_those_of_the_sorted_delays() -> None:
    random.seed(2)
    delays = [*sorted(random.expovariate(1e4) for _ in range(5000)), 0.5]
    lateness = Lateness()
    for delay in delays:
        lateness.add(delay)
    for share in (0.5, 0.99, 0.999):
        exact = delays[int(share * len(delays))]
        assert exact - BIN <= lateness.quantile(share) <= exact + 2 * BIN
    assert lateness.worst == 0.5
    assert lateness.facts()["worst"] == 0.5
    assert lateness.count == 5001


def test_a_delay_beyond_the_histogram_is_not_lost() -> None:
    lateness = Lateness()
    lateness.add(2 * BINS * BIN)
    assert lateness.quantile(0.5) == lateness.worst == 2 * BINS * BIN


def test_no_garbage_is_collected_within_and_all_is_as_before_afterwards() -> None:
    assert gc.isenabled()
    interval = sys.getswitchinterval()
    with steady():
        assert sys.getswitchinterval() <= 2e-4, "another thread keeps the interpreter for Python's 5 ms"
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
    assert gc.isenabled()
    assert sys.getswitchinterval() == interval
    assert gc.get_freeze_count() == 0
    if sys.platform.startswith("linux"):
        import ctypes

        assert ctypes.CDLL(None).prctl(30, 0, 0, 0, 0) >= 1000, "the timer slack was not put back"


# in a process of its own: memory that is locked is taken whole, and that of a test run is large
FIRST_IN_LINE = """
import os, sys, threading
from cosim.live.pace import priority

before, param = os.sched_getscheduler(0), os.sched_getparam(0)
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
except PermissionError:
    sys.exit("no right to real-time priority")
os.sched_setscheduler(0, before, param)
over, begun, known = threading.Event(), threading.Event(), []
helper = threading.Thread(target=lambda: (known.append(threading.get_native_id()), begun.set(), over.wait()))
helper.start()
try:
    begun.wait()
    with priority(True):
        loop, other = (os.sched_getparam(thread).sched_priority for thread in (0, known[0]))
        assert os.sched_getscheduler(known[0]) == os.SCHED_FIFO
        assert loop == other + 1
    assert os.sched_getscheduler(0) == os.sched_getscheduler(known[0]) == before
finally:
    over.set()
    helper.join()
"""


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="SCHED_FIFO of each thread is asked for on Linux"
)
def test_with_priority_all_threads_are_first_in_line_the_loop_before_the_others() -> None:
    """A thread that holds the interpreter and waits for a processor would hold the loop up."""
    done = subprocess.run([sys.executable, "-c", FIRST_IN_LINE], capture_output=True, text=True, check=False)
    if "no right" in done.stderr:
        pytest.skip("no right to real-time priority")
    assert done.returncode == 0, done.stderr
