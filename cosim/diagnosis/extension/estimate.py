"""The extended model of a diagnosis: its values from all blocks together, its packages, and its gain by the FMUs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import rms
from cosim.diagnosis.extension.packages import closed, write_extended
from cosim.diagnosis.extension.together import weighed
from cosim.diagnosis.extension.top_speed import top_speeds
from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.group_model import standing
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.trials import Trial
from cosim.diagnosis.fitting.whole import fitted_chain, whole_run
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.held_out.causes import Held, each_in_turn, left_out_errors, passed_in
from cosim.diagnosis.held_out.free_run import errors, onward, refitted
from cosim.diagnosis.held_out.gain import Gain, begun_anew, measure, run_package
from cosim.diagnosis.held_out.over_logs import over_logs
from cosim.diagnosis.hypotheses.naming import worth_naming
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.grid import of_piece
from cosim.diagnosis.record.record import fixed_values, is_start
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.cross_validation import fold_numbers, held_windows, repetitions
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import CALIBRATED_TRUST
from cosim.diagnosis.verdict.verdict import what_stands
from cosim.ssp.stimulus import stimulus_csv
from fmus.contract import Effect

Array = NDArray[np.float64]


def estimate(
    diagnosis: Diagnosis, groups: tuple[Group, ...], tolerance: float, constants: dict[str, float]
) -> None:
    """Values of the extended model, from all windows but the held-out ones; what the raw samples show is known from them."""
    fit_all(diagnosis, groups, tolerance, constants)
    for finding in diagnosis.findings.values():
        for seen in finding.signatures:
            name = f"{seen.effect.partition('.')[0]}.{seen.parameter}"
            diagnosis.values[name], diagnosis.deviations[name] = seen.value, seen.deviation


def fit_all(
    diagnosis: Diagnosis, groups: tuple[Group, ...], tolerance: float, constants: dict[str, float]
) -> None:
    """Fit the values of the extended model.

    Where every block is understood they are fitted together, driven by the command alone; otherwise block by block, so
    that a block that is not understood does not bend the others.
    """
    findings = diagnosis.findings
    effects = tuple(
        c.effect for c in diagnosis.causes if c.group in findings and c.effect.name not in SAMPLED
    )
    near: dict[str, float] = {}
    deviations: dict[str, float] = {}
    start: dict[str, float] = {}
    rules: dict[str, Whitener] = {}
    for finding in findings.values():
        fit = what_stands(finding).fit
        start |= {n: v for n, v in finding.task.model.fixed.items() if is_start(n)}
        near |= fit.values
        deviations |= fit.deviations
        diagnosis.correlations |= fit.correlations
        rules |= finding.task.rules
    diagnosis.values, diagnosis.deviations, diagnosis.start = constants | near, deviations, start
    record, cuts, off = diagnosis.record, diagnosis.record.cuts, partial(off_value, findings)
    diagnosis.between, diagnosis.top_speeds = {}, {}
    if (diagnosis.held is not None or tolerance >= CALIBRATED_TRUST) and len(findings) == len(groups) == 1:
        (finding,) = findings.values()  # alone it can bend no other, and the free run is what will be judged
        estimate_alone(diagnosis, finding, effects, tolerance, constants)
        return
    if diagnosis.rests or diagnosis.unjudged or diagnosis.sparse or not findings:
        for finding in findings.values():
            fit = what_stands(finding).fit
            diagnosis.between |= over_logs(fit, repetitions(finding.task), off) if cuts else {}
        return
    count = min(whole_run(r).windows(diagnosis.record.signals[s]).shape[0] for s, r in rules.items())
    mask = ~held_windows(count) if diagnosis.held is None else None

    def fitted(effects: tuple[Effect, ...], begin: dict[str, float]) -> Fit:
        return fitted_chain(
            groups, diagnosis.record, rules, effects, begin, start, tolerance, mask, constants
        )

    chain = weighed(diagnosis, groups, fitted, near, tolerance)
    diagnosis.values = constants | {n: v for n, v in chain.values.items() if n not in start}
    diagnosis.deviations, diagnosis.correlations = chain.deviations, chain.correlations
    diagnosis.start = {n: chain.values.get(n, v) for n, v in start.items()}
    if cuts:
        log = fold_numbers({s: whole_run(r) for s, r in rules.items()}, record.time.size, mask=mask)
        diagnosis.between = over_logs(chain, log, off)


def estimate_alone(
    diagnosis: Diagnosis,
    finding: Finding,
    effects: tuple[Effect, ...],
    tolerance: float,
    constants: dict[str, float],
) -> None:
    """Values of the extended model where one group is all that was judged: what makes its free run best on held-out data.

    Of an axis that drifts there are two estimates: from how the error moves from window to window, and from the free run
    over the log, which that log's course may have biased. Data held out tell which one predicts them better.
    """
    record, held, task = diagnosis.record, diagnosis.held, finding.task
    signal, rule = next(iter(task.rules.items()))
    mask = ~held_windows(rule.windows(record.signals[signal]).shape[0]) if held is None else None
    near = what_stands(finding).fit
    free, walked = partial(refitted, mask=mask), False
    best = free(finding, effects, tolerance, near)
    plain = free(finding, (), tolerance, finding.null.fit)
    if held is not None and signal in held.record.signals and task.model.group.drifts:
        error = partial(held_error, finding, held, signal, tolerance)
        other = onward(finding, effects, tolerance, near)
        # a limit that readings pass is none, in whichever estimate
        sure = all(
            worth_naming(Trial(effects, best, 0), e, task.model, tolerance)
            and not passed_in(held, task, e, best)
            for e in effects
        )
        if not sure or error(effects, other, True) <= error(effects, best, False):
            best, walked = other, True
        other = onward(finding, (), tolerance, finding.null.fit)
        plain = min((plain, False), (other, True), key=lambda fit: error((), *fit))[0]
    diagnosis.values, diagnosis.deviations = constants | best.values, best.deviations
    diagnosis.correlations = best.correlations
    if (
        tolerance >= CALIBRATED_TRUST
    ):  # what the extension is held against has its own parameters fitted as well
        diagnosis.calibrated = plain.values

    fold = None
    if record.cuts or (held is None and each_in_turn(record, rule, tolerance) is not None):
        fold = fold_numbers(task.rules, record.time.size, walked, mask)
        diagnosis.between = over_logs(best, fold, partial(off_value, {"": finding}))
    if tolerance >= CALIBRATED_TRUST:
        diagnosis.top_speeds = top_speeds(task.model, effects, best, fold)


def off_value(findings: Mapping[str, Finding], name: str) -> float:
    """Where ``component.parameter`` has no effect, SI: 0 of a parameter of the nominal model."""
    for finding in findings.values():
        model = finding.task.model
        if name.partition(".")[0] in model.group.components:
            return 0.0 if name in model.group.trusted else model.nominal(name)
    return 0.0


def held_error(
    finding: Finding,
    held: Held,
    signal: str,
    tolerance: float,
    effects: tuple[Effect, ...],
    found: Fit,
    walked: bool,
) -> float:
    """RMSE of a free run over data held out with a fit's values, SI; `walked` as `left_out_errors` takes it."""
    if held.in_turn:
        return rms(np.concatenate(left_out_errors(finding, effects, found, signal, tolerance, walked)))
    return rms(errors(finding, found, held.record)[signal][held.first :])


def write_packages(diagnosis: Diagnosis, folder: Path) -> tuple[Path, dict[str, float], dict[str, float]]:
    """Write the model before and after its extension.

    Returns:
        The package of the model before, and the values that differ from nominal before and after, SI.
    """
    machine, record = diagnosis.machine, diagnosis.record
    folder.mkdir(parents=True, exist_ok=True)
    stimulus = None
    first = record.pieces[0]  # a package plays one command: of several logs the first one's
    if closed(machine.source) and first.grid is None:
        stimulus = stimulus_csv(first.time, first.signals[machine.drive])
    # the mapping's values first: it may set back to nominal what the model's own files say
    values = machine.values | diagnosis.values
    values |= of_piece(standing(diagnosis.start, values), 0)
    plain = machine.values | diagnosis.calibrated
    nominal = write_extended(machine.source, plain, folder / "nominal", None)["open"]
    diagnosis.drafts = write_extended(machine.source, values, folder, stimulus)
    return nominal, plain, values


def gain_by_fmus(diagnosis: Diagnosis, folder: Path) -> None:
    """Write both packages, run their FMUs on the log's command, and measure the errors on what was held out."""
    machine, record, held = diagnosis.machine, diagnosis.record, diagnosis.held
    nominal, plain, values = write_packages(diagnosis, folder)
    extended = diagnosis.drafts["open"]
    begin = standing(diagnosis.start, machine.values | diagnosis.values)
    diagnosis.before = run_package(nominal, record, machine, standing(diagnosis.start, plain))
    diagnosis.after = run_package(extended, record, machine, begin if record.cuts else {})
    if held is None:
        diagnosis.gains = measure(record, diagnosis.before, diagnosis.after, diagnosis.window)
        return
    start = dict.fromkeys((n for n in values if is_start(n)), 0.0)  # that log may begin at rest
    start |= {n: v for g in diagnosis.groups for n, v in fixed_values(held.record, g).items()}
    diagnosis.held_before = run_package(nominal, held.record, machine, standing(start, plain))
    diagnosis.held_after = run_package(extended, held.record, machine, standing(start, values))
    window = diagnosis.window
    diagnosis.gains = measure(held.record, diagnosis.held_before, diagnosis.held_after, window, held.first)
    drifting = [s for g in diagnosis.groups if g.drifts for s in g.observed]
    if diagnosis.causes and any(diagnosis.gains[s].after > diagnosis.gains[s].before for s in drifting):
        diagnosis.gains |= ahead(diagnosis, held, [s for s in drifting if s in diagnosis.gains])


def ahead(diagnosis: Diagnosis, held: Held, signals: Sequence[str]) -> dict[str, Gain]:
    """Errors of predictions over a window each, from where the machine stands, on what was held out.

    Where one push in minutes decides the end of a free run, it says nothing of the machine: such an axis is then judged by
    how its prediction goes on, as its causes were.

    Args:
        diagnosis: with the runs of both packages.
        held: what was held out.
        signals: of the axes that drift.
    """
    record, window = held.record, diagnosis.window
    before = begun_anew(record, diagnosis.held_before, signals, window, held.first)
    after = begun_anew(record, diagnosis.held_after, signals, window, held.first)
    found = measure(record, before, after, window, held.first)
    return {s: replace(found[s], horizon=window * record.h) for s in signals}


def worse(diagnosis: Diagnosis) -> bool:
    """True if the extension makes errors on held-out data larger, taken over all signals.

    Of windows of the fitted log itself it must be clear where it has causes: these were borne out on other windows of it.
    """
    gains = diagnosis.gains.values()
    ratio = np.prod([g.after / max(g.before, 1e-300) for g in gains])
    if diagnosis.held is None and diagnosis.causes:
        return bool(ratio > 1.0 and any(g.ratio_ci95[0] > 1.0 for g in gains))
    return bool(ratio > 1.0)
