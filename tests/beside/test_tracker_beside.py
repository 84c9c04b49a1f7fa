"""The tracker beside a comparison says what the motion can show of seam and bias, and no more."""

import re

import numpy as np
import pytest

from cosim.beside.tracker import TOGETHER, TrackerRun, answer, as_data, estimates, lines, rows
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.diagnosis.tracker.comparison import compare_tracker
from cosim.rig import as_log, as_tracker, make_log

DEG = np.pi / 180.0


def laid_over(start: float, *hidden: str) -> TrackerRun:
    """A log of 25 s that starts at `start`, deg, and goes a few degrees either way, under its tracker."""
    run = make_log("mixed", 25.0, list(hidden), seed=3, tracker=True, start=start * DEG)
    log, tracker = as_log(run), as_tracker(run)
    finding = compare_tracker(prepare(log, our_machine("full_order")), tracker)
    sensor = np.interp(finding.time, log.time, log["slew"])
    return TrackerRun(finding, (log.source, tracker.source), finding.time, sensor, finding.measured,
                      finding.measured - finding.predicted)  # fmt: skip


def test_below_the_seam_seam_and_bias_are_one_number() -> None:
    run = laid_over(3.0, "tracker.seam:seam=0.3 deg")
    assert run.sensor.max() < 12.0 * DEG
    found = estimates(run)
    for name in ("tracker.seam", "sensor.bias"):
        assert not np.isfinite(found[name][1]), f"{name} is given a size that the record cannot show"
    value, deviation, accepted = found[TOGETHER]
    assert accepted
    assert abs(value - 0.3 * DEG) < 4.0 * deviation < 0.004 * DEG
    shown = {str(row[0]): row for row in rows(run)}
    assert shown["tracker.seam"][1] == shown["sensor.bias"][1] == "-"
    assert any("cannot be told from a bias" in text for text in lines(run))
    data = as_data(run)
    (cause,) = data["causes"]
    assert {cause, *data["indistinguishable_from"][cause]} == {"tracker.seam", "sensor.bias"}
    assert data["seam_angle"] is None


@pytest.mark.parametrize(("start", "says"), [(12.0, "fits best at"), (30.0, "there may be one")])
def test_where_the_motion_reaches_the_seam_or_stays_above_it(start: float, says: str) -> None:
    run = laid_over(start, "tracker.seam:seam=0.3 deg")
    found = estimates(run)
    assert TOGETHER not in found
    assert np.isfinite(found["sensor.bias"][1]), "above the seam a bias shows by itself"
    assert any(says in text for text in lines(run))
    assert as_data(run)["indistinguishable_from"] == {name: [] for name in as_data(run)["causes"]}
    if start == 12.0:
        value, deviation, accepted = found["tracker.seam"]
        assert accepted
        told = re.match(
            r"Slew sensor and tracker: tracker\.seam (\S+) \+- (\S+) deg \(added below 12 deg", answer(run)
        )
        assert told
        assert float(told[1]) == pytest.approx(value / DEG, rel=1e-3)
        assert float(told[2]) == pytest.approx(1.96 * deviation / DEG, rel=0.05)
        assert abs(value - 0.3 * DEG) < 4.0 * deviation
