"""`cosim diagnose` for any system: whether a model is one, and the diagnosis handed to people and programs."""

import math
from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from cosim.anysystem.answer import answer, shown_action
from cosim.anysystem.cuts import cut_by_logs
from cosim.anysystem.experiment import write_inputs
from cosim.anysystem.extend import write_extended
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.page import write_page
from cosim.anysystem.pipeline import AnyDiagnosis, diagnose_system
from cosim.anysystem.read import read
from cosim.anysystem.start import settable
from cosim.anysystem.stretch import USUAL
from cosim.console import stderr_console, told, warn
from cosim.diagnosis.answer.credibility import credited
from cosim.diagnosis.answer.schema import Answer, Packages
from cosim.diagnosis.budget import Budget
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.pipeline.parts import part
from cosim.errors import CosimError, UsageError
from cosim.files import Scratch, write_text
from cosim.interrupts import stoppable
from cosim.logs import Log
from cosim.logs.load import open_source
from cosim.logs.mapping import load_mapping
from cosim.memory import returned
from cosim.report.deliver import make_folder
from cosim.report.earlier import Earlier
from cosim.ssp.fmu import MENDED, promises_initial_outputs
from cosim.ssp.read import read_system
from cosim.ssp.system import System
from cosim.system.graph import port_of
from cosim.system.runs import Runs
from cosim.system.structure import structure

SUFFIXES = (".ssp", ".fmu")


def any_system(asked: str | None, mapping: Path | None, log: Path) -> Path | None:
    """The file of the model if it is to be diagnosed as any system; None for a chain of our blocks.

    A package of ours with a log of our signals goes the way of our blocks; the same package with columns named
    ``component.connector`` goes this one.
    """
    named = asked
    if named is None and mapping is not None:
        named = load_mapping(mapping).model_reference
    if named is None or not named.lower().endswith(SUFFIXES):
        return None
    path = Path(named)
    if not path.is_file():
        raise UsageError(f"there is no file '{named}'")
    if path.suffix.lower() == ".fmu":
        return path
    with read_system(path) as system:
        if chain_of_ours(system) and not dotted(log, mapping, system):
            return None
    return path


def chain_of_ours(system: System) -> bool:
    """Whether it has the components of one of our models, run by our blocks."""
    for groups in MODELS.values():
        stages = dict(stage for group in groups for stage in group.stages)
        if all(
            n in system.components and system.components[n].fmu.identifier == b for n, b in stages.items()
        ):
            return True
    return False


def dotted(log: Path, mapping: Path | None, system: System) -> bool:
    """Whether a log's signals are called ``component.connector``."""
    try:
        names = (
            list(load_mapping(mapping).signals)
            if mapping
            else [label.name for label in open_source(log).labels]
        )
        for name in names:
            if "." in name and port_of(system, name).component:
                return True
    except CosimError:
        return False
    return False


def diagnose_any(
    folder: Path,
    logs: Sequence[Path | Log],
    model: Path,
    mapping: Path | None,
    held_out: Sequence[Path | Log],
    tolerance: float,
    calibrate: bool,
    budget: float = math.inf,
) -> Answer:
    """Run the diagnosis of any system and write its folder.

    Args:
        folder: where it goes.
        logs: of one machine, files or logs that were read with the mapping.
        model: .ssp or .fmu.
        mapping: which column is what.
        held_out: further logs that are not fitted.
        tolerance: of trusted parameters, relative standard deviation.
        calibrate: trusted parameters are fitted freely.
        budget: time it may take [s], `USUAL` where it is infinite; the best so far is then the answer, with what was not
            tried among its warnings.

    Ctrl-C or SIGTERM ends the search with the best so far, which is written, and goes on as a KeyboardInterrupt; a second
    one ends at once.

    Raises:
        CosimError: as `cosim.anysystem.pipeline.diagnose_system`.
    """
    allowed = Budget(budget if math.isfinite(budget) else USUAL)
    with returned(), read_system(model) as system, threadpool_limits(1), stoppable(allowed.end):
        recordings, options, others = read([*logs, *held_out], system, mapping)
        for recording in recordings:
            for text in recording.warnings:
                warn(f"{recording.source.name}: {text}")
        if others:
            recordings[0].warnings.append(f"no connector of the system, left alone: {', '.join(others)}")
            warn(recordings[0].warnings[-1])
        cuts = cut_by_logs(system, recordings, len(held_out))
        for advice in structure(system, cuts.names).advice:
            if not told(advice, 0.0):
                stderr_console().print(advice, markup=False)
        notes = unlisted(system)
        for text in notes:
            warn(text)
        make_folder(folder)
        read_from = [log.source if isinstance(log, Log) else log for log in (*logs, *held_out)]
        earlier = Earlier(folder, inputs=[*read_from, model])
        with Runs(system) as runs:
            judged = [group.name for group in cuts.groups if group.judged]

            def watch(text: str) -> None:
                if not told(f"judging {text}", judged.index(text) / len(judged)):
                    stderr_console().print(f"judging {text}", markup=False)

            found = diagnose_system(
                system,
                recordings,
                runs,
                options,
                held=len(held_out),
                tolerance=tolerance,
                calibrate=calibrate,
                watch=watch,
                budget=allowed,
            )
            if allowed.ended:
                warn(
                    f"interrupted: writing what was found until then into {folder}; once more Ctrl-C leaves without"
                )
            if allowed.warnings and not (allowed.ended or math.isfinite(budget)):
                found.notes.append(f"beside FMUs a diagnosis may take {USUAL:g} s: more with --budget 1h")
                warn(found.notes[-1])
            for text in allowed.warnings:
                warn(text)
            untold = untrusted(found, options, calibrate)
            for text in untold:
                warn(text)
            found.notes = [*notes, *found.notes, *untold, *allowed.warnings]
            make_folder(folder)  # which may have been deleted while all was computed
            lost = list[str]()
            with Scratch("extended_") as made:
                drafts, package, file = None, None, None
                with part(lost, "the extended model"):
                    drafts = write_extended(
                        found, Path(made), lambda group, action: shown_action(found, group, action)
                    )
                if drafts:
                    package = Packages(ssp=str(folder / drafts[0].name), ssv=str(folder / drafts[1].name))
                with part(lost, "the next experiment"):
                    file = None if found.proposal is None else write_inputs(found, found.proposal, folder)
                found.notes += lost
                result = answer(found, package, file)
                if drafts:
                    credited({draft: folder / draft.name for draft in drafts}, result)
            write_text(folder / "diagnosis.json", result.model_dump_json(indent=2))
            if not allowed.ended:
                with part(lost, "the report"):
                    write_page(found, result, folder)
                if late := [text for text in lost if text not in result.warnings]:
                    result.warnings += late
                    write_text(folder / "diagnosis.json", result.model_dump_json(indent=2))
            for text in lost:
                warn(text)
            earlier.clear()  # only now: a write that fails must leave the old or the new
    if allowed.ended:
        raise KeyboardInterrupt
    return result


def untrusted(found: AnyDiagnosis, options: AnyOptions, calibrate: bool) -> list[str]:
    """What to say where a component stays unexplained and its parameters are not trusted, or may not be to be trusted."""
    known = {name.partition(".")[0] for name in (*options.trusted, *options.free)}
    lost = [
        name
        for group, finding in found.findings.items()
        if finding.unexplained and not known & set(finding.model.group.components)
        for name in finding.model.group.components
        if any(settable(v) for v in found.system.components[name].fmu.variables.values())
    ]
    trusted = {name.partition(".")[0] for name in options.trusted}
    strained = [
        name
        for finding in found.findings.values()
        if finding.unexplained and not calibrate
        for name in finding.model.group.components
        if name in trusted
    ]
    said = []
    if strained:
        said.append(
            f"what is trusted of {' and '.join(strained)} may be further off than that, several numbers at once: "
            "--calibrate fits it freely and says what that alone gains"
        )
    if lost:
        said.append(
            f"no parameter of {' and '.join(lost)} is trusted or free, so none could be named: list those that you know to "
            "a tolerance in the mapping, [diagnose] trusted (cosim init writes them as a comment), and diagnose again"
        )
    return said


def unlisted(system: System) -> list[str]:
    """Warnings for FMUs that a strict reader refuses and that run all the same."""
    found = {}
    for component in system.components.values():
        if not promises_initial_outputs(component.fmu):
            found[component.fmu.source] = (
                f"{component.fmu.source}: no InitialUnknowns, which FMI demands for its outputs; it is run all the same"
            )
        if (component.fmu.folder / MENDED).is_file():
            found[component.fmu.source + MENDED] = (
                f"{component.fmu.source}: parameters of a variability that FMI 2.0 does not allow are taken as tunable"
            )
        found |= {text: text for text in component.fmu.oddities}
    return list(found.values())
