"""Tables within another file: compressed text (.csv.gz, .csv.zip, ...) and the sheets of a workbook (.xlsx).

Both become a plain text file in a temporary folder, so that every check of a text file holds for them too.
"""

import bz2
import csv
import gzip
import lzma
import weakref
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import pyarrow as pa

from cosim.errors import DataError, MissingExtraError, ModelError
from cosim.files import Scratch
from cosim.logs.source import translated
from cosim.logs.text import TextSource

_BLOCK = 1 << 22
TABS = "\t"
_DAMAGES = (
    OSError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, NotImplementedError, ValueError, pa.ArrowException,
)  # fmt: skip


def _zstd(path: Path) -> IO[bytes]:
    return pa.CompressedInputStream(pa.OSFile(str(path)), "zstd")


_OPENERS: dict[str, Callable[[Path], Any]] = {
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
    ".zst": _zstd,
}
ZIP = ".zip"
PACKED = (*_OPENERS, ZIP)
"""Endings of compressed files."""


class PackedText(TextSource):
    """A compressed text file.

    Args:
        path: the file.
        texts: endings that a text file's name has.
        options: of `TextSource`.

    Raises:
        DataError: it is damaged, cut short or too large, or holds no text file or several.
    """

    def __init__(self, path: Path, texts: tuple[str, ...], **options: Any) -> None:
        text = beside(self)
        if path.suffix.lower() == ZIP:
            with _only_entry(path, texts) as stream:
                _unpack(path, stream, text)
        else:
            with _readable(path), _OPENERS[path.suffix.lower()](path) as stream:
                _unpack(path, stream, text)
        super().__init__(path, text=text, **options)


def beside(source: TextSource) -> Path:
    """A text file to write, in a temporary folder that goes with the source."""
    folder = Scratch("cosim_log_")
    weakref.finalize(source, folder.cleanup)
    return Path(folder.name, "log.csv")


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turns what a decompressor says of a damaged file into a `DataError`.

    Raises:
        DataError: the file is damaged or cut short.
    """
    try:
        yield
    except EOFError:
        raise DataError(f"{path}: the compressed file is cut short: copy it again") from None
    except _DAMAGES as error:
        raise DataError(
            f"{path}: cannot be unpacked ({' '.join(str(error).split())}): copy it again"
        ) from None


@contextmanager
def _only_entry(path: Path, texts: tuple[str, ...]) -> Iterator[IO[bytes]]:
    """The text file in a zip archive.

    Raises:
        DataError: the archive is bad, or holds none or several.
    """
    from cosim.ssp.archive import open_archive  # here, since a plain log needs none of it

    with _readable(path):
        try:
            archive = open_archive(path, str(path))
        except ModelError as error:
            raise DataError(str(error)) from None
        with archive:
            named = [entry.filename for entry in archive.infolist() if not entry.is_dir()]
            found = [n for n in named if n.lower().endswith(texts) and not n.startswith("__MACOSX/")]
            if len(found) != 1:
                inside = ", ".join(named[:9]) or "nothing"
                raise DataError(
                    f"{path}: {'no' if not found else 'more than one'} text file is in it ({inside}): unpack it, and give "
                    "the log"
                )
            with archive.open(found[0]) as stream:
                yield stream


def _unpack(path: Path, stream: IO[bytes], text: Path) -> None:
    """Write what a stream holds into a file.

    Raises:
        DataError: it is more than a log can be.
    """
    from cosim.ssp.archive import LARGEST, LARGEST_RATIO, SUSPICIOUS_SIZE

    packed, full = path.stat().st_size, 0
    with text.open("wb") as file:
        while block := stream.read(_BLOCK):
            full += len(block)
            if full > LARGEST or (full > SUSPICIOUS_SIZE and full > LARGEST_RATIO * packed):
                raise DataError(
                    f"{path}: {packed / 1e6:.3g} MB unpack to more than {full / 1e6:.3g} MB, which is refused as a "
                    "decompression bomb: unpack it yourself if you trust it"
                )
            file.write(block)


class Workbook(TextSource):
    """A sheet of an Excel workbook (.xlsx): the first that has a value, or the mapping's.

    Args:
        path: the file.
        sheet: its name; by default the first that has a value.
        options: of `TextSource`; separator and decimal sign are those of the sheet.

    Raises:
        MissingExtraError: openpyxl is not installed.
        DataError: it is damaged, too large, or has no such sheet or no value.
    """

    def __init__(self, path: Path, sheet: str | None = None, **options: Any) -> None:
        try:
            from openpyxl import load_workbook
        except ImportError:
            raise MissingExtraError(f"reading {path.name}", "xlsx") from None
        from cosim.ssp.archive import open_archive

        try:
            open_archive(path, str(path)).close()
        except ModelError as error:
            raise DataError(f"{error}; a workbook of before 2007 is to be saved as .xlsx") from None
        text = beside(self)
        notes: list[str] = []
        with translated(path, "XLSX", notes):
            book = load_workbook(path, read_only=True, data_only=True)
            try:
                names = [page.title for page in book.worksheets]
                if sheet is not None and sheet not in names:
                    raise DataError(f"{path}: has no sheet '{sheet}'; its sheets: {', '.join(names)}")
                wanted = names if sheet is None else [sheet]
                read = next((name for name in wanted if _write_sheet(book[name], text)), None)
            finally:
                book.close()
        if read is None:
            raise DataError(f"{path}: no value is in {'it' if sheet is None else f'the sheet {sheet!r}'}")
        super().__init__(path, text=text, **{**options, "separator": TABS, "decimal": options.get("decimal")})
        self.warnings += notes
        if sheet is None and len(names) > 1:
            others = ", ".join(f"'{name}'" for name in names if name != read)
            self.warnings.append(f"the sheet '{read}' was read; beside it: {others}")


def _write_sheet(page: Any, text: Path) -> bool:
    """Write a sheet as text, a row a line; whether there is a value."""
    page.reset_dimensions()  # what a program wrote into the file need not be true
    values = False
    with text.open("w", encoding="utf-8", newline="") as file:
        rows, waiting, width = csv.writer(file, delimiter=TABS, lineterminator="\n"), 0, 0
        for row in page.iter_rows(values_only=True):
            cells = [_cell(value) for value in row]
            while cells and not cells[-1]:
                cells.pop()
            if not cells:
                waiting += 1  # blank rows at the end of a sheet are no rows
                continue
            file.write("\n" * waiting)
            width, waiting, values = max(width, len(cells)), 0, True
            rows.writerow(cells + [""] * (width - len(cells)))
    return values


def _cell(value: object) -> str:
    """A cell as text."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(value)
    return value.isoformat(" ") if isinstance(value, datetime) else str(value)
