"""Logs of 10 and 1 Hz: what the signals did between the samples is not known, and what that leaves open is said."""

from dataclasses import replace

import pytest

from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.errors import DataError
from cosim.logs import Log
from cosim.rig import make_log
from cosim.rig.write import as_log


def thinned(hidden: list[str], every: int, seconds: float = 60.0) -> Log:
    """A log of the rig, of whose samples every so manieth is left."""
    log = as_log(make_log("mixed", seconds, hidden, seed=11))
    return replace(log, time=log.time[::every], signals={n: v[::every] for n, v in log.signals.items()})


def test_a_clean_log_of_ten_hertz_is_adequate_where_it_tells_anything() -> None:
    log = thinned([], 100)
    found = diagnose(log)
    said = answer(found, log, None)
    assert (said.verdict, found.causes) == ("adequate", [])
    assert list(found.findings) == ["mechanical"]
    assert said.not_judged["dcv"].startswith(
        "sampled every 100 ms: what u did between the samples is not known"
    )
    assert set(said.not_judged) == {"dcv", "continuity"}


@pytest.mark.slow
def test_friction_is_named_at_ten_hertz() -> None:
    (cause,) = diagnose(thinned(["mechanical.coulomb_friction:tau_c=100"], 100)).causes
    assert cause.effect.name == "mechanical.coulomb_friction"
    value, deviation = cause.parameters["tau_c"]
    assert value == pytest.approx(100.0, abs=max(4.0 * deviation, 5.0))


def test_a_log_of_one_hertz_is_refused_with_what_to_do() -> None:
    with pytest.raises(
        DataError, match=r"sampled every 1000 ms.* record every 50 ms or faster, or say in a mapping"
    ):
        diagnose(thinned([], 1000))


def test_a_log_in_which_nothing_moves_hides_nothing_between_its_samples() -> None:
    log = thinned([], 100)
    still = replace(log, signals={n: 0.0 * v + v[0] for n, v in log.signals.items()})
    still.signals["u"][:] = 0.0
    found = diagnose(still)
    assert found.at_rest
    assert found.causes == []
    assert found.sparse == {}
