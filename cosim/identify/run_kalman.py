"""``cosim identify kalman``: gains of the extended observer and what its estimates are worth."""

import math
from collections.abc import Mapping

from cosim.identify.answer import Answer
from cosim.identify.estimate import Quantity
from cosim.identify.kalman import DEG, ExtendedObserver, Mechanics, Noises, design
from cosim.identify.nominal import declared

SHOWN = {"theta": ("slew angle", "deg", DEG), "omega": ("slew velocity", "deg/s", DEG),
         "tau": ("disturbance", "N.m", 1.0), "beta": ("sensor error", "deg", DEG)}  # fmt: skip


def kalman_answer(known: Mapping[str, float], noises: Noises) -> Answer:
    """The stationary Kalman filter for the drive's mechanics and these noises.

    Args:
        known: ``component.parameter`` -> SI.
        noises: what the filter is told.

    Raises:
        UsageError: there is no such filter, or it is too fast for the samples.
    """
    found = design(Mechanics.of(known), noises)
    values = {
        f"observer.{name}": Quantity(value, 0.0, 1.0, declared(f"observer.{name}").unit)
        for name, value in found.values().items()
    }
    deviations = found.deviations
    data = {
        "states": list(found.states),
        "gain": found.gain,
        "gain_of_a_reading": found.reading,
        "poles": [[float(p.real), float(p.imag)] for p in found.poles],
        "standard_deviation": {
            name: {"value": deviations[name] / SHOWN[name][2], "unit": SHOWN[name][1]}
            for name in found.states
        },
        "innovation": {"value": math.sqrt(found.innovation) / DEG, "unit": "deg"},
        "innovation_external": None
        if math.isnan(found.innovation_external)
        else {"value": math.sqrt(found.innovation_external) / DEG, "unit": "deg"},
    }
    answer = Answer("kalman", data, values, model="full_order_extended")
    answer.lines = lines(found)
    rows: list[list[object]] = [[name, f"{q.value:.6g}", q.unit] for name, q in values.items()]
    answer.tables.append(
        ("extended observer: stationary Kalman filter", ["parameter", "value", "unit"], rows)
    )
    return answer


def lines(found: ExtendedObserver) -> list[str]:
    """Poles and what the estimates are worth, in words."""
    poles = ", ".join(
        f"{p.real:.4g}"
        if abs(p.imag) < 1e-9
        else f"{p.real:.4g} {'+' if p.imag > 0.0 else '-'} {abs(p.imag):.4g}i"
        for p in found.poles
    )
    worth = ", ".join(
        f"{SHOWN[name][0]} {deviation / SHOWN[name][2]:.3g} {SHOWN[name][1]}"
        for name, deviation in found.deviations.items()
    )
    return [
        f"poles of the error: {poles} 1/s",
        f"standard deviation of the estimates, if noise and disturbance are as stated: {worth}",
        f"innovation of the slew sensor: {math.sqrt(found.innovation) / DEG:.4g} deg",
    ]
