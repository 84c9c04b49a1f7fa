"""What a synthetic log is to be: everything that can be chosen about it, checked."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.rig import excitation as excitations
from cosim.rig.hidden import Hidden, assemble, changed, closest
from cosim.rig.integrate import SUBSTEPS
from cosim.rig.noise import Noise
from cosim.rig.parameters import (
    DEG,
    IDENTIFIED_ONLY,
    PARAMETERS,
    PHYSICAL_B,
    PHYSICAL_ONLY,
    STEP,
    Plant,
)
from cosim.rig.sensing import SEAM_ANGLE

Array = NDArray[np.float64]

SLEW_RANGE = (-20.0 * DEG, 270.0 * DEG)  # Table 3.8
SLEW_SPEED = 2.27 * DEG  # rad/s per unit command at low frequency (SYSTEM section 7)
FRICTIONS = ("sharp", "lugre", "smooth")
MODELS = ("full_order", "physical")


@dataclass(frozen=True)
class Recipe:
    """Everything that can be chosen about a synthetic log.

    Attributes:
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
        friction: ``sharp``; ``lugre`` for bristles with the same steady-state curve; ``smooth`` for one that passes through
            zero steeply instead of jumping, so that it creeps instead of sticking.
        observer: add the observer's estimates.
        tracker: add the optical tracker's record.
        markers: let the tracker's angle come from marker positions and two marker models, and keep the positions.
        command_file: CSV for the excitation ``file``.
        substeps: integration steps in a millisecond.
        model: ``full_order``, or ``physical`` for orifices and two chambers (4.17)-(4.21), where the motion takes up flow.
        card: let every analogue channel, its noise included, pass the input card's filter (2.1), (3.1) in samples at
            250 kHz, before it is rounded or lost.

    Raises:
        UsageError: a name, number or combination that makes no sense.
    """

    excitation: str | Array = "mixed"
    duration: float = 60.0
    hidden: Iterable[Hidden | str] = ()
    settings: Mapping[str, float] = field(default_factory=dict)
    noise: Noise | float = 1.0
    seed: int = 1
    amplitude: float = 1.0
    start: float | None = None
    friction: str = "sharp"
    observer: bool = False
    tracker: bool = False
    command_file: Path | None = None
    substeps: int = SUBSTEPS
    model: str = "full_order"
    markers: bool = False
    card: bool = False

    def __post_init__(self) -> None:
        """Check what no later step checks."""
        if self.friction not in FRICTIONS:
            raise UsageError(f"unknown friction '{self.friction}': known are {', '.join(FRICTIONS)}")
        if self.model not in MODELS:
            raise UsageError(f"no model '{self.model}' of the rig: {closest(self.model, MODELS)}")
        if self.substeps < 1:
            raise UsageError(f"{self.substeps} substeps a millisecond: at least 1 is needed")
        if self.start is not None and "mechanical.theta_0" in self.settings:
            raise UsageError("the start angle is given twice: as start and as mechanical.theta_0")
        if "continuity.physical" in self.settings:
            raise UsageError("continuity.physical is chosen by the model: --model physical")
        if isinstance(self.hidden, (str, Hidden)):
            raise UsageError("hidden is a list of effects: put the one effect into a list")
        # an iterator would be used up by its first reader
        object.__setattr__(self, "hidden", tuple(self.hidden))

    def effects(self) -> list[Hidden]:
        """The hidden effects.

        Raises:
            UsageError: one cannot be read.
        """
        return [Hidden.parse(item) if isinstance(item, str) else item for item in self.hidden]

    def sensor_noise(self) -> Noise:
        """The noise of the sensors."""
        return self.noise if isinstance(self.noise, Noise) else Noise(scale=float(self.noise))

    def command(self) -> tuple[Array, Array]:
        """Times [s] and command [1] of the log, (n,) each.

        Raises:
            UsageError: excitation, amplitude or duration make no sense.
            DataError: the command file is bad.
        """
        if not isinstance(self.excitation, str):
            u = np.ascontiguousarray(self.excitation, dtype=np.float64)
            if u.ndim != 1 or u.size < 2:
                raise UsageError(
                    "a command given as numbers must be one row of at least two samples at 1 kHz"
                )
            if not (np.abs(u) <= 1.0).all():
                raise UsageError("a command given as numbers must lie within -1 .. 1")
            return np.arange(u.size, dtype=np.float64) * STEP, u
        if self.command_file is not None and self.excitation != "file":
            raise UsageError(
                f"a command file is played by the excitation 'file' only, not by '{self.excitation}'"
            )
        count = round(self.duration / STEP) if 0.0 < self.duration < 1e6 else 0
        if count < 2 or abs(count * STEP - self.duration) > 1e-6:
            raise UsageError(
                f"duration {self.duration:g} s must be a whole number of milliseconds, at least 2 and below 1e6 s"
            )
        time = np.arange(count + 1, dtype=np.float64) * STEP
        u = excitations.command(self.excitation, time, self.amplitude, self.seed, self.command_file)
        return time, np.ascontiguousarray(u)

    def plant(self, u: Array) -> Plant:
        """The crane with all that is hidden in it, for a command `u` (n,) [1].

        Raises:
            UsageError: effects and settings contradict each other, or one is not allowed.
        """
        numbers = dict(self.settings)
        if numbers.get("tracker.misfit") and not self.markers:
            raise UsageError(
                "tracker.misfit is of the marker models: ask for marker positions (--markers FILE)"
            )
        numbers.setdefault("mechanical.theta_0", _centred(u) if self.start is None else self.start)
        if self.model == "full_order":
            plant = assemble(self.effects(), numbers)
            self._refuse(plant, PHYSICAL_ONLY, "acts in the physical system only: add --model physical")
            return plant
        if not any("mechanical.b" in effect.numbers() for effect in self.effects()):
            numbers.setdefault("mechanical.b", PHYSICAL_B)
        plant = assemble(self.effects(), numbers)
        instead = "has no place in the physical system: set continuity.w, p_s, R_s or tau_p there (--set)"
        self._refuse(plant, IDENTIFIED_ONLY, instead)
        return plant._replace(continuity=plant.continuity._replace(physical=1.0))

    @staticmethod
    def _refuse(plant: Plant, names: tuple[str, ...], why: str) -> None:
        for name in names:
            if name in changed(plant):
                raise UsageError(f"{name} {why}")

    def truth(self) -> dict[str, object]:
        """The choices as plain data; a command file by its name alone."""
        named = isinstance(self.excitation, str)
        played: dict[str, object] = {"name": self.excitation if named else "samples"}
        if named:
            played["amplitude"] = self.amplitude
        if self.command_file is not None:
            played["file"] = self.command_file.name
        return {
            "synthetic": True,
            "hidden": [effect.truth() for effect in self.effects()],
            "settings": {
                n: {"value": float(v), "unit": PARAMETERS[n].unit} for n, v in self.settings.items()
            },
            "excitation": played,
            "seed": self.seed,
            "friction": self.friction,
            "model": self.model,
            "card": self.card,
            "noise": self.sensor_noise().truth(),
            "substeps": self.substeps,
        }


def _centred(u: Array) -> float:
    """Start angle [rad] that centres the travel expected of `u` on the seam, as far as the sensor's range allows."""
    travel = np.cumsum(u) * STEP * SLEW_SPEED
    low, high = float(travel.min()), float(travel.max())
    centred = SEAM_ANGLE - 0.5 * (low + high)
    # travel that is too long for the range starts at its lower end; the run's notes say so
    return max(min(centred, SLEW_RANGE[1] - high), SLEW_RANGE[0] - low)
