"""MAT files with a Simulink data set: in memory (objects of MATLAB) and logged to a file (streams)."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import DataError
from cosim.logs import load_log
from cosim.logs.guess import guesses
from cosim.logs.overview import overview

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # mat-io sets a pandas option that pandas 3 deprecates
    matio = pytest.importorskip("matio", reason="the extra 'mat' is not installed")
    from matio.utils.matclass import MatlabOpaque
h5py = pytest.importorskip("h5py", reason="comes with the extra 'mat'")

TIME = np.arange(400) / 2000
COMMAND = 12.0 * np.sin(40 * TIME)
SPEED = 200.0 * np.sin(40 * TIME - 0.5)


def text(folder, name, value):
    """A text as MATLAB keeps it in version 7.3."""
    letters = np.frombuffer(value.encode("utf-16-le"), "<u2").reshape(-1, 1)
    made = folder.create_dataset(name, data=letters if value else np.zeros(2, dtype="<u8"))
    if not value:
        made.attrs["MATLAB_empty"] = np.uint8(1)


def describe(folder, name, stream, kind, clock, width=1, units="seconds"):
    """The structure that says which stream a signal is, and when it was sampled."""
    signal = folder.create_group(name)
    values = signal.create_group("Values")
    values["DataR2"] = np.array([[float(stream)]])
    if isinstance(clock, int):
        values["TimeR2"] = np.array([[float(clock)]])
    else:
        values["CompressedTime"] = np.array(clock, dtype=float).reshape(-1, 1)
    for unit, word in (("TimeUnits", units), ("DataUnits", "")):
        text(values.create_group(unit), "Value", word)
    about = values.create_group("SignalAttributes")
    text(about, "ClassName", kind)
    about["Dimension"] = np.array([[width]], dtype="<u4")
    about["Complexity"] = np.zeros((1, 1), dtype="u1")
    return signal


@pytest.fixture
def logged(tmp_path):
    """A file as Simulink logs to it: the command without a name, behind a block, and the speed in single precision."""
    path = tmp_path / "logsout.mat"

    def make(units="seconds", lost=False, own_stamps=False, pair=False, count=TIME.size):
        with h5py.File(path, "w", userblock_size=512) as made:
            refs = made.create_group("#refs#")
            regular = [0.0, 0.0005, count]
            speed = describe(refs, "a", 1, "single", 2 if own_stamps else regular, 2 if pair else 1, units)
            text(speed, "Name", "Angular_Velocity")
            command = describe(refs, "b", 7 if lost else 0, "double", regular, units=units)
            text(command, "Name", "")
            text(refs, "c", "bench/drive/Chirp")
            command["BlockPath"] = np.array([[refs["c"].ref]], dtype=h5py.ref_dtype)
            data_set = refs.create_group("d")
            data_set["Elements"] = np.array(
                [[refs["b"].ref], [speed.ref]], dtype=h5py.ref_dtype
            )  # not in the order of their names
            fast = np.column_stack([SPEED, -SPEED]) if pair else SPEED
            for number, values in enumerate((COMMAND, fast.astype("<f4"), TIME)):
                stream = made.create_group(f"#sigstream#/{number}")
                stream["#data#"] = np.frombuffer(values.tobytes(), dtype=np.uint8)
            made["data"] = np.zeros((1, 6), dtype=np.uint32)
            made["data"].attrs["MATLAB_class"] = np.bytes_(b"Simulink.SimulationData.Dataset")
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        return path

    return make


@pytest.mark.parametrize("own_stamps", [False, True])
def test_a_data_set_logged_to_a_file_is_read(logged, own_stamps):
    found = overview(logged(own_stamps=own_stamps))
    assert [c.label.text for c in found.columns] == ["Chirp", "Angular_Velocity"], "the order of the data set"
    np.testing.assert_array_equal(found.columns[0].values, COMMAND)
    np.testing.assert_array_equal(found.columns[1].values, SPEED.astype("f4"))
    np.testing.assert_allclose(found.clock.seconds, TIME, rtol=1e-15)


def test_a_logged_vector_has_a_column_for_each_element(logged):
    columns = {c.label.text: c.values for c in overview(logged(pair=True)).columns}
    assert list(columns) == ["Chirp", "Angular_Velocity(1)", "Angular_Velocity(2)"]
    np.testing.assert_array_equal(columns["Angular_Velocity(1)"], -columns["Angular_Velocity(2)"])


def test_what_info_says_of_time_where_each_signal_has_its_own(logged, finished):
    told = finished("info", logged()).stdout.splitlines()[0]
    assert "no gap; each column has stamps of its own; 2 of 2 columns look like" in told


def test_stamps_of_a_logged_signal_in_milliseconds(logged):
    assert overview(logged(units="milliseconds")).clock.step == pytest.approx(0.5e-6)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({"lost": True}, "does not say where its samples lie"),
        ({"units": "weeks"}, "save it in seconds"),
        ({"count": 1e15}, "400 values, but not as many time stamps"),
    ],
)
def test_a_logged_signal_that_cannot_be_read_is_said_by_name(logged, damage, message):
    with pytest.raises(DataError, match=message):
        load_log(logged(**damage))


def test_streams_that_nothing_describes_are_refused_with_the_way_out(tmp_path: Path) -> None:
    file = tmp_path / "logsout.mat"
    with h5py.File(file, "w", userblock_size=512) as made:  # as MATLAB lays such a file out
        made.create_group("#sigstream#/0")["#data#"] = np.zeros(80, dtype=np.uint8)
        made["data"] = np.zeros((1, 6), dtype=np.uint32)
        made["data"].attrs["MATLAB_class"] = np.bytes_(b"Simulink.SimulationData.Dataset")
    with file.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    with pytest.raises(DataError, match=r"Simulink data set.*writetimetable\(extractTimetable"):
        load_log(file)


def series(name, values, inner=True):
    """A timeseries as it stands in a data set, whose stamps lie in its TimeInfo."""
    info = MatlabOpaque({"Units": np.array(["seconds"]), "Time_": TIME.reshape(-1, 1)}, "tsdata.timemetadata")
    fields = {"Name": np.array([name if inner else ""]), "Data_": values, "Time_": np.empty((0, 0))}
    return MatlabOpaque(fields | {"TimeInfo": info}, "timeseries")


def cell(*items):
    made = np.empty((1, len(items)), dtype=object)
    made[0] = items
    return made


@pytest.mark.parametrize("version", ["v7", "v7.3"])
@pytest.mark.parametrize("signals", [False, True])
def test_a_data_set_in_memory_is_read(tmp_path, version, signals):
    """Its elements are timeseries, or signals that hold one and have the name."""
    made = [series(n, v.reshape(-1, 1), not signals) for n, v in (("input", COMMAND), ("omega", SPEED))]
    if signals:
        made = [
            MatlabOpaque({"Name": np.array([n]), "Values": v}, "Simulink.SimulationData.Signal")
            for n, v in zip(("input", "omega"), made, strict=True)
        ]
    storage = MatlabOpaque({"Elements": cell(*made)}, "Simulink.SimulationData.Storage.RamDatasetStorage")
    content = {"data": MatlabOpaque({"Storage": storage}, "Simulink.SimulationData.Dataset")}
    path = tmp_path / "bench.mat"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), content, version=version)
    found = overview(path)
    assert [c.label.text for c in found.columns] == ["data.input", "data.omega"]
    made_of = guesses(found, machine=True)
    assert {name: g.column.label.short for name, g in made_of.items()} == {"u": "input", "speed": "omega"}
    np.testing.assert_array_equal(found.columns[1].values, SPEED)
    np.testing.assert_allclose(found.clock.seconds, TIME, rtol=1e-15)


@pytest.mark.parametrize("last", [False, True])
def test_a_timeseries_of_several_signals_has_a_column_for_each(tmp_path, last):
    """Time runs along the first axis of the data, or along the last."""
    both = np.column_stack([COMMAND, SPEED])
    values = both.T.reshape(2, 1, TIME.size) if last else both
    path = tmp_path / "out.mat"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), {"data": series("", values)}, version="v7")
    found = overview(path)
    assert [c.label.text for c in found.columns] == ["data(1)", "data(2)"]
    np.testing.assert_array_equal(found.columns[0].values, COMMAND)
    np.testing.assert_array_equal(found.columns[1].values, SPEED)
