"""Which model a log is held against: one of ours by name, or a package of the same structure with values of its own."""

from collections.abc import Sequence
from pathlib import Path

from cosim.compare.mapping import CompareTable, load_mapping
from cosim.diagnosis.model.groups import COMPONENT_VALUES, MODELS
from cosim.diagnosis.model.machine import Machine, machine_for, our_machine
from cosim.diagnosis.model.options import Options, options_of
from cosim.errors import ModelError, UsageError
from cosim.logs import Log, listed
from cosim.logs.mapping import Mapping as LogMapping
from cosim.machines import made_for
from cosim.ssp.read import read_system
from cosim.ssp.system import Component
from fmus import registry

DEFAULT = "full_order"


def chosen(asked: str | None, of_log: str | None) -> tuple[str, dict[str, float]]:
    """The structure to judge by, and what its values differ in from nominal.

    Args:
        asked: name of a model or path of an .ssp, as the user gave it.
        of_log: the same, as the mapping of the log names it.

    Returns:
        Name of the model, and ``component.parameter`` -> SI.

    Raises:
        UsageError: no such model.
        ModelError: the package is bad, or its components are not those of one of our models.
    """
    name = asked or (of_log if of_log in MODELS or (of_log or "").endswith(".ssp") else None) or DEFAULT
    if name in MODELS:
        return name, {}
    if not name.lower().endswith(".ssp"):
        raise UsageError(
            f"no model '{name}' for the diagnosis; {registry.suggestion(name, list(MODELS))}, or a file .ssp"
        )
    with read_system(Path(name)) as system:
        for model, groups in MODELS.items():
            stages = dict(stage for group in groups for stage in group.stages)
            found = {
                n: c for n, c in system.components.items() if n in stages and c.fmu.identifier == stages[n]
            }
            if found.keys() == stages.keys():
                return model, differing(stages, {name: own_values(c) for name, c in found.items()})
        known = "; ".join(
            f"{m}: {', '.join(c for g in groups for c in g.components)}" for m, groups in MODELS.items()
        )
        raise ModelError(
            f"{name}: its components {', '.join(system.components)} are not those of a model that can be diagnosed ({known})"
        )


def machine_of(asked: str | None, logs: Log | Sequence[Log], mapping: Path | None) -> Machine:
    """The model to hold logs against: as asked for, as their mapping names it, or the crane.

    Args:
        asked: name of a model or path of an .ssp or .ssd, as the user gave it.
        logs: the log, or several of one machine.
        mapping: the mapping file with which they were read.

    Raises:
        UsageError: no such model.
        DataError, ModelError: the mapping or the model is bad.
    """
    log = listed(logs)[0]
    if mapping is not None:
        plain, table = load_mapping(mapping)
        if plain.machine and asked is None:
            made = made_for(mapping, logs)
            return machine_for(made.ssd, log, plain, made.table, options_of(made.diagnose, mapping))
        named = asked or log.model or DEFAULT
        if named in MODELS or named.lower().endswith(".ssd"):
            return machine_for(named, log, plain, table, options_of(plain.diagnose, mapping))
    if asked is not None and asked.lower().endswith(".ssd"):
        return machine_for(asked, log, LogMapping.model_construct(signals={}), CompareTable(), Options())
    return our_machine(*chosen(asked, log.model))


def own_values(component: Component) -> dict[str, float]:
    """Numeric parameters of a component as its package sets them."""
    starts = {n: v.start for n, v in component.fmu.variables.items() if v.causality == "parameter"} | dict(
        component.starts
    )
    return {n: float(v) for n, v in starts.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}


def differing(blocks: dict[str, str], values: dict[str, dict[str, float]]) -> dict[str, float]:
    """``component.parameter`` -> SI of what is not as its block declares it; the start angle comes from the log.

    Args:
        blocks: component -> block.
        values: component -> parameter -> SI.
    """
    found = {}
    for component, own in values.items():
        block = registry.block(blocks[component])
        for name, variable in block.parameters.items():
            nominal = COMPONENT_VALUES.get(f"{component}.{name}", variable.start)
            if name in own and name != "theta_0" and own[name] != nominal:
                found[f"{component}.{name}"] = own[name]
    return found
