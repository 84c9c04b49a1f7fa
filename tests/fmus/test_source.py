"""The source's printed numbers, from the blocks themselves (SYSTEM sections 4 to 9).

Once from what the blocks do: their step functions give the discrete transition of the whole chain, whose eigenvalues are
exp(pole h). Once from their parameters, with python-control.
"""

import math

import control
import numpy as np
import pytest
from fmu_bench import bare, run

H = 1e-3
NAMES = ("dcv", "continuity", "mechanical")
PRINTED = {"gain": (4.582e5, 4), "s3": (71.5, 3), "s2": (2164.0, 4), "s1": (3.673e4, 4), "s0": (2.02e5, 3)}


def printed_digits(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")


def chain_step(state: np.ndarray, u: float) -> np.ndarray:
    """States of valve, pressure and mechanics after one step with u held, one block after the other."""
    after, k, signal = [], 0, u
    for name in NAMES:
        composed = bare(name)
        r = run(composed, H, [0.0], {"x_min": -1.0, "x_max": 1.0, "v_max": 100.0} if name == "dcv" else {})
        n = len(r.x)
        r.x = type(r.x)(*(float(v) for v in state[k : k + n]))
        outputs = r.step(signal)
        after += list(r.x)
        k, signal = k + n, outputs[0]
    return np.array(after)


def transition() -> tuple[np.ndarray, np.ndarray]:
    """Matrices of x -> F x + g u of the chain, column by column."""
    sizes = np.array(
        [1e-3, 1e-2, 1e5, 1e-3, 1.0, 0.01, 1e3, 1e-5]
    )  # of spool, speed, PL, opening, theta, omega, torque, bristle
    F = np.column_stack([chain_step(np.eye(8)[k] * sizes[k], 0.0) / sizes[k] for k in range(8)])
    return F, chain_step(np.zeros(8), 1.0)


def from_behaviour() -> dict[str, float]:
    """Coefficients of (5.12) from eigenvalues and low-frequency gain of the chain's discrete transition."""
    F, g = transition()
    eigenvalues = np.linalg.eigvals(F)
    lasting = eigenvalues[np.abs(eigenvalues) > 0.5]  # the previous opening and torque are forgotten at once
    poles = np.log(lasting.astype(complex)) / H
    poles = poles[np.abs(poles) > 1e-6]  # the integrator aside
    denominator = np.poly(poles).real
    # moving steadily under u = 1: all but the angle stand still
    others = [0, 1, 2, 3, 5, 6, 7]
    still = np.linalg.solve(np.eye(7) - F[np.ix_(others, others)], g[others])
    slope = math.degrees(still[4])
    return dict(zip(PRINTED, [slope * denominator[4], *denominator[1:]], strict=True))


def from_parameters() -> dict[str, float]:
    """The same from the product of the blocks' transfer functions."""
    valve, pressure, drive = (run(bare(n), H, [0.0]).p for n in NAMES)
    s = control.tf("s")
    product = (
        valve.K * valve.w0**2 / (s**2 + 2 * valve.zeta * valve.w0 * s + valve.w0**2)
        * pressure.K_c / (pressure.T * s + 1)
        * math.degrees(drive.A * drive.r) / (s * (drive.J * s + drive.b))
    )  # fmt: skip
    numerator, denominator = product.num[0][0], product.den[0][0]
    assert denominator[-1] == 0.0, "an integrator"
    return dict(zip(PRINTED, np.array([numerator[-1], *denominator[1:-1]]) / denominator[0], strict=True))


@pytest.mark.parametrize("origin", [from_behaviour, from_parameters])
def test_every_printed_digit_of_5_12(origin) -> None:
    found = origin()
    for name, (value, digits) in PRINTED.items():
        assert printed_digits(found[name], digits) == value, name


def test_behaviour_and_parameters_agree() -> None:
    # eigenvalues near 1 and the logarithm over 1 ms cost four digits
    assert from_behaviour() == pytest.approx(from_parameters(), rel=1e-9)


def test_frequency_response_of_the_chain_is_5_12() -> None:
    """Over 0.1..70 rad/s, the range of section 8; holding u over 1 ms alone delays by half a step, which is taken out."""
    F, g = transition()
    w = np.geomspace(0.1, 70.0, 40)
    z = np.exp(1j * w * H)
    numerator, *denominator = from_parameters().values()
    s = 1j * w
    exact = numerator / (s * np.polyval([1.0, *denominator], s))
    theta = np.array([np.linalg.solve(x * np.eye(8) - F, g)[4] for x in z]) * 180 / math.pi
    held = (1 - 1 / z) / (s * H)
    # aliases and the straight lines between blocks: (w h)^2/12 at most
    assert np.abs(theta / (exact * held) - 1).max() < 2 * (70 * H) ** 2 / 12 * 3


def test_low_frequency_gain_of_both_models() -> None:
    """2.27 deg/s per unit command (SYSTEM section 7)."""
    full = from_behaviour()
    simple = run(bare("simplified"), H, [0.0]).p
    assert printed_digits(full["gain"] / full["s0"], 3) == 2.27
    assert printed_digits(math.degrees(simple.k / simple.a), 3) == 2.27
    assert math.degrees(simple.k) == pytest.approx(10.0, rel=1e-14)
    assert simple.a == 4.4


def test_valve_of_5_3() -> None:
    p = run(bare("dcv"), H, [0.0]).p
    assert (p.K, p.w0, p.zeta) == (2.375e-3, 25.23, 0.545)
    poles = np.roots([1, 2 * p.zeta * p.w0, p.w0**2])
    assert poles.real == pytest.approx(-0.545 * 25.23)
    assert (p.x_min, p.x_max) == (-2.6e-3, 2.6e-3)


def test_cylinder_of_5_9() -> None:
    """1.667 mm/s of rack per mm of spool; overdamped, real poles at 9.1 and 34.9 rad/s (SYSTEM section 9.6)."""
    pressure, drive = run(bare("continuity"), H, [0.0]).p, run(bare("mechanical"), H, [0.0]).p
    rack_speed = pressure.K_c * drive.A * drive.r / drive.b * drive.r
    assert printed_digits(rack_speed, 4) == 1.667
    poles = 1 / pressure.T, drive.b / drive.J
    assert (printed_digits(poles[0], 2), printed_digits(poles[1], 3)) == (9.1, 34.9)
    # s^2/317.1 + 0.14 s + 1 has their product and sum, to its own precision
    assert poles[0] * poles[1] == pytest.approx(317.1, rel=1e-3)
    assert round(sum(poles) / (poles[0] * poles[1]), 2) == 0.14


def test_largest_speed_of_the_rack() -> None:
    """(4.32): 5.7 mm/s is more than the identified chain reaches at full command, 3.96 mm/s (2.27 deg/s at 100 mm)."""
    full = from_behaviour()
    assert math.radians(full["gain"] / full["s0"]) * 100.0 == pytest.approx(3.96, abs=0.005)


def test_observer_gains_of_section_8() -> None:
    composed = bare("observer")
    gains = np.radians(composed.module.gains(run(composed, H, [0.0, 0.0]).p))
    assert [round(float(g), 3) for g in gains] == [7.744, 6.16]


def test_dead_zone_of_table_4_1() -> None:
    p = run(bare("dead_zone"), H, [0.0]).p
    assert (p.d_plus, p.d_minus, p.S) == (0.45, 0.40, 50.0)
    assert (p.b_r, p.b_l, p.m_r, p.m_l, p.limit) == (0.45, -0.40, 1.0, 1.0, 1.0)


def test_sensor_is_the_angle_itself() -> None:
    p = run(bare("sensor"), H, [0.0]).p
    assert (p.gain, p.bias) == (1.0, 0.0)
