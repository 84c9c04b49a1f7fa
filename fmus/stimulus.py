"""Stimulus: plays a recorded command, held between samples or joined by straight lines.

    u(t) = value of the last sample at or before t              (hold = 1)
    u(t) = straight line between the samples about t            (hold = 0)

Before the first and behind the last sample the nearest one holds.
"""

import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, Buffer, Variable, equation


class Input(NamedTuple):
    """Nothing comes in but time."""

    time: Annotated[float, Variable("s", "Communication time", kind="time")]


class Output(NamedTuple):
    """What goes out."""

    u: Annotated[float, Variable("1", "Command", discrete=True)]


class State(NamedTuple):
    """Where in the table it is."""

    row: Annotated[float, Variable("1", "Row of the last sample at or before now")]


class Memory(NamedTuple):
    """The table."""

    times: list[float]
    values: list[float]


class Parameters(NamedTuple):
    """How to play."""

    hold: Annotated[float, Variable("1", "1: hold each sample, 0: straight lines", 1.0, 0.0, 1.0, kind="integer", source="u held over each millisecond")]  # fmt: skip
    gain: Annotated[float, Variable("1", "Factor on the samples", 1.0, -100.0, 100.0, source="SYSTEM section 8: amplitudes 100, 75, 35 %")]  # fmt: skip


class Coefficients(NamedTuple):
    """Nothing but the step."""

    h: float


@equation
def sample(row: float, time: float, m: Memory, p: Parameters) -> float:
    """Value at `time`, which lies in or behind `row`."""
    i = int(row)
    value = m.values[i]
    if p.hold == 0.0 and i + 1 < len(m.times) and time > m.times[i]:
        part = (time - m.times[i]) / (m.times[i + 1] - m.times[i])
        value = value + part * (m.values[i + 1] - value)
    return p.gain * value


@equation
def seek(row: float, time: float, m: Memory) -> float:
    """Last row at or before `time`, from `row` on; a nanosecond of grace for masters with rounding jitter."""
    i = int(row)
    while i + 1 < len(m.times) and m.times[i + 1] <= time + 1e-9:
        i += 1
    return float(i)


@equation
def start(u: Input, p: Parameters) -> State:
    """Before the first row."""
    return State(0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Nothing depends on the step."""
    return Coefficients(h)


@equation
def step(x: State, u: Input, m: Memory, p: Parameters, c: Coefficients) -> State:
    """The row at the end of the step."""
    return State(seek(x.row, u.time, m))


@equation
def output(x: State, u: Input, m: Memory, p: Parameters) -> Output:
    """The sample that holds now."""
    return Output(sample(seek(x.row, u.time, m), u.time, m, p))


BLOCK = Block(
    name="stimulus",
    title="Stimulus: plays a recorded command",
    module=sys.modules[__name__],
    memory={
        "times": Buffer(0, "Time of each sample, s", "stimulus.csv:0"),
        "values": Buffer(0, "Command at each sample", "stimulus.csv:1"),
    },
)
