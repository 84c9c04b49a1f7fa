"""The next experiment: the excitation that would best separate two explanations that a log cannot tell apart.

T-optimality: the two fitted models are simulated on each feasible excitation, and the one in which their predictions
differ most, in units of the noise, wins; the nominal parameters may hide part of the difference at the price of their trust.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.remarks import shown
from cosim.diagnosis.fitting.fit import Unknown, jacobian
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.trials import unknowns
from cosim.diagnosis.fitting.whole import ChainModel
from cosim.diagnosis.hypotheses.exercised import moderate
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.grid import Grid, of_piece
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import BOTH_WAYS, NAMING_GAIN
from cosim.diagnosis.verdict.verdict import Cause
from cosim.files import write_text

Array = NDArray[np.float64]

Description = dict[str, float | str | list[float]]
Reach = tuple[float, float]  # lowest and highest value of the command, SI
FULL: Reach = (-1.0, 1.0)
REFINED = 10  # excitations whose separation is computed with the second model refitted


@dataclass(frozen=True)
class Proposal:
    """An experiment to make.

    Attributes:
        why: which explanations it separates.
        excitation: shape, amplitude, duration and what else describes it.
        predicted_gain: log-likelihood by which it would separate them.
        command: (n,) the command at 1 kHz, SI.
        drive: the signal that it is.
        models: names of the two explanations.
        predicted: signal -> (2, n) what each predicts, SI; the second as refitted to the first, as it would be.
        rules: signal -> whitening rule, by which the two are told apart.
        evidence: (n,) log-likelihood that each sample adds for the one against the other.
        file: CSV with the command, once written.
    """

    why: str
    excitation: Description
    predicted_gain: float
    command: Array
    models: tuple[str, str] = ("", "")
    predicted: dict[str, Array] = field(default_factory=dict, repr=False)
    rules: dict[str, Whitener] = field(default_factory=dict, repr=False)
    evidence: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    drive: str = "u"
    file: Path | None = None


class Rehearsal:
    """An experiment played on fitted models: commanded at every step, read as often as the log was sampled.

    Args:
        groups: the groups of the model.
        command: (n,) SI, one value a step.
        fixed: start angle.
        h: step, s.
        interval: between two readings, s.
    """

    def __init__(
        self, groups: tuple[Group, ...], command: Array, fixed: dict[str, float], h: float, interval: float
    ) -> None:
        self.chain = ChainModel(groups, Record(h, {groups[0].drive: command}), of_piece(fixed, 0))
        end = (command.size - 1) * h
        stamps = np.arange(int(end / interval + 1e-6) + 1, dtype=np.float64) * interval
        self.grid = Grid(stamps, h)
        self.every_step = abs(interval - h) < 1e-6 * h
        self.time = np.arange(command.size) * h

    def read(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Signal -> (m,) what is read of it, SI."""
        return self.sampled(self.chain.simulate(dict(values)))

    def sampled(self, found: dict[str, Array]) -> dict[str, Array]:
        """Signal -> (m,) what is read of signals (n,) known at every step, SI."""
        return found if self.every_step else {s: self.grid.sampled(rows) for s, rows in found.items()}

    def spread(self, evidence: Array) -> Array:
        """(m,) what each reading adds, as (n,) what each step adds."""
        if self.every_step:
            return evidence
        # the last reading may come before the command ends
        gathered = np.interp(self.time, self.grid.stamps, np.cumsum(evidence))
        return np.diff(gathered, prepend=0.0)


def menu(
    duration: float, h: float, amplitudes: tuple[float, ...] = (0.05, 0.1, 0.25, 0.5, 1.0)
) -> list[tuple[Description, Array]]:
    """Feasible excitations of one duration, s, at steps of h: shapes, amplitudes, frequencies; |u| <= 1, mean about zero."""
    time = np.arange(round(duration / h) + 1) * h
    found: list[tuple[Description, Array]] = []

    def add(shape: str, amplitude: float, of: str, value: float, command: Array) -> None:
        found.append(
            ({"shape": shape, "amplitude": amplitude, of: value, "duration_s": duration}, amplitude * command)
        )

    for amplitude in amplitudes:
        for omega in (0.3, 1.0, 3.0, 10.0):
            add("sine", amplitude, "frequency_rad_s", omega, np.sin(omega * time))
        for hold in (0.5, 1.5, 4.0):
            square = np.sign(np.sin(np.pi * time / hold + 1e-9))
            add("steps", amplitude, "hold_s", hold, square)
            add(
                "steps with rests", amplitude, "hold_s", hold, square * (np.floor(time / hold / 2.0) % 2 == 0)
            )
        for period in (5.0, 20.0):
            ramp = (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * time / period))
            add("triangle", amplitude, "period_s", period, ramp)
    return found


def within(reach: Reach, description: Description, command: Array, drive: str) -> tuple[Description, Array]:
    """An excitation of the menu, as far as the command may go, in the unit people read."""
    if reach == FULL:
        return description, command
    low, high = reach
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    unit, scale = shown(drive)
    said = description | {"amplitude": rounded(scale * half * float(description["amplitude"]))}  # type: ignore[arg-type]
    if middle:
        said["middle"] = rounded(scale * middle)
    return (said if unit == "1" else said | {"unit": unit}), middle + half * command


def rounded(value: float) -> float:
    """To four digits, as it is told."""
    return float(f"{value:.4g}")


def reached(values: Array) -> Reach:
    """How far a command (n,) may go: to rest, and nowhere beyond what the log shows; as far both ways where it went both."""
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    both = min(-low, high)
    return (-both, both) if both >= BOTH_WAYS * max(-low, high) else (low, high)


def white_difference(a: Mapping[str, Array], b: Mapping[str, Array], rules: Mapping[str, Whitener]) -> Array:
    """Difference of two predictions in units of noise, all signals in one row."""
    return np.concatenate([rule(a[s] - b[s]).ravel() for s, rule in rules.items() if s in a])


def evidence_of(predicted: Mapping[str, Array], rules: Mapping[str, Whitener]) -> Array:
    """(m,) log-likelihood that each reading adds for the first of two predictions (2, m) of each signal, if it is true."""
    found = np.zeros(next(iter(predicted.values())).shape[1])
    for signal, (one, other) in predicted.items():
        rule = rules[signal]
        each = np.repeat(0.5 * rule(one - other).ravel() ** 2 / rule.bins, rule.bins)
        found[rule.skip : rule.skip + each.size] += each
    return found


def separation(
    played: Rehearsal,
    first: Mapping[str, float],
    second: Mapping[str, float],
    rules: Mapping[str, Whitener],
    loose: list[Unknown],
) -> tuple[float, dict[str, float]]:
    """Log-likelihood by which an experiment would prefer `first`, if it is true, to `second` refitted to it; and that refit.

    The second model's parameters take up what they can, to first order, trusted ones at the price of their priors.
    """
    base = played.read(second)
    target = white_difference(played.read(first), base, rules)
    scales = np.array([u.scale for u in loose])
    z = np.array([second[u.name] for u in loose]) / scales
    low = np.array([u.low for u in loose]) / scales
    high = np.array([u.high for u in loose]) / scales

    def moved(at: Array) -> Array:
        values = dict(second) | {u.name: float(v) for u, v in zip(loose, at * scales, strict=True)}
        return white_difference(played.read(values), base, rules)

    columns = jacobian(moved, z, low, high)
    prior = np.diag([u.scale / u.prior[1] if u.prior else 0.0 for u in loose])
    rows = np.concatenate([columns, prior])
    aim = np.concatenate([target, np.zeros(len(loose))])
    solution, *_ = np.linalg.lstsq(rows, aim, rcond=None)
    rest = aim - rows @ solution
    refitted = np.clip(z + solution, low, high) * scales
    return 0.5 * float(rest @ rest), {u.name: float(v) for u, v in zip(loose, refitted, strict=True)}


def propose(
    groups: tuple[Group, ...],
    first: Mapping[str, float],
    second: Mapping[str, float],
    loose: list[Unknown],
    rules: Mapping[str, Whitener],
    why: str,
    fixed: dict[str, float],
    duration: float = 30.0,
    h: float = 1e-3,
    reach: Reach = FULL,
    interval: float = 1e-3,
) -> Proposal | None:
    """The excitation of the menu that separates two models best; None if none does.

    Args:
        groups: the groups of the model.
        first: all parameter values of one model, ``component.parameter`` -> SI.
        second: those of the other.
        loose: what can be refitted in the second.
        rules: signal -> whitening rule.
        why: the reason, in words.
        fixed: start angle.
        duration: of the experiment, s.
        h: step, s.
        reach: of the command, SI.
        interval: between two readings, s; the rules are for these.
    """
    ranked = []
    drive = groups[0].drive
    for description, command in (within(reach, *item, drive) for item in menu(duration, h)):
        played = Rehearsal(groups, command, fixed, h, interval)
        raw = white_difference(played.read(first), played.read(second), rules)
        ranked.append((float(raw @ raw), description, command))
    ranked.sort(key=lambda item: -item[0])
    best: Proposal | None = None
    values: dict[str, float] = {}
    for _, description, command in ranked[:REFINED]:
        played = Rehearsal(groups, command, fixed, h, interval)
        gain, refit = separation(played, first, second, rules, loose)
        if best is None or gain > best.predicted_gain:
            best = Proposal(why, description, gain, command, drive=drive)
            values = dict(second) | refit
    if best is None or best.predicted_gain <= 1.0:
        return None
    played = Rehearsal(groups, best.command, fixed, h, interval)
    drawn = [played.chain.simulate(dict(each)) for each in (first, values)]
    read = [played.sampled(each) for each in drawn]
    evidence = evidence_of({s: np.stack([r[s] for r in read]) for s in rules if s in read[0]}, rules)
    predicted = {s: np.stack([d[s] for d in drawn]) for s in rules if s in drawn[0]}
    return replace(best, predicted=predicted, rules=dict(rules), evidence=played.spread(evidence))


def proposal_for(
    groups: tuple[Group, ...],
    findings: Mapping[str, Finding],
    causes: list[Cause],
    fixed: dict[str, float],
    values: Mapping[str, float],
    tolerance: float = 0.01,
    reach: Reach = FULL,
    interval: float = 1e-3,
) -> Proposal | None:
    """An experiment for the first cause that has a twin in this log, or None; `reach` and `interval` as in `propose`."""
    for cause in causes:
        if not cause.indistinguishable or cause.group not in findings:
            continue
        finding = findings[cause.group]
        twins = [
            t
            for t in finding.rivals.get(cause.effect.name, [])
            if any(e.name == cause.indistinguishable[0] for e in t.effects)
        ]
        if not twins:
            continue
        rules = {s: r.of_any_log() for f in findings.values() for s, r in f.task.rules.items()}
        own = set(finding.chosen.fit.values) | set(twins[0].fit.values)
        base = {n: v for n, v in values.items() if n not in own}
        first = base | finding.chosen.fit.values
        second = base | twins[0].fit.values
        loose, _ = unknowns(finding.task.model, twins[0].effects, tolerance)
        why = f"tells {cause.effect.name} from {cause.indistinguishable[0]}, which this log cannot"
        found = propose(groups, first, second, loose, rules, why, fixed, reach=reach, interval=interval)
        return found and replace(found, models=(cause.effect.name, cause.indistinguishable[0]))
    return None


def first_of_all(
    groups: tuple[Group, ...],
    rules: Mapping[str, Whitener],
    fixed: dict[str, float],
    duration: float = 30.0,
    h: float = 1e-3,
    interval: float = 1e-3,
) -> Proposal | None:
    """The excitation of the menu that shows most effects of the library, for a machine that has only been seen at rest.

    An effect is shown where a moderate size of it changes the prediction by more than the price of naming it; among equals
    the one counts that shows the median effect best. Arguments as those of `propose`.
    """
    effects = [(g, e) for g in groups for e in g.effects() if e.name not in SAMPLED]
    best: Proposal | None = None
    most = (-1, -1.0)
    for description, command in menu(duration, h, (0.25, 1.0)):
        played = Rehearsal(groups, command, fixed, h, interval)
        plain = played.read({})
        each = []
        for _, effect in effects:
            moved = moderate(effect, played.chain.nominal, {})
            if moved is not None:
                raw = white_difference(played.read(moved), plain, rules)
                each.append(0.5 * float(raw @ raw))
        seen = sum(gain > NAMING_GAIN for gain in each)
        rank = (seen, float(np.median(each)))
        if rank > most:
            why = f"shows {seen} of {len(each)} effects at a moderate size, of which a log without motion shows none"
            most, best = rank, Proposal(why, description, rank[1], command)
    return best


def write_command(proposal: Proposal, folder: Path, h: float = 1e-3) -> Proposal:
    """Write the command as a CSV that the rig plays (``cosim rig --excitation file``), in the unit people read."""
    file = folder / "next_experiment.csv"
    unit, scale = shown(proposal.drive)
    values = (scale * proposal.command).tolist()
    digits = ".6f" if proposal.drive == "u" else ".7g"
    rows = "".join(f"{k * h:.3f},{u:{digits}}\n" for k, u in enumerate(values))
    write_text(file, f"time [s],{proposal.drive} [{unit}]\n{rows}")
    return replace(proposal, file=file)
