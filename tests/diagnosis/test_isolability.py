"""What a set of signals can tell apart follows from the wiring alone."""

from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.model.isolability import isolability

ALL = {"u", "spool", "p_load", "p_supply", "slew"}
FULL = MODELS["full_order"]


def test_blocks_have_their_own_residuals() -> None:
    found = isolability(FULL, ALL)
    assert found.signatures["dcv.hysteresis"] == ("dcv",)
    assert found.signatures["continuity.leakage"] == ("continuity",)
    # it acts behind the measured pressure, so only the mechanics' residual shows it
    assert found.signatures["continuity.cracking_pressure"] == ("mechanical",)


def test_without_tracker_a_sensor_error_looks_like_the_mechanics() -> None:
    found = isolability(FULL, ALL)
    assert found.signatures["sensor.gain"] == found.signatures["mechanical.inertia"]
    assert not found.signatures["tracker.seam"]
    assert any(
        line.startswith("slew_external would separate") and "sensor.gain" in line for line in found.advice
    )


def test_tracker_separates_sensor_from_mechanics() -> None:
    found = isolability(FULL, ALL | {"slew_external"})
    assert found.signatures["sensor.gain"] != found.signatures["mechanical.inertia"]
    assert found.signatures["tracker.seam"] == ("tracker",)


def test_missing_signal_is_named() -> None:
    found = isolability(FULL, ALL - {"spool"})
    # valve and continuity are judged as one, where a valve's gain and a flow gain look alike
    assert found.signatures["dcv.gain"] == found.signatures["continuity.flow_gain"] == ("dcv+continuity",)
    assert any(line.startswith("spool would separate") and "dcv.gain" in line for line in found.advice)
