"""From fits to answers: what is a cause, what cannot be told apart, what stays unexplained."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import noise_floor, resolution, rms
from cosim.diagnosis.fitting.fit import Unknown
from cosim.diagnosis.fitting.noise import centred
from cosim.diagnosis.fitting.trials import Trial, freed, trusted, without
from cosim.diagnosis.record.record import as_read
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.cross_validation import held_out_gain
from cosim.diagnosis.residuals.finding import Finding, at_first, gained, systematic
from cosim.diagnosis.residuals.freeform import Leftover
from cosim.diagnosis.residuals.local import Event
from cosim.diagnosis.thresholds import (
    AS_A_CONSTANT,
    BEYOND_TRUST,
    INDISTINGUISHABLE,
    LAW_KNOWN_TO,
    LEFT_BY_LINEAR,
    LEFT_BY_ONE,
    LEFT_BY_SEVERAL,
    LOCAL,
    MOVES_BEYOND,
    NAMING_GAIN,
    NOMINAL_TRUST,
    NOTICEABLE,
    ONE_SIDED_95,
    ROUNDING_SHARE,
    STRAIN_MARGIN,
)
from cosim.diagnosis.verdict import FREE_CURVE
from cosim.inference.held_out import HeldOutGain
from fmus import registry
from fmus.contract import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cause:
    """A named cause.

    Attributes:
        effect: the effect.
        group: name of the group in which it was found.
        parameters: its parameters: name -> (estimate, standard deviation), SI.
        gain: log-likelihood lost when the effect is taken away.
        held_out: log-likelihood gained on data that had no share in the estimates, with its interval: on held-out logs,
            on each of several logs left out in turn, or on windows of the log left out in turn.
        rivals: (effect, log-likelihood behind the chosen set).
        indistinguishable: effects that the data cannot tell from this one.
    """

    effect: Effect
    group: str
    parameters: Mapping[str, tuple[float, float]]
    gain: float
    held_out: HeldOutGain
    rivals: Sequence[tuple[Effect, float]] = ()
    indistinguishable: Sequence[str] = ()


@dataclass(frozen=True)
class Rest:
    """Something systematic that nothing in the library explains; `span` is when, s, if only one stretch is off."""

    block: str
    signal: str
    leftover: Leftover
    what: str
    span: tuple[float, float] | None = None


def negligible(finding: Finding, signal: str) -> float:
    """Size of a systematic rest that does not matter, SI: a part of the noise, or the error of readings in steps."""
    # while the motion is smaller than a step, and at rest, readings may be off by the same half step
    limits = [NOTICEABLE * finding.task.rules[signal].rms, ROUNDING_SHARE * rounding(finding, signal)]
    if len(finding.chosen.effects) == 1:
        # a model that runs away is wrong by more than there is to be explained
        before = min(finding.before[signal].rms, moves(finding, signal, finding.task.measured[signal]))
        limits.append((LEFT_BY_LINEAR if sole_form(finding) else LAW_KNOWN_TO) * before)
    return max(limits)


def notable(finding: Finding, signal: str, left: Leftover) -> bool:
    """True if what is left of a signal is neither chance nor negligible."""
    return systematic(left, negligible(finding, signal), finding.task.rules[signal].rms)


def sole_form(finding: Finding) -> bool:
    """True if the laws of all chosen effects have one form only: nothing that they leave is their own."""
    return all(e.sole_form for e in finding.chosen.effects)


def rounding(finding: Finding, signal: str) -> float:
    """Step of the grid on which a signal's readings lie, SI; 0 without one."""
    read = signal == finding.task.model.group.reading
    steps = [m.value for m in finding.signatures if m.effect == "sensor.quantisation" and read]
    return max(steps, default=0.0)


def adequate(finding: Finding) -> bool:
    """True if nothing noticeable is left in any signal of the group, and what moves is followed."""
    if any(unfollowed(finding, s) or notable(finding, s, left) for s, left in finding.after.items()):
        return False
    return not any(local(finding, s, e) for s, found in finding.events.items() for e in found.values())


def unfollowed(finding: Finding, signal: str) -> bool:
    """True if a signal moves, in the model too, and the chosen set leaves as much of it as a constant reading would.

    Noise that is learned from errors as large and as slow as the motion itself takes them for its own. What the model
    takes for constant, such as a supply pressure, moves by its noise alone, however slow; what a cause brings to a stand,
    as friction beyond any torque does, is not of that kind.
    """
    task, rule = finding.task, finding.task.rules[signal]
    measured, residual = task.measured[signal], finding.chosen.fit.residuals[signal]
    cuts = task.model.cuts
    noise = max(noise_floor(measured, task.model.h, cuts), resolution(measured, cuts))
    left, whole = rms(centred(rule, residual)), moves(finding, signal, measured)
    predicted = (task.predicted(trial.fit)[signal] for trial in (finding.chosen, finding.null))
    made = max(moves(finding, signal, x) for x in predicted)
    return min(whole, made) > MOVES_BEYOND * noise and left >= AS_A_CONSTANT * whole


def moves(finding: Finding, signal: str, series: Array) -> float:
    """RMS of what a constant leaves of a signal's series (n,) in its windows, SI."""
    return rms(centred(finding.task.rules[signal], series - series.mean()))


def local(finding: Finding, signal: str, event: Event) -> bool:
    """True if what stands out of a signal at one time or one frequency is no chance, and matters."""
    return event.p_value < LOCAL and size_of(finding, signal, event) > negligible(finding, signal)


def size_of(finding: Finding, signal: str, event: Event) -> float:
    """Size of what stands out, beyond the noise around it, in the signal's unit."""
    if event.size > 0.0:
        return event.size
    return finding.task.rules[signal].sigma * float(np.sqrt(max(event.excess - 1.0, 0.0)))


def after_start(finding: Finding, signal: str) -> list[Array]:
    """What is left of a signal in each log, without its start."""
    rule = finding.task.rules[signal]
    return [own[rule.skip :] for own in np.split(finding.chosen.fit.residuals[signal], rule.cuts)]


def stands(finding: Finding) -> bool:
    """True if the chosen effects carry the systematic part of the residual, even where a small rest remains.

    So do effects that data have borne out which took no part in naming them, and all that held-out windows bear out where
    the nominal parameters are not trusted: such a model leaves something in any case, and how much says nothing.
    """
    if finding.confirmed or finding.free:
        return True
    share = LEFT_BY_ONE if len(finding.chosen.effects) == 1 else LEFT_BY_SEVERAL
    share = LEFT_BY_LINEAR if sole_form(finding) else share
    gain = gained(finding)
    for signal, left in finding.after.items():
        if not notable(finding, signal, left):
            continue
        # the one signal may show next to nothing of a cause that the other is full of
        much = left.gain > LEFT_BY_LINEAR**2 * gain
        if much and left.rms > max(
            share * finding.before[signal].rms, LEFT_BY_LINEAR * at_first(finding, signal)
        ):
            return False
    # something that happens once and carries more than the causes do may well be what called for them
    listed = [(s, e) for s, found in finding.events.items() for e in found.values()]
    return not any(local(finding, s, e) and e.gain > gain for s, e in listed)


def what_stands(finding: Finding) -> Trial:
    """The chosen effects where they stand, the nominal model where they do not."""
    return finding.chosen if stands(finding) else finding.null


def of_signatures(finding: Finding) -> list[Cause]:
    """Causes seen in the raw samples."""
    effects, group = registry.effects(), finding.task.model.group.name
    return [
        Cause(
            effects[m.effect],
            group,
            {m.parameter: (m.value, m.deviation)},
            m.gain,
            m.held_out_gain,
        )
        for m in finding.signatures
    ]


def causes(finding: Finding, tolerance: float) -> list[Cause]:
    """The named causes of a group; none where something large stays unexplained."""
    found = of_signatures(finding)
    if not finding.chosen.effects or not stands(finding):
        return found
    found += [cause_of(finding, effect, tolerance) for effect in finding.chosen.effects]
    return sorted(found, key=rank)


def rank(cause: Cause) -> tuple[bool, float]:
    """Key that puts first what explains most, and what only the samples show behind it.

    How unlikely it is that all readings lie on a grid by chance says nothing of how far a step of it puts the model wrong.
    """
    return cause.effect.name in SAMPLED, -cause.gain


def cause_of(finding: Finding, effect: Effect, tolerance: float) -> Cause:
    """One of the chosen effects as a cause, with its own figures."""
    chosen, task = finding.chosen, finding.task
    rivals = [(other_of(t, chosen), shortfall(t, chosen)) for t in finding.rivals.get(effect.name, ())]
    rivals += finding.upstream
    fewer = without(task, chosen, effect, finding.null, tolerance)
    return Cause(
        effect,
        task.model.group.name,
        {p: (chosen.fit.values[n], chosen.fit.deviations[n]) for p, n in names_of(effect).items()},
        chosen.fit.log_likelihood - fewer.fit.log_likelihood,
        finding.borne.get(effect.name) or held_out_gain(task, chosen.fit, fewer.fit),
        sorted(rivals, key=lambda item: item[1]),
        list(
            dict.fromkeys(
                [
                    *(e.name for e, behind in finding.upstream if behind < INDISTINGUISHABLE),
                    *indistinguishable(finding, effect, fewer),
                ]
            )
        ),
    )


def indistinguishable(finding: Finding, effect: Effect, fewer: Trial) -> list[str]:
    """Rivals that explain the log about as well as a chosen effect in its place, the closest first.

    One whose gain behind the chosen set is small, or may be nothing on windows left out (of models that leave something,
    a difference means only what other data would show again: Vuong, Econometrica 57(2), 1989); and that itself gains.
    Where data were held out, these have told which the log leaves undecided.

    Args:
        finding: what was found in the group.
        effect: the chosen effect.
        fewer: the chosen set without it.
    """
    task, chosen = finding.task, finding.chosen
    found = []
    if effect.name in finding.undecided:
        told = finding.undecided[effect.name]
        rivals = sorted(finding.rivals.get(effect.name, []), key=lambda t: shortfall(t, chosen))
        return [name for t in rivals if (name := other_of(t, chosen).name) in told]
    for trial in sorted(finding.rivals.get(effect.name, []), key=lambda t: shortfall(t, chosen)):
        behind = shortfall(trial, chosen)
        if behind >= INDISTINGUISHABLE and (
            trial.score <= fewer.score + NAMING_GAIN
            or held_out_gain(task, chosen.fit, trial.fit).sure
            or not held_out_gain(task, trial.fit, fewer.fit).sure
        ):
            continue
        found.append(other_of(trial, chosen).name)
    return found


def shortfall(rival: Trial, chosen: Trial) -> float:
    """Log-likelihood by which a rival explains the log worse than the chosen set, less the price of fewer parameters.

    More parameters are held against a rival only where it frees all that the chosen set does and more: such a rival can
    always do as well. Any other that explains the log as well cannot be told apart, however many parameters it has.
    """
    by_score = chosen.score - rival.score
    if set(freed(chosen.effects)) < set(freed(rival.effects)):
        return by_score
    return min(by_score, chosen.fit.log_likelihood - rival.fit.log_likelihood)


def names_of(effect: Effect) -> dict[str, str]:
    """Parameter -> ``component.parameter`` of what an effect changes."""
    return {p: f"{effect.component}.{p}" for p in effect.free}


def other_of(trial: Trial, chosen: Trial) -> Effect:
    """The effect of a trial that the chosen set does not have."""
    return next(e for e in trial.effects if e not in chosen.effects)


def rests(finding: Finding, tolerance: float = NOMINAL_TRUST) -> list[Rest]:
    """What stays unexplained in a group, with words for what it depends on."""
    found = []
    standing = stands(finding)
    for signal, after in finding.after.items():
        left = after if standing else finding.before[signal]
        best, gain = next(iter(left.by_signal.items()), ("", 0.0))
        at_once = local_rests(finding, signal)
        # against the noise what is small may weigh more than all that is left, but it is not all that is wrong
        leads = [r for r in at_once if r.leftover.gain > gain and r.leftover.rms >= left.rms]
        if notable(finding, signal, left) and not leads:
            share = gain / max(left.gain, 1e-300)
            what, _, of = best.partition("(")
            cause = f"a missing {what} that depends on {of.rstrip(')')}"
            words = f"{cause} explains {min(share, 1.0):.0%} of what is systematic in {signal}"
            found.append(Rest(finding.task.model.group.name, signal, left, words))
        else:
            found += at_once
    if finding.lacks_linear:
        found.insert(0, missing_dynamics(finding))
    if finding.lacks_curve:
        found.insert(0, missing_curve(finding))
    return found or following_nothing(finding) or strained(finding, tolerance)


def following_nothing(finding: Finding) -> list[Rest]:
    """Signals that move, and of which the group leaves as much as a constant reading would."""
    found = []
    for signal, left in finding.after.items():
        if unfollowed(finding, signal):
            words = f"{signal} moves and the model does not follow it: it errs as much as a constant reading would"
            rest = replace(left, rms=rms(finding.chosen.fit.residuals[signal]))
            found.append(Rest(finding.task.model.group.name, signal, rest, words))
    return found


def missing_dynamics(finding: Finding) -> Rest:
    """What a linear model of free order shows that the group lacks."""
    assert finding.reference is not None
    signal, linear = next(iter(finding.before)), finding.reference
    where = f"over windows of {linear.span:.3g} s left out of the fit" if linear.span else "on data held out"
    words = (
        f"linear dynamics are missing: a linear model ({linear.words}) predicts {signal} {where} with "
        f"{linear.error / linear.ours_error:.0%} of the error that the model of blocks has"
    )
    left = replace(finding.before[signal], rms=float(np.sqrt(linear.ours_error**2 - linear.error**2)))
    return Rest(finding.task.model.group.name, signal, left, words)


def missing_curve(finding: Finding) -> Rest:
    """What a free curve of the drive shows that the group lacks."""
    assert finding.reference is not None
    signal, ours = next(iter(finding.before)), finding.reference.ours_error
    words = (
        f"{signal} follows {finding.task.model.group.drive} {FREE_CURVE}: one without dynamics, fitted freely each way, "
        f"leaves {finding.lacks_curve / ours:.0%} of the error that the model of blocks has"
    )
    left = replace(finding.before[signal], rms=float(np.sqrt(max(ours**2 - finding.lacks_curve**2, 0.0))))
    return Rest(finding.task.model.group.name, signal, left, words)


def strained(finding: Finding, tolerance: float) -> list[Rest]:
    """Trusted parameters that only a value far beyond their trust makes fit, although no named cause frees them."""
    chosen = what_stands(finding)
    freed = {n for e in chosen.effects for n in names_of(e).values()}
    signal = next(iter(finding.after))
    # a single cause whose law is known only nearly bends the parameters beside it
    gain = chosen.fit.log_likelihood - finding.null.fit.log_likelihood
    enough = (
        max(NAMING_GAIN, LAW_KNOWN_TO**2 * gain)
        if len(chosen.effects) == 1 and not sole_form(finding)
        else NAMING_GAIN
    )
    found = []
    for known in trusted(finding.task.model, tolerance):
        if known.name in freed or known.prior is None:
            continue
        pull = abs(chosen.fit.values[known.name] - known.start) / known.prior[1]
        off = pull - ONE_SIDED_95 * chosen.fit.deviations[known.name] / known.prior[1]
        if (
            off <= BEYOND_TRUST + STRAIN_MARGIN
            or 0.5 * pull**2 <= enough
            or not matters(finding, chosen, known)
        ):
            continue
        off_by = (
            f"{chosen.fit.values[known.name] / known.start - 1.0:+.1%} off" if known.start else "other than"
        )
        words = (
            f"{signal} asks for {known.name} {off_by} its nominal value, and no cause of the library says why"
        )
        left = finding.before[signal]
        found.append(Rest(finding.task.model.group.name, signal, left, words))
    return found


def matters(finding: Finding, chosen: Trial, known: Unknown) -> bool:
    """True if a trusted parameter at its nominal value changes a signal by more than rounding may have."""
    moved = finding.task.model.simulate(chosen.fit.values)
    nominal = finding.task.model.simulate(chosen.fit.values | {known.name: known.start})
    changes = {s: float(np.std(moved[s] - nominal[s])) for s in finding.task.measured}
    return any(change > ROUNDING_SHARE * rounding(finding, s) for s, change in changes.items())


def local_rests(finding: Finding, signal: str) -> list[Rest]:
    """What stays unexplained at one time or at one frequency, the clearest of these."""
    found = []
    residual = finding.chosen.fit.residuals[signal]
    for kind, event in finding.events.get(signal, {}).items():
        if not local(finding, signal, event):
            continue
        if kind == "event":
            words = f"{signal} is off between {event.start:.1f} and {event.end:.1f} s only: something happened once"
        elif kind == "oscillation":
            words = (
                f"{signal} swings at {event.start:.3f} Hz all the time, whatever the machine is asked to do"
            )
        else:
            words = f"{signal} rings at {event.start:.2f} Hz beyond what noise and the model give"
        size = size_of(finding, signal, event)
        left = Leftover(event.p_value, event.gain, size, residual, {kind: event.gain}, {}, event.gain)
        span = (event.start, event.end) if kind == "event" else None
        found.append(Rest(finding.task.model.group.name, signal, left, words, span))
    return sorted(found, key=lambda rest: -rest.leftover.gain)[:1]


def floor_of(finding: Finding, signal: str) -> float:
    """Standard deviation of a signal's noise per sample, white or not, rounding included, SI.

    Where nothing is left unexplained it is that of the noise learned: between the samples of a bin, and of the bins. Where
    something is left, which might pass for correlated noise, it is what shows where the signal is quietest, or what it
    leaves beside the model: a machine that never rests, sampled slowly, has no quiet place. Where machine and model both
    stand nothing is left, and of readings in steps that is not all the noise there is.
    """
    task = finding.task
    rule = task.rules[signal]
    parts = after_start(finding, signal)
    step = max(rounding(finding, signal), task.steps.get(signal, 0.0))
    if not adequate(finding):
        lost = task.lost.get(signal)
        measured, cuts = as_read(task.measured[signal], lost, task.model.cuts)
        gone = (
            [None] * len(parts) if lost is None else [own[rule.skip :] for own in np.split(lost, rule.cuts)]
        )
        left = [as_read(own, filled)[0] for own, filled in zip(parts, gone, strict=True)]
        interval = task.model.h * task.measured[signal].size / measured.size
        found = min(noise_floor(measured, interval, cuts), noise_floor(np.concatenate(left), interval))
        return float(max(found, max(step, resolution(measured, cuts)) / np.sqrt(12.0)))
    rows = np.concatenate([own[: own.size // rule.bins * rule.bins].reshape(-1, rule.bins) for own in parts])
    between = np.mean((rows - rows.mean(axis=1, keepdims=True)) ** 2)
    return float(np.sqrt(rule.rms**2 + between + step**2 / 12.0))
