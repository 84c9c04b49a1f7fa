"""What `cosim compare --calibrate` asks for, in texts, and what it leaves behind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim import console
from cosim.calibrate.free import read_free
from cosim.calibrate.outcome import Calibration
from cosim.calibrate.picture import write_picture
from cosim.calibrate.pipeline import HELD_OUT, STARTS, Options, calibrate
from cosim.calibrate.present import as_data, write_ssv
from cosim.compare import Comparator, CompareTable
from cosim.compare.outcome import Comparison
from cosim.errors import UsageError
from cosim.files import write_text
from cosim.logs import Mapping as LogMapping
from cosim.logs import load_log
from cosim.ssp.system import Value


@dataclass(frozen=True)
class Request:
    """The options of the command line, as given.

    Attributes:
        free, prior, fit_to: texts; what is empty comes from the mapping's table.
        held_out: a part of the log such as 0.3, or another log; None for the default.
        starts: of the search; None for the default.
    """

    free: Sequence[str] = ()
    prior: Sequence[str] = ()
    fit_to: Sequence[str] = ()
    held_out: str | None = None
    starts: int | None = None

    @property
    def empty(self) -> bool:
        """Nothing was asked for."""
        return not (self.free or self.prior or self.fit_to) and self.held_out is None and self.starts is None


def calibrated(
    comparator: Comparator,
    request: Request,
    given: Mapping[str, Value],
    table: CompareTable,
    names: LogMapping | None,
) -> Calibration:
    """Calibrate as a request says.

    Args:
        comparator: log and model.
        request: what was asked for.
        given: start values that differ from the model's own, by name.
        table: of the mapping file.
        names: the mapping by which a second log is read.

    Raises:
        UsageError, DataError, SimulationError: as `calibrate` and `read_free`.
    """
    own = table.calibrate
    free = read_free(comparator.system, request.free or own.free, request.prior or own.prior, given)
    starts = STARTS if request.starts is None else request.starts
    if starts < 1:
        raise UsageError(f"--starts {starts}: give at least 1")
    part, other = _held_out(request.held_out)
    chosen = {f.name for f in free}
    options = Options(
        signals=request.fit_to or own.fit_to,
        held_out=part,
        starts=starts,
        given={n: v for n, v in given.items() if n not in chosen},
    )
    with console.progress("calibrating", 1.0) as advance:

        def report(count: int) -> None:
            advance(1.0 - 100.0 / (100.0 + count))  # nobody knows how many there will be

        if other is None:
            return calibrate(comparator, free, options, progress=report)
        log = load_log(other, names)
        with Comparator(log, comparator.system, table=table, step=comparator.step) as second:
            return calibrate(comparator, free, options, second=second, progress=report)


def _held_out(text: str | None) -> tuple[float, Path | None]:
    if text is None:
        return HELD_OUT, None
    try:
        part = float(text.removesuffix("%")) * (0.01 if text.endswith("%") else 1.0)
    except ValueError:
        return 0.0, Path(text)
    return part, None


def write_files(
    found: Calibration,
    comparator: Comparator,
    comparison: Comparison,
    given: Mapping[str, Value],
    folder: Path,
) -> dict[str, Path]:
    """Write ``calibrated.ssv``, ``calibration.json`` and ``calibration.png``; returns name -> file.

    Raises:
        UsageError: the folder cannot be written to.
    """
    import json

    try:
        folder.mkdir(parents=True, exist_ok=True)
        values = {**given, **found.values}
        remarks = {p.name: p.remark for p in found.parameters}
        written = {"calibrated": write_ssv(comparator.system, values, folder / "calibrated.ssv", remarks)}
        data = console.to_jsonable(as_data(found, comparison))
        written["calibration"] = folder / "calibration.json"
        write_text(written["calibration"], json.dumps(data, indent=2) + "\n")
        written["calibration_picture"] = write_picture(found, comparison, folder / "calibration.png")
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return written
