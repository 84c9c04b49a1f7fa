"""What is left of a residual when nothing in particular is assumed: a smooth missing demand, opening, torque or reading.

The missing quantity is a sum of hat functions of each signal it might depend on (command, position, speed, pressure,
angle, time), passed through the linear part of the group. It serves three ends: an estimate of the noise that model
errors do not inflate, a test whether anything systematic is left, and a picture of what is missing.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter
from scipy.special import fdtrc

from cosim.diagnosis.fitting.noise import Whitener
from cosim.inference.pieces import by_piece

Array = NDArray[np.float64]

KNOTS = 9
RIDGES = (0.1, 1.0, 10.0)  # of a column's square: of what is visited less, hardly a coefficient is taken
FACTOR_KNOTS = 5  # of a factor that changes over the log or with another signal


@dataclass(frozen=True)
class Basis:
    """One family of free functions: of which signal, acting where.

    Attributes:
        of: the signal that the missing quantity would depend on.
        what: the missing quantity ("torque", "reading", ...), with `unit`.
        knots: (k,) where the hats stand, in the signal's unit.
        driver: (n,) the signal.
        transfer: numerator and denominator of the linear part behind it, or None for none.
        h: step, s.
        factor: (n,) what the hats are multiplied with, or None.
        cuts: first sample of each log but the first: nothing passes from one to the next.
    """

    of: str
    what: str
    unit: str
    knots: Array
    driver: Array = field(repr=False)
    transfer: tuple[list[float], list[float]] | None
    h: float
    factor: Array | None = field(default=None, repr=False)
    cuts: tuple[int, ...] = ()

    def columns(self) -> Iterator[Array]:
        """(n,) response of each hat in the observed signal, one at a time: all of them at once would fill the memory."""
        for unit in np.eye(self.knots.size):
            hat = np.interp(self.driver, self.knots, unit)
            if self.factor is not None:
                hat = hat * self.factor
            yield hat if self.transfer is None else by_piece(self.behind, self.cuts, hat)

    def behind(self, hat: Array) -> Array:
        """(n,) a hat of one log behind the linear part."""
        return hat if self.transfer is None else response(*self.transfer, self.h, hat)


@dataclass(frozen=True)
class Leftover:
    """What free functions explain of a residual.

    Attributes:
        p_value: probability of explaining this much by chance.
        gain: log-likelihood gained beyond what chance would give.
        rms: size of the explained part, in the observed signal's unit.
        explained: (windows, bins) means of the explained part.
        by_signal: "what(of)" -> log-likelihood that this family alone gains beyond chance, largest first.
        curves: "what(of)" -> (knots, missing quantity) of that family alone.
        held_out: log-likelihood that the better of all families together and the best one alone gains on each
            window with coefficients from the others: slow noise is explained once and not again.
    """

    p_value: float
    gain: float
    rms: float
    explained: Array
    by_signal: dict[str, float]
    curves: dict[str, tuple[Array, Array]]
    held_out: float


def hats(signal: Array, knots: int = KNOTS) -> tuple[Array, Array]:
    """(k,) knots at quantiles of a signal (n,), and (k, n) piecewise linear functions that are one at one knot each."""
    at = knots_of(signal, knots)
    return at, np.array([np.interp(signal, at, unit) for unit in np.eye(at.size)]).reshape(
        at.size, signal.size
    )


def knots_of(signal: Array, knots: int = KNOTS) -> Array:
    """(k,) knots at quantiles of a signal (n,); none where it has too few values."""
    # distinct values: a signal at rest most of the time would otherwise put all knots there
    spread = np.unique(np.round(signal / max(np.ptp(signal), 1e-300), 3)) * max(np.ptp(signal), 1e-300)
    at = np.unique(np.quantile(spread, np.linspace(0.0, 1.0, knots)))
    return at[:0] if at.size < 3 else at


def response(numerator: list[float], denominator: list[float], h: float, columns: Array) -> Array:
    """Response of a transfer function to `columns` (..., n), held over steps of h s."""
    b, a, _ = cont2discrete((numerator, denominator), h)
    return np.asarray(lfilter(np.ravel(b), a, columns, axis=-1))


def families(
    drivers: dict[str, Array],
    transfer: tuple[list[float], list[float]] | None,
    h: float,
    what: str,
    unit: str,
) -> list[Basis]:
    """One family for each driving signal (n,), acting through a transfer function, or directly without one."""
    found = [Basis(of, what, unit, knots_of(s), s, transfer, h) for of, s in drivers.items()]
    return [basis for basis in found if basis.knots.size]


def changing(
    of: str,
    signal: Array,
    by: str,
    driver: Array,
    transfer: tuple[list[float], list[float]],
    h: float,
    what: str,
    unit: str,
) -> list[Basis]:
    """A missing quantity in proportion to a signal (n,), by a factor that changes with another, `driver` (n,).

    With time as driver something warms or wears; with the angle, a torque in proportion to acceleration is an inertia
    that is not the same everywhere. A free function of time alone is not offered: slow noise would pass for it.
    """
    knots = knots_of(driver, FACTOR_KNOTS)
    if not knots.size:
        return []
    return [Basis(f"{of}, changing with {by}", what, unit, knots, driver, transfer, h, signal)]


def explain(
    residual: Array,
    bases: list[Basis],
    rule: Whitener,
    white: Callable[[Array], Array],
    window: NDArray[np.int64],
) -> Leftover:
    """Regress a residual (n,) on all families at once, and on each alone, after `white` has made its noise independent.

    The probability of chance is that of the clearest of these tests, times their number. `window` is the number of
    the window to which each whitened value belongs.
    """
    target = white(residual)
    blocks, means = prepared(bases, rule, white)
    matrix = np.concatenate(blocks, axis=1) if blocks else np.empty((target.size, 0))
    coefficients, used, rest = solved(matrix, target)
    before = float(target @ target)
    gained = before - rest
    # the values of this signal alone: others of the same task are silent, and an offset takes one of each window
    windows = rule.windows(residual)
    spare = windows.size - (windows.shape[0] if rule.demean else 0) - used
    level = rest / max(spare, 1)
    p_values = [chance_of(gained, used, level, spare)]
    explained = np.zeros_like(windows)
    position = 0
    alone: dict[str, float] = {}
    curves: dict[str, tuple[Array, Array]] = {}
    held_out = again(matrix, target, window)
    for basis, block, rows in zip(bases, blocks, means, strict=True):
        width = block.shape[1]
        explained += np.tensordot(coefficients[position : position + width], rows, axes=1)
        position += width
        own, rank, left = solved(block, target)
        label = f"{basis.what}({basis.of})"
        gain = 0.5 * (before - left - rank * level)
        # one family alone stands out more clearly than in the crowd; each is one more chance of a false alarm
        p_values.append(chance_of(before - left, rank, level, spare) * len(bases))
        if gain > max(alone.values(), default=0.0):
            held_out = max(held_out, again(block, target, window))
        alone[label], curves[label] = gain, (basis.knots, own)
    rows = explained - explained.mean(axis=1, keepdims=True) if rule.demean else explained
    share = max(0.0, gained - used * level) / max(gained, 1e-300)
    return Leftover(
        min(1.0, 2.0 * min(p_values)),
        0.5 * (gained - used * level),
        float(np.sqrt(np.mean(rows**2) * share)),
        explained,
        dict(sorted(alone.items(), key=lambda item: -item[1])),
        curves,
        held_out,
    )


def prepared(
    bases: list[Basis], rule: Whitener, white: Callable[[Array], Array]
) -> tuple[list[Array], list[Array]]:
    """Columns of each family, whitened (values, k) and as bin means (k, windows, bins): their own rate is not needed."""
    blocks, means = [], []
    for basis in bases:
        pairs = [(white(column), rule.windows(column)) for column in basis.columns()]
        blocks.append(np.stack([column for column, _ in pairs], axis=1))
        means.append(np.stack([rows for _, rows in pairs]))
    return blocks, means


def chance_of(gained: float, used: int, level: float, spare: int) -> float:
    """Probability that `used` free parameters explain this much of noise of a `level` known from `spare` values."""
    if not used or level <= 0.0:
        return 1.0
    return float(fdtrc(used, max(spare, 1), max(gained, 0.0) / used / level))


def again(matrix: Array, target: Array, window: NDArray[np.int64]) -> float:
    """Log-likelihood that columns gain on each window with coefficients from all the others, summed up.

    Columns that the other windows hardly visit get hardly a coefficient (ridge, of the size that serves best: too small
    a one lets a single window beyond what the others visit undo what all the others gain).
    """
    sizes = np.sqrt(np.sum(matrix**2, axis=0))
    scaled = matrix[:, sizes > 0.0] / sizes[sizes > 0.0]
    gram, inner = scaled.T @ scaled, scaled.T @ target
    gains = np.zeros(len(RIDGES))
    for one in np.unique(window):
        mine = window == one
        columns, values = scaled[mine], target[mine]
        others, known = gram - columns.T @ columns, inner - columns.T @ values
        for i, ridge in enumerate(RIDGES):
            rest = values - columns @ np.linalg.solve(others + ridge * np.eye(gram.shape[0]), known)
            gains[i] += 0.5 * float(values @ values - rest @ rest)
    return float(gains.max())


def solved(matrix: Array, target: Array) -> tuple[Array, int, float]:
    """Least squares with columns of unit size and small singular values left out: (coefficients, rank, rest of squares)."""
    if matrix.shape[1] == 0:
        return np.empty(0), 0, float(target @ target)
    sizes = np.sqrt(np.mean(matrix**2, axis=0))
    live = sizes > 1e-12 * max(float(sizes.max()), 1e-300)
    scaled = matrix[:, live] / sizes[live]
    found, _, rank, _ = np.linalg.lstsq(scaled, target, rcond=1e-4)
    coefficients = np.zeros(matrix.shape[1])
    coefficients[live] = found / sizes[live]
    rest = target - scaled @ found
    return coefficients, int(rank), float(rest @ rest)
