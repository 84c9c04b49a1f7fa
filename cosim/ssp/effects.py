"""The small FMUs that a diagnosis puts into the wires of an extended model, and where its signals are read there.

Their names end with the port and the place that they are made for: ``gain_plant_y_output`` stands behind ``plant.y``.
"""

from dataclasses import replace

from cosim.ssp.system import Port, System

FRICTION = "port_friction"
IDENTIFIERS = ("port_effect", FRICTION)  # of such FMUs


def kind_of(port: Port) -> str:
    """A port in the name of an effect's component."""
    return "".join(c if c.isalnum() else "_" for c in f"{port.component}_{port.variable}")


def effects_at(system: System, port: Port, *places: str) -> list[str]:
    """The components that hold an effect at a port, made for one of these places: input, output or sensor."""
    ends = tuple(f"_{kind_of(port)}_{place}" for place in places)
    return [
        name
        for name, part in system.components.items()
        if part.fmu.identifier in IDENTIFIERS and name != port.component and name.endswith(ends)
    ]


def read_at(system: System, port: Port) -> Port:
    """Where an extended model has what is measured at a port: behind the effects at an output, before those at an input."""
    if port.component not in system.components:
        return port
    entering = system.variable(port).causality == "input"
    here = port
    for place in ("input",) if entering else ("output", "sensor"):
        left = effects_at(system, port, place)
        while following := [
            n
            for n in left
            if any(
                (w.target == here and w.source == Port(n, "y"))
                if entering
                else (w.source == here and w.target == Port(n, "u"))
                for w in system.wires
            )
        ]:
            here = Port(following[0], "u" if entering else "y")
            left.remove(following[0])
    return here


def follows_motion(system: System, port: Port) -> bool:
    """Whether an input is that by which friction follows an output: a loop of the model's own, which no reading cuts."""
    return system.components[port.component].fmu.identifier == FRICTION and port.variable == "x"


def with_unit(system: System, port: Port) -> None:
    """Give the effects at a port its unit, in place: they hand on what it is in."""
    unit = system.variable(port).unit
    for name in effects_at(system, port, "input", "output", "sensor"):
        part = system.components[name]
        ends = {n: replace(part.fmu.variables[n], unit=unit) for n in ("u", "y")}
        fmu = replace(part.fmu, variables={**part.fmu.variables, **ends})
        system.components[name] = replace(part, fmu=fmu)


def with_all_units(system: System) -> None:
    """`with_unit` for all ports of a system as it is read."""
    if not any(part.fmu.identifier in IDENTIFIERS for part in system.components.values()):
        return
    for name, part in list(system.components.items()):
        for variable in part.fmu.variables.values():
            if variable.unit and variable.causality in ("input", "output"):
                with_unit(system, Port(name, variable.name))
