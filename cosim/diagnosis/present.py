"""The diagnosis handed to people and programs: what is said up front, files written, and the answer in the terminal."""

from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from cosim.console import stderr_console, stdout_console, table, warn
from cosim.diagnosis.answer import answer
from cosim.diagnosis.curve import curve_of
from cosim.diagnosis.experiment import Proposal, proposal_for, write_command
from cosim.diagnosis.found import Diagnosis, Interrupted
from cosim.diagnosis.isolability import isolability
from cosim.diagnosis.lexicon import speaking
from cosim.diagnosis.machine import Machine
from cosim.diagnosis.model import machine_of
from cosim.diagnosis.progress import ShownProgress
from cosim.diagnosis.schema import Answer
from cosim.diagnosis.story import diagnose
from cosim.diagnosis.stretch import by_twin
from cosim.diagnosis.watch import Watch
from cosim.errors import UsageError
from cosim.logs import Log, Tracker
from cosim.report.page import save_and_report


def announce(log: Log, tracker: Tracker | None, machine: Machine) -> None:
    """Say on stderr, before anything is computed, what these signals can tell apart and which others would help."""
    measured = {*log.signals} | ({"p_load"} if "p_load" in log else set())
    apart = isolability(machine.groups, measured | ({"slew_external"} if tracker else set()))
    for where, names in apart.classes:
        stderr_console().print(f"residual of {' and '.join(where)} shows: {', '.join(names)}", markup=False)
    for advice in apart.advice:
        stderr_console().print(advice, markup=False)


def diagnose_into(
    folder: Path,
    log: Log,
    tracker: Tracker | None,
    asked: str | None,
    tolerance: float,
    calibrate: bool,
    mapping: Path | None = None,
    held_out: Log | None = None,
) -> Answer:
    """Run the whole diagnosis and write its folder: JSON, extended packages, comparison, report.

    Ctrl-C leaves in the folder what had been found until then, and goes on as a KeyboardInterrupt.

    Args:
        folder: where it goes.
        log: the log.
        tracker: the external tracker's record.
        asked: the model as the user gave it; by default the mapping's.
        tolerance: trust in the nominal parameters.
        calibrate: fit them freely.
        mapping: the mapping file with which the log was read.
        held_out: another log of the machine, on which gains are measured.

    Raises:
        CosimError: as `cosim.diagnosis.story.diagnose`.
    """
    machine = machine_of(asked, log, mapping)
    announce(log, tracker, machine)
    make_folder(folder)
    with threadpool_limits(1), speaking(machine.lexicon), ShownProgress() as watch:
        try:
            found = diagnose(
                log,
                tracker=tracker,
                model=machine,
                held_out=held_out,
                tolerance=tolerance,
                calibrate=calibrate,
                folder=folder,
                watch=watch,
            )
            return delivered(found, log, folder, watch)
        except Interrupted as stop:
            watch.close()
            leave(stop.found, log, folder)
            raise


def make_folder(folder: Path) -> None:
    """Make the folder of results before anything is computed.

    Raises:
        UsageError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None


def delivered(found: Diagnosis, log: Log, folder: Path, watch: Watch | None = None) -> Answer:
    """Write what was found into a folder, and give it in the contract's form.

    Raises:
        Interrupted: Ctrl-C.
    """
    watch = watch or Watch()
    try:
        found.stage = "next experiment"
        watch.stage("next", found.stage)
        proposal = None
        if log.time_unit == "s":  # what is proposed is a command over time
            proposal = proposal_for(
                found.machine.groups,
                found.findings,
                found.causes,
                found.start,
                found.values,
                size=full_command(found),
                interval=found.record.h,
            )
        if proposal is not None:
            proposal = write_command(proposal, folder)
        found.stage = ""
        watch.stage("report", "report")
        return written(found, log, folder, proposal)
    except KeyboardInterrupt:
        found.stage = found.stage or "report"
        raise Interrupted(found) from None


def full_command(found: Diagnosis) -> float:
    """The largest command that a proposal may use, SI: 1 for a valve's, as large as in the log for another drive."""
    drive = found.machine.drive
    return 1.0 if drive == "u" else float(np.max(np.abs(found.record.signals[drive])))


def written(found: Diagnosis, log: Log, folder: Path, proposal: Proposal | None) -> Answer:
    """Write answer, series and report."""
    result = answer(found, log, proposal)
    result.drive_curve = None if found.stage else curve_of(found, log)
    (folder / "diagnosis.json").write_text(result.model_dump_json(indent=2), encoding="utf-8")
    if save_and_report(found, result, folder, proposal) is None:
        warn(
            "no report.html: install the extra 'report' (plotly, jinja2), then run 'cosim report' on the folder"
        )
    return result


def leave(found: Diagnosis, log: Log, folder: Path) -> None:
    """Write what an interrupted diagnosis has found; the comparison, if it was not reached, by the compiled twin."""
    warn(f"interrupted ({found.stage}): writing what was found until then; once more Ctrl-C leaves without")
    if not found.before:
        found.before = by_twin(found, found.record, found.machine.base)
    written(found, log, folder, None)
    judged = ", ".join(found.findings) or "no block"
    warn(f"{folder} holds what was found: {judged} judged; run it again for the rest")


def show(result: Answer, out: Path) -> None:
    """Print the answer for people."""
    kind = "synthetic log" if result.synthetic else "measured log"
    stdout_console().print(f"verdict: {result.verdict} ({kind}, model {result.model})")
    for cause in result.causes:
        numbers = ", ".join(
            f"{n} = {p.value:.6g} {p.unit} ({p.ci95[0]:.6g} to {p.ci95[1]:.6g})"
            for n, p in cause.parameters.items()
        )
        stdout_console().print(f"cause: {cause.effect}: {numbers}", markup=False)
        if cause.indistinguishable_from:
            stdout_console().print(
                f"  cannot be told from: {', '.join(cause.indistinguishable_from)}", markup=False
            )
    for item in result.refused:
        stdout_console().print(f"refused: {item.effect}: {item.why}", markup=False)
    for rest in result.unexplained:
        stdout_console().print(f"unexplained in {rest.block}: {rest.what}", markup=False)
    rows = [
        (
            s,
            f"{g.rmse_before:.4g}",
            f"{g.rmse_after:.4g}",
            f"{result.linear[s].rmse:.4g}" if s in result.linear else "",
            f"{g.noise_floor:.4g}",
            g.unit,
        )
        for s, g in result.gain.items()
    ]
    stdout_console().print(
        table(
            f"Error on {result.held_out}, before and after",
            ["signal", "before", "after", "linear model", "noise", "unit"],
            rows,
        )
    )
    if result.next_experiment:
        stdout_console().print(
            f"next experiment: {result.next_experiment.why}: {result.next_experiment.excitation}",
            markup=False,
        )
    stdout_console().print(f"written to {out}", markup=False)
