"""What dSPACE ControlDesk exports, CSV and MAT: traces told apart by path, two columns in one signal."""

import numpy as np
import pytest
from scipy.io import savemat

from cosim.errors import DataError
from cosim.logs import load_log, load_mapping
from cosim.logs.guess import guesses, mapping_text
from cosim.logs.overview import overview

HEAD = """descriptions,General,User,kim
,General,DateTime,2025-09-03 오후 12:24:46
,General,Origin,"Software: a.sdf, a.rta\\nVersion: 7.2"
,Measurement,Length,0.29

trace_size,30
trace_types,5,4,4,4,4,4
trace_names,,In1,In1,up_duty,dn_duty,In1
trace_units,,,,,,bar
description,,,,,,
path,,Root/Angles(22)/Boom,Root/Angles(22)/Arm,Root/Commands,Root/Commands,Root/Pressure(22)/Boom
min,,-1.8e308,-1.8e308,0,0,0
"""
MAPPING = """
[file]
encoding = "cp949"
[time]
column = "time"
[signals.u]
column = "up_duty"
minus = "dn_duty"
unit = "%"
[signals.slew]
column = "Angles(22)/Boom"
unit = "deg"
plausible = [-60, 30]
[signals.pressure]
column = "Root/Pressure(22)/Boom/In1"
"""


def export(count=30):
    rows = [f"{k / 100:.2f},{-k},{2 * k},{50 * (k > 9)},{20 * (k < 5)},{100 + k}" for k in range(count)]
    return HEAD + "trace_values," + "\n,".join(rows) + "\n\n"


@pytest.fixture
def mapping(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(MAPPING)
    return path


def test_an_export_is_read_by_paths(write, mapping):
    log = load_log(write(export(), encoding="cp949"), mapping)
    assert log.warnings == ()
    np.testing.assert_allclose(log.time, np.arange(30) / 100, atol=1e-15)
    np.testing.assert_allclose(log["slew"], np.radians(-np.arange(30.0)), rtol=1e-15)
    np.testing.assert_allclose(log["pressure"], 1e5 * (100 + np.arange(30.0)), rtol=1e-15)
    assert log["u"].tolist() == [-0.2] * 5 + [0] * 5 + [0.5] * 20
    assert log.held == {"u"}


def test_traces_of_one_name_must_be_told_apart(write, mapping):
    mapping.write_text(MAPPING.replace("Angles(22)/Boom", "In1"))
    with pytest.raises(DataError, match=r"from column 'In1', which is not there.*Root/Angles\(22\)/Boom/In1"):
        load_log(write(export(), encoding="cp949"), mapping)
    mapping.write_text(MAPPING.replace("Angles(22)/Boom", "Boom"))  # an angle and a pressure
    with pytest.raises(DataError, match="from column 'Boom', which is not there"):
        load_log(write(export(), encoding="cp949"), mapping)


def test_rows_are_held_against_the_number_announced(write, mapping):
    log = load_log(write(export(27), encoding="cp949"), mapping)
    assert len(log) == 27
    assert log.warnings == ("27 rows were read, the header announces 30",)


def test_places_are_counted_as_an_editor_does(write, mapping):
    text = export().replace("\n,0.10,-10,", "\n,0.10,-99,")
    warnings = load_log(write(text, encoding="cp949"), mapping).warnings
    assert "plausible are -60 to 30: check unit and scaling (first: row 23)" in warnings[0]
    assert text.split("\n")[22].startswith(",0.10")
    with pytest.raises(DataError, match=r"row 23, column 'Root/Angles\(22\)/Boom/In1': 'x' is not a number"):
        load_log(write(text.replace("-99", "x"), encoding="cp949"), mapping)


@pytest.mark.parametrize("lost", ["trace_names", "trace_values"])
def test_a_header_block_that_is_not_whole_is_refused(write, mapping, lost):
    with pytest.raises(DataError, match=r"log\.csv: row 1 is that of a ControlDesk export, but"):
        load_log(write(export().replace(lost, "x"), encoding="cp949"), mapping)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"cp949"', '"klingon"'), r"'file\.encoding': 'klingon' is not the name of an encoding"),
        (('"cp949"', '"utf-16"'), r"'file\.encoding': a file in 'utf-16' is not read: save it as UTF-8"),
        (("[-60, 30]", "[30, -60]"), r"'signals\.slew\.plausible': give the lowest value first"),
    ],
)
def test_wrong_keys_are_named(mapping, change, message):
    mapping.write_text(MAPPING.replace(*change))
    with pytest.raises(DataError, match=message):
        load_mapping(mapping)


def recorded(axes):
    """What ControlDesk saves as a MAT file: axes ``X`` and traces ``Y``, each of which says its axis."""
    axis = [("Data", object), ("Unit", object)]
    trace = [("Name", object), ("Path", object), ("Unit", object), ("XIndex", object), ("Data", object)]
    x, y = np.zeros((1, len(axes)), axis), np.zeros((1, 3), trace)
    for k, (stamps, unit) in enumerate(axes):
        x[0, k] = (stamps, unit)
    for k, (name, path, unit, number) in enumerate(
        (
            ("In1", "Root/Angles/Boom", "deg", 1),
            ("In1", "Root/Angles/Arm", "deg", 1),
            ("duty", "Root", "", len(axes)),
        )
    ):
        y[0, k] = (name, path, unit, number, np.arange(axes[number - 1][0].size) * float(k + 1))
    return {"rec_012": {"X": x, "Y": y, "Info": {"Revision": 3}}}


def test_a_recorded_mat_file_has_traces_by_path_and_name(tmp_path):
    file = tmp_path / "rec.mat"
    savemat(file, recorded([(np.arange(50) * 0.01, "s"), (np.arange(100) * 5.0, "ms")]))
    found = overview(file)
    assert [c.label.text for c in found.columns] == [
        "Root/Angles/Boom/In1",
        "Root/Angles/Arm/In1",
        "Root/duty",
    ]
    assert [c.unit for c in found.columns] == ["deg", "deg", None]
    text = mapping_text(found, guesses(found, machine=True), None)
    assert 'column = "Root/Angles/Boom/In1"' in text
    assert 'column = "Root/duty"' in text
    mapping = tmp_path / "m.toml"
    lines = (
        "[signals.slew]",
        'column = "Arm"',
        'unit = "deg"',
        "[signals.u]",
        'column = "duty"',
        'unit = "1"',
    )
    mapping.write_text("\n".join([*lines, "[time]", 'column = "duty"', 'unit = "s"']) + "\n")
    log = load_log(file, mapping)
    assert log.time[-1] == pytest.approx(0.495)  # of the trace with the most samples, told in ms
    np.testing.assert_allclose(np.degrees(log["slew"][:99:2]), 2.0 * np.arange(50), atol=1e-9)


def test_a_recorded_trace_without_its_axis_is_refused(tmp_path):
    file = tmp_path / "rec.mat"
    content = recorded([(np.arange(50) * 0.01, "s")])
    content["rec_012"]["Y"][0, 1]["Data"] = np.arange(7.0)
    savemat(file, content)
    with pytest.raises(DataError, match=r"trace 'Root/Angles/Arm/In1' has 7 values and no axis"):
        overview(file)


def test_the_names_of_the_lines_are_no_column(write):
    found = overview(write(export(), encoding="cp949"))
    assert [c.label.text for c in found.columns][:2] == ["time", "Root/Angles(22)/Boom/In1"]
    assert len(found.columns) == 6
    assert not any(c.why for c in found.columns)
    np.testing.assert_array_equal(found.columns[1].values, -np.arange(30.0))
