"""What really happened: the parts integrated in fine steps in Python, hidden effects in the wires; no FMU is run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, tanh

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AFTER_NOISE = ("port.quantisation", "port.dropout")
FINE = 5  # steps in a sample


@dataclass(frozen=True)
class Hidden:
    """Something hidden at a connector: ``component.connector``, where, and its size."""

    effect: str
    port: str
    where: str
    values: Mapping[str, float]


class Wire:
    """One effect, step by step."""

    def __init__(self, effect: str, values: Mapping[str, float], h: float) -> None:
        self.effect, self.v, self.h = effect, values, h
        self.state: float | None = None
        self.past: list[float] = []
        self.count = 0

    def __call__(self, x: float) -> float:
        """What comes out at the next step."""
        v, h, effect = self.v, self.h, self.effect
        self.count += 1
        if effect == "port.gain":
            return v["gain"] * x
        if effect == "port.offset":
            return x + v["offset"]
        if effect == "port.delay":
            self.past.append(x)
            at = len(self.past) - 1 - round(v["delay"] / h)
            return self.past[max(at, 0)]
        if effect == "port.lag":
            self.state = x if self.state is None else x + (self.state - x) * exp(-h / v["lag"])
            return self.state
        if effect == "port.saturation":
            return min(max(x, v["low"]), v["high"])
        if effect == "port.dead_zone":
            return x - v["high"] if x > v["high"] else x - v["low"] if x < v["low"] else 0.0
        if effect == "port.play":
            last = 0.0 if self.state is None else self.state
            self.state = max(x - v["half_width"], min(x + v["half_width"], last))
            return self.state
        if effect == "port.rate_limit":
            last = x if self.state is None else self.state
            step = v["rate"] * h
            self.state = last + min(max(x - last, -step), step)
            return self.state
        if effect == "port.quantisation":
            return v["quantum"] * np.floor(x / v["quantum"] + 0.5)
        if effect == "port.drift":
            return x + v["rate"] * h * (self.count - 1)
        # outside the vocabulary
        if effect == "strange.square":
            return x + v["size"] * x * x
        if effect == "strange.product":
            return x * (1.0 + v["size"] * np.sin(v["pace"] * self.count * h))
        if effect == "strange.rectified":
            return abs(x) * v["size"] + x
        if effect == "strange.disturbance":
            return x + v["size"] * np.sin(v["pace"] * self.count * h)
        raise ValueError(effect)


def rate(kind: str, p: Mapping[str, float], x: float, v: float, u: float, u2: float) -> tuple[float, float]:
    """Right-hand side of a part."""
    if kind == "lag":
        return (p["K"] * u - x) / p["T"], 0.0
    if kind == "second":
        return v, p["W"] ** 2 * (p["K"] * u - x) - 2 * p["ZETA"] * p["W"] * v
    if kind == "saturating":
        return (p["K"] * tanh(u / p["C"]) - x) / p["T"], 0.0
    if kind == "damped":
        return (p["K"] * u - x - p["C"] * x**3) / p["T"], 0.0
    if kind == "sum":
        return (p["K"] * u + p["C"] * u2 - x) / p["T"], 0.0
    return v, p["W"] ** 2 * (p["K"] * u - x - p["C"] * x**3) - 2 * p["ZETA"] * p["W"] * v


def simulate(
    kinds: Mapping[str, str],
    values: Mapping[str, Mapping[str, float]],
    wires: Sequence[tuple[str, str]],
    commands: Mapping[str, Array],
    h: float,
    hidden: Sequence[Hidden],
) -> dict[str, Array]:
    """True quantities before any reading: ``component.y`` and the inputs of the system, every h seconds."""
    fine = h / FINE
    count = next(iter(commands.values())).size
    at: dict[tuple[str, str], Callable[[float], float]] = {
        (e.port, e.where): Wire(e.effect, e.values, fine) for e in hidden if e.where in ("input", "output")
    }
    feeds = {end: source for source, end in wires}
    state = dict.fromkeys(kinds, (0.0, 0.0))
    out = {f"{c}.y": at[f"{c}.y", "output"](0.0) if (f"{c}.y", "output") in at else 0.0 for c in kinds}
    found = {name: np.empty(count) for name in out}
    for k in range(count):
        for name, value in out.items():
            found[name][k] = value
        if k == count - 1:
            break
        for i in range(FINE):
            share = i / FINE
            now = dict(out)
            for name, series in commands.items():
                now[name] = (1 - share) * series[k] + share * series[k + 1]
            entering = {}
            for end, source in feeds.items():
                value = now[source]
                effect = at.get((end, "input"))
                entering[end] = effect(value) if effect else value
            for c, kind in kinds.items():
                u, u2 = entering[f"{c}.u"], entering.get(f"{c}.v2", 0.0)
                x, v = state[c]
                a = rate(kind, values[c], x, v, u, u2)
                b = rate(kind, values[c], x + 0.5 * fine * a[0], v + 0.5 * fine * a[1], u, u2)
                state[c] = x + fine * b[0], v + fine * b[1]
            for c in kinds:
                value = state[c][0]
                effect = at.get((f"{c}.y", "output"))
                out[f"{c}.y"] = effect(value) if effect else value
    return {**found, **{n: s.copy() for n, s in commands.items()}}


def read(
    true: Mapping[str, Array], hidden: Sequence[Hidden], h: float, noise: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Readings: effects of sensors, then noise of `noise` times each signal's spread (none on inputs of the system)."""
    found = {}
    for name, series in true.items():
        reading = series
        for e in hidden:
            if e.where == "sensor" and e.port == name and e.effect not in AFTER_NOISE:
                wire = Wire(e.effect, e.values, h)
                reading = np.array([wire(float(x)) for x in reading])
        if "." in name:
            reading = reading + noise * float(np.std(series)) * rng.standard_normal(series.size)
        for e in hidden:
            if e.where == "sensor" and e.port == name and e.effect == "port.dropout":
                stale = rng.random(reading.size) < e.values["probability"]
                stale[0] = False
                reading = reading[np.maximum.accumulate(np.where(stale, 0, np.arange(reading.size)))]
            if e.where == "sensor" and e.port == name and e.effect == "port.quantisation":
                reading = e.values["quantum"] * np.floor(reading / e.values["quantum"] + 0.5)
        found[name] = reading
    return found
