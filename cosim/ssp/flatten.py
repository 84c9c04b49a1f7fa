"""A package with systems within systems as a flat one: each nested system gives way to its components.

A component ``part`` of a system ``drive`` is called ``drive_part`` (a dot would be read as the end of a component's name).
Values bound to a nested system come before those of the systems around it, which so take priority (SSP 1.0, 5.3.1).
"""

from copy import deepcopy

from lxml import etree

from cosim.errors import ModelError
from cosim.ssp.xml import IN_SSD


def flatten(system: etree._Element, what: str = "the system") -> None:
    """Put the components of all nested systems in their place, in an ``ssd:System`` as it is.

    Raises:
        ModelError: two components would have one name, or a connection cannot be taken through a nested system.
    """
    for nested in list(system.iterfind(f"{IN_SSD}Elements/{IN_SSD}System")):
        flatten(nested, f"system '{nested.get('name', '')}'")
        _lift(system, nested, what)


def _lift(system: etree._Element, nested: etree._Element, what: str) -> None:
    name = nested.get("name", "")
    elements = _part(system, "Elements")
    taken = {e.get("name") for e in elements if e is not nested}
    for component in list(nested.iterfind(f"{IN_SSD}Elements/*")):
        flat = f"{name}_{component.get('name', '')}"
        if flat in taken:
            raise ModelError(
                f"{what} has a component '{flat}' beside the system '{name}' of that part: rename one"
            )
        component.set("name", flat)
        elements.append(component)
    elements.remove(nested)
    _rewire(system, nested, name)
    bindings = _part(system, "ParameterBindings", before=("Elements", "Connections"))
    for place, binding in enumerate(
        list(nested.iterfind(f"{IN_SSD}ParameterBindings/{IN_SSD}ParameterBinding"))
    ):
        binding.set("prefix", f"{name}_{binding.get('prefix', '')}")
        bindings.insert(place, binding)


def _rewire(system: etree._Element, nested: etree._Element, name: str) -> None:
    """Join what meets at the connectors of a nested system, and take its own wires over."""
    wires = _part(system, "Connections")
    inside: dict[str, list[tuple[etree._Element, str]]] = {}
    for wire in list(nested.iterfind(f"{IN_SSD}Connections/{IN_SSD}Connection")):
        inner = [end for end in ("start", "end") if wire.get(f"{end}Element")]
        for end in inner:
            wire.set(f"{end}Element", f"{name}_{wire.get(f'{end}Element')}")
        if len(inner) == 2:
            wires.append(wire)
        elif not inner:
            raise ModelError(f"the system '{name}' joins two connectors of its own, which is not supported")
        else:
            outer = "end" if inner == ["start"] else "start"
            inside.setdefault(wire.get(f"{outer}Connector", ""), []).append((wire, inner[0]))
    for wire in list(wires):
        for end in ("start", "end"):
            if not isinstance(wire.tag, str) or wire.get(f"{end}Element") != name:
                continue
            place = list(wires).index(wire)
            wires.remove(wire)
            for k, (within, its) in enumerate(inside.get(wire.get(f"{end}Connector", ""), ())):
                wires.insert(place + k, _joined(wire, end, within, its, name))
            break


def _joined(wire: etree._Element, end: str, within: etree._Element, its: str, name: str) -> etree._Element:
    """A wire whose one end is a connector of a nested system, with the end of the wire within in its place."""
    found = deepcopy(wire)
    for attribute in ("Element", "Connector"):
        found.set(f"{end}{attribute}", within.get(f"{its}{attribute}", ""))
    if within.get("suppressUnitConversion") in ("true", "1"):
        found.set("suppressUnitConversion", "true")
    more = [
        deepcopy(child) for child in within if isinstance(child.tag, str) and "Transformation" in child.tag
    ]
    if more and any(isinstance(c.tag, str) and "Transformation" in c.tag for c in found):
        raise ModelError(
            f"a signal is transformed on both sides of the connector '{wire.get(f'{end}Connector')}' of the system "
            f"'{name}', which is not supported"
        )
    found.extend(more)
    return found


def _part(system: etree._Element, tag: str, before: tuple[str, ...] = ()) -> etree._Element:
    """The child of a system with this tag, made where it is not there."""
    found = system.find(f"{IN_SSD}{tag}")
    if found is None:
        found = etree.Element(f"{IN_SSD}{tag}")
        later = next(
            (c for c in system if isinstance(c.tag, str) and etree.QName(c).localname in before), None
        )
        system.insert(len(system) if later is None else list(system).index(later), found)
    return found
