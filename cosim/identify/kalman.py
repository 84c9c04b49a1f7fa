"""Gains of the extended observer (`fmus/observer_extended.py`): the stationary Kalman filter, by python-control.

    x = (theta, omega, tau, beta),  x' = A x + B A_c r PL + w,  slew = theta + beta + v,  tracker = theta + v_e

tau and beta are first-order Gauss-Markov processes, w holds what drives them and the noise of the load pressure. Noise of
samples taken every h counts as white noise of density variance * h. The same filter runs in samples, with the tracker's
readings between: its own covariance is that of the sampled recursion, so that an estimate can be held against it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError

Array = NDArray[np.float64]

DEG, BAR = math.pi / 180.0, 1e5
STATES = ("theta", "omega", "tau", "beta")
LONGEST_PERIOD = 2000  # steps after which sensor and tracker must have come round to the same phase


@dataclass(frozen=True)
class Noises:
    """What the filter is told of noise and disturbance, SI.

    Attributes:
        slew: standard deviation of a sample of the slew sensor [rad].
        p_load: of a sample of the load pressure [Pa]; 0 where it comes from a model.
        disturbance: of the disturbance torque [N.m], with its correlation time `T_tau` [s]; 0: there is none.
        sensor_error: of the slew sensor's slow error [rad], with its correlation time `T_beta` [s]; 0: there is none.
        tracker: of a reading of the tracker [rad]; 0: there is no tracker.
        tracker_step: time between two readings [s].
        step: time between two samples of the log [s].

    Raises:
        UsageError: a number that makes no sense, or a sensor error that nothing shows.
    """

    slew: float = 0.01 * DEG
    p_load: float = 0.1 * math.sqrt(2.0) * BAR
    disturbance: float = 100.0
    T_tau: float = 1.0
    sensor_error: float = 0.0
    T_beta: float = 10.0
    tracker: float = 0.0
    tracker_step: float = 1.0 / 80.0
    step: float = 1e-3

    def __post_init__(self) -> None:
        """Check all of it."""
        above = {n: getattr(self, n) for n in ("slew", "T_tau", "T_beta", "tracker_step", "step")}
        for name, value in above.items():
            if not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"the extended observer needs {name} above 0, not {value:g}")
        for name in ("p_load", "disturbance", "sensor_error", "tracker"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name} is a standard deviation: 0 or more, not {value:g}")
        if self.disturbance == 0.0 and self.p_load == 0.0:
            raise UsageError(
                "without disturbance and noise of the load pressure the model is exact: give a disturbance"
            )
        if self.sensor_error > 0.0 and self.tracker == 0.0:
            raise UsageError(
                "an error of the slew sensor shows only beside the tracker: give the noise of its readings too"
            )


@dataclass(frozen=True)
class Mechanics:
    """The part of the drive that the filter corrects: ``J omega' = A r PL - b omega + tau``, SI."""

    J: float
    b: float
    A: float
    r: float

    @classmethod
    def of(cls, values: Mapping[str, float]) -> "Mechanics":
        """From ``mechanical.J`` and its like."""
        return cls(*(values[f"mechanical.{name}"] for name in ("J", "b", "A", "r")))


@dataclass(frozen=True)
class ExtendedObserver:
    """The designed filter, SI.

    Attributes:
        noises, mechanics: what it was designed for.
        states: those of `STATES` that it has, in order.
        gain: (n,) of the slew sensor, per second.
        reading: (n,) of a reading of the tracker; zeros without one.
        poles: (n,) of the estimate's error, in continuous time [1/s].
        covariance: (n, n) of the error of the sampled filter, mean over the steps.
        innovation: variance of the slew sensor's innovation [rad2], mean over the steps.
        innovation_external: of the tracker's [rad2]; NaN without one.
    """

    noises: Noises
    mechanics: Mechanics
    states: tuple[str, ...]
    gain: Array
    reading: Array
    poles: NDArray[np.complex128]
    covariance: Array
    innovation: float
    innovation_external: float

    @property
    def deviations(self) -> dict[str, float]:
        """State -> standard deviation of its estimate."""
        return dict(zip(self.states, np.sqrt(np.diag(self.covariance)), strict=True))

    def values(self) -> dict[str, float]:
        """Parameters of the block `observer_extended`, by name."""
        n, m = self.noises, self.mechanics
        found = {"J": m.J, "b": m.b, "A": m.A, "r": m.r}
        found |= {
            "T_tau": n.T_tau if "tau" in self.states else 0.0,
            "T_beta": n.T_beta if "beta" in self.states else 0.0,
        }
        for letter, gains in (("l", self.gain), ("k", self.reading)):
            have = dict(zip(self.states, gains, strict=True))
            found |= {f"{letter}_{name}": float(have.get(name, 0.0)) for name in STATES}
        return found


def matrices(mechanics: Mechanics, noises: Noises) -> tuple[tuple[str, ...], Array, Array, Array]:
    """States, dynamics A (n, n), density W (n, n) of the noise that drives them, and outputs C (2, n): slew, tracker."""
    states = tuple(
        name
        for name, there in zip(
            STATES, (True, True, noises.disturbance > 0.0, noises.sensor_error > 0.0), strict=True
        )
        if there
    )
    A, W, C = np.zeros((4, 4)), np.zeros((4, 4)), np.array([[1.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]])
    m, n = mechanics, noises
    A[0, 1], A[1, 1], A[1, 2] = 1.0, -m.b / m.J, 1.0 / m.J
    A[2, 2], A[3, 3] = -1.0 / n.T_tau, -1.0 / n.T_beta
    W[1, 1] = (m.A * m.r / m.J * n.p_load) ** 2 * n.step
    W[2, 2] = 2.0 * n.disturbance**2 / n.T_tau
    W[3, 3] = 2.0 * n.sensor_error**2 / n.T_beta
    keep = [STATES.index(name) for name in states]
    return states, A[np.ix_(keep, keep)], W[np.ix_(keep, keep)], C[:, keep]


def design(mechanics: Mechanics, noises: Noises) -> ExtendedObserver:
    """The stationary Kalman filter for this drive and these noises.

    Raises:
        UsageError: there is no such filter, or it is too fast for the step.
    """
    import control

    states, A, W, C = matrices(mechanics, noises)
    n = noises
    rows = [0, 1] if n.tracker > 0.0 else [0]
    R = np.array([n.slew**2 * n.step, n.tracker**2 * n.tracker_step])[rows]
    # torques and angles differ by ten orders of magnitude: each state in a size of its own, for the Riccati equation
    size = {"theta": n.slew, "omega": n.slew, "tau": n.slew * mechanics.J, "beta": n.slew}
    S = np.diag([size[name] for name in states])
    inner = np.linalg.solve(S, A @ S)
    drive = np.linalg.solve(S, np.linalg.solve(S, W).T)
    outer = C[rows] @ S / n.slew
    try:
        L, _, poles = control.lqe(inner, np.eye(len(states)), outer, drive, np.diag(R) / n.slew**2)
    except (np.linalg.LinAlgError, ValueError, control.ControlException) as error:
        raise UsageError(f"there is no stationary Kalman filter for these numbers: {error}") from None
    gains = S @ np.asarray(L) / n.slew
    reading = gains[:, 1] * n.tracker_step if n.tracker > 0.0 else np.zeros(len(states))
    covariance, innovation, external = sampled(A, W, C, gains[:, 0], reading, noises)
    return ExtendedObserver(
        noises,
        mechanics,
        states,
        gains[:, 0],
        reading,
        np.asarray(poles, dtype=np.complex128),
        covariance,
        innovation,
        external,
    )


def sampled(
    A: Array, W: Array, C: Array, gain: Array, reading: Array, noises: Noises
) -> tuple[Array, float, float]:
    """Covariance of the sampled filter's error in steady state, and the variances of its innovations.

    A sensor's sample and a tracker's reading meet again after some steps; over these the error is a linear map of itself
    with noise added, whose fixed point python-control finds.

    Args:
        A: dynamics, of `matrices`.
        W: density of the noise, of `matrices`.
        C: outputs, of `matrices`.
        gain: (n,) per second.
        reading: (n,) per reading of the tracker.
        noises: of the samples.

    Returns:
        (n, n) covariance behind the correction, mean over the steps; variance of the innovation of the slew sensor, and of
        the tracker (NaN without one).

    Raises:
        UsageError: the error does not die out: the filter is too fast for its samples.
    """
    import control

    n, h = A.shape[0], noises.step
    F, Q = discretised(A, W, h)
    kept = np.eye(n) - h * np.outer(gain, C[0])
    noise = (h * noises.slew) ** 2 * np.outer(gain, gain)
    corrections = [_reading(A, C[1], reading, age) for age in _ages(noises)]
    M, V = np.eye(n), np.zeros((n, n))
    for correction in corrections:
        M, V = kept @ F @ M, kept @ (F @ V @ F.T + Q) @ kept.T + noise
        if correction is not None:
            M, V = (
                correction @ M,
                correction @ V @ correction.T + noises.tracker**2 * np.outer(reading, reading),
            )
    if np.max(np.abs(np.linalg.eigvals(M))) >= 1.0:
        raise UsageError(
            f"this filter is too fast for samples every {h:g} s and readings every {noises.tracker_step:g} s: "
            "state more noise of the sensors or less disturbance"
        )
    size = np.sqrt(np.diag(V)) + 1e-300
    scale = np.outer(size, size)
    P = scale * np.asarray(control.dlyap(M * size / size[:, None], 0.5 * (V + V.T) / scale))
    total, slew, external = np.zeros((n, n)), 0.0, []
    for correction, age in zip(corrections, _ages(noises), strict=True):
        P = F @ P @ F.T + Q
        slew += float(C[0] @ P @ C[0]) + noises.slew**2
        P = kept @ P @ kept.T + noise
        if correction is not None and age is not None:
            seen = C[1] - age * A[0]
            external.append(float(seen @ P @ seen) + noises.tracker**2)
            P = correction @ P @ correction.T + noises.tracker**2 * np.outer(reading, reading)
        total += P
    count = len(corrections)
    return total / count, slew / count, float(np.mean(external)) if external else math.nan


def _reading(A: Array, c: Array, reading: Array, age: float | None) -> Array | None:
    """What a reading that is `age` old leaves of the error, (n, n); None where there is none."""
    return None if age is None else np.eye(A.shape[0]) - np.outer(reading, c - age * A[0])


def _ages(noises: Noises) -> list[float | None]:
    """Of each step until sensor and tracker meet again: age of the reading that it ends with, s, or None."""
    if noises.tracker == 0.0:
        return [None]
    ratio = Fraction(noises.tracker_step / noises.step).limit_denominator(100)
    if ratio < 1 or ratio.numerator > LONGEST_PERIOD:
        raise UsageError(
            f"readings every {noises.tracker_step:g} s and samples every {noises.step:g} s: the tracker must be the "
            f"slower one, and both meet again within {LONGEST_PERIOD} samples"
        )
    found: list[float | None] = [None] * ratio.numerator
    for k in range(1, ratio.denominator + 1):
        ending = math.ceil(k * ratio)
        found[ending - 1] = float(ending - k * ratio) * noises.step
    return found


def discretised(A: Array, W: Array, h: float) -> tuple[Array, Array]:
    """Transition matrix and covariance of the noise over h (Van Loan, IEEE Trans. Automatic Control 23, 1978)."""
    from scipy.linalg import expm

    n = A.shape[0]
    block = expm(np.block([[-A, W], [np.zeros((n, n)), A.T]]) * h)
    F = block[n:, n:].T
    return F, F @ block[:n, n:]
