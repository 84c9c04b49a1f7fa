"""With a signal missing, what acts on it is still named where it acts."""

from dataclasses import replace

import pytest
from hidden_logs import off

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import make_log
from cosim.rig.write import as_log


@pytest.mark.slow
@pytest.mark.parametrize("missing", [("spool",), ("spool", "p_supply")])
def test_a_shifted_neutral_shows_in_the_pressure_where_the_spool_was_not_measured(
    missing: tuple[str, ...],
) -> None:
    run = make_log("multisine", 60.0, ["dcv.offset:x_0=0.05 mm"], seed=12, settings=off(12))
    log = as_log(run)
    found = diagnose(replace(log, signals={n: v for n, v in log.signals.items() if n not in missing}))
    (cause,) = found.causes
    assert cause.effect.name == "dcv.offset"
    assert cause.parameters["x_0"][0] == pytest.approx(5e-5, rel=0.05)


@pytest.mark.slow
def test_a_stop_that_is_just_met_is_found_where_the_spool_was_not_measured() -> None:
    run = make_log(
        "chirp", 40.0, ["dcv.stroke_limit:x_max=1.52 mm"], amplitude=0.65, seed=12, settings=off(12)
    )
    log = as_log(run)
    assert 1.50e-3 < log.signals["spool"].max() < 1.54e-3
    found = diagnose(replace(log, signals={n: v for n, v in log.signals.items() if n != "spool"}))
    (cause,) = found.causes
    assert cause.effect.name == "dcv.stroke_limit"
    assert cause.parameters["x_max"][0] == pytest.approx(1.52e-3, rel=0.005)
