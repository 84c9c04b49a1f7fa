"""`cosim init`: a first mapping for a model and a log, columns matched by name and unit, the rest in comments."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path

from cosim.anysystem.read import heading, value_of
from cosim.errors import DataError
from cosim.logs.load import open_source
from cosim.logs.source import Label
from cosim.ssp.quantities import definition
from cosim.ssp.system import System, Variable
from cosim.system.graph import connectors, port_of

ALIKE = 0.72  # of two names, from 0 to 1
SHORTEST = 3  # letters of a word that may be short for another
SLIP = 0.8  # of two words that are the same but for a slip
TIMES = ("time", "t", "zeit", "temps", "tid", "timestamp", "seconds")


def plain(name: str) -> str:
    """A name without case, signs and blanks."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def words(name: str) -> list[str]:
    """The words of a name: ``wheelPos``, ``wheel_pos`` and ``Wheel pos`` are wheel and pos."""
    return [w.lower() for w in re.findall(r"[A-Z]?[a-z]+\d*|[A-Z]+(?![a-z])\d*|[A-Z]|\d+", name)]


def akin(one: str, other: str) -> float:
    """How well two words fit, from 0 to 1: the same, one short for the other (``pos``, ``cmd``), or a slip of the pen."""
    if one == other:
        return 1.0
    short, long = sorted((one, other), key=len)
    if len(short) >= SHORTEST and long.startswith(short):
        return 0.9
    rest = iter(long)
    if len(short) >= SHORTEST and short[0] == long[0] and all(c in rest for c in short):
        return 0.8
    ratio = SequenceMatcher(None, one, other).ratio()
    return ratio if ratio >= SLIP else 0.0


def likeness(label: Label, connector: str, unit: str) -> float:
    """How well a column fits a connector, from 0 to 1; 0 where the units rule it out."""
    if label.unit and unit and not same_dimension(label.unit, unit):
        return 0.0
    name = plain(label.name)
    component, _, variable = connector.rpartition(".")
    if name == plain(connector):
        return 1.0
    if name in (plain(variable), plain(f"{variable}{component}")):
        return 0.95
    own, wanted, beside = words(label.name), words(variable), words(component)
    if not own or not wanted:
        return 0.0
    found = [max(akin(w, o) for o in own) for w in wanted]
    told = [max(akin(o, w) for w in (*wanted, *beside)) for o in own]
    return 0.5 * (sum(found) / len(found) + sum(told) / len(told)) if any(found) else 0.0


def same_dimension(one: str, other: str) -> bool:
    """Whether two units may be of the same dimension; what nobody knows may be."""
    if one == other:
        return True
    first, second = definition(one, {}), definition(other, {})
    return first is None or second is None or first.exponents[:7] == second.exponents[:7]


@dataclass(frozen=True)
class Matches:
    """Which column of a log is probably which connector.

    Attributes:
        labels: the columns' headings, in their order.
        clock: index of the time column, or None.
        taken: index of a column -> connector.
        units: connector -> unit of the FMU's variable, empty where it has none.
        by_unit: columns of `taken` of which only the unit fits, and that of no other column or connector.
    """

    labels: tuple[Label, ...]
    clock: int | None
    taken: dict[int, str]
    units: dict[str, str]
    by_unit: frozenset[int] = frozenset()


def matches(system: System, labels: Sequence[Label]) -> Matches:
    """Columns matched to connectors by name and unit, the best pairs first.

    Args:
        system: the model as read.
        labels: the log's headings.
    """
    labels = tuple(heading(label, system) for label in labels)
    clock = next((k for k, label in enumerate(labels) if plain(label.name) in TIMES), None)
    # an input of the system and what it feeds are one signal
    fed = {str(wire.target) for item in system.inputs.values() for wire in item.targets}
    ports = [p for p in connectors(system) if p not in fed]
    # what only goes on inside is no connector, but a log that calls a column by its name has measured it
    called = {plain(label.name) for label in labels}
    ports += [p for p in internal(system) if {plain(p), plain(p.partition(".")[2])} & called]
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
    guessed = only_by_unit(labels, clock, taken, units)
    return Matches(labels, clock, taken | guessed, units, frozenset(guessed))


def internal(system: System) -> list[str]:
    """Names of all Real variables that are no connector and change, ``component.variable``."""
    return [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if v.kind == "Real"
        and v.causality == "local"
        and v.variability not in ("fixed", "tunable", "constant")
    ]


def only_by_unit(
    labels: Sequence[Label], clock: int | None, taken: Mapping[int, str], units: Mapping[str, str]
) -> dict[int, str]:
    """Columns left over of which the unit fits one connector that is left over, and this no other column."""
    left = [p for p in units if p not in taken.values() and dimensional(units[p])]
    rest = [
        k for k, label in enumerate(labels) if k != clock and k not in taken and dimensional(label.unit or "")
    ]
    fits = {k: [p for p in left if same_dimension(labels[k].unit or "", units[p])] for k in rest}
    return {
        k: ports[0]
        for k, ports in fits.items()
        if len(ports) == 1 and sum(ports[0] in others for others in fits.values()) == 1
    }


def dimensional(unit: str) -> bool:
    """Whether a unit is known and no pure number."""
    found = definition(unit, {}) if unit else None
    return found is not None and any(found.exponents[:7])


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
            note = "  # only the unit fits: CHECK" if k in matched.by_unit else note
            lines += [
                "",
                f"[signals.{_quoted(port)}]",
                f"column = {_quoted(label.text)}",
                f"unit = {_quoted(unit)}{note}",
            ]
            told.append(
                f"{label.text} -> {port}{' (only the unit fits: CHECK)' if k in matched.by_unit else ''}"
            )
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
        known = ports or internal(system)
        what = "a connector" if ports else "a variable, and there are no connectors,"
        raise DataError(
            f"{log}: no column looks like {what} of {model} ({', '.join(known[:20])}): write the mapping by hand"
        )
    numbers = [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if settable(v) and value_of(system, f"{c.name}.{v.name}") is not None
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


def settable(variable: Variable) -> bool:
    """Whether it is a parameter that can be trusted or estimated."""
    return variable.kind == "Real" and variable.causality == "parameter" and variable.can_be_set


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
