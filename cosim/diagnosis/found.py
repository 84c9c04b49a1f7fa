"""What a diagnosis has found so far; it grows stage by stage, so that an interruption leaves what was done."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import noise_floor
from cosim.diagnosis.budget import Budget
from cosim.diagnosis.held_out.causes import Held, Refused, Steps
from cosim.diagnosis.held_out.gain import Gain
from cosim.diagnosis.labels import Contradiction
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.record.grid import window_span
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.residuals.reference import Fitted, Reference
from cosim.diagnosis.thresholds import LESS_THAN_NOISE
from cosim.diagnosis.tracker.comparison import TrackerFinding
from cosim.diagnosis.verdict.verdict import Cause, Rest, floor_of
from cosim.inference.between import Between
from cosim.inference.linear import LinearModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Elsewhere:
    """A part of a long log in which the extended model errs more than in the stretch that the fits used.

    Attributes:
        signal: the signal.
        start, end: s of the log's own time.
        log: its name.
        ratio: its error over that in the stretch.
    """

    signal: str
    start: float
    end: float
    ratio: float
    log: str = ""


@dataclass
class Diagnosis:
    """Everything the diagnosis found.

    Attributes:
        verdict: "adequate", "explained", "partly_explained", "unexplained" or "implausible_data"; "interrupted" until all is
            judged.
        record: the prepared log, or the stretch of it that the fits use.
        machine: the model.
        groups: its groups, as far as this log tells them apart.
        findings: group -> what was found in it, for the groups that could be judged.
        unjudged: group -> the signals whose absence keeps it from being judged.
        sparse: group -> why so sparse a log says nothing of it.
        data: labels of the log that its data contradict; nothing else is judged then.
        causes: named causes, the largest gain first.
        rests: what stays unexplained.
        never: effects that the log would not surely have shown.
        at_rest: nothing moves in the log, so that it could have shown none.
        values: ``component.parameter`` -> value of the extended model, SI.
        deviations: standard deviation of those estimated.
        correlations: of the estimates, by pairs.
        start: the start angle.
        before, after: signals of the nominal and the extended model's FMUs on the log's command.
        gains: signal -> error on held-out windows.
        drafts: files of the extended model as they were made, which do not say yet what they rest on.
        packages: the same where they lie, complete.
        tracker: what the external tracker says, if there was one.
        held: the part of the log, or the other log, on which gains are measured; None for every third window.
        held_before, held_after: as before, after, over the held-out log.
        in_place: the linear model that the extended model has in the place of the blocks, where they lack its dynamics.
        references: signal -> the linear reference from the command to it, beside the extended model.
        linear: (drive, signal) -> linear model of a free run over the fitted log, or over the windows of it that do not
            judge, as far as one was needed.
        calibrated: trusted parameters fitted without any cause, where they were freed: what the extension is held against.
        refused: causes that the fitting log asks for and the held-out one does not bear out.
        sets: group -> the data that judge its causes, and the sets of causes that they have judged.
        spans: start and end of the stretch of each log that was used, s of the log's own time.
        between: ``component.parameter`` -> what several logs say of it one by one; empty for one log.
        top_speeds: ``component.parameter`` of a limit -> the speed at it, where the log tells that and hardly the limit.
        elsewhere: where in the rest of the log the extended model errs more.
        failed: group -> why it could not be judged although its signals were measured.
        notes: what else failed by itself and is missing.
        stage: the stage that runs, or in which it was interrupted; empty when all is done.
        budget: the time allowed, and what was not tried because it was over.
    """

    verdict: str
    record: Record
    machine: Machine
    groups: tuple[Group, ...]
    findings: dict[str, Finding] = field(default_factory=dict)
    unjudged: dict[str, list[str]] = field(default_factory=dict)
    sparse: dict[str, str] = field(default_factory=dict)
    data: list[Contradiction] = field(default_factory=list)
    causes: list[Cause] = field(default_factory=list)
    rests: list[Rest] = field(default_factory=list)
    never: list[str] = field(default_factory=list)
    at_rest: bool = False
    values: dict[str, float] = field(default_factory=dict)
    deviations: dict[str, float] = field(default_factory=dict)
    correlations: dict[tuple[str, str], float] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    before: dict[str, Array] = field(default_factory=dict)
    after: dict[str, Array] = field(default_factory=dict)
    gains: dict[str, Gain] = field(default_factory=dict)
    drafts: dict[str, Path] = field(default_factory=dict)
    packages: dict[str, Path] = field(default_factory=dict)
    tracker: TrackerFinding | None = None
    held: Held | None = None
    held_before: dict[str, Array] = field(default_factory=dict)
    held_after: dict[str, Array] = field(default_factory=dict)
    refused: list[Refused] = field(default_factory=list)
    sets: dict[str, tuple[Held, Steps]] = field(default_factory=dict, repr=False)
    calibrated: dict[str, float] = field(default_factory=dict)
    in_place: LinearModel | None = None
    references: dict[str, Reference] = field(default_factory=dict)
    linear: Fitted = field(default_factory=dict)
    spans: tuple[tuple[float, float], ...] = ()
    between: dict[str, Between] = field(default_factory=dict)
    top_speeds: dict[str, Between] = field(default_factory=dict)
    elsewhere: list[Elsewhere] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    stage: str = ""
    budget: Budget = field(default_factory=Budget)

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.machine.name

    @property
    def noise(self) -> dict[str, float]:
        """Signal -> size of its noise per sample, SI: what is left where everything is explained."""
        floors = {s: floor_of(f, s) for f in self.findings.values() for s in f.task.rules}
        if self.in_place is not None:
            # what it leaves of a signal that never rests is less than what the blocks leave; at rest both leave nothing
            for s in floors.keys() & self.after.keys():
                measured = self.record.signals[s]
                left = noise_floor(measured - self.after[s], self.record.h)
                floors[s] = min(floors[s], max(left, self.record.rounding(s)))
        for s in floors.keys() & self.gains.keys():
            if 0.0 < self.gains[s].after < LESS_THAN_NOISE * floors[s]:
                floors[s] = self.gains[s].after
        return floors

    @property
    def window(self) -> int:
        """Samples in a window: those of the fits, so that what they left out is what is judged."""
        for finding in self.findings.values():
            for rule in finding.task.rules.values():
                return rule.bins * rule.window
        return round(window_span(self.record.h) / self.record.h)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a diagnosis; it carries what had been found until then.

    Attributes:
        found: the findings of the groups that were finished, and whatever followed.
    """

    def __init__(self, found: Diagnosis) -> None:
        super().__init__(f"interrupted: {found.stage}")
        self.found = found
