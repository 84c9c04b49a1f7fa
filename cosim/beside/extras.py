"""What `cosim compare` does beyond the two tables: calibration, the observer on the log, the external tracker."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim import console
from cosim.compare.comparator import Comparator
from cosim.compare.mapping import CompareTable
from cosim.compare.outcome import Comparison
from cosim.errors import UsageError
from cosim.ssp.system import Value

if TYPE_CHECKING:
    from cosim.beside.extended import ExtendedRun
    from cosim.beside.tracker import TrackerRun
    from cosim.calibrate import Calibration
    from cosim.compare.observer import ObserverRun
    from cosim.logs import Mapping


class Extras:
    """Collects what was asked for, then shows and writes it.

    Attributes:
        comparator: log and model.
        given: start values by name; after a calibration, those without what was free.
        calibration, observer, tracker: what was found, or None where it was not asked for.
        extended: what the extended observer found, or None without `observer` or in a model without mechanics.
    """

    def __init__(self, comparator: Comparator, given: dict[str, Value]) -> None:
        self.comparator, self.given = comparator, given
        self.calibration: Calibration | None = None
        self.observer: ObserverRun | None = None
        self.tracker: TrackerRun | None = None
        self.extended: ExtendedRun | None = None

    def calibrate(
        self, options: dict[str, Any], table: CompareTable, names: "Mapping | None"
    ) -> dict[str, Value]:
        """Calibrate; returns the start values that the comparison is to use.

        Raises:
            UsageError, DataError, SimulationError: as `cosim.calibrate.command.calibrated`.
        """
        from cosim.calibrate.command import Request, calibrated

        self.calibration = calibrated(self.comparator, Request(**options), self.given, table, names)
        self.given = {n: v for n, v in self.given.items() if n not in self.calibration.values}
        return {**self.given, **self.calibration.values}

    def observe(self) -> None:
        """Run the observer on the log; raises as `cosim.compare.observer.run_observer`."""
        from cosim.compare.observer import run_observer

        self.observer = run_observer(self.comparator, self.given)

    def track(self, file: Path) -> None:
        """Hold the tracker's record against the slew sensor; raises as `cosim.beside.tracker.run_tracker`."""
        from cosim.beside.tracker import run_tracker

        self.tracker = run_tracker(self.comparator.log, file)

    def extend(self) -> None:
        """Run the extended observer, with the tracker's readings where there are some.

        Raises:
            UsageError, DataError, SimulationError: as `cosim.beside.extended.run_extended`.
        """
        from cosim.beside.extended import MECHANICAL, run_extended

        if MECHANICAL not in self.comparator.system.components:
            return
        readings = None
        if self.tracker is not None:
            from cosim.beside.tracker import readings_of

            readings = readings_of(self.tracker)
        self.extended = run_extended(self.comparator, self.given, readings)

    def as_data(self, comparison: Comparison) -> dict[str, Any]:
        """What was found as plain data, under ``calibration``, ``observer``, ``tracker``."""
        found: dict[str, Any] = {}
        if self.calibration is not None:
            from cosim.calibrate.present import as_data as of_calibration

            found["calibration"] = of_calibration(self.calibration, comparison)
        if self.observer is not None:
            from cosim.compare.observer_present import as_data as of_observer

            found["observer"] = of_observer(self.observer)
        if self.extended is not None:
            from cosim.beside.extended_present import as_data as of_extended

            found["extended_observer"] = of_extended(self.extended)
        if self.tracker is not None:
            from cosim.beside.tracker import as_data as of_tracker

            found["tracker"] = of_tracker(self.tracker)
        return found

    def show(self, comparison: Comparison) -> None:
        """Print tables and sentences."""
        if self.calibration is not None:
            from cosim.calibrate import present

            output = console.stdout_console()
            for table in present.tables(self.calibration, comparison):
                output.print(table)
            for text in present.explanations(self.calibration):
                output.print(text, markup=False, soft_wrap=True)
        self.show_further(verbose=True)

    def show_further(self, verbose: bool = False) -> None:
        """Print what observer and tracker say; with `verbose` their tables, else their answers in sentences."""
        output = console.stdout_console()
        if self.observer is not None:
            from cosim.compare import observer_present

            if verbose:
                rows = observer_present.rows(self.observer)
                output.print(console.table("Observer FMU on the log", observer_present.HEADS, rows))
            told = observer_present.lines if verbose else observer_present.answer
            for text in told(self.observer):
                output.print(text, markup=False, soft_wrap=True)
        if self.extended is not None:
            from cosim.beside import extended_present

            for text in extended_present.lines(self.extended):
                output.print(text, markup=False, soft_wrap=True)
        if self.tracker is not None:
            from cosim.beside import tracker

            if verbose:
                table = console.table("Slew sensor and tracker", tracker.HEADS, tracker.rows(self.tracker))
                output.print(table)
            else:
                output.print(tracker.answer(self.tracker), markup=False, soft_wrap=True)
            for text in tracker.lines(self.tracker):
                output.print(text, markup=False, soft_wrap=True)

    def write(self, comparison: Comparison, folder: Path) -> dict[str, Path]:
        """Write files into a folder; returns name -> file.

        Raises:
            UsageError: the folder cannot be written to.
        """
        written: dict[str, Path] = {}
        if self.calibration is not None:
            from cosim.calibrate.command import write_files

            written |= write_files(self.calibration, self.comparator, comparison, self.given, folder)
        try:
            if self.observer is not None:
                from cosim.compare.observer_present import write_picture as draw_observer

                written["observer"] = draw_observer(self.observer, folder / "observer.png")
            if self.extended is not None:
                from cosim.beside import extended_present

                written["extended_observer"] = extended_present.write_picture(
                    self.extended, folder / "extended_observer.png"
                )
                written["estimates"] = extended_present.write_estimates(
                    self.extended, folder / "estimates.csv"
                )
            if self.tracker is not None:
                from cosim.beside.tracker import write_picture as draw_tracker

                written["tracker"] = draw_tracker(self.tracker, folder / "tracker.png")
        except OSError as error:
            raise UsageError(
                f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
            ) from None
        return written
