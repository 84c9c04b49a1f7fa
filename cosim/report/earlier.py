"""Results of an earlier run in the folder of a new one: said, and never left among the new ones."""

import os
from collections.abc import Sequence
from pathlib import Path

from cosim.console import warn
from cosim.files import keep_inputs

FILES = (
    "diagnosis.json",
    "report.html",
    "comparison.parquet",
    "held_out.parquet",
    "next_experiment.csv",
    "next_experiment.parquet",
    "extended.ssp",
    "extended_open.ssp",
    "extended_native.ssp",
    "extended.ssv",
)
"""Every file that a diagnosis writes."""
COMPARED = (
    "signals.png",
    "blocks.png",
    "series.parquet",
    "series.csv",
    "observer.png",
    "tracker.png",
    "calibrated.ssv",
    "calibration.json",
    "calibration.png",
)
"""Every file that a comparison writes, with calibration, observer and tracker."""


SET = ".ssv"


def keep_logs(folder: Path, files: Sequence[str], inputs: Sequence[Path]) -> None:
    """Refuse to write over a log: what a run reads but parameter sets, which may be written over.

    Raises:
        UsageError: a log lies there under the name of a result.
    """
    keep_inputs((folder / name for name in files), (path for path in inputs if path.suffix != SET))


class Earlier:
    """What of an earlier run lies in a folder; says so on stderr when made.

    Args:
        folder: of the results.
        files: what such a run writes.
        what: such a run, in a word.
        inputs: what this run reads. Logs are never written over; a parameter set may be, and is not deleted.

    Raises:
        UsageError: a log lies there under the name of a result.
    """

    def __init__(
        self,
        folder: Path,
        files: Sequence[str] = FILES,
        what: str = "diagnosis",
        inputs: Sequence[Path] = (),
    ) -> None:
        keep_logs(folder, files, inputs)
        sets = {os.path.realpath(path) for path in inputs if path.suffix == SET}
        self._stamps = {
            path: path.stat().st_mtime_ns
            for path in (folder / name for name in files)
            if path.is_file() and os.path.realpath(path) not in sets
        }
        if self._stamps:
            warn(f"{folder} holds an earlier {what} ({len(self._stamps)} files): its files are replaced")
        elif files is FILES and (beside := _before_this_process(folder)):
            warn(
                f"{folder} holds a comparison ({beside} files): those of the same name are replaced, the others stay; "
                "another --out keeps the two apart"
            )

    def clear(self) -> None:
        """Delete those that the new run has not written again: a package or a proposal that it does not have."""
        for path, stamp in self._stamps.items():
            if path.is_file() and path.stat().st_mtime_ns == stamp:
                path.unlink()


def _before_this_process(folder: Path) -> int:
    """How many files of a comparison lie in a folder that this process did not write: the demo compares and diagnoses."""
    import psutil

    begun = psutil.Process().create_time()
    found = [path.stat().st_mtime for path in (folder / name for name in COMPARED) if path.is_file()]
    return sum(written < begun for written in found)
