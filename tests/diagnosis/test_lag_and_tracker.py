"""A slew sensor that lags is no tracker whose clock is off, and a wrong scale beside the lag keeps its size."""

import pytest
from hidden_logs import only

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import as_log, as_tracker, make_log

LAG = "sensor.lag:tau_l=120 ms"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("others", "named", "wave", "seconds"),
    [
        ([], {}, "mixed", 30.0),
        (["tracker.clock:offset=2 s,rate=1.0002"], {"tracker.clock": ("offset", 2.0)}, "steps", 30.0),
        (["sensor.gain:gain=1.04"], {"sensor.gain": ("gain", 1.04)}, "steps", 16.0),
    ],
)
def test_lag_is_told_from_the_clock(
    others: list[str], named: dict[str, tuple[str, float]], wave: str, seconds: float
) -> None:
    run = make_log(wave, seconds, [LAG, *others], seed=5, tracker=True)
    found = diagnose(as_log(run), tracker=as_tracker(run), model=only("mechanical"))
    causes = {c.effect.name: c.parameters for c in found.causes}
    assert set(causes) == {"sensor.lag", *named}
    for effect, (parameter, truth) in (named | {"sensor.lag": ("tau_l", 0.12)}).items():
        value, deviation = causes[effect][parameter]
        assert abs(value - truth) < 4.0 * deviation
    assert found.verdict == "explained"
