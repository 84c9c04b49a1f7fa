"""A process that has loaded what every child needs, and from which children are forked: on Linux only.

A child of its own takes more than a second of processor time to import numba and load the compiled loop; a fork takes a
few hundredths. Each child is fresh all the same: the template itself loads no FMU.

The parent sends a request with the child's streams and one end of a channel. On the channel it gets the exit code of the
child, which stays a zombie until the parent closes the channel: its number can be signalled without danger until then.
"""

import contextlib
import ctypes
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

AVAILABLE = sys.platform == "linux"
DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG
LONGEST_REQUEST = 1 << 17  # bytes of a request, most of them the environment
CODE = struct.Struct("<i")
START_TEMPLATE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from cosim.master.template import main; main(int(sys.argv[2]), int(sys.argv[3]))"
)
# what the loader, the interpreter and libraries read once, when a process starts
READ_ONCE = ("LD_", "PYTHON", "NUMBA_", "OMP_", "OPENBLAS_", "MKL_")


class Forked:
    """A child of the template; what `cosim.master.apart` needs of a `subprocess.Popen`.

    Attributes:
        template: where it comes from.
        pid: its process id, also that of its process group.
        stdin, stdout: its streams.
    """

    def __init__(
        self, template: "Template", pid: int, stdin: IO[bytes], stdout: IO[bytes], channel: socket.socket
    ) -> None:
        self.template, self.pid, self.stdin, self.stdout = template, pid, stdin, stdout
        self._channel = channel
        self._code: int | None = None

    def poll(self) -> int | None:
        """Its exit code, minus the signal that ended it, or None while it lives."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.wait(0.0)
        return None

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end.

        Raises:
            subprocess.TimeoutExpired: it lives on.
        """
        if self._code is None:
            self._channel.settimeout(timeout)
            try:
                said = self._channel.recv(CODE.size)
            except (TimeoutError, BlockingIOError):
                raise subprocess.TimeoutExpired("a forked child", timeout or 0.0) from None
            except OSError:
                said = b""
            # a template that is gone took its children with it
            self._code = CODE.unpack(said)[0] if len(said) == CODE.size else -int(signal.SIGKILL)
        return self._code

    def kill(self) -> None:
        """End it with what it started."""
        with contextlib.suppress(OSError):
            os.killpg(self.pid, signal.SIGKILL)

    def release(self) -> None:
        """Let the template forget it."""
        self._channel.close()
        self.template.left(self)


class Template:
    """The template's process, as its parent sees it."""

    def __init__(self, path: list[str]) -> None:
        self._environment = read_once()
        self._children: set[Forked] = set()
        self._retired = False
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            command = [
                sys.executable,
                "-c",
                START_TEMPLATE,
                json.dumps(path),
                str(os.getpid()),
                str(theirs.fileno()),
            ]
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], start_new_session=True
            )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def serves(self) -> bool:
        """Whether it lives, and began with the environment of now."""
        return self._process.poll() is None and self._environment == read_once()

    def fork(self, path: list[str], memory: float) -> Forked:
        """A new child that runs `cosim.master.child.main`.

        Args:
            path: its search path for modules.
            memory: what may be added to its memory [MiB].

        Raises:
            OSError: the template is gone, or the request is too long.
        """
        request = json.dumps([path, memory, dict(os.environ), str(Path.cwd())]).encode(
            "utf-8", "surrogateescape"
        )
        if len(request) > LONGEST_REQUEST:
            raise OSError("too long a request")
        their_in, our_in = os.pipe()
        our_out, their_out = os.pipe()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            with theirs:
                socket.send_fds(self._channel, [request], [their_in, their_out, 2, theirs.fileno()])
            pid = CODE.unpack(self._channel.recv(CODE.size))[0]
        except (OSError, struct.error) as error:
            ours.close()
            os.close(our_in)
            os.close(our_out)
            raise OSError(f"no child could be forked: {error}") from None
        finally:
            os.close(their_in)
            os.close(their_out)
        child = Forked(self, pid, os.fdopen(our_in, "wb"), os.fdopen(our_out, "rb"), ours)
        self._children.add(child)
        return child

    def left(self, child: Forked) -> None:
        """A child is needed no more."""
        self._children.discard(child)
        if self._retired and not self._children:
            self.end()

    def retire(self) -> None:
        """End it when its last child has ended."""
        self._retired = True
        if not self._children:
            self.end()

    def end(self) -> None:
        """End it, and the children that are left."""
        self._channel.close()
        self._process.wait()

    def forget(self) -> None:
        """In a fork of the parent, to which it does not belong."""
        self._channel.close()
        self._process.returncode = 0


def read_once() -> dict[str, str]:
    """The part of the environment that a process reads when it starts."""
    return {name: value for name, value in os.environ.items() if name.startswith(READ_ONCE)}


# In the template


def main(parent: int, channel: int) -> None:
    """Serve a parent until it goes away."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent)
    from cosim.master import child, compiled

    compiled.load()
    template, requests = os.getpid(), socket.socket(fileno=channel)
    heard, woken = os.pipe()
    os.set_blocking(heard, False)
    os.set_blocking(woken, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(woken)
    children: dict[socket.socket, int] = {}  # channel: process id, zombies too
    living: set[socket.socket] = set()
    while True:
        watched: list[Any] = [requests, heard, *children]
        ready, _, _ = select.select(watched, [], [])
        for each in ready:
            if each == heard:
                with contextlib.suppress(BlockingIOError):
                    os.read(heard, 4096)
            elif each is requests:
                data, files, _, _ = socket.recv_fds(requests, LONGEST_REQUEST, 4)
                if not data:
                    os._exit(0)  # the children end with us
                pid = os.fork()
                if pid == 0:
                    signal.set_wakeup_fd(-1)
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    for stream in (requests, *children):
                        stream.close()
                    os.close(heard)
                    os.close(woken)
                    begin(data, files)
                    child.main(template, json.loads(data)[1])
                with contextlib.suppress(OSError):
                    os.setpgid(pid, pid)  # the child does the same; whoever is first
                own = socket.socket(fileno=files.pop())
                for file in files:
                    os.close(file)
                children[own] = pid
                living.add(own)
                requests.send(CODE.pack(pid))
            elif each in children:  # the parent needs it no more
                pid = children.pop(each)
                living.discard(each)
                each.close()
                with contextlib.suppress(OSError):
                    os.killpg(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
        for each in list(living):
            found = os.waitid(os.P_PID, children[each], os.WEXITED | os.WNOHANG | os.WNOWAIT)
            if found is not None:
                living.discard(each)
                code = found.si_status if found.si_code == os.CLD_EXITED else -found.si_status
                with contextlib.suppress(OSError):
                    each.send(CODE.pack(code))


def begin(data: bytes, files: list[int]) -> None:
    """What a forked child has of the one who asked for it: search path, environment, folder and streams."""
    path, _, environment, folder = json.loads(data)
    os.setpgid(0, 0)
    for number, file in enumerate(files[:3]):
        os.dup2(file, number)
    for file in files:
        os.close(file)
    sys.path[:] = path
    os.environ.clear()
    os.environ.update(environment)
    with contextlib.suppress(OSError):
        os.chdir(folder)
    random: Any = sys.modules.get("numpy.random")
    if random is not None:  # Python's own random numbers are another sequence in each fork, numpy's are not
        random.seed()


def end_with(parent: int) -> None:
    """End when the parent does, however it does."""
    ctypes.CDLL(None).prctl(DEATH_OF_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit()
