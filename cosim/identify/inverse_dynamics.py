"""Inertia and friction by inverse dynamics: from measured torque and motion, without simulating a fit.

    A r PL = J dw/dt + b w + tau_c sign(w) + tau_load                     (4.1)-(4.6), (4.27)

is linear in its four numbers, so one least-squares problem over the samples in motion gives them, as robots are identified
(Gautier, ICRA 1997). A differentiated angle brings noise into the rows, which pulls the factors towards 0; the instruments
are the same rows of a motion that is simulated under the measured torque, which know nothing of that noise (IDIM-IV:
Janot, Vandanjon, Gautier, IEEE Trans. Control Systems Technology 22(1), 2014).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import coherence, welch

from cosim.compiled import compiled_block
from cosim.errors import DataError, UsageError
from cosim.identify.estimate import FEWEST_BINS, Quantity
from cosim.identify.spectrum import Bins
from cosim.lexicon import current
from cosim.logs.filter import low_pass_without_shift

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNITS = {"J": "kg.m2", "b": "N.m.s/rad", "tau_c": "N.m", "tau_load": "N.m"}
OPTIONAL = ("tau_c", "tau_load")  # left out where the log does not show them
HIGHEST = 40.0  # Hz; as in the other identifications
RESOLVED = 0.2  # of the sampling rate: what differences of samples still resolve
COHERENT = 0.8  # between torque and velocity, up to the highest frequency used
WIDER = 3.0  # the differentiated angle's cut-off over the highest frequency used: its roll-off must not be seen there
STANDING = 0.01  # of the largest speed: below it friction laws differ, and noise decides the sign
NOISES = 5.0  # standard deviations of the velocity's noise below which its sign is in doubt
ORDER = 4  # of the low-pass without shift
SPOILT = 0.2  # s at both ends of the log that the filter spoils
LOG_PARTS = 24  # of the log, whose errors are taken as independent
FEWEST_PARTS = 10  # of them with motion
REFINEMENTS = 6  # of simulating the instruments and solving


@dataclass(frozen=True)
class Motion:
    """What was measured, at an even rate.

    Attributes:
        name: of the log, for messages.
        step: [s].
        torque: A r PL (n,) [N m].
        angle: (n,) [rad].
        keep: (n,), False where a sample was missing.
        values: parameter of the mechanics -> SI, as known: area and arm among them.
        start: time of the first sample [s].
    """

    name: str
    step: float
    torque: Array
    angle: Array
    keep: Mask
    values: Mapping[str, float]
    start: float = 0.0


@dataclass(frozen=True)
class Mechanics:
    """What was found.

    Attributes:
        motion: what it was found from.
        values: parameter -> number.
        not_shown: parameter -> what it would have been; its interval holds 0 and it was left out.
        highest: frequency [Hz] up to which torque and motion were compared.
        used: (n,), the samples in motion that counted.
        acceleration, velocity: (n,) [rad/s2], [rad/s], low-passed.
        fit: of the torque in these samples up to that frequency, 100 (1 - |y - yhat| / |y|).
        held_out: the same of parts of the log, each predicted from the others.
        without_friction: the same with inertia and viscous friction alone.
        one_way: the log moves one way only: what is told as dry friction is that and a constant load together.
    """

    motion: Motion
    values: dict[str, Quantity]
    not_shown: dict[str, Quantity]
    highest: float
    used: Mask
    acceleration: Array
    velocity: Array
    fit: float
    held_out: float
    without_friction: float
    one_way: bool = False

    def torque(self) -> Array:
        """The torque (n,) [N m] that the found numbers ask for."""
        found = {name: quantity.value for name, quantity in self.values.items()}
        rows = {
            "J": self.acceleration,
            "b": self.velocity,
            "tau_c": np.sign(self.velocity),
            "tau_load": np.ones_like(self.velocity),
        }
        return np.sum([value * rows[name] for name, value in found.items()], axis=0)


def identify_mechanics(motion: Motion, highest: float | None = None) -> Mechanics:
    """Inertia, viscous and dry friction and a constant load from torque and angle.

    Args:
        motion: what was measured.
        highest: frequency [Hz] up to which they are compared; by default as far as they belong together.

    Raises:
        DataError: there is too little motion, or torque and motion do not obey the equation.
        UsageError: `highest` does not fit the log's rate.
    """
    if highest is not None and not 0.0 < highest <= RESOLVED / motion.step:
        limit = RESOLVED / motion.step
        raise UsageError(
            f"--highest {highest:g} Hz does not lie between 0 and a fifth of the sampling rate, {limit:g} Hz"
        )
    problem = _Problem(motion, highest or coherent_band(motion.torque, motion.angle, motion.step))
    names, not_shown = list(UNITS), dict[str, Quantity]()
    if problem.one_way:
        names.remove("tau_load")
    while True:
        found = problem.solved(names)
        idle = [n for n in OPTIONAL if n in found and found[n].interval[0] <= 0.0 <= found[n].interval[1]]
        if not idle:
            break
        # the less certain one first: what it took up may be the other's
        worst = min(idle, key=lambda n: abs(found[n].value) / found[n].deviation)
        not_shown[worst] = found[worst]
        names.remove(worst)
    rows = problem.rows
    return Mechanics(
        motion,
        found,
        not_shown,
        problem.highest,
        problem.used,
        rows[0],
        rows[1],
        problem.fit(found),
        problem.held_out(found),
        problem.held_out(found, ("J", "b")),
        problem.one_way,
    )


def coherent_band(torque: Array, angle: Array, step: float) -> float:
    """The highest frequency [Hz] up to which torque (n,) and velocity belong together; above it noise rules."""
    segment = min(angle.size // 6, round(8.0 / step))
    frequencies, found = coherence(np.diff(angle), torque[1:], 1.0 / step, nperseg=segment)
    best = float(frequencies[1])
    for i in range(2, frequencies.size):
        if frequencies[i] > min(HIGHEST, RESOLVED / step):
            break
        if found[np.searchsorted(frequencies, frequencies[i] / 1.3) : i + 1].mean() > COHERENT:
            best = float(frequencies[i])
    return best


class _Problem:
    """The rows of a motion, and which samples count."""

    def __init__(self, motion: Motion, highest: float) -> None:
        self.motion, self.highest = motion, highest
        self.wide = min(WIDER * highest, 0.4 / motion.step)
        self.rows, velocity = self.differentiated(motion.angle)
        self.used = self._moving(velocity)
        self.bins = Bins.up_to(motion.angle.size, motion.step, highest)
        self.parts = np.array_split(np.arange(motion.angle.size), LOG_PARTS)
        self.parts = [part for part in self.parts if self.used[part].any()]
        if len(self.parts) < FEWEST_PARTS or self.bins.last < FEWEST_BINS:
            raise DataError(
                f"{motion.name}: the drive moves in {self.used.mean():.0%} of the log only, or the log is too short: inertia"
                " and friction need motion in both directions over ten seconds and more"
            )
        self.row_numbers, self.torque_numbers = self.numbers(self.rows), self.numbers(motion.torque)

    @property
    def one_way(self) -> bool:
        """True if the drive moves one way only, where the rows of dry friction and a load are the same."""
        return np.unique(self.rows[2][self.used]).size == 1

    def differentiated(self, angle: Array) -> tuple[Array, Array]:
        """Rows (4, n) that go with J, b, tau_c and tau_load, and a smoother velocity (n,) [rad/s]."""
        step = self.motion.step
        velocity = np.gradient(low_pass_without_shift(angle, step, self.wide, ORDER), step)
        smooth = low_pass_without_shift(velocity, step, min(self.highest, self.wide), ORDER)
        return np.vstack(
            [np.gradient(velocity, step), velocity, np.sign(smooth), np.ones_like(angle)]
        ), smooth

    def _moving(self, velocity: Array) -> Mask:
        """Samples (n,) in which the drive surely moves, away from standstill by the filter's width."""
        step, angle = self.motion.step, self.motion.angle
        frequencies, power = welch(angle, 1.0 / step, nperseg=min(angle.size // 6, round(8.0 / step)))
        # an octave above what coheres little of the motion is left
        above = power[(frequencies >= 2.0 * self.highest) & (frequencies <= 4.0 * self.highest)]
        noise = 2.0 * np.pi * np.sqrt(self.highest**3 / 3.0 * float(above.mean()))
        still = np.abs(velocity) <= max(NOISES * noise, STANDING * float(np.abs(velocity).max()))
        still |= ~self.motion.keep
        edge = round(SPOILT / step)
        still[:edge] = still[-edge:] = True
        width = 2 * round(1.0 / self.wide / step) + 1
        return np.convolve(still.astype(np.float64), np.ones(width), "same") < 0.5

    def numbers(self, series: Array) -> Array:
        """Series (..., n) by frequency (..., size), the samples at rest left out."""
        return self.bins(np.where(self.used, series, 0.0))

    def solved(self, names: Sequence[str]) -> dict[str, Quantity]:
        """The numbers `names`, the others being 0."""
        places = [list(UNITS).index(name) for name in names]
        rows, torque = self.row_numbers[places], self.torque_numbers
        found: Array = np.asarray(np.linalg.lstsq(rows.T, torque, rcond=None)[0])
        for _ in range(REFINEMENTS):
            self._check(dict(zip(names, found, strict=True)))
            instruments = self.numbers(self._simulated(names, found)[places])
            inverse = np.linalg.pinv(instruments @ rows.T)
            found = np.asarray(inverse @ (instruments @ torque))
        self._check(dict(zip(names, found, strict=True)))
        deviations = self._deviations(inverse @ instruments, self.motion.torque - found @ self.rows[places])
        freedom = float(len(self.parts) - len(names))
        return {
            name: Quantity(float(value), float(deviation), freedom, UNITS[name])
            for name, value, deviation in zip(names, found, deviations, strict=True)
        }

    def _check(self, found: Mapping[str, float]) -> None:
        if found["J"] <= 0.0 or found["b"] < 0.0:
            would = []
            for name, si in (("J", "kg.m2"), ("b", "N.m.s/rad")):
                unit, scale = current().quantity(si)
                would.append(f"{name} {found[name] * scale:.4g} {unit.replace('.', ' ')}")
            raise DataError(
                f"{self.motion.name}: drive and motion do not obey A r PL = J dw/dt + b w + friction: it would take"
                f" {' and '.join(would)}; check the signs and units of both signals, or record a livelier motion"
            )

    def _simulated(self, names: Sequence[str], found: Array) -> Array:
        """Rows (4, n) of the motion that the measured torque makes with the numbers found so far."""
        known, values = self.motion.values, dict(zip(names, map(float, found), strict=True))
        values = dict.fromkeys(OPTIONAL, 0.0) | values
        values["tau_c"] = max(values["tau_c"], 0.0)
        pressure = self.motion.torque / (known["A"] * known["r"])
        block = compiled_block("mechanical", "mechanical")
        outputs = block.run(pressure[None, 1:], self.motion.step, {**known, **values}, pressure[:1])
        return self.differentiated(outputs[0])[0]

    def _deviations(self, gains: Array, residual: Array) -> Array:
        """Standard deviations (p,) of estimates that are ``gains`` (p, size) times the residual (n,), from its parts.

        Noise of a derivative that counts in motion only is neither white nor stationary; the parts' sums show its effect
        whatever it is (Liang and Zeger, 1986).
        """
        effects = []
        for part in self.parts:
            own = np.zeros_like(residual)
            own[part] = residual[part]
            effects.append(gains @ self.numbers(own))
        count = len(effects)
        return np.sqrt(np.sum(np.square(effects), axis=0) * count / (count - gains.shape[0]))

    def fit(self, found: Mapping[str, Quantity]) -> float:
        """Share of the torque that is explained, in percent."""
        values = np.array([found[name].value if name in found else 0.0 for name in UNITS])
        left = self.torque_numbers - values @ self.row_numbers
        return 100.0 * (1.0 - float(np.linalg.norm(left) / np.linalg.norm(self.torque_numbers)))

    def held_out(self, found: Mapping[str, Quantity], names: Sequence[str] = ()) -> float:
        """The same of parts of the log, each predicted by the numbers `names` that the others show, in percent.

        The instruments are those of the whole log: they are simulated, and know nothing of the noise of a part.
        """
        taken = [n for n in UNITS if n in (names or found)]
        places = [list(UNITS).index(name) for name in taken]
        made = self._simulated(taken, np.array([found[name].value for name in taken]))[places]
        left, whole = 0.0, 0.0
        for part in self.parts:
            inside = np.zeros(self.used.size, dtype=bool)
            inside[part] = True
            outer, inner = ~inside, inside
            instruments, rows = self.numbers(made * outer), self.numbers(self.rows[places] * outer)
            torque = self.numbers(self.motion.torque * outer)
            own = np.linalg.pinv(instruments @ rows.T) @ (instruments @ torque)
            measured = self.numbers(self.motion.torque * inner)
            left += float(np.sum((measured - own @ self.numbers(self.rows[places] * inner)) ** 2))
            whole += float(np.sum(measured**2))
        return 100.0 * (1.0 - float(np.sqrt(left / whole)))
