"""The rig a millisecond at a time is the rig."""

import numpy as np
import pytest

from cosim.rig import Noise, Recipe, make
from cosim.rig.integrate import simulate
from cosim.rig.stepping import BLOCK, SteppedCrane
from cosim.signals import SIGNALS


@pytest.mark.parametrize(
    "hidden",
    [
        [],
        ["dcv.delay:tau_d=3.4 ms", "dcv.hysteresis", "mechanical.stribeck_friction", "mechanical.backlash"],
        ["dcv.delay", "sensor.lag", "continuity.supply_sag", "mechanical.compliance", "sensor.drift"],
    ],
)
def test_every_state_is_that_of_the_march_bit_for_bit(hidden) -> None:
    recipe = Recipe("steps", 4.0, hidden, noise=0.0)
    _, u = recipe.command()
    plant = recipe.plant(u)
    true, run = simulate(u, plant), make(recipe)
    crane = SteppedCrane(plant, Noise(0.0))
    assert np.ptp(u) > 0.5
    for k in range(u.size):
        assert (crane.state.x, crane.state.p_load, crane.seen) == (
            true["spool"][k],
            true["p_load"][k],
            true["seen"][k],
        )
        shown = crane.read()
        for name, values in run.signals.items():
            if name != "u":
                assert shown[name] * SIGNALS[name].to_si == pytest.approx(values[k], rel=1e-14), name
        crane.step(u[k])


def test_friction_sticks_in_every_form_of_it() -> None:
    recipe = Recipe("steps", 4.0, ["mechanical.coulomb_friction"], noise=0.0)
    _, u = recipe.command()
    plant = recipe.plant(u)
    for friction in ("sharp", "lugre", "smooth"):
        true = simulate(u, plant, friction=friction)
        crane = SteppedCrane(plant, Noise(0.0), friction=friction)
        for value in u[:-1]:
            crane.step(value)
        assert crane.seen == true["seen"][-1]


@pytest.mark.parametrize(("kind", "correlation"), [("white", 0.0), ("ar1", np.exp(-0.1))])
def test_the_noise_has_the_size_and_colour_that_was_asked_for(kind, correlation) -> None:
    crane = SteppedCrane(Recipe().plant(np.zeros(10)), Noise(kind=kind), seed=4)
    shown = []
    for _ in range(20 * BLOCK):
        shown.append(crane.read()["slew"])
        crane.step(0.0)
    noise = np.array(shown) - np.mean(shown)
    # standard error of a variance from 20 000 values with this correlation: 3 % at most
    assert np.std(noise) == pytest.approx(0.01, rel=0.1)
    assert np.mean(noise[1:] * noise[:-1]) / np.var(noise) == pytest.approx(correlation, abs=0.05)
    seams = np.arange(BLOCK, 20 * BLOCK, BLOCK)
    assert np.abs(noise[seams] - noise[seams - 1]).max() < 0.06


def test_lost_packets_and_rounding_are_those_of_the_sensor() -> None:
    recipe = Recipe("steps", 4.0, ["sensor.dropout:p_drop=0.3", "sensor.quantisation:quantum=0.1 deg"])
    _, u = recipe.command()
    crane = SteppedCrane(recipe.plant(u), recipe.sensor_noise(), seed=2)
    shown = []
    for value in u:
        shown.append(crane.read()["slew"])
        crane.step(value)
    angle = np.array(shown)
    assert np.abs(angle / 0.1 - np.round(angle / 0.1)).max() < 1e-9
    assert np.ptp(angle) > 0.5
    noiseless = Recipe("steps", 4.0, ["sensor.dropout:p_drop=0.3"])
    crane = SteppedCrane(noiseless.plant(u), noiseless.sensor_noise(), seed=2)
    shown = []
    for value in u:
        shown.append(crane.read()["slew"])
        crane.step(value)
    assert np.mean(np.diff(shown) == 0.0) == pytest.approx(0.3, abs=0.04)
