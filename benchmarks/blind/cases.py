"""Draws the cases of the blind suite: what is hidden, how it is excited, and how the sensors err."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.sizes import GROUP_OF, RANGES, SIZES, TRACKED, UNKNOWN, Size
from cosim.rig import EFFECTS, Hidden, Noise
from cosim.rig.excitation import EXCITATIONS
from cosim.rig.parameters import STEP, nominal_value

Array = NDArray[np.float64]

TRUSTED = ("dcv.K", "dcv.w0", "dcv.zeta", "continuity.K_c", "continuity.T", "mechanical.J", "mechanical.b")
TRUST = 0.01  # one standard deviation
NAMED_EXCITATIONS = ("mixed", "mixed", "sweep", "steps", "multisine", "small_steps")
OWN_EXCITATIONS = ("triangle_steps", "telegraph")
# share of each kind of case
KINDS = {
    "single": 0.42,
    "clean": 0.2,
    "unknown": 0.08,
    "left_out": 0.12,
    "pair_across": 0.07,
    "pair_within": 0.07,
    "lugre": 0.02,
    "smooth": 0.02,
    "tracker": 0.05,
}
FORMS = ("lugre", "smooth")  # of friction, other than the one that is sharp
WITH_TRACKER = 0.25  # share of clean logs that come with a tracker's record


@dataclass(frozen=True)
class Case:
    """One case, as plain data.

    Attributes:
        number: of the case in its run.
        kind: "single", "clean", "unknown", "left_out", "pair_across", "pair_within", "lugre", "smooth" or "tracker".
        size: "weak", "moderate", "strong" or "" for clean.
        hidden: effect -> parameter -> value, SI.
        removed: effect that the diagnosis may not consider, or "".
        excitation: name of the excitation, with its `amplitude`.
        duration: s.
        noise: arguments of `cosim.rig.Noise`.
        settings: nominal parameters that are off, SI.
        start: start angle, rad, or None for the rig's choice.
        seed: of the rig.
        tracker: an external tracker's record comes with the log.
    """

    number: int
    kind: str
    size: str
    hidden: dict[str, dict[str, float]]
    removed: str
    excitation: str
    amplitude: float
    duration: float
    noise: dict[str, Any]
    settings: dict[str, float]
    start: float | None
    seed: int
    tracker: bool = False

    def plain(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    def command(self) -> str | Array:
        """The excitation as the rig takes it."""
        return (
            own_command(self.excitation, self.duration, self.amplitude, self.seed)
            if self.excitation in OWN_EXCITATIONS
            else self.excitation
        )

    def recipe(self) -> dict[str, Any]:
        """Arguments of `cosim.rig.make_log`."""
        return {
            "excitation": self.command(),
            "duration": self.duration,
            "hidden": [Hidden(name, values) for name, values in self.hidden.items()],
            "amplitude": self.amplitude,
            "noise": Noise(**self.noise),
            "settings": self.settings,
            "start": self.start,
            "seed": self.seed,
            "friction": self.kind if self.kind in FORMS else "sharp",
            "tracker": self.tracker,
        }


def own_command(name: str, duration: float, amplitude: float, seed: int) -> Array:
    """Commands that the rig does not have: a triangle with steps on it, and a random telegraph; (n,) within +-amplitude."""
    time = np.arange(round(duration / STEP) + 1) * STEP
    rng = np.random.default_rng([seed, 77])
    if name == "triangle_steps":
        slow = EXCITATIONS["triangle"](time, 0.6 * amplitude, seed)
        return np.ascontiguousarray(slow + EXCITATIONS["steps"](time, 0.4 * amplitude, seed))
    u = np.zeros_like(time)
    at, travel = 0.3, 0.0
    while at < duration:
        hold = float(np.clip(rng.exponential(0.8), 0.1, 4.0))
        level = amplitude * float(rng.uniform(0.1, 1.0)) * (1.0 if rng.random() < 0.5 else -1.0)
        # the slew angle stays in the sensor's range: turn back after three units of travel
        level = -abs(level) if travel > 3.0 else abs(level) if travel < -3.0 else level
        u[(time >= at) & (time < at + hold)] = level
        travel, at = travel + level * hold, at + hold
    return u


def settings_for(hidden: dict[str, dict[str, float]], rng: np.random.Generator) -> dict[str, float]:
    """Nominal parameters off by their trust, cut at 2.5 standard deviations, but for those that a hidden effect sets."""
    taken = {f"{name.partition('.')[0]}.{p}" for name, values in hidden.items() for p in values}
    return {
        name: nominal_value(name) * (1.0 + TRUST * float(np.clip(rng.normal(), -2.5, 2.5)))
        for name in TRUSTED
        if name not in taken
    }


def noise_for(rng: np.random.Generator) -> dict[str, Any]:
    """Colour and size of the sensors' noise."""
    kind = str(rng.choice(["white", "ar1", "pink"], p=[0.4, 0.4, 0.2]))
    return {
        "scale": float(rng.uniform(0.5, 2.0)),
        "kind": kind,
        "correlation_time": float(rng.uniform(0.01, 0.1)),
    }


def unknown_parameters(name: str, duration: float, size: Size, rng: np.random.Generator) -> dict[str, float]:
    """Parameters of a cause that no library names: its first one between half and twice the rig's moderate value."""
    factor = {"weak": (0.4, 0.6), "moderate": (0.8, 1.25), "strong": (1.5, 2.0)}[size]
    values = {n.partition(".")[2]: v for n, v in EFFECTS[name].moderate.items()}
    first = next(iter(values))
    values[first] *= float(rng.uniform(*factor))
    if name == "unknown.angle_inertia":
        values[first] = min(values[first], 0.8)
    if name == "unknown.torque_burst":
        values["t_burst"] = float(rng.uniform(0.2, 0.8)) * duration
    return values


def hidden_for(
    kind: str, index: int, size: Size, duration: float, rng: np.random.Generator
) -> dict[str, dict[str, float]]:
    """What is hidden in a case; `index` walks through the effects so that every one comes up equally often."""
    names = list(RANGES)
    if kind == "clean":
        return {}
    if kind == "tracker":
        name = list(TRACKED)[index % len(TRACKED)]
        return {name: TRACKED[name].parameters(name.partition(".")[0], size, rng)}
    if kind == "unknown":
        name = list(UNKNOWN)[index % len(UNKNOWN)]
        return {name: unknown_parameters(name, duration, size, rng)}
    if kind in FORMS:
        names = ["mechanical.coulomb_friction", "mechanical.stribeck_friction"]
    if kind == "left_out":  # a sampling effect leaves a mark of its own kind and not a residual
        names = [n for n in names if n not in ("sensor.quantisation", "sensor.dropout")]
    chosen = [names[index % len(names)]]
    if kind.startswith("pair"):
        chosen = [str(rng.choice(names))]
        others = [
            n
            for n in names
            if n != chosen[0] and (GROUP_OF[n] == GROUP_OF[chosen[0]]) == (kind == "pair_within")
        ]
        chosen.append(str(rng.choice(others)))
    found: dict[str, dict[str, float]] = {}
    for name in chosen:
        component = name.partition(".")[0]
        found[name] = RANGES[name].parameters(component, size, rng)
    clash = {f"{n.partition('.')[0]}.{p}" for n in found for p in found[n]}
    if len(clash) < sum(len(v) for v in found.values()):  # two effects that set the same parameter
        return hidden_for(kind, index, size, duration, rng)
    return found


def cases(count: int, seed: int, duration: float = 60.0) -> Iterator[Case]:
    """`count` cases drawn from `seed`; the first n of a longer run are the same."""
    order = np.random.default_rng([seed, 1])
    kinds, shares = list(KINDS), list(KINDS.values())
    counts = dict.fromkeys(kinds, int(order.integers(0, 1000)))
    for number in range(count):
        rng = np.random.default_rng([seed, 2, number])
        kind = str(order.choice(kinds, p=np.array(shares) / sum(shares)))
        index = counts[kind]
        counts[kind] += 1
        # pairs of weak effects are not asked for: each alone would be near its limit
        size = str(rng.choice(SIZES if kind == "single" else SIZES[1:]))
        hidden = hidden_for(kind, index, size, duration, rng)  # type: ignore[arg-type]
        excitation = str(rng.choice(NAMED_EXCITATIONS + OWN_EXCITATIONS))
        yield Case(
            number=number,
            kind=kind,
            size="" if kind == "clean" else size,
            hidden=hidden,
            removed=next(iter(hidden)) if kind == "left_out" else "",
            excitation=excitation,
            amplitude=float(rng.uniform(0.6, 1.0)),
            duration=duration,
            noise=noise_for(rng),
            settings=settings_for(hidden, rng),
            start=None if rng.random() < 0.5 else float(rng.uniform(0.3, 2.0)),
            seed=int(rng.integers(1, 2**31)),
            tracker=kind == "tracker" or (kind == "clean" and rng.random() < WITH_TRACKER),
        )
