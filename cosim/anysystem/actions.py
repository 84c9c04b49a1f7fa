"""What may be wrong: an effect at a port, or a parameter; and where a search for its size begins."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port
from cosim.system.effects import EFFECTS

Array = NDArray[np.float64]
Where = Literal["input", "output", "sensor", ""]
PARAMETER = "parameter"
LEAST_DELAY = 1.5  # samples: below it a delay is a matter of when a sample was taken
STILL = 1e-9  # of a series' largest value: one that moves by less has one value, but for rounding
BY_LOG = "||"  # between the name of a number and the log that has it by itself
NEXT = -1  # number of a log that nobody has made
NEVER = 0.05  # of the reach beyond the extremes, where a limit does nothing


@dataclass(frozen=True)
class Action:
    """One thing that may be wrong.

    Attributes:
        effect: ``port.gain`` and so on, or ``parameter``.
        port: the connector, or ``component.parameter``.
        where: input, output or sensor; empty for a parameter.
    """

    effect: str
    port: Port
    where: Where = ""

    def key(self, parameter: str) -> str:
        """Name of one of its numbers among a model's values."""
        return f"{self.effect}|{self.port}|{self.where}|{parameter}"

    @property
    def words(self) -> str:
        """For lists: ``port.gain at valve.y (output)``."""
        return (
            f"{self.effect} {self.port}"
            if self.effect == PARAMETER
            else f"{self.effect} at {self.port} ({self.where})"
        )


@dataclass(frozen=True)
class Reach:
    """What a series reaches: half its range, and how fast it moves.

    Attributes:
        low, high: extremes.
        half: half of the range that 98 % of the samples keep.
        pace: half over its typical speed [s].
        h: interval [s].
        length: of the series [s].
        quantiles: of the values at 0.1, 0.25, 0.75, 0.9.
        signed: it goes to both sides of zero.
    """

    low: float
    high: float
    half: float
    pace: float
    h: float
    length: float
    quantiles: tuple[float, ...]
    speeds: tuple[float, ...]

    @property
    def still(self) -> bool:
        """The series has one value."""
        return self.high - self.low <= STILL * max(abs(self.low), abs(self.high))

    @classmethod
    def of(cls, series: Array, h: float) -> "Reach":
        """The reach of a series (n,) every h seconds."""
        low, high = (float(q) for q in np.quantile(series, [0.01, 0.99]))
        most = float(np.abs(series).max())
        half = max(0.5 * (high - low), STILL * max(1.0, most))
        if most > 0.0 and float(np.ptp(series)) <= STILL * most:  # its scale is its value
            half = most
        # over some samples, so that noise is no speed
        far = max(1, series.size // 2000)
        speed = (series[far:] - series[:-far]) / (far * h)
        typical = max(float(np.sqrt(np.mean(speed**2))), half / (series.size * h))
        fast = np.abs(speed)
        speeds = tuple(float(q) for q in np.quantile(fast, [0.6, 0.8, 0.95]))
        return cls(
            float(series.min()),
            float(series.max()),
            half,
            half / typical,
            h,
            series.size * h,
            tuple(float(q) for q in np.quantile(series, [0.1, 0.25, 0.75, 0.9])),
            speeds,
        )


def acts(effect: str, reach: Reach) -> bool:
    """Whether an effect is more than another value of a series that has one: what limits or delays it is no more."""
    return not reach.still or (
        effect in ("port.gain", "port.offset") and max(abs(reach.low), abs(reach.high)) > 0.0
    )


def unknowns(action: Action, reach: Reach) -> list[Unknown]:
    """The numbers of a port effect, with bounds and scales for a signal of this reach."""
    a, margin = reach.half, NEVER * reach.half
    slow = min(0.25 * reach.length, 20.0 * reach.pace)
    table: dict[str, list[tuple[str, float, float, float]]] = {
        "port.gain": [("gain", -10.0, 10.0, 0.3)],
        "port.offset": [("offset", -10.0 * a, 10.0 * a, 0.3 * a)],
        "port.delay": [("delay", 0.0, slow, max(2.0 * reach.h, 0.1 * reach.pace))],
        "port.lag": [("lag", 0.0, slow, max(2.0 * reach.h, 0.1 * reach.pace))],
        "port.saturation": [
            ("low", reach.low - margin, reach.high, 0.3 * a),
            ("high", reach.low, reach.high + margin, 0.3 * a),
        ],
        "port.dead_zone": [
            ("low", min(reach.low, 0.0) - margin, 0.0, 0.2 * a),
            ("high", 0.0, max(reach.high, 0.0) + margin, 0.2 * a),
        ],
        "port.play": [("half_width", 0.0, 1.5 * a, 0.1 * a)],
        "port.rate_limit": [("rate", 1e-3 * a / reach.length, 1e3 * a / reach.pace, 0.3 * a / reach.pace)],
        "port.quantisation": [("quantum", 0.0, 2.0 * a, 0.05 * a)],
        "port.drift": [("rate", -10.0 * a / reach.length, 10.0 * a / reach.length, 0.3 * a / reach.length)],
        "port.dropout": [("probability", 0.0, 0.99, 0.1)],
        "port.friction": [("level", 0.0, 2.0 * a, 0.1 * a)],
    }
    return [Unknown(action.key(n), low, high, scale) for n, low, high, scale in table[action.effect]]


def starts(action: Action, reach: Reach) -> list[dict[str, float]]:
    """Where a search begins, in rising distance from the off value."""
    a, h, pace = reach.half, reach.h, reach.pace
    never_low, never_high = reach.low - NEVER * a, reach.high + NEVER * a
    q10, q25, q75, q90 = reach.quantiles
    times = sorted({max(2.0 * h, part * pace) for part in (0.03, 0.1, 0.3, 1.0)})
    table: dict[str, list[dict[str, float]]] = {
        "port.gain": [{"gain": 0.85}, {"gain": 1.15}, {"gain": -1.0}],
        "port.offset": [{"offset": 0.1 * a}, {"offset": -0.1 * a}],
        "port.delay": [{"delay": t} for t in times],
        "port.lag": [{"lag": t} for t in times],
        "port.saturation": [
            {"low": q10, "high": q90},
            {"low": never_low, "high": q90},
            {"low": q10, "high": never_high},
            {"low": q25, "high": q75},
            {"low": reach.low + 0.08 * a, "high": reach.high - 0.08 * a},
        ],
        "port.dead_zone": [
            {"low": -0.05 * a, "high": 0.05 * a},
            {"low": -0.2 * a, "high": 0.2 * a},
            {"low": 0.0, "high": 0.15 * a},
            {"low": -0.15 * a, "high": 0.0},
        ],
        "port.play": [{"half_width": part * a} for part in (0.03, 0.1, 0.3)],
        "port.rate_limit": [
            {"rate": r}
            for r in sorted(
                {max(s, 1e-3 * a / reach.length) for s in (*reach.speeds, a / (3.0 * pace), 3.0 * a / pace)}
            )
        ],
        "port.quantisation": [{"quantum": part * a} for part in (0.02, 0.05, 0.1, 0.2)],
        "port.drift": [{"rate": 0.1 * a / reach.length}, {"rate": -0.1 * a / reach.length}],
        "port.friction": [{"level": part * a} for part in (0.05, 0.15, 0.4)],
    }
    return [{action.key(n): v for n, v in one.items()} for one in table.get(action.effect, [])]


def sides(action: Action, reach: Reach) -> dict[str, list[float]]:
    """Values of each of two limits at which a search looks with the other one off; nothing for other effects.

    The two act on different samples, so the best of each side together are near the best of both.
    """
    a = reach.half
    q10, q25, q75, q90 = reach.quantiles
    middle = 0.5 * (q25 + q75)
    table: dict[str, dict[str, list[float]]] = {
        "port.saturation": {
            "low": [reach.low + 0.08 * a, q10, q25, middle],
            "high": [reach.high - 0.08 * a, q90, q75, middle],
        },
        "port.dead_zone": {
            "low": [-part * a for part in (0.05, 0.15, 0.35, 0.8)],
            "high": [part * a for part in (0.05, 0.15, 0.35, 0.8)],
        },
    }
    found = table.get(action.effect, {})
    return {action.key(n): values for n, values in found.items()}


def moderate(action: Action, reach: Reach) -> dict[str, float]:
    """A moderate size of an effect at a port, for a signal of this reach; nothing for what a reading shows by itself."""
    found = starts(action, reach)
    if not found:
        return {}
    return found[0 if len(found[0]) > 1 else len(found) // 2]


def off(action: Action, reach: Reach) -> dict[str, float]:
    """Values at which the effect does nothing to a signal of this reach."""
    a = reach.half
    table = {
        "port.gain": {"gain": 1.0},
        "port.saturation": {"low": reach.low - NEVER * a, "high": reach.high + NEVER * a},
        "port.rate_limit": {"rate": 1e3 * a / reach.pace},
    }
    found = table.get(action.effect) or dict.fromkeys(EFFECTS[action.effect].parameters, 0.0)
    return {action.key(n): v for n, v in found.items()}


def part_of(action: Action, reach: Reach, start: Mapping[str, float], part: float) -> dict[str, float]:
    """A part of what a start has of an effect: its numbers from where it begins to act, a limited rate by its inverse."""
    if action.effect == "port.rate_limit":
        return {n: v / part for n, v in start.items()}
    if action.effect == "port.saturation":
        edges = {action.key("low"): reach.low, action.key("high"): reach.high}
    else:
        edges = off(action, reach)
    return {n: edges[n] + part * (v - edges[n]) for n, v in start.items()}


def acted(
    series: Array, h: float, port: Port, where: str, values: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> Array:
    """A series after the effects at one place; `values`: place -> effect -> parameters, as `placed` gives them."""
    here = values.get(f"{port}|{where}")
    if not here:
        return series
    for name, effect in EFFECTS.items():
        if name in here and name != "port.dropout":
            series = effect.act(series, h, here[name])
    return series


def placed(values: Mapping[str, float]) -> dict[str, dict[str, dict[str, float]]]:
    """The values of port effects by place, ``port|where``, and effect."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for key, value in values.items():
        if key.count("|") != 3 or key.startswith(PARAMETER):
            continue
        effect, port, where, parameter = key.split("|")
        found.setdefault(f"{port}|{where}", {}).setdefault(effect, {})[parameter] = value
    return found


def each(name: str, log: int) -> str:
    """Name of a number that one log has by itself."""
    return f"{name}{BY_LOG}{log}"


def of_all(name: str) -> str:
    """Name of the same number of all logs."""
    return name.partition(BY_LOG)[0]


def in_log(values: Mapping[str, float], log: int) -> dict[str, float]:
    """The values that hold in one log: its own where it has some, else those of all logs."""
    found = {n: v for n, v in values.items() if BY_LOG not in n}
    return found | {of_all(n): v for n, v in values.items() if BY_LOG in n and n == each(of_all(n), log)}
