"""Slew sensor against tracker: clock, seam and sensor errors are found with their sizes, and nothing where all is right."""

import numpy as np
import pytest

from cosim.diagnosis.story import prepare
from cosim.diagnosis.tracker import TrackerFinding, compare_tracker
from cosim.rig import as_log, as_tracker, make_log


def found(*hidden: str) -> TrackerFinding:
    run = make_log("mixed", 40.0, list(hidden), seed=3, tracker=True)
    return compare_tracker(prepare(as_log(run)), as_tracker(run))


def test_nothing_is_named_where_nothing_is_wrong() -> None:
    assert found().causes == []


@pytest.mark.parametrize(
    ("hidden", "effect", "parameter", "value"),
    [
        ("tracker.clock:offset=7.3 s,rate=1.0004", "tracker.clock", "offset", 7.3),
        ("tracker.clock:offset=7.3 s,rate=1.0004", "tracker.clock", "rate", 1.0004),
        ("tracker.seam:seam=0.2 deg", "tracker.seam", "seam", np.radians(0.2)),
        ("sensor.gain:gain=0.97", "sensor.gain", "gain", 0.97),
        ("sensor.bias:bias=0.5 deg", "sensor.bias", "bias", np.radians(0.5)),
    ],
)
def test_a_hidden_error_is_named_with_its_size(
    hidden: str, effect: str, parameter: str, value: float
) -> None:
    causes = {c.effect.name: c for c in found(hidden).causes}
    assert list(causes) == [effect]
    estimate, deviation = causes[effect].parameters[parameter]
    assert abs(estimate - value) < 4.0 * deviation  # four standard deviations


def test_clock_and_seam_together() -> None:
    names = {c.effect.name for c in found("tracker.clock:offset=-2 s,rate=0.9998", "tracker.seam").causes}
    assert names == {"tracker.clock", "tracker.seam"}
