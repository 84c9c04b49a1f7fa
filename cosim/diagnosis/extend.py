"""The extended model: all blocks fitted together with the named causes, and written as packages other clients can run."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.data import Record
from cosim.diagnosis.fit import Fit, Task, Unknown, fit
from cosim.diagnosis.groups import Group, GroupModel
from cosim.diagnosis.naming import unknowns
from cosim.diagnosis.noise import Whitener
from cosim.paths import ssp_folder
from cosim.ssp.write import values_xml, write_ssp
from fmus import registry
from fmus.build import composed_block
from fmus.contract import Effect, Variable

Array = NDArray[np.float64]


class ChainModel(GroupModel):
    """All groups of a model one behind the other, driven by the command alone."""

    def __init__(self, groups: tuple[Group, ...], record: Record, fixed: dict[str, float]) -> None:
        self.groups = groups
        self.models = [GroupModel(g, record.signals["u"], record.h, fixed) for g in groups]
        self.fixed = self.models[0].fixed
        self.h = record.h
        self.group = Group(
            "chain",
            tuple(s for g in groups for s in g.stages),
            "u",
            tuple(s for g in groups for s in g.observed),
        )

    def nominal(self, name: str) -> float:
        """Value of ``component.parameter`` before anything is estimated."""
        for model in self.models:
            try:
                return model.nominal(name)
            except KeyError:
                continue
        raise KeyError(name)

    def simulate(self, values: dict[str, float]) -> dict[str, Array]:
        """Predicted signals of all groups, each driven by the one before."""
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
    measured = {s: record.signals[s] for s in rules}
    # here the absolute angle counts: the command carries no noise that could drift
    absolute = {s: Whitener(r.bins, r.window, False, r.sizes) for s, r in rules.items()}
    task = Task(model, measured, absolute, mask=mask)
    wanted, _ = unknowns(model, effects, tolerance)
    placed = [Unknown(u.name, near.get(u.name, u.start), u.scale, u.low, u.high, u.prior) for u in wanted]
    for name, value in fixed.items():
        placed.append(Unknown(name, value, 1e-4, value - 0.1, value + 0.1, (value, 5e-4)))
    return fit(task, placed, rounds=15)


def by_component(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """``component.parameter`` -> value, grouped by component."""
    found: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        component, _, parameter = name.partition(".")
        found.setdefault(component, {})[parameter] = value
    return found


def write_values(grouped: Mapping[str, Mapping[str, float]], file: Path) -> Path:
    """Write all values as one .ssv with names ``component.parameter``."""
    declared: dict[str, Variable] = {}
    values: dict[str, float] = {}
    for component, own in grouped.items():
        block = registry.FMU_OF_COMPONENT.get(component, component)
        known = composed_block(block, component).parameters
        declared |= {f"{component}.{name}": known[name] for name in own}
        values |= {f"{component}.{name}": value for name, value in own.items()}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(values_xml(declared, values))
    return file


def write_extended(
    model: str, values: Mapping[str, float], folder: Path, stimulus: bytes | None
) -> dict[str, Path]:
    """Write the extended packages: open (for our runner), and closed with the log's command inside."""
    ssd = ssp_folder() / f"{model}.ssd"
    grouped = by_component(values)
    paths = {"open": write_ssp(ssd, folder / "extended_open.ssp", values=grouped, open=True)}
    if grouped:
        paths["ssv"] = write_values(grouped, folder / "extended.ssv")
    if stimulus is not None:
        paths["closed"] = write_ssp(ssd, folder / "extended.ssp", values=grouped, stimulus=stimulus)
    return paths
