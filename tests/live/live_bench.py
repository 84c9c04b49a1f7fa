"""Both ends of a link in one process, slot by slot: no clock and no network, so the machine's load does not count."""

import contextlib
import struct
from collections import deque

from cosim.live.codec import Codec
from cosim.live.crane import Crane
from cosim.live.layout import Layout
from cosim.live.link import Link
from cosim.live.master import Master, columns
from cosim.live.observer import PlainObserver
from cosim.live.operator import Operator
from cosim.live.recorder import Recorder


class Wire:
    """In place of a link's socket: what is sent has come. A busy system delivers even over the loopback when it likes."""

    def __init__(self, link, ends):
        self.name, self.ends, self.waiting = link.socket.getsockname(), ends, deque()
        link.socket.close()
        link.socket = ends[self.name] = self

    def getsockname(self):
        return self.name

    def sendto(self, payload, address):
        if address in self.ends:
            self.ends[address].waiting.append(payload)

    def recvfrom(self, size):
        if not self.waiting:
            raise BlockingIOError
        return self.waiting.popleft()[:size], next(name for name in self.ends if name != self.name)

    def close(self):
        self.waiting.clear()


def wired(link, other):
    """Joins two links by a wire."""
    ends = {}
    for one in (link, other):
        Wire(one, ends)
    link.peer = other.address


class Recorded:
    """A crane of the test's own: sends what it is told, keeps what it gets."""

    def __init__(self, master_link):
        self.link = Link(0, 24, master_link.address)
        wired(master_link, self.link)
        self.got = []

    def sample(self, slew=12.0, pressure=170.0, spool=0.0):
        self.send(struct.pack("<7f", slew, pressure, 85.0, 85.0, spool, 0.0, 0.0))

    def send(self, payload):
        self.link.socket.sendto(payload, self.link.peer)

    def listen(self):
        """The commands that came since the last time, as (u1, u2, u3, enable1, enable2, enable3)."""
        self.link.drain(1000)
        found = [struct.unpack("<6f", payload) for payload in self.link.take()]
        self.got += found
        return found


@contextlib.contextmanager
def bench(path=None, operator=None, **options):
    """A Master and a crane of the test's own."""
    codec = Codec(Layout())
    link = Link(0, codec.from_size)
    recorder = None if path is None else Recorder(path, columns(codec), 1e-3)
    crane = Recorded(link)
    try:
        yield Master(link, codec, PlainObserver(), operator or Operator(), recorder, **options), crane
    finally:
        if recorder is not None:
            recorder.close()
        link.close()
        crane.link.close()


@contextlib.contextmanager
def pair(plant, path, operator=None, crane_path=None, **options):
    """A Master and the crane with `plant`, joined."""
    codec = Codec(Layout())
    with contextlib.ExitStack() as stack:
        link = Link(0, codec.from_size)
        stack.callback(link.close)
        other = Link(0, codec.to_size, link.address)
        stack.callback(other.close)
        wired(link, other)
        recorder = Recorder(path, columns(codec), 1e-3)
        stack.callback(recorder.close)
        own = None
        if crane_path is not None:
            own = Recorder(
                crane_path,
                ["u [1]", *(f"{c.name} [{c.unit}]" for c in codec.channels), "synthetic [1]"],
                1e-3,
            )
            stack.callback(own.close)
        yield (
            Master(link, codec, PlainObserver(), operator or Operator(), recorder, **options),
            Crane(other, codec, plant, own),
        )


def run(master, crane, slots):
    """So many slots of both, the crane first."""
    for _ in range(slots):
        crane.tick()
        master.tick()
        master.listen(None)
