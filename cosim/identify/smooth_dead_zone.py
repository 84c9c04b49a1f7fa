"""The measured dead-zone curve by the source's smooth family: what command x opens the valve by y.

    x = y + d tanh(S y)        d = d_plus for y > 0, d_minus for y < 0                         (2.5), (4.9)
    response = k y + offset

It is the inverse of the compensator's own form, so d and S of a log are what that compensator should have. A valve with
sharp edges has S without bound: the curve is then as sharp as the log can tell. The response is taken as it stands the
chain's lag later, so the command must be slow: a ramp.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cosim.errors import DataError
from cosim.identify.dead_zone import DeadZone

Array = NDArray[np.float64]

SHARPEST = 500.0  # S beyond which a curve is no smoother than a thousandth of command
BLUNTEST = 2.0
BINS = 400  # of command, whose mean responses are fitted: a branch of a ramp is averaged with the other
TABLE_POINTS = 801  # of the curve's table


@dataclass(frozen=True)
class SmoothDeadZone:
    """A curve of the family.

    Attributes:
        d_plus, d_minus: [1] of full command.
        S: sharpness [1].
        deviations: of d_plus, d_minus and S.
        rmse: of the mean responses about the curve, in parts of the response at full command.
        rmse_sharp: the same about two straight lines with edges (2.2).
        sharp: S is at its upper bound: the log shows edges.
    """

    d_plus: float
    d_minus: float
    S: float
    deviations: tuple[float, float, float]
    rmse: float
    rmse_sharp: float
    sharp: bool


def opening(x: Array, d_plus: float, d_minus: float, S: float) -> Array:
    """Y (n,) of x = y + d tanh(S y) (n,); the curve rises everywhere, so it has one."""
    reach = max(float(np.abs(x).max()), 1e-9)
    # denser about zero, where the curve bends
    y = reach * np.linspace(-1.0, 1.0, TABLE_POINTS) ** 3
    return np.asarray(np.interp(x, y + np.where(y > 0.0, d_plus, d_minus) * np.tanh(S * y), y))


def smooth_dead_zone(found: DeadZone) -> SmoothDeadZone:
    """Fit the family to the log from which a dead zone was found.

    Raises:
        DataError: the response is the slew, whose curve is a rate, or only one side was entered.
    """
    if found.response == "slew":
        raise DataError(
            "the smooth curve needs the spool or the load pressure: the slew angle shows only its integral"
        )
    if len(found.sides) < 2:
        raise DataError("the smooth curve needs a command beyond the dead zone on both sides")
    x, y = _means(found)
    scale = float(np.abs(y).max())
    right, left = (found.sides[side]["break_point"].value for side in ("right", "left"))
    slope = found.sides["right"]["slope"].value / scale

    def residual(theta: Array) -> Array:
        k, offset, d_plus, d_minus, log_sharpness = theta
        return np.asarray(k * opening(x, d_plus, d_minus, np.exp(log_sharpness)) + offset - y / scale)

    low = [0.0, -1.0, 0.0, 0.0, np.log(BLUNTEST)]
    high = [np.inf, 1.0, 2.0, 2.0, np.log(SHARPEST)]
    fits = [
        least_squares(residual, [slope, 0.0, right, -left, np.log(start)], bounds=(low, high), x_scale="jac")
        for start in (10.0, 50.0, 200.0)
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    spread = np.linalg.pinv(best.jac.T @ best.jac) * 2.0 * best.cost / max(x.size - 5, 1)
    sharpness = float(np.exp(best.x[4]))
    deviations = np.sqrt(np.diag(spread)) * np.array([1.0, 1.0, 1.0, 1.0, sharpness])
    return SmoothDeadZone(
        float(best.x[2]),
        float(best.x[3]),
        sharpness,
        (float(deviations[2]), float(deviations[3]), float(deviations[4])),
        float(np.sqrt(np.mean(best.fun**2))),
        float(np.sqrt(np.mean((found.static(x) - y) ** 2))) / scale,
        sharpness > 0.98 * SHARPEST,
    )


def _means(found: DeadZone) -> tuple[Array, Array]:
    """Mean response in each bin of command, the response taken the lag later; within what the valve's limit leaves free."""
    item = found.record
    late = max(round(found.lag.value / item.step), 0)
    count = item.input.size - late
    x, y, keep = item.input[:count], item.output[late:], item.keep[:count] & item.keep[late:]
    x, y = x[keep], y[keep]
    place = np.minimum(((x - x.min()) / max(np.ptp(x), 1e-12) * BINS).astype(int), BINS - 1)
    number = np.bincount(place, minlength=BINS)
    full = number > 0
    middle = np.bincount(place, x, BINS)[full] / number[full]
    return middle, np.bincount(place, y, BINS)[full] / number[full]
