"""The same log through every file format, and the shapes MATLAB files come in."""

import dataclasses
import importlib.util
import sys
import warnings

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from log_files import csv_text, full_log_columns
from scipy.io import savemat
from scipy.io.matlab import MatlabObject

from cosim.errors import DataError, MissingExtraError
from cosim.logs import load_log, write_log
from cosim.logs.mat import MatSource
from cosim.logs.overview import overview
from cosim.signals import LOG_SIGNALS

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # mat-io sets a pandas option that pandas 3 deprecates
    try:
        import matio
        from matio.utils.matclass import MatlabOpaque
    except ImportError:  # Python 3.14, for which it has no wheel
        matio = MatlabOpaque = None
needs_matio = pytest.mark.skipif(matio is None, reason="the extra 'mat' is not installed")


@pytest.fixture
def reference(write):
    return load_log(write(csv_text(full_log_columns())))


def assert_same(log, reference):
    assert set(log.signals) == set(reference.signals)
    np.testing.assert_allclose(log.time, reference.time, rtol=1e-15, atol=0)
    for name in reference.signals:
        # one rounding to the log unit and one back
        np.testing.assert_allclose(log[name], reference[name], rtol=5e-16, atol=0)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
@pytest.mark.parametrize("synthetic", [False, True])
def test_written_and_read_again(reference, tmp_path, suffix, synthetic):
    log = dataclasses.replace(reference, synthetic=synthetic)
    again = load_log(write_log(log, tmp_path / "new" / f"again{suffix}"))
    assert_same(again, reference)
    assert again.synthetic is synthetic
    assert again.warnings == ()
    assert again.units == reference.units
    assert set(again.signals) == set(LOG_SIGNALS)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_filled_values_are_written_as_missing(load, tmp_path, suffix):
    log = load([f"{k / 1000:.3f},{k % 2},{'' if k in (3, 4) else k}" for k in range(20)])
    again = load_log(write_log(log, tmp_path / f"again{suffix}"))
    assert np.flatnonzero(~again.valid_mask("slew")).tolist() == [3, 4]
    assert again.valid_mask("u").all()


def names_and_units():
    columns = full_log_columns()
    names, units = zip(*columns, strict=True)
    return columns, list(names), list(units)


def matrix(columns, names, units):
    cell = np.array(names, dtype=object)
    return {
        "data": np.column_stack(list(columns.values())),
        "names": cell,
        "units": np.array(units, dtype=object),
    }


def wide_matrix(columns, names, units):
    heads = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    return {"data": np.vstack(list(columns.values())), "names": heads}


def vectors(columns, names, units):
    values = dict(zip(names, columns.values(), strict=True))
    return {**values, "units": dict(zip(names, units, strict=True))}


def struct(columns, names, units):
    return {"log": {**vectors(columns, names, units), "gain": 2.0, "remark": "by hand"}}


def with_time(columns, names, units):
    """Simulink's structure with time."""
    signals = np.array(
        [
            {"values": values.reshape(-1, 1), "dimensions": 1.0, "label": f"{name} [{unit}]"}
            for (name, unit), values in columns.items()
            if name != "time"
        ],
        dtype=object,
    )
    return {"out": {"time": columns["time", "s"], "signals": signals}}


@pytest.mark.parametrize("shape", [matrix, wide_matrix, vectors, struct, with_time])
def test_shapes_of_mat_files(reference, tmp_path, shape):
    path = tmp_path / "log.mat"
    savemat(path, shape(*names_and_units()), oned_as="column")
    assert_same(load_log(path), reference)


@needs_matio
@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_versions_of_mat_files(reference, tmp_path, version):
    path = tmp_path / "log.mat"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), struct(*names_and_units()), version=version)
    assert_same(load_log(path), reference)


def test_mat_file_version_4(reference, tmp_path):
    columns, names, units = names_and_units()
    path = tmp_path / "log.mat"
    head = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    savemat(path, {"data": np.column_stack(list(columns.values())), "names": np.array(head)}, format="4")
    assert_same(load_log(path), reference)


def timeseries(values, unit, stamps=None, start=0.0, step=0.001):
    """A timeseries with the property names under which MATLAB saves one; equidistant stamps are left implicit."""
    info = {"Units": np.array(["seconds"]), "Start_": np.array([[start]]), "Increment_": np.array([[step]])}
    measured = {"Units": np.array([unit])}
    return MatlabOpaque(
        {
            "Data_": np.asarray(values).reshape(-1, 1),
            "Time_": np.empty((0, 0)) if stamps is None else np.asarray(stamps).reshape(-1, 1),
            "TimeInfo": MatlabOpaque(info, "tsdata.timemetadata"),
            "DataInfo": MatlabOpaque(measured, "tsdata.datametadata"),
        },
        "timeseries",
    )


@pytest.fixture
def save_objects(tmp_path):
    if matio is None:
        pytest.skip("the extra 'mat' is not installed")

    def save(content, version):
        path = tmp_path / "objects.mat"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            matio.save_to_mat(str(path), content, version=version)
        return path

    return save


@pytest.mark.parametrize("version", ["v7", "v7.3"])
@pytest.mark.parametrize("implicit", [True, False])
def test_timeseries(reference, save_objects, version, implicit):
    stamps = None if implicit else reference.time
    columns = full_log_columns()
    content = {
        name: timeseries(values, unit, stamps) for (name, unit), values in columns.items() if name != "time"
    }
    assert_same(load_log(save_objects(content, version)), reference)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_timeseries_that_a_block_streamed_to_a_file(save_objects, version):
    """Its samples lie in a storage, its stamps in its TimeInfo; one that recorded nothing is passed over."""
    time, slew = np.arange(200) / 1000, np.sin(np.arange(200) / 30.0)

    def streamed(values, stamps):
        found = timeseries([], "deg")
        kept = {"Data": np.asarray(values).reshape(1, -1), "IsTimeStorageFirst": np.array([[False]])}
        info = {"Units": np.array(["seconds"]), "Time_": np.asarray(stamps).reshape(-1, 1)}
        found.properties |= {
            "Data_": np.empty((0, 0)),
            "Storage_": MatlabOpaque(kept, "tsdata.StreamingStorage"),
            "TimeInfo": MatlabOpaque(info, "tsdata.timemetadata"),
        }
        return found

    log = load_log(save_objects({"slew": streamed(slew, time), "none": streamed([], [])}, version))
    np.testing.assert_allclose(np.degrees(log["slew"]), slew, atol=1e-12)
    np.testing.assert_array_equal(log.time, time)


def test_timeseries_of_different_rates_share_the_finest_clock(save_objects):
    time = np.arange(200) / 1000
    content = {
        "u": timeseries(np.sign(np.sin(40 * time[::10])), "1", time[::10]),
        "slew": timeseries(30 * time, "deg", time),
    }
    log = load_log(save_objects(content, "v7"))
    assert len(log) == 200
    np.testing.assert_array_equal(log["u"][:191:10], np.sign(np.sin(40 * time[:191:10])))
    np.testing.assert_array_equal(log["u"][5], log["u"][0])  # held
    assert log.warnings[0] == "'u': on a clock of their own, brought to that of 'slew'"
    assert not log.valid_mask("u")[191:].any()


def iddata(inputs, outputs, step=0.01, instants=None, unit="seconds"):
    """Measured data of the System Identification Toolbox, one experiment for each of the pairs, as MATLAB saves it."""

    def cell(values):
        found = np.empty((1, len(values)), dtype=object)
        for k, value in enumerate(values):
            found[0, k] = value
        return found

    count = len(inputs)
    fields = {
        "Domain": "Time",
        "OutputData": cell([np.asarray(y, float).reshape(-1, 1) for y in outputs]),
        "OutputName": cell(["Boom angle"]),
        "OutputUnit": cell(["deg"]),
        "InputData": cell([np.asarray(u, float).reshape(-1, 1) for u in inputs]),
        "InputName": cell(["u1"]),
        "InputUnit": cell([""]),
        "Ts": cell([np.array([[step]])] * count if instants is None else [np.empty((0, 0))] * count),
        "Tstart": cell([np.empty((0, 0))] * count),
        "SamplingInstants": cell([np.empty((len(u), 0)) for u in inputs] if instants is None else instants),
        "TimeUnit": unit,
        "Utility": np.array([[(np.array([[2018.0, 11, 27]]),)]], dtype=[("last", "O")]),
    }
    value = np.empty((1, 1), dtype=[(name, "O") for name in fields])
    value[0, 0] = tuple(fields.values())
    return MatlabObject(value, "iddata")


@pytest.mark.parametrize("with_matio", [True, False])
def test_iddata_of_the_system_identification_toolbox(tmp_path, monkeypatch, with_matio):
    """Its inputs and outputs go by their names, with a clock for each experiment; before, the date of saving was read."""
    if not with_matio:
        monkeypatch.setitem(sys.modules, "matio", None)
    path, u, y = tmp_path / "log.mat", np.sin(np.arange(40)), np.cumsum(np.sin(np.arange(40)))
    savemat(path, {"id": iddata([u], [y]), "val": iddata([u[:9]], [y[:9]], step=20.0, unit="milliseconds")})
    found = overview(path)
    assert [(c.label.text, c.unit) for c in found.columns] == [
        ("id.u1", None), ("id.Boom angle", "deg"), ("val.u1", None), ("val.Boom angle", "deg"),
    ]  # fmt: skip
    mapping = tmp_path / "log.toml"
    head = 'time = { column = "val.u1", unit = "s" }\n[signals]\n'
    mapping.write_text(
        head + 'u = { column = "val.u1", unit = "1" }\nslew = { column = "val.Boom angle", unit = "deg" }\n',
        encoding="utf-8",
    )
    log = load_log(path, mapping)
    np.testing.assert_allclose(log.time, 0.02 * np.arange(1, 10))
    np.testing.assert_array_equal(log["u"], u[:9])
    np.testing.assert_allclose(log["slew"], np.radians(y[:9]))


def test_iddata_of_several_experiments_and_of_stamps_of_its_own(tmp_path):
    path, u = tmp_path / "log.mat", np.arange(5.0)
    stamps = [np.array([[0.0], [0.1], [0.3], [0.4], [0.5]])] * 2
    savemat(path, {"z": iddata([u, 2 * u], [u, u], instants=stamps)})
    source = MatSource(path)
    assert [label.text for label in source.labels] == [
        "z{1}.u1",
        "z{2}.u1",
        "z{1}.Boom angle",
        "z{2}.Boom angle",
    ]
    np.testing.assert_array_equal(source.clock(1), stamps[0].ravel())
    np.testing.assert_array_equal(source.read([1])[0], 2 * u)
    savemat(path, {"z": iddata([u], [u], unit="years")})
    with pytest.raises(DataError, match=r"iddata 'z' has no sampling interval in seconds"):
        MatSource(path)


def test_a_matrix_is_read_along_its_longer_side(tmp_path):
    """As Simulink's "To File" writes it: a sample is a column, and the first row is the time."""
    path, t = tmp_path / "log.mat", 0.01 * np.arange(40)
    savemat(path, {"ans": np.vstack([t, np.sin(t), np.cos(t)])})
    found = overview(path)
    assert [c.label.text for c in found.columns] == ["ans(1,:)", "ans(2,:)", "ans(3,:)"]
    assert found.samples == 40
    assert found.clock is not None
    assert found.clock.column == 0


def test_mat_columns_of_different_length(tmp_path):
    path = tmp_path / "log.mat"
    savemat(path, {"time": np.arange(5.0), "u": np.ones(4), "units": {"time": "s", "u": "1"}})
    with pytest.raises(DataError, match="'u' has 4 values, time has 5"):
        load_log(path)


def test_mat_without_units_names_the_column(tmp_path):
    path = tmp_path / "log.mat"
    savemat(path, {"time": np.arange(5.0), "u": np.ones(5)})
    with pytest.raises(DataError, match="column 'time' has no unit"):
        load_log(path)


def test_mat_without_columns(tmp_path):
    path = tmp_path / "log.mat"
    savemat(path, {"text": "hello", "number": 1.0})
    with pytest.raises(DataError, match="holds no column of numbers"):
        load_log(path)


def test_parquet_of_other_types(tmp_path):
    path = tmp_path / "log.parquet"
    field = pa.field("slew", pa.float32(), metadata={"unit": "deg"})
    schema = pa.schema([pa.field("time [s]", pa.float64()), pa.field("u [%]", pa.int16()), field])
    table = pa.table([[0.0, 0.1, 0.2, 0.3], [0, 100, None, -100], [0.0, 0.5, 1.0, 1.5]], schema=schema)
    pq.write_table(table, path)
    log = load_log(path)
    np.testing.assert_array_equal(log["u"], [0, 1, 1, -1])
    assert not log.valid_mask("u")[2]
    np.testing.assert_allclose(log["slew"], np.radians([0, 0.5, 1.0, 1.5]), rtol=1e-15)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"time [s]": [0.0, 1.0], "u [1]": ["a", "b"]},
            r"column 'u \[1\]' is of type (large_)?string, not numbers",
        ),
        ({"time [s]": pa.array([], pa.float64()), "u [1]": pa.array([], pa.float64())}, "no data row"),
    ],
)
def test_parquet_beyond_mending(tmp_path, columns, message):
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path)
    with pytest.raises(DataError, match=message):
        load_log(path)


def test_parquet_with_a_name_twice(tmp_path):
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table([[0.0], [1.0]], names=["u [1]", "u [1]"]), path)
    with pytest.raises(DataError, match=r"more than one column is named 'u \[1\]'"):
        load_log(path)


@pytest.mark.parametrize("suffix", [".mat", ".parquet"])
@pytest.mark.parametrize("content", [b"", b"PAR1" * 100, b"MATLAB 5.0 MAT-file" * 20, bytes(200)])
def test_damaged_binary_files(write, suffix, content):
    with pytest.raises(DataError, match=r"log"):
        load_log(write(content, f"log{suffix}"))


@pytest.mark.parametrize(
    ("suffix", "extra", "module"), [(".mf4", "mf4", "asammdf"), (".tdms", "tdms", "nptdms")]
)
def test_a_missing_extra_is_named(write, suffix, extra, module):
    if importlib.util.find_spec(module):
        with pytest.raises(DataError, match=r"cannot be read as|holds no channel"):
            load_log(write(b"no such format", f"log{suffix}"))
    else:
        with pytest.raises(MissingExtraError, match=rf"slew-cosim\[{extra}\]"):
            load_log(write(b"no such format", f"log{suffix}"))


def test_mf4(reference, tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="extra mf4 is not installed")
    columns = full_log_columns()
    time = columns["time", "s"]
    path = tmp_path / "log.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append(
            [
                asammdf.Signal(samples=values, timestamps=time, name=name, unit=unit)
                for (name, unit), values in columns.items()
                if name != "time"
            ]
        )
        file.save(path)
    assert_same(load_log(path), reference)


@pytest.mark.parametrize("waveform", [True, False])
def test_tdms(reference, tmp_path, waveform):
    nptdms = pytest.importorskip("nptdms", reason="extra tdms is not installed")
    path = tmp_path / "log.tdms"
    clock = {"wf_increment": 0.001, "wf_start_offset": 0.0, "wf_samples": 1} if waveform else {}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("rig", name, values, properties={"unit_string": unit, **clock})
                for (name, unit), values in full_log_columns().items()
                if name != "time" or not waveform
            ]
        )
    log = load_log(path)
    if waveform:
        np.testing.assert_allclose(log.time, reference.time, rtol=1e-12)
        np.testing.assert_array_equal(log["slew"], reference["slew"])
    else:
        assert_same(log, reference)


def flipped(path, at):
    """The file with one bit changed."""
    content = bytearray(path.read_bytes())
    content[at] ^= 0x10
    path.write_bytes(content)
    return path


def test_no_bit_of_our_parquet_changes_in_silence(reference, tmp_path):
    path = write_log(reference, tmp_path / "log.parquet")
    assert_same(load_log(path), reference)
    size = path.stat().st_size
    refused = 0
    for at in np.linspace(4, size - 9, 30, dtype=int):
        try:
            assert_same(load_log(flipped(path, at)), reference)  # statistics, which nobody reads
        except DataError:
            refused += 1
        flipped(path, at)
    assert refused > 27


def test_page_checksums_of_others_are_checked(tmp_path):
    path = tmp_path / "log.parquet"
    table = pa.table({"time [s]": np.arange(500) / 1000, "slew [deg]": np.sin(np.arange(500) / 50)})
    pq.write_table(table, path, write_page_checksum=True, compression="none", use_dictionary=False)
    assert load_log(path).warnings == ()
    at = path.read_bytes().index(np.sin(0.2).tobytes())  # one number of the data
    with pytest.raises(DataError, match=r"cannot be read as a Parquet file: .*CRC"):
        load_log(flipped(path, at))


def test_a_column_unlike_its_checksum_is_named(reference, tmp_path):
    path = write_log(reference, tmp_path / "log.parquet")
    table = pq.read_table(path)
    k = table.column_names.index("slew [deg]")
    changed = table.set_column(k, "slew [deg]", pa.array(table.column(k).to_numpy() + 1.0))
    pq.write_table(changed, path)
    with pytest.raises(
        DataError, match=r"column 'slew \[deg\]' is not that of its checksum: the file is damaged"
    ):
        load_log(path)
    renamed = table.rename_columns([name.replace("p_a", "p_c") for name in table.column_names])
    pq.write_table(renamed.replace_schema_metadata(table.schema.metadata), path)
    with pytest.raises(DataError, match="its columns are not those of its checksums"):
        load_log(path)


def test_a_damaged_mf4_leaves_nothing_on_stderr(write, capfd):
    pytest.importorskip("asammdf", reason="extra mf4 is not installed")
    with pytest.raises(DataError, match="cannot be read as a MDF file"):
        load_log(write(b"MDF     4.10    " + bytes(200), "log.mf4"))
    assert capfd.readouterr().err == ""


@needs_matio
def test_an_endless_loop_in_hdf5_is_refused(tmp_path):
    path = tmp_path / "log.mat"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), struct(*names_and_units()), version="v7.3")
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    place = heap + 16
    while int.from_bytes(content[place : place + 2], "little"):  # to the free space at its end
        place += 16 + -(-int.from_bytes(content[place + 8 : place + 16], "little") // 8) * 8
    content[place + 8 : place + 16] = bytes(8)
    path.write_bytes(content)
    with pytest.raises(
        DataError, match=rf"log\.mat: cannot be read as a MAT file: the heap at byte {heap} is damaged"
    ):
        load_log(path)


@pytest.mark.parametrize("shape", [matrix, wide_matrix, vectors, struct, with_time])
def test_mat_files_without_mat_io(reference, tmp_path, monkeypatch, shape):
    """As on Python 3.14, for which mat-io has no wheel."""
    monkeypatch.setitem(sys.modules, "matio", None)
    path = tmp_path / "log.mat"
    savemat(path, shape(*names_and_units()), oned_as="column")
    assert_same(load_log(path), reference)


def test_what_only_mat_io_reads_names_the_extra(save_objects, monkeypatch):
    stamps = np.arange(5.0)
    for content, version in (({"a": stamps}, "v7.3"), ({"log": {"slew": timeseries(stamps, "deg")}}, "v7")):
        path = save_objects(content, version)
        with monkeypatch.context() as without:
            without.setitem(sys.modules, "matio", None)
            with pytest.raises(MissingExtraError, match=r"slew-cosim\[mat\]'; or save .* in MATLAB"):
                load_log(path)
