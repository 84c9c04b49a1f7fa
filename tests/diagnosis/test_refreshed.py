"""A reading that is refreshed more rarely than it is logged was measured at its refreshes, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_logs import off, only

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.record.refreshed import at_refreshes, held_over, refreshed_every
from cosim.rig import make_log
from cosim.rig.write import as_log


def staircase(values: np.ndarray, treads: np.ndarray) -> np.ndarray:
    """Readings that stay for so many samples each."""
    at = np.concatenate([[0], np.cumsum(treads)])
    at = at[at < values.size]
    return values[at[np.searchsorted(at, np.arange(values.size), "right") - 1]]


WAVE = 100.0 * np.sin(np.arange(20000) / 900.0)


@pytest.mark.parametrize(("every", "jitter"), [(2, 0), (3, 0), (10, 1), (50, 5)])
def test_the_rate_of_refreshing_is_found(every: int, jitter: int) -> None:
    rng = np.random.default_rng(every)
    treads = every + rng.integers(-jitter, jitter + 1, 20000)
    assert abs(refreshed_every(staircase(WAVE, treads)) - every) <= 1
    in_steps = np.round(staircase(WAVE, treads) / 0.01) * 0.01
    assert abs(refreshed_every(in_steps) - every) <= 1


def test_neither_lost_packets_nor_coarse_steps_nor_noise_are_a_rate() -> None:
    rng = np.random.default_rng(1)
    for share in (0.1, 0.5, 0.7, 0.9):
        fresh = np.flatnonzero(rng.random(WAVE.size) > share)
        assert refreshed_every(staircase(WAVE, np.diff(fresh))) == 1
    for step in (0.1, 1.0, 10.0):
        assert refreshed_every(np.round(WAVE / step) * step) == 1
    # an encoder at one speed steps as evenly as a clock
    assert refreshed_every(np.round(np.arange(20000) / 10.0)) == 1
    assert refreshed_every(WAVE + rng.normal(0.0, 0.1, WAVE.size)) == 1
    assert refreshed_every(np.repeat([0.0, 1.0], 5)) == 1


def test_what_stays_longer_than_two_treads_was_read_again() -> None:
    values = np.repeat([0.0, 1.0, 2.0], [10, 50, 10])
    held = held_over(values, 10)
    assert held[1:10].all()
    assert not held[0]
    assert held[11:20].all()
    assert not held[20:51].any()
    assert held[51:60].all()


def test_a_slow_bus_hides_no_cause_and_is_none() -> None:
    log = as_log(make_log("triangle", 30.0, ["mechanical.coulomb_friction"], seed=41, settings=off(41)))
    slew = staircase(log.signals["slew"], np.full(len(log), 50))
    slow = replace(log, signals=log.signals | {"slew": slew})
    read, told = at_refreshes(slow, "u")
    assert len(told) == 1
    assert "every 50 samples" in told[0]
    assert 0.97 < np.mean(~read.valid["slew"]) < 0.99
    found = diagnose(slow, model=only("mechanical"))
    assert [c.effect.name for c in found.causes] == ["mechanical.coulomb_friction"]
    assert found.rests == []
    assert told[0] in found.notes
