"""A diagnosis as it is asked for, of our crane or of any system of FMUs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.anysystem.command import any_system, diagnose_any
from cosim.console import warn
from cosim.diagnosis.answer.schema import Answer
from cosim.errors import UsageError
from cosim.logs import Log, Tracker, load_log, load_mapping, load_tracker
from cosim.report.deliver import diagnose_into
from cosim.report.folder import ANSWER, read_answer


@dataclass(frozen=True)
class Asked:
    """What is asked for; the attributes are those of `cosim.api.diagnose`."""

    logs: list[Path | Log]
    model: str | None
    mapping: Path | None
    external: Path | Tracker | None
    held_out: list[Path | Log]
    tolerance: float
    calibrate: bool
    budget: float
    folder: Path
    verbose: bool = False

    def left(self) -> Answer | None:
        """What an interrupted diagnosis has left in its folder, or None."""
        return read_answer(self.folder) if (self.folder / ANSWER).is_file() else None


def run(asked: Asked) -> Answer:
    """Run the diagnosis and write its folder.

    Raises:
        CosimError: as `cosim.report.deliver.diagnose_into` and `cosim.anysystem.command.diagnose_any`.
    """
    if not 0.0 < asked.tolerance < math.inf:
        raise UsageError(
            f"a tolerance of {asked.tolerance:g} makes no sense: give a positive share such as 0.01"
        )
    foreign = any_system(asked.model, asked.mapping, file_of(asked.logs[0]))
    if foreign is not None:
        if asked.external is not None:
            raise UsageError(
                "--external goes with our crane; give the tracker's signal as a column of the log"
            )
        return diagnose_any(
            asked.folder,
            asked.logs,
            foreign,
            asked.mapping,
            asked.held_out or second_records(asked),
            asked.tolerance,
            asked.calibrate,
            asked.budget,
        )
    logs = [loaded(log, asked) for log in asked.logs]
    external = load_tracker(asked.external) if isinstance(asked.external, Path) else asked.external
    others = [loaded(log, asked) for log in asked.held_out] or second_records(asked)
    return diagnose_into(
        asked.folder,
        logs,
        external,
        asked.model,
        asked.tolerance,
        asked.calibrate,
        asked.mapping,
        others or None,
        asked.budget,
        asked.verbose,
    )


def second_records(asked: Asked) -> list[Log]:
    """The record that a mapping holds out, of each file: benchmarks keep two in one file (``uEst``, ``uVal``)."""
    if asked.mapping is None:
        return []
    return second_records_of([log for log in asked.logs if isinstance(log, Path)], asked.mapping)


def second_records_of(logs: Sequence[Path], mapping: Path) -> list[Log]:
    """The second record of each file, by the table ``[held_out]`` of a mapping; none without one."""
    plain = load_mapping(mapping)
    if not plain.held_out:
        return []
    found = [load_log(log, plain.of_held_out) for log in logs]
    for log in found:
        for warning in log.warnings:
            warn(f"held out: {warning}")
    return found


def loaded(log: Path | Log, asked: Asked) -> Log:
    """A log, read if it is a file; warnings name the file unless it is the only one."""
    found = load_log(log, asked.mapping) if isinstance(log, Path) else log
    for warning in found.warnings:
        warn(warning if len(asked.logs) == 1 and log is asked.logs[0] else f"{file_of(log)}: {warning}")
    return found


def file_of(log: Path | Log) -> Path:
    """The file of a log."""
    return log if isinstance(log, Path) else log.source
