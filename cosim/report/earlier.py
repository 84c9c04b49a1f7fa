"""Results of an earlier run in the folder of a new one: said, and never left among the new ones."""

from pathlib import Path

from cosim.console import warn

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


class Earlier:
    """What of an earlier diagnosis lies in a folder; says so on stderr when made.

    Args:
        folder: it exists.
    """

    def __init__(self, folder: Path) -> None:
        self._stamps = {
            path: path.stat().st_mtime_ns for path in (folder / name for name in FILES) if path.is_file()
        }
        if self._stamps:
            warn(f"{folder} holds an earlier diagnosis ({len(self._stamps)} files): its files are replaced")

    def clear(self) -> None:
        """Delete those that the new run has not written again: a package or a proposal that it does not have."""
        for path, stamp in self._stamps.items():
            if path.is_file() and path.stat().st_mtime_ns == stamp:
                path.unlink()
