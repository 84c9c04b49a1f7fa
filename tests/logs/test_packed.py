"""Compressed text files and workbooks: the same log, the same checks, and limits for bombs."""

import bz2
import datetime
import gzip
import io
import lzma
import sys
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from log_files import HEADER, csv_text, full_log_columns, rows

from cosim.api.looking import facts_of
from cosim.errors import DataError, MissingExtraError
from cosim.logs import load_log, packed
from cosim.logs.load import ending, stem
from cosim.logs.mapping import load_mapping
from cosim.logs.overview import overview

write_sheet = packed._write_sheet
TEXT = csv_text(full_log_columns())


def zipped(data):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("__MACOSX/._log.csv", b"\0")
        archive.writestr("run/", b"")
        archive.writestr("run/log.csv", data)
    return out.getvalue()


def zstd(data):
    return pa.compress(data, "zstd", asbytes=True)


PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress, ".zst": zstd, ".zip": zipped}


@pytest.fixture
def plain(write):
    return load_log(write(TEXT))


def same(log, other, rtol=0.0):
    assert set(log.signals) == set(other.signals)
    np.testing.assert_allclose(log.time, other.time, rtol=rtol, atol=0)
    for name in other.signals:
        np.testing.assert_allclose(log[name], other[name], rtol=rtol, atol=0)


@pytest.mark.parametrize("kind", PACKERS)
def test_a_compressed_log_is_the_log(tmp_path, plain, kind):
    path = tmp_path / f"log.csv{kind}"
    path.write_bytes(PACKERS[kind](TEXT.encode()))
    log = load_log(path)
    same(log, plain)
    assert log.source == path
    assert log.warnings == ()
    assert overview(path).samples == 400


@pytest.mark.parametrize("kind", PACKERS)
def test_damage_within_is_told_as_of_a_plain_file(tmp_path, kind):
    lines = rows()
    lines[9] = "0.009,1,x"
    path = tmp_path / f"log.csv{kind}"
    path.write_bytes(PACKERS[kind]((HEADER + "\n".join(lines) + "\n").encode()))
    with pytest.raises(
        DataError, match=rf"log.csv{kind}: row 11, column 'slew \[deg\]': 'x' is not a number"
    ):
        load_log(path)


@pytest.mark.parametrize("kind", PACKERS)
def test_a_file_cut_short_or_damaged_is_refused(tmp_path, kind):
    whole = PACKERS[kind](TEXT.encode())
    path = tmp_path / f"log.csv{kind}"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=rf"log.csv{kind}.*(copy it again|or copy it again)"):
        load_log(path)
    path.write_bytes(b"time [s],u [1]\n" * 20)
    with pytest.raises(DataError, match="again"):
        load_log(path)


@pytest.mark.parametrize("kind", PACKERS)
def test_a_bomb_is_refused_while_it_is_unpacked(tmp_path, monkeypatch, kind):
    monkeypatch.setattr("cosim.ssp.archive.SUSPICIOUS_SIZE", 1 << 20)
    path = tmp_path / f"log.csv{kind}"
    path.write_bytes(PACKERS[kind](HEADER.encode() + b"0,0,0\n" * (1 << 20)))
    with pytest.raises(DataError, match="bomb"):
        load_log(path)


def test_an_archive_holds_one_log(tmp_path):
    for names, told in (
        (("a.csv", "b.csv"), "more than one text file is in it"),
        (("a.pdf",), "no text file"),
    ):
        path = tmp_path / "logs.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name in names:
                archive.writestr(name, TEXT)
        with pytest.raises(DataError, match=f"logs.zip: {told}.*unpack it"):
            load_log(path)


def test_names_of_logs():
    assert ending("Run.CSV.GZ") == ".csv.gz"
    assert ending("run.mat") == ".mat"
    assert ending("run.tar.gz") is None
    assert stem(Path("a/run.csv.gz")) == "run"


def test_a_table_without_names_is_read_by_a_mapping(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress("\n".join(rows()).encode() + b"\n"))
    assert overview(path).samples == 30
    mapping = tmp_path / "m.toml"
    mapping.write_text(
        'name = "x"\nfile.header = false\ntime = {column = 1, unit = "s"}\nsignals.u = {column = 2, unit = "1"}\n'
    )
    assert len(load_log(path, mapping)) == 30


@pytest.fixture
def book(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="the extra 'xlsx' is not installed")

    def make(sheets, name="log.xlsx"):
        made = openpyxl.Workbook()
        made.remove(made.active)
        for title, lines in sheets.items():
            page = made.create_sheet(title)
            for line in lines:
                page.append(line)
        made.save(tmp_path / name)
        return tmp_path / name

    return make


def table(columns):
    return [
        [f"{name} [{unit}]" for name, unit in columns],
        *zip(*(v.tolist() for v in columns.values()), strict=True),
    ]


def test_a_workbook_is_the_log(book, plain):
    # openpyxl writes 16 digits
    same(load_log(book({"Sheet1": table(full_log_columns())})), plain, rtol=1e-15)


def test_a_sheet_among_several(book, tmp_path):
    path = book({"Cover": [], "Run 1": table(full_log_columns()), "Run 2": table(full_log_columns(50))})
    log = load_log(path)
    assert (len(log), log.warnings) == (400, ("the sheet 'Run 1' was read; beside it: 'Cover', 'Run 2'",))
    mapping = tmp_path / "m.toml"
    mapping.write_text(
        'name = "x"\nfile.sheet = "Run 2"\ntime.column = "time [s]"\nsignals.u.column = "u [1]"\n'
    )
    assert len(load_log(path, mapping)) == 50
    wrong = load_mapping(mapping).model_copy(
        update={"file": load_mapping(mapping).file.model_copy(update={"sheet": "3"})}
    )
    with pytest.raises(DataError, match="has no sheet '3'; its sheets: Cover, Run 1, Run 2"):
        load_log(path, wrong)


@pytest.mark.parametrize("names", [{}, {"u": "Cmd", "slew": "Angle"}], ids=["ours", "foreign"])
def test_info_converts_a_sheet_once(book, monkeypatch, names):
    lines = table({(names.get(name, name), unit): v for (name, unit), v in full_log_columns().items()})
    path, converted = book({"Sheet1": lines}), []
    monkeypatch.setattr(
        packed, "_write_sheet", lambda page, text: converted.append(page) or write_sheet(page, text)
    )
    assert facts_of(path, plot=True)["samples"] == 400
    assert len(converted) == 1


def test_cells_of_a_workbook(book):
    begin = datetime.datetime(2026, 3, 1, 23, 59, 59)
    stamps = [begin + datetime.timedelta(milliseconds=10 * k) for k in range(300)]
    lines = [
        ["Test 3", None, None],
        ["time", "u [1]", "slew [deg]"],
        *([t, k > 9, 0.1 * k] for k, t in enumerate(stamps)),
    ]
    lines[20][2] = None
    log = load_log(book({"Data": [*lines, [None], []]}))
    assert log.time[-1] == pytest.approx(2.99)
    assert log["u"].tolist() == [0.0] * 10 + [1.0] * 290
    assert np.flatnonzero(~log.valid_mask("slew")).tolist() == [18]
    lines[30][2] = "#DIV/0!"
    with pytest.raises(DataError, match=r"row 31, column 'slew \[deg\]': '#DIV/0!' is not a number"):
        load_log(book({"Data": lines}))


def test_a_workbook_that_is_none(tmp_path, book):
    path = book({"Sheet1": [[]]})
    with pytest.raises(DataError, match="no value is in it"):
        load_log(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(DataError, match=r"log\.xlsx is not a readable zip archive.*as \.xlsx"):
        load_log(path)
    path.write_bytes(zipped(b"a,b\n"))
    with pytest.raises(DataError, match="cannot be read as a XLSX file"):
        load_log(path)


def test_without_the_extra(tmp_path, monkeypatch):
    (tmp_path / "log.xlsx").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(MissingExtraError, match=r"reading log.xlsx needs .*slew-cosim\[xlsx\]"):
        load_log(tmp_path / "log.xlsx")
