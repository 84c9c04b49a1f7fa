"""The diagnosis handed to people and programs: what is said up front, files written, and the answer in the terminal."""

import math
from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from cosim.console import stderr_console, typed, warn
from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.answer.credibility import credited
from cosim.diagnosis.answer.curve import curve_of
from cosim.diagnosis.answer.experiment import (
    FULL,
    Proposal,
    Reach,
    first_of_all,
    proposal_for,
    reached,
    write_command,
)
from cosim.diagnosis.answer.schema import Answer
from cosim.diagnosis.budget import Budget
from cosim.diagnosis.found import Diagnosis, Interrupted
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.isolability import isolability
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.pipeline.parts import part
from cosim.diagnosis.pipeline.stretch import by_twin
from cosim.diagnosis.progress import ShownProgress
from cosim.diagnosis.watch import Watch
from cosim.errors import UsageError
from cosim.files import Scratch, write_text
from cosim.interrupts import stoppable
from cosim.lexicon import speaking
from cosim.logs import Log, Tracker, listed
from cosim.report.earlier import Earlier
from cosim.report.folder import keep
from cosim.report.material import gather
from cosim.report.page import save_and_report


def announce(logs: Sequence[Log], tracker: Tracker | None, machine: Machine) -> None:
    """Say on stderr, before anything is computed, what these signals can tell apart and which others would help."""
    measured = set.intersection(
        *({*log.signals} | ({"p_load"} if "p_load" in log else set()) for log in logs)
    ) - set(machine.aside)
    apart = isolability(machine.groups, measured | ({"slew_external"} if tracker else set()))
    for where, names in apart.classes:
        stderr_console().print(f"residual of {' and '.join(where)} shows: {', '.join(names)}", markup=False)
    for advice in apart.advice:
        stderr_console().print(advice, markup=False)


def diagnose_into(
    folder: Path,
    log: Log | Sequence[Log],
    tracker: Tracker | None,
    asked: str | None,
    tolerance: float,
    calibrate: bool,
    mapping: Path | None = None,
    held_out: Log | Sequence[Log] | None = None,
    budget: float = math.inf,
    verbose: bool = False,
) -> Answer:
    """Run the whole diagnosis and write its folder: JSON, extended packages, comparison, report.

    Ctrl-C or SIGTERM leaves in the folder what had been found until then, of the block that is being judged as well,
    and goes on as a KeyboardInterrupt; a second one ends at once.

    Args:
        folder: where it goes.
        log: the log, or several of one machine.
        tracker: the external tracker's record.
        asked: the model as the user gave it; by default the mapping's.
        tolerance: trust in the nominal parameters.
        calibrate: fit them freely.
        mapping: the mapping file with which the log was read.
        held_out: another log of the machine, or several, on which gains are measured.
        budget: time it may take, s; what was not tried is said on stderr and among the warnings.
        verbose: say on stderr beforehand what these signals can tell apart.

    Raises:
        CosimError: as `cosim.diagnosis.pipeline.diagnose.diagnose`.
    """
    allowed = Budget(budget)
    logs = listed(log)
    machine = machine_of(asked, logs, mapping)
    if verbose:
        announce(logs, tracker, machine)
    make_folder(folder)
    read = [one.source for one in (*logs, *(listed(held_out) if held_out is not None else ()))]
    read += [tracker.source] if tracker is not None else []
    earlier = Earlier(folder, inputs=read)
    with (
        Scratch("extended_") as made,
        threadpool_limits(1),
        speaking(machine.lexicon),
        stoppable(allowed.end),
        ShownProgress() as watch,
    ):
        try:
            found = diagnose(
                logs,
                tracker=tracker,
                model=machine,
                held_out=held_out,
                tolerance=tolerance,
                calibrate=calibrate,
                folder=Path(made),
                watch=watch,
                budget=allowed,
            )
            for warning in allowed.warnings:
                warn(warning)
            result = delivered(found, logs, folder, watch)
            earlier.clear()  # only now: a write that fails must leave the old or the new
            return result
        except Interrupted as stop:
            watch.close()
            leave(stop.found, logs, folder)
            earlier.clear()
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


def delivered(found: Diagnosis, log: Log | Sequence[Log], folder: Path, watch: Watch | None = None) -> Answer:
    """Write what was found into a folder, and give it in the contract's form.

    Raises:
        Interrupted: Ctrl-C.
    """
    watch = watch or Watch()
    try:
        handed_over(found, log, folder)  # before the answer, which names them
        found.stage = "next experiment"
        said(found, log, folder, None)  # the answer first: what follows may fail, or be ended from outside
        watch.stage("next", found.stage)
        proposal = None
        if found.budget.gone:
            found.notes.append(found.budget.omitted("the next experiment"))
        elif listed(log)[0].time_unit == "s" and not found.data:  # what is proposed is a command over time
            with part(found.notes, "the next experiment"):
                proposal = proposed(found)
                if proposal is not None:
                    proposal = write_command(proposal, folder)
        found.stage = ""
        watch.stage("report", "report")
        return written(found, log, folder, proposal)
    except KeyboardInterrupt:
        found.stage = found.stage or "report"
        raise Interrupted(found) from None


def proposed(found: Diagnosis) -> Proposal | None:
    """The next experiment: what separates causes alike, or what shows most where the log shows nothing."""
    if found.at_rest:
        if found.machine.drive != "u":
            return None  # nothing says how far it may go
        rules = {s: r.of_any_log() for f in found.findings.values() for s, r in f.task.rules.items()}
        return first_of_all(found.machine.groups, rules, found.start, interval=found.record.h)
    return proposal_for(
        found.machine.groups,
        found.findings,
        found.causes,
        found.start,
        found.values,
        reach=reach_of(found),
        interval=found.record.h,
    )


def reach_of(found: Diagnosis) -> Reach:
    """How far the command of a proposal may go, SI: what our valve takes, or what the log of another machine has shown."""
    return FULL if found.machine.mapping is None else reached(found.record.signals[found.machine.drive])


def handed_over(found: Diagnosis, log: Log | Sequence[Log], folder: Path) -> None:
    """Put the extended packages into a folder, once and complete: nothing that has its name is written again."""
    make_folder(folder)  # which may have been deleted while all was computed
    drafts, found.drafts = found.drafts, {}
    if not drafts:
        return
    by_the_twin(found)
    found.packages = {name: folder / made.name for name, made in drafts.items()}
    with part(found.notes, "the extended package"):
        targets = {made: found.packages[name] for name, made in drafts.items()}
        credited(targets, answer(found, log, None))
        return
    found.packages = {}


def by_the_twin(found: Diagnosis) -> None:
    """Errors of the nominal model by the twin where the FMUs were not run."""
    if not found.before:
        with part(found.notes, "the nominal model's run"):
            found.before = by_twin(found, found.record, found.machine.base)


def said(found: Diagnosis, log: Log | Sequence[Log], folder: Path, proposal: Proposal | None) -> Answer:
    """Write the answer."""
    by_the_twin(found)
    result = answer(found, log, proposal)
    if not found.stage:
        with part(found.notes, "the static drive curve"):
            result.drive_curve = curve_of(found, log)
    write_text(folder / "diagnosis.json", result.model_dump_json(indent=2))
    return result


def written(found: Diagnosis, log: Log | Sequence[Log], folder: Path, proposal: Proposal | None) -> Answer:
    """Write answer, series and report; a report that fails leaves the answer, which says so."""
    result = said(found, log, folder, proposal)
    known = len(found.notes)
    with part(found.notes, "the report"):
        if found.budget.gone and not found.budget.ended:
            keep(gather(found, result, folder, proposal), folder)
            found.notes.append(
                f"{found.budget.omitted('the report')}; 'cosim report {typed(folder)}' makes it"
            )
        elif save_and_report(found, result, folder, proposal) is None:
            warn(
                "no report.html: install the extra 'report' (plotly, jinja2), then run 'cosim report' on the folder"
            )
    for note in found.notes:
        warn(note)
    return said(found, log, folder, proposal) if len(found.notes) > known else result


def leave(found: Diagnosis, log: Log | Sequence[Log], folder: Path) -> None:
    """Write what an interrupted diagnosis has found; the comparison, if it was not reached, by the compiled twin."""
    warn(f"interrupted ({found.stage}): writing what was found until then; once more Ctrl-C leaves without")
    handed_over(found, log, folder)
    written(found, log, folder, None)
    judged = ", ".join(found.findings) or "no block"
    warn(f"{folder} holds what was found: {judged} judged; run it again for the rest")
