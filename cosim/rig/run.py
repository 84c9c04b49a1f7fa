"""Makes one synthetic log: command, true drive, instruments, and the truth about all of it."""

import platform
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError
from cosim.rig.hidden import Hidden, changed
from cosim.rig.integrate import simulate
from cosim.rig.markers import MarkerRecord, watch
from cosim.rig.parameters import DEG, NOMINAL, PARAMETERS, STEP, Plant
from cosim.rig.recipe import SLEW_RANGE, Recipe
from cosim.rig.sensing import observe, slew_signal, track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigRun:
    """A synthetic log. All arrays are SI, (n,), one value a millisecond from 0 to the duration, both included.

    Attributes:
        time: [s].
        u: command [1] held over the millisecond that starts at each time.
        spool, p_supply, p_a, p_b, slew: as the sensors log them [m, Pa, Pa, Pa, rad].
        slew_estimate, slew_rate_estimate: the observer's [rad, rad/s], or None when not asked for.
        true: the noise-free signals ``spool, p_load, p_supply, theta, omega, seen, sensed, boom, p_sum``.
        tracker: stamps on the tracker's own clock [s] and angles [rad] (m,), or None when not asked for.
        truth: everything that was hidden and chosen, as plain data; ``truth["synthetic"]`` is True.
        notes: what the user should know about this log.
        markers: what the tracker saw of its markers, or None when not asked for. `tracker` holds NaN where they
            gave no pose.
    """

    time: Array
    u: Array
    spool: Array
    p_supply: Array
    p_a: Array
    p_b: Array
    slew: Array
    slew_estimate: Array | None
    slew_rate_estimate: Array | None
    true: Mapping[str, Array]
    tracker: tuple[Array, Array] | None
    truth: dict[str, Any] = field(repr=False)
    notes: list[str]
    markers: MarkerRecord | None = None

    @property
    def signals(self) -> dict[str, Array]:
        """The logged signals (SI) by name, in the order of the log's columns, without time."""
        names = ("u", "spool", "p_supply", "p_a", "p_b", "slew", "slew_estimate", "slew_rate_estimate")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


def make_log(
    excitation: str | Array = "mixed",
    duration: float = 60.0,
    hidden: Iterable[Hidden | str] = (),
    **options: Any,
) -> RigRun:
    """One synthetic log of the crane.

    Args:
        excitation: a name, or the command itself (n,) [1] at 1 kHz.
        duration: [s].
        hidden: effects to hide, as `Hidden` or in the form ``effect:name=value unit``.
        **options: the other attributes of `Recipe`, where all are explained.

    Raises:
        UsageError: a name, number or combination that makes no sense.
        DataError: the command file is bad.
        SimulationError: the crane's motion is no longer finite.
    """
    return make(Recipe(excitation, duration, hidden, **options))


def make(recipe: Recipe) -> RigRun:
    """One synthetic log after a recipe; raises what `make_log` does."""
    time, u = recipe.command()
    plant = recipe.plant(u)
    true = simulate(u, plant, friction=recipe.friction, substeps=recipe.substeps)
    if not all(np.isfinite(values).all() for values in true.values()):
        raise SimulationError("the crane's motion is not finite with these parameters: try more substeps")
    noise, seed = recipe.sensor_noise(), recipe.seed
    passes: Callable[[NDArray[np.float64]], NDArray[np.float64]] = _as_it_is
    if recipe.card:
        from cosim.logs.filter import input_card

        passes = partial(input_card, step=STEP)
    slew = slew_signal(true, plant, noise, seed, passes)
    estimates = observe(u, slew) if recipe.observer else (None, None)
    markers = watch(true["seen"], plant, noise, seed) if recipe.markers else None
    notes = _notes(true, plant, recipe.tracker or recipe.markers)
    truth = recipe.truth() | {
        "not_nominal": {n: {"value": v, "unit": PARAMETERS[n].unit} for n, v in changed(plant).items()},
        "duration": {"value": float(time[-1]), "unit": "s"},
        "start": {"value": plant.mechanical.theta_0, "unit": "rad"},
        "notes": notes,
        "versions": _versions(),
    }
    if markers is not None:
        truth["markers"] = markers.truth()
        tracker: tuple[Array, Array] | None = (markers.stamps, markers.stitched.angle)
    else:
        tracker = track(true["seen"], plant, noise, seed) if recipe.tracker else None
    return RigRun(
        time=time,
        u=u,
        spool=passes(true["spool"] + noise.draw("spool", time.size, seed)),
        p_supply=passes(true["p_supply"] + noise.draw("p_supply", time.size, seed)),
        p_a=passes(0.5 * (true["p_sum"] + true["p_load"]) + noise.draw("p_a", time.size, seed)),
        p_b=passes(0.5 * (true["p_sum"] - true["p_load"]) + noise.draw("p_b", time.size, seed)),
        slew=slew,
        slew_estimate=estimates[0],
        slew_rate_estimate=estimates[1],
        true=true,
        tracker=tracker,
        truth=truth,
        notes=notes,
        markers=markers,
    )


def _as_it_is(values: Array) -> Array:
    """Values of a channel without a filter."""
    return values


def _notes(true: Mapping[str, Array], plant: Plant, tracker: bool) -> list[str]:
    """Plain sentences about what a reader of the log might trip over."""
    notes = []
    low, high = float(true["seen"].min()), float(true["seen"].max())
    if low < SLEW_RANGE[0] - 1e-9 or high > SLEW_RANGE[1] + 1e-9:
        notes.append(
            f"the slew angle runs from {low / DEG:.1f} to {high / DEG:.1f} deg and leaves the sensor's range "
            "-20 .. 270 deg: use a smaller amplitude, a shorter log or another start"
        )
    if plant.tracker != NOMINAL.tracker and not tracker:
        notes.append(
            "an effect of the tracker is hidden, but no tracker record is made: ask for one (--tracker FILE)"
        )
    return notes


def _versions() -> dict[str, str]:
    """Versions of what made the log."""
    found = {"python": platform.python_version()}
    for name in ("slew-cosim", "numpy", "numba", "scipy"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # run from a checkout that is not installed
            found[name] = "not installed"
    return found
