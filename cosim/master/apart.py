"""FMUs of others run in a child process, so that none of them can end, hang or fill the tool's own.

The child (`cosim.master.child`) has the same loop. The parent waits for its answers and looks every few hundredths of a
second where it stands, what memory it has and whether it lives. What the loop has recorded lies in a file that both map:
a child that dies leaves every value up to its last whole step.
"""

import atexit
import contextlib
import json
import math
import multiprocessing
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np
import psutil
from numpy.typing import NDArray

from cosim import errors
from cosim.errors import CosimError, SimulationError
from cosim.files import Scratch
from cosim.master import marks
from cosim.master.child import MARKS, ROWS, send
from cosim.master.engine import pieces
from cosim.master.host import Progress, Task
from cosim.master.limits import Limits
from cosim.master.modules import search_path
from cosim.master.template import AVAILABLE, Forked, Template
from cosim.ssp.system import System

Array = NDArray[np.float64]
POLL = 0.05  # s between looks at a child
OWN_TIME = 300.0  # s that the child's own code may take: imports and compiling, on a machine with other work
END = 5.0  # s for FMUs to be freed
ROOM = 1 << 30  # bytes; a piece of a thousand signals has 0.8 GB
LONGEST_ANSWER = 1 << 22  # bytes of an answer
START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from cosim.master.child import main; main(int(sys.argv[2]), float(sys.argv[3]))"
)


@cache
def _starter() -> ThreadPoolExecutor:
    """The thread that starts children: Linux ends them with the thread that did, so it must last as long as we do."""
    return ThreadPoolExecutor(1, "cosim-children")


_templates: list[Template] = []  # one at most


def _in_a_fork() -> None:
    _starter.cache_clear()  # a fork has no such thread
    while _templates:
        _templates.pop().forget()


@atexit.register
def _at_exit() -> None:
    while _templates:
        _templates.pop().end()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_a_fork)


class Apart:
    """The instances of a system, in a child process; used as `cosim.master.host.Host`.

    Attributes:
        messages: what the FMUs logged in the last run at status Warning or worse.
        wall_time: duration of its loop [s].
    """

    def __init__(self, system: System, limits: Limits, many: bool = False) -> None:
        """Start the child and instantiate the FMUs there; with `many` what they print is shown until the first run ends.

        Raises:
            ModelError: a library cannot be loaded.
            SimulationError: an FMU cannot be instantiated, or took the child down.
        """
        self.system, self.limits = system, limits
        self.messages: list[str] = []
        self.wall_time = 0.0
        self._many, self._silent = many, False
        self._process: subprocess.Popen[bytes] | Forked | None = None
        self._order: tuple[str, ...] = ()
        self._first = 0
        self._base = 0
        self._folder = Scratch("cosim_run_", _shared_memory())
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def run(self, task: Task, progress: Progress = None) -> Generator[tuple[int, Array, Array], None, None]:
        """Simulate once from the start values; yields and raises as `cosim.master.engine.Engine.run`.

        Raises:
            SimulationError: an FMU failed, took its process down, or went beyond a limit. What was reached comes before.
        """
        if self._process is None:
            self._start()
        self.messages, self.wall_time = [], 0.0
        self._said.clear()
        self._order, self._grid = task.plan.order.names, task.grid
        self._within, self._begun = task.within, time.monotonic()
        rows, columns = self._make_room(task), len(task.plan.places())
        ended = False
        try:
            self._send("run", task, self._silent)
            self._silent = self._many
            for start, stop in pieces(task.whole, len(task.grid)):
                self._first, new = start, 1 if start else 0
                try:
                    answer = self._answer(progress)
                except _DeathError as death:
                    # what was recorded of the piece is there also where the process died right after
                    made = self._steps(stop - start)
                    phase = self._marks[marks.PHASE]
                    if phase == marks.LOOP or (phase == marks.OURS and made):
                        count = made + 1
                        yield self._piece(task, rows, columns, start, stop, new, count)
                    raise SimulationError(str(death)) from None
                if "piece" not in answer:
                    raise _refused(answer)
                count = min(max(_whole(answer.get("count")) + new, 1), stop - start + 1)
                if progress is not None:  # the last look at the child came before
                    progress(float(task.grid[start + count - 1] - task.grid[0]))
                yield self._piece(task, rows, columns, start, stop, new, count)
                self._send("next")
            try:
                answer = self._answer(None)
            except _DeathError as death:
                raise SimulationError(str(death)) from None
            if "done" not in answer:
                raise _refused(answer)
            ended = True
            seconds, said = answer.get("wall_time"), answer.get("messages")
            self.wall_time = seconds if isinstance(seconds, float) else 0.0
            self.messages = [str(m) for m in said] if isinstance(said, list) else []
        except SimulationError:
            ended = True
            raise
        finally:
            self._within = math.inf
            if not ended:  # by Ctrl-C or a caller who wants no more: where the child stands then is unknown
                self._kill()

    def close(self) -> None:
        """Free the FMUs and end the child; one that does not in time is ended."""
        if self._process is not None and self._process.poll() is None:
            with contextlib.suppress(_DeathError, OSError):
                self._send("close")
                self._answer(None, END)
        self._kill()
        self._folder.cleanup()

    # The child

    def _start(self) -> None:
        folder = Path(self._folder.name)
        np.zeros(marks.COUNT, dtype=np.int64).tofile(folder / MARKS)
        self._marks = np.memmap(folder / MARKS, dtype=np.int64, mode="r", shape=(marks.COUNT,))
        self._said: deque[str] = deque(maxlen=3)
        self._order, self._first, self._grid = (), 0, np.zeros(1)
        self._within, self._begun = math.inf, 0.0
        self._process = _starter().submit(_started, search_path(), self.limits.memory).result()
        assert self._process.stdout is not None
        self._lines: queue.Queue[bytes | None] = queue.Queue()
        threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True).start()
        self._allowed = float("inf")
        try:
            self._answer(None)
            self._allow(0)
            # the folder of the FMUs is the parent's
            self._send("load", replace(self.system, folder=None), folder, self._silent)
            answer = self._answer(None)
        except _DeathError as death:
            raise SimulationError(str(death)) from None
        if "done" not in answer:
            raise _refused(answer)

    def _allow(self, more: int) -> None:
        """Memory that the child may have from here on [bytes]: what it has, the limit, and `more` for our own tables."""
        assert self._process is not None
        if more == 0:
            with contextlib.suppress(psutil.Error):
                self._base = psutil.Process(self._process.pid).memory_info().rss
                if isinstance(self._process, Forked):  # what it shares counts as soon as it is touched
                    whole = psutil.Process(self._process.template.pid).memory_info().rss
                    self._base = max(self._base, whole)
        self._allowed = self._base + self.limits.memory * 2**20 + more

    def _send(self, *request: Any) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        # a child that is gone says so when it is asked for an answer
        with contextlib.suppress(BrokenPipeError, ConnectionError, OSError):
            send(self._process.stdin, request)

    def _answer(self, progress: Progress, within: float | None = None) -> dict[str, Any]:
        """The child's next answer.

        Raises:
            _DeathError: it died, or went beyond a limit and was ended.
        """
        seen, since, begun = b"", time.monotonic(), time.monotonic()
        while True:
            try:
                line = self._lines.get(timeout=POLL)
            except queue.Empty:
                now = time.monotonic()
                look = self._marks.tobytes()
                if look != seen:
                    seen, since = look, now
                    if progress is not None and self._marks[marks.PHASE] == marks.LOOP:
                        k = self._first + self._steps(len(self._grid) - 1 - self._first)
                        progress(float(self._grid[k] - self._grid[0]))
                self._watch(now - since)
                if within is not None and now - begun > within:
                    self._die("did not end in time")
                continue
            if line is None:
                self._die(None)
            try:
                answer = json.loads(line or b"")
            except ValueError:
                self._die("overwrote what its process says")
            if not isinstance(answer, dict):
                self._die("overwrote what its process says")
            if "said" not in answer:
                return answer
            self._said.append(str(answer["said"]))

    def _watch(self, still: float) -> None:
        """Hold the child against its limits; it has stood still for that long [s]."""
        assert self._process is not None
        if self._process.poll() is not None:
            self._die(None)
        # first: filling memory takes time, and says more than that it took long
        with contextlib.suppress(psutil.Error):
            if psutil.Process(self._process.pid).memory_info().rss > self._allowed:
                self._die(f"took more than {self.limits.memory:g} MiB of memory (--memory, COSIM_MEMORY)")
        inside = int(self._marks[marks.PHASE]) != marks.OURS
        if still > self.limits.stall + (0.0 if inside else OWN_TIME):
            self._die(f"did not come back within {self.limits.stall:g} s (--stall, COSIM_STALL)")
        if time.monotonic() - self._begun > self._within:
            self._die(f"took longer than {self._within:.3g} s for one run")

    def _die(self, why: str | None) -> NoReturn:
        """End the child and say which component did what and where.

        Raises:
            _DeathError: always.
        """
        assert self._process is not None
        if why is None:
            with contextlib.suppress(subprocess.TimeoutExpired):  # it may have closed its answers and live on
                self._process.wait(END)
            code = self._process.poll()
            why = "stopped answering" if code is None else _way(code)
        phase, at = int(self._marks[marks.PHASE]), ""
        names: tuple[str, ...] = self._order if phase == marks.LOOP else tuple(self.system.components)
        number = int(self._marks[marks.STEPPED if phase == marks.LOOP else marks.CALLED])
        name = names[number] if 0 <= number < len(names) else names[0]
        if phase == marks.LOOP:
            k = self._first + self._steps(len(self._grid) - 1 - self._first)
            at = f" in the step from t = {self._grid[k]:.9g} s"
        elif marks.words(phase):
            at = f" {marks.words(phase)}"
        said = f": {'; '.join(dict.fromkeys(self._said))}" if self._said else ""
        self._kill()
        if phase == marks.OURS:
            raise _DeathError(
                f"the process of the foreign FMUs {', '.join(names)} {why} between their calls{said}"
            )
        raise _DeathError(f"component '{name}' {why}{at}{said}")

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(OSError):
            if os.name == "posix":
                os.killpg(process.pid, signal.SIGKILL)  # what an FMU started goes too
            else:
                process.kill()
        process.wait()
        if isinstance(process, Forked):
            process.release()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()

    # What it recorded

    def _make_room(self, task: Task) -> Path:
        """A file for the longest piece."""
        longest = max(stop - start + 1 for start, stop in pieces(task.whole, len(task.grid)))
        size = 8 * longest * len(task.plan.places())
        file = Path(self._folder.name, ROWS)
        if not file.exists() or file.stat().st_size != size:
            free = shutil.disk_usage(self._folder.name).free
            if size > free:
                raise SimulationError(f"{self._folder.name} has no room for {size / 1e6:.3g} MB of results")
            with file.open("wb") as stream:
                stream.truncate(size)
        series = task.plan.n_series * longest * 8
        self._allow(1 + 2 * size + 4 * (series + task.grid.nbytes))
        return file

    def _steps(self, most: int) -> int:
        """Whole steps of the piece that the child has made."""
        return min(max(int(self._marks[marks.STEP]), 0), most)

    def _piece(
        self, task: Task, file: Path, columns: int, start: int, stop: int, new: int, count: int
    ) -> tuple[int, Array, Array]:
        rows = np.empty((count, 0))
        if columns:
            shape = (columns, stop - start + 1)
            # a copy: the child writes the next piece over this one
            rows = np.array(np.memmap(file, dtype=np.float64, mode="r", shape=shape)[:, :count]).T
        points = task.sampler.points(start, start + count - 1)
        return start + new, points[new:], rows[new:]


def _shared_memory() -> str | None:
    """A folder in memory with room enough for what is recorded, or None for the usual one."""
    folder = Path("/dev/shm")
    if os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > ROOM:
        return str(folder)
    return None


class _DeathError(Exception):
    """A child is no more; the text says why."""


def _started(path: list[str], memory: float) -> "subprocess.Popen[bytes] | Forked":
    """A new child with this search path, and a limit of its memory [MiB]."""
    if AVAILABLE and multiprocessing.parent_process() is None:  # a process of a batch starts one child only
        with contextlib.suppress(OSError):
            return _template(path).fork(path, memory)
    command = [sys.executable, "-c", START, json.dumps(path), str(os.getpid()), str(memory)]
    # its own session: Ctrl-C reaches the parent alone, and what the FMUs start can be ended with it
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=os.name == "posix"
    )


def _template(path: list[str]) -> Template:
    """The process from which children are forked; another one where the environment is another."""
    if _templates and _templates[0].serves:
        return _templates[0]
    while _templates:
        _templates.pop().retire()
    _templates.append(Template(path))
    return _templates[0]


def _read(stream: IO[bytes], lines: "queue.Queue[bytes | None]") -> None:
    """Hand on the child's answers; None at the end, or where one is too long to be ours."""
    with contextlib.suppress(OSError, ValueError):
        while (line := stream.readline(LONGEST_ANSWER)).endswith(b"\n"):
            lines.put(line)
    lines.put(None)


def _whole(number: object) -> int:
    """A whole number that a child sent; it may be anything."""
    return number if isinstance(number, int) else 0


def _way(code: int) -> str:
    """How a process ended."""
    if code >= 0:
        return f"ended its process (exit code {code if code < 256 else hex(code)})"
    name = signal.Signals(-code).name if -code in {s.value for s in signal.Signals} else f"signal {-code}"
    why = {
        "SIGABRT": "aborted",
        "SIGSEGV": "used memory that is not its own",
        "SIGBUS": "used memory that is not there",
    }
    return f"took its process down: it {why.get(name, 'was ended')} ({name})"


def _refused(answer: dict[str, Any]) -> CosimError:
    """The error that a child reports."""
    if "error" not in answer:
        return SimulationError("the process of the foreign FMUs overwrote what its process says")
    kind = getattr(errors, str(answer.get("error")), None)
    text = str(answer.get("text"))
    if isinstance(kind, type) and issubclass(kind, CosimError) and kind is not errors.MissingExtraError:
        return kind(text)
    return SimulationError(f"the process of the foreign FMUs failed: {text}")
