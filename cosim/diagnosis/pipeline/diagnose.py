"""The diagnosis from log to answer, on one page: prepare, localise and name block by block, extend, measure the gain."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cosim.compare.metrics import rms
from cosim.diagnosis.at_rest import nothing_moves, off_at_rest
from cosim.diagnosis.budget import Budget, current
from cosim.diagnosis.budget import within as within_budget
from cosim.diagnosis.extension.estimate import estimate, gain_by_fmus, worse, write_packages
from cosim.diagnosis.extension.linear import can_replace, replaced
from cosim.diagnosis.fitting.bounds import cannot_be, greatest_torque
from cosim.diagnosis.fitting.chain import Known, task_for
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.limits import idle
from cosim.diagnosis.fitting.propagated import propagated
from cosim.diagnosis.fitting.trials import Trial, candidates_of, freed, tried, without
from cosim.diagnosis.found import Diagnosis, Interrupted
from cosim.diagnosis.held_out.causes import (
    Held,
    Refused,
    Steps,
    each_in_turn,
    held_logs,
    key_of,
    left_out_errors,
    next_best,
    predicts_better,
    reconsider,
    refuse,
    simpler,
)
from cosim.diagnosis.held_out.free_run import onward, refitted
from cosim.diagnosis.hypotheses.exercised import never_exercised
from cosim.diagnosis.hypotheses.naming import (
    accepted,
    find,
    rivals,
    sizes_of,
    sure_from,
    to_the_end,
    wald,
)
from cosim.diagnosis.labels import Contradiction, against_tracker, clock, contradictions, rescaled, whole
from cosim.diagnosis.model.groups import Group, left_out, merged
from cosim.diagnosis.model.machine import Machine, our_machine
from cosim.diagnosis.pipeline.origin import traced
from cosim.diagnosis.pipeline.parts import failure
from cosim.diagnosis.pipeline.parts import part as part_of
from cosim.diagnosis.pipeline.reading import clear_of_lag, known_of, take_over
from cosim.diagnosis.pipeline.stretch import by_twin, chosen_stretch, elsewhere, others
from cosim.diagnosis.record.ends import lost_at_ends
from cosim.diagnosis.record.grid import Grid, grid_of
from cosim.diagnosis.record.record import Record, joined
from cosim.diagnosis.record.refreshed import at_refreshes
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.residuals.reference import (
    Fitted,
    Reference,
    across,
    beside,
    in_turn,
    of_curve,
    of_group,
    of_same_order,
    of_whole,
    over_logs,
)
from cosim.diagnosis.thresholds import (
    AS_WELL,
    CALIBRATED_TRUST,
    FAST_SAMPLING,
    FEWEST_SAMPLES,
    GUESSED_TRUST,
    LEFT_TO_POLES,
    LOST_AT_ENDS,
    NAMING_BUDGET,
    NOMINAL_TRUST,
    ROUGH_TRUST,
    SEARCH_BUDGET,
    SPARSE_OF_INTEGRAL,
    SPARSE_SAMPLING,
)
from cosim.diagnosis.tracker.comparison import compare_tracker
from cosim.diagnosis.verdict.discrepancy import understood
from cosim.diagnosis.verdict.verdict import (
    Cause,
    Rest,
    adequate,
    cause_of,
    causes,
    local,
    names_of,
    negligible,
    rank,
    rests,
)
from cosim.diagnosis.watch import Watch, watched_by
from cosim.errors import DataError, UsageError
from cosim.interrupts import often_uninterrupted
from cosim.logs import Log, Tracker, listed
from cosim.memory import returned
from fmus.contract import Effect

Array = NDArray[np.float64]


def prepare(log: Log, machine: Machine) -> Record:
    """The log in the model's units, sampled as it was measured, with the load pressure.

    Raises:
        DataError: there is no command, or the log is too short to hold anything out.
    """
    log.require(machine.drive, "anything")
    second = 1.0 if log.time_unit == "s" else machine.options.sample
    if second is None:
        raise DataError(
            f"{log.source}: the log counts samples and has no time: say in the mapping what one sample counts as, such as "
            '[diagnose] sample = "10 ms"'
        )
    if len(log) < FEWEST_SAMPLES:
        raise DataError(
            f"{log.source}: the log has {len(log)} samples; a diagnosis needs at least {FEWEST_SAMPLES}, and windows of its "
            "own to hold out: record longer, or faster"
        )
    if (
        not log.uniform and log.step <= FAST_SAMPLING
    ):  # jitter of a fast log: straight lines between its samples lose nothing
        log = log.resample(log.step)
    grid, interval = grid_of(log.time * second, machine.options.step, machine.drive not in log.held)
    gains = {n: item.gain for n, item in machine.signals.items()}
    signals = {
        n: v if gains.get(n, 1.0) == 1.0 else gains[n] * v
        for n, v in log.signals.items()
        if n not in machine.aside
    }
    filled = {n: ~valid for n, valid in log.valid.items() if n in signals}
    if "p_load" in log and "p_load" not in machine.aside:
        signals["p_load"] = log.p_load
        valid = log.valid_mask("p_load")
        filled |= {} if valid.all() else {"p_load": ~valid}
    sparse = interval > SPARSE_SAMPLING and machine.mapping is None
    return Record(interval, signals, grid, machine.options.rest, sparse, filled)


def judge(
    found: Diagnosis, trust: float, constants: Mapping[str, float] | None = None, watch: Watch | None = None
) -> None:
    """Judge all groups whose drive and first observed signal were measured; note what is missing for the others.

    Args:
        found: record and groups; findings and conclusions are added group by group.
        trust: relative standard deviation of the nominal parameters.
        constants: ``component.parameter`` -> SI that is known already, such as a sensor's scale.
        watch: told about each group.
    """
    known: list[Known] = []
    errors: list[Exception] = []
    for k, group in enumerate(found.groups):
        shares = [
            SEARCH_BUDGET * (k + part) / len(found.groups)
            for part in (NAMING_BUDGET if found.held else 1.0, 1.0)
        ]
        current().allow(shares[0])
        missing = [s for s in (group.drive, *group.observed[:1]) if s not in found.record.signals]
        if missing:
            found.unjudged[group.name] = missing
            known = []
            continue
        if too_sparse(found, group):
            found.sparse[group.name] = why_sparse(found.record, group.drive)
            known = []
            continue
        try:
            known = judged(found, group, known, trust, constants, watch, shares[1])
        except Exception as error:  # the other groups stand
            errors.append(error)
            found.failed[group.name] = failure(f"judging {group.name}", error)
            known = []
    if errors and not found.findings:
        raise errors[0]


def too_sparse(found: Diagnosis, group: Group) -> bool:
    """True if what drives a group between two samples is not known, and decides what is read at them.

    A command may step anywhere in between; a measured signal that is integrated moves no faster than the block before it.
    """
    if not found.record.sparse or found.at_rest:
        return False
    return not group.moves or group.drive == found.machine.drive or found.record.h > SPARSE_OF_INTEGRAL


def why_sparse(record: Record, drive: str) -> str:
    """Why so sparse a log says nothing of a group, and what to do."""
    return (
        f"sampled every {1e3 * record.h:.4g} ms: what {drive} did between the samples is not known; record every "
        f"{1e3 * SPARSE_SAMPLING:.4g} ms or faster, or say in a mapping how the command changes ([signals.u] held = true "
        "where it does at the stamps only)"
    )


def judged(
    found: Diagnosis,
    group: Group,
    known: list[Known],
    trust: float,
    constants: Mapping[str, float] | None,
    watch: Watch | None,
    share: float = 1.0,
) -> list[Known]:
    """Judge one group; what is known afterwards of the blocks before the next one.

    Args:
        found: findings and conclusions are added.
        group: the group.
        known: the blocks before it that are understood, in order.
        trust: relative standard deviation of the nominal parameters.
        constants: ``component.parameter`` -> SI that is known already.
        watch: told about it.
        share: of the budget, until which what was named may be tried on held-out data.
    """
    with current().searching():
        enter(found, watch, group.name, f"{group.name}: {len(group.effects())} candidates")
        return named_in(found, group, known, trust, constants, watch, share)


def named_in(
    found: Diagnosis,
    group: Group,
    known: list[Known],
    trust: float,
    constants: Mapping[str, float] | None,
    watch: Watch | None,
    share: float,
) -> list[Known]:
    """As `judged`."""
    record, held, most = found.record, found.held, found.machine.options.causes
    # mechanics integrate: what upstream is known to deliver drives them; elsewhere the measured signal does
    # what is delivered upstream on a command that is not known between its samples is no better than what was measured
    driving = known if group.moves and not record.sparse else []
    done: Steps = {}
    task = begun(found, group, constants, driving)
    others = held or each_in_turn(record, next(iter(task.rules.values())), trust)
    better = None if others is None else predicts_better(others, trust, done)
    finding = find(task, record, trust, most, better)
    current().allow(share)
    if others is not None:
        found.sets[group.name] = others, done
        finding = borne_out(found, group, finding, others, trust, watch, done)
    with part_of(found.notes, f"the linear reference of {group.name}"):
        finding = beside_linear(finding, record, held, found.linear)
    if driving:

        def again(known: list[Known]) -> Finding:
            return find(begun(found, group, constants, known), record, trust, most)

        with part_of(found.notes, f"looking for the origin of what {group.name} shows in the blocks before"):
            known, finding = traced(found, finding, known, again, trust)
    conclude(found, group.name, finding, trust)
    if group.name == found.groups[-1].name or not adequate(finding):
        return []
    upstream = known if not known or known[-1].model.group.observed[0] == group.drive else []
    return [*upstream, understood(finding, record, trust)]


def borne_out(
    found: Diagnosis,
    group: Group,
    finding: Finding,
    held: Held,
    trust: float,
    watch: Watch | None,
    done: Steps,
) -> Finding:
    """What held-out data bear out of a finding, and what could as well stand there.

    `done` are the sets that they have judged already.
    """
    if current().over:
        if finding.chosen.effects:
            current().leave_out(group.name, "its causes on the held-out data")
        return finding
    count = len(finding.chosen.effects)
    enter(found, watch, group.name, f"{group.name}: {count} causes tried on the held-out data")
    finding, turned_down, kept = refuse(finding, held, trust, done)
    found.refused += turned_down
    finding = keep(finding, kept, found.record, trust, done)
    with part_of(found.notes, "holding rivals of the causes against the held-out data"):
        finding, taken, worse = reconsider(finding, held, turned_down, trust, done)
        found.refused += worse
        if taken != finding.chosen.effects:
            finding = keep(finding, taken, found.record, trust, done)
    return finding


def keep(finding: Finding, kept: tuple[Effect, ...], record: Record, trust: float, done: Steps) -> Finding:
    """The finding with those of its effects that held-out data bear out, fitted also from where these judged them.

    Of all that was found the rivals are known; those that explain nearly as much are fitted until they settle.
    """
    task = finding.task
    if freed(kept) == freed(finding.chosen.effects):
        known = {
            name: [to_the_end(task, t, finding, trust) for t in found]
            for name, found in finding.rivals.items()
        }
        return replace(finding, rivals=known)
    begin = refound(finding, kept, trust, done) if kept else finding.null
    finding = replace(finding.accept(begin, record), confirmed=kept != ())
    return replace(finding, rivals=rivals(task, finding, candidates_of(task), trust))


def refound(finding: Finding, kept: tuple[Effect, ...], trust: float, done: Steps) -> Trial:
    """A set of effects fitted in windows, from the finding's fit and from the one with which held-out data judged it.

    A set explains no less than a part of it does: where it seems to, the search went astray and begins there.
    """
    task, judged = finding.task, done.get(key_of(kept))
    begins = [finding.chosen.fit, *([] if judged is None else [judged.fit])]
    best = max((tried(task, kept, trust, fit) for fit in begins), key=lambda t: t.score)
    for effect in kept:
        part = without(task, best, effect, finding.null, trust)
        if part.fit.log_likelihood > best.fit.log_likelihood and not current().over:
            best = max(best, tried(task, kept, trust, part.fit), key=lambda t: t.score)
    return best


def beside_linear(finding: Finding, record: Record, held: Held | None, fitted: Fitted) -> Finding:
    """A finding with a linear model of free order beside it; where that is clearly better, nothing is named on top of it.

    `fitted` are the linear models of the record that are known; it grows.
    """
    task, linear = finding.task, finding.reference
    if held is None:
        linear = of_group(task, finding.chosen.fit, record.time)
    elif finding.held_squares is not None:
        linear = over_logs(task, record, held.record, held.first, finding.held_squares, fitted)
    finding, signal = replace(finding, reference=linear), next(iter(task.measured))
    if linear is None or adequate(finding) or not linear.clearly_better:
        return finding
    group = task.model.group
    if not linear.model.order and (group.is_speed(signal) or not group.integrates):
        return finding  # a constant gain has no dynamics that such a group could lack
    if linear.ours_error**2 - linear.error**2 <= negligible(finding, signal) ** 2:
        return finding
    if swings_by_itself(finding, signal, linear):
        return finding
    if held is None and finding.chosen.effects and numbers_only(finding, record, linear):
        return finding
    without = replace(finding.accept(finding.null, record), rivals={})
    if group.is_speed(signal) or not group.integrates:
        curve = of_curve(task, record, *((None, 0) if held is None else (held.record, held.first)))
        if curve < AS_WELL * linear.error:  # what a curve tells is no dynamics
            return replace(without, lacks_curve=curve)
    return replace(without, lacks_linear=True)


def numbers_only(finding: Finding, record: Record, linear: Reference) -> bool:
    """True if the causes do in this log what a gain, a lag and a constant would: such stand in for no dynamics.

    A log of one direction shows dry friction as a constant, which any linear reference has as well: that more of its poles
    describe what is left of a few transients says nothing against it. What stands in for a pole leaves more to it.
    """
    plain = of_same_order(finding.task, finding.chosen.fit, record.time)
    if not plain.error <= AS_WELL * plain.ours_error <= AS_WELL**2 * plain.error:
        return False
    before = beside(finding.task, finding.null.fit, record.time, lambda _: linear.model).ours_error
    return linear.ours_error**2 - linear.error**2 <= LEFT_TO_POLES * (before**2 - linear.error**2)


def swings_by_itself(finding: Finding, signal: str, linear: Reference) -> bool:
    """True if the linear model is better by a mode at which the signal swings whatever is commanded: that is no dynamics.

    Its initial state swings on for as long as such a mode lives. A log tells two frequencies apart by one over its length.
    """
    swing = finding.events.get(signal, {}).get("oscillation")
    if swing is None or not local(finding, signal, swing):
        return False
    modes = (w / (2.0 * np.pi) for w, _ in linear.model.sections.second)
    return any(abs(mode - swing.start) * linear.model.length < 1.0 for mode in modes)


def begun(found: Diagnosis, group: Group, constants: Mapping[str, float] | None, known: list[Known]) -> Task:
    """Data, model and noise of a group that `known` blocks drive, before anything is fitted."""
    task = task_for(group, found.record, known)
    settle(task.model, constants or {})
    heard = [f.task.rules[group.drive] for f in found.findings.values() if group.drive in f.task.rules]
    if group.moves and not known and heard:
        left = propagated(task, heard[0])
        task.set_rules({s: replace(rule, propagated=left[s]) for s, rule in task.rules.items()})
    return task


def conclude(found: Diagnosis, name: str, finding: Finding, trust: float) -> None:
    """Causes, rests and what was never exercised in a group, all at once: an interruption leaves all of it or none."""
    named, left, never = causes(finding, trust), rests(finding, trust), never_exercised(finding, trust)
    found.findings[name] = finding
    found.causes += named
    found.rests += left
    found.never += never


def enter(found: Diagnosis, watch: Watch | None, name: str, text: str) -> None:
    """A stage begins, unless somebody has ended the diagnosis in the one before.

    Raises:
        KeyboardInterrupt: so it is.
    """
    if found.budget.ended:
        raise KeyboardInterrupt
    found.stage = text
    if watch is not None:
        watch.stage(name, text)


def settle(model: GroupModel, constants: Mapping[str, float]) -> None:
    """Take over what is known already."""
    model.fixed = model.fixed | {
        n: v for n, v in constants.items() if n.partition(".")[0] in model.group.components
    }


def concluded(found: Diagnosis) -> None:
    """Order of the causes, and the verdict."""
    found.causes.sort(key=rank)
    # the last word on each: an earlier search may have refused what a later one bears out, or cannot tell from that
    named = {(c.group, n) for c in found.causes for n in (c.effect.name, *c.indistinguishable)}
    last = {(r.group, r.effect.name): r for r in found.refused}
    found.refused = [r for key, r in last.items() if key not in named]
    found.verdict = verdict_of(found.causes, found.rests)
    if found.failed and found.verdict in ("adequate", "explained"):  # nobody knows what the rest is like
        found.verdict = "partly_explained" if found.causes else "interrupted"


def untenable_taken_back(found: Diagnosis, trust: float) -> bool:
    """Take causes back whose size cannot be, or may be none, and what was named beside; True if any was.

    What held-out data bear out by itself stays, fitted anew without them. Of causes that make up for each other each may be
    none while another is there: they go one by one.
    """
    taken = False
    for name, finding in list(found.findings.items()):
        model = finding.task.model
        torque = greatest_torque(model, finding.chosen.fit.values)

        def impossible(cause: Cause, model: GroupModel = model, torque: float = torque) -> bool:
            of = cause.effect.component
            sizes = {p: found.values.get(f"{of}.{p}", v) for p, (v, _) in cause.parameters.items()}
            return cannot_be(cause.effect, sizes, model, torque)

        own = [c for c in found.causes if c.group == name and c.effect.name not in SAMPLED]
        apart = [c.effect for c in own if none_between_logs(found, c, model)]
        gone = [c.effect for c in own if impossible(c) or c.effect in apart]
        unsure = [] if gone else least_sure(found, [c.effect for c in own], model)
        if not gone and not unsure:
            continue
        taken, others = True, [e for e in finding.chosen.effects if e not in gone and e not in unsure]
        kept = tuple(e for e in others if unsure or borne_by_itself(finding, e))
        rest = tried(finding.task, kept, trust, finding.chosen.fit) if kept else finding.null
        found.refused += [refused_unsure(finding, c, rest) for c in own if c.effect in (*unsure, *apart)]
        stands = None
        if unsure and not finding.borne:
            rest = with_less(finding, unsure, rest, trust)
        elif unsure or apart:
            stands = with_next_best(found, finding, {e.name for e in gone}, trust)
        finding, rest = stands or (replace(finding, rivals={}), rest)
        finding = replace(
            finding.accept(rest, found.record), confirmed=finding.confirmed and rest.effects != ()
        )
        found.findings[name] = finding
        found.causes = [c for c in found.causes if c not in own or c.effect in rest.effects]
        named = {c.effect for c in found.causes if c.group == name}
        found.causes += [cause_of(finding, e, trust) for e in rest.effects if e not in named]
        found.rests = [r for r in found.rests if r.block != name] + rests(finding, trust)
    concluded(found)
    return taken


def with_next_best(
    found: Diagnosis, finding: Finding, gone: Collection[str], trust: float
) -> tuple[Finding, Trial] | None:
    """A finding without causes that are taken back, and the next best set that held-out data bear out; None without one.

    Args:
        found: the diagnosis; what was refused because nobody knows its size does not come again.
        finding: what was found in the group.
        gone: names of the causes that cannot be.
        trust: relative standard deviation of the nominal parameters.
    """
    name = finding.task.model.group.name
    if name not in found.sets:
        return None
    held, done = found.sets[name]
    unsure = {r.effect.name for r in found.refused if r.group == name and r.in_fitted and not r.sure}
    gains, alike = next_best(finding, held, {*gone, *unsure}, trust, done)
    if not gains:
        return None
    marked = (e for e in finding.chosen.effects if e.name in SAMPLED)
    kept = (*gains, *marked)
    rest = refound(finding, kept, trust, done)

    def instead(effect: Effect) -> list[Trial]:
        company = tuple(e for e in kept if e != effect)
        return [tried(finding.task, (*company, other), trust, rest.fit) for other in alike[effect]]

    told = replace(
        finding,
        rivals={e.name: instead(e) for e in alike},
        undecided={e.name: [o.name for o in others] for e, others in alike.items()},
        borne={e.name: gain for e, gain in gains.items()},
    )
    return told, rest


def none_between_logs(found: Diagnosis, cause: Cause, model: GroupModel) -> bool:
    """True if several logs, taken as repetitions, do not tell any size of a cause from none."""
    names = {n: model.nominal(n) for n in names_of(cause.effect).values() if n in found.between}
    ends = {n: found.between[n].ci95 for n in names}
    return bool(names) and all(ends[n][0] <= off <= ends[n][1] for n, off in names.items())


def least_sure(found: Diagnosis, effects: Sequence[Effect], model: GroupModel) -> list[Effect]:
    """The effect of whose size the last estimate says least, if that may be none: a name without a size helps nobody."""
    shares = {e: share_of_sure(found, e, model) for e in effects}
    return sorted((e for e, share in shares.items() if share < 1.0), key=lambda e: shares[e])[:1]


def with_less(finding: Finding, gone: Sequence[Effect], rest: Trial, trust: float) -> Trial:
    """What is left without an effect, with a simpler one that it holds in its place where that explains the log better.

    Coulomb's level may be sure where a peak beside it is not, nor the two apart.
    """
    instead = [e for effect in gone for e in simpler(finding, effect) if e not in rest.effects]
    sets = [tried(finding.task, (*rest.effects, e), trust, finding.chosen.fit) for e in instead]
    better = [t for t in sets if accepted(t, rest, finding.task.model, trust)]
    return max(better, key=lambda t: t.score, default=rest)


def refused_unsure(finding: Finding, cause: Cause, without: Trial) -> Refused:
    """A cause of whose size the estimate of the whole says nothing, and what the fitted log loses with it."""
    signal = next(iter(finding.task.measured))
    fewer, more = (rms(trial.fit.residuals[signal]) for trial in (without, finding.chosen))
    return Refused(cause.effect, cause.group, signal, cause.gain, fewer, more, sure=False, in_fitted=True)


def share_of_sure(found: Diagnosis, effect: Effect, model: GroupModel) -> float:
    """Wald's statistic of an effect's sizes against none, over what it must reach; infinite where none was estimated.

    Of a size beyond which nothing changes, such as the friction of a drive that it holds, the deviation is the search's: the
    gain over none has told it from that.
    """
    sizes = sizes_of(effect, model, found.values) if known_in(found, effect) else {}
    fit_ = found.findings[model.group.name].chosen.fit
    # a limit that windows do not meet the whole log may meet
    met = {n for p, n in names_of(effect).items() if effect.free[p].limits and sizes.get(n)}
    names = [n for n in sizes if found.deviations.get(n, 0.0) > 0.0 and (n in met or not idle(fit_, n))]
    if not names:
        return np.inf
    pairs = found.correlations
    together = [[pairs.get((a, b), pairs.get((b, a), float(a == b))) for b in names] for a in names]
    # by the interval that is told, the wider of the windows' and the whole's: else that of a named cause may hold none
    windows = {n: fit_.deviations.get(n, 0.0) for n in names if n not in met and n not in found.between}
    away = np.array([sizes[n] / max(found.deviations[n], windows.get(n, 0.0)) for n in names])
    return wald(away, np.array(together)) / sure_from(len(names))


def known_in(found: Diagnosis, effect: Effect) -> bool:
    """True if the last estimate has all sizes of an effect."""
    return set(names_of(effect).values()) <= found.values.keys()


def borne_by_itself(finding: Finding, effect: Effect) -> bool:
    """True if data held out are sure to be predicted better with an effect."""
    return effect.name in finding.borne and finding.borne[effect.name].borne_out


def taken_back(found: Diagnosis, folder: Path, trust: float) -> None:
    """Leave the model as it was where its extension predicts data held out worse: such causes are refused."""
    for name, finding in list(found.findings.items()):
        signal = next(iter(finding.task.measured))
        gain = found.gains.get(signal)
        own = [c for c in found.causes if c.group == name and c.effect.name not in SAMPLED]
        if not own or gain is None:
            continue
        found.refused += [Refused(c.effect, name, signal, c.gain, gain.before, gain.after) for c in own]
        found.findings[name] = finding = finding.accept(finding.null, found.record)
        found.causes = [c for c in found.causes if c not in own]
        found.rests = [r for r in found.rests if r.block != name] + rests(finding, trust)
    concluded(found)
    found.values = dict(found.calibrated)
    gain_by_fmus(found, folder)


def left_out_of(found: Diagnosis, trust: float) -> dict[str, Array]:
    """Signal of a group that the command drives -> (n,) error of several logs, each with what the others give, SI."""
    errors = {}
    for finding in found.findings.values():
        group, signal = finding.task.model.group, next(iter(finding.task.measured))
        if group.drive != found.machine.drive:
            continue
        effects = tuple(
            c.effect for c in found.causes if c.group == group.name and c.effect.name not in SAMPLED
        )
        again = onward if group.drifts else refitted
        fit = again(finding, effects, trust, finding.chosen.fit)
        each = left_out_errors(finding, effects, fit, signal, trust, group.drifts)
        errors[signal] = np.concatenate(each)
    return errors


def beside_the_whole(found: Diagnosis, constants: Mapping[str, float], trust: float) -> dict[str, Reference]:
    """The linear reference from the command to each signal, beside the extended model."""
    held, drive = found.held, found.machine.drive
    values = dict(constants) | found.values
    after = found.after or by_twin(found, found.record, values)
    signals = [s for s in after if s in found.record.signals and s in found.noise]
    if held is None:
        if not found.record.cuts:
            return of_whole(found.record, drive, signals, after, found.window, found.linear)
        ours = {s: found.record.signals[s] - after[s] for s in signals} | left_out_of(found, trust)
        return in_turn(found.record, drive, signals, ours, found.window)
    judged = found.held_after or by_twin(found, held.record, values)
    anew = [s for s, gain in found.gains.items() if np.isfinite(gain.horizon)]
    return across(
        found.record, held.record, held.first, drive, signals, judged, found.window, anew, found.linear
    )


def outdone_by_linear(
    references: Mapping[str, Reference], noise: Mapping[str, float], steps: Mapping[str, float]
) -> bool:
    """True if a linear model of free order leaves less of a signal on held-out data, by more than the sensor's noise.

    However unclear that is: what a linear model predicts better is not explained. Of readings in steps a prediction that
    is rounded as they are errs by a whole step where it is off by less, as the place is in which it begins.

    Args:
        references: signal -> linear reference beside the extended model.
        noise: signal -> size of its noise per sample, SI.
        steps: signal -> step of its readings where that is coarser than their noise, SI.
    """
    unsure = {s: max(own, steps.get(s, 0.0)) for s, own in noise.items()}
    judged = {s: r.evidence for s, r in references.items() if s in unsure}
    return any(r.ours_error**2 - r.error**2 > unsure[s] ** 2 for s, r in judged.items())


def verdict_of(named: list[Cause], left: list[Rest]) -> str:
    """One word for the whole."""
    if not named:
        return "unexplained" if left else "adequate"
    return "partly_explained" if left else "explained"


@often_uninterrupted()
def diagnose(
    log: Log | Sequence[Log],
    *,
    tracker: Tracker | None = None,
    model: str | Machine = "full_order",
    base: Mapping[str, float] | None = None,
    held_out: Log | Sequence[Log] | None = None,
    tolerance: float = NOMINAL_TRUST,
    calibrate: bool = False,
    folder: Path | None = None,
    watch: Watch | None = None,
    budget: Budget | None = None,
) -> Diagnosis:
    """Compare a log with a model, name what the model gets wrong, extend it and measure the gain.

    Of a long log the fits use the five minutes whose command visits most (`stretch`); the rest is then simulated.

    Args:
        log: the log, or several of one machine: each with a start and a noise of its own, and the unit of repetition.
        tracker: the external tracker's record of one log, on its own clock.
        model: the model, or the name of one of ours.
        base: ``component.parameter`` -> SI in which the model at hand differs from the nominal one.
        held_out: another log of the machine, or several: gains are measured on it, and a cause that does
            not help there is refused.
        tolerance: standard deviation of the trust in each nominal parameter, relative.
        calibrate: fit the nominal parameters freely, so that only missing structure is a cause; so it is done without
            where the mapping says that parameters are `free`.
        folder: where the extended packages are made (`drafts`), which does not say yet what they rest on; without one
            they are not made and the FMUs are not run.
        watch: told about each stage.
        budget: the time it may take; searches then end with the best so far. Unlimited by default.

    Raises:
        UsageError: an unknown model, or what only one log can have together with several.
        DataError: the log lacks the command or is too short, or the tracker does not fit to it.
        Interrupted: Ctrl-C, once the log is prepared.
    """
    machine = our_machine(model, base) if isinstance(model, str) else model
    free = CALIBRATED_TRUST if isinstance(model, str) or not machine.options.named else GUESSED_TRUST
    trust = free if calibrate or machine.options.free else tolerance
    logs, repeats = read_only(listed(log), machine)
    if len(logs) > 1 and (tracker is not None or machine.options.held_out_from is not None):
        what = (
            "an external tracker goes" if tracker is not None else "diagnose.held_out_from in a mapping goes"
        )
        raise UsageError(f"{what} with one log; give one log, or hold out whole logs (--held-out)")
    with threadpool_limits(1):  # small matrices: more threads only wait for one another
        each = [labelled(one, machine, trust, tracker is not None) for one in logs]
    parts, data = [part for part, _, _ in each], [told for _, _, found in each for told in found]
    record, held = parted(joined([record for _, record, _ in each]), machine)
    if held_out is not None:
        apart, more = read_only(listed(held_out), machine)
        held, repeats = held_logs([prepare(one, machine) for one in apart], apart), repeats + more
    machine = with_held_drive(machine, logs, record)
    groups = merged(machine.groups, record.signals)
    if trust > ROUGH_TRUST:  # what is known of a machine tells of its ends in windows, too
        groups = tuple(at_its_ends(group, record) for group in groups)
    found = Diagnosis("interrupted", record, machine, groups)
    found.spans = tuple((float(part.time[0]), float(part.time[-1])) for part in parts)
    found.held, found.notes = held, repeats
    found.data = list(dict.fromkeys(data))
    if found.data:
        contradicted(found, found.data)
        return found
    watch, found.budget = watch or Watch(), budget or Budget()
    try:
        with threadpool_limits(1), watched_by(watch), within_budget(found.budget), returned():
            stages(found, logs, parts, tracker, trust, folder, watch)
    except KeyboardInterrupt:
        raise Interrupted(found) from None
    return found


def read_only(logs: Sequence[Log], machine: Machine) -> tuple[list[Log], list[str]]:
    """The logs without what they repeat between two readings, and what is said of that."""
    each = [at_refreshes(one, machine.drive) for one in logs]
    return [log for log, _ in each], [text for _, told in each for text in told]


def with_held_drive(machine: Machine, logs: Sequence[Log], record: Record) -> Machine:
    """The model, its drive held from sample to sample where the logs say so of one that its block takes as it goes.

    Only in steps finer than the samples: in steps of a sample it would be half a step late, and is half a step early.
    """
    finer = all(isinstance(piece.grid, Grid) for piece in record.pieces)
    if not finer or not all(machine.drive in log.held for log in logs):
        return machine
    groups = (replace(g, held=True) if g.drive == machine.drive else g for g in machine.groups)
    return replace(machine, groups=tuple(groups))


def at_its_ends(group: Group, record: Record) -> Group:
    """The group, its place counting where ends of the travel took part of the way: windows with an offset forget them."""
    if not group.drifts or group.drifting:
        return group
    place = next(s for s in group.observed if not group.is_speed(s))
    if not {group.drive, place} <= record.signals.keys():
        return group
    lost = lost_at_ends(record.signals[group.drive], record.signals[place], record.cuts)
    return replace(group, absolute=True) if lost > LOST_AT_ENDS else group


def contradicted(found: Diagnosis, data: list[Contradiction]) -> None:
    """End with labels that the data contradict: no physical cause stands beside them."""
    found.data, found.causes, found.rests, found.never = data, [], [], []
    found.verdict, found.tracker, found.stage = "implausible_data", None, ""
    found.before = by_twin(found, found.record, found.machine.base)


def labelled(
    log: Log, machine: Machine, trust: float, from_start: bool = False
) -> tuple[Log, Record, list[Contradiction]]:
    """The part of a log that is fitted, the same made ready, and what the data say against their labels.

    The clock comes first, of the whole log: in another unit the part would be another one.

    Args:
        log: the log as read.
        machine: the model.
        trust: relative standard deviation of the nominal parameters.
        from_start: as `used_part`.

    Raises:
        DataError: as `prepare`.
    """
    known = trust < CALIBRATED_TRUST

    def made(one: Log) -> Record:
        return prepare(used_part(one, machine, from_start), machine)

    told = clock(log, made, machine, known)
    part = used_part(rescaled(log, 1.0 / (told[0].factor or 1.0)) if told else log, machine, from_start)
    record = prepare(part, machine)
    return part, record, [*told, *contradictions(part, record, whole(machine, known), known)]


def used_part(log: Log, machine: Machine, from_start: bool) -> Log:
    """The part of a log that is fitted."""
    if log.time_unit != "s" or machine.options.held_out_from is not None:
        return log
    return chosen_stretch(log, machine.drive, from_start=from_start)


def stages(
    found: Diagnosis,
    logs: Sequence[Log],
    parts: Sequence[Log],
    tracker: Tracker | None,
    trust: float,
    folder: Path | None,
    watch: Watch,
) -> None:
    """The diagnosis stage by stage; each leaves what it found in `found`."""
    watch.plan(planned(found, tracker is not None, folder is not None))
    if tracker is not None:
        enter(found, watch, "tracker", "slew sensor against tracker")
        seen = compare_tracker(found.record, tracker)
        if told := against_tracker(found.record, tracker, seen):
            contradicted(found, told)
            return
        take_over(found, seen)
    constants = known_of(found)
    found.at_rest = nothing_moves(found.record, found.machine)
    unmoved = [e.name for g in found.groups for e in g.effects()] if found.at_rest else []
    with left_out(*unmoved):  # none of them can be told from another, so none is a candidate
        judge(found, trust, constants, watch)
    if found.at_rest:
        found.rests = [
            r for f in found.findings.values() for r in off_at_rest(f, found.record, found.machine)
        ]
        found.never += [n for n in unmoved if n not in found.never]
    if tracker is not None and not found.at_rest and clear_of_lag(found, tracker):
        constants = known_of(found)
        judge(found, trust, constants, watch)
    if not found.findings and tracker is None:
        missing = sorted({s for names in found.unjudged.values() for s in names})
        if found.sparse:
            raise DataError(f"{logs[0].source}: no block can be judged: {next(iter(found.sparse.values()))}")
        raise DataError(f"{logs[0].source}: no block can be judged; missing signals: {', '.join(missing)}")
    found.never += [] if tracker is not None else ["tracker.clock", "tracker.seam"]
    untenable_taken_back(found, trust)
    current().allow(1.0)
    enter(found, watch, "extended", "extended model")
    with part_of(found.notes, "the fit of all blocks together"):
        estimate(found, found.groups, trust, constants)
        while untenable_taken_back(found, trust):  # what is left stands without them
            estimate(found, found.groups, trust, constants)
    concluded(found)
    rest = [p for log, part in zip(logs, parts, strict=True) if part is not log for p in others(log, part)]
    if rest and found.budget.gone:
        found.notes.append(found.budget.omitted("the look at the rest of the log"))
    elif rest:
        with part_of(found.notes, "the look at the rest of the log"):
            pieces = ((p, prepare(p, found.machine)) for p in rest)
            found.elsewhere = elsewhere(found, pieces, constants | found.values)
    if folder is not None and found.budget.gone:
        with part_of(found.notes, "the extended package"):
            write_packages(found, folder)
        found.notes.append(found.budget.omitted("the gain by the FMUs"))
    elif folder is not None:
        enter(found, watch, "gain", "gain on held-out data, by the FMUs")
        with part_of(found.notes, "the gain by the FMUs"):
            gain_by_fmus(found, folder)
            if worse(found):
                taken_back(found, folder, trust)
    if found.held is None and found.record.cuts and found.budget.gone:  # a fit for each log
        found.notes.append(found.budget.omitted("the linear reference of the whole"))
    else:
        with part_of(found.notes, "the linear reference of the whole"):
            found.references = beside_the_whole(found, constants, trust)
    if folder is not None and found.gains and can_replace(found):
        with part_of(found.notes, "the linear model in the place of the blocks"):
            replaced(found, folder)
    steps = {s: step for f in found.findings.values() for s, step in f.task.steps.items()}
    if found.verdict == "explained" and outdone_by_linear(found.references, found.noise, steps):
        found.verdict = "partly_explained"
    found.stage = ""


def planned(found: Diagnosis, tracker: bool, fmus: bool) -> list[tuple[str, float]]:
    """The stages to come and their shares of the time, one candidate of a group being 1."""
    plan = [("tracker", 3.0)] if tracker else []
    plan += [(g.name, 1.0 + len(g.effects())) for g in found.groups]
    return [*plan, ("extended", 6.0), *([("gain", 10.0)] if fmus else [])]


def parted(record: Record, machine: Machine) -> tuple[Record, Held | None]:
    """The part of a log that is fitted, and the log with the part that the mapping holds out.

    Raises:
        DataError: nothing is left to fit, or nothing is held out.
    """
    start = machine.options.held_out_from
    if start is None:
        return record, None
    first = int(np.searchsorted(record.time, start * (machine.options.sample or 1.0) * (1.0 - 1e-12)))
    if first < FEWEST_SAMPLES or first > record.time.size - 2:
        raise DataError(
            f"diagnose.held_out_from = {start:g} leaves too little of the log to fit or to hold out"
        )
    return record.until(first), Held(record, first)
