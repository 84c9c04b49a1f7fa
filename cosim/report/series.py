"""Series made ready to be looked at: thinned without losing peaks, smoothed, binned, aligned on steps."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_BUCKETS = (
    6000  # buckets of a thinned series: 100 Hz over a minute, and files of one size whatever the log's length
)


def bucket(n: int, h: float, most: int = MOST_BUCKETS) -> int:
    """Samples in one bucket of a thinned series of n samples: 10 ms, more for logs longer than `most` buckets."""
    return max(1, round(0.01 / h), -(-n // most))


def envelope(values: Array, size: int) -> tuple[Array, Array]:
    """Positions (2k,) in samples and values (2k,): smallest and largest of each bucket of `size`, in the order they come.

    A last bucket that is not full is left out.
    """
    k = values.size // size
    if size == 1 or k == 0:
        return np.arange(values.size, dtype=np.float64), values.copy()
    rows = values[: k * size].reshape(k, size)
    both = np.sort(np.stack([rows.argmin(axis=1), rows.argmax(axis=1)], axis=1), axis=1)
    at = (np.arange(k)[:, None] * size + both).ravel()
    return at.astype(np.float64), values[at]


def averaged(values: Array, size: int) -> tuple[Array, Array]:
    """Positions (k,) in samples and means (k,) of buckets of `size` samples."""
    k = values.size // size
    at = (np.arange(k, dtype=np.float64) + 0.5) * size - 0.5
    return at, np.asarray(values[: k * size].reshape(k, size).mean(axis=1), dtype=np.float64)


def binned(x: Array, y: Array, independent: float, count: int = 24) -> tuple[Array, Array, Array]:
    """Means of x and y, (k,), and two standard errors of y in bins of equal width over x.

    Args:
        x: (n,).
        y: (n,).
        independent: independent values a sample; a smoothed signal has fewer than samples.
        count: bins at most; those with too little in them are left out.
    """
    if x.size < 2 or np.ptp(x) == 0.0:
        return np.empty(0), np.empty(0), np.empty(0)
    which = np.clip(((x - x.min()) / np.ptp(x) * count).astype(int), 0, count - 1)
    number = np.bincount(which, minlength=count).astype(np.float64)
    full = number * independent >= 3.0
    safe = np.maximum(number, 1.0)
    mean_x, mean_y = (np.bincount(which, v, minlength=count) / safe for v in (x, y))
    variance = np.bincount(which, (y - mean_y[which]) ** 2, minlength=count) / safe
    error = 2.0 * np.sqrt(variance / np.maximum(number * independent, 1.0))
    return mean_x[full], mean_y[full], error[full]


def steady(u: Array, h: float, span: float = 0.06, most: float = 0.2) -> Mask:
    """(n,) True where a command changes by no more than `most` within `span` s on either side."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    width = 2 * max(1, round(span / h)) + 1
    return np.asarray(maximum_filter1d(u, width) - minimum_filter1d(u, width) <= most)


def steps_of(
    u: Array, h: float, least: float = 0.05, hold: float = 0.25
) -> dict[tuple[float, float], NDArray[np.intp]]:
    """Steps of a command: (from, to), rounded to 0.01 -> samples at which it has just jumped.

    A step counts if the command has stood for `hold` s before and stands for `hold` s after it.
    """
    width = max(1, round(hold / h))
    jumps = np.flatnonzero(np.abs(np.diff(u)) >= least) + 1
    found: dict[tuple[float, float], list[int]] = {}
    for k in jumps.tolist():
        if k < width or k + width > u.size:
            continue
        if np.ptp(u[k - width : k]) < 1e-3 and np.ptp(u[k : k + width]) < 1e-3:
            found.setdefault((round(float(u[k - 1]), 2), round(float(u[k]), 2)), []).append(k)
    return {pair: np.array(at) for pair, at in found.items()}


def reversals(angle: Array, least: float) -> list[tuple[int, int, int]]:
    """Turning points of a motion: (sample, last sample of the motion after it, new direction).

    A turn counts where the motion before and after it spans more than `least`.
    """
    turns: list[tuple[int, int]] = []  # (sample of the extreme, direction after it)
    low = high = 0
    direction = 0
    for k in range(angle.size):
        if angle[k] > angle[high]:
            high = k
        if angle[k] < angle[low]:
            low = k
        if direction >= 0 and angle[high] - angle[k] > least:
            turns.append((high, -1))
            direction, low, high = -1, k, k
        elif direction <= 0 and angle[k] - angle[low] > least:
            turns.append((low, 1))
            direction, low, high = 1, k, k
    if not turns:
        return []
    ends = [*[t for t, _ in turns[1:]], angle.size - 1]
    return [(t, end, d) for (t, d), end in zip(turns, ends, strict=True)][1:]
