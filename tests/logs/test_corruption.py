"""Laws: what is written is read again, and no damage whatever raises anything but a CosimError."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_files import csv_text, full_log_columns, rows

from cosim.errors import CosimError
from cosim.logs import load_log, load_mapping, write_log

CLEAN = csv_text(full_log_columns(40)).encode()
COMMA = (
    "time [s];u [1];slew [deg]\n" + "\n".join(rows(30)).replace(",", ";").replace(".", ",") + "\n"
).encode()
quick = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def attempt(content, suffix=".csv"):
    """Loads damaged content; what comes back must be a sound log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{suffix}"
        path.write_bytes(content)
        try:
            log = load_log(path)
        except CosimError as error:
            message = str(error)
        else:
            assert (np.diff(log.time) > 0).all()
            assert all(
                np.isfinite(values).all() and len(values) == len(log) for values in log.signals.values()
            )
            return
        assert str(path) in message
        assert "Traceback" not in message


@st.composite
def damaged(draw, clean):
    data = bytearray(clean)
    for _ in range(draw(st.integers(1, 8))):
        kind = draw(st.sampled_from(["flip", "cut", "drop", "double", "swap", "insert"]))
        at = draw(st.integers(0, max(0, len(data) - 1)))
        if kind == "flip" and data:
            data[at] = draw(st.integers(0, 255) | st.sampled_from(b',;\n\r"\t.-+eE0\0'))
        elif kind == "cut":
            del data[at:]
        elif kind == "insert":
            data[at:at] = draw(
                st.binary(max_size=12) | st.sampled_from([b"NaN", b"\n", b",,", b'"', b"\r\n", b"1e999"])
            )
        else:
            lines = bytes(data).split(b"\n")
            i, j = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
            if kind == "drop":
                del lines[i]
            elif kind == "double":
                lines.insert(j, lines[i])
            else:
                lines[i], lines[j] = lines[j], lines[i]
            data = bytearray(b"\n".join(lines))
    return bytes(data)


@quick
@given(damaged(CLEAN) | damaged(COMMA))
def test_a_damaged_csv_never_raises_anything_else(content):
    attempt(content)


@quick
@given(st.binary(max_size=300) | st.text('time [sude]1,;\n".0-e\t', max_size=200).map(str.encode))
def test_any_bytes_as_csv(content):
    attempt(content)


@pytest.fixture(scope="module")
def binary_logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("binary")
    (folder / "log.csv").write_bytes(CLEAN)
    log = load_log(folder / "log.csv")
    return {suffix: write_log(log, folder / f"log{suffix}").read_bytes() for suffix in (".mat", ".parquet")}


@settings(quick, max_examples=30)
@given(st.data(), st.sampled_from([".mat", ".parquet"]))
def test_a_damaged_binary_file_never_raises_anything_else(binary_logs, data, suffix):
    content = bytearray(binary_logs[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    attempt(bytes(content[: data.draw(st.integers(0, len(content)))]), suffix)


@quick
@given(st.text(max_size=200) | st.text('[]{}"=.timesgnalscou\n123 ', max_size=80))
def test_any_text_as_mapping(tmp_path, text):
    path = tmp_path / "map.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(CosimError, match=r"map\.toml"):
        load_mapping(path)


values = st.floats(-1e6, 1e6, allow_subnormal=False)


@settings(quick, max_examples=40)
@given(
    st.lists(st.tuples(values, values, values), min_size=2, max_size=30),
    st.floats(1e-4, 10),
    st.booleans(),
    st.sampled_from([".csv", ".parquet", ".mat"]),
)
def test_what_is_written_is_read_again(tmp_path, samples, step, synthetic, suffix):
    spool, pressure, slew = map(np.array, zip(*samples, strict=True))
    columns = {
        ("time", "s"): np.arange(len(samples)) * step,
        ("spool", "mm"): spool,
        ("p_a", "bar"): pressure,
        ("slew", "deg"): slew,
    }
    if synthetic:
        columns["synthetic", "1"] = np.ones(len(samples))
    path = tmp_path / "first.csv"
    path.write_text(csv_text(columns))
    log = load_log(path)
    again = load_log(write_log(log, tmp_path / f"again{suffix}"))
    assert again.synthetic is synthetic
    np.testing.assert_array_equal(again.time, log.time)
    for name in log.signals:
        np.testing.assert_allclose(again[name], log[name], rtol=5e-16, atol=0)
