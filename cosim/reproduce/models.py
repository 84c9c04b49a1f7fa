"""The source's transfer functions, in its own units: degrees, mm, bar; Bode plots, poles and loops by python-control."""

from collections.abc import Mapping
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from cosim.report.picture import Layer, Panel, Picture, Role

Array = NDArray[np.float64]

VALVE_GAIN, W0, ZETA = 2.375, 25.23, 0.545  # (5.3), mm
K_PRESSURE, T = 5.28, 0.11  # (5.4), bar/mm
GAIN, POLE = 7.5e-6, 34.9  # (4.34) with the pole of (5.12), deg
AREA_ARM = 8419.3 * 100.0  # mm3
PRINTED = ((4.582e5,), (1.0, 71.5, 2164.0, 3.673e4, 2.02e5, 0.0))  # (5.12)


def simplified() -> Any:
    """(4.15): command to deg."""
    return control.tf([10.0], [1.0, 4.4, 0.0])


def full_order() -> Any:
    """(5.12) as printed: command to deg."""
    return control.tf(*(list(side) for side in PRINTED))


def valve() -> Any:
    """(5.3): command to mm."""
    return control.tf([VALVE_GAIN * W0**2], [1.0, 2.0 * ZETA * W0, W0**2])


def pressure() -> Any:
    """(5.4): mm to bar."""
    return control.tf([K_PRESSURE], [T, 1.0])


def mechanics() -> Any:
    """(5.5) with the values of contradiction 1: bar to deg."""
    return control.tf([GAIN * AREA_ARM], [1.0, POLE, 0.0])


def bode(
    key: str,
    title: str,
    plants: Mapping[str, tuple[Any, Role]],
    low: float,
    high: float,
    caption: str,
    points: tuple[str, Array, NDArray[np.complex128]] | None = None,
) -> Picture:
    """Magnitude and phase over frequency.

    Args:
        key: of the picture.
        title: of the picture.
        plants: name -> transfer function and role.
        low: lowest frequency [rad/s].
        high: highest frequency [rad/s].
        caption: of the picture.
        points: a measured response: its name, frequencies (m,) [rad/s] and values (m,).
    """
    w = np.geomspace(low, high, 400)
    magnitude, phase = list[Layer](), list[Layer]()
    if points is not None:
        name, at, response = points
        zero = np.zeros(at.size)
        magnitude.append(Layer("means", name, "measured", at, decibels(response), zero))
        phase.append(Layer("means", name, "measured", at, degrees(response), zero))
    for name, (plant, role) in plants.items():
        response = np.asarray(plant(1j * w))
        magnitude.append(Layer("line", name, role, w, decibels(response)))
        phase.append(Layer("line", name, role, w, degrees(response)))
    panels = [Panel("magnitude [dB]", magnitude), Panel("phase [deg]", phase)]
    return Picture(key, title, "frequency [rad/s]", panels, caption, log=True)


def decibels(response: NDArray[np.complex128]) -> Array:
    """20 log10 of the magnitude."""
    return np.asarray(20.0 * np.log10(np.abs(response)))


def degrees(response: NDArray[np.complex128]) -> Array:
    """Phase without jumps, that of the lowest frequency between -180 and 180 deg."""
    return np.asarray(np.rad2deg(np.unwrap(np.angle(response))))


def pole_map(key: str, title: str, plants: Mapping[str, tuple[Any, Role]], caption: str) -> Picture:
    """Poles in the complex plane."""
    layers = []
    for name, (plant, role) in plants.items():
        poles = np.asarray(plant.poles())
        layers.append(Layer("means", name, role, poles.real, poles.imag, np.zeros(poles.size)))
    return Picture(key, title, "real part [1/s]", [Panel("imaginary part [1/s]", layers)], caption)
