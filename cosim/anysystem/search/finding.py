"""What was found in one group: sets of causes with their fits, and what is handed on of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import PARAMETER, Action
from cosim.anysystem.model import SHIFT, GroupModel
from cosim.anysystem.readings import Grid, Stale
from cosim.inference.between import Between
from cosim.inference.freeform import Explained
from cosim.inference.held_out import HeldOutGain
from cosim.inference.problem import Fit, Problem
from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port

Array = NDArray[np.float64]


@dataclass
class Candidate:
    """A set of causes with its fit."""

    actions: tuple[Action, ...]
    fit: Fit
    price: float
    score: float = 0.0


@dataclass
class Trust:
    """What is known of the parameters.

    Attributes:
        trusted: ``component.parameter`` -> (value, relative deviation).
        free: those that are fitted with every cause -> value.
        tolerance: relative deviation of one of which nothing is said.
    """

    trusted: dict[str, tuple[float, float]] = field(default_factory=dict)
    free: dict[str, float] = field(default_factory=dict)
    tolerance: float = 0.01


@dataclass
class Finding:
    """What was found in a group.

    Attributes:
        model, problem: how it was judged.
        null: without causes.
        chosen: with those that are named, estimated on the whole log.
        fitted: the same as the fitted windows alone have it, by which gains are measured.
        nearest: with the causes that explain most, even if they leave too much to be named.
        alike: for each named cause, others that explain the log alike.
        rivals: for each, (action, log-likelihood behind).
        held: for each, what it gains on windows held out.
        told: signal of each log -> what inputs still tell of the residual with the causes.
        before: the same without causes.
        floors: signal -> noise floor.
        spreads: signal -> standard deviation of its reading.
        free: free parameters -> (value, standard deviation).
        settled: parameters that are no causes as the extended model has them -> (value, standard deviation): trusted ones
            within their tolerance, and free ones beside the causes.
        between: numbers of the causes, by `Action.key` or ``parameter|...`` -> what several logs say of them one by one.
        unexplained: signals that stay wrong, with words.
        twins: for each named cause, those of `alike` that were fitted, with all values of the model; other effects
            first.
        twin_unknowns: (cause, twin) -> what was fitted with the twin.
        never: causes that the log could not have shown even at a moderate size, with that size.
        read: causes that the readings show by themselves.
        bent: trusted parameters at the limit of what is trusted, where no cause is named.
        instead: the cause that comes nearest then.
        refused: causes that the fitted windows ask for and the held-out ones do not bear out, with words.
    """

    model: GroupModel
    problem: Problem
    null: Candidate
    chosen: Candidate
    fitted: Candidate | None = None
    nearest: Candidate | None = None
    alike: dict[Action, list[Action]] = field(default_factory=dict)
    rivals: dict[Action, list[tuple[Action, float]]] = field(default_factory=dict)
    held: dict[Action, HeldOutGain] = field(default_factory=dict)
    gains: dict[Action, float] = field(default_factory=dict)
    told: dict[str, Explained] = field(default_factory=dict)
    before: dict[str, Explained] = field(default_factory=dict)
    floors: dict[str, float] = field(default_factory=dict)
    spreads: dict[str, float] = field(default_factory=dict)
    free: dict[str, tuple[float, float]] = field(default_factory=dict)
    settled: dict[str, tuple[float, float]] = field(default_factory=dict)
    between: dict[str, Between] = field(default_factory=dict)
    unexplained: dict[str, str] = field(default_factory=dict)
    twins: dict[Action, list[tuple[Action, dict[str, float]]]] = field(default_factory=dict)
    twin_unknowns: dict[tuple[Action, Action], tuple[Unknown, ...]] = field(default_factory=dict)
    never: dict[Action, dict[str, float]] = field(default_factory=dict)
    read: dict[Action, Grid | Stale] = field(default_factory=dict)
    bent: tuple[str, ...] = ()
    instead: Action | None = None
    refused: list[tuple[Action, str]] = field(default_factory=list)

    @property
    def named(self) -> tuple[Action, ...]:
        """The causes."""
        return (*self.chosen.actions, *self.read)


def parameter(name: str) -> Action:
    """Another value of ``component.parameter``."""
    return Action(PARAMETER, Port(*name.split(".", 1)))


def renumbered(actions: Sequence[Action]) -> bool:
    """Whether causes are other numbers of the model, and no other law."""
    return all(action.effect == PARAMETER for action in actions)


def moments(problem: Problem) -> list[str]:
    """Nuisances that are the moments within a sample at which a log was read: of all, these alone are no simulation's."""
    return [u.name for u in problem.nuisances_shared if u.name.startswith(f"{SHIFT}:")]


def errors(finding: Finding, values: Mapping[str, float]) -> dict[str, Array]:
    """Measured minus what the model does by itself."""
    with finding.problem.sharing(moments(finding.problem)):
        return finding.problem.residuals(values)


def extended(finding: Finding, candidate: Candidate) -> dict[str, float]:
    """Values of the extended model: the causes, and what was settled beside them."""
    return candidate.fit.values | {f"{PARAMETER}|{n}": v for n, (v, _) in finding.settled.items()}


def worth(finding: Finding) -> float:
    """How well a finding's causes explain the group's readings, less the price of what they take; for another drive.

    Every tenth sample counts as independent: what is left is coloured.
    """
    residual = finding.problem.residuals(finding.chosen.fit.values)
    size = 0.0
    for signal, _ in finding.model.group.judged:
        own = finding.model.whole(residual, signal)
        left = max(float(np.sqrt(np.mean(own**2))), 1e-9 * finding.spreads[signal])
        size += own.size / 10.0 * float(np.log(left))
    return -size - finding.chosen.price
