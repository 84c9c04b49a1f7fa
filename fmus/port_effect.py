"""What may happen to a signal in a wire, one after the other; each is off by default.

    y = gain u;  + offset;  delay;  lag y' + y = u;  low..high;  dead zone;  play;  rate limit;  drift;  quantum

It stands between an output and an input of a system whose components nobody here knows.
"""

import math
import sys
from typing import Annotated, Any, NamedTuple

from fmus.contract import UNBOUNDED, Block, Buffer, Variable, equation
from fmus.ring import RING, ago


class Input(NamedTuple):
    """What comes in."""

    u: Annotated[float, Variable("1", "Signal before the effect, in its own unit")]


class Output(NamedTuple):
    """What goes on."""

    y: Annotated[float, Variable("1", "Signal after the effect, in its own unit")]


class State(NamedTuple):
    """What the effects remember."""

    y: Annotated[float, Variable("1", "Signal after the effect")]
    place: Annotated[float, Variable("1", "Place of the newest sample in the ring")]
    steps: Annotated[float, Variable("1", "Steps made")]
    first: Annotated[float, Variable("1", "Signal at the start")]
    late: Annotated[float, Variable("1", "Delayed signal")]
    slow: Annotated[float, Variable("1", "Output of the lag")]
    held: Annotated[float, Variable("1", "Output of the play")]
    limited: Annotated[float, Variable("1", "Output of the rate limit")]


class Parameters(NamedTuple):
    """Sizes; each at its off value."""

    gain: Annotated[float, Variable("1", "Factor", 1.0, -1e6, 1e6, source="off: 1")]
    offset: Annotated[float, Variable("1", "Added", 0.0, source="off: 0")]
    delay: Annotated[float, Variable("s", "Transport delay", 0.0, 0.0, 1e6, source="off: 0")]
    lag: Annotated[float, Variable("s", "Time constant", 0.0, 0.0, 1e6, source="off: 0")]
    low: Annotated[float, Variable("1", "Lowest value", -UNBOUNDED, source="off: out of reach")]
    high: Annotated[float, Variable("1", "Highest value", UNBOUNDED, source="off: out of reach")]
    zone_low: Annotated[float, Variable("1", "Lower end of the dead zone", 0.0, high=0.0, source="off: 0")]
    zone_high: Annotated[float, Variable("1", "Upper end of the dead zone", 0.0, 0.0, source="off: 0")]
    half_width: Annotated[float, Variable("1", "Half of the play's width", 0.0, 0.0, source="off: 0")]
    rate: Annotated[float, Variable("1/s", "Highest speed", UNBOUNDED, 0.0, source="off: out of reach")]
    drift: Annotated[float, Variable("1/s", "Speed of a ramp", 0.0, source="off: 0")]
    quantum: Annotated[float, Variable("1", "Step of the values", 0.0, 0.0, source="off: 0")]


class Coefficients(NamedTuple):
    """The step, s."""

    h: float


@equation
def limits(y: float, p: Parameters) -> float:
    """Saturation, then the dead zone."""
    y = min(max(y, p.low), p.high)
    if p.zone_low == 0.0 and p.zone_high == 0.0:
        return y
    if y > p.zone_high:
        return y - p.zone_high
    if y < p.zone_low:
        return y - p.zone_low
    return 0.0


@equation
def shown(y: float, time: float, p: Parameters) -> float:
    """Ramp and steps of a reading."""
    y = y + p.drift * time
    if p.quantum > 0.0:
        y = p.quantum * math.floor(y / p.quantum + 0.5)
    return y


@equation
def start(u: Input, p: Parameters) -> State:
    """As if the signal had been what it is; the play has come from zero."""
    x = p.gain * u.u + p.offset
    y = limits(x, p)
    held = max(y - p.half_width, min(y + p.half_width, 0.0))
    if p.half_width == 0.0:
        held = y
    return State(shown(held, 0.0, p), 0.0, 0.0, x, x, x, held, held)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Nothing to compute before."""
    return Coefficients(h)


@equation
def step(x: State, u: Input, m: Any, p: Parameters, c: Coefficients) -> State:
    """One step: straight lines between samples."""
    y = p.gain * u.u + p.offset
    i = (int(x.place) + 1) % 16384
    m.ring[i] = y
    count = x.steps + 1.0
    late = y
    if p.delay > 0.0:
        late = ago(p.delay / c.h, i, count, x.first, m)
    slow = late
    if p.lag > 0.0:
        z = c.h / p.lag
        e = math.exp(-z)
        slow = e * x.slow + ((1.0 - e) / z - e) * x.late + (1.0 - (1.0 - e) / z) * late
    y = limits(slow, p)
    held = max(y - p.half_width, min(y + p.half_width, x.held))
    if p.half_width == 0.0:
        held = y
    reach = p.rate * c.h
    limited = x.limited + min(max(held - x.limited, -reach), reach)
    return State(shown(limited, count * c.h, p), float(i), count, x.first, late, slow, held, limited)


@equation
def output(x: State, u: Input, m: Any, p: Parameters) -> Output:
    """The state's."""
    return Output(x.y)


BLOCK = Block(
    name="port_effect",
    title="What happens to a signal in a wire",
    module=sys.modules[__name__],
    reads={"u": "line"},
    memory={"ring": Buffer(RING, "Past values of the signal")},
    helpers=(ago,),
)
