"""The folder of a batch, written so that a batch killed at any moment can go on where it stopped.

batch.json      what was asked for, and the digest by which a resumed batch knows that it is the same
journal.jsonl   one line a finished run, appended once its signals are on disk
signals.zarr    signals, run x time, for xarray; NaN where a run has not finished or failed
runs.parquet    one row a run, written at the end
summary.png     the picture
.cosim-batch.lock  of the process that writes here

A line of the journal comes after its signals have been synced, and holds their checksum.
"""

import contextlib
import errno
import json
import os
import shutil
import time as clock
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import zarr
from numpy.typing import NDArray

from cosim.batch.coordinates import Coordinates
from cosim.batch.job import Outcome, Signal
from cosim.batch.lasting import LastingStore
from cosim.console import to_jsonable
from cosim.errors import DataError, UsageError
from cosim.files import HeldError, held, is_left_over, whole, write_bytes, write_text
from cosim.interrupts import POSTPONING, uninterrupted

POSTPONING.add(str(Path(zarr.__file__).parent / "_").removesuffix("_"))
Array = NDArray[np.float64]

INTERVAL = 1.0  # s of finished work that a kill may cost at most, besides the runs in hand
STALE = 1.0  # s after which nobody writes a file of the cube any more
HELD_BACK = 64 * 2**20  # bytes of signals held in memory at most
CHUNK = (64, 1024)  # runs and points of time in one file of the cube
FILES = {
    "plan": "batch.json",
    "journal": "journal.jsonl",
    "signals": "signals.zarr",
    "runs": "runs.parquet",
    "picture": "summary.png",
}
# of a line of the journal, whatever its version
ROW = {"run", "status", "reason", "seconds", "worker", "scores", "notes"}
LOCK = ".cosim-batch.lock"


class Store:
    """The folder of one batch.

    Attributes:
        folder: where it is.
        rows: what is known of each finished run, by number.
        spoilt: how many finished runs were found without their signals, and are not among the rows.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: dict[int, dict[str, Any]] = {}
        self.spoilt = 0
        self._cube = LastingStore(self.path("signals"))
        self._waiting: list[Outcome] = []
        self._bytes = 0
        self._flushed = clock.monotonic()
        self._arrays: dict[str, Any] = {}

    def path(self, what: str) -> Path:
        """A file of the folder, by its key in FILES."""
        return self.folder / FILES[what]

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """No other process writes into the folder within the block.

        Raises:
            UsageError: one does, or it cannot be written.
        """
        with contextlib.ExitStack() as stack:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                stack.enter_context(held(self.folder / LOCK))
            except HeldError as error:
                raise UsageError(
                    f"another batch writes into '{self.folder}' ({error}): wait for it, or name another folder with --out"
                ) from None
            except OSError as error:
                raise self._unwritten(error) from None
            yield

    def _unwritten(self, error: OSError) -> UsageError:
        return UsageError(
            f"cannot write into '{self.folder}' ({error.strerror or error}); name another folder with --out"
        )

    # Beginning, or going on

    def begin(self, about: Mapping[str, Any], coordinates: Coordinates, fresh: bool) -> int:
        """Make the folder, or take up the batch that lies in it.

        Args:
            about: what goes into batch.json; its ``identity`` says whether it is the same batch.
            coordinates: of the runs.
            fresh: throw away what lies there.

        Returns:
            How many runs are done already.

        Raises:
            UsageError: another batch lies there, or something that is no batch, or it cannot be written.
            DataError: what lies there is damaged.
        """
        try:
            known = self.path("plan").is_file()
            if known and not fresh:
                self._take_up(about, coordinates)
                return len(self.rows)
            if known:
                self._clear()
            elif self.folder.is_dir() and not self._abandoned():
                raise UsageError(
                    f"'{self.folder}' is not empty and holds no batch: name another folder with --out"
                )
            else:
                self._clear()
            self.folder.mkdir(parents=True, exist_ok=True)
            coordinates.write(self._cube)
            self._cube.last()
            # last: from here on there is a batch to take up
            write_text(self.path("plan"), json.dumps(to_jsonable(about), indent=2, ensure_ascii=False))
        except OSError as error:
            raise self._unwritten(error) from None
        return 0

    def _abandoned(self) -> bool:
        """Whether the folder holds nothing but what a batch leaves that was killed before it had begun."""
        ours = (FILES["signals"], LOCK)
        return all(item.name in ours or is_left_over(item) for item in self.folder.iterdir())

    def _clear(self) -> None:
        # the plan before the cube: what is left of a clearing that was killed is a batch, or `_abandoned`
        for what in sorted(FILES, key=("runs", "picture", "journal", "plan", "signals").index):
            path = self.path(what)
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def _take_up(self, about: Mapping[str, Any], coordinates: Coordinates) -> None:
        try:
            known = json.loads(self.path("plan").read_text(encoding="utf-8"))["identity"]
        except (ValueError, KeyError, TypeError):
            raise DataError(f"{self.path('plan')} is damaged: begin anew with --fresh") from None
        if known != about["identity"]:
            raise UsageError(
                f"'{self.folder}' holds another batch (other parameters, models, logs or versions of them): name another "
                "folder with --out, or throw it away with --fresh"
            )
        for left in self.path("signals").rglob("*.partial"):  # beside which zarr was killed
            with contextlib.suppress(FileNotFoundError):
                if clock.time() - left.stat().st_mtime > STALE:
                    left.unlink()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of a signal's place that was begun, which is made again
                lost = coordinates.lost(self._group())
                list(self._group().arrays())
        except (OSError, ValueError, KeyError, TypeError, RuntimeError) as error:  # also of a codec
            raise DataError(f"{self.path('signals')} is damaged ({error}): begin anew with --fresh") from None
        if lost is not None:
            raise DataError(f"{self.path('signals')} is damaged ({lost}): begin anew with --fresh")
        journal = self.path("journal")
        if not journal.is_file():
            return
        text = journal.read_bytes()
        complete = text[: text.rfind(b"\n") + 1]  # a line that a kill cut short is not done
        for number, line in enumerate(complete.splitlines(), 1):
            try:
                row = json.loads(line)
                if not row.keys() >= ROW:
                    raise KeyError
                self.rows[int(row["run"])] = row
            except (ValueError, KeyError, TypeError, AttributeError):
                raise DataError(f"{journal}, line {number} is damaged: begin anew with --fresh") from None
        if len(complete) < len(text):
            write_bytes(journal, complete)
        self._hold_against_the_cube()

    def _hold_against_the_cube(self) -> None:
        """Take runs for not done whose signals are not those that were written: a disk has lost them."""
        group = self._group()
        arrays = [(name, array) for name, array in group.arrays() if array.ndim == 2]
        for first in range(0, group["run"].shape[0], CHUNK[0]):
            rows = range(first, min(first + CHUNK[0], group["run"].shape[0]))
            known = [number for number in rows if "checksum" in self.rows.get(number, {})]
            sums = dict.fromkeys(known, 0)
            for name, array in arrays if known else []:
                values = self._chunk_row(name, array, rows)
                for number in known:
                    sums[number] += checksum(name, values[number - first])
            for number in known:
                if sums[number] != self.rows[number]["checksum"]:
                    del self.rows[number]
                    self.spoilt += 1

    def _chunk_row(self, name: str, array: Any, rows: range) -> Array:
        """A signal in the runs of one row of files; of files that cannot be read nothing, and they are taken away."""
        try:
            return np.asarray(array[rows.start : rows.stop])
        except (OSError, ValueError, RuntimeError):
            for file in (self.path("signals") / name).glob(f"{rows.start // CHUNK[0]}.*"):
                file.unlink(missing_ok=True)
            return np.full((len(rows), array.shape[1]), np.nan)

    def forget_failed(self) -> int:
        """Take failed runs for not done; returns how many."""
        failed = [number for number, row in self.rows.items() if row["status"] == "failed"]
        for number in failed:
            del self.rows[number]
        return len(failed)

    # While it runs

    def add(self, outcomes: Iterable[Outcome]) -> None:
        """Take in finished runs; they are on disk after `flush`, which is called now and then."""
        for outcome in outcomes:
            self._waiting.append(outcome)
            self._bytes += sum(signal.values.nbytes for signal in outcome.signals.values())
        if self._bytes > HELD_BACK:
            self.flush()

    def tick(self) -> None:
        """Flush if it is time."""
        if clock.monotonic() - self._flushed >= INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Write what waits: signals first, since a line of the journal says that they are there."""
        if self._waiting:
            self._write_signals(self._waiting)
            self._cube.last()
            lines = []
            for outcome in self._waiting:
                row = {
                    "run": outcome.number,
                    "status": outcome.status,
                    "reason": outcome.reason,
                    "seconds": outcome.seconds,
                    "worker": outcome.worker,
                    "resident": outcome.resident,
                    "scores": outcome.scores,
                    "notes": outcome.notes,
                    "checksum": sum(checksum(name, s.values) for name, s in outcome.signals.items()),
                }
                lines.append(json.dumps(to_jsonable(row), ensure_ascii=False) + "\n")
                self.rows[outcome.number] = json.loads(lines[-1])
            with uninterrupted():  # the flush that follows a signal would write the lines again
                self._append("".join(lines).encode())
                self._waiting = []
        self._waiting, self._bytes, self._flushed = [], 0, clock.monotonic()

    def _append(self, lines: bytes) -> None:
        """Lines of the journal, all of them or none: half a line would spoil the next one."""
        with self.path("journal").open("ab", buffering=0) as stream:
            before = stream.tell()
            try:
                if stream.write(lines) != len(lines):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path("journal")))
                os.fsync(stream.fileno())
            except OSError:
                stream.truncate(before)
                raise

    def _write_signals(self, outcomes: Sequence[Outcome]) -> None:
        """One write a signal and length: runs that lie in one chunk cost one file."""
        groups: dict[tuple[str, int], list[tuple[int, Signal]]] = {}
        for outcome in outcomes:
            for name, signal in outcome.signals.items():
                groups.setdefault((name, signal.values.size), []).append((outcome.number, signal))
        for (name, size), found in groups.items():
            array = self._array(name, found[0][1], size)
            order = sorted(found, key=lambda item: item[0])
            rows = np.array([number for number, _ in order])
            array.oindex[rows, slice(0, size)] = np.stack([signal.values for _, signal in order])

    def _array(self, name: str, signal: Signal, size: int) -> Any:
        if name not in self._arrays:
            group = self._group()
            unit, factor, offset = signal.display
            shown = {"display_unit": unit, "display_factor": factor, "display_offset": offset}
            told = {"_ARRAY_DIMENSIONS": ["run", "time"], "units": signal.unit, **shown}
            # a batch may have been killed between any two of these writes
            if name not in (listed := group.attrs.get("signals", [])):
                group.attrs["signals"] = [*listed, name]  # in the order of the chain
            if name in group:
                array = group[name]
            else:
                array = group.create_array(
                    name,
                    shape=(group["run"].shape[0], size),
                    chunks=CHUNK,
                    dtype="float64",
                    fill_value=np.nan,
                    attributes=told,
                )
            if dict(array.attrs) != told:
                array.attrs.update(told)
            self._arrays[name] = array
        array = self._arrays[name]
        if array.shape[1] < size:
            array.resize((array.shape[0], size))
        return array

    def _group(self) -> Any:
        # the gathered metadata lag behind until the end
        return zarr.open_group(self._cube, mode="r+", zarr_format=2, use_consolidated=False)

    # At the end

    def finish(self, columns: Mapping[str, Sequence[object]]) -> pd.DataFrame:
        """Write runs.parquet and complete the cube.

        Args:
            columns: what is known of every run beforehand, by heading; ``run`` among them.

        Returns:
            The table: those columns, status, reason, seconds, worker, then the scores.
        """
        import pyarrow as pa
        import pyarrow.parquet

        frame = pd.DataFrame(columns)
        known = [self.rows.get(int(number)) for number in frame["run"]]
        blank: dict[str, Any] = {"status": "not done", "reason": "", "seconds": None, "worker": ""}
        for key, value in blank.items():
            frame[key] = [row[key] if row else value for row in known]
        scores = pd.DataFrame([row["scores"] if row else {} for row in known], index=frame.index)
        frame = pd.concat([frame, scores], axis=1)
        table = pa.Table.from_pandas(frame, preserve_index=False)
        with whole(self.path("runs")) as part:
            pyarrow.parquet.write_table(table, part, write_page_checksum=True)
        self._complete_cube()
        return frame

    def _complete_cube(self) -> None:
        """Bring all signals to one length, write the axis of time, and gather the metadata for quick opening."""
        group = self._group()
        signals = [array for _, array in group.arrays() if array.ndim == 2]
        size = max((array.shape[1] for array in signals), default=0)
        for array in signals:
            if array.shape[1] < size:
                array.resize((array.shape[0], size))
        first, step = float(group.attrs["first_time"]), float(group.attrs["output_step"])
        attributes = {"_ARRAY_DIMENSIONS": ["time"], "units": "s", "long_name": group.attrs["time_is"]}
        times = first + np.arange(size) * step
        if not _holds(group, "time", times, attributes):  # a disk may be full between taking away and writing
            time = group.create_array(
                "time", shape=(size,), dtype="float64", fill_value=None, attributes=attributes, overwrite=True
            )
            time[:] = times
        zarr.consolidate_metadata(self._cube, zarr_format=2)
        self._cube.last()


def _holds(group: Any, name: str, values: Array, attributes: Mapping[str, Any]) -> bool:
    """Whether a cube has an array with these values and attributes."""
    try:
        array = group[name]
        return bool(np.array_equal(array[:], values)) and dict(array.attrs) == attributes
    except (OSError, ValueError, KeyError, TypeError, RuntimeError):
        return False


def checksum(name: str, values: Array) -> int:
    """Of one signal of a run, without the NaN with which the cube fills it up; 0 of none."""
    given = np.asarray(values, dtype=np.float64)[~np.isnan(values)]
    return zlib.crc32(given.tobytes(), zlib.crc32(name.encode())) if given.size else 0
