"""A transmission ratio that depends on the angle: against LSODA, over whole turns, and its vanishing size."""

import numpy as np
import pytest
from fmu_bench import bare, run
from scipy.integrate import solve_ivp

from fmus import registry
from fmus.compose import compose

AR = 8.4193e-3 * 0.1
LINKED = compose(registry.block("mechanical"), [registry.effects()["mechanical.linkage"]])


@pytest.mark.parametrize("e_l", [0.3, -0.6, 0.9])
@pytest.mark.parametrize("pressure", [5e5, -6e7])
def test_against_lsoda(e_l: float, pressure: float) -> None:
    """The larger pressure turns the joint more than once."""
    p = {"e_l": e_l, "theta_l": 0.7, "theta_0": -0.4}
    r = run(LINKED, 1e-2, [pressure], p, torque=AR * pressure)
    found = r.play([[pressure]] * 1500)
    values = r.p

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [
            y[1] * (1.0 + e_l * np.cos(y[0] - 0.7)),
            (AR * pressure - values.b * y[1]) / values.J,
        ]

    time = np.arange(1, 1501) * 1e-2
    exact = solve_ivp(slope, (0.0, 15.0), [-0.4, 0.0], "LSODA", t_eval=time, rtol=1e-11, atol=1e-12)
    assert np.abs(found[:, 0] - exact.y[0]).max() < 1e-7
    rate = exact.y[1] * (1.0 + e_l * np.cos(exact.y[0] - 0.7))
    assert np.abs(found[:, 1] - rate).max() < 1e-7
    if abs(pressure) > 1e6:
        assert abs(found[-1, 0]) > 2.0 * np.pi


def test_one_step_equals_many() -> None:
    p = {"e_l": 0.4, "theta_l": 0.2}
    whole = run(LINKED, 0.5, [1e6], p, torque=AR * 1e6).step(1e6)
    parts = run(LINKED, 0.05, [1e6], p, torque=AR * 1e6).play([[1e6]] * 10)[-1]
    assert whole == pytest.approx(tuple(parts), abs=1e-12)


def test_a_vanishing_size_is_rack_and_pinion() -> None:
    rows = np.random.default_rng(3).uniform(-1e6, 1e6, (300, 1))
    linked = run(LINKED, 0.01, rows[0], {"e_l": 1e-9}, torque=AR * rows[0, 0]).play(rows)
    plain = run(bare("mechanical"), 0.01, rows[0], torque=AR * rows[0, 0]).play(rows)
    assert np.abs(linked - plain).max() < 1e-8
