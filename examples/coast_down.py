"""Which friction stops a wheel? Hypotheses for a model that is a plain Python function (docs/inference.md).

``python examples/coast_down.py`` prints what 20 s of a record say of them, and what 60 s do.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cosim.inference.hypotheses import Hypothesis, Judgement, judged, problem_of
from cosim.inference.unknowns import Unknown

Array = NDArray[np.float64]
Series = dict[str, Array]

INTERVAL, NOISE, STEP = 0.02, 0.2, 1e-3  # s; rad/s: noise and steps of the tachometer

# name, bounds, and what a typical change is, in which the search moves; all per unit of inertia
START = Unknown("start", 0.0, 200.0, 1.0)  # rad/s
VISCOUS = Unknown("viscous", 0.0, 1.0, 0.01)  # 1/s
DRY = Unknown("dry", 0.0, 10.0, 0.1)  # rad/s2
AIR = Unknown("air", 0.0, 1000.0, 1.0)  # 1e-4/rad


def wheel(seconds: float) -> Callable[[Mapping[str, float]], Series]:
    """The model: values -> speed of a wheel that coasts down, dw/dt = -viscous w - dry - 1e-4 air w^2, until it rests."""
    time = np.arange(round(seconds / INTERVAL)) * INTERVAL

    def simulate(values: Mapping[str, float]) -> Series:
        viscous, dry, air = (values.get(name, 0.0) for name in ("viscous", "dry", "air"))

        def slope(_: float, w: Array) -> Array:
            return np.where(w > 0.0, -viscous * w - dry - 1e-4 * air * w**2, 0.0)

        found = solve_ivp(slope, (0.0, time[-1]), [values["start"]], t_eval=time, rtol=1e-8, atol=1e-8)
        return {"speed": np.maximum(found.y[0], 0.0)}

    return simulate


def measured(seconds: float, seed: int = 7) -> Series:
    """A synthetic record: dry friction and drag of the air, read by a tachometer with noise and steps."""
    true = wheel(seconds)({"start": 60.0, "dry": 0.4, "air": 2.0})["speed"]
    read = true + NOISE * np.random.default_rng(seed).standard_normal(true.size)
    return {"speed": STEP * np.round(read / STEP)}


def hypotheses() -> list[Hypothesis]:
    """What may have stopped it; the first is what the others must beat."""
    begin = {"start": 55.0, "viscous": 0.01, "dry": 0.1, "air": 0.1}
    sets = {
        "viscous": (START, VISCOUS),
        "viscous, air": (START, VISCOUS, AIR),
        "viscous, dry": (START, VISCOUS, DRY),
        "dry, air": (START, DRY, AIR),
        "all three": (START, VISCOUS, DRY, AIR),
    }
    return [Hypothesis(name, free, {u.name: begin[u.name] for u in free}) for name, free in sets.items()]


def compared(seconds: float) -> tuple[Judgement, ...]:
    """The hypotheses on the first seconds of the record, best first."""
    return judged(problem_of(measured(seconds), wheel(seconds), {"speed": STEP}), hypotheses())


def line(one: Judgement, best: Judgement) -> str:
    """What is said of a hypothesis."""
    low, high = (round(end) for end in one.gain.ci95)
    said = f"{one.hypothesis.name:12} {best.score - one.score:8.1f} {f'{low} .. {high}':>14}  "
    shown = [(u.name, one.fit.values[u.name], one.ci95(u.name)) for u in one.hypothesis.unknowns[1:]]
    return said + ", ".join(f"{name} {value:.4f} ({a:.4f} .. {b:.4f})" for name, value, (a, b) in shown)


if __name__ == "__main__":
    for duration in (20.0, 60.0):
        print(f"{duration:g} s        behind       held out  estimates (95 %)")
        found = compared(duration)
        print("\n".join(line(one, found[0]) for one in found))
