"""Mapping files: scaling, units, time without a column, and what is wrong in one."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from log_files import TOP
from pydantic import ValidationError
from scipy.io import savemat

from cosim.api import diagnosing
from cosim.errors import DataError, UsageError
from cosim.logs import Mapping, load_log, load_mapping

PLAIN = """
model = "simplified"
[time]
column = "t"
unit = "ms"
[signals.u]
column = "duty"
unit = "%"
zero = 50
gain = 2
sign = -1
[signals.slew]
column = "angle [deg]"
offset = 3
"""
LINES = [f"{k},{50 + k % 3},{k * 0.5},x" for k in range(20)]


@pytest.fixture
def foreign(write):
    return write("t,duty,angle [deg],remark\n" + "\n".join(LINES) + "\n", "foreign.csv")


def test_a_mapping_scales_and_names(foreign, write):
    log = load_log(foreign, write(PLAIN, "map.toml"))
    np.testing.assert_allclose(log.time, np.arange(20) / 1000, rtol=1e-15)
    np.testing.assert_allclose(log["u"], [-0.02 * (k % 3) for k in range(20)], rtol=0, atol=1e-15)
    np.testing.assert_allclose(log["slew"], np.radians(0.5 * np.arange(20) + 3), rtol=1e-14)
    assert log.model == "simplified"
    assert log.held == {"u"}
    assert log.warnings == ()  # what a mapping does not name is left alone on purpose


def test_columns_by_number_and_own_names(foreign):
    mapping = Mapping.model_validate(
        {
            "time": {"step": 0.5, "unit": "ms"},
            "signals": {
                "force": {"column": 2, "unit": "kN", "held": True},
                "p": {"column": 3, "unit": "mbar"},
            },
        }
    )
    log = load_log(foreign, mapping)
    assert log.step == pytest.approx(5e-4)
    assert log["force"][0] == pytest.approx(50e3)
    assert log["p"][1] == pytest.approx(50.0)
    assert log.units["p"] == "kg.m-1.s-2"
    assert log.display == {"force": "kN", "p": "mbar"}
    np.testing.assert_allclose(log.in_display_units("force"), [50 + k % 3 for k in range(20)])
    assert log.held == {"force"}


def test_logs_of_one_machine_may_call_a_signal_differently(write):
    """A Simulink data set names a command by the block from which it comes: Chirp in one log, Sine in the next."""
    given = {
        "time": {"column": ["t", "time"], "unit": "s"},
        "signals": {"u": {"column": ["Chirp", "Sine"], "unit": "%"}},
    }
    mapping = Mapping.model_validate(given)
    for heading in ("t,Chirp,y", "time,y,Sine", "time,Sine,Chirp"):
        place = heading.split(",").index("Chirp" if "Chirp" in heading else "Sine")
        lines = [[k / 10, 0, 0] for k in range(3)]
        for k, line in enumerate(lines):
            line[place] = 10 * k
        text = "\n".join(",".join(map(str, line)) for line in lines)
        log = load_log(write(f"{heading}\n{text}\n", "log.csv"), mapping)
        assert log["u"].tolist() == [0.0, 0.1, 0.2]
    with pytest.raises(
        DataError, match=r"'u' from column 'Chirp', which is not there.*name all: column = \['Chirp'"
    ):
        load_log(write("t,Stair,y\n0,1,1\n1,2,2\n", "log.csv"), mapping)


def test_a_file_without_header(write):
    path = write("0;1,5\n1;2,5\n2;3,5\n", "bare.csv")
    mapping = Mapping.model_validate(
        {
            "file": {"header": False},
            "time": {"step": 1, "unit": "sample"},
            "signals": {"u": {"column": 2, "unit": "%"}},
        }
    )
    log = load_log(path, mapping)
    assert log["u"].tolist() == [0.015, 0.025, 0.035]
    assert log.time.tolist() == [0, 1, 2]
    assert log.time_unit == "sample"


def test_forced_separator_and_decimal(write):
    path = write("t [s]|a,b|u [1]\n0,0|x|0,25\n0,1|y|0,75\n", "odd.csv")
    content = {
        "file": {"separator": "|", "decimal": ","},
        "time": {"column": "t"},
        "signals": {"u": {"column": "u"}},
    }
    assert load_log(path, Mapping.model_validate(content))["u"].tolist() == [0.25, 0.75]


def test_a_gain_stored_in_the_file(tmp_path):
    path = tmp_path / "drive.mat"
    savemat(path, {"t": np.arange(4.0), "volts": np.array([0, 1, 2, 3.0]), "gtau": 35.0, "kp": 1.0})
    content = {
        "time": {"column": "t", "unit": "s"},
        "signals": {"force": {"column": "volts", "unit": "N", "gain": "gtau", "sign": -1}},
    }
    assert load_log(path, Mapping.model_validate(content))["force"].tolist() == [0, -35, -70, -105]
    content["signals"]["force"]["gain"] = "gtua"
    with pytest.raises(
        DataError, match=r"gain 'gtua' for 'force' .*did you mean 'gtau'\?; stored numbers: gtau, kp"
    ):
        load_log(path, Mapping.model_validate(content))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'column = "duty"',
            'colum = "duty"',
            r"'signals\.u\.colum' is not a key of a mapping; did you mean 'column'\?",
        ),
        ("[time]", "[tiem]", r"'tiem' is not a key of a mapping; did you mean 'time'\?"),
        ('unit = "ms"', 'units = "ms"', r"'time\.units' is not a key of a mapping; did you mean 'unit'\?"),
        ("gain = 2", "gain = 0", r"'signals\.u\.gain'.*leaves nothing"),
        ("gain = 2", "gain = inf", r"'signals\.u\.gain"),
        ("sign = -1", "sign = 2", r"'signals\.u\.sign'"),
        ('unit = "%"', 'unit = "deg"', r"signal 'u': unit 'deg' is an angle"),
        ('unit = "%"', 'unit = "V"', r"signal 'u': unit 'V' has the wrong dimension"),
        (
            'unit = "%"',
            'unit = "us"',
            r"of a raw reading, such as a voltage, write unit = \"1\" and gain = 1 over its value at full command",
        ),
        ('unit = "ms"', 'unit = "mm"', r"'time': unit 'mm' has the wrong dimension"),
        ('column = "t"', 'column = "t"\nstep = 1', r"'time': give either the column or the step"),
        ('unit = "ms"', 'unit = "sample"', r"unit 'sample' goes with a step"),
        ("[signals.slew]", "[signals.p_load]", r"'p_load' cannot be the name of a signal: it is p_a - p_b"),
        ("[signals.slew]", '[signals."a b"]', r"'a b' cannot be the name of a signal"),
        ("[time]", "[time", r"not valid TOML"),
        ('model = "simplified"', 'path = "x"', r"'path' is not a key"),
        (
            'model = "simplified"',
            'file = {separator = ",", decimal = ","}',
            r"separator and decimal are the same",
        ),
    ],
)
def test_what_is_wrong_in_a_mapping_is_named(write, old, new, message):
    assert PLAIN.count(old)
    path = write(PLAIN.replace(old, new, 1), "map.toml")
    with pytest.raises(DataError, match=message) as caught:
        load_mapping(path)
    assert "map.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'column = "duty"',
            'column = "Duty"',
            r"'u' from column 'Duty', which is not there; did you mean 'duty'\?",
        ),
        ('column = "duty"', "column = 9", r"'u' from column 9; there are 4"),
        ('unit = "%"', "", r"column 'duty' has no unit: give 'signals.u.unit'"),
        ('unit = "ms"', "", r"column 't' has no unit: give 'time.unit'"),
        ('column = "duty"', 'column = "remark"', r"row 2, column 'remark': 'x' is not a number"),
    ],
)
def test_what_does_not_fit_the_file_is_named(foreign, write, old, new, message):
    with pytest.raises(DataError, match=message):
        load_log(foreign, write(PLAIN.replace(old, new, 1), "map.toml"))


def test_a_heading_that_fits_two_columns(write):
    path = write("t [s],a [1],a [1]\n0,1,2\n1,2,3\n")
    content = {"time": {"column": "t"}, "signals": {"u": {"column": "a"}}}
    with pytest.raises(
        DataError, match=r"'a' fits several columns \(2 'a \[1\]', 3 'a \[1\]'\): give its number"
    ):
        load_log(path, Mapping.model_validate(content))
    content["signals"]["u"]["column"] = 3
    assert load_log(path, Mapping.model_validate(content))["u"].tolist() == [2, 3]


def test_select_with_a_mapping(foreign, write):
    path = write(PLAIN, "map.toml")
    assert list(load_log(foreign, path, select=["slew"]).signals) == ["slew"]
    with pytest.raises(UsageError, match=r"no signal 'slow'; did you mean 'slew'"):
        load_log(foreign, path, select=["slow"])


def test_a_model_file_is_found_beside_the_mapping(write, tmp_path):
    mapping = load_mapping(write(PLAIN.replace('"simplified"', '"own/crane.ssp"'), "map.toml"))
    assert mapping.model_reference == str(tmp_path / "own" / "crane.ssp")


def test_a_model_file_beside_a_mapping_is_called_as_the_user_calls_the_mapping(
    write, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    """The report of a colleague's folder showed where it lay on this computer."""
    write(PLAIN.replace('"simplified"', '"../own/crane.fmu"'), "map.toml").rename(tmp_path / "map.toml")
    (tmp_path / "logs").mkdir()
    (tmp_path / "map.toml").rename(tmp_path / "logs" / "map.toml")
    monkeypatch.chdir(tmp_path)
    for given in (Path("logs", "map.toml"), Path("logs") / ".." / "logs" / "map.toml"):
        assert load_mapping(given).model_reference == str(Path("own", "crane.fmu"))


def test_a_missing_mapping(tmp_path):
    with pytest.raises(DataError, match=r"nowhere.toml: the mapping cannot be read"):
        load_mapping(tmp_path / "nowhere.toml")


def test_a_mapping_in_memory_is_checked_as_well():
    with pytest.raises(ValidationError):
        Mapping.model_validate({"time": {"column": "t"}, "signals": {}})


@pytest.mark.parametrize(
    "path", sorted((TOP / "examples" / "mappings").glob("*.toml")), ids=lambda path: path.stem
)
def test_the_example_mappings_are_valid(path):
    mapping = load_mapping(path)
    assert mapping.name
    assert mapping.description
    assert math.prod(len(column.unit) for column in mapping.signals.values()) > 0


TWO_RECORDS = """
time = {{ step = 0.1, unit = "s" }}
[signals]
u = {{ column = "uEst", unit = "1", gain = 0.5 }}
slew = {{ column = "yEst", unit = "deg" }}
[held_out]
u = "uVal"
{line}
"""


def test_a_second_record_in_the_same_file_is_held_out(tmp_path, monkeypatch):
    """Benchmarks keep both in one file; before, one had to be cut out of it."""
    path, mapping = tmp_path / "log.mat", tmp_path / "log.toml"
    savemat(
        path, {"uEst": np.ones(9), "yEst": np.arange(9.0), "uVal": np.zeros(5), "yVal": np.arange(5.0) ** 2}
    )
    mapping.write_text(TWO_RECORDS.format(line='slew = "yVal"'), encoding="utf-8")
    seen = []
    monkeypatch.setattr(diagnosing, "diagnose_into", lambda folder, logs, *rest: seen.extend((logs, rest[5])))
    asked = diagnosing.Asked([path], None, mapping, None, [], 0.01, False, math.inf, tmp_path)
    diagnosing.run(asked)
    (log,), (held,) = seen
    np.testing.assert_array_equal(log["u"], np.full(9, 0.5))
    np.testing.assert_array_equal(held["u"], np.zeros(5))
    np.testing.assert_allclose(np.degrees(held["slew"]), np.arange(5.0) ** 2)
    np.testing.assert_allclose(held.time, 0.1 * np.arange(5))
    # another log that is asked for takes precedence
    diagnosing.run(dataclasses.replace(asked, held_out=[log]))
    assert seen[3] == [log]


@pytest.mark.parametrize(
    ("line", "said"),
    [('slow = "yVal"', "'slow' is not a signal.*did you mean 'slew'"), ('time = "t"', "'time' is not a")],
)
def test_a_second_record_has_the_signals_of_the_first(tmp_path, line, said):
    mapping = tmp_path / "log.toml"
    mapping.write_text(TWO_RECORDS.format(line=line), encoding="utf-8")
    with pytest.raises(DataError, match=said):
        load_mapping(mapping)


def test_the_second_record_may_have_a_time_of_its_own():
    mapping = Mapping.model_validate(
        {
            "time": {"column": "t1", "unit": "s"},
            "signals": {"u": {"column": "u1", "unit": "1"}},
            "held_out": {"time": "t2", "u": "u2"},
        }
    ).of_held_out
    assert (mapping.time.column, mapping.signals["u"].column, mapping.held_out) == ("t2", "u2", {})


def test_an_angle_that_begins_anew_goes_on(tmp_path):
    """Within one turn, with a sample missing where it begins anew; before, it had to be unwrapped by hand."""
    path, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    angle = 5.0 * np.arange(200.0) - 30.0
    shown = [f"{a % 360.0:.1f}" for a in angle]
    shown[79] = ""
    path.write_text(
        "t,u,a\n" + "".join(f"{0.01 * k:.2f},0,{a}\n" for k, a in enumerate(shown)), encoding="utf-8"
    )
    text = 'time = {{ column = "t", unit = "s" }}\n[signals]\nslew = {{ column = "a", unit = "deg"{} }}\n'
    mapping.write_text(text.format(", period = 360"), encoding="utf-8")
    log = load_log(path, mapping)
    np.testing.assert_allclose(np.degrees(log["slew"]), angle + 360.0, atol=1e-9)
    mapping.write_text(text.format(""), encoding="utf-8")
    assert np.ptp(np.degrees(load_log(path, mapping)["slew"])) < 360.0
