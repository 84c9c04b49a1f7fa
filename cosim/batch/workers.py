"""Where runs are carried out: processes of this machine, or the workers of a Dask cluster.

Both are executors of concurrent.futures. Of this machine's processes each is a pool of one, so a process that dies takes
its own run and no other, and one that has grown is replaced between two runs.
"""

import contextlib
import math
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import time as clock
import weakref
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from multiprocessing.util import get_temp_dir
from typing import Any, Protocol

import psutil

from cosim.batch.job import Job, Outcome, Run, Task
from cosim.batch.task import execute, hello
from cosim.errors import MissingExtraError, SimulationError, UsageError
from cosim.interrupts import uninterrupted
from cosim.ssp.archive import scratch_folder

Outcomes = list[Outcome]
CONNECT = 10.0  # s until a scheduler must answer
ARRIVE = 30.0  # s until it must have a worker
GONE = 5.0  # s until a process that was killed is gone
TRIES = 100  # to have a process forked
START = 60.0  # s that a process may take to begin, beside the time limit of its first run
# what a task needs beside `cosim.batch.ready`
LOADED: dict[Task, tuple[str, ...]] = {
    "simulate": (),
    "compare": ("cosim.compare", "cosim.logs"),
    "diagnose": ("cosim.diagnosis.pipeline.diagnose", "cosim.logs", "cosim.report.deliver"),
}


class Crew(Protocol):
    """Who carries out runs.

    Attributes:
        size: how many runs go on at a time.
        capacity: how many may be handed over at a time.
        lost: what a future raises if its process died.
        certain: whether a process that dies had the run in hand that is blamed.
        retired: how many processes were replaced.
        tight: one was replaced after its first run, because that took all its memory.
    """

    size: int
    capacity: int
    lost: tuple[type[BaseException], ...]
    certain: bool
    retired: int
    tight: bool

    def submit(self, job: Job, runs: list[Run]) -> "Future[Outcomes]":
        """Hand over runs; at most `capacity` futures may be open."""
        ...

    def settle(self, future: "Future[Outcomes]") -> str:
        """Take note that a future is done; says how its process died, if it did."""
        ...

    def watch(self) -> None:
        """End runs that take too long; called about twice a second."""
        ...

    def close(self) -> None:
        """End everything at once."""
        ...


class _Lane:
    """One process, with one run at a time; made when first needed."""

    def __init__(self) -> None:
        self.pool: ProcessPoolExecutor | None = None
        self.process: BaseProcess | None = None
        self.future: Future[Outcomes] | None = None
        self.runs = 0
        self.begun, self.late, self.together = 0.0, False, 0
        # of pools that were retired; not held, since a pool's pipes go with its thread
        self.ending: weakref.WeakSet[threading.Thread] = weakref.WeakSet()

    def submit(self, job: Job, runs: list[Run], folder: str) -> "Future[Outcomes]":
        self.begun, self.late, self.together = clock.monotonic(), False, len(runs)
        if self.process is not None and not self.process.is_alive():
            self.retire()  # it died while it had nothing to do, and its pool may not have noted it yet
        if self.pool is not None:
            try:
                self.future = self.pool.submit(execute, job, runs)
            except BrokenProcessPool:  # it died while it had nothing to do
                self.retire()
        if self.pool is None:
            # a process that is told half of how it begins prints a traceback, and half a folder of Python's stays
            with uninterrupted():
                begun = ((folder, get_temp_dir()), dict(os.environ), GONE)
                self.pool = ProcessPoolExecutor(
                    1, mp_context=_context(job.task), initializer=_begin, initargs=begun
                )
                self.future = self.pool.submit(execute, job, runs)
            # what a process writes that is killed within its answer has an end only where nobody else holds the pipe
            self.pool._result_queue._writer.close()  # type: ignore[attr-defined]
            # the pool's own list: among the living it is missing where it has died already
            self.process, self.runs = next(iter(self.pool._processes.values())), 0
            self.begun += START
        assert self.future is not None
        self.runs += len(runs)
        return self.future

    def retire(self, at_once: bool = False) -> None:
        """End the process, after its run or at once."""
        if self.pool is not None:
            if isinstance(thread := self.pool._executor_manager_thread, threading.Thread):
                self.ending.add(thread)
            # the pool's own list: a signal may have come before we knew the process
            processes = list((self.pool._processes or {}).values())
            self.pool.shutdown(wait=False, cancel_futures=True)
            for process in processes if at_once else ():
                if process.is_alive():
                    process.kill()
                    process.join(GONE)
        self.pool, self.process = None, None


class Processes:
    """Processes of this machine, each replaced after `most_runs` runs or before it outgrows `most_memory` bytes.

    One whose run takes longer than `most_time` s is killed.
    """

    lost: tuple[type[BaseException], ...] = (BrokenProcessPool,)
    certain = True

    def __init__(
        self, count: int, most_memory: float, most_runs: int | None = None, most_time: float = math.inf
    ) -> None:
        self.size = self.capacity = count
        self.most_time = most_time
        self.most_memory, self.most_runs = most_memory, most_runs
        self.retired, self.tight = 0, False
        self._lanes = [_Lane() for _ in range(count)]
        # what a process that is killed has unpacked goes with this folder
        self._folder, _ = scratch_folder()
        self._growth = 0.0
        self._resident: dict[_Lane, int] = {}

    def submit(self, job: Job, runs: list[Run]) -> "Future[Outcomes]":
        """Hand runs to a process that has none."""
        lane = next(lane for lane in self._lanes if lane.future is None)
        return lane.submit(job, runs, self._folder.name)

    def settle(self, future: "Future[Outcomes]") -> str:
        """Free the future's process for the next run, or replace it."""
        lane = next(lane for lane in self._lanes if lane.future is future)
        lane.future = None
        if isinstance(future.exception(), BrokenProcessPool):
            how = f"it took longer than {self.most_time:g} s" if lane.late else how_it_ended(lane.process)
            self._replace(lane)
            return how
        if future.exception() is None:
            resident = max((outcome.resident for outcome in future.result()), default=0)
            if lane in self._resident:  # the first run loads the FMUs; what later ones add counts
                self._growth = max(self._growth, float(resident - self._resident[lane]))
            elif resident > self.most_memory:
                self.tight = True
            self._resident[lane] = resident
            full = self.most_runs is not None and lane.runs >= self.most_runs
            if lane.late or full or resident + self._growth > self.most_memory:
                self._replace(lane)
        return ""

    def watch(self) -> None:
        """Kill processes whose runs take too long; their futures then raise what is `lost`."""
        for lane in self._lanes:
            allowed = self.most_time * lane.together
            overdue = lane.future is not None and clock.monotonic() - lane.begun > allowed
            if overdue and not lane.late and lane.process is not None:
                lane.late = True
                lane.process.kill()

    def close(self) -> None:
        """Kill all processes: what they had in hand is lost."""
        with uninterrupted():
            for lane in self._lanes:
                lane.retire(at_once=lane.future is not None)
            for lane in self._lanes:
                # Python wakes those that are left as it ends, and a pipe that one closes just then is a traceback
                for thread in list(lane.ending):
                    thread.join(GONE)
            self._folder.cleanup()

    def _replace(self, lane: _Lane) -> None:
        lane.retire()
        self._resident.pop(lane, None)
        self.retired += 1


if sys.platform == "linux":
    from multiprocessing.context import ForkServerContext, ForkServerProcess
    from multiprocessing.popen_forkserver import Popen

    class SharedPopen(Popen):
        """How a process ended can be read from its server once only, and both its pool's thread and ours ask for it.

        Without the lock the second reads nothing, and takes that for exit code 255.
        """

        def __init__(self, process: BaseProcess) -> None:
            self._asking = threading.Lock()
            for _ in range(TRIES):
                try:
                    super().__init__(process)
                except (ConnectionError, EOFError):
                    # its server has just died, and may not be known to be dead yet
                    clock.sleep(GONE / TRIES)
                else:
                    return
            raise OSError("the process from which those of a batch are forked ends again and again")

        def poll(self, flag: int = os.WNOHANG) -> int | None:
            """The exit code, negative for a signal; None while the process runs and `flag` is not to wait for it."""
            if flag != os.WNOHANG and self.returncode is None:
                wait([self.sentinel])
            with self._asking:
                return super().poll(os.WNOHANG)

    class SharedProcess(ForkServerProcess):
        """A process whose end any thread may ask for."""

        @staticmethod
        def _Popen(process: BaseProcess) -> Popen:
            return SharedPopen(process)

    class SharedContext(ForkServerContext):
        """Makes such processes."""

        Process = SharedProcess


def _context(task: Task) -> BaseContext:
    """How processes begin: never as a fork of this one, which has threads of its own.

    On Linux they are forked from one that has loaded what the first task needs; each takes half a second less to begin.
    """
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = SharedContext()
    context.set_forkserver_preload(["cosim.batch.ready", *LOADED[task]])
    return context


def _gone(pid: int | None, within: float) -> bool:
    """True if a process has ended, or does so within so many seconds."""
    until = clock.monotonic() + within
    while pid is not None and psutil.pid_exists(pid) and clock.monotonic() < until:
        with contextlib.suppress(psutil.Error):
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        clock.sleep(0.01)
    return pid is None or not psutil.pid_exists(pid)


def _begin(folders: tuple[str, ...], environment: dict[str, str], gone: float) -> None:
    """First thing in a process: Ctrl-C is the parent's to handle, and without the parent there is nothing to do.

    Args:
        folders: for its temporary files, and others that go when the parent is killed.
        environment: of the parent now; what it is forked from may have had another.
        gone: s until a parent that was killed is gone.
    """
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = folders[0]
    if hasattr(os, "setsid"):
        os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            wait([parent.sentinel])
            # given up by a parent that lives, since what forked this one is gone: the folders are others' too
            if _gone(parent.pid, gone):
                for folder in folders:
                    shutil.rmtree(folder, ignore_errors=True)
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()


def how_it_ended(process: BaseProcess | None) -> str:
    """What a process died of, in words: its signal by name, or its exit code."""
    if process is None:
        return "its process died"
    process.join(5.0)
    settled = clock.monotonic() + 5.0
    # the pool's thread may have collected the exit status and not yet noted it: join() then returns without one
    while (code := process.exitcode) is None and clock.monotonic() < settled:
        clock.sleep(0.001)
    if code is None or code >= 0:
        return f"its process died (exit code {code})"
    try:
        return f"its process died ({signal.Signals(-code).name})"
    except ValueError:
        return f"its process died (signal {-code})"


class Cluster:
    """The workers of a Dask cluster that runs already."""

    certain = False  # the scheduler blames every run that a dying worker had taken
    retired, tight = 0, False  # the cluster looks after its workers itself

    def __init__(self, address: str) -> None:
        """Connect, and see that its workers can run us.

        Raises:
            MissingExtraError: dask.distributed is not installed.
            UsageError: there is no scheduler.
            SimulationError: it has no workers, or they lack this project or have another version.
        """
        try:
            import distributed
        except ImportError:
            raise MissingExtraError("cosim batch --scheduler", "batch") from None
        library: Any = distributed  # its functions have no types
        try:
            self._client = library.Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise UsageError(f"--scheduler {address}: no Dask scheduler answers there ({error})") from None
        self.lost: tuple[type[BaseException], ...] = (library.KilledWorker,)
        try:
            self.size = self._workers(address)
        except BaseException:
            self._client.close()
            raise
        self.capacity = 2 * self.size  # so that none waits for the next run
        self._executor: Executor = self._client.get_executor(pure=False)

    def _workers(self, address: str) -> int:
        until = clock.monotonic() + ARRIVE
        while not self._client.scheduler_info(n_workers=-1)["workers"]:
            if clock.monotonic() > until:
                raise SimulationError(f"the scheduler at {address} has no workers: start some (dask worker)")
            clock.sleep(0.2)
        found: dict[str, Any] = self._client.run(hello, on_error="return")
        for worker, version in found.items():
            if version != hello():
                raise SimulationError(
                    f"worker {worker} cannot take part: {version if isinstance(version, Exception) else 'version'} "
                    f"{'' if isinstance(version, Exception) else version}: install slew-cosim {hello()} there"
                )
        return len(found)

    def submit(self, job: Job, runs: list[Run]) -> "Future[Outcomes]":
        """Hand runs to the scheduler."""
        return self._executor.submit(execute, job, runs)

    def settle(self, future: "Future[Outcomes]") -> str:
        """Nothing to do: the cluster looks after its workers."""
        return "its worker died, more often than the scheduler allows" if future.exception() else ""

    def watch(self) -> None:
        """Nothing to do: the cluster has no time limit."""

    def close(self) -> None:
        """Cancel what is open, and leave the cluster as it was."""
        self._executor.shutdown(wait=False)
        self._client.close()
