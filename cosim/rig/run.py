"""Makes one synthetic log: command, true drive, instruments, and the truth about all of it."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError, UsageError
from cosim.rig import excitation as excitations
from cosim.rig.hidden import Hidden, assemble, changed
from cosim.rig.integrate import SUBSTEPS, simulate
from cosim.rig.noise import Noise
from cosim.rig.parameters import DEG, NOMINAL, PARAMETERS, STEP, Plant
from cosim.rig.sensing import SEAM_ANGLE, observe, slew_signal, track

Array = NDArray[np.float64]

SLEW_RANGE = (-20.0 * DEG, 270.0 * DEG)  # Table 3.8
SLEW_SPEED = 2.27 * DEG  # rad/s per unit command at low frequency (SYSTEM section 7)
FRICTIONS = ("sharp", "lugre")


@dataclass(frozen=True)
class RigRun:
    """A synthetic log. All arrays are SI, (n,), one value a millisecond from 0 to the duration, both included.

    Attributes:
        time: [s].
        u: command [1] held over the millisecond that starts at each time.
        spool, p_supply, p_a, p_b, slew: as the sensors log them [m, Pa, Pa, Pa, rad].
        slew_estimate, slew_rate_estimate: the observer's [rad, rad/s], or None when not asked for.
        true: the noise-free signals ``spool, p_load, p_supply, theta, omega, seen, sensed, boom``.
        tracker: stamps on the tracker's own clock [s] and angles [rad] (m,), or None when not asked for.
        truth: everything that was hidden and chosen, as plain data; ``truth["synthetic"]`` is True.
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
    truth: dict[str, object] = field(repr=False)

    @property
    def signals(self) -> dict[str, Array]:
        """The logged signals (SI) by name, in the order of the log's columns, without time."""
        names = ("u", "spool", "p_supply", "p_a", "p_b", "slew", "slew_estimate", "slew_rate_estimate")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def notes(self) -> list[str]:
        """What the user should know about this log."""
        return list(self.truth["notes"])  # type: ignore[call-overload]


def make_log(
    excitation: str | Array = "mixed",
    duration: float = 60.0,
    hidden: Iterable[Hidden | str] = (),
    *,
    settings: Mapping[str, float] | None = None,
    noise: Noise | float = 1.0,
    seed: int = 1,
    amplitude: float = 1.0,
    start: float | None = None,
    friction: str = "sharp",
    observer: bool = False,
    tracker: bool = False,
    command_file: Path | None = None,
    substeps: int = SUBSTEPS,
) -> RigRun:
    """One synthetic log of the crane.

    Args:
        excitation: a name of `cosim.rig.excitation.EXCITATIONS`, ``file`` (plays `command_file`), or the command itself,
            (n,) [1] at 1 kHz, which then also sets the duration.
        duration: [s], a whole number of milliseconds.
        hidden: effects to hide, as `Hidden` or in the form ``effect:name=value unit``.
        settings: ``component.parameter`` -> value (SI) of nominal numbers that are off.
        noise: a `Noise`, or a factor on the default sizes (0: none).
        seed: of excitation, noise and dropout; the same seed gives the same numbers.
        amplitude: of the command, 0 .. 1.
        start: slew angle [rad] at the start; None chooses it so that the travel is centred on the seam at 12 deg, or
            as near as the range -20 .. 270 deg allows.
        friction: ``sharp``, or ``lugre`` for bristles with the same steady-state curve.
        observer: add the observer's estimates.
        tracker: add the optical tracker's record.
        command_file: CSV for the excitation ``file``.
        substeps: integration steps in a millisecond.

    Raises:
        UsageError: a name, number or combination that makes no sense.
        DataError: the command file is bad.
        SimulationError: the crane's motion is no longer finite.
    """
    if friction not in FRICTIONS:
        raise UsageError(f"unknown friction '{friction}': known are {', '.join(FRICTIONS)}")
    if substeps < 1:
        raise UsageError(f"{substeps} substeps a millisecond: at least 1 is needed")
    noise = noise if isinstance(noise, Noise) else Noise(scale=float(noise))
    effects = [Hidden.parse(item) if isinstance(item, str) else item for item in hidden]
    time, u = _command(excitation, duration, amplitude, seed, command_file)
    numbers = dict(settings or {})
    if start is not None and "mechanical.theta_0" in numbers:
        raise UsageError("the start angle is given twice: as start and as mechanical.theta_0")
    numbers.setdefault("mechanical.theta_0", _start(u) if start is None else start)
    plant = assemble(effects, numbers)
    true = simulate(u, plant, lugre=friction == "lugre", substeps=substeps)
    if not all(np.isfinite(values).all() for values in true.values()):
        raise SimulationError("the crane's motion is not finite with these parameters: try more substeps")
    slew = slew_signal(true, plant, noise, seed)
    estimates = observe(u, slew) if observer else (None, None)
    truth: dict[str, object] = {
        "synthetic": True,
        "hidden": [effect.truth() for effect in effects],
        "settings": {n: {"value": float(v), "unit": PARAMETERS[n].unit} for n, v in (settings or {}).items()},
        "not_nominal": {n: {"value": v, "unit": PARAMETERS[n].unit} for n, v in changed(plant).items()},
        "excitation": _described(excitation, amplitude, command_file),
        "duration": {"value": float(time[-1]), "unit": "s"},
        "start": {"value": plant.mechanical.theta_0, "unit": "rad"},
        "seed": seed,
        "friction": friction,
        "noise": noise.truth(),
        "substeps": substeps,
        "notes": _notes(true, plant, tracker),
        "versions": _versions(),
    }
    return RigRun(
        time=time,
        u=u,
        spool=true["spool"] + noise.draw("spool", time.size, seed),
        p_supply=true["p_supply"] + noise.draw("p_supply", time.size, seed),
        p_a=0.5 * (true["p_supply"] + true["p_load"]) + noise.draw("p_a", time.size, seed),
        p_b=0.5 * (true["p_supply"] - true["p_load"]) + noise.draw("p_b", time.size, seed),
        slew=slew,
        slew_estimate=estimates[0],
        slew_rate_estimate=estimates[1],
        true=true,
        tracker=track(true["seen"], plant, noise, seed) if tracker else None,
        truth=truth,
    )


def _command(
    excitation: str | Array, duration: float, amplitude: float, seed: int, path: Path | None
) -> tuple[Array, Array]:
    """Times [s] and command [1] of a log, (n,) each."""
    if not isinstance(excitation, str):
        u = np.ascontiguousarray(excitation, dtype=np.float64)
        if u.ndim != 1 or u.size < 2:
            raise UsageError("a command given as numbers must be one row of at least two samples at 1 kHz")
        if not (np.abs(u) <= 1.0).all():
            raise UsageError("a command given as numbers must lie within -1 .. 1")
        return np.arange(u.size, dtype=np.float64) * STEP, u
    if path is not None and excitation != "file":
        raise UsageError(f"a command file is played by the excitation 'file' only, not by '{excitation}'")
    count = round(duration / STEP) if 0.0 < duration < 1e6 else 0
    if count < 2 or abs(count * STEP - duration) > 1e-6:
        raise UsageError(
            f"duration {duration:g} s must be a whole number of milliseconds, at least 2 and below 1e6 s"
        )
    time = np.arange(count + 1, dtype=np.float64) * STEP
    return time, np.ascontiguousarray(excitations.command(excitation, time, amplitude, seed, path))


def _start(u: Array) -> float:
    """Start angle [rad] that centres the travel expected of `u` on the seam, as far as the sensor's range allows."""
    travel = np.cumsum(u) * STEP * SLEW_SPEED
    low, high = float(travel.min()), float(travel.max())
    centred = SEAM_ANGLE - 0.5 * (low + high)
    # a range that is too small for the travel is left at its upper end, and `_notes` says so
    return max(min(centred, SLEW_RANGE[1] - high), SLEW_RANGE[0] - low)


def _notes(true: Mapping[str, Array], plant: Plant, tracker: bool) -> list[str]:
    """Plain sentences about what a reader of the log might trip over."""
    notes = []
    low, high = float(true["seen"].min()) / DEG, float(true["seen"].max()) / DEG
    if low < SLEW_RANGE[0] / DEG - 1e-9 or high > SLEW_RANGE[1] / DEG + 1e-9:
        notes.append(
            f"the slew angle runs from {low:.1f} to {high:.1f} deg and leaves the sensor's range -20 .. 270 deg: "
            "use a smaller amplitude, a shorter log or another start"
        )
    if plant.tracker != NOMINAL.tracker and not tracker:
        notes.append(
            "an effect of the tracker is hidden, but no tracker record is made: ask for one (--tracker FILE)"
        )
    return notes


def _described(excitation: str | Array, amplitude: float, path: Path | None) -> dict[str, object]:
    """The excitation as plain data; a file by its name alone."""
    if not isinstance(excitation, str):
        return {"name": "samples"}
    described: dict[str, object] = {"name": excitation, "amplitude": amplitude}
    if path is not None:
        described["file"] = path.name
    return described


def _versions() -> dict[str, str]:
    """Versions of what made the log."""
    found = {"python": platform.python_version()}
    for name in ("slew-cosim", "numpy", "numba", "scipy"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # run from a checkout that is not installed
            found[name] = "not installed"
    return found
