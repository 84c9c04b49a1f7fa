"""Rows that hold several logs one behind the other: what is done to them is done to each by itself."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Cuts = tuple[int, ...]  # first sample of each piece but the first


def by_piece(function: Callable[..., NDArray[Any]], cuts: Cuts, *rows: NDArray[Any]) -> NDArray[Any]:
    """(..., n) what a function makes of rows (..., n), piece by piece: nothing passes from one log to the next."""
    if not cuts:
        return function(*rows)
    parts = zip(*(np.split(row, cuts, axis=-1) for row in rows), strict=True)
    return np.concatenate([function(*part) for part in parts], axis=-1)


def slope(values: Array, spacing: float | Array, cuts: Cuts = ()) -> Array:
    """(n,) derivative of values (n,), spaced evenly or at these places (n,), piece by piece."""
    if isinstance(spacing, np.ndarray):
        return by_piece(lambda y, x: np.asarray(np.gradient(y, x)), cuts, values, spacing)
    return by_piece(lambda y: np.asarray(np.gradient(y, spacing)), cuts, values)
