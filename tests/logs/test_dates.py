"""Stamps written as date and time: they are read as seconds, whatever the country."""

import numpy as np
import pytest

from cosim.errors import DataError
from cosim.logs import load_log, load_mapping
from cosim.logs.dates import is_stamp, seconds
from cosim.logs.guess import guesses, mapping_text
from cosim.logs.overview import overview
from cosim.logs.text import TextSource


@pytest.mark.parametrize(
    "cells",
    [
        ["2024-03-01 10:00:00.000", "2024-03-01 10:00:00.125", "2024-03-01 10:00:01.5"],
        ["2024-03-01T10:00:00Z", "2024-03-01T10:00:00.125Z", "2024-03-01T10:00:01.5Z"],
        ["2024/3/1 10:00:00", "2024/3/1 10:00:00.125", "2024/3/1 10:00:01.5"],
        ["01.03.2024 10:00:00,000", "01.03.2024 10:00:00,125", "01.03.2024 10:00:01,500"],
        ["03/01/2024 11:59:59.0 AM", "03/01/2024 11:59:59.125 AM", "03/01/2024 12:00:00.5 PM"],
        ["01-Mar-2024 10:00:00", "01-Mar-2024 10:00:00.125", "01-Mar-2024 10:00:01.5"],
        ["10:00:00", "10:00:00.125", "10:00:01.5"],
        ["23:59:59", "23:59:59.125", "0:00:00.5"],
        ["31.12.2023 23:59:59", "31.12.2023 23:59:59.125", "01.01.2024 00:00:00.5"],
        ["12/31/2023 23:59:59", "12/31/2023 23:59:59.125", "1/1/2024 00:00:00.5"],
    ],
)
def test_stamps_of_all_kinds(cells):
    assert all(map(is_stamp, cells))
    np.testing.assert_allclose(seconds(cells), [0.0, 0.125, 1.5], atol=1e-9)


def test_of_two_numbers_the_day_is_the_one_that_changes():
    days = [f"{{}}/2024 {h}:00:00" for h in ("23", "01")]
    assert seconds([days[0].format("3/4"), days[1].format("3/5")])[1] == 7200.0
    assert seconds([days[0].format("3/4"), days[1].format("4/4")])[1] == 7200.0


def test_the_newest_row_may_stand_first():
    """A plant's historian writes backwards; midnight is then where the time of day goes on by a day."""
    np.testing.assert_allclose(seconds(["0:00:01", "0:00:00", "23:59:58"]), [0.0, -1.0, -3.0])
    dated = [f"2024-03-0{day} {clock}" for day, clock in ((2, "0:00:01"), (2, "0:00:00"), (1, "23:59:58"))]
    np.testing.assert_allclose(seconds(dated), [0.0, -1.0, -3.0])


def test_a_missing_stamp_is_missing_and_a_wrong_one_is_named():
    assert np.isnan(seconds(["10:00:00", "", "10:00:02"])).tolist() == [False, True, False]
    for wrong in ("soon", "2024-02-30 10:00:00"):
        with pytest.raises(ValueError, match="1"):
            seconds(["2024-02-01 10:00:00", wrong])


@pytest.mark.parametrize("text", ["1.5", "2024-03-01", "10:00", "Pump 10:00:00", "1:2:3", ""])
def test_what_is_no_stamp(text):
    assert not is_stamp(text)


DATED = """timestamp,command,Boom position (mm)
2024-03-01 23:59:59.900,0,10.0
2024-03-02 00:00:00.000,0,10.1
2024-03-02 00:00:00.100,100,10.3
2024-03-02 00:00:00.200,0,10.9
"""


def test_a_log_with_dates_is_a_log(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(DATED, encoding="utf-8")
    found = overview(path)
    assert found.clock is not None
    assert (found.clock.column, found.clock.unit, found.clock.guessed) == (0, "s", "")
    made = guesses(found, machine=True)
    mapping = tmp_path / "log.toml"
    mapping.write_text(mapping_text(found, made, None), encoding="utf-8")
    log = load_log(path, load_mapping(mapping))
    np.testing.assert_allclose(log.time, [0.0, 0.1, 0.2, 0.3], atol=1e-9)
    np.testing.assert_allclose(log["travel"], [0.01, 0.0101, 0.0103, 0.0109])


def test_a_log_whose_newest_row_stands_first_is_read_backwards(tmp_path):
    head, *lines = DATED.splitlines()
    path, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    path.write_text("\n".join([head, *lines[::-1]]) + "\n", encoding="utf-8")
    found = overview(path)
    assert found.clock is not None
    assert (found.clock.column, found.clock.step) == (0, pytest.approx(0.1))
    np.testing.assert_allclose(found.columns[2].values, [10.0, 10.1, 10.3, 10.9])
    mapping.write_text(mapping_text(found, guesses(found, machine=True), None), encoding="utf-8")
    log = load_log(path, load_mapping(mapping))
    np.testing.assert_allclose(log.time, [-0.3, -0.2, -0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(log["travel"], [0.01, 0.0101, 0.0103, 0.0109])
    assert any("the newest row stands first" in w for w in log.warnings)


def test_a_clock_that_was_set_back_once_is_still_refused(tmp_path):
    path, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    rows = "".join(f"{t / 10},{t % 3},{t}\n" for t in [*range(50, 100), *range(50)])
    path.write_text(f"time [s],command,travel [mm]\n{rows}", encoding="utf-8")
    found = overview(path)
    mapping.write_text(mapping_text(found, guesses(found, machine=True), None), encoding="utf-8")
    with pytest.raises(DataError, match="time goes back"):
        load_log(path, load_mapping(mapping))


def test_dates_are_read_alike_by_the_fast_and_by_the_careful_reader(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(DATED, encoding="utf-8")
    fast = TextSource(path).read([0, 2])
    path.write_text(DATED.replace(",10.3", ",+10.3"), encoding="utf-8")
    for one, other in zip(fast, TextSource(path).read([0, 2]), strict=True):
        np.testing.assert_array_equal(one, other)
    path.write_text(DATED.replace("2024-03-02 00:00:00.100", "later"), encoding="utf-8")
    with pytest.raises(DataError, match=r"row 4, column 'timestamp': 'later' is not a date and time"):
        TextSource(path).read([0])
