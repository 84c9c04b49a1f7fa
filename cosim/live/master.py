"""The controller's side: a sample in, a command out, a row on the log, once a slot."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from cosim.live.codec import Codec, Sample, single
from cosim.live.link import ROOM, STALE, Arrivals, Link
from cosim.live.observer import Estimator
from cosim.live.operator import Operator
from cosim.live.pace import PERIOD, Lateness, Pace
from cosim.live.recorder import Recorder, Row
from cosim.signals import LOG_SIGNALS, SIGNALS, SYNTHETIC_COLUMN
from fmus import controller, reference
from fmus.contract import NoMemory

DEG = math.pi / 180.0
MOST_BEHIND = ROOM - 6  # slots made up for after a pause; a longer one leaves a gap in the log
MOST_EVENTS = 1000
Cells = list[float | None]
ESTIMATES = ("slew_estimate", "slew_rate_estimate")


class Controller:
    """Manual and automatic by the block `controller`, its reference by the block `reference`; angles in deg.

    Args:
        gains: parameters of the block that differ from its declaration, SI.
    """

    def __init__(self, gains: dict[str, float] | None = None) -> None:
        starts = {n: v.start for n, v in controller.BLOCK.parameters.items()} | (gains or {})
        self._p = controller.Parameters(**starts)
        self._c = controller.coefficients(self._p, PERIOD)
        self._profile = reference.Parameters(*(v.start for v in reference.BLOCK.parameters.values()))
        self._x = controller.State(0.0, 0.0, 0.0, -1.0)
        self._angle, self._rate, self._automatic = 0.0, 0.0, False

    def rest(self) -> None:
        """The command is 0; what comes next fades in, since no mode was the last one."""
        self._x, self._automatic = controller.State(0.0, 0.0, 0.0, -1.0), False

    def step(self, manual: float, automatic: bool, target: float | None, slew: float, rate: float) -> float:
        """The command [1] for the slot that begins, from angle [deg] and velocity [deg/s] now."""
        if automatic and not self._automatic:
            self._angle, self._rate = slew * DEG, 0.0  # the loop closes where the crane is
        elif automatic and target is not None:
            self._angle, self._rate = reference.toward(
                self._angle, self._rate, target * DEG, self._profile, PERIOD
            )
        self._automatic = automatic
        entered = controller.Input(
            self._angle, self._rate, slew * DEG, rate * DEG, manual, 1.0 if automatic else 0.0
        )
        self._x = controller.step(self._x, entered, NoMemory(), self._p, self._c)
        u = controller.output(self._x, entered, NoMemory(), self._p).u
        return max(-1.0, min(1.0, u))


class Master:
    """One run of the controller's side.

    Attributes:
        operator: what is wanted.
        lateness: of each slot.
        overrun: slots that were over before they began, and for which no command went out.
        skipped: slots left out after a pause that was too long to be made up for.
        recorder: of the log, or None; the caller closes it.
        slot: number of the slot in the log, which begins with the first datagram; -1 before.
        synthetic: samples carried the mark of our own crane.
        events: what happened when, as (time in the log [s], text); the last `MOST_EVENTS`.
    """

    def __init__(
        self,
        link: Link,
        codec: Codec,
        observer: Estimator,
        operator: Operator,
        recorder: Recorder | None = None,
        *,
        control: Controller | None = None,
        played: Sequence[float] = (),
        script: Sequence[tuple[float, str]] = (),
        outgoing: Callable[[float], float] = float,
        synthetic: bool = False,
    ) -> None:
        """Put the parts together.

        Args:
            link: to the crane.
            codec: of its layout.
            observer: makes the estimates.
            operator: what is wanted.
            recorder: of the log, whose columns are `columns(codec)`; None keeps no log.
            control: of the first command.
            played: manual command of each slot, added to the operator's.
            script: lines for the operator with their times in the log [s].
            outgoing: from the logged command to the one that goes out: a compensator on this side.
            synthetic: mark the log as synthetic whatever the samples carry.
        """
        self.operator, self.lateness, self.events = (
            operator,
            Lateness(),
            deque[tuple[float, str]](maxlen=MOST_EVENTS),
        )
        self.overrun = self.skipped = 0
        self.slot, self.synthetic = -1, synthetic
        self._link, self._codec, self._observer, self.recorder = link, codec, observer, recorder
        self._control, self._played, self._script = control or Controller(), played, deque(script)
        self._outgoing = outgoing
        self._arrivals = Arrivals(link.counts)
        self._values: list[float | None] = [None] * len(codec.channels)
        self._slew = [c.name for c in codec.channels].index("slew")
        self._u = 0.0
        self._estimate: tuple[float, float] | None = None
        self._down, self._blind = True, STALE
        self._ahead: list[Cells] = []
        # a log's columns: command, sensors, estimates, mark; then what the layout names beside the signals
        known = sum(c.name in LOG_SIGNALS for c in codec.channels)
        self._places = [k + 1 if k < known else k + 4 for k in range(len(codec.channels))] + [known + 3]
        self._first, self._width = known + 1, len(codec.channels) + 4

    def run(
        self,
        pace: Pace,
        duration: float | None,
        stop: Callable[[], str | None],
        lines: Callable[[], str | None] = lambda: None,
    ) -> str:
        """Runs until the duration [s] is over, `stop` gives a reason or `quit` is said; returns why it ended.

        Args:
            pace: the clock.
            duration: None has no end.
            stop: asked once a slot.
            lines: gives the operator's next line, asked once a slot.
        """
        end = math.inf if duration is None else round(duration / pace.period)
        count = 0
        try:
            while True:
                late = pace.wait(self._link.socket)
                self.lateness.add(late)
                self._link.drain(int(pace.behind()) + 2)
                # what comes from here on counts as come in a later slot: a pause of ours would make a flood of it
                behind = pace.behind()
                if (reason := stop()) is not None:
                    # what came before the word to stop belongs on the log, however late we are
                    waiting = self._link.drain(int(behind) + 2)
                    for _ in range(max(0, int(behind)) + 1 + waiting):
                        if not self._link.drain(int(behind) + 2):
                            break
                        self.tick(overdue=True, due=int(behind) + 2)
                    return reason
                if count >= end:
                    return "duration"
                self.listen(lines())
                if self.operator.ended:
                    return "quit"
                slots = 1
                if behind > MOST_BEHIND:
                    slots = int(behind)
                    self.skip(slots)
                self.tick(behind >= 0.0 and slots == 1, None)
                if self._arrivals.down:
                    pace.aligned = False
                pace.next(slots)
                count += slots
        finally:
            self.end()

    def listen(self, line: str | None) -> None:
        """Hands the operator a line, and those of the script whose time has come; a bad one is an event."""
        now = self.time
        while self._script and self._script[0][0] <= now + 1e-9 and self.slot >= 0:
            self._obey(self._script.popleft()[1])
        if line is not None:
            self._obey(line)

    def _obey(self, line: str) -> None:
        from cosim.errors import UsageError

        try:
            self.operator.obey(line)
            self.note(line.strip())
        except UsageError as error:
            self.note(str(error))

    @property
    def time(self) -> float:
        """Time in the log, s."""
        return max(self.slot, 0) * PERIOD

    def note(self, text: str) -> None:
        """Remembers an event."""
        self.events.append((self.time, text))

    def skip(self, slots: int) -> None:
        """Leaves slots out: the pause was too long to be made up for."""
        self.skipped += slots
        self.note(f"{slots} slots left out after a pause")
        if self.slot >= 0:
            self.slot += slots - 1

    def tick(self, overdue: bool = False, due: int | None = 1) -> None:
        """One slot.

        Args:
            overdue: the next slot is due already: this one takes one of the waiting samples and sends nothing.
            due: number of datagrams that may be waiting without being too many; None: they have been read already.
        """
        link = self._link
        if due is not None:
            link.drain(due)
        payloads = link.take(1) if overdue else link.take()
        self.overrun += overdue
        if self.slot < 0 and not link.counts.received:
            link.send(self._codec.write_command((0.0,) * 6))
            return
        self.slot += 1
        first, fresh = self._arrivals.place(
            self.slot, payloads if len(payloads) < 2 else self._usable(payloads)
        )
        row: Row = [None] * self._width
        if self.recorder is not None:
            self.recorder.add(self.slot, row)
        self._blind += 1
        samples = [self._take(payload) for payload in fresh]
        self._lay(first, row, samples)
        self._watch()
        slew = self._values[self._slew]
        if slew is not None:
            self._estimate = self._observer.step(self._u, slew)
            row[self._first], row[self._first + 1] = self._estimate
        if not overdue:
            self._send()
        row[0] = self._u

    def _usable(self, payloads: list[bytes]) -> list[bytes]:
        """Without those of which no value can be used, where there is another: they are no samples."""
        counts, found = self._link.counts, []
        bad: list[Sample] = []
        for payload in payloads:
            sample = self._codec.read_sample(payload)
            if any(value is not None for value in sample.values):
                found.append(payload)
            else:
                bad.append(sample)
        if not found:
            return payloads
        counts.nan += sum(sample.nan > 0 for sample in bad)
        counts.beyond += sum(sample.beyond > 0 for sample in bad)
        return found

    def _take(self, payload: bytes) -> Cells:
        """Holds what is good of a sample; returns its cells: the channels' values and the mark."""
        sample = self._codec.read_sample(payload)
        counts = self._link.counts
        counts.nan += sample.nan > 0
        counts.beyond += sample.beyond > 0
        self.synthetic |= sample.synthetic
        for k, value in enumerate(sample.values):
            if value is not None:
                self._values[k] = value
                self._blind = 0 if k == self._slew else self._blind
        return [*sample.values, 1.0 if self.synthetic else 0.0]

    def _lay(self, first: int, row: Row, samples: list[Cells]) -> None:
        """Lays samples into the rows from slot `first` to this one, in the order in which they came; what is early waits."""
        rows: list[Row] = [row]
        if first < self.slot and self.recorder is not None:
            older = [self.recorder.row(k) for k in range(first, self.slot)]
            rows = [*(r for r in older if r is not None), row]
        mark = self._places[-1]
        known = [[r[k] for k in self._places] for r in rows if r[mark] is not None]
        room = len(rows) - len(known) + self._arrivals.ahead
        new = [*self._ahead, *samples]
        waiting = [*known, *new[max(0, len(new) - room) :]]
        for target, cells in zip(rows, waiting, strict=False):
            for place, value in zip(self._places, cells, strict=True):
                target[place] = value
        self._ahead = waiting[len(rows) :]

    def _watch(self) -> None:
        down = self._blind >= STALE
        if down != self._down:
            self._down = down
            self.note("no usable slew angle comes" if down else "the slew angle comes")
        if self.operator.stopped:
            self._played = ()  # a reset does not go on with it

    def _send(self) -> None:
        """Decides on the commands of the slot that begins and sends them."""
        operator = self.operator
        played = self._played[self.slot] if self.slot < len(self._played) else 0.0
        manual = max(-1.0, min(1.0, operator.manual[0] + played))
        live = self._estimate is not None and not self._down and not operator.stopped
        enables = [live and enable for enable in operator.enables]
        if enables[0] and self._estimate is not None:
            self._u = single(self._control.step(manual, operator.automatic, operator.target, *self._estimate))
        else:
            self._u = 0.0
            self._control.rest()
        others = [operator.manual[k] if enables[k] else 0.0 for k in (1, 2)]
        self._link.send(self._codec.write_command((self._outgoing(self._u), *others, *map(float, enables))))

    def end(self) -> None:
        """The last word to the crane: every command 0 and every enable off, said three times since one may be lost."""
        self._arrivals.close()
        for _ in range(3):
            self._link.send(self._codec.write_command((0.0,) * 6))

    def facts(self) -> dict[str, Any]:
        """The account of the run, as plain data."""
        return {
            "slots": self.slot + 1,
            "synthetic": self.synthetic,
            "observer": self._observer.kind,
            "datagrams": self._link.counts.facts(),
            "sent": self._link.sent,
            "unsent": self._link.unsent,
            "lateness": self.lateness.facts(),
            "overrun": self.overrun,
            "skipped": self.skipped,
            "emergency_stop": self.operator.stopped,
            "events": [{"time": stamp, "what": text} for stamp, text in self.events],
        }


def columns(codec: Codec) -> list[str]:
    """The columns of the log, ``name [unit]``, without time."""
    named = [f"{c.name} [{c.unit}]" for c in codec.channels]
    known = sum(c.name in LOG_SIGNALS for c in codec.channels)
    estimates = [f"{name} [{SIGNALS[name].unit}]" for name in ESTIMATES]
    return ["u [1]", *named[:known], *estimates, f"{SYNTHETIC_COLUMN} [1]", *named[known:]]
