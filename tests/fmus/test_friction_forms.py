"""Friction that builds up with speed or over a distance: against scipy's solution, and in the limits where it is sharp."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from fmu_bench import bare, orders, run
from friction_reference import AR, B, J
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fmus import mechanical, registry
from fmus.compose import compose

BLOCK = bare("mechanical")
LEVEL = 200.0
END = 1.6
FORMS = [{"omega_v": 1e-3}, {"z_s": 2e-5}]
IDS = ["builds up with speed", "builds up over a distance"]


def torque(t: float) -> float:
    """Breaks away, reverses and comes to rest, N m."""
    return 900.0 * math.sin(2 * math.pi * t) * (t < 1.25) + 150.0 * (t >= 1.25)


def played(h: float, form: dict[str, float]) -> np.ndarray:
    """Angle and velocity at the end of each step."""
    rows = [[torque(k * h) / AR] for k in range(1, round(END / h) + 1)]
    return run(BLOCK, h, [0.0], {"tau_c": LEVEL, **form}).play(rows)


def smooth(t: float, y: np.ndarray) -> list[float]:
    """Friction LEVEL tanh(w/omega_v)."""
    return [y[1], (torque(t) - B * y[1] - LEVEL * math.tanh(y[1] / 1e-3)) / J]


def bristles(t: float, y: np.ndarray) -> list[float]:
    """LuGre friction of stiffness LEVEL / z_s and damping sqrt(stiffness J)."""
    stiffness = LEVEL / 2e-5
    rate = y[1] - abs(y[1]) * stiffness * y[2] / LEVEL
    friction = stiffness * y[2] + math.sqrt(stiffness * J) * rate
    return [y[1], (torque(t) - B * y[1] - friction) / J, rate]


@pytest.mark.parametrize(("form", "rates"), [(FORMS[0], smooth), (FORMS[1], bristles)], ids=IDS)
def test_agrees_with_the_differential_equation_to_second_order(form, rates) -> None:
    # the torque jumps at 1.25 s: on a straight line within a step, so the reference starts again there
    start, exact = [0.0] * (2 if rates is smooth else 3), []
    for a, b in ((0.0, 1.25 - 1e-12), (1.25, END)):
        found = solve_ivp(rates, (a, b), start, "Radau", rtol=1e-10, atol=1e-13)
        start = found.y[:, -1]
        exact.append(start[0])
    errors = [abs(played(h, form)[round(1.2499999 / h) - 1, 0] - exact[0]) for h in (2e-3, 1e-3, 5e-4)]
    assert errors[1] < 2e-3 * abs(exact[0])
    assert errors[2] < errors[0] / 8.0, (errors, orders(errors))
    assert played(1e-3, form)[-1, 0] == pytest.approx(exact[1], rel=5e-3)


@pytest.mark.parametrize("form", [{"omega_v": 1e-7}, {"z_s": 1e-9}], ids=IDS)
def test_a_steep_rise_is_sharp_friction(form) -> None:
    sharp, steep = played(1e-3, {}), played(1e-3, form)
    assert np.ptp(sharp[:, 0]) > 1e-3
    assert np.abs(steep - sharp)[:, 0].max() < 2e-3 * np.ptp(sharp[:, 0])


@pytest.mark.parametrize("form", FORMS, ids=IDS)
@given(
    st.lists(st.floats(-3000, 3000), min_size=2, max_size=20),
    st.floats(0.1, 1000.0),
    st.sampled_from([1e-3, 0.05]),
)
def test_mirror_images(form, torques, tau_c, h) -> None:
    rows = np.array(torques)[:, None] / AR
    one = run(BLOCK, h, rows[0], {"tau_c": tau_c, **form}).play(rows)
    other = run(BLOCK, h, -rows[0], {"tau_c": tau_c, **form}).play(-rows)
    assert np.array_equal(one, -other)


@pytest.mark.parametrize("form", FORMS, ids=IDS)
@given(st.floats(-0.1, 0.1), st.floats(0.1, 1000.0), st.sampled_from([1e-3, 0.05]))
def test_without_drive_the_motion_dies_out(form, omega, tau_c, h) -> None:
    """No form of friction pushes: the speed only falls but for the bristles' own spring-back."""
    found = run(BLOCK, h, [0.0], {"tau_c": tau_c, **form}, omega=omega).play([[0.0]] * 30)
    speeds = np.abs(np.concatenate([[omega], found[:, 1]]))
    spring = 0.0 if "omega_v" in form else form["z_s"] * math.sqrt(tau_c / form["z_s"] / J)
    assert np.all(speeds[1:] <= speeds[:-1] + spring + 1e-12)


@given(
    st.floats(-0.1, 0.1), st.floats(-3000.0, 3000.0), st.floats(-3000.0, 3000.0), st.sampled_from([1e-3, 0.05])
)  # fmt: skip
def test_friction_at_the_mean_speed_of_a_step_solves_its_equation(omega, old, new, h) -> None:
    """Mean speed = that without friction less what the level times tanh takes of it."""
    p = run(BLOCK, h, [0.0], {"tau_c": LEVEL, "omega_v": 1e-3}).p
    c = mechanical.coefficients(p, h)
    friction = mechanical.with_smooth_friction(omega, old, new, None, p, c)
    _, free = mechanical.slid(0.0, omega, old, new, h, c.J, c.w_w, c.phi1, c.phi2, c.phi3)
    mean = 0.5 * (omega + free) - 0.5 * h / c.J * c.phi1 * friction
    assert friction == pytest.approx(LEVEL * math.tanh(mean / 1e-3), abs=1e-6 * LEVEL)


def test_bristles_give_way_and_hold() -> None:
    """Under half of what breaks it away the drive gives by half the bristles' travel, and stays there."""
    found = run(BLOCK, 1e-3, [0.0], {"tau_c": LEVEL, "z_s": 2e-5}).play([[0.5 * LEVEL / AR]] * 4000)
    # the bristles take half their travel; LuGre friction then creeps no more under a steady torque
    assert found[-1, 0] == pytest.approx(2e-5 * math.log(2.0), rel=0.1)
    assert abs(found[-1, 1]) < 1e-9


def test_bristles_outlive_a_level_that_falls_to_nothing() -> None:
    """Stribeck friction without Coulomb friction: far above its speed nothing is left, and the step still ends."""
    block = compose(registry.block("mechanical"), [registry.effects()["mechanical.stribeck_friction"]])
    made = run(block, 1e-3, [0.0], {"tau_c": 0.0, "tau_s": 100.0, "omega_s": 1e-3, "z_s": 2e-5}, omega=0.1)
    found = made.play([[0.1 * B / AR]] * 200)
    assert np.isfinite(found).all()
    assert found[-1, 1] == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("delta", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("speed", [-0.02, -0.005, 0.0, 0.001, 0.03])
def test_friction_falls_with_speed_by_the_power_asked_for(delta: float, speed: float) -> None:
    """Armstrong's curve: 1 is Tustin's exponential, 2 the Gaussian."""
    law = registry.effects()["mechanical.stribeck_friction"].fills["friction_level"]
    p = SimpleNamespace(tau_s=100.0, omega_s=0.01, delta=delta)
    expected = 100.0 * math.exp(-((abs(speed) / 0.01) ** delta))
    assert law(speed, None, p) == pytest.approx(expected, rel=1e-14)
