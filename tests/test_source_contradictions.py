"""The figures of docs/contradictions.md, recomputed from the source's printed numbers.

Nothing here imports the models: these are checks of the source, and of what our document says about it.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares

TOP = Path(__file__).resolve().parent.parent
DOCUMENT = (TOP / "docs" / "contradictions.md").read_text(encoding="utf-8")

A, R = 8419.3, 100.0  # mm2, mm
K_VALVE, W0, ZETA = 2.375, 25.23, 0.545  # (5.3)
K_PRESSURE, T = 5.28, 0.11  # (5.4), Table 4.4 TF4
PRINTED_NUMERATOR = 4.582e5  # (5.12)
PRINTED_DENOMINATOR = (1.0, 71.5, 2164.0, 3.673e4, 2.02e5)


def chain(gain: float, pole: float) -> tuple[float, np.ndarray]:
    """Numerator and denominator (without the integrator) of the product of the blocks."""
    numerator = K_VALVE * W0**2 * K_PRESSURE / T * A * R * gain
    valve = [1.0, 2 * ZETA * W0, W0**2]
    return numerator, np.polymul(np.polymul(valve, [1.0, 1.0 / T]), [1.0, pole])


def round_to_digits_of(value: float, printed: float, digits: int) -> bool:
    return float(f"{value:.{digits - 1}e}") == printed


def documented(text: str) -> None:
    assert text in DOCUMENT, f"docs/contradictions.md does not state '{text}'"


def test_our_values_give_every_printed_digit_of_5_12() -> None:
    numerator, denominator = chain(7.5e-6, 34.9)
    assert round_to_digits_of(numerator, PRINTED_NUMERATOR, 4)
    for value, printed, digits in zip(denominator[1:], PRINTED_DENOMINATOR[1:], (3, 4, 4, 3), strict=True):
        assert round_to_digits_of(value, printed, digits), (value, printed)


@pytest.mark.parametrize(("gain", "pole"), [(1.0e-5, 39.4), (7.5e-6, 39.4), (1.0e-5, 34.9)])
def test_the_other_readings_do_not_give_5_12(gain: float, pole: float) -> None:
    numerator, denominator = chain(gain, pole)
    low_frequency = numerator / denominator[-1]
    printed = PRINTED_NUMERATOR / PRINTED_DENOMINATOR[-1]
    assert abs(low_frequency / printed - 1) > 0.1


def test_the_values_of_5_5_are_18_percent_too_fast() -> None:
    numerator, denominator = chain(1.0e-5, 39.4)
    ours, ours_denominator = chain(7.5e-6, 34.9)
    ratio = (numerator / denominator[-1]) / (ours / ours_denominator[-1])
    documented(f"{ratio:.3f} times as large")
    documented(f"{100 * (ratio - 1):.1f} % too fast")


def test_denominator_of_5_12_factors_into_the_blocks() -> None:
    roots = np.roots(PRINTED_DENOMINATOR)
    # the printed digits are 3 to 4, so the roots are good to about a percent
    real = np.sort(-roots[np.abs(roots.imag) < 1e-9].real)
    assert real == pytest.approx([1 / T, 34.9], rel=0.01)
    pair = roots[np.abs(roots.imag) > 1e-9]
    assert abs(pair[0]) == pytest.approx(W0, rel=0.01)
    documented(f"(s^2 + {2 * ZETA * W0:.2f} s + {W0**2:.1f})(s + {1 / T:.2f})(s + 34.9)")


def test_inertia_and_friction_in_si() -> None:
    inertia = 1e-4 / (7.5e-6 * math.pi / 180)  # 1 bar mm3 = 1e5 Pa x 1e-9 m3
    documented(f"J = 1e-4/(7.5e-6 pi/180) = {inertia:.2f} kg m2")
    documented(f"b = 34.9 J = {34.9 * inertia:,.0f} N m s/rad".replace(",", " "))


def test_only_the_mixed_units_of_contradiction_2_fit_5_12() -> None:
    si = K_VALVE * 1e-3 * W0**2 * (K_PRESSURE * 1e5 / 1e-3 / T) * A * 1e-6 * R * 1e-3 / 763.94
    assert math.degrees(si) == pytest.approx(PRINTED_NUMERATOR, rel=2e-4), (
        "SI blocks, the angle then turned into degrees"
    )
    assert abs(si / PRINTED_NUMERATOR - 1) > 0.9
    documented(f"{K_PRESSURE * 1e5 / 1e-3:.2e}".replace("e+08", "e8") + " Pa/m")


def test_no_reading_of_73_mm_gives_the_area() -> None:
    circle = math.pi * 73**2
    documented(f"pi 73^2 = {circle:.0f} mm2")
    documented(f"pi 73^2 / 4 = {circle / 4:.0f} mm2")
    assert all(abs(area / A - 1) > 0.4 for area in (circle, circle / 4))


def test_maximum_flow() -> None:
    flow = A * 5.7  # mm3/s
    documented(f"{round(flow, -1):,.0f} mm3/s".replace(",", " "))
    documented(f"{flow * 60e-6:.2f} l/min")
    documented(f"{2.84 / 60e-6 / A:.2f} mm/s")
    assert f"{flow * 60e-6:.2f}" != "2.84"


def orifice(drop: float) -> float:
    """Flow through one orifice with Cd A sqrt(2/rho) = 1."""
    return math.copysign(math.sqrt(abs(drop)), drop)


@pytest.mark.parametrize("supply_bar", [60.0, 170.0])
@pytest.mark.parametrize("share", [-0.6, 0.0, 0.3, 0.9])
def test_signs_of_4_18_conserve_mass_only_as_we_use_them(supply_bar: float, share: float) -> None:
    load = share * supply_bar
    # u > 0, steady motion: what enters A leaves B; PA is where both orifices pass the same flow
    p_a = brentq(
        lambda p: orifice(supply_bar - p) - orifice(p - load),
        max(load, 0.0),
        min(supply_bar, supply_bar + load),
    )
    q_a, outflow = orifice(supply_bar - p_a), orifice(p_a - load)
    assert q_a - outflow == pytest.approx(0.0, abs=1e-9)
    assert q_a + outflow > 0.1 * math.sqrt(supply_bar), "the printed sign: both sides fill"
    # (4.22) in its standard form: sqrt(2/rho drop) with 2/rho = 1 becomes sqrt((Ps - PL)/2)
    assert q_a == pytest.approx(math.sqrt((supply_bar - load) / 2), rel=1e-9)


def test_cylinder_pair_is_overdamped() -> None:
    w_mh = math.sqrt(317.1)
    zeta_mh = 0.14 * w_mh / 2
    documented(f"sqrt(317.1) = {w_mh:.1f} rad/s and zeta_mh = 0.14 x {w_mh:.1f}/2 = {zeta_mh:.2f}")
    slow, fast = sorted(-np.roots([1 / 317.1, 0.14, 1.0]).real)
    documented(f"{slow:.2f} and {fast:.1f}")
    exact = np.polymul([1.0, 1 / T], [1.0, 34.9])
    assert exact[2] == pytest.approx(317.1, rel=1e-3)
    assert f"{exact[1] / exact[2]:.2f}" == "0.14"
    documented(f"{exact[1]:.2f} s + {exact[2]:.1f}")
    documented(f"{exact[1] / exact[2]:.4f}")
    assert 3 * w_mh > 25.2, "the rule of thumb w_DCV > 3 w_mh fails"
    documented(f"25.2 < 3 x 17.8 = {3 * 17.8:.1f}")


def test_simplified_and_full_order_models_agree_at_low_frequency() -> None:
    simplified = 10 / 4.4
    numerator, denominator = chain(7.5e-6, 34.9)
    full = numerator / denominator[-1]
    assert simplified == pytest.approx(full, rel=2e-3)
    documented(f"{simplified:.2f} deg/s per unit command, is that of (5.12), {full:.2f} deg/s")


def decibels(value: np.ndarray | complex) -> np.ndarray:
    return 20.0 * np.log10(np.abs(value))


def test_the_simplified_model_is_no_two_pole_reduction_of_5_12() -> None:
    def full(w: np.ndarray | float) -> np.ndarray:
        return PRINTED_NUMERATOR / np.polyval((*PRINTED_DENOMINATOR, 0.0), 1j * np.asarray(w))

    def reduced(gain: float, pole: float, w: np.ndarray | float) -> np.ndarray:
        s = 1j * np.asarray(w)
        return gain / (s * (s + pole))

    w = np.linspace(0.1, 5.0, 491)

    def error(z: np.ndarray) -> np.ndarray:
        ratio = np.log(reduced(z[0], z[1], w) / full(w))
        return np.concatenate([ratio.real, ratio.imag])

    gain, pole = least_squares(error, [10.0, 4.4]).x
    documented(f"{gain:.1f}/(s(s + {pole:.1f}))")
    assert pole > 1.15 * 4.4
    worst = np.abs(decibels(reduced(gain, pole, w) / full(w))).max()
    documented(f"{worst:.1f} dB from it at most")
    behind = [-decibels(reduced(10.0, 4.4, one) / full(one)) for one in (1.0, 3.0, 5.0)]
    documented("{:.1f} dB low at 1 rad/s, {:.1f} dB at 3 rad/s and {:.1f} dB at 5 rad/s".format(*behind))
    documented(f"(4.15) is {behind[2]:.1f} dB below (5.12) at 5 rad/s")
