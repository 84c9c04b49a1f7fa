"""`cosim init`: a first mapping for a model and a log, columns matched by name and unit, the rest in comments."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path

from cosim.anysystem.read import heading, value_of
from cosim.errors import DataError
from cosim.logs.load import open_source
from cosim.logs.source import Label
from cosim.ssp.quantities import definition
from cosim.ssp.system import System
from cosim.system.graph import connectors, port_of

ALIKE = 0.72  # of two names, from 0 to 1
TIMES = ("time", "t", "zeit", "temps", "tid", "timestamp", "seconds")


def plain(name: str) -> str:
    """A name without case, signs and blanks."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def likeness(label: Label, connector: str, unit: str) -> float:
    """How well a column fits a connector, from 0 to 1; 0 where the units rule it out."""
    if label.unit and unit and label.unit != unit:
        one, other = definition(label.unit, {}), definition(unit, {})
        if one is not None and other is not None and one.exponents[:7] != other.exponents[:7]:
            return 0.0
    name = plain(label.name)
    component, _, variable = connector.rpartition(".")
    whole, last = plain(connector), plain(variable)
    if name == whole:
        return 1.0
    if name in (last, plain(f"{variable}{component}")):
        return 0.95
    return max(SequenceMatcher(None, name, text).ratio() for text in (whole, last, plain(component)) if text)


@dataclass(frozen=True)
class Matches:
    """Which column of a log is probably which connector.

    Attributes:
        labels: the columns' headings, in their order.
        clock: index of the time column, or None.
        taken: index of a column -> connector.
        units: connector -> unit of the FMU's variable, empty where it has none.
    """

    labels: tuple[Label, ...]
    clock: int | None
    taken: dict[int, str]
    units: dict[str, str]


def matches(system: System, labels: Sequence[Label]) -> Matches:
    """Columns matched to connectors by name and unit, the best pairs first.

    Args:
        system: the model as read.
        labels: the log's headings.
    """
    labels = tuple(heading(label, system) for label in labels)
    clock = next((k for k, label in enumerate(labels) if plain(label.name) in TIMES), None)
    ports = connectors(system)
    units = {p: _unit(system, p) for p in ports}
    pairs = sorted(
        (
            (likeness(label, port, units[port]), k, port)
            for k, label in enumerate(labels)
            if k != clock
            for port in ports
        ),
        reverse=True,
    )
    taken: dict[int, str] = {}
    for score, k, port in pairs:
        if score >= ALIKE and k not in taken and port not in taken.values():
            taken[k] = port
    return Matches(labels, clock, taken, units)


def mapping_text(system: System, model: Path, log: Path, folder: Path) -> tuple[str, list[str], list[str]]:
    """A mapping as text, the columns that were matched, and what is left to the user.

    Args:
        system: the model as read.
        model: its file.
        log: the log.
        folder: where the mapping will lie.

    Raises:
        DataError: the log cannot be read.
    """
    matched = matches(system, open_source(log).labels)
    labels, clock, taken, units = matched.labels, matched.clock, matched.taken, matched.units
    ports = list(units)
    reference = _relative(model, folder)
    lines = [
        f"# which column of {log.name} is which connector of {model.name}",
        f"model = {_quoted(reference)}",
        "",
        "[time]",
    ]
    if clock is None:
        lines += [
            "# no column looks like a time: name it, or give the step",
            '# column = "time"',
            "step = 0.001",
            'unit = "s"',
        ]
    else:
        lines += [f"column = {_quoted(labels[clock].text)}", f"unit = {_quoted(labels[clock].unit or 's')}"]
    told, open_ = [], []
    for k, label in enumerate(labels):
        if k == clock:
            continue
        if k in taken:
            port = taken[k]
            unit = label.unit or units[port] or "1"
            note = "" if label.unit else "  # the heading has no unit: check"
            lines += [
                "",
                f"[signals.{_quoted(port)}]",
                f"column = {_quoted(label.text)}",
                f"unit = {_quoted(unit)}{note}",
            ]
            told.append(f"{label.text} -> {port}")
        else:
            unit = label.unit or "1"
            rest = ", ".join(p for p in ports if p not in taken.values())
            lines += ["", f"# what is this column? connectors: {rest}", '# [signals."component.connector"]']
            lines += [f"# column = {_quoted(label.text)}", f"# unit = {_quoted(unit)}"]
            open_.append(f"column '{label.text}'")
    open_ += [
        f"connector {p} is not measured" for p in ports if p not in taken.values() and p in system.inputs
    ]
    if not taken:
        raise DataError(
            f"{log}: no column looks like a connector of {model} ({', '.join(ports[:20])}): write the mapping by hand"
        )
    numbers = [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if v.kind == "Real"
        and v.causality == "parameter"
        and v.can_be_set
        and value_of(system, f"{c.name}.{v.name}") is not None
    ]
    lines += [
        "",
        "[diagnose]",
        "# parameters that are known to a tolerance: one that is off by more is named as a cause",
    ]
    lines += (
        ["# trusted = { " + ", ".join(f'{_quoted(n)} = "1 %"' for n in numbers) + " }"] if numbers else []
    )
    lines += ["# parameters that nobody knows: fitted with every cause", "# free = []", ""]
    return "\n".join(lines), told, open_


def _unit(system: System, connector: str) -> str:
    port = port_of(system, connector)
    return system.variable(port).unit if port.component else system.inputs[port.variable].unit


def _relative(model: Path, folder: Path) -> str:
    try:
        return model.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(model.resolve())


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
