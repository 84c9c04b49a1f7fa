"""A model beside a log, with calibration, observer and tracker where they are asked for: one call for command and Python."""

from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Named
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cosim import console
from cosim.anysystem.read import named_columns
from cosim.beside.extras import Extras
from cosim.compare import Comparator, CompareTable, Comparison, load_mapping, open_model
from cosim.compare.limits import check_limits, read_limits
from cosim.compare.model import build_wiring
from cosim.compare.picture import write_pictures
from cosim.compare.present import answer, as_data, write_series
from cosim.errors import DataError, ModelError, UsageError
from cosim.logs import Log, load_log
from cosim.logs.mapping import Mapping
from cosim.report.earlier import COMPARED, Earlier, keep_logs
from cosim.request import parameters
from cosim.ssp.archive import scratch_folder
from cosim.ssp.read import read_system
from cosim.units import parse_quantity

DEFAULT_MODEL = "full_order"
LONG = 500_000  # samples: Python FMUs take some 20 s for them, to compile native ones takes five, once


@dataclass(frozen=True)
class Beside:
    """What came of it.

    Attributes:
        comparison: model against log.
        source: the model's file.
        extras: calibration, observer, tracker.
        limits: each threshold, and whether it was kept.
        written: name -> file.
    """

    comparison: Comparison
    source: Path
    extras: Extras
    limits: list[dict[str, Any]] = field(default_factory=list)
    written: Named[str, Path] = field(default_factory=dict)

    def as_data(self) -> dict[str, Any]:
        """As the JSON object of the command."""
        found = as_data(self.comparison, self.source)
        return {
            **found,
            **self.extras.as_data(self.comparison),
            "thresholds": self.limits,
            "files": self.written,
        }

    def lines(self) -> list[str]:
        """The answer in a few lines."""
        found = [self.headline(), *answer(self.comparison)]
        if self.extras.calibration is not None:
            from cosim.calibrate.present import answer as fitted

            found += fitted(self.extras.calibration, self.comparison)
        return [*found, *self.threshold_lines()]

    def headline(self) -> str:
        """Log and model in a line."""
        log = self.comparison.log
        kind = "synthetic log" if log.synthetic else "log"
        span = self.comparison.time[-1] - self.comparison.time[0]
        return (
            f"{log.source} ({kind}, {span:.6g} s at {self.comparison.step:.6g} s) and model {self.comparison.model}, "
            "simulated"
        )

    def threshold_lines(self) -> list[str]:
        """Each threshold in a line."""
        found = []
        for limit in self.limits:
            state, name, unit = "kept" if limit["passed"] else "MISSED", limit["signal"], limit["unit"]
            found.append(
                f"threshold {state}: RMSE of {name} {limit['rmse']:.4g} {unit}, limit {limit['limit']:.4g} {unit}"
            )
        return found


def beside(
    log: Path | Log,
    *,
    model: str | None = None,
    mapping: Path | None = None,
    parameter_sets: Sequence[Path] = (),
    settings: Sequence[str] = (),
    step_size: str | None = None,
    thresholds: Sequence[str] = (),
    calibration: dict[str, Any] | None = None,
    observer: bool = False,
    external: Path | None = None,
    out: Path | None = None,
    csv: bool = False,
) -> Beside:
    """Compare, and calibrate first where that is asked for.

    Args:
        log: a file, or a log already read (with the same mapping).
        model: name or file [default: the mapping's, or full_order].
        mapping: mapping file of the log.
        parameter_sets: .ssv files.
        settings: ``name=value unit``.
        step_size: such as ``1 ms``.
        thresholds: ``signal=value unit``.
        calibration: attributes of `cosim.calibrate.command.Request`, or None for none.
        observer: run the observer on the log.
        external: the tracker's record.
        out: folder for pictures and series; a calibration without one writes into ``calibration``.
        csv: series as CSV.

    Raises:
        DataError, ModelError, UsageError, SimulationError: whatever is wrong with log, model, request or run.
    """
    names, table = load_mapping(mapping) if mapping is not None else (None, CompareTable())
    if names is None and model is not None and not isinstance(log, Log):
        names = of_connectors(log, model)
    loaded = log if isinstance(log, Log) else load_log(log, names)
    inputs = [loaded.source, *([external] if external is not None else []), *parameter_sets]
    inputs += [*table.parameter_files, *_held_out_file(calibration)]
    if out is not None:
        keep_logs(out, COMPARED, inputs)  # before any work
    source, table = _source(model, mapping, names, table, loaded)
    step = parse_quantity(step_size, "s") if step_size else None
    with (
        fast_enough(source, len(loaded)) as runs,
        Comparator(loaded, runs, table=table, step=step) as comparator,
    ):
        limits = read_limits(list(thresholds), comparator)
        own = parameters(comparator.system, [*table.parameter_files, *parameter_sets], list(settings))
        given = {**comparator.constants, **own}
        extras = Extras(comparator, given)
        if calibration is not None:
            given = extras.calibrate(calibration, table, names)
        if observer:
            extras.observe()
        if external is not None:
            extras.track(external)
        if observer:
            extras.extend()
        with console.progress(f"comparing with {comparator.system.name}", 1.0):
            comparison = comparator.run(given)
        results = check_limits(comparison, limits)
        written: dict[str, Path] = {}
        if out is not None:
            earlier = Earlier(out, COMPARED, "comparison", inputs)
            written |= write_files(comparison, out, csv)
            written |= extras.write(comparison, out)
            earlier.clear()
    return Beside(comparison, source, extras, results, written)


def of_connectors(log: Path, model: str) -> Mapping | None:
    """A mapping for a log whose columns are called like the connectors of somebody's own model, as a diagnosis takes them.

    None where the model is one of ours, or no column is called so.
    """
    with read_system(open_model(model)) as system:
        if all(part.fmu.ours or part.fmu.house for part in system.components.values()):
            return None
        try:
            return named_columns(log, system, {})[0]
        except DataError:
            return None


def _held_out_file(calibration: dict[str, Any] | None) -> list[Path]:
    """The log that a calibration holds out, if it is a file and not a part of the one that is fitted."""
    text = (calibration or {}).get("held_out")
    return [Path(text)] if text and Path(text).is_file() else []


@contextmanager
def fast_enough(source: Path, samples: int) -> Iterator[Path]:
    """The model file; for a long log a copy of it with native FMUs, which give the same numbers, where they can be made.

    Args:
        source: an .ssp or .fmu file.
        samples: of the log.
    """
    if samples < LONG:
        yield source
        return
    from cosim.native.build import MissingCompilerError
    from cosim.native.package import swapped

    folder, _ = scratch_folder()
    with folder:
        try:
            swift = swapped(source, Path(folder.name, source.name))
        except (
            MissingCompilerError,
            ModelError,
        ):  # no compiler; an FMU that is not ours, or is bad, as will be said
            swift = source
        yield swift


def _source(
    model: str | None, mapping: Path | None, names: Mapping | None, table: CompareTable, log: Log
) -> tuple[Path, CompareTable]:
    """The file to simulate, and what the signals stand for in it: a machine in one file is made first."""
    if mapping is not None and names is not None and names.machine and model is None:
        from cosim.machines import made_for

        made = made_for(mapping, log)
        return build_wiring(made.ssd, made.ssd.parent), made.table
    from cosim.machines import table_in_package

    source = open_model(*_reference(model, names, table))
    return source, table_in_package(source, names, table)


def _reference(model: str | None, mapping: Mapping | None, table: CompareTable) -> tuple[str, Path | None]:
    """The model's name or file, and the folder where a file that the mapping names may lie."""
    if model is not None:
        return model, None
    if mapping is not None and mapping.model is not None:
        return mapping.model, table.folder if mapping.path is None else mapping.path.parent
    return DEFAULT_MODEL, None


def write_files(comparison: Comparison, folder: Path, csv: bool) -> dict[str, Path]:
    """Write pictures and series; returns name -> file.

    Raises:
        UsageError: the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = write_pictures(comparison, folder)
        written["series"] = write_series(comparison, folder / f"series.{'csv' if csv else 'parquet'}")
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return written
