"""What loggers write above a table (title, operator, units) is left out and said; a bad cell is not taken for it."""

import numpy as np
import pytest

from cosim.console import typed
from cosim.errors import DataError, HeadlessError
from cosim.logs import load_log, load_mapping
from cosim.logs.guess import guesses, mapping_text
from cosim.logs.overview import overview
from cosim.logs.text import TextSource

GERMAN = """Messung vom 24.11.2026;Prüfstand 3;;
Bediener: X;;;
Zeit;Sollwert Schwenkventil;Drehwinkel;pP
ms;%;°;bar
0;0,0;10,5;170,0
10;50,0;10,6;169,5
20;-50,0;10,7;170,5
30;0,0;10,6;170,0
"""


def test_title_and_units_of_a_german_logger(tmp_path):
    path = tmp_path / "prüfstand 3.csv"
    path.write_text(GERMAN, encoding="utf-8-sig")
    found = overview(path)
    assert found.samples == 4
    assert found.clock is not None
    assert found.clock.unit == "ms"
    assert any("left out above the names: rows 1 to 2" in text for text in found.warnings)
    assert any("units were read from row 4" in text for text in found.warnings)
    made = guesses(found)
    assert {name: g.unit for name, g in made.items()} == {"u": "%", "slew": "deg", "p_supply": "bar"}
    mapping = tmp_path / "prüfstand 3.toml"
    mapping.write_text(mapping_text(found, made, "full_order"), encoding="utf-8")
    log = load_log(path, load_mapping(mapping))
    np.testing.assert_allclose(log["u"], [0.0, 0.5, -0.5, 0.0])
    np.testing.assert_allclose(log["slew"], np.radians([10.5, 10.6, 10.7, 10.6]))
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02, 0.03], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "names", "said"),
    [
        # a title without separators, commas between columns
        ("Run 12, second try\ntime [s],u [1]\n0,1\n1,2\n2,3\n", ["time [s]", "u [1]"], ["row 1"]),
        # units only
        ("t\tu\ns\t-\n0\t1\n1\t2\n", ["t", "u"], ["row 2"]),
        ("t;u;\n[s];[%];\n0;1;\n1;2;\n", ["t", "u", ""], ["row 2"]),
        # a row of names alone is no preamble, whatever they are called
        ("s,bar\n0,1\n1,2\n", ["s", "bar"], []),
        ("time [s];u [1]\n0;1,5\n1;2,5\n", ["time [s]", "u [1]"], []),
    ],
)
def test_where_the_table_begins(tmp_path, text, names, said):
    path = tmp_path / "log.csv"
    path.write_text(text)
    source = TextSource(path)
    assert [label.text for label in source.labels] == names
    assert len(source.warnings) == len(said)
    assert all(part in warning for part, warning in zip(said, source.warnings, strict=True))
    first, *_ = source.read([0])
    np.testing.assert_array_equal(first, np.arange(first.size))
    assert source.row(0) == next(k for k, line in enumerate(text.splitlines(), 1) if line.startswith("0"))


RECORDER = """Axis1
Number of sampling data,4
Sampling time interval(ms),0.667
Time,Analog 1,Analog 2,Digital 1,Digital 2
ms,Servo motor speed,Torque,Not selected,Not selected
0.000,0,-1.0,0,0
0.667,5,-0.8,0,0
1.333,9,-0.6,0,0
2.000,9,-0.6,0,0
"""
AMPLIFIER = """Timestamp,2020-03-16 17:04:51,Timestamp,2020-03-16 17:04:51
Interval,0.0005,Interval,0.0005
Channel name,"Force",Channel name,"Input 1"
Unit,"kN",Unit,"V"
0,-0.12,0,-3.2
0.0005,-0.13,0.0005,-3.1
"""


@pytest.mark.parametrize(
    ("text", "names", "units", "row"),
    [
        (
            RECORDER,
            ["Time", "Analog 1 Servo motor speed", "Analog 2 Torque", "Digital 1", "Digital 2"],
            ["ms", None, None, None, None],
            6,
        ),
        (AMPLIFIER, ["Timestamp", "Force", "Timestamp", "Input 1"], [None, "kN", None, "V"], 5),
    ],
)
def test_columns_named_by_several_rows(tmp_path, text, names, units, row):
    """A servo amplifier names the channel in one row and what it shows in the next; a recorder repeats its keys."""
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8-sig")
    source = TextSource(path)
    assert [label.name for label in source.labels] == names
    assert [label.unit for label in source.labels] == units
    assert source.row(0) == row
    assert f"to {row - 1}" in source.warnings[0]
    found = overview(path)
    assert found.clock is not None
    assert found.clock.step == pytest.approx(0.5e-3 if row == 5 else 0.667e-3, rel=2e-3)


def test_several_rows_of_words_below_the_names_are_damaged_data(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time [s],slew [deg]\nms,foo\nbar,baz\n1,2\n2,3\n")
    with pytest.raises(DataError, match=r"row 2, column .* is not a number"):
        TextSource(path).read([0, 1])


@pytest.mark.parametrize(
    ("text", "row"),
    [
        ("time [s],slew [deg]\n0,x\n1,2\n2,3\n", 2),  # one bad cell
        ("time [s],slew [deg]\nfoo,bar baz\n1,2\n2,3\n", 2),  # a row of words that are no units
        ("time [s],slew [deg]\n0,1\n1,x\n2,3\n3,4\n", 3),
    ],
)
def test_a_bad_row_is_named_and_not_taken_for_a_preamble(tmp_path, text, row):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=rf"row {row}, column .* is not a number"):
        TextSource(path).read([0, 1])


def test_columns_of_a_simulink_array_have_no_names():
    from cosim.logs.guess import GENERIC

    assert {"yout", "simout"} <= GENERIC


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("a/run_1.csv", "a/run_1.csv"),
        ("Messung.csv", "Messung.csv"),
        ("run 3.csv", "'run 3.csv'"),
        ("März.csv", "März.csv"),
    ],
)
def test_a_path_is_shown_as_it_is_typed(path, shown, monkeypatch):
    monkeypatch.setattr("cosim.console.os.name", "posix")
    assert typed(path) == shown
    monkeypatch.setattr("cosim.console.os.name", "nt")
    assert typed(path) == shown.replace("'", '"')


def serial(count=60, between=(), sign="//", top=("con restarted", "#define GAIN 5.5", "")):
    """What a microcontroller prints to its serial line: remarks, then numbers without names."""
    lines = [f"{sign}{text}" for text in top]
    for k in range(count):
        lines += [f"{sign}insane angle"] if k in between else []
        lines.append(f"{1000 + 10 * k}, {k * 0.5:.3f},{-k * 0.01:.2f}")
    return "\n".join(lines) + "\n"


BY_PLACE = """
[file]
header = false
[time]
column = "1"
unit = "ms"
[signals.travel]
column = "2"
unit = "mm"
[signals.force]
column = "3"
unit = "N"
"""


@pytest.mark.parametrize("sign", ["//", "#", "%"])
@pytest.mark.parametrize("between", [(), (0,), (20, 21, 59)])
def test_remarks_of_a_serial_line_are_no_rows(write, sign, between):
    path = write(serial(between=between, sign=sign))
    found = overview(path)
    assert not found.header
    assert found.clock.unit == "ms"
    log = load_log(path, load_mapping(write(BY_PLACE, "m.toml")))
    np.testing.assert_allclose(log.time, np.arange(60) * 0.01 + 1.0)
    np.testing.assert_allclose(log["travel"], np.arange(60) * 0.5e-3)
    top = 4 if between[:1] == (0,) else 3
    assert f"left out above the numbers: rows 1 to {top}" in log.warnings
    inside = [text for text in log.warnings if text.startswith("remarks among the numbers")]
    assert inside == (
        ["remarks among the numbers were left out (first: row 24; in all 3)"] if len(between) > 1 else []
    )


def test_a_bad_row_after_remarks_is_named_by_its_line(write):
    path = write(serial(between=(20,)) + "1600,nonsense,2\n1610,1,2\n")
    with pytest.raises(DataError, match=r"row 65, column '2': 'nonsense' is not a number"):
        load_log(path, load_mapping(write(BY_PLACE, "m.toml")))


def test_names_in_a_remark_name_the_columns(write):
    path = write(serial(top=("log of press 3", " time [ms],travel [mm],force [N]"), sign="#"))
    assert [c.label.short for c in overview(path).columns][1:] == ["travel", "force"]


def test_without_names_and_mapping_the_remedy_is_told(write):
    with pytest.raises(
        HeadlessError, match=r"row 4 holds numbers, and above it stand remarks, no names.*cosim init"
    ):
        load_log(write(serial()))


ACQUIRED = """Header Size:  7
Version:  2
Sampling Interval:  0.005
Sampling Rate:  200
Sample Count:  4
Device Serial Number:  0
Sample Number, Date/Time, CHANNEL0, CHANNEL1, Events
         1,   04/29/2022 11:56:20.695 AM, 0.0320, -2.9931, DAQ Start
         2,   04/29/2022 11:56:20.700 AM, 0.0320, -2.9934
         3,   04/29/2022 11:56:20.705 AM, 0.0290, -2.9934
         4,   04/29/2022 11:56:20.710 AM, 0.0260, -2.9931
         5,   04/29/2022 11:56:20.715 AM, 0.0240, -2.9931
         6,   04/29/2022 11:56:20.720 AM, 0.0230, -2.9931, DAQ Pause, DAQ Stop
"""


def test_the_last_column_of_a_recorder_is_for_remarks(tmp_path):
    """Most rows end before it: what stands there is left out and said, and a row with too few numbers stays an error."""
    path = tmp_path / "acquired.txt"
    path.write_text(ACQUIRED, encoding="utf-8")
    source = TextSource(path)
    assert [label.text for label in source.labels] == ["Sample Number", "Date/Time", "CHANNEL0", "CHANNEL1"]
    number, time, one, _ = source.read(range(4))
    assert number.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    np.testing.assert_allclose(time, 0.005 * np.arange(6), atol=1e-9)
    assert one.tolist() == [0.032, 0.032, 0.029, 0.026, 0.024, 0.023]
    assert source.warnings == [
        "left out above the names: rows 1 to 6",
        "what stands beyond the last column of numbers was left out (first: row 8)",
    ]
    path.write_text(ACQUIRED.replace("0.0260, -2.9931", "0.0260"), encoding="utf-8")
    with pytest.raises(DataError, match="row 11 has 3 cells"):
        TextSource(path).read([2])
    path.write_text(ACQUIRED.replace("0.0260, -2.9931", "0.0260, -2.9931, 7.5"), encoding="utf-8")
    with pytest.raises(DataError, match="row 11 has 5 cells"):
        TextSource(path).read([2])
