"""CSV files that are whole: encodings, separators, units, unknown columns, the mark of a synthetic log."""

import math
import subprocess
import sys

import numpy as np
import pytest
from log_files import HEADER, rows

from cosim.errors import DataError, UsageError
from cosim.logs import load_log
from cosim.logs.overview import overview


def test_a_clean_log_is_read_in_si(load):
    log = load(rows())
    assert log.warnings == ()
    assert list(log.signals) == ["u", "slew"]
    np.testing.assert_allclose(log.time, np.arange(30) * 0.001, rtol=0, atol=1e-15)
    np.testing.assert_allclose(log["slew"], np.radians(0.5 * np.arange(30)), rtol=1e-15)
    assert log.units == {"u": "1", "slew": "rad"}
    assert log.uniform
    assert log.step == pytest.approx(0.001)
    assert log.held == {"u"}
    assert not log.synthetic
    assert len(log.sha256) == 64


@pytest.mark.parametrize(
    "variant",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", " , "),
        lambda text: "\n\n" + text.replace("0.003", "\n0.003"),
        lambda text: text.replace("deg", "°"),
        lambda text: text.replace("[deg]", "(deg)"),
        lambda text: ",".join(f'"{cell}"' for cell in HEADER.strip().split(",")) + text[len(HEADER) - 1 :],
        lambda text: text.replace("0.003,1,1.5", "+0.003,1,+1.5e0"),
    ],
    ids=[
        "crlf",
        "cr",
        "bom",
        "tab",
        "semicolon",
        "blanks",
        "blank lines",
        "degree sign",
        "round",
        "quoted",
        "plus",
    ],
)
def test_spellings_of_the_same_log(load, write, variant):
    plain = load(rows())
    log = load_log(write(variant(HEADER + "\n".join(rows()) + "\n"), "variant.csv"))
    assert log.warnings == ()
    np.testing.assert_array_equal(log.time, plain.time)
    np.testing.assert_array_equal(log["slew"], plain["slew"])


def test_windows_1252_degree_sign(write):
    log = load_log(write(HEADER.replace("deg", "°") + "\n".join(rows()) + "\n", encoding="cp1252"))
    assert log["slew"][2] == pytest.approx(math.radians(1.0))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_comma_is_found_and_told(write, separator):
    text = (HEADER + "\n".join(rows()) + "\n").replace(",", separator).replace(".", ",")
    log = load_log(write(text))
    assert log["slew"][1] == pytest.approx(math.radians(0.5))
    assert log.warnings == ("numbers were read with a decimal comma",)


def test_decimal_comma_with_comma_separator_names_the_remedy(write):
    path = write(HEADER + "\n".join(rows()).replace(".", ",") + "\n")
    with pytest.raises(
        DataError, match=r"row 2 has 5 cells where the header has 3; with a decimal comma .* ';'"
    ):
        load_log(path)


@pytest.mark.parametrize(
    ("heading", "message"),
    [
        ("slew", r"column 'slew' has no unit.*'slew \[deg\]'"),
        ("slew [furlings]", r"column 'slew \[furlings\]': 'furlings' is not a unit"),
        ("slew [1]", r"column 'slew \[1\]': unit '1' is not an angle"),
        ("slew [bar]", r"column 'slew \[bar\]': unit 'bar' has the wrong dimension"),
        ("slew [((]", r"column 'slew \[\(\(\]'"),
    ],
)
def test_a_wrong_unit_names_the_column(write, heading, message):
    path = write(HEADER.replace("slew [deg]", heading) + "\n".join(rows()) + "\n")
    with pytest.raises(DataError, match=message):
        load_log(path)


@pytest.mark.parametrize(
    ("unit", "factor"), [("%", 0.01), ("1", 1.0), ("", None), ("deg", None), ("V", None)]
)
def test_the_command_takes_numbers_and_percent_only(write, unit, factor):
    path = write(HEADER.replace("u [1]", f"u [{unit}]") + "\n".join(rows()) + "\n")
    if factor is None:
        with pytest.raises(DataError, match=r"column 'u \["):
            load_log(path)
    else:
        assert load_log(path)["u"].max() == factor


def test_unknown_columns_are_listed_with_the_closest_name(load):
    header = "time [s],u [1],Slew [deg],oil temperature [degC]\n"
    log = load([f"{row},45" for row in rows()], header)
    assert list(log.signals) == ["u"]
    (warning,) = log.warnings
    assert "'Slew [deg]'; did you mean 'slew'?" in warning
    assert "'oil temperature [degC]'" in warning


def test_text_in_an_ignored_column_does_no_harm(load):
    log = load([f"{row},fine" for row in rows()], "time [s],u [1],slew [deg],remark\n")
    assert len(log) == 30


@pytest.mark.parametrize("sign", ["\x0b", "\x0c", "\x1c", "\x1e"])
def test_what_ends_a_line_of_text_elsewhere_ends_no_row(load, sign):
    """Python's `splitlines` takes more for a line's end than a CSV file has; pyarrow takes none before a number."""
    lines = rows()
    lines[0] = sign + lines[0]
    assert len(load(lines)) == len(lines)


def test_the_same_signal_twice_is_refused(load):
    with pytest.raises(DataError, match=r"columns 'u \[1\]' and 'u \[%\]' are both 'u'"):
        load(rows(), "time [s],u [1],u [%]\n")


def test_no_known_signal_lists_what_was_found(load):
    with pytest.raises(DataError, match=r"no column is a known signal .*found 'a \[1\]', 'b \[deg\]'"):
        load(rows(), "time [s],a [1],b [deg]\n")


def test_no_time_column(load):
    with pytest.raises(DataError, match="there is no time column"):
        load(rows(), "clock [s],u [1],slew [deg]\n")


def test_select_reads_only_what_is_asked_for(load):
    # the unselected column is not even converted
    log = load([row.replace("0.5", "abc") for row in rows()], select=["u"])
    assert list(log.signals) == ["u"]
    with pytest.raises(UsageError, match=r"no signal 'slow'; did you mean 'slew'\?"):
        load(rows(), select=["slow"])


@pytest.mark.parametrize(("mark", "synthetic"), [("1", True), ("1.0", True), ("0", False)])
def test_the_mark_of_a_synthetic_log(load, mark, synthetic):
    log = load([f"{row},{mark}" for row in rows()], "time [s],u [1],slew [deg],synthetic [1]\n")
    assert log.synthetic is synthetic
    assert "synthetic" not in log.signals
    assert log.warnings == ()


def test_values_out_of_range_are_told_with_their_place(load):
    lines = rows()
    lines[12] = "0.012,0,4000"
    log = load(lines)
    assert len(log.warnings) == 1
    assert "slew: values from 0 to 4000 deg, plausible are -30 to 280" in log.warnings[0]
    assert "row 14" in log.warnings[0]


ENDS_EARLY = """
import sys, time
from pathlib import Path
from cosim.errors import DataError
from cosim.logs import load_log, text
from cosim.logs.window import Window

plain = Window.readinto

def slow(window, buffer):
    time.sleep(0.05)
    return plain(window, buffer)

text._BLOCK = 1 << 12
fast = text.TextSource._read_fast
def one(*words):
    Window.readinto = slow
    try:
        return fast(*words)
    finally:
        Window.readinto = plain
text.TextSource._read_fast = one
try:
    load_log(Path(sys.argv[1]))
except DataError as error:
    sys.exit(str(error))
"""


def test_what_arrow_still_reads_ahead_does_not_abort_the_process_that_ends(write):
    # with a file of Python's, arrow's threads called Python while it ended: "terminate called without an active exception"
    lines = ["0,x", *(f"{k / 1000},1.5" for k in range(1, 20_000))]
    path = write("time [s],slew [deg]\n" + "\n".join(lines) + "\n")
    done = subprocess.run(
        [sys.executable, "-c", ENDS_EARLY, path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    assert "row 2, column 'slew [deg]': 'x' is not a number" in done.stderr


@pytest.mark.parametrize(("on", "off"), [("TRUE", "FALSE"), ("True", "False"), ("wahr", "falsch")])
def test_a_switch_that_is_written_as_a_truth_value_is_one_and_zero(tmp_path, on, off):
    path = tmp_path / "log.csv"
    rows = "".join(f"{0.1 * k:.1f},{k},{on if k > 2 else off}\n" for k in range(6))
    path.write_text(f"time [s],slew [deg],enable\n{rows}", encoding="utf-8")
    column = next(c for c in overview(path).columns if c.label.text == "enable")
    assert list(column.values) == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
