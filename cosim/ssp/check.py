"""Everything that is wrong with an .ssp or .fmu file: the standards' schemas, then what a schema cannot see."""

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

from cosim.errors import ModelError
from cosim.paths import unsafe_characters
from cosim.ssp import binary
from cosim.ssp.archive import open_archive, read_entry
from cosim.ssp.parameters import local_source, read_ssv, units_of
from cosim.ssp.quantities import contradiction
from cosim.ssp.read import DESCRIPTION, read_fmu, read_ssp
from cosim.ssp.system import Fmu, System
from cosim.ssp.xml import IN_SSD, parse, safe_parser, schema_problems

EVERY = tuple(name for name in dir(FMU3Slave) if name.startswith("fmi3"))  # function of FMI 3.0


@dataclass(frozen=True)
class Problem:
    """One finding.

    Attributes:
        severity: "error": the file breaks the standard or cannot be run; "warning": some clients stumble over it.
        where: the file or element.
        text: what is wrong, and the remedy.
    """

    severity: Literal["error", "warning"]
    where: str
    text: str

    def __str__(self) -> str:
        named = self.text.startswith((f"{self.where}:", f"{self.where} "))
        return f"{self.severity}: {'' if named else f'{self.where}: '}{self.text}"


def check_ssp(path: Path) -> list[Problem]:
    """Check an SSP package: schemas of wiring and values, every FMU, and the system as a whole.

    Returns:
        The problems found; none for a package that every client accepts.
    """
    try:
        with open_archive(path, str(path)) as archive:
            problems = list(_schema_findings(archive))
    except ModelError as error:
        return [Problem("error", path.name, str(error))]
    try:
        with read_ssp(path) as system:
            problems += [Problem("warning", path.name, note) for note in system.notes]
            problems += _fmu_findings(system)
            problems += _name_findings(system)
    except ModelError as error:
        problems.append(Problem("error", path.name, str(error)))
    return problems + _path_findings(path)


def check_fmu(path: Path) -> list[Problem]:
    """Check an FMU: the schema and rules of FMI (by fmpy), and whether it can run here.

    Returns:
        The problems found; none for an FMU that every client accepts.
    """
    try:
        with read_fmu(path) as system:
            problems = _fmu_findings(system)
            problems += [Problem("warning", path.name, note) for note in system.notes]
    except ModelError as error:
        return [Problem("error", path.name, str(error))]
    return problems + _path_findings(path)


def check_ssv(path: Path) -> list[Problem]:
    """Check a parameter set against its schema, and that its values can be read.

    Returns:
        The problems found.
    """
    try:
        values = read_ssv(path)
        root = parse(path.read_bytes(), path.name)
        known = units_of(root, path.name)
    except ModelError as error:
        return [Problem("error", path.name, str(error))]
    found = [Problem("error", path.name, text) for text in schema_problems(root)]
    for value in values:
        if value.unit and value.unit not in known:
            text = f"the unit '{value.unit}' of '{value.name}' is not defined in Units, which SSP 1.0 demands"
            found.append(Problem("warning", path.name, text))
    return found


def _schema_findings(archive: zipfile.ZipFile) -> Iterator[Problem]:
    root = parse(read_entry(archive, DESCRIPTION, "the package"), DESCRIPTION)
    yield from (Problem("error", DESCRIPTION, text) for text in schema_problems(root))
    if root.get("version", "").startswith("2."):
        yield Problem(
            "warning", DESCRIPTION, "SSP 2: its schema is not at hand, only what is read was checked"
        )
    for node in root.iter("{http://ssp-standard.org/SSP1/SystemStructureParameterValues}ParameterSet"):
        # the schema of the wiring lets any content through here
        yield from (
            Problem("error", f"{DESCRIPTION}, inline values", t) for t in schema_problems(_detached(node))
        )
    for name in sorted(set(_sources(root))):
        values = parse(read_entry(archive, name, "the package"), name)
        yield from (Problem("error", name, text) for text in schema_problems(values))
    for connector in root.iter(f"{IN_SSD}Connector"):
        if not any(isinstance(c.tag, str) and "SystemStructureCommon" in c.tag for c in connector):
            yield Problem(
                "warning",
                DESCRIPTION,
                f"connector '{connector.get('name')}' has no type child; libcosim and ecos want one",
            )


def _sources(root: etree._Element) -> Iterator[str]:
    for binding in root.iter(f"{IN_SSD}ParameterBinding"):
        if binding.get("source") and binding.get("sourceBase", "SSD") == "SSD":
            yield local_source(binding.get("source"), "a parameter binding")


def _detached(node: etree._Element) -> etree._Element:
    return etree.fromstring(etree.tostring(node, with_tail=False), safe_parser())


def _fmu_findings(system: System) -> list[Problem]:
    fmus = {c.fmu.folder: c.fmu for c in system.components.values()}.values()
    found = [Problem("error", fmu.source, text) for fmu in fmus for text in validate_fmu(str(fmu.folder))]
    found += [Problem("error", fmu.source, text) for fmu in fmus for text in fmu.oddities]
    found += [
        Problem(
            "warning", fmu.source, f"{text}: correct one, or readings in other units are converted wrongly"
        )
        for fmu in fmus
        for unit in fmu.units
        if (text := contradiction(unit, fmu.units))
    ]
    return found + [Problem("error", fmu.source, text) for fmu in fmus for text in _binary_findings(fmu)]


def _binary_findings(fmu: Fmu) -> Iterator[str]:
    """What is wrong with the libraries for other platforms; reading refused a bad one for this."""
    for folder in sorted((fmu.folder / "binaries").iterdir()):
        suffix = binary.SUFFIXES.get(binary.platform_of(folder.name).rstrip("0123456789"))
        if suffix is None:
            continue
        file = folder / f"{fmu.identifier}{suffix}"
        wrong = (
            binary.problem(file.read_bytes(), folder.name, fmu.version) if file.is_file() else "is missing"
        )
        if wrong:
            yield f"the library 'binaries/{folder.name}/{file.name}' {wrong}: export or copy the FMU again"
        elif fmu.version != "2.0":
            content = file.read_bytes()
            absent = [name for name in EVERY if name.encode() + b"\0" not in content]
            if absent:
                yield (
                    f"the library 'binaries/{folder.name}/{file.name}' exports no {', '.join(absent)}, "
                    "which FMI 3.0 demands of every FMU; it is run all the same"
                )


def _name_findings(system: System) -> list[Problem]:
    names = sorted(system.components)
    found = []
    for first, second in pairwise(names):
        if second.startswith(first):
            found.append(
                Problem(
                    "warning",
                    system.name,
                    f"'{first}' is the start of '{second}': fmpy mixes their variables up; rename one",
                )
            )
    found += [
        Problem(
            "warning",
            system.name,
            f"component '{name}' is no plain identifier, which some clients refuse: rename it",
        )
        for name in names
        if not name.isidentifier()
    ]
    return found


def _path_findings(path: Path) -> list[Problem]:
    bad = unsafe_characters(path)
    if not bad:
        return []
    return [
        Problem(
            "warning",
            path.name,
            f"clients that unpack beside the file crash with pythonfmu FMUs because of '{bad}' in its path: move it",
        )
    ]
