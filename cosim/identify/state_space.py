"""State space, controllability, observability, root locus and the observer's gain, by python-control.

    x1' = -a x1 + k u        y = c x2                           (4.35)-(4.38)
    x2' =    x1
    x^' = A x^ + B u + L (y - C x^)                             (2.15)

In the source's numbers (degrees): a = 4.4, k = 4, c = 2.5; its observer's poles are -3 and -1.5 times the fastest pole of
the plant, -13.2 and -6.6, and L = [7.744, 6.16].
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError

Array = NDArray[np.float64]

FASTER = (3.0, 1.5)  # times the fastest plant pole, (2.15)
OUTPUT_GAIN = 2.5  # deg, C2 of (4.37)
SAMPLING = 1e-3  # s, of the target that runs the observer
COARSE = 0.2  # an observer pole times the step that is no longer a continuous pole


@dataclass(frozen=True)
class StateSpace:
    """The simplified drive in state space, angles in degrees as the source has them.

    Attributes:
        A, B, C: matrices of (4.35)-(4.37).
    """

    A: Array
    B: Array
    C: Array

    @property
    def controllability(self) -> int:
        """Rank of [B, A B]."""
        import control

        return int(np.linalg.matrix_rank(control.ctrb(self.A, self.B)))

    @property
    def observability(self) -> int:
        """Rank of [C; C A]."""
        import control

        return int(np.linalg.matrix_rank(control.obsv(self.A, self.C)))

    @property
    def poles(self) -> Array:
        """Poles of the plant [1/s]."""
        return np.asarray(np.linalg.eigvals(self.A))


@dataclass(frozen=True)
class ModalForm:
    """The same system with a state for each pole: ``x = T z``, ``z' = diag(poles) z + T^-1 B u``, ``y = C T z``.

    Attributes:
        poles: (n,) [1/s], the slowest first.
        T: (n, n) its modes, each scaled so that its entry in the last state is 1.
        B: (n, 1) how strongly the input drives each mode.
        C: (1, n) how much of each mode the output shows.
    """

    poles: Array
    T: Array
    B: Array
    C: Array


@dataclass(frozen=True)
class Observer:
    """An observer.

    Attributes:
        plant: what it observes.
        poles: where its own poles are [1/s].
        gain: L (2,), angles in degrees.
        placed: its poles as they come out with that gain.
    """

    plant: StateSpace
    poles: tuple[float, float]
    gain: Array
    placed: Array


def drive(gain: float = 10.0, pole: float = 4.4, output: float = OUTPUT_GAIN) -> StateSpace:
    """(4.35)-(4.37) of ``gain / (s (s + pole))`` in degrees: (4.15) has 10 and 4.4."""
    a = np.array([[-pole, 0.0], [1.0, 0.0]])
    return StateSpace(a, np.array([[gain / output], [0.0]]), np.array([[0.0, output]]))


def design_observer(plant: StateSpace, poles: Sequence[float] = ()) -> Observer:
    """Place the observer's poles (2.15).

    Args:
        plant: what it observes.
        poles: two negative numbers [1/s]; -3 and -1.5 times the fastest plant pole by default.

    Raises:
        UsageError: the poles are not two negative ones, or too fast for the 1 kHz target.
    """
    import control

    fastest = float(np.max(np.abs(plant.poles)))
    wanted = tuple(poles) or tuple(-factor * fastest for factor in FASTER)
    if len(wanted) != 2 or not all(np.isfinite(p) and p < 0.0 for p in wanted):
        raise UsageError(
            f"an observer of two states needs two negative poles, such as -13.2 and -6.6, not {list(wanted)}"
        )
    if max(-p for p in wanted) * SAMPLING > COARSE:
        raise UsageError(
            f"a pole of {min(wanted):g} 1/s is too fast for an observer at 1 kHz: stay above {-COARSE / SAMPLING:g} 1/s"
        )
    if plant.observability < plant.A.shape[0]:
        raise UsageError("the plant is not observable from its output: no gain places the observer's poles")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PendingDeprecationWarning of np.matrix inside python-control
        # acker: place() refuses a double pole with one output
        gain = np.asarray(control.acker(plant.A.T, plant.C.T, list(wanted))).ravel()
    placed = np.sort(np.linalg.eigvals(plant.A - np.outer(gain, plant.C)).real)
    return Observer(plant, (float(wanted[0]), float(wanted[1])), gain, placed)


def modal_form(plant: StateSpace) -> ModalForm:
    """The modal form of a system with distinct real poles.

    Raises:
        UsageError: two poles coincide or are complex: there is no such form.
    """
    import control

    poles, T = np.linalg.eig(plant.A)
    near = min((abs(p - q) for i, p in enumerate(poles) for q in poles[:i]), default=np.inf)
    if np.iscomplexobj(poles) or near <= 1e-6 * float(np.max(np.abs(poles))):
        raise UsageError(
            f"poles {poles.tolist()} are not real and distinct: there is no modal form of real modes"
        )
    order = np.argsort(np.abs(poles))
    T = T[:, order] / T[-1, order]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PendingDeprecationWarning of np.matrix inside python-control
        found = control.similarity_transform(control.ss(plant.A, plant.B, plant.C, 0.0), np.linalg.inv(T))
    return ModalForm(poles[order], T, np.asarray(found.B), np.asarray(found.C))


def error_dynamics(observer: Observer) -> StateSpace:
    """(2.16): ``e' = (A - L C) e``, driven by noise of the measured angle through -L and seen through C."""
    plant = observer.plant
    return StateSpace(plant.A - np.outer(observer.gain, plant.C), -observer.gain[:, None], plant.C)


def observer_values(observer: Observer) -> dict[str, float]:
    """Parameters of the component `observer` (SI)."""
    degree = np.pi / 180.0
    return {
        "observer.a": -float(observer.plant.A[0, 0]),
        "observer.k": float(observer.plant.B[0, 0]),
        "observer.c": float(observer.plant.C[0, 1]) * degree,
        "observer.p1": observer.poles[0],
        "observer.p2": observer.poles[1],
    }


@dataclass(frozen=True)
class RootLocus:
    """Poles of the loop with proportional control (5.2), command per degree of error.

    Attributes:
        gains: (m,).
        poles: (m, n) [1/s], each column one branch.
        limit: smallest gain at which a pole is in the right half plane; infinite if there is none.
        margins: gain margin, phase margin [deg] at gain 1.
    """

    gains: Array
    poles: NDArray[np.complex128]
    limit: float
    margins: tuple[float, float]


def root_locus(
    numerator: Sequence[float], denominator: Sequence[float], gains: Array | None = None
) -> RootLocus:
    """Root locus of ``k B(s)/A(s)`` in negative feedback, angles in degrees.

    Args:
        numerator: falling powers.
        denominator: falling powers.
        gains: (m,) >= 0; by default 0 to well beyond the limit of stability.
    """
    import control

    plant = control.tf(list(numerator), list(denominator))
    margin, phase, *_ = control.margin(plant)
    top = 3.0 * margin if np.isfinite(margin) else 20.0 * abs(denominator[-2] / numerator[-1])
    values = (
        np.concatenate([[0.0], np.geomspace(1e-3 * top, top, 400)]) if gains is None else np.asarray(gains)
    )
    found = control.root_locus_map(plant, gains=values)
    return RootLocus(values, np.asarray(found.loci), float(margin), (float(margin), float(phase)))
