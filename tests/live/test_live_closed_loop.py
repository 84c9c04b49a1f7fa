"""Logs recorded in closed loop: the command is then correlated with the sensors' noise, and the diagnosis must not mind."""

import json
import random

import numpy as np
import pytest
from live_bench import pair, run

from cosim.live.master import Controller
from cosim.live.operator import Operator
from cosim.logs import load_log
from cosim.rig.hidden import Hidden, assemble
from cosim.rig.noise import Noise
from cosim.rig.parameters import DEG, PARAMETERS
from cosim.rig.stepping import SteppedCrane
from cosim.units import factor

GAIN = 2.0 / DEG  # a third of the gain limit: the noise of the angle moves the command


def recorded(path, seed, seconds, *effects, noise=None):
    """A log of automatic motion between angles drawn within 3 deg; `noise` is the noise's own seed."""
    plant = assemble([Hidden.parse(text) for text in effects], {"mechanical.theta_0": 12.0 * DEG})
    drawn = random.Random(seed)
    script, time = [(0.5, "auto")], 0.6
    while time < seconds:
        script.append((round(time, 3), f"target {12.0 + drawn.uniform(-3.0, 3.0):.3f} deg"))
        time += drawn.uniform(1.0, 2.5)
    crane = SteppedCrane(plant, Noise(1.0), seed if noise is None else noise)
    control = Controller({"k_p": GAIN})
    with pair(crane, path, Operator(), script=script, control=control) as (master, other):
        run(master, other, round(1000 * seconds))
    return path


def test_the_command_carries_the_sensors_noise(tmp_path) -> None:
    """What makes these logs special: the same targets, other noise, another command."""
    one = load_log(recorded(tmp_path / "one.csv", 1, 4.0))
    two = load_log(recorded(tmp_path / "two.csv", 1, 4.0, noise=2))
    assert 1e-3 < np.abs(one["u"] - two["u"]).max() < 0.1
    assert np.ptp(one["slew"]) > 1.0 * DEG


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_named_in_a_clean_log(command, built, tmp_path, seed) -> None:
    code, out, _ = command("diagnose", recorded(tmp_path / "log.csv", seed, 25.0), "--json")
    answer = json.loads(out)
    assert code == 0
    assert (answer["verdict"], answer["causes"]) == ("adequate", [])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "effect", "parameter", "value"),
    [
        (3, "mechanical.coulomb_friction", "tau_c", 150.0),
        (4, "dcv.gain", "K", 2.2e-3),
        (5, "mechanical.inertia", "J", 900.0),
    ],
)
def test_the_cause_is_named_and_its_size_is_right(
    command, built, tmp_path, seed, effect, parameter, value
) -> None:
    log = recorded(tmp_path / "log.csv", seed, 25.0, f"{effect}:{parameter}={value!r}")
    code, out, _ = command("diagnose", log, "--json")
    answer = json.loads(out)
    assert code == 0
    assert answer["verdict"] == "explained"
    assert [cause["effect"] for cause in answer["causes"]] == [effect]
    estimate = answer["causes"][0]["parameters"][parameter]
    scale = factor(estimate["unit"], PARAMETERS[f"{effect.partition('.')[0]}.{parameter}"].unit)
    low, high = (scale * bound for bound in estimate["ci95"])
    # one interval in twenty misses by chance, none of a sound estimate by its own width
    assert low - (high - low) <= value <= high + (high - low)
    assert scale * estimate["value"] == pytest.approx(value, rel=0.02)
