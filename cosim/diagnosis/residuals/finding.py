"""What is known of one group while its causes are looked for, and what is left when they are taken out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.noise import centred, learned
from cosim.diagnosis.fitting.rounded import concentration
from cosim.diagnosis.fitting.trials import Trial, freed
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.record.signatures import Signature
from cosim.diagnosis.residuals.bases import free_bases
from cosim.diagnosis.residuals.cross_validation import window_numbers
from cosim.diagnosis.residuals.freeform import Basis, Leftover, explain
from cosim.diagnosis.residuals.hysteresis import Reversals
from cosim.diagnosis.residuals.local import Event
from cosim.diagnosis.residuals.reference import Reference
from cosim.diagnosis.thresholds import (
    AGAIN_SHARE,
    CERTAIN,
    LARGE_REST,
    NOISE_SMALLER,
    SHOWN_AGAIN,
    SYSTEMATIC,
    TIMING_MOVED,
)
from cosim.inference.held_out import HeldOutGain
from cosim.inference.noise import quietest
from fmus.contract import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """What was found in one group: a value, of which each step of the diagnosis makes another.

    Attributes:
        task: data, model and noise.
        null: the nominal model, trusted parameters fitted under their priors.
        chosen: the accepted set of effects (empty: the nominal model).
        single: every single effect, best first.
        rivals: for each accepted effect, sets that differ in that effect, best first.
        before, after: what free functions still explain, by signal.
        events: what is left at one time ("event") or one frequency ("line") only, by signal.
        signatures: effects seen in the raw samples.
        upstream: effects of the blocks before, with how far each explains the log worse than the accepted one.
        confirmed: held-out data have borne out the chosen effects.
        free: the nominal parameters are fitted freely, so nothing says how little the model must leave.
        reference: a linear model of free order beside the chosen effects.
        borne: name of an effect -> what it gains on held-out data, where these have decided.
        undecided: name of an effect -> what held-out data cannot tell from it, where these were asked.
        held_squares: (windows,) mean square of the free run's error on held-out data with the effects kept, SI.
        lacks_linear: the linear model is clearly better: linear dynamics are missing.
        lacks_curve: error of a free curve of the drive that does as well as this linear model, SI; 0 where there is none.
    """

    task: Task
    null: Trial
    chosen: Trial
    single: Sequence[Trial] = ()
    rivals: Mapping[str, Sequence[Trial]] = field(default_factory=dict)
    before: Mapping[str, Leftover] = field(default_factory=dict)
    after: Mapping[str, Leftover] = field(default_factory=dict)
    events: Mapping[str, Mapping[str, Event]] = field(default_factory=dict)
    signatures: Sequence[Signature] = ()
    upstream: Sequence[tuple[Effect, float]] = ()
    confirmed: bool = False
    free: bool = False
    reference: Reference | None = None
    borne: Mapping[str, HeldOutGain] = field(default_factory=dict)
    undecided: Mapping[str, Sequence[str]] = field(default_factory=dict)
    held_squares: Array | None = field(default=None, repr=False)
    lacks_linear: bool = False
    lacks_curve: float = 0.0

    def accept(self, chosen: Trial, record: Record) -> "Finding":
        """The finding with another set accepted, and what that leaves."""
        return replace(self, chosen=chosen, after=leftovers(self.task, record, chosen.fit))


def bases_of(task: Task, record: Record, found: Fit) -> dict[str, list[Basis]]:
    """Free functions for each signal of the group, its linear part as fitted."""
    own = task.model.group.linear
    values = {n: task.model.nominal(n) for n in own} | found.values
    return free_bases(record, task.model.group, values, task.predicted(found))


def leftovers(task: Task, record: Record, found: Fit) -> dict[str, Leftover]:
    """What free functions explain of a fit's residuals, by signal."""
    silent = {s: np.zeros_like(r) for s, r in found.residuals.items()}
    window = window_numbers(task)
    explained = {}
    for signal, bases in bases_of(task, record, found).items():
        white = partial(lambda signal, values: task.white(silent | {signal: values}), signal)
        explained[signal] = explain(found.residuals[signal], bases, task.rules[signal], white, window)
    return explained


def learn_noise(task: Task, record: Record, found: Fit) -> None:
    """Set the task's whitening rules from the part of the residuals that free functions do not explain."""
    task.retime(task.predicted(found), record.time)
    rules = {}
    for signal, bases in bases_of(task, record, found).items():
        # not of the path since a reversal: what friction's law lacks lies along it as well, and would pass for less noise
        smooth = (b.columns() for b in bases if not isinstance(b, Reversals))
        columns = chain.from_iterable([*smooth, task.discrepancy.get(signal, ())])
        least = quietest(task.measured[signal])
        rules[signal] = learned(task.rules[signal], found.residuals[signal], columns, least)
        if signal in task.steps:
            whole = task.measured[signal] - task.predicted(found)[signal]
            rules[signal] = rules[signal].larger(concentration(whole, task.steps[signal], rules[signal]))
    task.set_rules(rules)


def systematic(leftover: Leftover, negligible: float, noise: float) -> bool:
    """True if a residual holds something that is neither chance nor negligible (a size in the signal's unit).

    It must show again, and as strongly, in windows that had no share in finding it, unless no noise could explain that
    much, or it is larger than the noise of one bin (`noise`, in the signal's unit): windows that visit different regimes
    have little to say of each other, and what is nearly constant has been taken for slow noise.
    """
    again = leftover.held_out > max(SHOWN_AGAIN, AGAIN_SHARE * leftover.gain)
    sure = leftover.p_value < CERTAIN or leftover.rms > LARGE_REST * noise
    seen = again or (sure and leftover.gain > SHOWN_AGAIN)
    return leftover.p_value < SYSTEMATIC and leftover.rms > negligible and seen


def lacking(task: Task, record: Record, found: Fit) -> bool:
    """True if a fit leaves something that is no chance in a signal."""
    left = leftovers(task, record, found)
    return any(systematic(one, 0.0, task.rules[s].rms) for s, one in left.items())


def relearned(task: Task, record: Record, found: Fit) -> bool:
    """Learn the noise from a fit; True if it is smaller than was thought, otherwise the rules stay as they were.

    Likewise if the discrepancy of the timing has moved: what a late signal looks like depends on what is predicted.
    """
    rules, discrepancy = task.rules, task.discrepancy
    learn_noise(task, record, found)
    if any(task.rules[s].sigma < NOISE_SMALLER * rule.sigma for s, rule in rules.items()):
        return True
    if (
        task.late
        and np.linalg.norm(task.rows({s: d[0] - discrepancy[s][0] for s, d in task.discrepancy.items()}))
        > TIMING_MOVED
    ):
        return True
    task.discrepancy = discrepancy
    task.set_rules(rules)
    return False


def nominal_is_cause(finding: Finding) -> bool:
    """True if a nominal parameter is itself a cause: the null model has then moved it already and leaves nothing of it."""
    return bool(set(finding.task.model.group.trusted) & set(freed(finding.chosen.effects)))


def at_first(finding: Finding, signal: str) -> float:
    """Size of what the nominal model leaves in a signal beyond noise, SI; of one moved so, the change against nominal."""
    size, task = finding.before[signal].rms, finding.task
    if not nominal_is_cause(finding):
        return size
    change = task.residuals({})[signal] - finding.chosen.fit.residuals[signal]
    return max(size, float(np.sqrt(np.mean(centred(task.rules[signal], change) ** 2))))


def gained(finding: Finding) -> float:
    """Log-likelihood that the chosen effects gain over the nominal model; of one moved so, over the nominal parameters."""
    null = finding.null.fit.log_likelihood
    if nominal_is_cause(finding):
        white = finding.task.white(finding.task.residuals({}))
        null = min(null, -0.5 * float(white @ white))
    return finding.chosen.fit.log_likelihood - null
