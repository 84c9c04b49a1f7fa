"""What both exports need of a system: its FMU files, wires, values, step and stop time, checked before they write."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import fmpy

from cosim.errors import ModelError, UsageError
from cosim.files import write_bytes
from cosim.master.order import acts_directly, step_order
from cosim.ssp.archive import open_archive, read_entry
from cosim.ssp.read import resolve
from cosim.ssp.system import Component, Fmu, Port, System, Value, Variable, Wire

DEFAULT_STEP = 1e-3
DEFAULT_STOP = 10.0


@dataclass(frozen=True)
class ExportedFmu:
    """An FMU file of the system.

    Attributes:
        stem: name of the file without suffix, as in the package.
        fmu: its description.
        data: the bytes of the .fmu file.
        inputs, outputs: its ports, in the order of the declarations.
        listed_outputs: its outputs in the order of ModelStructure.
        direct: inputs that an output may depend on without a delay.
        platforms: for which it has a binary, as FMI names them.
    """

    stem: str
    fmu: Fmu
    data: bytes
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    listed_outputs: tuple[str, ...]
    direct: frozenset[str]
    platforms: tuple[str, ...]

    @property
    def runs_python(self) -> bool:
        """Whether it starts a Python interpreter in the host."""
        return self.fmu.module is not None

    @property
    def exported(self) -> list[Variable]:
        """What a model of it has: parameters, inputs, outputs."""
        return [*self.parameters, *self.inputs, *self.outputs]

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """Its parameters that can be set, in the order of the declarations."""
        return tuple(
            v
            for v in self.fmu.variables.values()
            if v.causality == "parameter" and v.variability != "constant"
        )


@dataclass(frozen=True)
class ExportedModel:
    """A system ready for export.

    Attributes:
        system: components, wires, connectors.
        fmus: by the name of the FMU in the package, in the order of the components.
        order: components in the order our master steps them.
        delayed: wires that close a loop; our master hands over last step's value.
        late: wires whose source is discrete; our master hands over the value at the start of a step.
        step: communication step [s].
        start, stop: of the experiment [s].
    """

    system: System
    fmus: Mapping[str, ExportedFmu]
    order: tuple[str, ...]
    delayed: frozenset[Wire]
    late: frozenset[Wire]
    step: float
    start: float
    stop: float

    def values(self, component: Component) -> dict[str, Value]:
        """The parameters that the package gives a component, in the order of the declarations."""
        names = [v.name for v in self.fmus[component.fmu.source].parameters]
        return {name: component.starts[name] for name in names if name in component.starts}

    def start_of(self, port: Port) -> Value:
        """The value that an input has before anything drives it."""
        variable = self.system.variable(port)
        value = self.system.components[port.component].starts.get(port.variable, variable.start)
        if value is not None:
            return value
        return "" if variable.kind == "String" else 0

    def is_held(self, name: str) -> bool:
        """Whether a system input is held over a step, as our master does: the command u, and what FMUs declare discrete."""
        ports = [wire.target for wire in self.system.inputs[name].targets]
        return name == "u" or (
            bool(ports) and all(self.system.variable(p).variability == "discrete" for p in ports)
        )

    def open_ports(self) -> list[Port]:
        """Inputs that neither a component nor a system input drives; they keep their start value."""
        fed = {w.target for w in self.system.wires}
        fed |= {w.target for item in self.system.inputs.values() for w in item.targets}
        ports = [Port(c.name, v.name) for c in self.system.components.values() for v in self.inputs_of(c)]
        return [port for port in ports if port not in fed]

    def inputs_of(self, component: Component) -> tuple[Variable, ...]:
        """The input ports of a component."""
        return self.fmus[component.fmu.source].inputs

    @property
    def runs_python(self) -> bool:
        """Whether any FMU starts a Python interpreter in the host."""
        return any(item.runs_python for item in self.fmus.values())

    @property
    def platforms(self) -> tuple[str, ...]:
        """Platforms for which every FMU has a binary."""
        sets = [set(item.platforms) for item in self.fmus.values()]
        return tuple(sorted(set.intersection(*sets)))


def prepare(
    system: System,
    values: Mapping[str, Value] | None = None,
    step: float | None = None,
    stop: float | None = None,
) -> ExportedModel:
    """Collect what an export needs.

    Args:
        system: as read; its FMUs stay unpacked while the export is written.
        values: further start values by system-level name, in the units of the FMUs.
        step: communication step [s]; by default the smallest that an FMU asks for, or 1 ms.
        stop: end of the experiment [s]; by default that of the system, or 10 s after its start.

    Raises:
        ModelError: an FMU cannot be read from the package, or two FMUs have files of the same name.
        UsageError: step or stop make no sense.
    """
    for name, value in (values or {}).items():
        for port in resolve(system, name):
            system.components[port.component] = _with(system.components[port.component], port.variable, value)
    start = system.start_time or 0.0
    chosen = (step or system.step_size or DEFAULT_STEP) if step is None or step > 0.0 else 0.0
    end = stop if stop is not None else system.stop_time or start + DEFAULT_STOP
    if chosen <= 0.0 or end - start < chosen:
        raise UsageError(
            f"a step of {step if step is not None else chosen:g} s from {start:g} s to {end:g} s makes no simulation: "
            "give a positive --step-size, and a --stop-time at least one step after the start"
        )
    late = frozenset(w for w in system.wires if system.variable(w.source).variability == "discrete")
    components = {c.name: c.fmu for c in system.components.values()}
    order = step_order(components, [w for w in system.wires if w not in late])
    return ExportedModel(
        system=system,
        fmus=_read_fmus(system),
        order=order.names,
        delayed=frozenset(order.delayed),
        late=late,
        step=chosen,
        start=start,
        stop=end,
    )


def _with(component: Component, name: str, value: Value) -> Component:
    return Component(component.name, component.fmu, {**component.starts, name: value})


def refuse_other_versions(model: ExportedModel) -> None:
    """Refuse FMUs that what is exported could not call.

    Raises:
        ModelError: one is not of FMI 2.0.
    """
    for item in model.fmus.values():
        if item.fmu.version != "2.0":
            raise ModelError(
                f"{model.system.path}: {item.fmu.source} is of FMI {item.fmu.version}, and what is exported calls FMI 2.0: "
                "take the same FMU of FMI 2.0"
            )


def _read_fmus(system: System) -> dict[str, ExportedFmu]:
    found: dict[str, ExportedFmu] = {}
    stems: dict[str, str] = {}
    for component in system.components.values():
        fmu = component.fmu
        if fmu.source in found:
            continue
        stem = PurePosixPath(fmu.source).stem
        other = stems.setdefault(stem.lower(), fmu.source)
        if other != fmu.source:
            raise ModelError(
                f"{system.path}: '{other}' and '{fmu.source}' would be the same file '{stem}.fmu' in the export: rename one"
            )
        found[fmu.source] = _exported(stem, fmu, _data(system, fmu))
    return found


def _data(system: System, fmu: Fmu) -> bytes:
    if system.path.suffix.lower() == ".fmu":
        return system.path.read_bytes()
    with open_archive(system.path, str(system.path)) as archive:
        return read_entry(archive, fmu.source, str(system.path))


def _exported(stem: str, fmu: Fmu, data: bytes) -> ExportedFmu:
    ports = {
        kind: tuple(v for v in fmu.variables.values() if v.causality == kind) for kind in ("input", "output")
    }
    description = fmpy.read_model_description(str(fmu.folder), validate=False)
    with open_archive(data, fmu.source) as archive:
        platforms = _platforms(archive, fmu.identifier)
    return ExportedFmu(
        stem=stem,
        fmu=fmu,
        data=data,
        inputs=ports["input"],
        outputs=ports["output"],
        listed_outputs=tuple(unknown.variable.name for unknown in description.outputs),
        direct=frozenset(v.name for v in ports["input"] if acts_directly(fmu, v.name)),
        platforms=platforms,
    )


def _platforms(archive: zipfile.ZipFile, identifier: str) -> tuple[str, ...]:
    entries = [PurePosixPath(name).parts for name in archive.namelist() if name.startswith("binaries/")]
    return tuple(sorted({p[1] for p in entries if len(p) == 3 and PurePosixPath(p[2]).stem == identifier}))


def write_files(folder: Path, files: Mapping[str, bytes], overwrite: bool) -> list[Path]:
    """Write an export into a folder of its own.

    Args:
        folder: made if it does not exist.
        files: content by relative path.
        overwrite: whether the folder may hold other files, and files of the same name be replaced.

    Returns:
        The files written, in the order given.

    Raises:
        UsageError: the folder holds other files, or cannot be written to.
    """
    try:
        held = sorted(item.name for item in folder.iterdir()) if folder.exists() else []
        if held and not overwrite:
            shown = ", ".join(held[:5]) + (", ..." if len(held) > 5 else "")
            raise UsageError(
                f"the folder '{folder}' already holds files ({shown}): name an empty one, or give --overwrite"
            )
        written = []
        for name, data in files.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(target, data)
            written.append(target)
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return written
