"""A whole chain as one FMU: the components of a wiring file but the stimulus, with the coupling solved inside.

The order of stepping and of initialisation is that of our master (`cosim/master/order.py`), and each component gets what
its sources just computed, so that the container gives the numbers of the package under `cosim simulate`.
"""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from lxml import etree

from cosim.errors import ModelError, UsageError
from cosim.master.order import Order, step_order
from cosim.native.model import Model, Part, Row, Wire
from cosim.ssp import system
from cosim.ssp.write import NAMESPACES, STIMULUS, Values, read_values, read_xml
from fmus import registry
from fmus.build import checked_starts, composed_block
from fmus.compose import Composed
from fmus.contract import Variable

LONGEST = 55  # characters that Simulink takes for a parameter


def container(ssd_path: Path, name: str | None = None, values: Values | None = None) -> Model:
    """The model of a chain: input ``u`` where the stimulus was, all outputs, parameters named component.parameter.

    An output is named as in its component; where two components share the name, component_output.

    Args:
        ssd_path: the wiring; its parameter bindings give the nominal values.
        name: model identifier; by default the file's name and "_chain".
        values: what differs from the .ssv files: component -> parameter -> value, SI.

    Raises:
        ModelError: the wiring is bad, or a name is too long.
        UsageError: a value's component or parameter does not exist, or it is out of range.
    """
    root = read_xml(ssd_path)
    parts = read_parts(root, ssd_path, values or {})
    wires = read_wires(root, ssd_path, parts)
    order = order_of(parts, wires)
    rows, places = variables(parts, wires)
    too_long = [n for n, _, _ in rows if len(n) > LONGEST]
    if too_long:
        raise ModelError(
            f"{ssd_path.name}: '{too_long[0]}' has more than {LONGEST} characters, which Simulink refuses"
        )
    declared = {n: p.composed for n, p in parts.items()}
    outputs = [n for n, causality, _ in rows if causality == "output"]
    return Model(
        name=name or f"{ssd_path.stem}_chain",
        title=f"Chain of {', '.join(parts)}",
        parts=tuple(parts[n] for n in order.names),
        rows=rows,
        places=places,
        wires=tuple(wires),
        begin=order.names,
        loop=bool(order.delayed),
        feedthrough={n: ("u",) for n in outputs if acts(places[n], wires, declared)},
        step_size=min(p.composed.block.step_size for p in parts.values()),
    )


def read_parts(root: etree._Element, ssd_path: Path, values: Values) -> dict[str, Part]:
    """The components, in the order of the file, with their start values."""
    found: dict[str, Part] = {}
    for component in root.findall(".//ssd:Component", NAMESPACES):
        name, source = component.get("name", ""), component.get("source", "")
        if name == STIMULUS:
            continue
        stem = PurePosixPath(source).stem
        try:
            composed = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem)
        except KeyError as error:
            raise ModelError(f"{ssd_path.name}: component '{name}' runs {source}: {error.args[0]}") from None
        binding = component.find("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES)
        nominal = {} if binding is None else read_values(ssd_path.parent / binding.get("source", ""))
        found[name] = Part(name, composed, checked_starts(composed, nominal | dict(values.get(name, {}))))
    for name in values:
        if name not in found:
            raise UsageError(
                f"{ssd_path.name} has no component '{name}'; {registry.suggestion(name, list(found))}"
            )
    return found


def read_wires(root: etree._Element, ssd_path: Path, parts: Mapping[str, Part]) -> list[Wire]:
    """The connections; what the stimulus feeds, or the system's input, is fed by ``u``."""
    found = []
    for node in root.findall(".//ssd:Connection", NAMESPACES):
        start, output = node.get("startElement", ""), node.get("startConnector", "")
        end, entry = node.get("endElement", ""), node.get("endConnector", "")
        if not end:
            continue  # an output of the system
        if len(node):
            raise ModelError(
                f"{ssd_path.name}: the connection into {end}.{entry} converts values, which is not supported"
            )
        source = ("", "u") if start in ("", STIMULUS) else (start, output)
        if end not in parts or entry not in parts[end].composed.inputs:
            raise ModelError(f"{ssd_path.name}: there is no input {end}.{entry}")
        if source[0] and (start not in parts or output not in parts[start].composed.outputs):
            raise ModelError(f"{ssd_path.name}: there is no output {start}.{output}")
        found.append(Wire((end, entry), source))
    fed = {w.target for w in found}
    for name, part in parts.items():
        for entry in part.composed.inputs:
            if (name, entry) not in fed:
                raise ModelError(f"{ssd_path.name}: nothing feeds {name}.{entry}: connect it")
    return found


def order_of(parts: Mapping[str, Part], wires: list[Wire]) -> Order:
    """Order of stepping as our master has it; without a stimulus also that of initialisation."""
    inner = [system.Wire(system.Port(*w.source), system.Port(*w.target)) for w in wires if w.source[0]]
    return step_order({name: as_fmu(part.composed) for name, part in parts.items()}, inner)


def as_fmu(composed: Composed) -> system.Fmu:
    """What the master knows of a component's FMU when it orders the components."""
    kinds = [(n, "input") for n in composed.inputs] + [(n, "output") for n in composed.outputs]
    variables = {
        n: system.Variable(n, k, "Real", c, "continuous", "exact", None, "", "", 1.0, 0.0, 0.0, 0.0)
        for k, (n, c) in enumerate(kinds)
    }
    direct = {n: frozenset(composed.block.feedthrough.get(n, ())) for n in composed.outputs}
    return system.Fmu(composed.block.name, Path(), "", "", variables, direct, {}, None, True, None)


def variables(
    parts: Mapping[str, Part], wires: list[Wire]
) -> tuple[tuple[Row, ...], dict[str, tuple[str, str]]]:
    """Variables of the container, and the component and own name behind each output and parameter."""
    fed = [parts[w.target[0]].composed.inputs[w.target[1]] for w in wires if not w.source[0]]
    command = Variable(
        fed[0].unit, "Valve command", fed[0].start, max(v.low for v in fed), min(v.high for v in fed)
    )
    rows: list[Row] = [("u", "input", command)]
    places: dict[str, tuple[str, str]] = {}
    outputs = [(p.name, n, v) for p in parts.values() for n, v in p.composed.outputs.items()]
    for component, own, variable in outputs:
        shared = sum(1 for _, other, _ in outputs if other == own) > 1
        name = f"{component}_{own}" if shared else own
        places[name] = component, own
        rows.append((name, "output", variable))
    for part in parts.values():
        for own, variable in part.composed.parameters.items():
            places[f"{part.name}.{own}"] = part.name, own
            rows.append((f"{part.name}.{own}", "parameter", variable))
    return tuple(rows), places


def acts(place: tuple[str, str], wires: list[Wire], declared: Mapping[str, Composed]) -> bool:
    """True if the container's input acts on an output without a delay."""
    component, own = place
    for entry in declared[component].block.feedthrough.get(own, ()):
        source = next(w.source for w in wires if w.target == (component, entry))
        if not source[0] or acts(source, wires, declared):
            return True
    return False
