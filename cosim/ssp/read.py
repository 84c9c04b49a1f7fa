"""Reads an SSP system (1.0 or 2.0, nested ones made flat), or a single FMU as a system of one component.

    with read_ssp(Path("system.ssp")) as system:
        print(system.components, system.wires)

Problems are collected, so that one reading names them all.
"""

import tempfile
import zipfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from lxml import etree

from cosim.errors import ModelError, UsageError
from cosim.paths import called
from cosim.ssp.archive import Budget, open_archive, read_entry, scratch_folder
from cosim.ssp.connect import connect
from cosim.ssp.effects import with_all_units
from cosim.ssp.flatten import flatten
from cosim.ssp.fmu import load_fmu
from cosim.ssp.hints import did_you_mean
from cosim.ssp.parameters import ParameterValue, bindings, fitted, local_source
from cosim.ssp.system import FOUND, NUMERIC, Component, Fmu, Port, System, SystemInput, Value, Wire
from cosim.ssp.xml import IN_SSD, number, parse
from cosim.trust import is_ours

DESCRIPTION = "SystemStructure.ssd"
FMU_TYPES = ("application/x-fmu-sharedlibrary", "")


def read_system(path: Path, parameter_set: str | None = None) -> System:
    """A system from an .ssp file, or from an .fmu file (one component, whose inputs are the system's).

    Args:
        path: the file.
        parameter_set: see `read_ssp`.

    Raises:
        ModelError: the file is bad; the message names all problems found.
        UsageError: the suffix is neither .ssp nor .fmu.
    """
    if path.suffix.lower() == ".fmu":
        return read_fmu(path)
    if path.suffix.lower() != ".ssp":
        raise UsageError(f"{path} is neither an .ssp nor an .fmu file")
    return read_ssp(path, parameter_set)


def read_ssp(path: Path, parameter_set: str | None = None) -> System:
    """An SSP system: components, wires, system connectors, parameter values.

    Args:
        path: the .ssp file.
        parameter_set: apply only the bindings whose ParameterSet has this name; by default all are applied.

    Raises:
        ModelError: the file is bad; the message names all problems found.
    """
    with ExitStack() as stack:
        folder, note = scratch_folder()
        stack.callback(folder.cleanup)
        budget = Budget()
        with open_archive(path, str(path), budget) as archive, ExitStack() as nested:
            system = _Reader(path, archive, folder, parameter_set, budget, nested).read()
        stack.pop_all()  # from here on the system owns the folder
    if note:
        system.notes.append(note)
    return system


def read_fmu(path: Path) -> System:
    """An FMU as a system of one component named like the file, with all its inputs that are numbers as system inputs.

    Raises:
        ModelError: the FMU is bad or cannot run here.
    """
    with ExitStack() as stack:
        folder, note = scratch_folder()
        stack.callback(folder.cleanup)
        shown = Path(called(path))
        with open_archive(path, str(path)) as archive:
            target = Path(folder.name, "c0")
            fmu = load_fmu(archive, shown.name, target, ours=is_ours(path))
        name = shown.stem.replace(".", "_")  # the first dot of a signal's name ends the component's
        wires = {
            v.name: Wire(Port("", v.name), Port(name, v.name))
            for v in fmu.variables.values()
            if v.causality == "input" and v.kind in NUMERIC
        }
        inputs = {n: SystemInput(n, fmu.variables[n].unit, (wire,)) for n, wire in wires.items()}
        outputs = {
            v.name: Port(name, v.name)
            for v in fmu.variables.values()
            if v.causality == "output" and v.kind == "Real"
        }
        component = Component(name, fmu, {})
        stack.pop_all()
    notes = ([note] if note else []) + remarks(fmu)
    return System(
        name,
        path,
        {name: component},
        (),
        inputs,
        outputs,
        notes=notes,
        start_time=fmu.start_time,
        stop_time=fmu.stop_time,
        folder=folder,
    )


def remarks(fmu: Fmu) -> list[str]:
    """What the user should know of variables that are not read, or not shown as their FMU asks."""
    found = []
    if fmu.left_out:
        found.append(
            f"arrays, clocks and binary data are left out and keep their start values: {_few(fmu.left_out)}"
        )
    if fmu.misshown:
        found.append(
            f"display units whose factor contradicts their name are not used, numbers are shown in the unit itself: "
            f"{_few(fmu.misshown)}"
        )
    return [f"{fmu.source}: {text}" for text in found]


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


class _Reader:
    """State of one reading: what is found, and what is wrong."""

    def __init__(
        self,
        path: Path,
        archive: zipfile.ZipFile,
        folder: "tempfile.TemporaryDirectory[str]",
        parameter_set: str | None,
        budget: Budget,
        nested: ExitStack,
    ) -> None:
        self.path, self.archive, self.folder, self.wanted = path, archive, folder, parameter_set
        self.budget, self.nested = budget, nested
        self.archives: dict[str, tuple[zipfile.ZipFile, bool]] = {}
        self.problems: list[str] = []
        self.notes: list[str] = []
        self.fmus: dict[str, Fmu] = {}
        self.set_names: set[str] = set()
        self.found: set[str] = set()

    def read(self) -> System:
        root = parse(read_entry(self.archive, DESCRIPTION, str(self.path)), DESCRIPTION)
        if root.tag != f"{IN_SSD}SystemStructureDescription":
            raise ModelError(
                f"{self.path}: {DESCRIPTION} is no SSP 1.0 system: its root element is {root.tag}"
            )
        version = root.get("version", "")
        if not version.startswith(("1.", "2.")):
            raise ModelError(f"{self.path}: SSP version '{version}' is not supported: only 1.x and 2.x")
        node = root.find(f"{IN_SSD}System")
        if node is None:
            raise ModelError(f"{self.path}: {DESCRIPTION} holds no System")
        try:
            flatten(node)
        except ModelError as error:
            raise ModelError(f"{self.path}: {error}") from None
        components = self.components(node)
        self.stop_if_bad()
        connected = connect(node, components, self.problems, self.notes)
        self.stop_if_bad()
        system = System(
            node.get("name", ""),
            self.path,
            components,
            *connected,
            found=self.found,
            notes=self.notes,
            folder=self.folder,
        )
        self.apply_system_values(node, system)
        self.check_set_name()
        self.check_modules(components)
        self.stop_if_bad()
        experiment = root.find(f"{IN_SSD}DefaultExperiment")
        if experiment is not None:
            what = f"{self.path}: {DESCRIPTION}: DefaultExperiment"
            system.start_time = number(experiment, "startTime", what)
            system.stop_time = number(experiment, "stopTime", what)
        self.note_open_inputs(system)
        with_all_units(system)
        return system

    def stop_if_bad(self) -> None:
        if self.problems:
            raise ModelError(f"{self.path}: " + "; ".join(self.problems))

    def components(self, system: etree._Element) -> dict[str, Component]:
        found: dict[str, Component] = {}
        elements = system.find(f"{IN_SSD}Elements")
        for element in [] if elements is None else elements:
            if not isinstance(element.tag, str):
                continue
            name, kind = element.get("name", ""), etree.QName(element).localname
            if kind != "Component":
                self.problems.append(
                    f"'{name}' is a {kind}; only systems of FMUs are supported: put an FMU in its place"
                )
                continue
            if name in found:
                self.problems.append(f"two components are named '{name}'")
                continue
            try:
                found[name] = self.component(element, name)
            except ModelError as error:
                self.problems.append(str(error))
        if not found and not self.problems:
            self.problems.append("the system has no components")
        return found

    def component(self, element: etree._Element, name: str) -> Component:
        kind, source = element.get("type", FMU_TYPES[0]), element.get("source", "")
        if kind not in FMU_TYPES or source.lower().endswith((".ssp", ".ssd")):
            raise ModelError(
                f"component '{name}' is of type {kind or source}; only FMUs and systems of the same file are supported"
            )
        if "." in name:
            raise ModelError(
                f"component '{name}': a dot in the name makes '{name}.variable' ambiguous: rename it"
            )
        entry = local_source(source, f"component '{name}'")
        archive, ours = self.opened(entry, name)
        fmu = self.fmus.get(entry)
        if fmu is None:
            folder = Path(self.folder.name, f"c{len(self.fmus)}")
            fmu = load_fmu(archive, entry, folder, ours)
            self.fmus[entry] = fmu
            self.notes += remarks(fmu)
        if element.get("implementation", "any") == "ModelExchange":
            self.notes.append(
                f"component '{name}': model exchange is asked for; the FMU is run for co-simulation, with its own solver"
            )
        starts: dict[str, Value] = {}
        for value in self.chosen(bindings(element, self.archive, archive, f"component '{name}'")):
            if value.name in fmu.variables:
                starts[value.name] = fitted(value, fmu.variables[value.name], fmu, f"component '{name}'")
                self.found |= {f"{name}.{value.name}"} if value.set_name == FOUND else set()
            else:
                self.ignored(value, f"component '{name}'", list(fmu.variables))
        return Component(name, fmu, starts)

    def opened(self, entry: str, name: str) -> tuple[zipfile.ZipFile, bool]:
        """An FMU's archive within the package, opened and counted once however many components it has; is it ours?"""
        if entry not in self.archives:
            data = read_entry(self.archive, entry, f"component '{name}'")
            archive = self.nested.enter_context(open_archive(data, entry, self.budget))
            self.archives[entry] = archive, is_ours(data)
        return self.archives[entry]

    def chosen(self, sets: Sequence[tuple[str, list[ParameterValue]]]) -> list[ParameterValue]:
        self.set_names |= {label for label, _ in sets}
        return [v for label, values in sets if self.wanted in (None, label) for v in values]

    def ignored(self, value: ParameterValue, what: str, known: list[str]) -> None:
        """SSP 1.0 ignores names it does not find; silently would hide a misspelling."""
        if value.name in known:
            self.notes.append(
                f"the value '{value.name}' of the parameter set '{value.set_name}' is for a connector of {what} that leads "
                "to no component, and is ignored: connect it"
            )
            return
        self.notes.append(
            f"the value '{value.name}' of the parameter set '{value.set_name}' matches nothing in {what} and is ignored"
            f"{did_you_mean(value.name, known)}"
        )

    def apply_system_values(self, node: etree._Element, system: System) -> None:
        try:
            values = self.chosen(bindings(node, self.archive, None, "system"))
            apply_values(system, values, lambda v, known: self.ignored(v, "the system", known))
        except ModelError as error:
            self.problems.append(str(error))

    def check_set_name(self) -> None:
        if self.wanted is not None and self.wanted not in self.set_names:
            known = ", ".join(f"'{n}'" for n in sorted(self.set_names)) or "none"
            self.problems.append(f"there is no parameter set named '{self.wanted}'; the system has {known}")

    def check_modules(self, components: dict[str, Component]) -> None:
        seen: dict[str, tuple[str, str]] = {}
        for component in components.values():
            if component.fmu.module is None:
                continue
            name, digest = component.fmu.module
            source, other = seen.setdefault(name, (component.fmu.source, digest))
            if digest != other:
                self.problems.append(
                    f"{source} and {component.fmu.source} both bring a Python module '{name}' with different content; "
                    "in one process the second would silently run the first one's code: rename a script and build it again"
                )

    def note_open_inputs(self, system: System) -> None:
        fed = {wire.target for wire in system.wires} | {
            wire.target for item in system.inputs.values() for wire in item.targets
        }
        known = system.places(fed)
        for component in system.components.values():
            for variable in component.fmu.variables.values():
                port = Port(component.name, variable.name)
                if variable.causality == "input" and (component.name, variable.reference) not in known:
                    start = component.starts.get(variable.name, variable.start)
                    system.notes.append(
                        f"input {port} is not connected and keeps its start value {start!r} {variable.unit}".rstrip()
                    )


def apply_values(
    system: System, values: Sequence[ParameterValue], ignored: Callable[[ParameterValue, list[str]], None]
) -> None:
    """Give values with system-level names (connector, or ``component.variable``) to the components, in order.

    Raises:
        ModelError: a value does not fit its variable.
    """
    for value in values:
        targets = resolve(system, value.name)
        for port in targets:
            component = system.components[port.component]
            variable = component.fmu.variables[port.variable]
            start = fitted(value, variable, component.fmu, f"component '{port.component}'")
            for wire in system.inputs[value.name].targets if value.name in system.inputs else ():
                if wire.target == port:
                    start = wire.factor * float(start) + wire.offset
            system.components[port.component] = replace(
                component, starts={**component.starts, port.variable: start}
            )
        if not targets:
            ignored(value, settable_names(system))


def resolve(system: System, name: str) -> tuple[Port, ...]:
    """The components' variables that a system-level name stands for; empty if there is none."""
    if name in system.parameters:
        return system.parameters[name]
    if name in system.inputs:
        return tuple(wire.target for wire in system.inputs[name].targets)
    component, dot, variable = name.partition(".")
    while dot:  # a component of a nested system: drive.part.K is drive_part.K
        if component in system.components and variable in system.components[component].fmu.variables:
            return (Port(component, variable),)
        more, dot, variable = variable.partition(".")
        component = f"{component}_{more}"
    return ()


def settable_names(system: System) -> list[str]:
    """All system-level names that can be given a value."""
    names = [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if v.can_be_set
    ]
    return names + list(system.parameters) + list(system.inputs)
