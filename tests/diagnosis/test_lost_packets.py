"""Stale samples are named, and neither their lateness nor their steps pass for anything else."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_logs import off, only

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.record.signatures import stale
from cosim.logs import Log
from cosim.rig import make_log
from cosim.rig.write import as_log


def in_bursts(log: Log, every: int, chance: float, longest: int) -> Log:
    """A log of every n-th sample whose slew goes stale by this chance, for up to so many samples in a row."""
    rng = np.random.default_rng(4)
    signals = {n: v[::every].copy() for n, v in log.signals.items()}
    slew, k = signals["slew"], 0
    while k < slew.size:
        length = int(rng.integers(1, longest)) if rng.random() < chance else 0
        slew[k : k + length + 1] = slew[k]
        k += length + 1
    return replace(log, time=log.time[::every], signals=signals)


@pytest.mark.parametrize(
    ("excitation", "every", "chance", "longest", "seconds"),
    [
        ("triangle", 5, 0.02, 8, 30.0),
        *(
            pytest.param(*case, 60.0, marks=pytest.mark.slow)
            for case in [("mixed", 1, 0.5, 3), ("steps", 1, 0.01, 45)]
        ),
    ],
)
def test_lost_packets_hide_nothing_and_make_nothing_up(
    excitation: str, every: int, chance: float, longest: int, seconds: float
) -> None:
    log = as_log(make_log(excitation, seconds, seed=41, settings=off(41)))
    # only the blocks that the angle shows meet the packets
    found = diagnose(in_bursts(log, every, chance, longest), model=only("mechanical"))
    assert [c.effect.name for c in found.causes] == ["sensor.dropout"]
    assert found.rests == []


def test_a_long_run_of_stale_samples_is_no_rest_of_a_noisy_sensor() -> None:
    """By chance the noise behind a run starts as gently as a motion does."""
    rng = np.random.default_rng(3)
    values = 1e-5 * np.arange(4000) + rng.normal(0.0, 1e-4, 4000)
    late = np.zeros(values.size, dtype=bool)
    for first in range(100, 3900, 100):
        late[first : first + 30] = True
        values[first : first + 30] = values[first - 1]
    assert np.array_equal(stale(values, np.ones(values.size)), late)


def test_what_is_stale_is_known_sample_by_sample() -> None:
    values = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, 4000))
    late = np.zeros(values.size, dtype=bool)
    late[50::40] = True
    values[late] = values[np.flatnonzero(late) - 1]
    assert np.array_equal(stale(values, np.ones(values.size)), late)
    assert not stale(values[late], np.ones(late.sum())).any()
