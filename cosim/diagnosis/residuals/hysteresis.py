"""Free functions of the path since the last reversal: whatever lags behind a motion that turns round.

A sum of stop operators (Prandtl and Ishlinskii; Visintin, Differential Models of Hysteresis, 1994) holds every lost motion:
a gap, several in series, and one that closes slowly.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.residuals.freeform import Basis
from cosim.inference.pieces import by_piece

Array = NDArray[np.float64]

PATHS = (0.002, 0.006, 0.02, 0.06, 0.2)  # of a signal's range: where the knots stand


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def stop(signal: Array, half: float) -> Array:
    """(n,) what of a signal (n,) a play of this half-width holds back: within -half .. half."""
    held = np.empty_like(signal)
    far = signal[0]
    for k in range(signal.size):
        far = max(signal[k] - half, min(signal[k] + half, far))
        held[k] = signal[k] - far
    return held


@dataclass(frozen=True)
class Reversals(Basis):
    """What is missing as a piecewise linear function of the path since the last reversal, constant beyond the last knot."""

    def columns(self) -> Iterator[Array]:
        """(n,) response of each hat in the observed signal."""
        widths = np.diff(self.knots, prepend=0.0)
        stops = np.stack(
            [by_piece(partial(stop, half=0.5 * knot), self.cuts, self.driver) for knot in self.knots]
        )
        for unit in np.eye(self.knots.size):
            # a hat over the path is a sum of ramps that end at the knots, and a stop is such a ramp
            slopes = np.diff(unit, prepend=0.0) / widths
            yield (slopes - np.append(slopes[1:], 0.0)) @ stops


def reversals(of: str, signal: Array, what: str, unit: str, h: float) -> list[Basis]:
    """The family of a signal (n,) that moves; none for one at rest."""
    reach = float(np.ptp(signal))
    if reach <= 0.0:
        return []
    return [Reversals(f"path of {of} since it turned", what, unit, reach * np.array(PATHS), signal, None, h)]
