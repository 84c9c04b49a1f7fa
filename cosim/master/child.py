"""The child process in which FMUs of others run; `cosim.master.apart` starts it and watches it.

It gets pickled requests on stdin. What it answers is JSON, since an FMU may have written over its memory: nothing that it
says is executed. Numbers go through a file that parent and child map.
"""

import json
import os
import pickle
import signal
import struct
import sys
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import CosimError
from cosim.master import instance, marks
from cosim.master.host import Host
from cosim.master.template import end_with

LENGTH = struct.Struct("<Q")
MARKS, ROWS = "marks", "rows"  # files in the run's folder
MOST_WORDS = 2000  # characters of one message of an FMU
QUEUED_MESSAGES = 1000
# the parent ends a child at its limit; beyond this the system refuses what the parent is too slow for
SPARE = 512.0  # MiB: tables of ours, compiled code
ALLOWANCE = 1.25


def send(stream: IO[bytes], request: Any) -> None:
    """Write one request to a child."""
    data = pickle.dumps(request, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(LENGTH.pack(len(data)) + data)
    stream.flush()


class Child:
    """Answers the requests of its parent, one after the other."""

    def __init__(self) -> None:
        # an FMU that reads or prints shall not meet the parent's requests and answers
        self.requests = os.fdopen(os.dup(0), "rb")
        self.answers = os.fdopen(os.dup(1), "wb")
        with Path(os.devnull).open("rb") as nothing:
            os.dup2(nothing.fileno(), 0)
        os.dup2(2, 1)
        self.said = 0
        self.own = os.getpid()
        self.host: Host | None = None

    def receive(self) -> Any:
        """The next request, or None when the parent went away."""
        head = self.requests.read(LENGTH.size)
        if len(head) < LENGTH.size:
            return None
        return pickle.loads(self.requests.read(LENGTH.unpack(head)[0]))

    def answer(self, **content: Any) -> None:
        """Write one answer; the copy of this process that an FMU may have made with fork() ends instead of a second one."""
        if os.getpid() != self.own:
            os._exit(1)
        self.answers.write(json.dumps(content).encode() + b"\n")
        self.answers.flush()

    def hear(self, name: bytes, message: instance.Message) -> None:
        """Hand on what an FMU says, since the process may not live to do so later."""
        if message.status >= instance.WARNING and self.said < QUEUED_MESSAGES:
            self.said += 1
            self.answer(said=message.text[:MOST_WORDS].strip())

    def serve(self) -> None:
        """Answer until the parent has no more requests."""
        while (request := self.receive()) is not None:
            kind, *content = request
            try:
                getattr(self, kind)(*content)
            except CosimError as error:
                self.answer(error=type(error).__name__, text=str(error))
            except Exception as error:
                self.answer(error="internal", text=f"{type(error).__name__}: {error}")

    def silence(self) -> None:
        """Let nobody hear what FMUs print from here on."""
        with Path(os.devnull).open("wb") as nothing:
            for stream in (1, 2):
                os.dup2(nothing.fileno(), stream)

    def load(self, system: Any, folder: Path, silent: bool) -> None:
        """Instantiate the FMUs of a system; marks and rows lie in `folder`."""
        if silent:
            self.silence()
        self.folder = folder
        marks.share(folder / MARKS)
        instance.hear = self.hear
        self.host = Host(system)
        self.answer(done=True)

    def run(self, task: Any, silent: bool) -> None:
        """Simulate; each piece lies in the file of rows until the parent asks for the next."""
        if silent:
            self.silence()
        assert self.host is not None
        self.said = 0
        for first, _, rows in self.host.run(task, room=self.room):
            self.answer(piece=first, count=len(rows))
            self.receive()
        self.answer(done=True, wall_time=self.host.wall_time, messages=self.host.messages)

    def room(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """An array in the file of rows, which is big enough: the parent made it."""
        if 0 in shape:
            return np.empty(shape)
        return np.asarray(np.memmap(self.folder / ROWS, dtype=np.float64, mode="r+", shape=shape))

    def close(self) -> None:
        """Free the FMUs."""
        if self.host is not None:
            self.host.close()
        self.answer(done=True)


def guard(parent: int, memory: float) -> None:
    """End with the parent, ignore Ctrl-C (the parent hears it too), leave no core, take no more memory than allowed.

    Args:
        parent: its process id.
        memory: what may be added to the memory of this process [MiB].
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform.startswith("linux"):
        end_with(parent)
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform.startswith("linux"):
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        data = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmData"))
        most = int(1024 * data + (ALLOWANCE * memory + SPARE) * 2**20)
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if hard == resource.RLIM_INFINITY or most < hard:
            resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def main(parent: int, memory: float) -> None:
    """Serve a parent."""
    child = Child()
    # compiled before the limits count
    import cosim.master.compiled  # noqa: F401

    guard(parent, memory)
    child.answer(done=True)
    child.serve()
    sys.stderr.flush()
    os._exit(0)  # what libraries do at exit matters to nobody here
