"""Sensor noise: how much, which colour, and one independent random stream for each purpose."""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.rig.parameters import BAR, DEG, STEP

KINDS = ("white", "ar1", "pink")
SIZES: dict[str, float] = {  # standard deviations (SI); the tracker's as the slew sensor's
    "spool": 0.005e-3,
    "p_supply": 0.1 * BAR,
    "p_a": 0.1 * BAR,
    "p_b": 0.1 * BAR,
    "slew": 0.01 * DEG,
    "slew_external": 0.01 * DEG,
}
UNITS = {"spool": "m", "p_supply": "Pa", "p_a": "Pa", "p_b": "Pa", "slew": "rad", "slew_external": "rad"}


def stream(seed: int, purpose: str) -> np.random.Generator:
    """A generator of its own for each purpose: hiding one effect leaves the noise of everything else as it was."""
    if seed < 0:
        raise UsageError(f"seed {seed} is negative: use a whole number from 0 on")
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


@dataclass(frozen=True)
class Noise:
    """Noise of the sensors.

    Attributes:
        scale: factor on all sizes; 0 is none.
        kind: ``white``, ``ar1`` (exponential correlation over `correlation_time`) or ``pink`` (power as 1/f).
        correlation_time: [s], of ``ar1``.
        sizes: standard deviation (SI) by signal, where it differs from SIZES.

    Raises:
        UsageError: an unknown kind or signal, or a negative number.
    """

    scale: float = 1.0
    kind: str = "white"
    correlation_time: float = 0.01
    sizes: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check all of it."""
        if self.kind not in KINDS:
            raise UsageError(f"unknown noise '{self.kind}': known are {', '.join(KINDS)}")
        if not (math.isfinite(self.scale) and self.scale >= 0.0):
            raise UsageError(f"noise scale {self.scale:g} must be 0 or more")
        if not self.correlation_time > 0.0:
            raise UsageError(f"noise correlation time {self.correlation_time:g} s must be above 0")
        for signal, size in self.sizes.items():
            if signal not in SIZES:
                raise UsageError(f"no noise on '{signal}': signals with noise are {', '.join(SIZES)}")
            if not (math.isfinite(size) and size >= 0.0):
                raise UsageError(f"noise size of {signal}, {size:g}, must be 0 or more")

    def size(self, signal: str) -> float:
        """Standard deviation (SI) of the noise on `signal`."""
        return self.scale * self.sizes.get(signal, SIZES[signal])

    def draw(self, signal: str, count: int, seed: int, step: float = STEP) -> NDArray[np.float64]:
        """`count` samples of noise (SI) on `signal`, `step` seconds apart; the same seed gives the same numbers."""
        return self.size(signal) * self.unit(f"noise {signal}", count, seed, step)

    def unit(self, purpose: str, count: int, seed: int, step: float = STEP) -> NDArray[np.float64]:
        """`count` samples of unit noise of this colour, `step` seconds apart, from the stream of `purpose`."""
        white = stream(seed, purpose).standard_normal(count)
        return _coloured(white, self.kind, step / self.correlation_time)

    def truth(self) -> dict[str, object]:
        """Kind, correlation time and sizes as plain data."""
        plain: dict[str, object] = {"kind": self.kind if self.scale > 0.0 else "none"}
        if self.kind == "ar1":
            plain["correlation_time"] = {"value": self.correlation_time, "unit": "s"}
        plain["standard_deviation"] = {s: {"value": self.size(s), "unit": UNITS[s]} for s in SIZES}
        return plain


def _coloured(white: NDArray[np.float64], kind: str, decay: float) -> NDArray[np.float64]:
    """Unit white noise (n,) turned into unit noise of `kind`; `decay` is the step over the correlation time."""
    if kind == "ar1":
        from scipy.signal import lfilter

        pole = math.exp(-decay)
        # the first sample already has the stationary size
        start = white[:1] * pole
        rest, _ = lfilter([math.sqrt(1.0 - pole * pole)], [1.0, -pole], white[1:], zi=start)
        return np.concatenate([white[:1], rest])
    if kind == "pink" and white.size > 1:
        spectrum = np.fft.rfft(white)
        order = np.arange(spectrum.size)
        gain = np.zeros(spectrum.size)
        gain[1:] = 1.0 / np.sqrt(order[1:])
        weight = np.where((order > 0) & (2 * order != white.size), 2.0, 1.0)
        gain *= math.sqrt(white.size / np.sum(weight * gain**2))
        return np.asarray(np.fft.irfft(spectrum * gain, white.size))
    return white
