"""Effects that other machines ask for, against figures worked out by hand."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lsim

from cosim.compiled import compiled_block
from cosim.diagnosis.model.machine import our_machine

K_C, T = 5.28e8, 0.11


def pressure(opening: np.ndarray, h: float, **values: float) -> np.ndarray:
    return compiled_block("continuity").run(opening[None, 1:], h, values, opening[:1])[0]


def speed(force: float, **values: float) -> float:
    """Steady speed of an axis of 95 kg with 200 N s/m under a constant force, m/s."""
    own = {"J": 95.0, "b": 200.0, "A": 1.0, "r": 1.0} | values
    steps = np.full((1, 8000), force)
    return float(compiled_block("mechanical").run(steps, 1e-3, own)[1, -1])


@pytest.mark.parametrize("h", [4e-3, 1e-3])
def test_a_moving_load_rings_as_its_transfer_function(h: float) -> None:
    w, d = 6.0, 1.5
    time = np.arange(0.0, 4.0, h)
    opening = 1e-3 * np.clip(time / 0.2, 0.0, 1.0)
    found = pressure(opening, h, w_l=w, d_l=d)
    # T p' = K_c (x - y) - p,  y' = w^2 T/K_c p - d y
    _, exact, _ = lsim(([K_C, K_C * d], [T, 1.0 + T * d, d + w * w * T]), opening, time)
    # the load's speed is extrapolated over a step: second order
    assert np.max(np.abs(found - exact)) < 40.0 * h**2 * np.max(exact)


def test_without_a_load_the_pressure_is_that_of_the_nominal_block() -> None:
    opening = 1e-3 * np.sin(np.arange(500) * 0.02)
    assert np.array_equal(pressure(opening, 1e-3, w_l=0.0, d_l=3.0, c_q=0.0), pressure(opening, 1e-3))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_flow_falls_with_the_load_pressure(side: float) -> None:
    opening, c = 1e-3, 1e-6
    found = side * float(pressure(np.full(5000, side * opening), 1e-3, c_q=c)[-1])
    # p = K_c x sqrt(1 - c p): a quadratic in p
    k = (K_C * opening) ** 2
    assert found == pytest.approx(0.5 * (-k * c + np.sqrt((k * c) ** 2 + 4.0 * k)), rel=1e-6)


@pytest.mark.parametrize("force", [60.0, -60.0])
def test_a_constant_load_pulls_one_way(force: float) -> None:
    assert speed(force, tau_load=5.0) == pytest.approx((force - 5.0) / 200.0, rel=1e-4)


@pytest.mark.parametrize("force", [60.0, -60.0])
def test_friction_that_differs_between_the_directions(force: float) -> None:
    side = np.sign(force)
    found = speed(force, tau_c=20.0, tau_d=5.0)
    assert found == pytest.approx((force - side * (20.0 + side * 5.0)) / 200.0, rel=1e-4)
    # sliding, it is a constant load: no log without rest tells the two apart
    assert found == pytest.approx(speed(force, tau_c=20.0, tau_load=5.0), rel=1e-9)


@pytest.mark.parametrize("force", [60.0, -60.0])
def test_viscous_friction_that_differs_between_the_directions(force: float) -> None:
    side = np.sign(force)
    assert speed(force, a_b=0.25) == pytest.approx(force / (200.0 * (1.0 + side * 0.25)), rel=1e-4)


def test_viscous_friction_never_drives() -> None:
    """Where one direction has none left the axis is accelerated uniformly and does not run away."""
    assert speed(60.0, a_b=1.0) == pytest.approx(60.0 / 400.0, rel=1e-4)
    free = 60.0 / 95.0 * 8.0  # over the eight seconds
    assert speed(-60.0, a_b=1.0) == pytest.approx(-free, rel=1e-3)


def test_asymmetric_friction_holds_at_rest_and_never_drives() -> None:
    assert speed(19.0, tau_c=20.0, tau_d=5.0) == 0.0
    assert speed(-60.0, tau_c=20.0, tau_d=50.0) == pytest.approx(-60.0 / 200.0, rel=1e-4)


def test_laws_that_need_their_block_alone_are_no_candidates_among_others() -> None:
    """Where neither spool nor pressure is measured their blocks are one group: there they are asked for or not tried."""
    needy = {"dcv.amplitude_damping", "continuity.flow_pressure"}

    def considered(group) -> set[str]:
        return needy & {effect.name for effect in group.effects()}

    apart = {group.name: group for group in our_machine("full_order").groups}
    assert considered(apart["dcv"]) | considered(apart["continuity"]) == needy
    stages = tuple(stage for group in apart.values() for stage in group.stages)
    lumped = dataclasses.replace(apart["mechanical"], stages=stages)
    assert considered(lumped) == set()
    asked = dataclasses.replace(lumped, asked=("continuity.flow_pressure",))
    assert considered(asked) == {"continuity.flow_pressure"}
