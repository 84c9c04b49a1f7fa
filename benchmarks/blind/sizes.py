"""How large each effect is hidden: ranges from which the sizes are drawn, in SI, weak, moderate and strong.

The ranges are those of the crane's practice (a few per cent to tens of per cent of a nominal value, a part of the greatest
torque of about 470 N m, a part of the stroke of 2.4 mm), chosen before the first run and not changed after it.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from cosim.rig.parameters import nominal_value

Size = Literal["weak", "moderate", "strong"]
SIZES: tuple[Size, ...] = ("weak", "moderate", "strong")
DEG = math.pi / 180.0


@dataclass(frozen=True)
class Drawn:
    """How one parameter is drawn.

    Attributes:
        weak, moderate, strong: range of its distance from the value at which the effect is off, SI or relative to it.
        relative: the ranges are relative to the nominal value.
        signs: signs that the distance may have.
    """

    weak: tuple[float, float]
    moderate: tuple[float, float]
    strong: tuple[float, float]
    relative: bool = False
    signs: tuple[float, ...] = (1.0,)

    def value(self, name: str, size: Size, rng: np.random.Generator) -> float:
        """A value of ``component.parameter``, SI."""
        nominal = nominal_value(name)
        unit = abs(nominal) if self.relative else 1.0
        return nominal + float(rng.choice(self.signs)) * unit * float(rng.uniform(*getattr(self, size)))


@dataclass(frozen=True)
class Ranges:
    """How an effect is drawn.

    Attributes:
        sized: parameters that set the size.
        within: the others: range from which they are drawn at every size, SI.
    """

    sized: dict[str, Drawn]
    within: dict[str, tuple[float, float]] = field(default_factory=dict)

    def parameters(self, component: str, size: Size, rng: np.random.Generator) -> dict[str, float]:
        """Parameter -> value, SI."""
        values = {n: d.value(f"{component}.{n}", size, rng) for n, d in self.sized.items()}
        return values | {n: float(rng.uniform(*r)) for n, r in self.within.items()}


def nominal(signs: tuple[float, ...] = (1.0, -1.0)) -> Drawn:
    """A nominal parameter off by more than its trust."""
    return Drawn((0.045, 0.06), (0.08, 0.15), (0.2, 0.4), relative=True, signs=signs)


BOTH = (1.0, -1.0)
# a stop is drawn as its distance from the nominal stop, a rate limit as its distance from "out of reach"
RANGES: dict[str, Ranges] = {
    "dead_zone.mismatch": Ranges(
        {
            "b_r": Drawn((0.005, 0.01), (0.02, 0.06), (0.08, 0.15), signs=BOTH),
            "b_l": Drawn((0.005, 0.01), (0.02, 0.06), (0.08, 0.15), signs=BOTH),
        }
    ),
    "dcv.gain": Ranges({"K": nominal()}),
    "dcv.bandwidth": Ranges({"w0": nominal()}),
    "dcv.damping": Ranges({"zeta": nominal()}),
    "dcv.amplitude_damping": Ranges(
        {"c_a": Drawn((0.2, 0.4), (0.7, 1.5), (2.0, 4.0))}, {"u_a": (0.12, 0.34)}
    ),
    "dcv.delay": Ranges({"tau_d": Drawn((0.001, 0.003), (0.008, 0.025), (0.03, 0.06))}),
    "dcv.rate_limit": Ranges({"v_max": Drawn((0.975, 0.98), (0.983, 0.99), (0.992, 0.996), signs=(-1.0,))}),
    "dcv.stroke_limit": Ranges(
        {
            "x_max": Drawn((0.4e-3, 0.6e-3), (0.7e-3, 1.1e-3), (1.2e-3, 1.7e-3), signs=(-1.0,)),
            "x_min": Drawn((0.4e-3, 0.6e-3), (0.7e-3, 1.1e-3), (1.2e-3, 1.7e-3)),
        }
    ),
    "dcv.hysteresis": Ranges({"play": Drawn((0.004, 0.01), (0.015, 0.04), (0.06, 0.1))}),
    "dcv.offset": Ranges(
        {"x_0": Drawn((0.005e-3, 0.015e-3), (0.04e-3, 0.12e-3), (0.2e-3, 0.4e-3), signs=BOTH)}
    ),
    "continuity.flow_gain": Ranges({"K_c": nominal()}),
    "continuity.flow_asymmetry": Ranges({"a_q": Drawn((0.01, 0.02), (0.05, 0.12), (0.18, 0.3), signs=BOTH)}),
    "continuity.leakage": Ranges({"c_l": Drawn((0.05, 0.08), (0.12, 0.25), (0.35, 0.7))}),
    "continuity.compressibility": Ranges({"c_beta": Drawn((0.05, 0.1), (0.2, 0.5), (0.7, 1.5))}),
    "continuity.lag_asymmetry": Ranges({"r_T": Drawn((0.08, 0.15), (0.3, 0.7), (1.0, 2.0))}),
    "continuity.supply_sag": Ranges(
        {"k_s": Drawn((0.05e9, 0.15e9), (0.5e9, 1.5e9), (2e9, 3.5e9))}, {"tau_s": (0.05, 0.4)}
    ),
    "continuity.cracking_pressure": Ranges({"p_c": Drawn((0.1e5, 0.2e5), (0.5e5, 1.3e5), (1.8e5, 3e5))}),
    # the source's own supply of 170 bar is 5.9e-8: a moderate size
    "continuity.flow_pressure": Ranges({"c_q": Drawn((1.2e-8, 2e-8), (4e-8, 8e-8), (1.2e-7, 2.5e-7))}),
    "mechanical.coulomb_friction": Ranges({"tau_c": Drawn((8.0, 20.0), (50.0, 130.0), (180.0, 280.0))}),
    "mechanical.stribeck_friction": Ranges(
        {
            "tau_s": Drawn((20.0, 35.0), (50.0, 110.0), (130.0, 180.0)),
            "tau_c": Drawn((20.0, 40.0), (50.0, 100.0), (100.0, 150.0)),
        },
        {"omega_s": (0.004, 0.012)},
    ),
    "mechanical.viscous_friction": Ranges({"b": nominal()}),
    "mechanical.inertia": Ranges({"J": nominal()}),
    "mechanical.gravity_load": Ranges(
        {"tau_g": Drawn((5.0, 15.0), (50.0, 130.0), (180.0, 260.0), signs=BOTH)}, {"theta_g": (-1.0, 1.0)}
    ),
    "mechanical.backlash": Ranges(
        {"gap": Drawn((0.03 * DEG, 0.06 * DEG), (0.12 * DEG, 0.3 * DEG), (0.4 * DEG, 0.9 * DEG))}
    ),
    "mechanical.compliance": Ranges(
        {"mu": Drawn((0.05, 0.1), (0.2, 0.35), (0.4, 0.6))}, {"w_f": (6.0, 20.0), "zeta_f": (0.01, 0.06)}
    ),
    "mechanical.gear_ripple": Ranges(
        {"tau_r": Drawn((8.0, 15.0), (35.0, 70.0), (90.0, 140.0))},
        {"n_r": (14.0, 32.0), "phi_r": (-3.0, 3.0)},
    ),
    "sensor.gain": Ranges({"gain": Drawn((0.006, 0.012), (0.02, 0.05), (0.07, 0.12), signs=BOTH)}),
    "sensor.drift": Ranges(
        {
            "drift": Drawn(
                (0.001 * DEG, 0.003 * DEG), (0.006 * DEG, 0.02 * DEG), (0.03 * DEG, 0.08 * DEG), signs=BOTH
            )
        }
    ),
    "sensor.quantisation": Ranges(
        {"quantum": Drawn((0.03 * DEG, 0.05 * DEG), (0.08 * DEG, 0.15 * DEG), (0.2 * DEG, 0.4 * DEG))}
    ),
    "sensor.lag": Ranges({"tau_l": Drawn((0.004, 0.01), (0.03, 0.07), (0.1, 0.2))}),
    "sensor.dropout": Ranges({"p_drop": Drawn((0.01, 0.02), (0.05, 0.15), (0.25, 0.5))}),
}

# what only an external tracker shows; its clock is drawn as the true time at its zero
TRACKED: dict[str, Ranges] = {
    "tracker.clock": Ranges(
        {"offset": Drawn((0.01, 0.03), (0.05, 0.3), (0.5, 1.5), signs=BOTH)}, {"rate": (0.9995, 1.0005)}
    ),
    "tracker.seam": Ranges(
        {"seam": Drawn((0.05 * DEG, 0.1 * DEG), (0.15 * DEG, 0.4 * DEG), (0.6 * DEG, 1.0 * DEG), signs=BOTH)}
    ),
    "sensor.bias": Ranges(
        {"bias": Drawn((0.05 * DEG, 0.1 * DEG), (0.2 * DEG, 1.0 * DEG), (1.5 * DEG, 4.0 * DEG), signs=BOTH)}
    ),
    "sensor.gain": RANGES["sensor.gain"],
    "sensor.drift": RANGES["sensor.drift"],
}

# causes that the library does not have (docs/rig.md): size relative to the rig's moderate one
UNKNOWN: dict[str, str] = {
    "unknown.quadratic_drag": "mechanical",
    "unknown.warming_valve": "dcv",
    "unknown.torque_burst": "mechanical",
    "unknown.pressure_friction": "mechanical",
    "unknown.angle_inertia": "mechanical",
}
GROUP_OF: dict[str, str] = {
    name: "mechanical"
    if name.startswith(("sensor.", "mechanical.")) or name == "continuity.cracking_pressure"
    else "continuity"
    if name.startswith("continuity.")
    else "dcv"
    for name in RANGES
}
