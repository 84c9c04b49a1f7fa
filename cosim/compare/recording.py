"""Simulated signals of one run: in memory or, where there are hours of them, in a temporary file."""

import tempfile
import weakref
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError

Array = NDArray[np.float64]
WHOLE = slice(None)
MOST_KEPT = 2_000_000  # samples of a signal up to which memory is no question: 16 MB
SIZE = np.dtype(np.float64).itemsize


class Recording:
    """Signals (n,) that are written piece by piece (`put` is a sink of `cosim.master.Runner.run`) and read by name.

    The file lies where Python's tempfile puts it (TMPDIR), has no name where the system allows, and goes with the object.
    """

    def __init__(self, names: Iterable[str], count: int, most_kept: int | None = None) -> None:
        """Make room.

        Args:
            names: of the signals.
            count: samples of each.
            most_kept: samples up to which they stay in memory [default: MOST_KEPT].
        """
        self._count = count
        self._place = {name: k for k, name in enumerate(names)}
        on_disk = count > (MOST_KEPT if most_kept is None else most_kept)
        # closed with the object
        self._file = tempfile.TemporaryFile(prefix="cosim_") if on_disk else None  # noqa: SIM115
        if self._file is not None:
            weakref.finalize(self, self._file.close)
        self._kept = {} if on_disk else {name: np.empty(count) for name in self._place}

    def put(self, first: int, piece: Mapping[str, Array]) -> None:
        """Take values (m,) of every signal, the first of them at index `first`.

        Raises:
            SimulationError: the disk is full.
        """
        if self._file is None:
            for name, values in piece.items():
                self._kept[name][first : first + len(values)] = values
            return
        try:
            for name, values in piece.items():
                self._file.seek(SIZE * (self._place[name] * self._count + first))
                self._file.write(np.ascontiguousarray(values).data)
            self._file.flush()
        except OSError as error:
            raise SimulationError(
                f"the simulated signals of this log need {SIZE * self._count * len(self._place) / 1e9:.2g} GB in "
                f"{tempfile.gettempdir()} ({error.strerror}): name a larger disk in TMPDIR"
            ) from None

    def read(self, name: str, part: slice = WHOLE) -> Array:
        """A signal's values in `part` (a slice without step), from the file or as a view."""
        if self._file is None:
            return self._kept[name][part]
        first, last, _ = part.indices(self._count)
        self._file.seek(SIZE * (self._place[name] * self._count + first))
        return np.fromfile(self._file, count=last - first)
