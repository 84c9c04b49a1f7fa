"""What can happen at a port of any component: a signal goes in, another comes out.

Each effect is one entry of `EFFECTS`: its parameters with their off values, and its action on a whole series. None of
them knows what is inside a component.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Kind = Literal["1", "signal", "s", "signal/s"]
"""Unit of a parameter: none, the signal's, seconds, the signal's per second."""
STALE = 2147483647.0


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Attributes:
        kind: its unit.
        off: value at which the effect does nothing, in terms of what the signal reaches where `per_reach`.
        low, high: bounds, in the same terms.
        text: what it is.
    """

    kind: Kind
    off: float
    low: float
    high: float
    text: str


@dataclass(frozen=True)
class PortEffect:
    """An effect at a port.

    Attributes:
        name: as in the contract, such as ``port.delay``.
        parameters: by name, in order.
        act: (signal (n,), interval s, values) -> signal (n,).
        reading: it can happen to a reading only.
        looped: it depends on what the component then does, and is run in a loop with it: `act` leaves a series as it is.
        text: one line for people.
    """

    name: str
    parameters: dict[str, EffectParameter]
    act: Callable[[Array, float, Mapping[str, float]], Array]
    text: str
    reading: bool = False
    looped: bool = False

    def unit(self, parameter: str, of_signal: str) -> str:
        """Unit of a parameter where the signal has this one."""
        kind = self.parameters[parameter].kind
        signal = of_signal or "1"
        return {"1": "1", "s": "s", "signal": signal, "signal/s": f"{signal}/s" if signal != "1" else "1/s"}[
            kind
        ]


def gain(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Scaled: y = gain x."""
    return v["gain"] * x


def offset(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Shifted: y = x + offset."""
    return x + v["offset"]


def delay(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Late: y(t) = x(t - delay), straight lines between samples; the first value before that."""
    if v["delay"] == 0.0:
        return x
    k = np.arange(x.size, dtype=np.float64)
    return np.interp(k - v["delay"] / h, k, x)


def lag(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """T y' + y = x from the first value on, exact for straight lines between samples."""
    return _lag(np.ascontiguousarray(x), h, max(v["lag"], 0.0))


def saturation(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Limited to low..high."""
    return np.clip(x, min(v["low"], v["high"]), max(v["low"], v["high"]))


def dead_zone(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Zero between low and high, slope 1 outside."""
    return np.maximum(x - max(v["high"], 0.0), 0.0) + np.minimum(x - min(v["low"], 0.0), 0.0)


def play(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Follows once the input has moved by the half-width."""
    return _play(np.ascontiguousarray(x), max(v["half_width"], 0.0))


def rate_limit(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Speed limited."""
    return _rate_limit(np.ascontiguousarray(x), h * max(v["rate"], 1e-300))


def quantisation(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Rounded to a multiple of the quantum."""
    quantum = v["quantum"]
    return quantum * np.floor(x / quantum + 0.5) if quantum > 0.0 else x


def drift(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """A ramp from the first sample on."""
    return x + v["rate"] * h * np.arange(x.size)


def dropout(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """The last reading once more, with a probability; the generator is that of our sensor's dropout."""
    return _dropout(np.ascontiguousarray(x), v["probability"])


def friction(x: Array, h: float, v: Mapping[str, float]) -> Array:
    """Less what rubs against the motion that follows (`fmus.port_friction`), of which a series alone knows nothing."""
    return x


@numba.njit(cache=True)
def _lag(x: Array, h: float, constant: float) -> Array:
    y = np.empty_like(x)
    y[0] = x[0]
    if constant <= 1e-9 * h:
        return x.copy()
    z = h / constant
    e = np.exp(-z)
    # weights of the two ends of a straight line
    late = 1.0 - (1.0 - e) / z
    early = (1.0 - e) / z - e
    for k in range(1, x.size):
        y[k] = e * y[k - 1] + early * x[k - 1] + late * x[k]
    return y


@numba.njit(cache=True)
def _play(x: Array, half: float) -> Array:
    y = np.empty_like(x)
    last = min(max(0.0, x[0] - half), x[0] + half)
    for k in range(x.size):
        last = max(x[k] - half, min(x[k] + half, last))
        y[k] = last
    return y


@numba.njit(cache=True)
def _rate_limit(x: Array, step: float) -> Array:
    y = np.empty_like(x)
    last = x[0]
    for k in range(x.size):
        last += min(max(x[k] - last, -step), step)
        y[k] = last
    return y


@numba.njit(cache=True)
def _dropout(x: Array, probability: float) -> Array:
    y = np.empty_like(x)
    seed, held = 20190515.0, x[0]
    for k in range(x.size):
        if not seed < STALE * probability:
            held = x[k]
        y[k] = held
        seed = (16807.0 * seed) % STALE
    return y


_FAR = 1e12


def _one(kind: Kind, off: float, low: float, high: float, text: str) -> EffectParameter:
    return EffectParameter(kind, off, low, high, text)


EFFECTS: dict[str, PortEffect] = {
    effect.name: effect
    for effect in (
        PortEffect("port.gain", {"gain": _one("1", 1.0, -20.0, 20.0, "factor")}, gain, "scaled"),
        PortEffect("port.offset", {"offset": _one("signal", 0.0, -_FAR, _FAR, "added")}, offset, "shifted"),
        PortEffect("port.delay", {"delay": _one("s", 0.0, 0.0, _FAR, "transport delay")}, delay, "late"),
        PortEffect("port.lag", {"lag": _one("s", 0.0, 0.0, _FAR, "time constant")}, lag, "lagging"),
        PortEffect(
            "port.saturation",
            {
                "low": _one("signal", -_FAR, -_FAR, _FAR, "lowest value"),
                "high": _one("signal", _FAR, -_FAR, _FAR, "highest value"),
            },
            saturation,
            "limited",
        ),
        PortEffect(
            "port.dead_zone",
            {
                "low": _one("signal", 0.0, -_FAR, 0.0, "lower end"),
                "high": _one("signal", 0.0, 0.0, _FAR, "upper end"),
            },
            dead_zone,
            "zero where small",
        ),
        PortEffect(
            "port.play",
            {"half_width": _one("signal", 0.0, 0.0, _FAR, "half of the width")},
            play,
            "with play",
        ),
        PortEffect(
            "port.rate_limit",
            {"rate": _one("signal/s", _FAR, 0.0, _FAR, "highest speed")},
            rate_limit,
            "limited in speed",
        ),
        PortEffect(
            "port.quantisation",
            {"quantum": _one("signal", 0.0, 0.0, _FAR, "step of the reading")},
            quantisation,
            "in steps",
            reading=True,
        ),
        PortEffect(
            "port.dropout",
            {"probability": _one("1", 0.0, 0.0, 0.99, "probability that a sample is stale")},
            dropout,
            "stale samples",
            reading=True,
        ),
        PortEffect(
            "port.drift",
            {"rate": _one("signal/s", 0.0, -_FAR, _FAR, "speed of the ramp")},
            drift,
            "a ramp",
            reading=True,
        ),
        PortEffect(
            "port.friction",
            {"level": _one("signal", 0.0, 0.0, _FAR, "dry friction")},
            friction,
            "less dry friction",
            looped=True,
        ),
    )
}
"""Every effect by name, in the order in which ties are named."""
