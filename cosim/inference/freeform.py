"""What a residual still holds that can be told from the inputs: a free function of them, judged on windows it never saw."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cosim.inference.held_out import ratio_ci95, squares_by_block

Array = NDArray[np.float64]
MOST_SAMPLES = 12_000  # samples are looked at; of more every second, third and so on
HATS = 9  # of a function of one signal
MEMORIES = 6  # time constants
RIDGE = 1e-3  # of a feature's own power, per sample


@dataclass(frozen=True)
class Explained:
    """What free functions of some signals tell of a residual.

    Attributes:
        before, after: RMS on windows held out, without and with.
        ci95: of their ratio.
        by: signal -> share of the told variance that its functions bring.
        series: (n,) what is told, at every sample that was looked at.
    """

    before: float
    after: float
    ci95: tuple[float, float]
    by: dict[str, float]
    series: Array

    @property
    def size(self) -> float:
        """RMS of what is told, on windows held out."""
        return float(np.sqrt(max(self.before**2 - self.after**2, 0.0)))

    @property
    def sure(self) -> bool:
        """True if the interval excludes that nothing is told."""
        return self.ci95[1] < 1.0


def features(signal: Array, h: float) -> Array:
    """(k, n) functions of one signal (n,): values, speed, hats over its range, memories of several lengths."""
    low, high = np.quantile(signal, [0.005, 0.995])
    reach = max(float(high - low), 1e-300)
    x = (signal - 0.5 * (low + high)) / reach
    if float(np.ptp(signal)) <= 1e-12 * max(1.0, float(np.abs(signal).max())):
        return np.zeros((0, signal.size))
    speed = np.gradient(x)
    unit = speed / max(float(np.sqrt(np.mean(speed**2))), 1e-300)
    rows = [x, unit, np.tanh(3.0 * unit), unit * np.abs(x), x * np.tanh(3.0 * unit)]
    knots = np.unique(np.quantile(x, np.linspace(0.0, 1.0, HATS)))
    rows += [np.maximum(x - knot, 0.0) for knot in knots[1:-1]]
    longest = max(signal.size / 8.0, 4.0)
    for length in np.geomspace(2.0, longest, MEMORIES):
        a = float(np.exp(-1.0 / length))
        slow, _ = lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])
        rows += [slow, np.abs(x - slow)]
    return np.stack(rows)


def explained(
    residual: Array,
    signals: Mapping[str, Array],
    fitted: NDArray[np.bool_],
    windows: NDArray[np.int64],
    h: float,
) -> Explained:
    """What free functions of the signals tell of a residual (n,), fitted on one part and measured on the rest.

    Args:
        residual: in its unit.
        signals: (n,) each.
        fitted: (n,) the part to fit.
        windows: (n,) number of each sample's window.
        h: interval [s].
    """
    every = max(1, -(-residual.size // MOST_SAMPLES))
    r, inside, numbers = residual[::every], fitted[::every], windows[::every]
    names: list[str] = ["time", "time"]
    t = np.linspace(-1.0, 1.0, r.size)
    rows = [np.ones(r.size), t]
    for name, series in signals.items():
        found = list(features(series[::every], h * every))
        rows += found
        names += [name] * len(found)
    table = np.stack(rows)
    size = np.sqrt(np.mean(table[:, inside] ** 2, axis=1))
    keep = size > 1e-12
    table, names = table[keep] / size[keep, None], [n for n, k in zip(names, keep, strict=True) if k]
    part = table[:, inside]
    gram = part @ part.T + RIDGE * inside.sum() * np.eye(len(names))
    weights = np.linalg.solve(gram, part @ r[inside])
    series = weights @ table
    out = ~inside
    one, other = (squares_by_block((r - s)[out], numbers[out]) for s in (series, np.zeros_like(series)))
    by: dict[str, float] = {}
    for name in dict.fromkeys(names):
        mine = np.array([n == name for n in names])
        by[name] = float(np.var(weights[mine] @ table[mine]))
    total = max(sum(by.values()), 1e-300)
    before, after = (float(np.sqrt(np.mean(e[out] ** 2))) for e in (r, r - series))
    return Explained(before, after, ratio_ci95(one, other), {n: v / total for n, v in by.items()}, series)
