"""The log of a live run, written while it runs: whole lines, on the disk at least once a second.

The loop formats rows and hands them over a quarter of a second at a time; a thread writes, since a disk may take its time.
Where the disk is full the file ends with its last whole line; what comes is kept, up to `KEPT` bytes, and written when
there is room again. A kill leaves what was written by then.
"""

import os
import queue
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from cosim.errors import DataError, UsageError
from cosim.live.link import STALE

CHUNK = 250  # rows handed over at a time
KEPT = 16 << 20  # bytes kept while the disk takes none: about three minutes
SYNC = 0.5  # s between requests to put it on the disk
SUFFIXES = (".csv", ".parquet")
Row = list[float | None]


def check_suffix(path: Path) -> None:
    """Refuse a file type that is not written.

    Raises:
        UsageError: it is none of `SUFFIXES`.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: a live log is written as {' or '.join(SUFFIXES)}, not '{path.suffix}'")


class Recorder:
    """Writes one row a slot: ``time [s]`` and the columns.

    A Parquet file cannot be read before its end is written: until then the rows stand in ``NAME.live.csv`` beside it.

    Attributes:
        path: the log.
        journal: the file that is written while the loop runs.
        rows: rows handed over.
        rows_lost: rows that never reached the disk.
        error: what the system said when it last refused to write, or "".
    """

    def __init__(self, path: Path, columns: Sequence[str], period: float) -> None:
        """Open the file and write its header.

        Raises:
            UsageError: the file type is not written.
            DataError: the file cannot be made.
        """
        check_suffix(path)
        self.path, self._period = path, period
        self.journal = path if path.suffix.lower() == ".csv" else path.with_name(f"{path.stem}.live.csv")
        self.rows = self.rows_lost = 0
        self.error = ""
        self._open_rows: deque[tuple[int, Row]] = deque()
        self._text: list[str] = []
        self._kept: deque[tuple[int, bytes]] = deque()
        self._queue: queue.SimpleQueue[tuple[int, bytes] | None] = queue.SimpleQueue()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0)
            self._file = os.open(self.journal, flags, 0o666)
            header = (",".join(["time [s]", *columns]) + "\n").encode()
            self._written = os.write(self._file, header)
            os.fsync(self._file)
        except OSError as error:
            raise DataError(f"{self.journal}: cannot be written: {error.strerror or error}") from None
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def add(self, slot: int, row: Row) -> None:
        """Takes the row of a slot; it can be changed for `STALE` slots more, since a late datagram belongs into it."""
        self._open_rows.append((slot, row))
        if len(self._open_rows) > STALE:
            self._format(*self._open_rows.popleft())

    def row(self, slot: int) -> Row | None:
        """The row of a slot that can still be changed."""
        if not self._open_rows:
            return None
        place = slot - self._open_rows[0][0]
        if 0 <= place < len(self._open_rows) and self._open_rows[place][0] == slot:
            return self._open_rows[place][1]
        return None

    def close(self) -> None:
        """Writes everything, puts it on the disk, and makes the Parquet file where one is wanted.

        Raises:
            DataError: the Parquet file cannot be written; the message names the journal, which has all rows.
        """
        while self._open_rows:
            self._format(*self._open_rows.popleft())
        self._hand_over()
        self._queue.put(None)
        self._thread.join()
        self.rows_lost += sum(number for number, _ in self._kept)
        os.close(self._file)
        if self.journal != self.path and self.rows > self.rows_lost:
            self._convert()

    def _format(self, slot: int, row: Row) -> None:
        cells = ["" if value is None else f"{value:.9g}" for value in row]
        self._text.append(f"{slot * self._period:.6f},{','.join(cells)}\n")
        if len(self._text) >= CHUNK:
            self._hand_over()

    def _hand_over(self) -> None:
        if self._text:
            self.rows += len(self._text)
            self._queue.put((len(self._text), "".join(self._text).encode()))
            self._text = []

    # The thread

    def _work(self) -> None:
        synced, size = time.monotonic(), 0
        while (item := self._queue.get()) is not None:
            self._kept.append(item)
            size += len(item[1])
            size -= self._write()
            while size > KEPT and self._kept:
                number, text = self._kept.popleft()
                self.rows_lost += number
                size -= len(text)
            if time.monotonic() - synced >= SYNC:
                self._sync()
                synced = time.monotonic()
        self._write()
        self._sync()

    def _write(self) -> int:
        """Writes what is kept, as whole lines; returns the number of bytes that went."""
        gone = 0
        while self._kept:
            number, text = self._kept[0]
            try:
                done = os.write(self._file, text)
            except OSError as error:
                self.error = error.strerror or str(error)
                return gone
            whole = text.rfind(b"\n", 0, done) + 1
            if done < len(text):  # the disk is full: what is read back ends with a whole line
                os.ftruncate(self._file, self._written + whole)
                os.lseek(self._file, self._written + whole, os.SEEK_SET)
            self._written += whole
            gone += whole
            if done < len(text):
                self._kept[0] = (number - text.count(b"\n", 0, whole), text[whole:])
                self.error = "it took a part only; the disk is probably full"
                return gone
            self._kept.popleft()
        return gone

    def _sync(self) -> None:
        try:
            os.fsync(self._file)
        except OSError as error:
            self.error = error.strerror or str(error)

    def _convert(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq
        from pyarrow import csv

        from cosim.files import whole
        from cosim.logs import checksums

        try:
            table = csv.read_csv(self.journal)
            columns = [column.cast(pa.float64()) for column in table.columns]
            table = checksums.added(pa.table(columns, names=table.column_names))
            with whole(self.path) as part:
                pq.write_table(table, part, write_page_checksum=True)
            self.journal.unlink()
        except (OSError, pa.ArrowException) as error:
            raise DataError(
                f"{self.path}: cannot be written: {error}; all rows are in {self.journal}"
            ) from None
