"""The crane behind the same link: the virtual rig, or a system of FMUs, in real time; and its side of the link."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from cosim.errors import SimulationError, UsageError
from cosim.live.codec import Codec
from cosim.live.link import Arrivals, Link
from cosim.live.master import MOST_BEHIND
from cosim.live.pace import PERIOD, Lateness, Pace
from cosim.live.recorder import Recorder, Row
from cosim.signals import LOG_SIGNALS, SIGNALS, SYNTHETIC_COLUMN

HELD = 1.0 + 1e-6  # a command beyond 1 by rounding to float32 still counts


class Plant(Protocol):
    """A crane that goes on by a period a call."""

    def step(self, u: float) -> None:
        """A period with the command `u` [1]."""

    def read(self) -> Mapping[str, float]:
        """What the sensors show now, in the log's units."""


class SystemPlant:
    """A system of FMUs as a crane: any open package with an input ``u`` and a log's signals as outputs.

    Args:
        path: the .ssp file.
        settings: texts ``component.parameter=value unit``.

    Raises:
        ModelError, UsageError: the file is bad, or a setting.
        SimulationError: an FMU cannot be started.
    """

    def __init__(self, path: Path, settings: Sequence[str] = ()) -> None:
        from cosim.master.engine import Engine
        from cosim.master.host import _initialise
        from cosim.master.inputs import Sampler
        from cosim.master.instance import Instance
        from cosim.master.interpreted import operations
        from cosim.master.plan import make_plan
        from cosim.request import parameters
        from cosim.ssp.read import read_system, resolve
        from cosim.units import factor

        self._instances: list[Any] = []
        self._system = system = read_system(path)
        try:
            if not all(component.fmu.ours for component in system.components.values()):
                raise UsageError(
                    f"{path}: an FMU in it is not ours, so it runs in a process of its own, which no loop of 1 ms can wait"
                    " for: take a package that `cosim build` made"
                )
            names = [
                n
                for n in LOG_SIGNALS
                if n in system.outputs and n not in ("slew_estimate", "slew_rate_estimate")
            ]
            if "u" not in system.inputs or "slew" not in names:
                raise UsageError(
                    f"{path}: a crane needs an input 'u' and an output 'slew': take an open package"
                )
            plan = make_plan(system, ["u"], ["u"], names)
            instances = {}
            for number, (name, component) in enumerate(system.components.items()):
                instances[name] = Instance(component, number)
                self._instances.append(instances[name])
            ordered = [instances[name] for name in plan.order.names]
            grid = np.array([0.0, PERIOD])
            loop = Engine(plan, ordered, grid, Sampler({"u": 0.0}, grid, plan.held))
            found = parameters(system, [], list(settings))
            _initialise(loop, {port: value for n, value in found.items() for port in resolve(system, n)})
            self._steps = operations(
                plan, ordered, loop.values, loop.in_values, (loop.in_slots, loop.out_slots), PERIOD
            )
        except BaseException:
            self.close()
            raise
        self._kept = plan, loop  # the FMUs read and write their arrays by address
        self._ordered, self._values = ordered, loop.values
        self._input, self._copies = plan.n_outputs, list(enumerate(map(int, plan.snapshots)))
        self._read = [
            (r.name, r.index, factor(system.variable(r.unit_of).unit or "1", SIGNALS[r.name].unit))
            for r in plan.recorded
        ]
        self._count = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Frees the FMUs."""
        for instance in self._instances:
            instance.close()
        self._instances.clear()
        self._system.close()

    def step(self, u: float) -> None:
        """See `Plant`.

        Raises:
            SimulationError: an FMU failed.
        """
        values = self._values
        values[self._input] = u
        for d, source in self._copies:
            values[self._input + 1 + d] = values[source]
        time = self._count * PERIOD
        for instance, operate in zip(self._ordered, self._steps, strict=True):
            _, status = operate(time, time + PERIOD)
            if status > 1 or status < 0:
                instance.failed(status)
                raise SimulationError(instance.report(f"failed at t = {time:.9g} s"))
        self._count += 1

    def read(self) -> Mapping[str, float]:
        """See `Plant`."""
        return {name: float(self._values[index]) * scale for name, index, scale in self._read}


class Crane:
    """One run of the crane's side: a slot is a period of the plant with the newest command, then a sample goes out.

    A command that comes within the period after the sample it answers holds for all of that period, so that a log's row is a
    sample and the command that was held from it on.

    Attributes:
        lateness: of each slot.
        overrun: slots that were over before they began.
        recorder: of the log, or None; the caller closes it.
        slot: number of the slot.
        applied: the command that the plant feels, 1.
    """

    def __init__(
        self,
        link: Link,
        codec: Codec,
        plant: Plant,
        recorder: Recorder | None = None,
        incoming: Callable[[float], float] = float,
    ) -> None:
        """Put the parts together.

        Args:
            link: to the controller.
            codec: of the layout.
            plant: the crane.
            recorder: of what the crane itself knows, whose columns are `columns(codec)`.
            incoming: from the command that comes in to the one that the plant takes.
        """
        self.lateness, self.overrun, self.skipped, self.slot = Lateness(), 0, 0, -1
        self.applied = 0.0
        self._link, self._codec, self._plant, self.recorder = link, codec, plant, recorder
        self._incoming = incoming
        self._arrivals = Arrivals(link.counts)
        self._sample = self._measured()

    def run(self, pace: Pace, duration: float | None, stop: Callable[[], str | None]) -> str:
        """Runs until the duration [s] is over or `stop` gives a reason; returns why it ended."""
        end = math.inf if duration is None else round(duration / pace.period)
        count = 0
        while True:
            self.lateness.add(pace.wait())
            behind = pace.behind()
            if (reason := stop()) is not None:
                return reason
            if count >= end:
                return "duration"
            slots = 1
            if behind > MOST_BEHIND:  # its time stands still meanwhile
                slots = int(behind)
                self.skipped += slots - 1
            self.tick(behind >= 0.0 and slots == 1, int(behind) + 2)
            pace.next(slots)
            count += slots

    def tick(self, overdue: bool = False, due: int = 1) -> None:
        """One slot; arguments as those of `cosim.live.master.Master.tick`."""
        link = self._link
        link.drain(due)
        payloads = link.take(1) if overdue else link.take()
        self.overrun += overdue
        self.slot += 1
        for payload in self._arrivals.place(self.slot, payloads)[1]:
            self._obey(payload)
        if self._arrivals.down:
            self.applied = 0.0
        if self.slot > 0:
            if self.recorder is not None:
                row: Row = [self.applied, *self._sample, 1.0]
                self.recorder.add(self.slot - 1, row)
            self._plant.step(self.applied)
            self._sample = self._measured()
        link.send(self._codec.write_sample(self._sample))

    def _obey(self, payload: bytes) -> None:
        """Takes the first command; one that is no number or beyond -1 to 1 is held over, a disabled one is 0."""
        counts, (u, *_, enable, _, _) = self._link.counts, self._codec.read_command(payload)
        if not (math.isfinite(u) and math.isfinite(enable)):
            counts.nan += 1
        elif abs(u) > HELD:
            counts.beyond += 1
        elif enable >= 0.5:
            self.applied = max(-1.0, min(1.0, self._incoming(max(-1.0, min(1.0, u)))))
        else:
            self.applied = 0.0

    def _measured(self) -> tuple[float, ...]:
        """What the sensors show, of the layout's channels; one that the plant does not have is 0."""
        found = self._plant.read()
        return tuple(found.get(channel.name, 0.0) for channel in self._codec.channels)

    def facts(self) -> dict[str, Any]:
        """The account of the run, as plain data."""
        return {
            "slots": self.slot + 1,
            "synthetic": True,
            "datagrams": self._link.counts.facts(),
            "sent": self._link.sent,
            "unsent": self._link.unsent,
            "lateness": self.lateness.facts(),
            "overrun": self.overrun,
            "skipped": self.skipped,
        }


def columns(codec: Codec) -> list[str]:
    """The columns of the crane's own log, ``name [unit]``, without time."""
    return ["u [1]", *(f"{c.name} [{c.unit}]" for c in codec.channels), f"{SYNTHETIC_COLUMN} [1]"]
