"""Material for the pictures without a diagnosis: a rig log, and the truth in the place of what a diagnosis would find."""

from pathlib import Path
from typing import Any

import numpy as np

from cosim.diagnosis.answer.schema import Answer, NamedCause, Parameter, Signal, Unexplained
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.trials import declared
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.record.record import Record, fixed_values
from cosim.report.material import Curve, Material, Noise, Part
from cosim.rig import Hidden, make_log
from cosim.units import factor
from fmus import registry

FULL_ORDER = MODELS["full_order"]


def empty_answer(**changes: Any) -> Answer:
    """An answer that says nothing, but for `changes`; what the lead adds to it is filled with empty values."""
    plain: dict[str, Any] = {}
    for name, item in Answer.model_fields.items():
        if not item.is_required():
            continue
        kind = str(item.annotation)
        plain[name] = [] if kind.startswith("list") else {} if kind.startswith("dict") else None
    plain |= {"verdict": "explained", "synthetic": True, "model": "full_order"}
    return Answer.model_validate(plain | changes)


def named(effect: str, values: dict[str, float], spread: float = 0.02) -> NamedCause:
    """A named cause with these sizes (SI) and intervals of a relative half-width."""
    found = registry.effects()[effect]
    parameters = {}
    for name, value in values.items():
        variable = declared(found, name)
        unit = variable.display or variable.unit
        shown = value * factor(variable.unit, unit)
        wide = spread * abs(shown)
        parameters[name] = Parameter(value=shown, unit=unit, ci95=(shown - wide, shown + wide))
    return NamedCause(
        effect=effect,
        block=found.block,
        parameters=parameters,
        evidence={},
        rivals=[],
        indistinguishable_from=[],
    )


def material_of(run: Any, causes: list[NamedCause], folder: Path | None = None) -> Material:
    """Material of a rig log as a diagnosis that found `causes` exactly would leave it."""
    signals = dict(run.signals) | {"p_load": run.p_a - run.p_b}
    record = Record(1e-3, signals)
    sizes = {}
    for cause in causes:
        effect = registry.effects()[cause.effect]
        for name, item in cause.parameters.items():
            sizes[f"{effect.component}.{name}"] = (
                cause.effect,
                item.value * factor(item.unit, declared(effect, name).unit),
            )
    series: dict[str, dict[str, Any]] = {
        "measured": signals,
        "nominal": {},
        "extended": {},
        "block_nominal": {},
        "block_extended": {},
    }
    parts = {}
    for group in FULL_ORDER:
        model = GroupModel(group, signals[group.drive], record.h, fixed_values(record, group))
        own = {}
        for name, (effect, value) in sizes.items():
            try:
                model.nominal(name)
            except KeyError:
                continue
            own[name] = (effect, value)
        nominal = model.simulate({})
        extended = model.simulate({n: v for n, (_, v) in own.items()})
        for kind, found in (("nominal", nominal), ("extended", extended)):
            series[kind] |= found
            series[f"block_{kind}"] |= found
        for cause in causes:
            if cause.effect in [e.name for e in group.effects()]:
                series[f"without {cause.effect}"] = model.simulate(
                    {n: v for n, (e, v) in own.items() if e != cause.effect}
                )
        noise = {
            s: Noise(10, 500, group.name != "dcv", float(np.std(signals[s] - extended[s]) / 3.0))
            for s in group.observed
        }
        parts[group.name] = Part(group.name, group.drive, noise, {}, {})
    shown = {s: Signal(rmse=1.0, fit_percent=50.0, unit="1", noise_floor=0.1) for s in series["nominal"]}
    answer = empty_answer(causes=causes, signals=shown, made={"log": "test", "log_sha256": "0" * 64})
    tracker = {}
    if run.tracker is not None:
        stamps, angle = run.tracker
        offset, rate = (sizes.get(f"tracker.{n}", ("", d))[1] for n, d in (("offset", 0.0), ("rate", 1.0)))
        instants = offset + rate * stamps
        inside = (instants >= 0.0) & (instants <= run.time[-1])
        tracker = {"time": instants[inside], "reading": angle[inside], "stamp": stamps[inside]}
    return Material(answer, record.h, series, parts, tracker, folder)


def hidden_material(
    effect: str, excitation: str = "mixed", duration: float = 30.0, also: tuple[str, ...] = (), **options: Any
) -> Material:
    """Material of a log in which an effect of moderate size (and others, by name) is hidden."""
    wanted = [Hidden(name) for name in (effect, *also)]
    run = make_log(excitation, duration, wanted, seed=3, **options)
    causes = []
    for item in wanted:
        values = {n.partition(".")[2]: v for n, v in item.numbers().items()}
        causes.append(named(item.effect, values))
    return material_of(run, causes)


def friction_with_rest() -> Material:
    """Material of a partly explained log: friction is named, a torque over the angle is left."""
    material = hidden_material("mechanical.coulomb_friction")
    curve = Curve("torque(theta)", 99.0, np.array([0.1, 0.2, 0.3]), np.array([0.0, 20.0, -20.0]))
    part = material.parts["mechanical"]
    material.parts["mechanical"] = Part(
        part.name, part.drive, part.noise, {"slew": [curve]}, {"slew": [curve]}
    )
    rest = Unexplained(
        block="mechanical",
        what="a missing torque that depends on theta is left in slew",
        residual_rms=0.1,
        unit="deg",
    )
    material.answer = material.answer.model_copy(
        update={"verdict": "partly_explained", "unexplained": [rest]}
    )
    return material
