"""The log itself: derived signals, slices, resampling, and the tracker's record."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_files import csv_text, full_log_columns, rows

from cosim.errors import DataError, UsageError
from cosim.logs import Gap, load_log, load_tracker, write_log
from cosim.logs.log import whole_interval


@pytest.fixture
def log(write):
    return load_log(write(csv_text(full_log_columns())))


def test_load_pressure_is_derived(log):
    np.testing.assert_array_equal(log["p_load"], log["p_a"] - log["p_b"])
    assert "p_load" in log
    assert log.valid_mask("p_load").all()


def test_a_missing_signal_says_what_cannot_be_judged(load):
    log = load(rows())
    assert "p_load" not in log
    with pytest.raises(
        DataError, match=r"no signal 'p_a' and 'p_b': without it the mechanics cannot be judged"
    ):
        log.require("p_load", "the mechanics")
    with pytest.raises(DataError, match=r"no signal 'slw'; did you mean 'slew'\? \(it holds u, slew\)"):
        log.require("slw")


def test_slice_keeps_stamps_and_shares_memory(log):
    part = log.slice(0.1, 0.2)
    assert part.time[0] == 0.1
    assert part.time[-1] == pytest.approx(0.199)
    assert np.shares_memory(part["slew"], log["slew"])
    assert part.duration == pytest.approx(0.099)
    assert len(log.slice()) == len(log)
    with pytest.raises(
        UsageError, match=r"fewer than two samples between 5 and 6 s; the log runs from 0 to 0.399 s"
    ):
        log.slice(5, 6)


def test_slice_cuts_masks_and_gaps(load):
    lines = [f"{row.rsplit(',', 1)[0]}," if k == 20 else row for k, row in enumerate(rows(60))]
    log = load(lines[:10] + lines[13:])
    part = log.slice(0.015, 0.03)
    assert part.gaps == ()
    assert np.flatnonzero(~part.valid_mask("slew")).tolist() == [5]
    assert log.slice(0.005, 0.03).gaps == (Gap(0.009, 0.013),)


@pytest.mark.parametrize("step", [1e-3, 5e-4, 2e-3, 3e-3])
def test_resampling_holds_and_interpolates(log, step):
    new = log.resample(step)
    assert new.uniform
    assert len(new) == math.floor(0.399 / step + 1e-9) + 1
    np.testing.assert_allclose(new["slew"], np.interp(new.time, log.time, log["slew"]), rtol=1e-13)
    index = np.floor(new.time / 1e-3 + 1e-6).astype(int)
    np.testing.assert_array_equal(new["u"], log["u"][index])
    assert new.valid == {}


def test_resampling_to_its_own_step_changes_nothing(log):
    new = log.resample(0.001)
    for name in log.signals:
        np.testing.assert_allclose(new[name], log[name], rtol=1e-12, atol=1e-15)


def test_resampling_marks_gaps_and_filled_values(load):
    lines = [f"{row.rsplit(',', 1)[0]}," if k == 20 else row for k, row in enumerate(rows(60))]
    log = load(lines[:10] + lines[13:]).resample(0.0005)
    bad = np.flatnonzero(~log.valid_mask("slew")) * 0.5
    np.testing.assert_allclose(bad, [9.5, 10, 10.5, 11, 11.5, 12, 12.5, 19.5, 20, 20.5])
    assert np.flatnonzero(~log.valid_mask("u")).tolist() == list(range(19, 26))


@pytest.mark.parametrize("step", [0, -1, math.nan, math.inf, 10])
def test_a_step_that_does_not_fit(log, step):
    with pytest.raises(UsageError, match=r"a step of .* does not fit"):
        log.resample(step)


@given(st.floats(1e-4, 0.05), st.floats(-1, 1), st.floats(-2, 2))
def test_a_straight_line_stays_one_on_any_grid(tmp_path_factory, step, start, slope):
    path = tmp_path_factory.mktemp("line") / "log.csv"
    stamps = start + np.cumsum(np.tile([0.001, 0.0013, 0.0007], 40))
    path.write_text(csv_text({("time", "s"): stamps, ("spool", "mm"): slope * stamps}))
    log = load_log(path).resample(step)
    np.testing.assert_allclose(log["spool"], slope * log.time * 1e-3, rtol=1e-9, atol=1e-15)


def test_round_numbers_stay_round(write, tmp_path):
    random = np.random.default_rng(11)
    columns = {
        key: np.round(values, int(random.integers(3, 9))) for key, values in full_log_columns().items()
    }
    log = load_log(write(csv_text(columns)))
    again = load_log(write_log(log, tmp_path / "again.csv"))
    for name in log.signals:
        np.testing.assert_array_equal(again[name], log[name])  # bit by bit
    cells = (tmp_path / "again.csv").read_text().replace("\n", ",").split(",")
    assert max(map(len, cells[len(columns) :])) <= 13  # 3 digits, the point, 8 decimals, a sign


def test_what_cannot_be_written(log, tmp_path):
    with pytest.raises(UsageError, match=r"'.xlsx' is none of them"):
        write_log(log, tmp_path / "log.xlsx")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(UsageError, match="cannot be written"):
        write_log(log, tmp_path / "folder.csv")


TRACKER = "time [s],slew_external [deg]\n"


def test_tracker_keeps_its_clock(write, tmp_path):
    stamps = 7.25 + np.arange(200) / 80.0
    text = TRACKER + "".join(f"{t!r},{math.sin(t)!r}\n" for t in stamps.tolist())
    tracker = load_tracker(write(text, "tracker.csv"))
    np.testing.assert_array_equal(tracker.time, stamps)
    np.testing.assert_allclose(tracker.slew_external, np.radians(np.sin(stamps)), rtol=1e-15)
    assert tracker.step == pytest.approx(1 / 80)
    assert tracker.uniform
    assert tracker.valid.all()
    again = load_tracker(write_log(tracker, tmp_path / "again.parquet"))
    np.testing.assert_allclose(again.slew_external, tracker.slew_external, rtol=1e-15)


def test_tracker_marks_what_it_filled(write):
    text = TRACKER + "".join(f"{k / 80!r},{'' if k == 5 else k}\n" for k in range(20))
    tracker = load_tracker(write(text, "tracker.csv"))
    assert np.flatnonzero(~tracker.valid).tolist() == [5]
    assert tracker.slew_external[5] == pytest.approx(math.radians(5))


def test_a_log_is_no_tracker_record(write):
    with pytest.raises(DataError, match=r"no column is a known signal \(slew_external\)"):
        load_tracker(write(csv_text(full_log_columns())))


@pytest.mark.parametrize(
    ("interval", "count", "whole"),
    [
        (0.0100001, 751, 0.01),  # a clock that rounds
        (0.0530221, 2000, 0.0530221),  # another rate, not a rounded one
        (0.0100001, 100_000, 0.0100001),  # so many samples are ten intervals apart
        (0.00125, 10**6, 0.00125),
        (1.0 / 3000.0, 3000, 1.0 / 3000.0),
    ],
)
def test_an_interval_is_the_round_one_that_all_samples_keep(
    interval: float, count: int, whole: float
) -> None:
    assert whole_interval(interval, count) == whole
