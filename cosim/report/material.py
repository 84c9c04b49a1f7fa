"""What a report is made from, gathered from a diagnosis."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.schema import Answer, NamedCause
from cosim.inference.pieces import Cuts, by_piece, slope
from cosim.lexicon import current
from cosim.logs.filter import low_pass_without_shift
from fmus import registry

if TYPE_CHECKING:
    from cosim.diagnosis.answer.experiment import Proposal
    from cosim.diagnosis.found import Diagnosis
    from cosim.diagnosis.record.record import Record
    from cosim.diagnosis.residuals.finding import Finding

Array = NDArray[np.float64]

MEASURED, NOMINAL, EXTENDED = "measured", "nominal", "extended"
BLOCK_NOMINAL, BLOCK_EXTENDED = "block_nominal", "block_extended"
KINDS = (MEASURED, NOMINAL, EXTENDED, BLOCK_NOMINAL, BLOCK_EXTENDED)


@dataclass(frozen=True)
class Noise:
    """How a block's residual is judged.

    Attributes:
        bins: samples averaged into one value.
        window: values in a window.
        free: True if each window has an offset of its own, which is then no error.
        rms: size of the noise of one value, SI.
    """

    bins: int
    window: int
    free: bool
    rms: float


@dataclass(frozen=True)
class Curve:
    """A free-form missing quantity over a signal.

    Attributes:
        label: "torque(omega)": what is missing, over what.
        gain: log-likelihood that it explains beyond chance.
        knots, values: (k,) SI.
    """

    label: str
    gain: float
    knots: Array
    values: Array


@dataclass(frozen=True)
class Part:
    """One group of blocks between two measured signals.

    Attributes:
        name: the group.
        drive: signal that drives it.
        noise: observed signal -> how its residual is judged.
        before, after: observed signal -> free-form curves of the nominal and the extended residual, strongest first.
    """

    name: str
    drive: str
    noise: dict[str, Noise]
    before: dict[str, list[Curve]]
    after: dict[str, list[Curve]]


@dataclass(frozen=True)
class Experiment:
    """The proposed experiment as two explanations predict it.

    Attributes:
        models: names of the two.
        h: step, s.
        command: (n,) SI.
        predicted: signal -> (2, n) SI.
        noise: signal -> how a residual is judged, as in the log.
        evidence: (n,) log-likelihood that each sample adds for the first, if it is true.
        drive: the signal that the command is.
    """

    models: tuple[str, str]
    h: float
    command: Array
    predicted: dict[str, Array]
    noise: dict[str, Noise]
    evidence: Array
    drive: str = "u"


@dataclass
class Material:
    """Everything a report shows.

    Attributes:
        answer: the diagnosis in the units people read.
        h: sample interval, s.
        series: kind -> signal -> (n,) SI. Kinds: measured; nominal and extended (FMUs on the command alone); block_nominal
            and block_extended (each group driven by what was measured); "without <effect>" (as block_extended, that
            effect off).
        parts: the groups that were judged.
        tracker: time (s), reading (rad) and raw stamps (s) of the external tracker, (m,) each; empty without one.
        folder: where the diagnosis lies, or None.
        experiment: the next experiment as predicted, or None.
        stamps: (n,) s, where the samples are not evenly spaced.
        other: measured, nominal and extended series of a held-out log.
        cuts: first sample of each log but the first, where several stand one behind the other.
    """

    answer: Answer
    h: float
    series: dict[str, dict[str, Array]]
    parts: dict[str, Part]
    tracker: dict[str, Array] = field(default_factory=dict)
    folder: Path | None = None
    experiment: Experiment | None = None
    stamps: Array | None = None
    other: "Material | None" = None
    cuts: Cuts = ()

    def smooth(self, values: Array, cutoff: float) -> Array:
        """Values (n,) without what lies above `cutoff` Hz, no phase shift, log by log."""
        return by_piece(lambda row: low_pass_without_shift(row, self.h, cutoff, order=3), self.cuts, values)

    def slopes(self, values: Array) -> tuple[Array, Array]:
        """First and second time derivative (n,) of a smooth signal, log by log."""
        first = slope(values, self.h, self.cuts)
        return first, slope(first, self.h, self.cuts)

    def at(self, samples: Array) -> Array:
        """Times of positions counted in samples, s."""
        if self.stamps is None:
            return samples * self.h
        return np.asarray(np.interp(samples, np.arange(self.stamps.size), self.stamps))

    @property
    def time(self) -> Array:
        """(n,) s, from zero."""
        if self.stamps is not None:
            return self.stamps
        return np.arange(len(next(iter(self.measured.values()))), dtype=np.float64) * self.h

    @property
    def measured(self) -> dict[str, Array]:
        """Measured signals, SI."""
        return self.series[MEASURED]

    def part_of(self, signal: str) -> Part | None:
        """The group that predicts a signal."""
        return next((p for p in self.parts.values() if signal in p.noise), None)

    def without(self, cause: NamedCause, signal: str) -> Array | None:
        """Prediction of a signal's group with everything but this cause, SI; None if it was not kept."""
        return self.series.get(f"without {cause.effect}", {}).get(signal)

    def nominal(self, name: str) -> float:
        """Nominal value of ``component.parameter``, SI."""
        if name in self.answer.words.values:
            return self.answer.words.values[name]
        component, _, parameter = name.partition(".")
        for effect in registry.effects().values():
            if effect.component == component and parameter in effect.parameters:
                return effect.parameters[parameter].start
        return registry.parameter(component, parameter).start

    def value(self, name: str, but: NamedCause | None = None) -> float:
        """Value of ``component.parameter`` in the extended model, SI.

        Args:
            name: the parameter.
            but: a cause that is taken away first: its parameters are nominal.
        """
        component, _, parameter = name.partition(".")
        for cause in self.answer.causes:
            if parameter in cause.parameters and component_of(cause) == component:
                return self.nominal(name) if cause is but else self.size(cause, parameter)
        if name in self.answer.nominal:
            item = self.answer.nominal[name]
            return item.value * current().to_si(
                item.unit,
                registry.parameter(component, parameter).unit,
            )
        return self.nominal(name)

    def size(self, cause: NamedCause, parameter: str) -> float:
        """Estimate of one of a cause's parameters, SI."""
        item = cause.parameters[parameter]
        effect = registry.effects()[cause.effect]
        variable = effect.parameters.get(parameter) or registry.parameter(effect.component, parameter)
        return item.value * current().to_si(item.unit, variable.unit)

    def named(self, effect: str) -> NamedCause | None:
        """The named cause of that effect, or None."""
        return next((c for c in self.answer.causes if c.effect == effect), None)


def component_of(cause: NamedCause) -> str:
    """The component whose parameters a cause changes."""
    effect = registry.effects().get(cause.effect)
    return effect.component if effect else cause.block


def gather(
    found: "Diagnosis", answer: Answer, folder: Path | None = None, proposal: "Proposal | None" = None
) -> Material:
    """The material of a diagnosis just made."""
    from cosim.diagnosis.verdict.verdict import names_of, what_stands

    series: dict[str, dict[str, Array]] = {
        MEASURED: dict(found.record.signals),
        NOMINAL: dict(found.before),
        EXTENDED: dict(found.after),
        BLOCK_NOMINAL: {},
        BLOCK_EXTENDED: {},
    }
    parts = {}
    for name, finding in found.findings.items():
        extended = what_stands(finding)
        series[BLOCK_NOMINAL] |= finding.task.predicted(finding.null.fit)
        series[BLOCK_EXTENDED] |= finding.task.predicted(extended.fit)
        parts[name] = part_of(name, finding)
    for cause in found.causes:
        if cause.group in found.findings:
            finding = found.findings[cause.group]
            off = {n: finding.task.model.nominal(n) for n in names_of(cause.effect).values()}
            series[f"without {cause.effect.name}"] = finding.task.model.simulate(
                finding.chosen.fit.values | off
            )
    experiment = None
    if proposal is not None and proposal.predicted:
        noise = {s: Noise(r.bins, r.window, r.demean, r.rms) for s, r in proposal.rules.items()}
        experiment = Experiment(
            proposal.models,
            1e-3,
            proposal.command,
            proposal.predicted,
            noise,
            proposal.evidence,
            proposal.drive,
        )
    stamps = stamps_of(found.record)
    made = Material(
        answer,
        found.record.h,
        series,
        parts,
        tracker_of(found),
        folder,
        experiment,
        stamps,
        cuts=found.record.cuts,
    )
    if found.held is not None and found.held_after:
        record = found.held.record
        kinds = {MEASURED: dict(record.signals), NOMINAL: found.held_before, EXTENDED: found.held_after}
        made.other = Material(answer, record.h, kinds, {}, stamps=stamps_of(record), cuts=record.cuts)
    return made


def stamps_of(record: "Record") -> Array | None:
    """Stamps of a log that is not evenly sampled."""
    if record.grid is None or np.ptp(np.diff(record.time)) <= 1e-9 * record.h:
        return None
    return record.time


def tracker_of(found: "Diagnosis") -> dict[str, Array]:
    """Readings of the external tracker on the log's clock and their raw stamps; empty without a tracker."""
    seen = getattr(found, "tracker", None)
    if seen is None:
        return {}
    offset, rate = seen.fit.values.get("tracker.offset", 0.0), seen.fit.values.get("tracker.rate", 1.0)
    return {"time": seen.time, "reading": seen.measured, "stamp": (seen.time - offset) / rate}


def part_of(name: str, finding: "Finding") -> Part:
    """Noise bands and curves of one group."""
    rules = {s: Noise(r.bins, r.window, r.demean, r.rms) for s, r in finding.task.rules.items()}
    both = [
        {
            s: [Curve(k, gain, *left.curves[k]) for k, gain in left.by_signal.items()][:4]
            for s, left in leftovers.items()
        }
        for leftovers in (finding.before, finding.after)
    ]
    return Part(name, finding.task.model.group.drive, rules, *both)
