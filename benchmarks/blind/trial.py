"""One case of the blind suite: make the log, diagnose it, write down what was said and what the truth would have gained."""

import tempfile
import time
import traceback
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.cases import Case
from benchmarks.blind.sizes import GROUP_OF, UNKNOWN
from cosim.diagnosis.fitting.fit import fit
from cosim.diagnosis.fitting.noise import learned
from cosim.diagnosis.fitting.trials import tried, unknowns
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.held_out.gain import measure
from cosim.diagnosis.model.groups import left_out
from cosim.diagnosis.model.machine import Machine, our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.verdict.verdict import Cause, Rest
from cosim.rig import RigRun, make_log
from cosim.rig.sensing import SEAM_ANGLE
from cosim.rig.write import as_log, as_tracker
from fmus import registry

Array = NDArray[np.float64]
TRUST = 0.01
SAMPLED = ("sensor.quantisation", "sensor.dropout")  # seen in the raw samples, not in a likelihood


def run_case(
    case: Case, fmus: bool, blocks: Collection[str] = (), without: Collection[str] = ()
) -> dict[str, Any]:
    """The case with its outcome, as plain data; an error of the diagnosis is an outcome too.

    Args:
        case: what is hidden, and how.
        fmus: run the extended model's FMUs.
        blocks: judge these groups of the crane alone; empty: all.
        without: effects that the diagnosis may not consider, beside the one that the case leaves out.
    """
    row: dict[str, Any] = {"case": case.plain()}
    try:
        run = make_log(**case.recipe())
        log, tracker = as_log(run), as_tracker(run) if case.tracker else None
        began, cpu = time.perf_counter(), time.process_time()
        with left_out(case.removed, *without), tempfile.TemporaryDirectory() as folder:
            found = diagnose(
                log, tracker=tracker, model=judged(blocks), folder=Path(folder) / "out" if fmus else None
            )
        row["seconds"] = time.perf_counter() - began
        row["cpu_seconds"] = time.process_time() - cpu
        row |= said(found)
        row["truth"] = truth(case, found, run)
        row["noise_known"] = noise_known(case, found, run)
        row["crossed"] = crossed(run)
        row["noise"] = noise_held_out(found, run)
    except Exception:
        row["error"] = traceback.format_exc()
    return row


def judged(blocks: Collection[str]) -> Machine:
    """The crane, of which these groups alone are judged; all where none is named."""
    machine = our_machine("full_order")
    return replace(machine, groups=tuple(g for g in machine.groups if not blocks or g.name in blocks))


def said(found: Diagnosis) -> dict[str, Any]:
    """What the diagnosis answered, as plain data."""
    return {
        "verdict": found.verdict,
        "causes": [plain_cause(cause) for cause in found.causes],
        "rests": [plain_rest(rest, found) for rest in found.rests],
        "left": leftovers(found, "after"),
        "first": leftovers(found, "before"),
        "events": {
            f"{name}.{signal}.{kind}": [event.p_value, event.gain, event.excess]
            for name, finding in found.findings.items()
            for signal, kinds in finding.events.items()
            for kind, event in kinds.items()
        },
        "never": found.never,
        "chosen": {name: list(f.chosen.names) for name, f in found.findings.items()},
        "fmu_gain": {s: [g.before, g.after] for s, g in found.gains.items()},
    }


def plain_cause(cause: Cause) -> dict[str, Any]:
    """A named cause as plain data."""
    return {
        "effect": cause.effect.name,
        "group": cause.group,
        "gain": cause.gain,
        "held_out": cause.held_out.gain,
        "alike": list(cause.indistinguishable),
        "parameters": {n: [float(v), float(d)] for n, (v, d) in cause.parameters.items()},
    }


def plain_rest(rest: Rest, found: Diagnosis) -> dict[str, Any]:
    """What stays unexplained, its size in units of the noise."""
    return {
        "block": rest.block,
        "signal": rest.signal,
        "what": rest.what,
        "p": rest.leftover.p_value,
        "gain": rest.leftover.gain,
        "relative": rest.leftover.rms / found.findings[rest.block].task.rules[rest.signal].rms,
    }


def leftovers(found: Diagnosis, when: str) -> dict[str, list[float]]:
    """Group and signal -> probability, gain, size by the noise, held-out gain of what free functions explain."""
    return {
        f"{name}.{signal}": [
            left.p_value,
            left.gain,
            left.rms / finding.task.rules[signal].rms,
            left.held_out,
        ]
        for name, finding in found.findings.items()
        for signal, left in getattr(finding, when).items()
    }


def truth(case: Case, found: Diagnosis, run: RigRun) -> dict[str, dict[str, float]]:
    """Group -> log-likelihood that the true effects gain over the nominal model and over what was chosen."""
    result: dict[str, dict[str, float]] = {}
    if case.tracker:
        return result
    for name in {UNKNOWN[n] for n in case.hidden if n in UNKNOWN} & found.findings.keys():
        finding = found.findings[name]
        best = noise_alone(finding, run)
        result[name] = {
            "gain": best - finding.null.fit.log_likelihood,
            "ahead": best - finding.chosen.fit.log_likelihood,
        }
    if result:
        return result
    for name in {GROUP_OF[n] for n in case.hidden}:
        finding = found.findings.get(name)
        names = [n for n in case.hidden if GROUP_OF[n] == name and n not in SAMPLED]
        if finding is None or not names:
            continue
        best = true_fit(case, finding, names)
        null = finding.null.fit.log_likelihood
        # what the least of several causes adds to the others: below a limit the log cannot show that there are several
        least = min(
            (best - true_fit(case, finding, [o for o in names if o != n]) for n in names), default=0.0
        )
        result[name] = {
            "gain": best - null,
            "ahead": best - finding.chosen.fit.log_likelihood,
            "least": least if len(names) > 1 else best - null,
        }
    return result


def noise_known(case: Case, found: Diagnosis, run: RigRun) -> dict[str, float]:
    """Group -> log-likelihood that the true effects gain where the noise is learned from itself and not from a residual.

    What no diagnosis of this log could exceed by much: it tells an effect that the noise hides from one that is taken for
    noise.
    """
    result: dict[str, float] = {}
    for name in {GROUP_OF[n] for n in case.hidden if n in GROUP_OF} & found.findings.keys():
        task = found.findings[name].task
        names = [n for n in case.hidden if GROUP_OF.get(n) == name and n not in SAMPLED]
        if not names or case.tracker:
            continue
        true, rules = seen(run, task.measured), task.rules
        noise = {s: measured - true[s][: measured.size] for s, measured in task.measured.items()}
        try:
            task.set_rules({s: learned(rule, noise[s], []) for s, rule in rules.items()})
            null = tried(task, (), TRUST).fit.log_likelihood
            result[name] = true_fit(case, found.findings[name], names) - null
        finally:
            task.set_rules(rules)
    return result


def crossed(run: RigRun) -> bool:
    """True if the motion spends at least a hundredth of the time on either side of the tracker's seam."""
    below = float(np.mean(run.true["seen"] < SEAM_ANGLE))
    return 0.01 < below < 0.99


def seen(run: RigRun, signals: Iterable[str]) -> dict[str, Array]:
    """What error-free sensors would have read, (n,) each, SI."""
    true = dict(run.true) | {"slew": run.true["seen"]}
    return {s: true[s] for s in signals}


def noise_held_out(found: Diagnosis, run: RigRun) -> dict[str, float]:
    """Signal -> size of the sensors' noise on the windows on which the gain was measured, SI."""
    if not found.gains:
        return {}
    true = {s: v[: found.record.time.size] for s, v in seen(run, found.gains).items()}
    return {s: gain.after for s, gain in measure(found.record, true, true, found.window).items()}


def noise_alone(finding: Finding, run: RigRun) -> float:
    """Log-likelihood of a group whose residual is nothing but the sensors' noise: what the best of all models reaches."""
    task = finding.task
    true = seen(run, task.measured)
    noise = {s: measured - true[s][: measured.size] for s, measured in task.measured.items()}
    white = task.white(noise)
    return -0.5 * float(white @ white)


def true_fit(case: Case, finding: Finding, names: list[str]) -> float:
    """Log-likelihood of the true effects, fitted from their true sizes."""
    effects = tuple(registry.effects()[n] for n in names)
    true = {f"{e.component}.{p}": v for e in effects for p, v in case.hidden[e.name].items()}
    wanted, _ = unknowns(finding.task.model, effects, TRUST)
    placed = [
        u.__class__(
            u.name, float(np.clip(true.get(u.name, u.start), u.low, u.high)), u.scale, u.low, u.high, u.prior
        )
        for u in wanted
    ]
    return fit(finding.task, placed).log_likelihood
