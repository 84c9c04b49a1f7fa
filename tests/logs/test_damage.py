"""Damaged logs: each either loads with a warning that says what was done, or stops with file, row and column."""

import math
import re
import time
from pathlib import Path

import numpy as np
import pytest
from log_files import HEADER, rows

from benchmarks.damage_corpus import READERS
from cosim.errors import DataError
from cosim.logs import Gap, load_log


def replaced(lines, changes):
    return [changes.get(k, line) for k, line in enumerate(lines)]


@pytest.mark.parametrize(
    ("tail", "samples", "warning"),
    [
        ("0.030,1", 30, r"the last line \(row 32\) was cut short \(2 of 3 cells\) and left out"),
        ("0.0", 30, r"row 32.*1 of 3 cells"),
        ("0.030,1,", 30, r"row 32.*3 of 3 cells"),
        ("0.030,1,1e", 30, r"row 32.*cut short"),
        ("0.030,1,15", 31, r"does not end with a line end: the last number may be cut short"),
    ],
)
def test_a_cut_last_line(write, tail, samples, warning):
    path = write(HEADER + "\n".join(rows()) + "\n" + tail)
    log = load_log(path)
    assert len(log) == samples
    assert len(log.warnings) == 1
    np.testing.assert_allclose(log["slew"][:30], np.radians(0.5 * np.arange(30)), rtol=1e-15)
    assert re.search(warning, log.warnings[0])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ("\n\n  \n", "is empty"),
        (HEADER, "a header but no data row"),
        (HEADER.strip(), "a header but no data row"),
        (HEADER + "0.0,1,2\n", "only one usable row"),
        ("0,1,2\n1,2,3\n", "row 1 holds numbers, not names"),
        (b"\x00\x01\x02" * 50, "no text file"),
        (b"x" * (1 << 20) + b"y" * 10, "no line end in the first megabyte"),
        (HEADER + "0,1,2\n1,abc,2\n2,1,1\n", r"row 3, column 'u \[1\]': 'abc' is not a number"),
        (HEADER + "0,1,2\n1,1\n2,1,1\n", r"row 3 has 2 cells where the header has 3"),
        (HEADER + "0,1,2\n1,1,1,1\n2,1,1\n", r"row 3 has 4 cells where the header has 3"),
        (HEADER + "0,1,2\n\n\n1,1,1_000\n2,1,1\n", r"row 5, column 'slew \[deg\]': '1_000' is not a number"),
        (HEADER + '0,1,2\n1,1,"1\n2,1,1\n', r"row"),
    ],
)
def test_files_beyond_mending(write, content, message):
    path = write(content)
    with pytest.raises(DataError, match=message) as caught:
        load_log(path)
    assert str(path) in str(caught.value)


def test_utf16_names_the_remedy(write):
    with pytest.raises(DataError, match="UTF-16: save it as UTF-8"):
        load_log(write(HEADER + "\n".join(rows()), encoding="utf-16"))


@pytest.mark.parametrize("cell", ["", "NaN", "nan", "inf", "-inf", "NA", "null", "1e999"])
def test_missing_values_are_filled_and_marked(load, cell):
    log = load(replaced(rows(), {10: f"0.010,0,{cell}", 11: f"0.011,1,{cell}"}))
    np.testing.assert_allclose(log["slew"], np.radians(0.5 * np.arange(30)), rtol=1e-12)  # straight line
    assert np.flatnonzero(~log.valid_mask("slew")).tolist() == [10, 11]
    assert log.valid_mask("u").all()
    (warning,) = log.warnings
    assert "slew: 2 missing values in 1 place filled by straight lines" in warning
    assert "row 12" in warning


def test_a_missing_command_is_held(load):
    log = load(replaced(rows(), {10: "0.010,,5.0", 11: "0.011,,5.5"}))
    assert log["u"][9:13].tolist() == [1, 1, 1, 0]
    assert np.flatnonzero(~log.valid_mask("u")).tolist() == [10, 11]
    assert "u: 2 missing values in 1 place filled by the value before" in log.warnings[0]


def test_a_command_missing_for_long_is_refused(load):
    lines = replaced(rows(300), {k: f"{k / 1000:.3f},,0" for k in range(50, 160)})
    with pytest.raises(DataError, match=r"row 52, column 'u': 110 values are missing in a row \(0.111 s\)"):
        load(lines)


def test_missing_at_the_ends_keeps_the_nearest_value(load):
    log = load(replaced(rows(), {0: "0.000,,", 29: "0.029,1,"}))
    assert log["u"][0] == 1
    assert log["slew"][0] == log["slew"][1]
    assert log["slew"][29] == log["slew"][28]


def test_an_empty_column_counts_as_missing(load):
    log = load([f"{k / 1000:.3f},{k % 2}," for k in range(20)])
    assert list(log.signals) == ["u"]
    assert "slew: no value at all" in log.warnings[0]
    with pytest.raises(DataError, match=r"no signal 'slew': without it the mechanics cannot be judged"):
        log.require("slew", "the mechanics")
    with pytest.raises(DataError, match="no signal has any value"):
        load([f"{k / 1000:.3f},," for k in range(20)])


def test_missing_samples_are_counted_and_remembered(load):
    lines = rows(60)
    log = load(lines[:10] + lines[13:40] + lines[41:])
    assert len(log) == 56
    assert log.gaps == (Gap(0.009, 0.013), Gap(0.039, 0.041))
    assert not log.uniform
    assert log.warnings == ("4 samples missing in 2 places (longest 0.004 s; first after row 11)",)


def test_rows_that_come_late_are_put_back(load):
    lines = rows()
    lines.insert(5, lines.pop(8))  # one packet overtakes three
    log = load(lines)
    assert log.uniform
    np.testing.assert_allclose(log["slew"], np.radians(0.5 * np.arange(30)), rtol=1e-15)
    assert log.warnings == ("1 row came late, by up to 3 places, put back in order (first: row 8)",)


@pytest.mark.parametrize("back", [40, 200])
def test_a_clock_that_was_set_back_is_refused(load, back):
    lines = rows(400) + [f"{(400 - back + k) / 1000 + 0.0003:.4f},0,1" for k in range(300)]
    with pytest.raises(DataError, match=r"row 402, column time: time goes back from 0.399 to"):
        load(lines)


def test_repeated_rows_are_dropped(load):
    lines = rows()
    log = load(lines[:7] + lines[5:])
    assert len(log) == 30
    assert log.uniform
    assert log.warnings[1] == "2 repeated rows left out, the first kept (first: row 9)"


def test_one_row_twice_is_dropped(load):
    lines = rows()
    log = load(lines[:7] + lines[6:])
    assert log.uniform
    assert log.warnings == ("1 repeated row left out, the first kept (first: row 9)",)


def test_a_repeated_stamp_with_other_values_keeps_the_first(load):
    lines = rows()
    log = load([*lines[:7], "0.006,0,99", *lines[7:]])
    assert log["slew"][6] == pytest.approx(math.radians(3.0))
    assert log.warnings == ("1 differing row at a repeated stamp left out, the first kept (first: row 9)",)


def test_a_clock_that_stands_still_is_refused(load):
    with pytest.raises(
        DataError, match=r"row 3, column time: time stands still at 0 s .* 'time.step' in a mapping"
    ):
        load([f"0.000,{k % 2},{k}" for k in range(40)])
    with pytest.raises(DataError, match="only one usable row"):
        load(["0.0,1,2"] * 5)


def test_unusable_stamps(load):
    lines = rows(400)
    log = load(replaced(lines, {100: ",1,50"}))
    assert len(log) == 399
    assert "1 row without a usable time stamp left out (first: row 102)" in log.warnings[0]
    assert log.gaps == (Gap(0.099, 0.101),)
    with pytest.raises(
        DataError, match=r"row 12, column time: no usable time stamp; so have 30 of 400 rows: delete them"
    ):
        load(replaced(lines, dict.fromkeys(range(10, 40), "nan,1,50")))


def test_jitter_and_irregular_sampling_are_told(load):
    random = np.random.default_rng(3)
    stamps = np.arange(200) / 1000 + random.uniform(-2e-5, 2e-5, 200)
    log = load([f"{t:.7f},0,1" for t in stamps])
    assert log.warnings[0].startswith("jitter: intervals from 0.0009")
    assert not log.uniform
    stamps = np.cumsum(random.uniform(0.02, 0.09, 200))
    stamps[100:] += 5.0
    log = load([f"{t:.7f},0,1" for t in stamps])
    assert log.warnings[0].startswith("pauses of more than ten median intervals in 1 place (longest 5.")
    assert log.warnings[1].startswith("irregular sampling: intervals from 0.02")
    assert len(log.gaps) == 1


def test_rows_are_counted_as_an_editor_does(load):
    lines = rows()
    lines[20] = "0.020,0,4000"
    log = load(["", lines[0], "", *lines[1:]])
    assert "row 24" in log.warnings[0]  # header, two blank lines, twenty rows before it


@pytest.mark.parametrize("name", ["x.csv", "x.mat", "x.parquet"])
def test_a_missing_file_and_a_folder(tmp_path, name):
    with pytest.raises(DataError, match="there is no such file"):
        load_log(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(DataError, match="this is a folder"):
        load_log(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("log.ods", ": save it as .xlsx, or its sheet as CSV"),
        ("log.gz", ": a compressed text file is called so, such as log.csv.gz"),
        ("log.csv.7z", ": unpack it first"),
        ("run.mcap", ": write the messages of its topics as CSV"),
        ("log.NPZ", ": write it as CSV or Parquet"),
        ("trace.blf", ": decode its CAN messages"),
        ("log.abc", "$"),
    ],
)
def test_an_unknown_file_type_lists_those_known_and_says_what_makes_a_log_of_it(write, name, remedy):
    with pytest.raises(
        DataError, match=rf"a log is one of .csv, .*'{Path(name).suffix.lower()}' is none of them{remedy}"
    ):
        load_log(write("x", name))


def test_a_text_file_may_be_called_a_log(write):
    assert (
        load_log(
            write("time [s],u [1]\n" + "".join(f"{k / 100},0.5\n" for k in range(9)), "run.log")
        ).time.size
        == 9
    )


@pytest.mark.parametrize("last", ["", '0.700,0,350.0,"ok', '0.700,0,350.0,o"k'])
def test_a_stray_quotation_mark_loses_no_row_in_silence(write, last):
    lines = [f"{row},ok" for row in rows(900)]
    lines[100] = '0.100,0,50.0,"ok'
    lines[700] = last or lines[700]
    end = "702" if last else "901"
    with pytest.raises(
        DataError,
        match=rf"row 102, column 'remark': a quotation mark opens a cell that ends in row {end} only",
    ):
        load_log(write("time [s],u [1],slew [deg],remark\n" + "\n".join(lines) + "\n"))


def test_a_quotation_mark_before_a_long_log_is_named(write):
    lines = [f"{row},ok" for row in rows(20000)]
    lines[100] = '0.100,0,50.0,"ok'
    with pytest.raises(
        DataError, match=r"row 102: a quotation mark opens a cell that is longer than 131072 char"
    ):
        load_log(write("time [s],u [1],slew [deg],remark\n" + "\n".join(lines) + "\n"))


def test_a_remark_of_two_lines_is_read(load):
    lines = [f"{row},ok" for row in rows(100)]
    lines[50] = '0.050,0,25.0,"by hand,\nstopped"'
    log = load([*lines[:80], "", *lines[80:]], "time [s],u [1],slew [deg],remark\n")
    assert len(log) == 100
    assert log.warnings == ("ignored columns: 'remark'",)


@pytest.mark.parametrize(("place", "size"), [(96, 0x8E238F13), (100, 0xF577119E), (80, 1 << 40)])
def test_an_mdf_file_that_claims_more_than_it_holds_is_refused_at_once(tmp_path, place, size):
    pytest.importorskip("asammdf", reason="an extra is not installed")
    path = READERS["mf4_zip"][1](tmp_path / "log.mf4")
    data = bytearray(path.read_bytes())
    at = data.index(b"##CG") + place  # bytes of a record, of its marks, number of records
    data[at : at + (8 if place == 80 else 4)] = size.to_bytes(8 if place == 80 else 4, "little")
    path.write_bytes(data)
    begun = time.process_time()
    with pytest.raises(DataError, match=r"group 1 claims .* more than the file can hold"):
        load_log(path)
    assert time.process_time() - begun < 5.0


@pytest.mark.parametrize("place", [41, 48, 1 << 22])
def test_an_mdf_channel_outside_its_records_is_refused_before_memory_of_others_is_read(tmp_path, place):
    pytest.importorskip("asammdf", reason="an extra is not installed")
    path = READERS["mf4"][1](tmp_path / "log.mf4")
    data = bytearray(path.read_bytes())
    at = data.index(b"##CN") + 92  # byte of the record
    data[at : at + 4] = place.to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(DataError, match=rf"channel '\w+' lies at byte {place} of records of 48 bytes"):
        load_log(path)


def channel_changed(path, number, at, value, size=1):
    """One field of the CN block of an MDF file's n-th channel overwritten; channel 0 is the time."""
    data = bytearray(READERS["mf4"][1](path).read_bytes())
    begin = -1
    for _ in range(number + 1):
        begin = data.index(b"##CN", begin + 1)
    data[begin + at : begin + at + size] = value.to_bytes(size, "little")
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("number", "at", "value", "size", "said"),
    [
        (
            0,
            90,
            48,
            1,
            "group 1 names a channel that is none",
        ),  # a clock of no known type: its samples were counted
        (4, 90, 48, 1, "group 1 names a channel that is none"),  # the channel was left out
        (2, 31, 128, 1, "group 1 names a channel that is none"),  # and with the link to the next all after it
        (4, 90, 0, 10, "channel 'p_b' has numbers of 0 bits"),  # gave zeros
        (4, 96, 60, 1, "channel 'p_b' has numbers of 60 bits"),
    ],
)
def test_an_mdf_channel_that_the_library_would_lose_in_silence_is_refused(
    tmp_path, number, at, value, size, said
):
    pytest.importorskip("asammdf", reason="an extra is not installed")
    with pytest.raises(DataError, match=said):
        load_log(channel_changed(tmp_path / "log.mf4", number, at, value, size))


def test_what_the_library_of_mdf_passes_over_is_a_warning_once(tmp_path):
    """A conversion that cannot be read leaves raw numbers; asammdf says so at a level that it does not show."""
    pytest.importorskip("asammdf", reason="an extra is not installed")
    path = channel_changed(
        tmp_path / "log.mf4", 3, 56, 248, 8
    )  # a block of data in the place of a conversion
    (told,) = [text for text in load_log(path).warnings if "onversion" in text]
    assert told.startswith("Channel conversion parsing error (")
    assert "Traceback" not in told


def test_a_file_of_mdf_3_is_read_as_one_of_mdf_4(tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="an extra is not installed")
    whole = load_log(READERS["mf4"][1](tmp_path / "log.mf4"))
    with asammdf.MDF(tmp_path / "log.mf4") as file:
        file.convert("3.30").save(tmp_path / "log.mdf", overwrite=True)
    old = load_log(tmp_path / "log.mdf")
    assert all(np.array_equal(whole[name], old[name]) for name in whole.signals)
