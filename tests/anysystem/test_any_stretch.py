"""Logs of which one run takes long: how much of them is used, where that begins, and what is said of the rest."""

import math
from pathlib import Path

import numpy as np
import pytest
from test_any_axis import STATED, axis, log, moved, recording

from cosim.anysystem import pipeline, stretch
from cosim.anysystem.answer import answer
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Recording
from cosim.anysystem.thin import ENOUGH
from cosim.diagnosis.answer.schema import Answer
from cosim.errors import DataError
from cosim.ssp.read import read_system
from cosim.system.runs import Runs

__all__ = ["axis"]  # the fixture


@pytest.mark.parametrize(("seconds", "most"), [(0.1e-6, 25_000), (6e-6, 6_250), (20e-6, 3000), (1.0, 3000)])
def test_as_many_samples_are_used_as_can_be_run_thousands_of_times(seconds: float, most: int) -> None:
    """6 us: one FMU of plain pythonfmu; a minute of several at 100 Hz."""
    assert stretch.most_samples(seconds, math.inf) == most
    assert stretch.most_samples(seconds, 30.0) == most
    more = stretch.most_samples(seconds, 10.0 * stretch.USUAL)
    assert more == max(int(10.0 * stretch.RUN / stretch.coarse_cost(seconds)), ENOUGH)


def test_logs_share_the_samples_that_can_be_run() -> None:
    assert stretch.lengths([25_000], 25_000) is None
    assert stretch.lengths([250_000], 25_000) == [25_000]
    assert stretch.lengths([100_000, 150_000], 25_000) == [10_000, 15_000]
    assert stretch.lengths([2000, 1_000_000], 25_000) == [2000, 24_950]
    assert stretch.lengths([4500], 3000) is None, "most of it: all of it"
    assert stretch.lengths([5500], 3000) == [3000]


def test_a_clock_that_errs_by_a_quarter_seldom_changes_what_is_used() -> None:
    for seconds in (1e-6, 6e-6, 30e-6):  # native, Python, a chain of Python
        assert len({stretch.coarse_cost(seconds * f) for f in (0.75, 1.0, 1.25)}) == 1


def tours() -> tuple[np.ndarray, np.ndarray]:
    """Thrice from 0 and back with a stand between, the second at four levels, and a fourth that ends elsewhere."""
    stand, parts = np.zeros(400), []
    for levels in ((0.5,), (0.3, 0.5, 0.8, 0.4), (0.5,)):
        there = np.repeat(levels, 300)
        parts += [stand, there, 0.0 * stand, -there]
    u = np.concatenate([*parts, stand, np.full(300, 0.2), stand, np.full(600, 0.9)])
    return u, 0.01 * np.cumsum(u)


@pytest.mark.parametrize("told", [(), ("y",)])
def test_a_part_begins_where_the_machine_stands_as_at_first(told: tuple[str, ...]) -> None:
    u, y = tours()
    t = 0.01 * np.arange(u.size)
    whole = recording(t, u, y + 1e-4 * np.random.default_rng(1).standard_normal(u.size))
    whole.signals = {"u": u, "y": whole.signals["axis.y"]}
    places = stretch.stands(whole, {"y"}, told, 700)
    after = u[np.minimum(places[1:] + 1, u.size - 1)]
    assert np.all(u[places[1:]] == 0.0)
    assert np.all(after != 0.0), "the last sample of each stand"
    back = np.abs(y[places] - y[0]) < 0.05 * np.ptp(y)
    assert back.all() if not told else not back.all()
    part = stretch.part_of(whole, {"y"}, told, 2400)
    assert part.time.size == 2400
    assert {0.3, 0.5, 0.8, 0.4} <= {*part.signals["u"].tolist()}
    assert stretch.part_of(whole, {"y"}, told, u.size) is whole


def told_of(axis: Path, log: Recording) -> Answer:
    """The answer for one log of the axis."""
    options = AnyOptions(trusted=dict.fromkeys((f"axis.{n}" for n in STATED), 0.01))
    with read_system(axis) as system, Runs(system, apart=False) as runs:
        return answer(diagnose_system(system, [log], runs, options))


def part_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One run takes so long that 1600 samples are all that can be run."""
    monkeypatch.setattr(pipeline, "most_samples", lambda seconds, allowed: 1600)
    monkeypatch.setattr(pipeline, "lengths", lambda counts, most: [most])


def test_what_is_found_in_a_part_is_run_over_the_rest(axis: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    part_alone(monkeypatch)
    told = told_of(axis, log(3, {"dz_up": 0.25}, count=4800))
    assert told.span == (0.0, pytest.approx(0.02 * 1599))
    assert [c.parameter for c in told.causes] == ["dz_up"]
    assert any("it uses 0 to 31.98 s" in w for w in told.warnings)
    (rest,) = (w for w in told.warnings if "in the rest of it the error of axis.y is" in w)
    assert float(rest.partition("axis.y is ")[2].partition(" times")[0]) < 0.2


def test_where_nothing_is_named_the_rest_is_told_if_it_is_worse(
    axis: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part_alone(monkeypatch)
    sound = log(3, {}, count=4800)
    assert not any("rest of it" in w for w in told_of(axis, sound).warnings)
    u = sound.signals["axis.u"]
    broken = np.where(np.arange(u.size) < 2400, moved(u, 0.02, {}), moved(u, 0.02, {"k_up": 1.5}))
    later = recording(sound.time, u, broken + 0.003 * np.random.default_rng(1).standard_normal(u.size))
    assert any("times that of the part used" in w for w in told_of(axis, later).warnings)


def test_of_a_log_whose_runs_take_too_long_fewer_samples_come_before_a_part(
    axis: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reading that hums loses more than white noise when it is taken at fewer samples."""
    dense = log(3, {"dz_up": 0.25}, 0.002, 12000)
    y = dense.signals["axis.y"]
    dense.signals["axis.y"] = y + 0.02 * np.std(y) * np.sin(2.0 * np.pi * 40.0 * dense.time)
    judged: list[pipeline.AnyDiagnosis] = []

    def looked_at(found: pipeline.AnyDiagnosis, *rest: object) -> None:
        judged.append(found)
        raise DataError("this is all that is asked")

    monkeypatch.setattr(pipeline, "judge", looked_at)
    for most in (10_000, 3500):
        monkeypatch.setattr(pipeline, "most_samples", lambda seconds, allowed, most=most: most)
        with pytest.raises(DataError, match="all that is asked"):
            told_of(axis, dense)
    usual, short = judged
    assert usual.segments[0].count == 6000
    assert "far faster" in usual.notes[0]
    assert short.segments[0].count == 3000
    (note,) = short.notes
    assert "one run of it takes long" in note
    assert "it uses one sample each 0.008 s, by which a reading loses 0." in note
    assert short.span is None
