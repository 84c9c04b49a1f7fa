"""Transfer functions fitted to a frequency response, weighted by its uncertainty."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cosim.errors import DataError
from cosim.identify.data import Record
from cosim.identify.estimate import Fit
from cosim.identify.frf import Frf, stepped
from cosim.identify.linear import delayed, simulate
from cosim.identify.transfer_function import Structure, TransferFunction

Array = NDArray[np.float64]

TRUST = (
    2e-3  # of the response: no point is trusted beyond this, as the deviation does not know its own transient
)
CORRECTIONS = 3  # rounds of fit and correction
CORRECTION_ERROR = 0.03  # of a point's correction, that it may itself be wrong by


def fit_frf(frf: Frf, structure: Structure) -> TransferFunction:
    """Fit a transfer function to a frequency response by weighted least squares.

    The intervals are widened where the misfit is more than the points' own uncertainty accounts for.

    Raises:
        DataError: there are fewer points than the structure has free numbers, or they do not determine its poles.
    """
    count = 2 * frf.frequency.size
    if count < 2 * structure.size:
        raise DataError(
            f"{frf.frequency.size} points of a frequency response cannot determine {structure.size} numbers: take fewer"
            " poles, or an experiment with more frequencies"
        )
    weight = 1.0 / np.maximum(frf.deviation, TRUST * np.abs(frf.response))
    data = _real(frf.response * weight)

    def matrix(theta: Array) -> Array:
        s = 1j * frf.frequency
        shape = weight / np.polyval(structure.denominator(theta), s)
        if structure.delay:
            shape = shape * np.exp(-theta[-1] * s)
        return np.column_stack([_real(shape * s**j) for j in range(structure.zeros + 1)])

    def solved(theta: Array) -> tuple[Array, Array]:
        rows = matrix(theta)
        scale = np.linalg.norm(rows, axis=0)
        beta = np.linalg.lstsq(rows / scale, data, rcond=1e-12)[0] / scale
        return beta, data - rows @ beta

    q = structure.free + structure.delay
    tried = [
        least_squares(lambda t: solved(t)[1], start, bounds=structure.bounds(), x_scale="jac")
        for start in structure.starts()
    ]
    theta = np.asarray(min(tried, key=lambda r: float(r.cost)).x) if q else np.empty(0)
    beta, residual = solved(theta)
    jacobian = _jacobian(theta, beta, matrix)
    freedom = max(count - structure.size, 1)
    spread = max(float(residual @ residual) / freedom, 1.0)
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = 1.0
    influence = np.sqrt(spread) * np.linalg.pinv(jacobian / scale, rcond=1e-10) / scale[:, None]
    return TransferFunction(structure, Fit(theta, beta, [], [], influence, [], [], float(freedom)), ())


def without_transients(
    frf: Frf, records: Sequence[tuple[Record, Array]], found: TransferFunction
) -> tuple[Frf, TransferFunction]:
    """A stepped sine's response corrected for the transient in each period, and the fit to it.

    One period a frequency leaves the block no time to settle. The fitted model plays the same command, its periods are read
    back in the same way, and what they miss of its true response is taken off the measured points.

    Returns:
        The corrected response, whose deviation holds a share of the correction, and the new fit.
    """
    for _ in range(CORRECTIONS):
        played = [(replace(item, output=played_by(found, item)), u) for item, u in records]
        read = stepped(played)
        error = read.response - response_of(found, read.frequency)
        deviation = np.hypot(frf.deviation, CORRECTION_ERROR * np.abs(error))
        corrected = replace(frf, response=frf.response - error, deviation=deviation)
        found = fit_frf(corrected, found.structure)
    return corrected, found


def played_by(found: TransferFunction, item: Record) -> Array:
    """What a fitted transfer function makes of a record's input, from rest (n,)."""
    given = delayed(item.input, found.delay / item.step)
    return simulate(found.numerator.tolist(), found.denominator.tolist(), given, item.step, item.held)


def frf_best_fit(frf: Frf, found: TransferFunction) -> float:
    """Best fit % of the complex response."""
    model = response_of(found, frf.frequency)
    missed = float(np.linalg.norm(frf.response - model))
    return 100.0 * (1.0 - missed / float(np.linalg.norm(frf.response - frf.response.mean())))


def response_of(found: TransferFunction, frequency: Array) -> NDArray[np.complex128]:
    """Response (m,) of a fitted transfer function at frequencies (m,) [rad/s]."""
    s = 1j * frequency
    return np.asarray(
        np.polyval(found.numerator, s) / np.polyval(found.denominator, s) * np.exp(-found.delay * s),
        dtype=np.complex128,
    )


def _real(values: NDArray[np.complex128]) -> Array:
    return np.concatenate([values.real, values.imag])


def _jacobian(theta: Array, beta: Array, matrix: Callable[[Array], Array]) -> Array:
    """Weighted Jacobian in theta and numerator."""
    columns = []
    for i in range(theta.size):
        move = 1e-6 * max(abs(theta[i]), 1e-2)
        up, down = theta.copy(), theta.copy()
        up[i] += move
        down[i] -= move
        columns.append((matrix(up) @ beta - matrix(down) @ beta) / (2.0 * move))
    return np.column_stack([*columns, matrix(theta)])
