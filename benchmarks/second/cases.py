"""Draws what is hidden in a log of the second simulator, and in which form of its law."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.second.machine import Machine
from benchmarks.second.record import COLUMNS, COMMANDS, DEG

NOMINAL = Machine()
TRUSTED = ("K", "w0", "zeta", "K_c", "T", "J", "b")


@dataclass(frozen=True)
class Flaw:
    """An effect as this simulator has it.

    Attributes:
        sizes: parameter -> range of its value; a third entry "+-" gives either sign, "*" a factor on the nominal value.
        forms: other forms of its law: what they set, in SI or as a range.
        names: parameter here -> name in diagnosis.json where they differ.
        sensing: the parameters belong to the sensors.
        tracker: only a tracker's record shows it.
    """

    sizes: dict[str, tuple[Any, ...]]
    forms: tuple[dict[str, Any], ...] = ()
    names: dict[str, str] = field(default_factory=dict)
    sensing: bool = False
    tracker: bool = False


def trusted(name: str) -> Flaw:
    """A trusted parameter off by 8 to 35 %."""
    return Flaw({name: (0.08, 0.35, "*")})


FRICTION = ({"friction": 1, "w_v": (3e-4, 2e-3)}, {"friction": 2, "z_s": (1e-5, 6e-5)})
FLAWS: dict[str, Flaw] = {
    "dead_zone.mismatch": Flaw({"b_r": (0.02, 0.12, "+-"), "b_l": (0.02, 0.12, "+-")}, ({"round_dz": (0.01, 0.04)},)),
    "dcv.gain": trusted("K"),
    "dcv.bandwidth": trusted("w0"),
    "dcv.damping": trusted("zeta"),
    "dcv.delay": Flaw({"tau_d": (0.005, 0.05)}, ({"pade": 1},)),
    "dcv.rate_limit": Flaw({"v_max": (0.006, 0.02)}),
    "dcv.stroke_limit": Flaw(
        {"x_max": (-1.4e-3, -0.6e-3, "+"), "x_min": (0.6e-3, 1.4e-3, "+")}, ({"stop_w": (300.0, 900.0)},)
    ),
    "dcv.hysteresis": Flaw({"play": (0.012, 0.08)}, ({"plays": 5},)),
    "dcv.offset": Flaw({"x_0": (0.03e-3, 0.35e-3, "+-")}),
    "continuity.flow_gain": trusted("K_c"),
    "continuity.flow_asymmetry": Flaw({"a_q": (0.04, 0.25, "+-")}),
    "continuity.leakage": Flaw({"c_l": (0.1, 0.6)}, ({"p_turb": (2e5, 20e5)},)),
    "continuity.compressibility": Flaw({"c_beta": (0.15, 1.2)}, ({"p_air": (3e5, 20e5)},)),
    "continuity.lag_asymmetry": Flaw({"r_T": (1.3, 3.0)}),
    "continuity.supply_sag": Flaw({"k_s": (0.4e9, 3e9), "tau_s": (0.05, 0.4)}, ({"supply": 1}, {"supply": 2})),
    "continuity.cracking_pressure": Flaw({"p_c": (0.3e5, 2.5e5)}, ({"s_c": (0.2, 1.0)},)),
    "mechanical.coulomb_friction": Flaw({"tau_c": (30.0, 250.0)}, FRICTION),
    "mechanical.stribeck_friction": Flaw(
        {"tau_s_friction": (40.0, 160.0), "tau_c": (30.0, 140.0), "omega_s": (0.004, 0.012)},
        (*FRICTION, {"law": 1}, {"law": 2}),
        {"tau_s_friction": "tau_s"},
    ),
    "mechanical.viscous_friction": trusted("b"),
    "mechanical.inertia": trusted("J"),
    "mechanical.gravity_load": Flaw({"tau_g": (30.0, 220.0), "theta_g": (-1.0, 1.0)}),
    "mechanical.backlash": Flaw({"gap": (0.08 * DEG, 0.7 * DEG)}, ({"creep": (0.02, 0.1)},)),
    "mechanical.compliance": Flaw({"mu": (0.12, 0.5), "w_f": (6.0, 18.0), "zeta_f": (0.01, 0.06)}),
    "mechanical.gear_ripple": Flaw({"tau_r": (25.0, 120.0), "n_r": (14.0, 32.0), "phi_r": (-3.0, 3.0)}, ({"triangle": 1},)),
    "sensor.lag": Flaw({"tau_l": (0.02, 0.15)}, ({"lags": 2},)),
    "sensor.gain": Flaw({"gain": (0.015, 0.1, "+-")}, sensing=True),
    "sensor.drift": Flaw({"drift": (0.004 * DEG, 0.06 * DEG, "+-")}, sensing=True),
    "sensor.quantisation": Flaw({"quantum": (0.06 * DEG, 0.3 * DEG)}, ({"down": True},), sensing=True),
    "sensor.dropout": Flaw({"stale": (0.04, 0.4)}, ({"burst": 5.0},), {"stale": "p_drop"}, sensing=True),
    "sensor.bias": Flaw({"bias": (0.1 * DEG, 3.0 * DEG, "+-")}, sensing=True, tracker=True),
    "tracker.clock": Flaw(
        {"offset": (0.03, 1.0, "+-"), "clock": (-5e-4, 5e-4)}, names={"clock": "rate"}, sensing=True, tracker=True
    ),
    "tracker.seam": Flaw({"seam": (0.1 * DEG, 0.8 * DEG, "+-")}, sensing=True, tracker=True),
}  # fmt: skip
LACKING = (  # signals that a log may lack
    (),
    (),
    ("spool",),
    ("p_supply",),
    ("p_a", "p_b", "p_supply"),
    ("spool", "p_supply", "p_a", "p_b"),
)


@dataclass(frozen=True)
class Case:
    """One log, as plain data: effects with their parameters under the names of diagnosis.json, other settings, command."""

    seed: int
    hidden: dict[str, dict[str, float]]
    forms: dict[str, dict[str, float]]
    machine: dict[str, float]
    sensing: dict[str, Any]
    command: str
    amplitude: float
    duration: float


def sized(flaw: Flaw, rng: np.random.Generator) -> dict[str, float]:
    """Values of a flaw's parameters, SI."""
    values = {}
    for name, (low, high, *how) in flaw.sizes.items():
        value = float(rng.uniform(low, high))
        sign = 1.0 if how in ([], ["+"]) or rng.random() < 0.5 else -1.0
        off = getattr(NOMINAL, name, {"gain": 1.0, "clock": 1.0}.get(name, 0.0))
        if how == ["*"]:
            value *= off
        shifted = how or name == "clock"
        values[name] = off + sign * value if shifted else value
    return values


def formed(flaw: Flaw, rng: np.random.Generator) -> dict[str, float]:
    """Half of the time another form of the law: what it sets."""
    if not flaw.forms or rng.random() < 0.5:
        return {}
    form = flaw.forms[int(rng.integers(len(flaw.forms)))]
    return {n: float(rng.uniform(*v)) if isinstance(v, tuple) else v for n, v in form.items()}


def clash(hidden: dict[str, dict[str, float]]) -> bool:
    """True if two effects set one parameter."""
    names = [n for values in hidden.values() for n in values]
    return len(names) > len(set(names))


def setting(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, Any]]:
    """A machine off nominal by what is trusted, somewhere on its way, and the noise and rate of its log."""
    machine = {
        n: getattr(NOMINAL, n) * (1.0 + 0.01 * float(np.clip(rng.normal(), -2.0, 2.0))) for n in TRUSTED
    }
    machine["theta_0"] = float(rng.uniform(-0.2, 0.8))
    sensing: dict[str, Any] = {
        "noise": float(rng.uniform(0.5, 2.0)),
        "colour": float(rng.choice([0.0, rng.uniform(0.01, 0.1)])),
        "rate": int(rng.choice([1000, 1000, 500, 200, 100])),
    }
    return machine, sensing


def draw(seed: int) -> Case:
    """The case of a seed: none, one or two effects, any form, any command, some signals, perhaps a tracker."""
    rng = np.random.default_rng([seed, 2019])
    tracked = rng.random() < 0.3
    names = [n for n, f in FLAWS.items() if tracked or not f.tracker]
    count = int(rng.choice([0, 1, 2], p=[0.15, 0.5, 0.35]))
    while True:
        hidden = {str(n): sized(FLAWS[str(n)], rng) for n in rng.choice(names, count, replace=False)}
        if not clash(hidden):
            break
    forms = {n: formed(FLAWS[n], rng) for n in hidden}
    machine, sensing = setting(rng)
    lacking = LACKING[int(rng.integers(len(LACKING)))]
    sensing["columns"] = tuple(c for c in COLUMNS if c not in lacking)
    if tracked:
        sensing |= {"frames": float(rng.choice([60.0, 80.0, 100.0])), "offset": 0.0}
    for name, values in hidden.items():
        target = sensing if FLAWS[name].sensing else machine
        target |= values | forms[name]
    return Case(
        seed, hidden, forms, machine, sensing, str(rng.choice(COMMANDS)), float(rng.uniform(0.55, 1.0)),
        float(rng.uniform(45.0, 75.0)),
    )  # fmt: skip
