"""CSV files: by pyarrow in blocks, straight into float64 columns; a second, careful pass finds out what is wrong.

Rows are counted as an editor counts lines: the header is line 1.
"""

import contextlib
import csv
import dataclasses
import io
import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from cosim.console import typed
from cosim.errors import DataError, HeadlessError, UsageError
from cosim.logs import blanks, controldesk, dates
from cosim.logs.preamble import read_preamble
from cosim.logs.source import Array, Label, Source, parse_label
from cosim.logs.window import Window, head_text, survey
from cosim.units import factor

_MISSING = [
    "",
    "NaN",
    "nan",
    "NAN",
    "-nan",
    "NA",
    "N/A",
    "n/a",
    "#N/A",
    "null",
    "NULL",
    "None",
    "-",
    "1.#QNAN",
    "1.#IND",
]
# LabVIEW's graphs are exported so: 731.5m, 3k
_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
# of a switch, as programs and Excel write it
_TRUTH = {"true": 1.0, "false": 0.0, "wahr": 1.0, "falsch": 0.0}
_PREFIXED = re.compile(r"([-+\d.,eE]*\d[\d.,]*)\s?([pnuµmkMG])")
_IN_BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
_BREAK = re.compile(r"\r\n|\r|\n")
COARSE = 0.005  # of a column's range, beyond which the last digit of an export is told
_BLOCK = 1 << 22


class _RowsError(Exception):
    """As many rows were parsed as no count of lines explains: the file is to be read cell by cell."""


class _DecimalCommaError(Exception):
    """A cell looks like 1,5: the file is to be read again with a decimal comma."""


class TextSource(Source):
    """A CSV file.

    Args:
        path: the file.
        separator: column separator; by default the one in the header (``;`` before tab before ``|`` before ``,``), or runs
            of blanks where the numbers have these alone between them.
        decimal: decimal sign; by default a point, or a comma where the cells show one.
        header: False for a file that starts with data; its columns are then named ``1``, ``2``, ...
        encoding: of the header; by default UTF-8, or Windows-1252 where it is none.
        text: where the text lies, if it was unpacked; messages name `path`.

    Raises:
        DataError: the file is empty, is no text, or has no data rows.
    """

    row_word = "row"

    def __init__(
        self,
        path: Path,
        separator: str | None = None,
        decimal: str | None = None,
        header: bool = True,
        encoding: str | None = None,
        text: Path | None = None,
    ) -> None:
        self._text = path if text is None else text
        self._survey = survey(self._text, encoding, path)
        first = self._survey.first_line
        above = None
        head = head_text(self._text, self._survey, encoding)
        remarks, data = _remarks(head)
        if not header and remarks:
            first = data
        if separator is None and blanks.parted(head, _may_be_number):
            separator = blanks.BLANK
        if header and not first.startswith(controldesk.FIRST):
            above = read_preamble(head, separator, _may_be_value)
        found = separator or next((sign for sign in blanks.SIGNS if sign in first), ",")
        self._separator = found if above is None else above.separator
        self._decimal = decimal
        self._squeezed: bytes | None = None
        self._passed = False
        self._prefixed = False
        self._digits: dict[int, dict[float, int]] = {}  # column -> prefix -> most digits behind the point
        self._told: set[int] = set()  # columns whose prefix was looked at
        self._coarse: set[int] = set()  # and whose few digits were told
        self._surplus = False
        if header and above is None and remarks and self._unnamed(head, remarks, data):
            raise HeadlessError(
                f"{path}: row {remarks + 1} holds numbers, and above it stand remarks, no names: put a header such as "
                f"'time [s],slew [deg]' before it, or let 'cosim init {typed(path)}' write a mapping in which columns go by "
                "their place"
            )
        try:
            cells = blanks.cells(first, self._separator)
        except csv.Error as error:
            raise DataError(f"{path}: the header row cannot be read: {error}") from None
        self._width = len(cells)
        self._header = header
        export = None
        if header and cells[:1] == [controldesk.FIRST]:
            export = controldesk.read_header(head, self._separator)
            if export is None:
                raise DataError(
                    f"{path}: row 1 is that of a ControlDesk export, but the lines 'trace_names' and 'trace_values' are"
                    " not both there: export it again"
                )
        if above is not None:
            cells = [label.text for label in above.labels]
            self._width = len(cells)
        if header and cells and above is None and self._begins_with_data(head, cells):
            raise HeadlessError(
                f"{path}: row 1 holds numbers, not names: put a header such as 'time [s],slew [deg]' before it, or let "
                f"'cosim init {typed(path)}' write a mapping in which columns go by their place"
            )
        labels = [
            parse_label(cell) if header else Label(str(k), str(k), None) for k, cell in enumerate(cells, 1)
        ]
        if above is not None:
            labels = list(above.labels)
        super().__init__(path, labels if export is None else export.labels[1:])
        self._lead = 0 if export is None else 1  # the names of an export's lines, no values
        self._above = 0 if header else remarks
        self._named = self._width if above is None else above.named
        if self._above:
            self.warnings.append(f"left out above the numbers: {_rows(self._above)}")
        if above is not None:
            self._survey = dataclasses.replace(self._survey, header_lines=above.lines)
            if above.several:
                self.warnings.append(f"names were read from rows {above.before + 1} to {above.lines}")
            if not above.blank:
                self.warnings.append(f"left out above the names: {_rows(above.before)}")
            if above.has_units:
                self.warnings.append(f"units were read from row {above.before + 2}")
        self._announced = None
        if export is not None:
            before = self._survey.header_lines - 1
            self._survey = dataclasses.replace(self._survey, header_lines=before + export.lines)
            self._width, self._announced = len(export.labels), export.size
        self._end = self._survey.end
        self._rows: int | None = None
        self._stamped = self._of_stamps(head) if export is None else frozenset()
        self.labels = tuple(
            dataclasses.replace(label, unit=label.unit or "s") if k in self._stamped else label
            for k, label in enumerate(self.labels)
        )
        self._check_end()
        if self._survey.header_lines >= self._survey.lines and header:
            raise DataError(f"{path}: there is a header but no data row")

    def _unnamed(self, head: str, remarks: int, data: str) -> bool:
        """Whether a table of numbers follows upon remarks of which none names its columns."""
        try:
            cells = blanks.cells(data, self._separator)
            names = [blanks.cells(line, self._separator) for line in head.splitlines()[:remarks]]
        except csv.Error:
            return False
        numbers = len(cells) > 1 and all(_may_be_number(cell.strip()) for cell in cells)
        return numbers and all(len(row) != len(cells) for row in names)

    def _begins_with_data(self, head: str, cells: Sequence[str]) -> bool:
        """Whether the first row is one of numbers: in all cells, or wherever the row below has one, beside remarks."""
        first = [_is_number(cell, ".") or _is_number(cell, ",") for cell in map(str.strip, cells)]
        if all(first) or not any(first):
            return all(first)
        lines = [line for line in head.splitlines()[self._survey.header_lines :] if line.strip()]
        try:
            below = blanks.cells(next(iter(lines), ""), self._separator)
        except csv.Error:
            return False
        return [_is_number(cell, ".") or _is_number(cell, ",") for cell in map(str.strip, below)] == first

    def _of_stamps(self, head: str) -> frozenset[int]:
        """The columns whose first value is a time of day: they are read as seconds since then."""
        before = self._survey.header_lines if self._header else self._above
        lines = (line for line in head.splitlines()[before:] if line.strip() and not blanks.remark(line))
        try:
            row = blanks.cells(next(lines, ""), self._separator)
        except csv.Error:
            return frozenset()
        return frozenset(k for k, cell in enumerate(row[: self._width]) if dates.is_stamp(cell))

    def read(self, indices: Sequence[int]) -> list[Array]:
        """See `Source.read`."""
        indices = [k + self._lead for k in indices]
        try:
            columns = self._read_as(indices, self._decimal or ".")
        except _DecimalCommaError:
            columns = self._read_as(indices, ",")
            self.warnings.append("numbers were read with a decimal comma")
        if self._announced not in (None, self._rows):
            self.warnings.append(f"{self._rows} rows were read, the header announces {self._announced}")
        return columns

    def row(self, index: int) -> int:
        """See `Source.row`; blank lines are counted."""
        before = self._survey.header_lines if self._header else self._above
        if self._rows == self._survey.lines - before:
            return index + before + 1
        with self._window() as file:
            seen = -1
            for number, line in enumerate(_text(file), 1):
                seen += number > before and not (blanks.remark(line) if self._passed else not line.strip())
                if seen == index:
                    return number
        return index + before + 1

    def _read_as(self, indices: Sequence[int], decimal: str) -> list[Array]:
        try:
            return self._read_fast(indices, decimal)
        except (pa.ArrowException, UnicodeError, _RowsError):
            return self._read_carefully(indices, decimal)

    def _read_fast(self, indices: Sequence[int], decimal: str) -> list[Array]:
        names = [f"c{k}" for k in range(self._width)]
        wanted = [names[k] for k in dict.fromkeys(indices)]
        stamped = {names[k] for k in self._stamped}
        columns = {name: np.empty(self._survey.lines + 1) for name in wanted if name not in stamped}
        stamps: dict[str, list[str]] = {name: [] for name in wanted if name in stamped}
        filled = 0
        # arrow reads ahead in threads of its own that outlive the reader: a file of Python's would have them call Python
        # while it ends, which aborts the process
        with self._bytes() as file:
            reader = arrow_csv.open_csv(
                file,
                read_options=arrow_csv.ReadOptions(
                    column_names=names,
                    skip_rows=self._survey.header_lines if self._header else self._above,
                    block_size=_BLOCK,
                ),
                parse_options=arrow_csv.ParseOptions(delimiter=self._delimiter),
                convert_options=arrow_csv.ConvertOptions(
                    column_types={name: pa.string() if name in stamped else pa.float64() for name in wanted},
                    include_columns=wanted,
                    null_values=_MISSING,
                    decimal_point=decimal,
                    check_utf8=False,
                ),
            )
            for batch in reader:
                for name, values in zip(wanted, batch.columns, strict=True):
                    if name in stamped:
                        stamps[name] += ["" if text is None else text for text in values.to_pylist()]
                        continue
                    # by DLPack where nothing is missing: to_numpy imports pandas, a quarter of a short command's time
                    part = (
                        values.to_numpy(zero_copy_only=False) if values.null_count else np.from_dlpack(values)
                    )
                    columns[name][filled : filled + len(values)] = part
                filled += len(batch)
        self._rows = filled
        self._check_rows(filled)
        for name, texts in stamps.items():
            columns[name] = self._seconds(texts, names.index(name))
        # only pages that were written are in memory, so the unused end costs nothing
        return [columns[names[k]][:filled] for k in indices]

    def _check_rows(self, filled: int) -> None:
        """Holds the rows parsed against the lines counted: a stray quote makes one cell of many lines.

        Raises:
            _RowsError: they differ by more than blank lines.
        """
        before = self._survey.header_lines if self._header else self._above
        if filled == self._survey.lines - before:
            return
        with self._window() as file:
            lines = sum(
                1 for number, line in enumerate(_text(file), 1) if number > before and line.strip("\r\n")
            )
        if filled != lines:
            raise _RowsError

    def _check_span(self, line: int, end: int, cells: list[str]) -> None:
        """Refuses a row over several lines of which one looks like a row of its own.

        Args:
            line: number of its first line.
            end: number of its last.
            cells: of the row.
        """
        if end == line:
            return
        k, cell = next((k, cell) for k, cell in enumerate(cells) if _breaks(cell))
        inner = _BREAK.split(cell)[1:]
        if any(part.count(self._separator) >= self._width - 2 for part in inner):
            raise DataError(
                f"{self.path}: row {line}, column '{self._heading(min(k, self._width - 1))}': a quotation mark opens a"
                f" cell that ends in row {end} only and swallows the rows between: delete it, or close it"
            )

    def _read_carefully(self, indices: Sequence[int], decimal: str) -> list[Array]:
        """Cell by cell: either names the bad one, or reads what pyarrow is too strict for (``+1.5``)."""
        columns = {k: array("d") for k in indices if k not in self._stamped}
        stamps: dict[int, list[str]] = {k: [] for k in indices if k in self._stamped}
        self._rows = 0
        passed: list[int] = []
        beyond: list[int] = []
        with self._window() as file:
            reader = csv.reader(_text(file), delimiter=self._delimiter)
            begin = 1
            for line, cells in self._rows_of(reader):
                self._check_span(max(begin, line - sum(map(_breaks, cells))), line, cells)
                begin = line + 1
                if blanks.remark(cells[0]) and cells[0].strip():
                    passed.append(line)
                    continue
                surplus = [cell for cell in map(str.strip, cells[self._width :]) if cell]
                remarks = self._named > self._width and not any(map(_may_be_number, surplus))
                if len(cells) != self._width and not (remarks and len(cells) > self._width):
                    raise DataError(self._width_message(line, cells))
                if surplus:
                    beyond.append(line)
                for k, values in columns.items():
                    values.append(self._number(cells[k], decimal, line, k))
                for k, texts in stamps.items():
                    texts.append("" if cells[k].strip() in _MISSING else cells[k])
                self._rows += 1
        if passed and not self._passed:
            more = f"; in all {len(passed)}" if len(passed) > 1 else ""
            self.warnings.append(f"remarks among the numbers were left out (first: row {passed[0]}{more})")
        if beyond and not self._surplus:
            self.warnings.append(
                f"what stands beyond the last column of numbers was left out (first: row {beyond[0]})"
            )
        self._passed, self._surplus = bool(passed), bool(beyond)
        found = {k: self._seconds(texts, k) for k, texts in stamps.items()}
        found |= {k: np.frombuffer(v, dtype=float) if v else np.empty(0) for k, v in columns.items()}
        self._tell_digits(found)
        return [found[k] for k in indices]

    def _seconds(self, texts: list[str], k: int) -> Array:
        try:
            return dates.seconds(texts)
        except ValueError as error:
            row = int(error.args[0])
            raise DataError(
                f"{self.path}: {self.at(row)}, column '{self._heading(k)}': '{texts[row][:30]}' is not a date and time"
                " as those before it"
            ) from None

    def _rows_of(self, reader: Iterator[list[str]]) -> Iterator[tuple[int, list[str]]]:
        line = 0
        while True:
            try:
                cells = next(reader, None)
            except csv.Error as error:
                reason = f" cannot be read: {error}"
                if "field limit" in str(error):
                    reason = (
                        f": a quotation mark opens a cell that is longer than {csv.field_size_limit()} characters:"
                        " delete it, or close it"
                    )
                raise DataError(f"{self.path}: row {line + 1}{reason}") from None
            line = reader.line_num  # type: ignore[attr-defined]
            if cells is None:
                return
            if cells and line > (self._survey.header_lines if self._header else self._above):
                yield line, cells

    def _tell_twice(self, text: str, prefix: str, k: int) -> None:
        """Warns where a column's unit has the prefix as well: ``5m`` under ``(mA)``, unless the user has said the unit."""
        if k - self._lead in self.settled:
            return
        found = _IN_BRACKETS.search(self._heading(k))
        if found is None or not found[1].startswith(prefix):
            return
        unit, plain = found[1], found[1][len(prefix) :]
        try:
            twice = math.isclose(factor(unit, plain), _PREFIXES[prefix])
        except UsageError:
            return
        if twice:
            value = float(text[:-1].replace(",", ".")) * _PREFIXES[prefix]
            self.warnings.append(
                f"'{self._heading(k)}': '{text}' was read as {value:g} {unit}; if it means"
                f' {text[:-1]} {unit}, write unit = "{plain}" in a mapping'
            )

    def _count_digits(self, k: int, text: str, decimal: str, prefix: float) -> None:
        own = self._digits.setdefault(k, {})
        own[prefix] = max(own.get(prefix, 0), len(text.partition(decimal)[2]))

    def _tell_digits(self, columns: Mapping[int, Array]) -> None:
        """Warns where the digits that a column was exported with change with the prefix, and are few beside its range."""
        for k, digits in self._digits.items():
            steps = sorted(prefix * 10.0**-count for prefix, count in digits.items())
            values = columns[k][np.isfinite(columns[k])]
            if k not in self._coarse and len(steps) > 1 and steps[-1] > COARSE * np.ptp(values):
                self._coarse.add(k)
                self.warnings.append(
                    f"'{self._heading(k)}' was exported with few digits, rounded to {steps[0]:.6g} where it is small and to"
                    f" {steps[-1]:.6g} where it is large: these steps are the file's and not the machine's"
                )
        self._digits = {}

    def _number(self, cell: str, decimal: str, line: int, k: int) -> float:
        text = cell.strip()
        if text in _MISSING:
            return float("nan")
        if _is_number(text, decimal):
            if self._prefixed:
                self._count_digits(k, text, decimal, 1.0)
            return float(text.replace(",", "."))
        if self._decimal is None and decimal == "." and _is_number(text, ","):
            raise _DecimalCommaError
        if (prefixed := _PREFIXED.fullmatch(text)) and _is_number(prefixed[1], decimal):
            if not self._prefixed:
                self.warnings.append(f"numbers with a prefix were read as such: '{text}', m is a thousandth")
            if k not in self._told:
                self._told.add(k)
                self._tell_twice(text, prefixed[2], k)
            self._prefixed = True
            self._count_digits(k, prefixed[1], decimal, _PREFIXES[prefixed[2]])
            return float(prefixed[1].replace(",", ".")) * _PREFIXES[prefixed[2]]
        if (truth := _TRUTH.get(text.lower())) is not None:
            return truth
        shown = text if len(text) <= 30 else text[:30] + "..."
        raise DataError(
            f"{self.path}: row {line}, column '{self._heading(k)}': '{shown}' is not a number"
            " (a missing value is an empty cell or NaN)"
        )

    def _heading(self, k: int) -> str:
        """Of the `k`-th column of the table."""
        return self.labels[k - self._lead].text if k >= self._lead else controldesk.FIRST

    def _width_message(self, line: int, cells: list[str]) -> str:
        text = f"{self.path}: row {line} has {len(cells)} cells where the header has {self._width}"
        if self._separator == "," and len(cells) > self._width:
            text += "; with a decimal comma the columns need another separator: save with ';'"
        return text + "; mend or delete the row"

    def _check_end(self) -> None:
        """Leaves out a last line that was cut short while being written."""
        last = self._survey.last_line
        if self._survey.ends_cleanly or self._survey.lines <= self._survey.header_lines:
            return
        try:
            cells = blanks.cells(last, self._separator)
        except csv.Error:
            cells = []
        texts = [cell.strip() for cell in cells]
        whole = len(texts) == self._width and texts[-1] != ""
        plain = all(cell in _MISSING or _is_number(cell, ".") or _is_number(cell, ",") for cell in texts[-1:])
        if whole and plain:
            self.warnings.append("the file does not end with a line end: the last number may be cut short")
            return
        self._end = self._survey.last_start
        number = self._survey.lines
        self._survey = self._survey.without_last()
        self.warnings.append(
            f"the last line (row {number}) was cut short ({len(cells)} of {self._width} cells) and left out"
        )

    @property
    def _delimiter(self) -> str:
        """Between the cells of what `_window` and `_bytes` give."""
        return "\t" if self._separator == blanks.BLANK else self._separator

    def _whole(self) -> bytes:
        """The table with one tab for each run of blanks."""
        if self._squeezed is None:
            self._squeezed = blanks.squeezed(self._text, self._survey.start, self._end)
        return self._squeezed

    @contextlib.contextmanager
    def _bytes(self) -> Iterator[Any]:
        """The table, to read by arrow."""
        if self._separator == blanks.BLANK:
            yield pa.BufferReader(self._whole())
            return
        with pa.OSFile(str(self._text)) as file:
            yield file.get_stream(self._survey.start, self._end - self._survey.start)

    def _window(self) -> io.BytesIO | io.BufferedReader:
        if self._separator == blanks.BLANK:
            return io.BytesIO(self._whole())
        return io.BufferedReader(Window(self._text, self._survey.start, self._end), _BLOCK)


def _remarks(head: str) -> tuple[int, str]:
    """How many lines at the top of a file are remarks, and the line below them; none where the whole head is."""
    lines = head.splitlines()
    count = next((k for k, line in enumerate(lines) if not blanks.remark(line)), 0)
    return (count, lines[count]) if any(line.strip() for line in lines[:count]) else (0, "")


def _rows(count: int) -> str:
    return "row 1" if count == 1 else f"rows 1 to {count}"


def _text(file: io.BytesIO | io.BufferedReader) -> io.TextIOWrapper:
    return io.TextIOWrapper(file, encoding="utf-8", errors="replace", newline="")


def _breaks(cell: str) -> int:
    """Line breaks in a cell, as the reader of rows counts them."""
    return len(_BREAK.findall(cell))


def _may_be_number(text: str) -> bool:
    """Whether a cell holds a number with either decimal sign, or says that one is missing."""
    return text in _MISSING or _is_number(text, ".") or _is_number(text, ",")


def _may_be_value(text: str) -> bool:
    """As `_may_be_number`, or a time of day."""
    return _may_be_number(text) or dates.is_stamp(text)


def _is_number(text: str, decimal: str) -> bool:
    """Whether the text is a plain number with this decimal sign; Python's float alone takes 1_000 and Arabic digits."""
    if not text.isascii() or "_" in text or (decimal == "," and "." in text):
        return False
    try:
        float(text.replace(",", ".") if decimal == "," else text)
    except ValueError:
        return False
    return True
