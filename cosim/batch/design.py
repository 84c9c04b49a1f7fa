"""The runs of a batch: which values of the parameters go together.

Sweeps make a grid or go side by side; ranges and distributions are drawn at random, by a Latin hypercube or by Sobol's
sequence (scipy.stats.qmc), each dimension through its quantile function.
"""

import itertools
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from cosim.batch.plan import Design
from cosim.batch.values import Distribution
from cosim.errors import UsageError
from cosim.ssp.system import Value

Array = NDArray[np.float64]
Row = dict[str, Value]
MOST_RUNS = 1_000_000


def grid(values: Mapping[str, list[Value]]) -> list[Row]:
    """Every combination, the last parameter changing fastest.

    Raises:
        UsageError: there are too many.
    """
    count = int(np.prod([float(len(column)) for column in values.values()]))
    if count > MOST_RUNS:
        raise UsageError(f"the grid has {count} runs, more than {MOST_RUNS}: take fewer values, or draw them")
    return [dict(zip(values, row, strict=True)) for row in itertools.product(*values.values())]


def side_by_side(values: Mapping[str, list[Value]]) -> list[Row]:
    """The first values together, then the second, and so on.

    Raises:
        UsageError: the parameters have different numbers of values.
    """
    counts = {name: len(column) for name, column in values.items()}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise UsageError(f"design 'zip' needs equally many values of every parameter: {told}")
    return [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]


def drawn(
    distributions: Mapping[str, Distribution],
    samples: int,
    design: Design,
    seed: int,
    correlations: Mapping[tuple[str, str], float] = MappingProxyType({}),
) -> tuple[list[Row], list[str]]:
    """Draws from distributions.

    Args:
        distributions: parameter -> what it is drawn from.
        samples: how many.
        design: "random", "latin_hypercube" or "sobol".
        seed: of the draws; the same seed gives the same draws.
        correlations: pair of parameters -> correlation of the normal values behind them (a Gaussian copula: each
            parameter keeps its own distribution); 0 for pairs that are not here.

    Returns:
        The rows, and notes for the user.

    Raises:
        UsageError: too many samples.
    """
    if samples > MOST_RUNS:
        raise UsageError(f"{samples} samples are more than {MOST_RUNS}")
    notes: list[str] = []
    size, parts = len(distributions), np.empty((0, 0))
    if design != "random":
        from scipy.stats import qmc  # half a second to load, which a grid does without
    if design == "sobol":
        power = max(0, int(np.ceil(np.log2(samples))))
        if 2**power != samples:
            notes.append(
                f"Sobol's sequence is balanced at powers of two: {2**power} samples in place of {samples}"
            )
        parts = qmc.Sobol(size, rng=seed).random_base2(power)
    elif design == "latin_hypercube":
        parts = qmc.LatinHypercube(size, rng=seed).random(samples)
    else:
        parts = np.random.default_rng(seed).random((samples, size))
    parts = dependent(parts, list(distributions), correlations)
    columns = {
        name: found.quantile(parts[:, k]).tolist() for k, (name, found) in enumerate(distributions.items())
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)], notes


def dependent(parts: Array, names: list[str], correlations: Mapping[tuple[str, str], float]) -> Array:
    """Parts between 0 and 1 (samples, names), made dependent as the correlations say; those of no pair stay as they are."""
    number = {name: k for k, name in enumerate(names)}
    matrix = np.eye(len(names))
    for (one, other), value in correlations.items():
        if one in number and other in number:
            matrix[number[one], number[other]] = matrix[number[other], number[one]] = value
    touched = np.flatnonzero((matrix != np.eye(len(names))).any(axis=1))
    if not touched.size:
        return parts
    # rounded correlations may miss being those of any distribution by a little: the nearest that are
    values, vectors = np.linalg.eigh(matrix[np.ix_(touched, touched)])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    root = root / np.linalg.norm(root, axis=1, keepdims=True)
    # lower triangular: the first of them keeps its own draws, and so its even spread
    lower = np.asarray(np.linalg.qr(root.T, mode="r")).T
    lower = lower * np.where(np.diag(lower) < 0.0, -1.0, 1.0)
    from scipy.special import ndtr, ndtri  # a fifth of a second, which a sweep does not need

    found = parts.copy()
    found[:, touched] = ndtr(ndtri(np.clip(parts[:, touched], 1e-12, 1.0 - 1e-12)) @ lower.T)
    return found


def crossed(first: list[Row], second: list[Row]) -> list[Row]:
    """Every row of the first with every row of the second.

    Raises:
        UsageError: there are too many.
    """
    if len(first) * len(second) > MOST_RUNS:
        raise UsageError(f"{len(first)} x {len(second)} runs are more than {MOST_RUNS}: take fewer")
    return [one | other for one in first for other in second]
