"""The UDP socket of one side, and the account of what came.

A datagram has no number and no time. So the only clock is ours: a slot a period, one datagram a slot. A slot without one is
held over; what that meant shows later, and `Arrivals` says so.
"""

import contextlib
import socket
from collections import deque
from dataclasses import asdict, dataclass

from cosim.errors import UsageError

LOOPBACK = "127.0.0.1"
ROOM = (
    256  # datagrams read a slot, and kept; more is a flood, whose rest stays with the system, which drops it
)
FLOOD = 10  # datagrams more than are due in a slot, above which it is called flooded
BUFFER = 1 << 20  # bytes that the system is asked to keep: about a second of samples, while we pause
STALE = 100  # slots without a usable datagram after which the link counts as down
LATE = 20  # slots in which none was empty or late, after which nothing makes up for an empty one any more
AHEAD = 2  # datagrams that may have come before their slot, as where we woke late or the other clock jitters
Address = tuple[str, int]


@dataclass
class Counts:
    """What came, in datagrams unless it says otherwise.

    Attributes:
        received: all of them.
        used: taken as a sample, in their slot or late.
        lost: slots whose datagram never came.
        late: came in a later slot than their own.
        repeated: the same bytes again beside another datagram in one slot.
        surplus: more than one a slot, where none was missing.
        identical: the same bytes as the sample before, alone in their slot: a quiet sensor or a stale sender.
        short, long: of a wrong length; dropped.
        nan: with a value that is NaN or infinite; that value is held over, or all of it dropped where it has nothing else.
        beyond: with a value beyond what the instrument can show; that value is held over.
        foreign: from another host than the peer; dropped.
        held_over: slots in which nothing new came.
        silent: slots, among the held over, while the link was down.
        interruptions: times the link went down.
        flooded: slots with more than `FLOOD` datagrams beyond those that were due.
        refused: errors of the system while receiving.
    """

    received: int = 0
    used: int = 0
    lost: int = 0
    late: int = 0
    repeated: int = 0
    surplus: int = 0
    identical: int = 0
    short: int = 0
    long: int = 0
    nan: int = 0
    beyond: int = 0
    foreign: int = 0
    held_over: int = 0
    silent: int = 0
    interruptions: int = 0
    flooded: int = 0
    refused: int = 0

    def facts(self) -> dict[str, int]:
        """As plain data."""
        return asdict(self)


def parse_peer(text: str) -> Address:
    """``HOST:PORT``, the host as a name, an IPv4 address or an IPv6 address in brackets.

    Raises:
        UsageError: it is none.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(f"--peer '{text}' should read HOST:PORT, such as 127.0.0.1:5002")
    return host.strip("[]"), int(port)


class Link:
    """A bound socket and the peer.

    Attributes:
        socket: bound, not blocking.
        peer: where to send; where none is given, the host of the first good datagram, at the port of its last one.
        counts: what came.
        sent, unsent: datagrams that the system took and did not take.
    """

    def __init__(self, port: int, size: int, peer: Address | None = None, bind: str = LOOPBACK) -> None:
        """Bind.

        Args:
            port: to listen on; 0 lets the system choose.
            size: bytes of a datagram that comes in.
            peer: where to send.
            bind: address of this machine to listen on; the loopback unless another is wanted.

        Raises:
            UsageError: address or port cannot be used, or the peer's name is not known.
        """
        if not 0 <= port < 65536:
            raise UsageError(f"--listen {port} is no port: use 1 to 65535, or 0 for a free one")
        family, address = _resolved(bind, port, "--bind")
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.counts, self.sent, self.unsent = Counts(), 0, 0
        self._size, self._waiting = size, deque[bytes](maxlen=ROOM)
        try:
            self.socket.setblocking(False)
            with contextlib.suppress(OSError):  # then it keeps as much as it does by itself
                self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self.socket.bind(address)
            self.peer = None if peer is None else _resolved(*peer, "--peer", family)[1]
            self._given = self.peer is not None
        except OSError as error:
            self.close()
            raise UsageError(
                f"cannot listen on {bind}:{port}: {error.strerror or error}: choose another --listen or --bind"
            ) from None
        except BaseException:
            self.close()
            raise

    @property
    def address(self) -> Address:
        """Where this side listens."""
        host, port = self.socket.getsockname()[:2]
        return host, port

    def close(self) -> None:
        """Closes the socket; safe to call twice."""
        self.socket.close()

    def drain(self, due: int = 1) -> int:
        """Reads what has come, where so many are `due`; returns how many good ones wait, at most `ROOM`."""
        counts, waiting, size = self.counts, self._waiting, self._size
        number, room = 0, ROOM - len(waiting)
        while number < room:
            try:
                payload, sender = self.socket.recvfrom(size + 1)
            except BlockingIOError:
                break
            except OSError:  # Windows tells of a peer that is not there, and of datagrams that are too long
                counts.refused += 1
                number += 1
                continue
            number += 1
            if self.peer is not None and sender[0] != self.peer[0]:
                counts.foreign += 1
            elif len(payload) < size:
                counts.short += 1
            elif len(payload) > size:
                counts.long += 1
            else:
                if not self._given:
                    self.peer = sender
                waiting.append(payload)
        counts.received += number
        counts.flooded += number > FLOOD + due
        return len(waiting)

    def take(self, most: int = ROOM) -> list[bytes]:
        """The oldest of the waiting datagrams, at most so many, in the order in which they came."""
        return [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]

    def send(self, payload: bytes) -> None:
        """Sends, if the peer is known; what the system refuses is counted."""
        if self.peer is None:
            return
        try:
            self.socket.sendto(payload, self.peer)
            self.sent += 1
        except OSError:
            self.unsent += 1


def _resolved(
    host: str, port: int, option: str, family: int = socket.AF_UNSPEC
) -> tuple[int, tuple[str, int]]:
    """Family and address of a host and port."""
    with contextlib.suppress(OSError):
        found = socket.getaddrinfo(host, port, family, socket.SOCK_DGRAM)
        if found:
            return int(found[0][0]), found[0][4]  # type: ignore[return-value]
    raise UsageError(
        f"{option}: '{host}' is no address of the kind that is bound: give one, or another --bind"
    )


class Arrivals:
    """Which datagram belongs to which slot; datagrams are taken to come in the order in which they were sent.

    - The same bytes as the datagram before, beside another one in the slot: repeated, dropped. Where most datagrams are as
      the one before anyhow (a held command, a sensor without noise) equal bytes say nothing: late if a slot was empty.
    - Several left: they make up for the last empty slots (late); else they belong to the next ones (early, at most
      `AHEAD`, not counted); else they are surplus, and the oldest is dropped. So is an early one that no empty slot follows
      within `LATE` slots: all samples behind it would stand in the row of a later command.
    - None: the slot is held over. It is lost when nothing makes up for it until `LATE` slots in a row were in order, or
      for `STALE` slots; where nothing at all came for `STALE` slots the link is down, and they are silent instead.

    Two datagrams exchanged on the way look like any others.

    Attributes:
        down: nothing has come for `STALE` slots, or yet.
        ahead: how many of the datagrams that were placed belong to slots to come.
    """

    def __init__(self, counts: Counts) -> None:
        self.down = True
        self._counts = counts
        self._last: bytes | None = None
        self._empty = deque[int]()
        self._quiet = self.ahead = self._led = self._unsteady = 0

    def place(self, slot: int, payloads: list[bytes]) -> tuple[int, list[bytes]]:
        """What to use in a slot.

        Returns:
            (the empty slot from which on the samples move up by as many as are late, or `slot` itself; the datagrams in
            their order, of which the last `AHEAD` may belong to the slots after this one).
        """
        counts = self._counts
        empty = self._empty
        while empty and (empty[0] <= slot - STALE or slot - self._unsteady > LATE):
            empty.popleft()
            counts.lost += 1
        if not payloads:
            self._miss(slot)
            return slot, []
        fresh = self._without_repeats(payloads)
        self._led = self._led + 1 if self.ahead else 0
        if self._led > LATE:
            self._led = 0
            self.ahead -= 1
            counts.used -= 1
            counts.surplus += 1
        served = self.ahead > 0
        late = 0 if served else min(len(fresh) - 1, len(self._empty))
        early = self.ahead - served + len(fresh) - late - (not served)
        for _ in range(early - AHEAD):
            if fresh.pop(0) == fresh[-1]:
                counts.repeated += 1
            else:
                counts.surplus += 1
        first = slot
        for _ in range(late):
            first, self._unsteady = self._empty.pop(), slot
        self.ahead, self._quiet, self.down = min(AHEAD, early), 0, False
        counts.late += late
        counts.used += len(fresh)
        return first, fresh

    def close(self) -> None:
        """The end: what is still missing was lost, unless the link was down."""
        self._counts.lost += len(self._empty)
        self._empty.clear()

    def _miss(self, slot: int) -> None:
        counts = self._counts
        if self.ahead:
            self.ahead -= 1
            return
        counts.held_over += 1
        self._quiet += 1
        if self.down:
            counts.silent += 1
            return
        self._empty.append(slot)
        self._unsteady = slot
        if self._quiet == STALE:
            self.down = True
            counts.interruptions += 1
            counts.silent += STALE
            for _ in range(STALE):
                self._empty.pop()

    def _without_repeats(self, payloads: list[bytes]) -> list[bytes]:
        counts, last = self._counts, self._last
        self._last = payloads[-1]
        counts.identical += len(payloads) == 1 and payloads[0] == last
        if len(payloads) == 1 or 10 * counts.identical > counts.used:
            return payloads
        before = [last, *payloads[:-1]]
        fresh = [now for now, then in zip(payloads, before, strict=True) if now != then] or payloads[-1:]
        counts.repeated += len(payloads) - len(fresh)
        return fresh
