"""What a torque that depends on the angle weighs is seen along the measured motion."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cosim.diagnosis.fitting.weighed import weighed
from fmus import registry

H = 0.01
TIME = np.arange(3000) * H
J, B, WEIGHT, REST = 0.0125, 0.0575, 2.2, -0.27
GRAVITY = registry.effects()["mechanical.gravity_load"]


def torque(t):
    """Steps of a motor, in one direction."""
    return np.where(np.sin(0.7 * t) + np.sin(0.31 * t) > 0.3, 1.5, 0.2)


def task(signal="slew"):
    """A driven pendulum that was measured."""
    move = solve_ivp(
        lambda t, y: (y[1], (torque(t) - B * y[1] - WEIGHT * np.sin(y[0] - REST)) / J),
        (0.0, TIME[-1]),
        (0.0, 0.0),
        t_eval=TIME,
        max_step=H,
    )
    measured = move.y[0] + 5e-4 * np.random.default_rng(2).standard_normal(TIME.size)
    numbers = {"mechanical.A": 1.0, "mechanical.r": 1.0, "mechanical.J": 3.0 * J, "mechanical.b": 0.0}
    group = SimpleNamespace(stages=(("mechanical", "mechanical"),), is_speed=lambda s: s == "speed")
    model = SimpleNamespace(group=group, h=H, cuts=(), drive=torque(TIME), nominal=numbers.__getitem__)
    return SimpleNamespace(model=model, measured={signal: measured})


def test_the_weight_of_an_arm_is_seen_along_its_motion():
    """From its usual size the search ended at six times the weight, and friction that stopped the arm was named."""
    known = {"mechanical.J": J, "mechanical.b": B}
    found = weighed(task(), GRAVITY, known)
    assert found["mechanical.tau_g"] == pytest.approx(WEIGHT, rel=0.05)
    assert found["mechanical.theta_g"] == pytest.approx(REST, abs=0.05)


def test_where_no_angle_was_measured_or_no_angle_decides_nothing_is_weighed():
    assert weighed(task("speed"), GRAVITY, {}) == {}
    for name in ("mechanical.coulomb_friction", "mechanical.gear_ripple"):
        assert weighed(task(), registry.effects()[name], {}) == {}
