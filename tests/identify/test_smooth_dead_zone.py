"""The tanh family (2.5), (4.9) found in ramps of the rig whose valve has smooth or sharp edges."""

import dataclasses

import numpy as np
import pytest

from cosim.errors import DataError
from cosim.identify.dead_zone import identify_dead_zone
from cosim.identify.experiment import ramp
from cosim.identify.nominal import nominal
from cosim.identify.run import dead_zone_answer
from cosim.identify.smooth_dead_zone import opening, smooth_dead_zone
from cosim.rig import as_log, make_log

OFF = {"compensator.d_plus": 0.0, "compensator.d_minus": 0.0}
KNOWN = nominal() | OFF


def ramp_log(sharpness):
    """A slow ramp at a valve of the family: the rig's sharp one behind a command that gives it what the smooth one would."""
    command = ramp(periods=1, period=60.0).command
    u = command
    if sharpness is not None:
        y = opening(command, 0.45, 0.40, sharpness)
        u = np.where(y > 1e-4, y + 0.45, np.where(y < -1e-4, y - 0.40, 0.0)).clip(-1.0, 1.0)
    log = as_log(make_log(u, settings=OFF, seed=2, start=0.1))
    return dataclasses.replace(log, signals=log.signals | {"u": command})


def test_the_curve_is_the_inverse_of_the_compensator():
    y = np.linspace(-0.6, 0.55, 301)
    x = y + np.where(y > 0.0, 0.45, 0.40) * np.tanh(50.0 * y)
    # between the table's points: at most an eighth of the square of their distance, where the curve bends by S
    assert opening(x, 0.45, 0.40, 50.0) == pytest.approx(y, abs=1e-5)


@pytest.mark.parametrize("sharpness", [pytest.param(30.0, marks=pytest.mark.slow), 60.0])
def test_a_smooth_valve_is_found(sharpness):
    curve = smooth_dead_zone(identify_dead_zone(ramp_log(sharpness), KNOWN))
    assert pytest.approx(sharpness, rel=5e-3) == curve.S
    # on a ramp of 1/15 a second the lag, known to a tenth of a millisecond, moves an edge by less than 1e-4
    assert (curve.d_plus, curve.d_minus) == pytest.approx((0.45, 0.40), abs=3e-4)
    assert not curve.sharp
    assert curve.rmse < 0.1 * curve.rmse_sharp


@pytest.mark.slow
def test_a_sharp_valve_is_said_to_be_sharp(monkeypatch):
    log = ramp_log(None)
    found = identify_dead_zone(log, KNOWN)
    curve = smooth_dead_zone(found)
    assert curve.sharp
    assert curve.rmse_sharp < curve.rmse
    assert (curve.d_plus, curve.d_minus) == pytest.approx((0.45, 0.40), abs=1e-3)
    monkeypatch.setattr("cosim.identify.run.identify_dead_zone", lambda *_, **__: found)
    answer = dead_zone_answer(log, KNOWN, None, None)
    assert answer.data["smooth"]["S"] is None
    assert any("sharper than the family can be" in line for line in answer.details)
    with pytest.raises(DataError, match="its integral"):
        smooth_dead_zone(dataclasses.replace(found, response="slew"))
    with pytest.raises(DataError, match="on both sides"):
        smooth_dead_zone(dataclasses.replace(found, sides={"right": found.sides["right"]}))
