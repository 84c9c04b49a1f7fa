"""All groups of a model one behind the other, driven by the command alone: simulated, and fitted together."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.chain import observed_of
from cosim.diagnosis.fitting.fit import Fit, Task, Unknown, fit
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.trials import anchored, unknowns
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.grid import of_piece, plain_name
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.record.signatures import coarse_steps
from fmus.contract import Effect

Array = NDArray[np.float64]


class ChainModel(GroupModel):
    """All groups of a model one behind the other, driven by the command alone."""

    def __init__(self, groups: tuple[Group, ...], record: Record, fixed: dict[str, float]) -> None:
        self.groups = groups
        drive = groups[0].drive
        self.models = [GroupModel(g, record.signals[drive], record.h, fixed, record.grid) for g in groups]
        own = record.pieces if record.cuts else []
        self.parts = [ChainModel(groups, piece, of_piece(fixed, i)) for i, piece in enumerate(own)]
        self.fixed = self.models[0].fixed
        self.h = record.h
        self.grid = record.grid
        self.group = Group(
            "chain",
            tuple(s for g in groups for s in g.stages),
            drive,
            tuple(s for g in groups for s in g.observed),
            trusted=tuple(n for g in groups for n in g.trusted),
            scale=groups[0].scale,
        )

    def nominal(self, name: str) -> float:
        """Value of ``component.parameter`` before anything is estimated."""
        for model in self.models:
            try:
                return model.nominal(name)
            except KeyError:
                continue
        raise KeyError(name)

    def trust(self, name: str, tolerance: float) -> tuple[float, float, float]:
        """As that of the group that has the parameter."""
        component = name.partition(".")[0]
        owner = next(m for m in self.models if component in m.group.components)
        return owner.trust(name, tolerance)

    def simulate(self, values: dict[str, float]) -> dict[str, Array]:
        """Predicted signals of all groups, each driven by the one before."""
        if self.parts:
            each = [part.simulate(of_piece(self.fixed | values, i)) for i, part in enumerate(self.parts)]
            return {s: np.concatenate([found[s] for found in each]) for s in each[0]}
        signals: dict[str, Array] = {}
        drive = self.models[0].drive
        for model in self.models:
            if model.drive is not drive:
                if not np.array_equal(model.drive, drive):
                    model.kept.clear()
                model.drive = drive
            found = model.simulate(values)
            signals |= found
            drive = found[model.group.observed[0]]
        return signals


def fitted_chain(
    groups: tuple[Group, ...],
    record: Record,
    rules: Mapping[str, Whitener],
    effects: tuple[Effect, ...],
    near: Mapping[str, float],
    fixed: dict[str, float],
    tolerance: float,
    mask: NDArray[np.bool_] | None,
    constants: Mapping[str, float] | None = None,
) -> Fit:
    """Trusted parameters, causes and start angle fitted together to all signals, driven by the command alone.

    Args:
        groups: the groups of the model, in order.
        record: the log.
        rules: signal -> whitening rule, as learned group by group.
        effects: the named causes.
        near: where the search begins.
        fixed: start angle.
        tolerance: trust in the nominal parameters.
        mask: windows to fit on.
        constants: ``component.parameter`` -> SI that is known already.
    """
    model = ChainModel(groups, record, fixed | dict(constants or {}))
    measured: dict[str, Array] = {}
    lost: dict[str, NDArray[np.bool_]] = {}
    for group in groups:
        own, stale = observed_of(group, record)
        measured |= {s: v for s, v in own.items() if s in rules}
        lost |= stale
    # here the absolute angle counts: the command carries no noise that could drift
    absolute = {s: whole_run(r) for s, r in rules.items()}
    task = Task(model, measured, absolute, mask=mask, steps=coarse_steps(measured, record.cuts), lost=lost)
    wanted, _ = unknowns(model, effects, tolerance)
    placed = anchored(wanted, near)
    for name, value in ((n, v) for n, v in fixed.items() if plain_name(n).endswith(".theta_0")):
        size = dict(groups[0].scale).get("rad", 1.0)
        placed.append(
            Unknown(name, value, 1e-4 * size, value - 0.1 * size, value + 0.1 * size, (value, 5e-4 * size))
        )
    return fit(task, placed, rounds=15)


def whole_run(rule: Whitener) -> Whitener:
    """The rule for a run that the command alone drives: no offsets, and the start counts."""
    return replace(rule, demean=False, skip=0, propagated=None)
