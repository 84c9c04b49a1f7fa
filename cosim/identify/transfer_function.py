"""Transfer functions of a chosen order, fitted to time series: poles, zeros, integrators and a delay, with intervals.

    y = B(s) exp(-tau s) / (s^m A(s)) (u + u_0) + start

A is a product of ``s^2 + p s + q`` and ``s + a`` with positive p, q and a: a stable denominator, whatever the search
tries. u_0 (an offset of the input) and the start are free in every record.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.identify.data import Record
from cosim.identify.estimate import Fit, Quantity, Rows, Series, fit, residual_size
from cosim.identify.linear import delayed, free_responses, responses

Array = NDArray[np.float64]

LOOSE = 0.5  # half-width of a pole's interval, of the pole, beyond which the data say nothing about it
LONGEST_DELAY = 0.25  # s
FASTEST = 1e4  # rad/s, of a pole
EXTRA = 300.0  # rad/s, of a pole that a simpler structure does not have
START_RATES = (2.0, 8.0, 30.0)  # rad/s, where the search for poles begins


@dataclass(frozen=True)
class Structure:
    """What a transfer function looks like.

    Attributes:
        poles: their number, the integrators among them.
        zeros: their number.
        integrators: poles at 0.
        delay: with a transport delay.
    """

    poles: int
    zeros: int = 0
    integrators: int = 0
    delay: bool = False

    def __post_init__(self) -> None:
        """Check that it is strictly proper and small enough to be told from data."""
        if not 1 <= self.poles <= 6:
            raise UsageError(f"{self.poles} poles: choose 1 to 6")
        if not 0 <= self.zeros < self.poles:
            raise UsageError(
                f"{self.zeros} zeros with {self.poles} poles: there must be fewer zeros than poles"
            )
        if not 0 <= self.integrators <= self.poles:
            raise UsageError(f"{self.integrators} integrators among {self.poles} poles: choose fewer")

    @property
    def free(self) -> int:
        """Poles that are not at 0."""
        return self.poles - self.integrators

    @property
    def size(self) -> int:
        """Free numbers: factors of the denominator, delay and numerator."""
        return self.free + self.delay + self.zeros + 1

    def __str__(self) -> str:
        at_zero = f" ({self.integrators} at 0)" if self.integrators else ""
        parts = [
            f"{self.poles} pole{'s' * (self.poles != 1)}{at_zero}",
            f"{self.zeros} zero{'s' * (self.zeros != 1)}",
        ]
        return ", ".join([*parts, "delay"] if self.delay else parts)

    def denominator(self, theta: Array) -> Array:
        """Monic, falling powers, from the logarithms of the factors' coefficients; what else theta holds is left."""
        found = np.array([1.0])
        for k in range(0, self.free - 1, 2):
            found = np.polymul(found, [1.0, np.exp(theta[k]), np.exp(theta[k + 1])])
        if self.free % 2:
            found = np.polymul(found, [1.0, np.exp(theta[self.free - 1])])
        return np.concatenate([found, np.zeros(self.integrators)])

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest theta: rates of 1e-3 to 1e4 rad/s, delays up to `LONGEST_DELAY`."""
        low, high = np.full(self.free, np.log(1e-3)), np.full(self.free, np.log(FASTEST))
        for k in range(1, self.free, 2):  # s^2 + p s + q
            low[k], high[k] = 2.0 * np.log(1e-3), 2.0 * np.log(FASTEST)
        if self.delay:
            low, high = np.append(low, 0.0), np.append(high, LONGEST_DELAY)
        return low, high

    def from_poles(self, poles: Sequence[complex]) -> Array:
        """Theta of a denominator with these poles; where there are fewer than it has, fast real ones are added."""
        known = list(poles)[: self.free]
        pairs = [s for s in known if s.imag > 0.0]
        real = sorted(-s.real for s in known if s.imag == 0.0) + [EXTRA] * (self.free - len(known))
        theta = [value for s in pairs for value in (np.log(-2.0 * s.real), np.log(abs(s) ** 2))]
        for slow, fast in zip(real[0::2], real[1::2], strict=False):
            theta += [np.log(slow + fast), np.log(slow * fast)]
        if len(real) % 2:
            theta.append(np.log(real[-1]))
        return np.array([*theta, *([0.005] * self.delay)], dtype=np.float64)

    def starts(self) -> list[Array]:
        """Where to begin the search: poles around each of `START_RATES`, spread."""
        found = []
        for rate in START_RATES:
            rates = (
                rate * np.geomspace(0.6, 4.0, max(1, self.free))
                if self.free > 2
                else np.full(self.free, rate)
            )
            theta: list[float] = []
            for k in range(0, self.free - 1, 2):
                theta += [float(np.log(1.4 * rates[k])), float(2 * np.log(rates[k]))]
            if self.free % 2:
                theta.append(float(np.log(rates[-1])))
            found.append(np.array(theta + [0.005] * self.delay))
        return found


@dataclass(frozen=True)
class TransferFunction:
    """A fitted transfer function.

    Attributes:
        structure: what it looks like.
        fit: what the fit found; its shared factors are the numerator's coefficients of rising powers.
        records: what it was fitted to.
    """

    structure: Structure
    fit: Fit
    records: tuple[Record, ...]

    @cached_property
    def denominator(self) -> Array:
        """Monic, falling powers."""
        return self.structure.denominator(self.fit.theta)

    @property
    def numerator(self) -> Array:
        """Falling powers."""
        return self.fit.shared[::-1]

    @property
    def delay(self) -> float:
        """[s]."""
        return float(self.fit.theta[-1]) if self.structure.delay else 0.0

    @property
    def best_fit(self) -> float:
        """Best fit % over all records (MATLAB's NRMSE fit)."""
        measured = [r.output[r.keep] for r in self.records]
        missed = [e[r.keep] for e, r in zip(self.fit.residuals, self.records, strict=True)]
        spread = np.sqrt(sum(float(np.sum((y - y.mean()) ** 2)) for y in measured))
        return 100.0 * (1.0 - float(np.linalg.norm(np.concatenate(missed))) / spread)

    def quantity(self, name: str) -> Quantity:
        """``gain`` (at low frequency, the integrators taken out), or ``delay``."""
        if name == "delay":
            return self.fit.derived(lambda theta, b: float(theta[-1]), "s")
        m = self.structure.integrators
        return self.fit.derived(lambda theta, b: float(b[0] / self.structure.denominator(theta)[-1 - m]))

    def poles(self) -> list[dict[str, Quantity]]:
        """Of each real pole its ``rate`` (the pole is at minus it), of each pair ``w0`` and ``zeta``; slowest first."""
        roots = pole_list(self.denominator, self.structure.integrators)
        found = []
        for k, root in enumerate(roots):
            if root.imag < 0.0:
                continue
            if root.imag == 0.0:
                found.append({"rate": self._pole(k, lambda s: -s.real, "1/s")})
            else:
                w0 = self._pole(k, abs, "rad/s")
                found.append({"w0": w0, "zeta": self._pole(k, lambda s: -s.real / (abs(s) or 1.0), "1")})
        return found

    def zeros(self) -> NDArray[np.complex128]:
        """Zeros [1/s]."""
        return np.roots(self.numerator).astype(np.complex128)

    def _pole(self, k: int, of: Callable[[complex], float], unit: str) -> Quantity:
        structure = self.structure

        def value(theta: Array, b: Array) -> float:
            return float(of(pole_list(structure.denominator(theta), structure.integrators)[k]))

        return self.fit.derived(value, unit)

    def simulated(self, k: int) -> Array:
        """Its output (n,) in record k, with that record's start and offset."""
        return self.records[k].output - self.fit.residuals[k]

    @property
    def determined(self) -> bool:
        """Whether no pole's interval is as wide as the pole."""
        return all(not _loose(pole) for pole in self.poles())

    def check_known(self, name: str = "") -> None:
        """Refuse poles that the data do not determine; `name` is that of the log, for the message.

        Raises:
            DataError: a pole's interval is as wide as the pole itself; the message names the band to excite.
        """
        for pole in filter(_loose, self.poles()):
            rate = pole.get("rate") or pole["w0"]
            w, reach = abs(rate.value), (rate.interval[1] - rate.interval[0]) / 2.0
            log = name or self.records[0].name
            fastest = np.pi / self.records[0].step
            if w > fastest:
                raise DataError(
                    f"{log}: a pole came out at {w:.3g} rad/s, beyond what samples every {self.records[0].step * 1e3:.3g} ms"
                    f" show ({fastest:.3g} rad/s): the log tells no such lag; take fewer poles (--order), or sample faster"
                )
            raise DataError(
                f"{log}: the log does not excite the band around {w:.3g} rad/s enough: the pole"
                f" there is only known as {w:.3g} ± {reach:.2g}; take fewer poles (--order), or excite {0.3 * w:.2g} to"
                f" {3 * w:.2g} rad/s (`cosim identify experiment` writes such a command)"
            )


def _loose(pole: Mapping[str, Quantity]) -> bool:
    rate = pole.get("rate") or pole["w0"]
    low, high = rate.interval
    return not (high - low) / 2.0 <= LOOSE * abs(rate.value)


def pole_list(denominator: Array, integrators: int) -> NDArray[np.complex128]:
    """Poles but those at 0, by magnitude; of a pair the one above the real axis first."""
    roots = np.roots(denominator[: denominator.size - integrators]).astype(np.complex128)
    order = sorted(roots, key=lambda s: (round(abs(s), 9), -s.imag))
    return np.array(order, dtype=np.complex128)


def rows_of(structure: Structure, item: Record, theta: Array) -> Rows:
    """What numerator, input offset and start each add to a record's output."""
    denominator = structure.denominator(theta)
    given = delayed(item.input, theta[-1] / item.step) if structure.delay else item.input
    shared = responses(denominator, given, item.step, item.held)[: structure.zeros + 1]
    own = free_responses(denominator, item.output.size, item.step)
    # an offset of the input adds a power of time, and what the free motion holds already
    offset = np.linspace(0.0, 1.0, item.input.size) ** structure.integrators
    return shared, np.vstack([own, offset[None]])


def fit_records(
    records: Sequence[Record],
    structure: Structure,
    *,
    highest: float = 40.0,
    start: Array | None = None,
    simpler: Sequence[TransferFunction] = (),
) -> TransferFunction:
    """Fit one transfer function to one or several records.

    Args:
        records: what it is to explain, all at once.
        structure: poles, zeros, integrators, delay.
        highest: frequency [Hz] beyond which nothing is used.
        start: theta where the search begins; else several places are tried.
        simpler: fits of simpler structures, from whose poles it may begin too.

    Raises:
        DataError: a record is too short.
    """
    series = [Series(r.output, r.step, r.keep, r.name) for r in records]

    def model(theta: Array, k: int) -> Rows:
        return rows_of(structure, records[k], theta)

    q = structure.free + structure.delay
    low, high = structure.bounds()
    begins = [*structure.starts(), *_extended(structure, simpler)] if start is None else [start]
    if len(begins) > 1 and q:
        begins = [min(begins, key=lambda theta: residual_size(series, model, theta, highest))]
    found = fit(series, model, begins[0], highest=highest, bounds=(low, high))
    return TransferFunction(structure, found, tuple(records))


def _extended(structure: Structure, simpler: Sequence[TransferFunction]) -> list[Array]:
    """Starts from the poles of simpler fits."""
    low, high = structure.bounds()
    return [
        np.clip(structure.from_poles(list(pole_list(s.denominator, s.structure.integrators))), low, high)
        for s in simpler
        if s.structure.integrators == structure.integrators and s.structure.free <= structure.free
    ]


def held_out_fit(found: TransferFunction, records: Sequence[Record]) -> float:
    """Best fit % in records that the fit did not see; only their start and offset are found anew, by least squares."""
    missed, spread = 0.0, 0.0
    for item in records:
        shared, own = rows_of(found.structure, item, found.fit.theta)
        rest = np.where(item.keep, item.output - found.fit.shared @ shared, 0.0)
        free = np.where(item.keep, own, 0.0)
        scale = np.linalg.norm(free, axis=1)
        scale[scale == 0.0] = 1.0
        factors = np.linalg.lstsq((free / scale[:, None]).T, rest, rcond=1e-12)[0]
        error = (rest - factors @ (free / scale[:, None]))[item.keep]
        missed += float(error @ error)
        y = item.output[item.keep]
        spread += float(np.sum((y - y.mean()) ** 2))
    return 100.0 * (1.0 - float(np.sqrt(missed / spread))) if spread > 0.0 else float("nan")
