"""Carries out a batch: hands runs to a crew, keeps what comes back, and sees to it that a failure costs one run."""

import time as clock
from collections import deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass

from cosim.batch.job import Job, Outcome, Run
from cosim.batch.store import Store
from cosim.batch.workers import Crew
from cosim.console import Advance
from cosim.errors import SimulationError

TURN = 0.5  # s between looks at the clock while nothing finishes
TOGETHER = {
    "fmu": 1,
    "compiled": 16,
}  # runs handed over at a time: compiled ones are as short as the way there


@dataclass
class _Parcel:
    """Runs handed over together; `alone` where nothing else is under way, so that blame is certain."""

    runs: list[Run]
    alone: bool = False


def carry_out(job: Job, runs: Sequence[Run], crew: Crew, store: Store, advance: Advance) -> float:
    """Do the runs.

    Args:
        job: what they have in common.
        runs: those that are not done yet.
        crew: who does them.
        store: takes what comes of them; flushed on return, however that comes about.
        advance: told how many are done.

    Returns:
        Duration [s].

    Raises:
        SimulationError: the connection to the cluster is lost.
        KeyboardInterrupt: Ctrl-C.
    """
    begun = clock.monotonic()
    try:
        _Loop(job, runs, crew, store, advance).run()
    finally:
        try:
            store.flush()
        finally:  # a signal may strike, or the disk be full, as it is flushed
            crew.close()
    return clock.monotonic() - begun


class _Loop:
    def __init__(self, job: Job, runs: Sequence[Run], crew: Crew, store: Store, advance: Advance) -> None:
        self.job, self.crew, self.store, self.advance = job, crew, store, advance
        # at the end small parcels, so that no process waits long for the last one
        size = max(1, min(TOGETHER[job.engine], len(runs) // (4 * crew.size)))
        parts = (list(runs[k : k + size]) for k in range(0, len(runs), size))
        self.waiting: deque[_Parcel] = deque(_Parcel(part) for part in parts)
        self.suspects: deque[_Parcel] = deque()
        self.open: dict[Future[list[Outcome]], _Parcel] = {}
        self.finished = 0

    def run(self) -> None:
        while self.waiting or self.suspects or self.open:
            while self.waiting and len(self.open) < self.crew.capacity:
                self._hand_over(self.waiting.popleft())
            if not self.open and self.suspects:
                self._hand_over(self.suspects.popleft())
            done, _ = wait(self.open, TURN, FIRST_COMPLETED)
            for future in done:
                self._take(future, self.open.pop(future))
            self.crew.watch()
            self.store.tick()

    def _hand_over(self, parcel: _Parcel) -> None:
        self.open[self.crew.submit(self.job, parcel.runs)] = parcel

    def _take(self, future: "Future[list[Outcome]]", parcel: _Parcel) -> None:
        try:
            outcomes = future.result()
        except self.crew.lost:
            how = self.crew.settle(future)
            if len(parcel.runs) > 1:
                self.waiting.extendleft(_Parcel([run]) for run in reversed(parcel.runs))
                return
            if not (self.crew.certain or parcel.alone):
                self.suspects.append(_Parcel(parcel.runs, alone=True))
                return
            outcomes = [Outcome(parcel.runs[0].number, "failed", how)]
        except (CancelledError, ConnectionError, OSError) as error:
            raise SimulationError(
                f"the connection to the workers is lost ({error or type(error).__name__}); what is done is kept: "
                "the same command goes on from there"
            ) from None
        else:
            self.crew.settle(future)
        self.store.add(outcomes)
        self.finished += len(outcomes)
        self.advance(self.finished)
