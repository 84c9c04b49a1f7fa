"""Reads an FMU: what it is, what its variables are, and whether this machine can run it."""

import hashlib
import math
import re
import struct
import sys
import zipfile
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import CoSimulation, ModelDescription, ModelVariable
from lxml import etree

from cosim.errors import ModelError
from cosim.ssp import binary
from cosim.ssp.archive import read_entry, unpack
from cosim.ssp.quantities import UnitDefinition, from_xml, misshown
from cosim.ssp.system import Fmu, Value, Variable
from cosim.ssp.xml import number, parse, safe_parser
from fmus.describe import AT_START, TOOL

# of FMI 3.0, as the kinds that FMI 2.0 has; an enumeration is set and got as an Int64
_KINDS = {
    "Float64": "Real",
    "Float32": "Real",
    "Enumeration": "Enumeration",
    "Boolean": "Boolean",
    "String": "String",
}
_WHOLE = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
KIND_OF = _KINDS | dict.fromkeys(_WHOLE, "Integer")
RUNS = ("2.0", "3.0")

_LIBRARY = re.compile(r"binaries/([^/]+)/([^/]+\.(?:so|dll|dylib))")

MENDED = "modelDescription.mended.xml"  # in an unpacked FMU: what was read where the original breaks a rule

# elements with numbers, and the format in which an FMU holds them
_FLOATS = {"Real": "<d", "Float64": "<d", "Float32": "<f", "Float64Type": "<d", "Float32Type": "<f"}

# FMI 2.0 table in section 2.2.7, FMI 3.0 in 2.4.7.5: the default of `initial` by causality, then variability
_INITIAL = {
    "parameter": {"fixed": "exact", "tunable": "exact"},
    "structuralParameter": {"fixed": "exact", "tunable": "exact"},
    "output": {"constant": "exact"},
    "local": {"constant": "exact"},
}


def load_fmu(archive: zipfile.ZipFile, source: str, folder: Path, ours: bool = False) -> Fmu:
    """Check an FMU, unpack it and read its description.

    Args:
        archive: the checked archive of the FMU.
        source: its name, for messages.
        folder: an empty folder to unpack it to.
        ours: this installation built it.

    Raises:
        ModelError: it is no co-simulation FMU of FMI 2.0 or 3.0, has no binary for this platform, or is damaged.
    """
    root = description_of(archive, source)
    version = version_of(root)
    if version not in RUNS:
        raise ModelError(
            f"{source} is an FMI {version or '(no version)'} FMU; only FMI 2.0 and 3.0 can be run: export it as one of these"
        )
    co_simulation = root.find("CoSimulation")
    if co_simulation is None:
        other = "scheduled execution" if root.find("ModelExchange") is None else "model exchange"
        raise ModelError(f"{source} is for {other} only: export it for co-simulation")
    units = _units(root, source)
    experiment = _experiment(root, source)
    _check_numbers(root, source)
    absent = _check_binary(archive, source, co_simulation.get("modelIdentifier", ""), version)
    unpack(archive, folder, source)
    description = described(folder, source)
    fmu = _fmu(description, source, folder, units, version, _inverse(root))
    return replace(
        fmu,
        keeps_state=fmu.keeps_state and not set(absent) & set(binary.STATE),
        start_time=experiment.get("startTime"),
        stop_time=experiment.get("stopTime"),
        step_size=experiment.get("stepSize"),
        tolerance=experiment["tolerance"] if experiment.get("tolerance", 0.0) > 0.0 else None,
        oddities=_oddities(description.coSimulation, source, _python_module(folder) is not None, absent),
        ours=ours,
        begins=_begins(root),
        house=root.get("generationTool", "").startswith(TOOL),
    )


def _begins(root: Any) -> frozenset[str]:
    """Inputs of which a step takes the value at its start: FMUs of ours say so in an annotation."""
    places = (f"VendorAnnotations/Tool[@name='{TOOL}']", f"Annotations/Annotation[@type='{TOOL}']")
    told = [node for place in places for node in root.iterfind(f"{place}/Input[@taken='{AT_START}']")]
    return frozenset(node.get("name", "") for node in told)


def version_of(root: Any) -> str:
    """The version of FMI that a description is of: a bugfix release of 3.0 is 3.0."""
    version: str = root.get("fmiVersion", "")
    return "3.0" if re.fullmatch(r"3\.0(\.\d+)?", version) else version


def description_of(archive: zipfile.ZipFile, source: str) -> Any:
    """Root element of an FMU's model description, checked for entities.

    Raises:
        ModelError: there is none, or it is bad.
    """
    return parse(read_entry(archive, "modelDescription.xml", source), f"{source}: modelDescription.xml")


def described(folder: Path, source: str) -> ModelDescription:
    """The model description in a folder, as fmpy reads it; call `description_of` before, which refuses what harms.

    Raises:
        ModelError: it cannot be read.
    """
    try:
        return fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:  # fmpy raises bare exceptions
        if "illegal combination" in str(error) and (mended := _mended(folder)) is not None:
            return mended
        raise ModelError(f"{source}: the model description cannot be read: {error}") from None


def _mended(folder: Path) -> ModelDescription | None:
    """The description with a variability that FMI allows for each parameter, or None if that does not help.

    Plain pythonfmu writes ``continuous`` for a parameter whose script names none.
    """
    tree = etree.parse(folder / "modelDescription.xml", safe_parser())
    for variable in tree.iterfind("ModelVariables/ScalarVariable"):
        if variable.get("causality") in ("parameter", "calculatedParameter") and variable.get(
            "variability", "continuous"
        ) not in ("fixed", "tunable"):
            variable.set("variability", "tunable")
    file = folder / MENDED
    tree.write(file)
    try:
        return fmpy.read_model_description(str(file), validate=False)
    except Exception:  # fmpy raises bare exceptions
        return None


def _units(root: Any, source: str) -> dict[str, UnitDefinition]:
    node = root.find("UnitDefinitions")
    return {} if node is None else from_xml(node, source)


def _inverse(root: Any) -> set[tuple[str, str]]:
    """Display units of FMI 3.0 that show the inverse (s for Hz), which are not shown: (unit, display unit)."""
    return {
        (unit.get("name", ""), display.get("name", ""))
        for unit in root.iterfind("UnitDefinitions/Unit")
        for display in unit.iterfind("DisplayUnit")
        if display.get("inverse") in ("true", "1")
    }


def _experiment(root: Any, source: str) -> dict[str, float]:
    """What the default experiment says: startTime, stopTime, tolerance, stepSize."""
    node, what = root.find("DefaultExperiment"), f"{source}: DefaultExperiment"
    if node is None:
        return {}
    names = ("startTime", "stopTime", "tolerance", "stepSize")
    found = {name: value for name in names if (value := number(node, name, what)) is not None}
    if "stepSize" in found and not found["stepSize"] > 0.0:
        raise ModelError(f"{what}: stepSize='{node.get('stepSize')}' is no step: it must be positive")
    if found.get("stopTime", math.inf) < found.get("startTime", 0.0):
        raise ModelError(f"{what}: stopTime='{node.get('stopTime')}' lies before the start")
    return found


def _check_numbers(root: Any, source: str) -> None:
    """Numbers of all variables and types, of those that are left out as well; a start value of FMI 3.0 may be a list."""
    for where, node in (
        (w, n) for w in ("ModelVariables", "TypeDefinitions") for n in root.iterfind(f"{w}//*")
    ):
        bits = _FLOATS.get(node.tag) if isinstance(node.tag, str) else None
        if bits is None:
            continue
        owner = node.getparent() if node.tag == "Real" else node
        what = "variable" if where == "ModelVariables" else "type"
        place = f"{source}: the {what} '{owner.get('name', '')}' has a bad number"
        for name in ("start", "min", "max", "nominal"):
            for text in node.get(name, "").split():
                try:
                    struct.pack(bits, float(text))  # what a Float32 cannot hold is infinite there
                    finite = math.isfinite(float(text))
                except OverflowError:
                    finite = False
                except ValueError:
                    raise ModelError(f"{place}: {name}='{text}' is no number: correct it") from None
                if not finite:
                    remedy = "leave it out" if name in ("min", "max") else "correct it"
                    raise ModelError(f"{place}: {name}='{text}' is no finite number: {remedy}")


def platform_of(version: str) -> str:
    """This machine as a version of FMI calls it."""
    return str(fmpy.platform_tuple if version.startswith("3.") else fmpy.platform)


def libraries(names: Iterable[str]) -> dict[str, list[str]]:
    """The platforms for which an archive with these entries has a library, and what these are called.

    Some exporters pack folders of platforms for which there is none.
    """
    held: dict[str, list[str]] = {}
    for found in filter(None, map(_LIBRARY.fullmatch, names)):
        held.setdefault(found[1], []).append(found[2])
    return held


def _check_binary(archive: zipfile.ZipFile, source: str, identifier: str, version: str) -> tuple[str, ...]:
    """Refuse an FMU without a library that runs here; the functions that this one lacks and is run without."""
    if not re.fullmatch(r"\w[\w.+ -]*", identifier, re.ASCII):
        raise ModelError(f"{source}: modelIdentifier='{identifier}' is no C identifier, which FMI demands")
    names = archive.namelist()
    platform = platform_of(version)
    wanted = f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}"
    if wanted in names:
        library = read_entry(archive, wanted, source)
        # linux64 of FMI 2.0 says no architecture: here it is the one that is to load it
        own = binary.architecture_of(fmpy.platform_tuple) if sys.platform == "linux" else None
        wrong = binary.problem(library, platform, version, own)
        if wrong:
            raise ModelError(f"{source}: the library '{wanted}' {wrong}: export or copy the FMU again")
        return binary.absent(library, version)
    held = libraries(names)
    if platform in held:
        raise ModelError(
            f"{source}: '{wanted}' is missing, the name that modelDescription.xml gives its library (modelIdentifier); that "
            f"folder has {', '.join(held[platform])}: export it again, or rename the library"
        )
    if held:
        raise ModelError(
            f"{source} has no binary for this platform ({platform}), only for {', '.join(sorted(held))}: "
            f"'{wanted}' is missing; export it for {platform}"
        )
    raise ModelError(f"{source} has no binary at all ('{wanted}' is missing): export it with binaries")


def promises_initial_outputs(fmu: Fmu) -> bool:
    """Whether an FMU names anything that it calculates before its first step, which FMI demands of one with outputs."""
    text = (fmu.folder / "modelDescription.xml").read_text(encoding="utf-8", errors="replace")
    outputs = any(v.causality == "output" and v.initial != "exact" for v in fmu.variables.values())
    return not outputs or "<InitialUnknown" in text


def _oddities(slave: CoSimulation, source: str, python: bool, absent: tuple[str, ...]) -> tuple[str, ...]:
    found = []
    if absent:
        found.append(
            f"{source}: its library exports no {', '.join(absent)}, which FMI 2.0 demands of every FMU; "
            "it is run all the same"
        )
    if not re.fullmatch(r"[A-Za-z_]\w*", slave.modelIdentifier, re.ASCII):
        found.append(
            f"{source}: modelIdentifier='{slave.modelIdentifier}' is no C identifier, which FMI demands; "
            "it is run all the same"
        )
    if (
        slave.needsExecutionTool and not python
    ):  # pythonfmu says so of all it makes, and means the Python that runs this
        found.append(
            f"{source} needs the tool that exported it (needsExecutionTool): where that is not installed it will not start"
        )
    return tuple(found)


def _fmu(
    description: ModelDescription,
    source: str,
    folder: Path,
    units: Mapping[str, UnitDefinition],
    version: str,
    inverse: Collection[tuple[str, str]],
) -> Fmu:
    shown = {
        (unit.name, display.name): (float(display.factor), float(display.offset))
        for unit in description.unitDefinitions
        for display in unit.displayUnits
        if (unit.name, display.name) not in inverse
    }
    wrong = [place for place, (factor, _) in shown.items() if misshown(*place, factor, units)]
    shown = {place: scale for place, scale in shown.items() if place not in wrong}
    variables: dict[str, Variable] = {}
    left_out = []
    for item in description.modelVariables:
        if item.name in variables:
            raise ModelError(f"{source} declares the variable '{item.name}' twice")
        if version != "2.0" and (item.dimensions or item.type not in KIND_OF):
            left_out.append(item.name)
            continue
        variables[item.name] = _variable(item, shown, source, version)
    dependencies = {
        unknown.variable.name: frozenset(v.name for v in unknown.dependencies)
        for unknown in description.outputs
        if unknown.dependencies is not None
    }
    # another name of an output depends on what that one does
    dependencies |= {
        v.name: dependencies[v.alias.name]
        for v in description.modelVariables
        if isinstance(v.alias, ModelVariable) and v.alias.name in dependencies
    }
    slave = description.coSimulation
    return Fmu(
        source=source,
        folder=folder,
        guid=description.guid,
        identifier=slave.modelIdentifier,
        variables=variables,
        dependencies=dependencies,
        units=units,
        step_size=None,
        variable_steps=bool(slave.canHandleVariableCommunicationStepSize),
        module=_python_module(folder),
        keeps_state=bool(slave.canGetAndSetFMUstate),
        version=version,
        left_out=tuple(left_out),
        misshown=tuple(f"'{display}' of '{unit}'" for unit, display in wrong),
    )


def _variable(
    item: ModelVariable, shown: Mapping[tuple[Any, Any], tuple[float, float]], source: str, version: str
) -> Variable:
    kind, called = item.type, "Integer" if item.type == "Enumeration" else item.type
    if version != "2.0":
        kind, called = KIND_OF[item.type], "Int64" if item.type == "Enumeration" else item.type
    causality = item.causality or "local"
    variability = item.variability or "continuous"
    if kind != "Real" and variability == "continuous" and causality in ("input", "output", "local"):
        variability = "discrete"  # FMI 2.0, section 2.2.7: only Real can be continuous
    declared = item.declaredType
    unit = item.unit or (declared.unit if declared else None) or ""
    display = item.displayUnit or (declared.displayUnit if declared else None) or ""
    factor, offset = shown.get((unit, display), (1.0, 0.0))
    if (unit, display) not in shown:
        display = ""  # a display unit without definition cannot be converted to
    low, high = (getattr(item, b) or (getattr(declared, b) if declared else None) for b in ("min", "max"))
    try:
        return Variable(
            name=item.name,
            reference=_reference(item.valueReference),
            kind=kind,
            type=called,
            causality=causality,
            variability=variability,
            initial=item.initial or _INITIAL.get(causality, {}).get(variability, "calculated"),
            start=parse_value(kind, item.start) if item.start is not None else None,
            unit=unit,
            display_unit=display,
            display_factor=factor,
            display_offset=offset,
            low=-math.inf if low is None else _no_nan(low),
            high=math.inf if high is None else _no_nan(high),
            description=item.description or "",
        )
    except ValueError as error:
        raise ModelError(f"{source}: the variable '{item.name}' has a bad number: {error}") from None


def _reference(text: str | int) -> int:
    """A value reference: an unsigned int of C."""
    value = int(text)
    if not 0 <= value < 1 << 32:
        raise ValueError(f"the value reference {value} is not from 0 to {(1 << 32) - 1}")
    return value


def _no_nan(text: str) -> float:
    value = float(text)
    if math.isnan(value):
        raise ValueError(f"{text} is no number")
    return value


def parse_value(kind: str, text: str) -> Value:
    """A value as XML writes it.

    Args:
        kind: Real, Integer, Enumeration, Boolean or String.
        text: the attribute.

    Raises:
        ValueError: the text is no value of that kind.
    """
    if kind == "Real":
        return _no_nan(text)
    if kind in ("Integer", "Enumeration"):
        return int(text)
    if kind == "Boolean":
        if text.strip() not in ("true", "false", "1", "0"):
            raise ValueError(f"'{text}' is not true or false")
        return text.strip() in ("true", "1")
    return text


def _python_module(folder: Path) -> tuple[str, str] | None:
    """Name and digest of the module a pythonfmu FMU imports; Python shares modules by name within a process."""
    marker = folder / "resources" / "slavemodule.txt"
    if not marker.is_file():
        return None
    name = marker.read_text(encoding="utf-8", errors="replace").strip()
    script = folder / "resources" / f"{name}.py"
    content = script.read_bytes() if script.is_file() else b""
    return name, hashlib.sha256(content).hexdigest()
