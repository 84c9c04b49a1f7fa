"""The parameters of a machine's blocks: as stated, as its log tells, or such that an unknown block does nothing."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.logs import Log
from cosim.machines.rough import FirstOrder, brought_back, first_order, reach, stays_with
from cosim.machines.table import MOVING, UNKNOWN, MachineTable, block_of

Array = NDArray[np.float64]

# what blocks are set to of which nothing is said: no dead zone, a valve and an oil column faster than most logs show (and
# faster than that where this one would show them: `unnoticed`), and full command = 1 mm of spool = 1 bar = 1 N m, because
# between two measured signals only the product of gains shows
NEUTRAL: dict[str, dict[str, float]] = {
    "dead_zone": {"form": 1.0, "m_r": 1.0, "b_r": 0.0, "m_l": 1.0, "b_l": 0.0, "limit": 10.0},
    "compensator": {"form": 3.0, "d_plus": 0.0, "d_minus": 0.0, "limit": 10.0},
    "dcv": {"K": 1e-3, "w0": 200.0, "zeta": 1.0, "x_min": -1e-2, "x_max": 1e-2},
    "continuity": {"K_c": 1e8, "T": 5e-3},
    "mechanical": {"A": 1e-4, "r": 0.1},
    "sensor": {"gain": 1.0},
}
UNSEEN = 0.1  # of the machine's lag: what blocks of which nothing is said may add to it
SHORT = 1e-2  # mm, way of such a spool at full command where the file states the motion: its fastest, 1 m/s, shows nowhere
EXACT = 1e-3  # of a lag that the file states, well within the percent to which it is then trusted
TOLD = 2.0  # intervals between samples: rough numbers come out at one of them where a log tells no lag
ZETA = 0.8  # damping taken for a valve whose natural frequency only the log tells
SHOWN = {"dcv": "spool", "continuity": "p_load"}  # block -> its signal, where it is measured
LINEAR = (
    "dcv.K", "dcv.w0", "dcv.zeta", "continuity.K_c", "continuity.T", "mechanical.J", "mechanical.b", "simplified.k",
    "simplified.a",
)  # fmt: skip
SIGN_SHOWN = (
    0.25  # of the variance that a first order explains: what rings more than it follows has no sign yet
)
FAR = 0.5  # of the farthest way of several logs: what goes as far tells a machine
SLOWEST, FASTEST = 1e-4, 1e3  # s, bounds of a lag that a parameter can take


@dataclass
class Numbers:
    """The parameters of a machine.

    Attributes:
        values: ``component.parameter`` -> SI.
        from_log: those that the log told, or must tell.
        speed: of the motion at a drive of 1, SI; 0 where nothing moves.
        lag: of the whole chain, s.
    """

    values: dict[str, float]
    from_log: list[str] = field(default_factory=list)
    speed: float = 0.0
    lag: float = 0.0


def inner_signals(table: MachineTable, signals: Mapping[str, str]) -> dict[str, str]:
    """Component of the chain -> the signal that measures its output, the machine's output among them.

    Args:
        table: the machine.
        signals: signal -> ``component.variable``, for those that a mapping names.
    """
    found = {table.chain[-1]: table.output}
    moving = [c for c in table.chain if c in MOVING]
    if moving:
        found[moving[-1]] = table.output
    for component, name in SHOWN.items():
        if component in table.chain and component != table.chain[-1]:
            named = next((s for s, v in signals.items() if v == f"{component}.{name}"), None)
            if named is not None:
                found[component] = named
    return found


def unknown(table: MachineTable, inner: Mapping[str, str]) -> list[str]:
    """``component.parameter`` that only a log can tell."""
    listed = [n for n, v in table.parameters.items() if v == UNKNOWN]
    for component, gain in (("dcv", "K"), ("continuity", "K_c")):
        name = f"{component}.{gain}"
        if component in inner and component in table.chain and name not in table.parameters:
            own = [n for n in table.parameters if n.startswith(f"{component}.")]
            # the gain of two blocks in one shows in one of them only
            if not own or component == "dcv":
                listed.append(name)
            # a pressure that was measured shows its lag as well as its gain
            if not own and component == "continuity":
                listed.append("continuity.T")
    pair = (
        ("mechanical.J", "mechanical.b") if "mechanical" in table.chain else ("simplified.k", "simplified.a")
    )
    if table.moves and not (table.motion_quantity("speed", "rad/s") and table.motion_quantity("lag", "s")):
        listed += [n for n in pair if n not in table.parameters]
    return list(dict.fromkeys(listed))


def numbers(
    table: MachineTable,
    inner: Mapping[str, str],
    gains: Mapping[str, float],
    logs: Sequence[Log],
    sample: float = 1.0,
    rates: Collection[str] = (),
) -> Numbers:
    """All parameters of the chain that are not as their blocks declare them.

    Args:
        table: the machine.
        inner: component -> the signal that measures its output.
        gains: signal -> the variable per signal, SI.
        logs: logs of the machine.
        sample: what one unit of the logs' time counts as, s.
        rates: signals that show a speed; another motion is an angle or a position.

    Raises:
        UsageError: something is unknown, and there is no log to tell it.
        DataError: the logs do not tell it.
    """
    stated = {n: v for n in table.parameters if (v := table.value(n)) is not None}
    values: dict[str, float] = {}
    for component in table.chain:
        values |= {f"{component}.{n}": v for n, v in NEUTRAL.get(component, {}).items()}
    if table.forced:
        values |= {"mechanical.A": 1.0, "mechanical.r": 1.0}
    values |= stated
    asked = unknown(table, inner)
    if table.commanded and logs:
        far = max(float(np.max(np.abs(log.require(table.input)))) for log in logs)
        own = not {"dcv.K", "continuity.K_c"} & stated.keys() and not {"dcv", "continuity"} & inner.keys()
        far *= abs(gains.get(table.input, 1.0))
        if not asked or far > NEUTRAL["dead_zone"]["limit"]:
            within_reach(values, far, (1.0 if asked else SHORT) if own else None)
    if asked and not logs:
        raise UsageError(
            f"{' and '.join(asked)} must be told by a log of the machine: give one (cosim machine --log LOG, "
            "or --input LOG), or state them in [machine]"
        )
    found = Numbers(values, asked)
    drive, before = table.input, []
    for component in table.chain:
        before.append(component)
        if component in inner and logs and all(inner[component] in log for log in logs):
            told(
                found,
                table,
                before,
                (drive, inner[component]),
                gains,
                logs,
                sample,
                inner[component] in rates,
            )
            drive, before = inner[component], []
    if table.moves:
        moved(found, table, stated)
        interval = min((float(np.median(np.diff(log.time))) * sample for log in logs), default=0.0)
        unnoticed(found, stated, interval, table.output in rates)
    missing = [n for n in asked if n not in values]
    if missing and logs:
        raise DataError(
            f"{sources(logs)}: it does not tell {' and '.join(missing)}: state them in [machine.parameters]"
        )
    return found


def within_reach(values: dict[str, float], command: float, travel: float | None) -> None:
    """Keep the limits of blocks of which nothing is said beyond a command that goes far past 1, as one in volts does.

    Args:
        values: the parameters; the neutral ones are changed.
        command: how far it goes.
        travel: of a spool that is neither measured nor stated, mm at the largest command: so its fastest, 1 m/s, stays out
            of reach; None for a spool of which something is known.
    """
    command = max(command, 1.0)
    limits = {n: command * values[n] for n in ("dead_zone.limit", "compensator.limit") if n in values}
    if travel is not None and {"dcv.K", "continuity.K_c"} <= values.keys():
        both = values["dcv.K"] * values["continuity.K_c"]  # all that shows
        values["dcv.K"] = within("dcv.K", values["dcv.K"] * travel / command)
        values["continuity.K_c"] = within("continuity.K_c", both / values["dcv.K"])
    for name, value in limits.items():
        values[name] = within(name, value)


def within(name: str, value: float) -> float:
    """A value of ``component.parameter`` within its bounds."""
    component, _, parameter = name.partition(".")
    variable = block_of(component).parameters[parameter]
    return float(np.clip(value, variable.low, variable.high))


def sources(logs: Sequence[Log]) -> str:
    """Where logs are from."""
    return ", ".join(str(log.source) for log in logs)


def unnoticed(found: Numbers, stated: Collection[str], interval: float, rate: bool) -> None:
    """Make valve and oil of which nothing is said so fast that a log does not show them beside the machine's own lag.

    Where the file states the motion in full, its simulation is that and no more: they are next to nothing.

    A motor of 7 ms sampled at 2 kHz shows the 15 ms of the neutral valve and oil, which would stand for its own dynamics. So
    does a valve of 60 ms sampled every 20 ms whose flow is measured: in a speed or flow a lag shorter than an interval shows
    as well, while in a place it is a shift by less than one sample's way.

    Args:
        found: the parameters.
        stated: those that the machine's file states.
        interval: between two samples, s.
        rate: the machine's output is a speed or a flow.
    """
    values, known = found.values, {*stated, *found.from_log}
    lags = {}
    if {"dcv.w0", "dcv.zeta"} <= values.keys() and not {"dcv.w0", "dcv.zeta"} & known:
        lags["dcv.w0"] = 2.0 * values["dcv.zeta"] / values["dcv.w0"]
    if "continuity.T" in values and "continuity.T" not in known:
        lags["continuity.T"] = values["continuity.T"]
    least = UNSEEN * found.lag
    if not found.from_log:
        least = EXACT * found.lag
    elif not rate or found.lag <= TOLD * interval:
        least = max(least, interval)
    if not lags or found.lag == 0.0 or sum(lags.values()) <= least:
        return
    faster = sum(lags.values()) / least
    for name in lags:
        value = values[name] * faster if name == "dcv.w0" else values[name] / faster
        put(found, {name: value}, always=True)


def told(
    found: Numbers,
    table: MachineTable,
    blocks: list[str],
    ends: tuple[str, str],
    gains: Mapping[str, float],
    logs: Sequence[Log],
    sample: float,
    rate: bool,
) -> None:
    """Gain and lag of the blocks between two signals, put where they are unknown.

    Raises:
        DataError: one of the two does not move.
    """
    drive, seen = ends
    moving = any(b in MOVING for b in blocks)
    asked = [n for n in found.from_log if n.partition(".")[0] in blocks]
    if not asked and not (moving and found.speed == 0.0):
        return
    pairs = [(log.time * sample, *(log.require(n) * gains.get(n, 1.0) for n in ends)) for log in logs]
    if table.forced and "mechanical" in blocks and not rate:
        back = next((swing for one in pairs if (swing := brought_back(*one)) is not None), None)
        if back is not None:
            put(found, {"mechanical.b": back.damping, "mechanical.J": back.mass})
            found.lag += back.mass / back.damping
            found.speed = 1.0 / back.damping
            return
    rough = plainest(pairs, integrates=moving and not rate)
    if rough.gain == 0.0 and not asked:
        return
    if rough.gain == 0.0:
        raise DataError(
            f"{sources(logs)}: '{drive}' or '{seen}' does not move, so {' and '.join(asked)} cannot be told from it"
        )
    if rough.gain < 0.0 and rough.share > SIGN_SHOWN:
        if moving and not rate and any(stays_with(*one) for one in pairs):
            raise DataError(
                f"{sources(logs)}: '{seen}' follows '{drive}' itself and stays with it: if '{drive}' is a demanded place, "
                "say command = \"place\" in [machine], and leave 'sensor' out of its chain"
            )
        raise DataError(
            f"{sources(logs)}: '{seen}' goes against '{drive}' (gain {rough.gain:.3g}): give one of them sign = -1 in "
            "[signals]"
        )
    gain = abs(rough.gain)
    values, lag = found.values, float(np.clip(rough.lag, SLOWEST, FASTEST))
    ahead = forward(values, blocks)
    if "simplified" in blocks:
        put(found, {"simplified.a": 1.0 / lag, "simplified.k": gain / lag})
    elif "mechanical" in blocks:
        b = values.get("mechanical.b", ahead / gain)
        put(found, {"mechanical.b": b, "mechanical.J": b * lag})
    elif "continuity" in blocks:
        both = "dcv.w0" in asked
        valve = values["dcv.K"] if "dcv" in blocks else 1.0
        put(found, {"continuity.K_c": gain / valve, "continuity.T": 0.5 * lag if both else lag})
        put(found, {"dcv.w0": 4.0 * ZETA / lag, "dcv.zeta": ZETA, "dcv.K": values.get("dcv.K", 1e-3)})
    elif "dcv" in blocks:
        put(found, {"dcv.K": gain, "dcv.w0": 2.0 * ZETA / lag, "dcv.zeta": ZETA})
        values |= {
            "dcv.x_min": -min(10.0 * values["dcv.K"], 1.0),
            "dcv.x_max": min(10.0 * values["dcv.K"], 1.0),
        }
    found.lag += lag
    if moving:
        b = values.get("mechanical.b", 0.0)
        # a mass without friction has no speed of its own
        found.speed = 1.0 / b if table.forced and b > 0.0 else gain


def plainest(logs: Sequence[tuple[Array, ...]], *, integrates: bool) -> FirstOrder:
    """Of several logs what the one says that a dead zone or friction bends least.

    Both take from a motion and none adds to it: of the logs that go half as far as the farthest, the fastest for its drive.

    Args:
        logs: times, what drives, what answers, each (n,).
        integrates: as `first_order`.
    """
    ways = [reach(answered) for _, _, answered in logs]
    far = [log for log, way in zip(logs, ways, strict=True) if way >= FAR * max(ways)]
    return max((first_order(*log, integrates=integrates) for log in far), key=lambda found: abs(found.gain))


def put(found: Numbers, told_now: Mapping[str, float], always: bool = False) -> None:
    """Take over what the log tells of unknown parameters (or `always`), within their bounds."""
    for name, value in told_now.items():
        if always or name in found.from_log:
            found.values[name] = float(f"{within(name, value):.4g}")


def forward(values: Mapping[str, float], blocks: list[str]) -> float:
    """Torque, N m, per unit of what drives these blocks."""
    found = 1.0
    for name in ("dcv.K", "continuity.K_c", "mechanical.A", "mechanical.r"):
        if name.partition(".")[0] in blocks:
            found *= values.get(name, 1.0)
    return found


def moved(found: Numbers, table: MachineTable, stated: Mapping[str, float]) -> None:
    """Put a stated speed and lag where the chain has them."""
    speed, lag = table.motion_quantity("speed", "rad/s"), table.motion_quantity("lag", "s")
    values = found.values
    if speed is not None:
        if "simplified" in table.chain and "simplified.k" not in stated:
            pole = values.get("simplified.a", 1.0 / (lag or 1.0))
            values["simplified.a"] = 1.0 / lag if lag else pole
            values["simplified.k"] = speed * values["simplified.a"]
        elif "mechanical.b" not in stated and "mechanical" in table.chain:
            old = values.get("mechanical.b")
            values["mechanical.b"] = forward(values, list(table.chain)) / speed
            if old is not None and "mechanical.J" in values and "mechanical.J" not in stated:
                values["mechanical.J"] *= values["mechanical.b"] / old
        found.speed = speed
    if lag is not None:
        if "mechanical.b" in values and "mechanical.J" not in stated:
            values["mechanical.J"] = lag * values["mechanical.b"]
        elif "simplified" in table.chain and "simplified.a" not in stated:
            values["simplified.k"] = values["simplified.k"] / values["simplified.a"] / lag
            values["simplified.a"] = 1.0 / lag
        found.lag = lag
    if found.speed == 0.0 and values.get("mechanical.b"):
        found.speed = forward(values, list(table.chain)) / values["mechanical.b"]
    if found.speed == 0.0 and values.get("simplified.a"):
        found.speed = values["simplified.k"] / values["simplified.a"]
