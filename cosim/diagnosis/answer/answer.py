"""The diagnosis as JSON, in the units people read."""

import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import version

import numpy as np

from cosim.compare.metrics import fit_percent, rms
from cosim.diagnosis.answer.experiment import Proposal
from cosim.diagnosis.answer.remarks import (
    advice,
    files,
    held_file,
    held_from,
    held_out,
    is_part,
    limits,
    not_judged,
    notes,
    shown,
    turned_down,
)
from cosim.diagnosis.answer.schema import (
    Answer,
    Correlated,
    DataFinding,
    LinearReference,
    Location,
    LogGain,
    NamedCause,
    NextExperiment,
    OfLog,
    Packages,
    Parameter,
    RefusedCause,
    Rival,
    Separable,
    ShownSignal,
    Signal,
    SignalGain,
    Unexplained,
    Words,
)
from cosim.diagnosis.fitting.limits import idle
from cosim.diagnosis.fitting.trials import declared
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.isolability import isolability
from cosim.diagnosis.residuals.finding import at_first
from cosim.diagnosis.residuals.reference import Reference, described
from cosim.diagnosis.thresholds import INDEPENDENT, INDISTINGUISHABLE, SYSTEMATIC_SHARE
from cosim.diagnosis.verdict.verdict import Cause, local, names_of, size_of, stands, unfollowed
from cosim.inference.between import Between
from cosim.inference.held_out import ratio_ci95
from cosim.lexicon import current
from cosim.logs import Log, listed
from cosim.packages import project_version
from cosim.units import of_speed
from fmus import registry
from fmus.contract import Variable


def answer(
    diagnosis: Diagnosis, log: Log | Sequence[Log], proposal: Proposal | None, model_file: str = ""
) -> Answer:
    """The diagnosis of a log, or of several, in the contract's form."""
    logs = listed(log)
    said = [f"{one.name}: {w}" if len(logs) > 1 else w for one in logs for w in one.warnings]
    whole = len(logs) > 1 or not diagnosis.spans or not is_part(diagnosis.spans[0], logs[0])
    measured = {*diagnosis.record.signals} | ({"slew_external"} if diagnosis.tracker else set())
    apart = isolability(diagnosis.machine.groups, measured)
    told = {cause.effect.name for cause in diagnosis.causes}
    return Answer(
        verdict=diagnosis.verdict,  # type: ignore[arg-type]
        synthetic=all(one.synthetic for one in logs),
        model=diagnosis.model,
        signals=signals(diagnosis),
        localisation=localisation(diagnosis),
        causes=[named(diagnosis, cause) for cause in diagnosis.causes],
        extended=packages(diagnosis),
        gain=gains(diagnosis),
        unexplained=unexplained(diagnosis),
        next_experiment=next_experiment(proposal),
        not_exercised=diagnosis.never,
        at_rest=diagnosis.at_rest,
        not_judged=not_judged(diagnosis),
        isolability=[Separable(residual=list(where), effects=list(names)) for where, names in apart.classes],
        helpful_signals=apart.advice,
        nominal=nominal(diagnosis),
        warnings=[*said, *notes(diagnosis, logs), *limits(diagnosis, logs), *diagnosis.budget.warnings],
        advice=advice(diagnosis),
        held_out=held_out(diagnosis),
        held_out_from=held_from(diagnosis),
        refused=[turned_down(item, told) for item in diagnosis.refused] + left_too_much(diagnosis),
        data=[
            DataFinding(signal=d.signal, finding=d.finding, remedy=d.remedy, factor=d.factor)
            for d in diagnosis.data
        ],
        linear={s: linear(s, item) for s, item in diagnosis.references.items()},
        linear_blocks=linear_blocks(diagnosis),
        words=words(diagnosis),
        correlations=correlated(diagnosis),
        interrupted=diagnosis.stage or None,
        span=None if whole else diagnosis.spans[0],
        made={
            "cosim": project_version(),
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "scipy", "numba", "fmpy", "pythonfmu")},
            **files(logs),
            **held_file(diagnosis),
        },
    )


def words(diagnosis: Diagnosis) -> Words:
    """Units, words and values of a machine that is not the nominal crane, for whoever makes the report again."""
    lexicon = diagnosis.machine.lexicon
    shown_ = {n: ShownSignal(unit=s.unit, scale=s.scale, text=s.text) for n, s in lexicon.signals.items()}
    return Words(
        signals=shown_, units=lexicon.units, blocks=lexicon.blocks, values=dict(diagnosis.machine.base)
    )


def signals(diagnosis: Diagnosis) -> dict[str, Signal]:
    """Errors of the nominal model's FMUs over the whole log."""
    found, floors = {}, diagnosis.noise
    for signal, simulated in diagnosis.before.items():
        if signal not in diagnosis.record.signals:
            continue
        measured = diagnosis.record.signals[signal]
        unit, scale = shown(signal)
        rmse = rms(measured - simulated)
        fit = fit_percent(measured, simulated) or 0.0  # 0 also for a constant signal
        noise = floors.get(signal, 0.0) * scale
        found[signal] = Signal(rmse=rmse * scale, fit_percent=fit, unit=unit, noise_floor=noise)
    return found


def localisation(diagnosis: Diagnosis) -> list[Location]:
    """Blocks by how much of their residual is systematic, in units of their noise; shares add up to one."""
    rows = []
    for name, finding in diagnosis.findings.items():
        for signal, left in finding.before.items():
            rule = finding.task.rules[signal]
            penalty = max(0.0, finding.chosen.fit.log_likelihood - finding.null.fit.log_likelihood)
            once = [e for e in finding.events.get(signal, {}).values() if local(finding, signal, e)]
            # of what moves and is not followed every sample says so, whatever passes for noise
            lost = 0.5 * finding.task.measured[signal].size if unfollowed(finding, signal) else 0.0
            weight = max(
                lost, left.gain if left.p_value < SYSTEMATIC_SHARE else 0.0, *(e.gain for e in once)
            ) + (penalty if finding.chosen.effects else 0.0)
            size = max(at_first(finding, signal), *(size_of(finding, signal, e) for e in once), 0.0)
            rows.append((name, signal, weight, float(np.hypot(size, rule.rms)), rule.rms))
    total = sum(row[2] for row in rows)
    found = []
    for name, signal, weight, residual, noise in sorted(rows, key=lambda row: -row[2]):
        unit, scale = shown(signal)
        share = weight / total if total > 0.0 else 0.0
        found.append(
            Location(
                block=name,
                signal=signal,
                share=share,
                residual_rms=residual * scale,
                noise_floor=noise * scale,
                unit=unit,
            )
        )
    return found


def named(diagnosis: Diagnosis, cause: Cause) -> NamedCause:
    """One cause with its parameters, evidence and rivals."""
    parameters = {}
    nothing = unmoved(diagnosis, cause)
    for parameter, name in names_of(cause.effect).items():
        if parameter in nothing:
            continue
        variable = declared(cause.effect, parameter)
        value, deviation = cause.parameters[parameter]
        value = diagnosis.values.get(name, value)
        deviation = max(deviation, diagnosis.deviations.get(name, 0.0))
        parameters[parameter] = parameter_of(diagnosis, name, variable, value, deviation)
    nearest: dict[str, float] = {}  # an effect may have been tried in several sets of causes
    for effect, behind in cause.rivals:
        nearest[effect.name] = min(behind, nearest.get(effect.name, behind))
    rivals = [
        Rival(effect=name, why_not=reason(behind, name in cause.indistinguishable))
        for name, behind in list(nearest.items())[:8]
    ]
    low, high = cause.held_out.decided
    evidence = {
        "log_likelihood_gain": cause.gain,
        "held_out_gain": cause.held_out.gain,
        "held_out_gain_low": low,
        "held_out_gain_high": high,
    }
    return NamedCause(
        effect=cause.effect.name,
        block=cause.effect.block,
        parameters=parameters,
        evidence=evidence,
        rivals=rivals,
        indistinguishable_from=list(cause.indistinguishable),
        top_speed=speeds_at(diagnosis, cause, parameters),
    )


def left_too_much(diagnosis: Diagnosis) -> list[RefusedCause]:
    """Causes that come nearest in a block, and leave more than trusted numbers allow."""
    found = []
    for name, finding in diagnosis.findings.items():
        if not finding.chosen.effects or stands(finding):
            continue
        signal = max(finding.after, key=lambda s: finding.after[s].gain)
        unit, scale = shown(signal)
        before, after = (scale * left[signal].rms for left in (finding.before, finding.after))
        if after >= before:
            continue
        beside = f" with {len(finding.chosen.effects) - 1} more" if len(finding.chosen.effects) > 1 else ""
        for effect in finding.chosen.effects:
            why = (
                f"it comes nearest{beside}: what is systematic in {signal} falls from {before:.3g} to {after:.3g} {unit} "
                "with it, and more is left than beside numbers that are trusted (--calibrate fits them, too)"
            )
            sizes = {
                p: parameter_of(
                    diagnosis,
                    n,
                    declared(effect, p),
                    finding.chosen.fit.values[n],
                    finding.chosen.fit.deviations[n],
                )
                for p, n in names_of(effect).items()
            }
            found.append(RefusedCause(effect=effect.name, block=name, why=why, parameters=sizes))
    return found


def unmoved(diagnosis: Diagnosis, cause: Cause) -> set[str]:
    """Parameters of a cause of which the log says nothing, where others do move: they stay, or are a limit never met.

    Or they change nothing, such as the dead zone of a direction in which nothing was driven.
    """
    finding = diagnosis.findings.get(cause.group)
    if finding is None:
        return set()
    nominal = {p: finding.task.model.nominal(n) for p, n in names_of(cause.effect).items()}
    stay = {p for p, off in nominal.items() if cause.parameters[p] == (off, 0.0)}
    limits = {p: n for p, n in names_of(cause.effect).items() if (f := cause.effect.free.get(p)) and f.limits}
    # an interval that reaches over where the limit is out of reach
    stay |= {
        p
        for p, n in limits.items()
        if abs(diagnosis.values.get(n, 0.0) - nominal[p]) <= diagnosis.deviations.get(n, 0.0)
    }
    change_nothing = {p for p, n in names_of(cause.effect).items() if idle(finding.chosen.fit, n)}
    # a cause keeps a size: where none is left, what changes nothing in its block's fit may do so in that of the whole
    return next(
        (still for still in (stay | change_nothing, stay) if len(still) < len(cause.parameters)), set()
    )


def parameter_of(
    diagnosis: Diagnosis, name: str, variable: Variable, value: float, deviation: float
) -> Parameter:
    """An estimate in display units, its interval no further than it can be; of several logs what each says by itself."""
    unit, scale = current().parameter(variable)
    reach, item = 1.96 * deviation, diagnosis.between.get(name)
    if item is None:
        ends = ((value - reach) * scale, (value + reach) * scale)
        told = Parameter(value=value * scale, unit=unit, ci95=ends)
    else:
        told = with_logs(diagnosis, item, value, unit, scale)
    return clipped(told, variable.low * scale, variable.high * scale)


def clipped(told: Parameter, low: float, high: float) -> Parameter:
    """A parameter whose intervals end where it can be no further."""
    within = {"ci95": (max(low, told.ci95[0]), min(high, told.ci95[1]))}
    if told.next_log_ci95 is not None:
        within["next_log_ci95"] = (max(low, told.next_log_ci95[0]), min(high, told.next_log_ci95[1]))
    return told.model_copy(update=within)


def with_logs(diagnosis: Diagnosis, item: Between, value: float, unit: str, scale: float) -> Parameter:
    """The same with what each of several logs says, in a unit of that scale."""
    ends = (item.ci95[0] * scale, item.ci95[1] * scale)
    if not diagnosis.record.cuts:  # its parts are no logs
        return Parameter(value=value * scale, unit=unit, ci95=ends)
    each = []
    for own, spread in zip(item.values, 1.96 * item.deviations, strict=True):
        told = (float(own - spread) * scale, float(own + spread) * scale) if np.isfinite(spread) else None
        each.append(OfLog(value=float(own) * scale, ci95=told))
    return Parameter(
        value=value * scale,
        unit=unit,
        ci95=ends,
        per_log=each,
        next_log_ci95=(item.next_ci95[0] * scale, item.next_ci95[1] * scale),
    )


def speeds_at(diagnosis: Diagnosis, cause: Cause, limits: Iterable[str]) -> dict[str, Parameter]:
    """Limit of a cause -> the speed at it, where that is what the log tells."""
    found, names = {}, names_of(cause.effect)
    for limit in limits:
        item = diagnosis.top_speeds.get(names[limit])
        if item is not None:
            signal = diagnosis.findings[cause.group].task.model.group.observed[0]
            unit, scale = shown(signal)
            told = with_logs(diagnosis, item, item.value, of_speed(unit), scale)
            # a limit to one side is none to the other
            sides = (0.0, np.inf) if item.value > 0.0 else (-np.inf, 0.0)
            found[limit] = clipped(told, *sides)
    return found


def reason(behind: float, indistinguishable: bool) -> str:
    """Words for how far a rival lies behind."""
    if indistinguishable and behind > INDISTINGUISHABLE:
        return (
            f"{behind:.0f} in log-likelihood behind, which tells nothing while the law is known only nearly: "
            "this log cannot tell the two apart"
        )
    if indistinguishable:
        if behind < 0.0:
            return f"{-behind:.1f} in log-likelihood ahead on the fitted data: this log cannot tell the two apart"
        return f"only {behind:.1f} in log-likelihood behind: this log cannot tell the two apart"
    if behind < 0.5:  # what is named was chosen with other data, or with the other causes, in view
        by = f"better by {-behind:.0f} in log-likelihood" if behind <= -0.5 else "as well"
        return f"explains the fitted data {by}, but not data held out, or not beside the other causes"
    return f"explains the log worse by {behind:.0f} in log-likelihood (less the price of its parameters)"


def packages(diagnosis: Diagnosis) -> Packages | None:
    """Paths of the extended package and its parameter set."""
    if not diagnosis.packages:
        return None
    package = diagnosis.packages.get("closed", diagnosis.packages["open"])
    in_place = None if diagnosis.in_place is None else described(diagnosis.in_place)
    return Packages(ssp=str(package), ssv=str(diagnosis.packages.get("ssv", package)), in_place=in_place)


def gains(diagnosis: Diagnosis) -> dict[str, SignalGain]:
    """Held-out errors in display units."""
    found, floors, held = {}, diagnosis.noise, diagnosis.held
    names = held.logs if held is not None else ()
    for signal, gain in diagnosis.gains.items():
        unit, scale = shown(signal)
        logs = zip(names, gain.each, strict=True) if gain.each else ()
        found[signal] = SignalGain(
            rmse_before=gain.before * scale,
            rmse_after=gain.after * scale,
            unit=unit,
            noise_floor=floors.get(signal, 0.0) * scale,
            fit_percent_before=gain.fit_before,
            fit_percent_after=gain.fit_after,
            ci95_of_ratio=gain.ratio_ci95,
            horizon=gain.horizon if np.isfinite(gain.horizon) else None,
            per_log=[LogGain(log=n, rmse_before=a * scale, rmse_after=b * scale) for n, (a, b) in logs],
        )
    return found


def linear(signal: str, item: Reference) -> LinearReference:
    """A linear reference in display units."""
    unit, scale = shown(signal)
    return LinearReference(
        order=item.model.order,
        poles=[(p.real, p.imag) for p in item.model.sections.poles],
        delay=item.model.sections.delay,
        what=item.words,
        rmse=item.error * scale,
        rmse_extended=item.ours_error * scale,
        unit=unit,
        ci95_of_ratio=ratio_ci95(item.ours, item.squares),
        ahead=item.ahead,
    )


def linear_blocks(diagnosis: Diagnosis) -> dict[str, LinearReference]:
    """The linear reference of each block that was held against one."""
    found = {}
    for name, finding in diagnosis.findings.items():
        if finding.reference is not None:
            found[name] = linear(next(iter(finding.task.measured)), finding.reference)
    return found


def unexplained(diagnosis: Diagnosis) -> list[Unexplained]:
    """What stays unexplained, in display units."""
    found = []
    for rest in diagnosis.rests:
        unit, scale = shown(rest.signal)
        found.append(
            Unexplained(
                block=rest.block,
                what=rest.what,
                residual_rms=rest.leftover.rms * scale,
                unit=unit,
                span=rest.span,
            )
        )
    return found


def nominal(diagnosis: Diagnosis) -> dict[str, Parameter]:
    """The trusted parameters as estimated together with the causes."""
    freed = {n for c in diagnosis.causes for n in names_of(c.effect).values()}
    found = {}
    for name, value in diagnosis.values.items():
        component, _, parameter = name.partition(".")
        if name in freed or name not in diagnosis.deviations:
            continue
        variable = registry.parameter(component, parameter)
        found[name] = parameter_of(diagnosis, name, variable, value, diagnosis.deviations.get(name, 0.0))
    return found


def correlated(diagnosis: Diagnosis) -> list[Correlated]:
    """Estimates whose errors go together, of those that are told."""
    told = {*nominal(diagnosis)} | {n for c in diagnosis.causes for n in names_of(c.effect).values()}
    return [
        Correlated(parameters=pair, correlation=round(value, 4))
        for pair, value in diagnosis.correlations.items()
        if told.issuperset(pair) and abs(value) > INDEPENDENT
    ]


def next_experiment(proposal: Proposal | None) -> NextExperiment | None:
    """The proposed experiment, if one would help."""
    if proposal is None:
        return None
    return NextExperiment(
        why=proposal.why,
        excitation=proposal.excitation,
        predicted_gain=proposal.predicted_gain,
        file=str(proposal.file) if proposal.file else None,
    )
