"""`cosim init`: a first mapping for a model and a log, columns matched by name and unit, the rest in comments."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from pathlib import Path

from cosim.anysystem.initial import Beginning, beginnings
from cosim.anysystem.letters import is_letter
from cosim.anysystem.meant import Meaning, behind, clearly, conflicts, kinds_of
from cosim.anysystem.read import ends, heading, value_of
from cosim.errors import DataError
from cosim.logs.clocks import TIME_WORDS
from cosim.logs.clocks import plain as in_words
from cosim.logs.guess import column_of, directed, opposite, stamped, time_lines
from cosim.logs.overview import Column, Overview, overview
from cosim.logs.source import Label
from cosim.ssp.quantities import definition
from cosim.ssp.stated import in_si, unit_in_words, without_unit
from cosim.ssp.system import Port, System, Variable
from cosim.system.graph import connectors, port_of

# connector -> name of its variable, what is said of it, name of its component
Told = Mapping[str, tuple[str, str, str]]
ALIKE = 0.72  # of two names, from 0 to 1
SHORTEST = 3  # letters of a word that may be short for another
BY_NAME = 0.95  # from which on a column has a connector's very name
ABOUT = 0.05  # by which of two columns that fit a name neither is the better
NEAREST = 3  # columns that are shown for a connector without one
SLIP = 0.8  # of two words that are the same but for a slip
LETTERS = {"u": ("in", "input"), "y": ("out", "output")}  # Modelica's names of a block's connectors
_UNIT_WITHIN = re.compile(r"\s*[\[(][^\])]*[\])]")  # `Current (mA) - Plot 0`
TIMES = ("time", "t", "zeit", "temps", "tid", "timestamp", "seconds")


def plain(name: str) -> str:
    """A name without case, signs and blanks."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def words(name: str) -> list[str]:
    """The words of a name: ``wheelPos``, ``wheel_pos`` and ``Wheel pos`` are wheel and pos."""
    return [w.lower() for w in re.findall(r"[A-Z]?[a-z]+\d*|[A-Z]+(?![a-z])\d*|[A-Z]|\d+", name)]


def akin(one: str, other: str) -> float:
    """How well two words fit, from 0 to 1: the same, one short for the other (``pos``, ``cmd``), or a slip of the pen."""
    if one == other or any(x in LETTERS.get(y, ()) for x, y in ((one, other), (other, one))):
        return 1.0
    short, long = sorted((one, other), key=len)
    if len(short) >= SHORTEST and long.startswith(short):
        return 0.9
    rest = iter(long)
    if len(short) >= SHORTEST and short[0] == long[0] and all(c in rest for c in short):
        return 0.8
    ratio = SequenceMatcher(None, one, other).ratio()
    return ratio if ratio >= SLIP else 0.0


def likeness(label: Label, connector: str, unit: str, own: str = "") -> float:
    """How well a column fits a connector, from 0 to 1; 0 where the units rule it out.

    Args:
        label: its heading.
        connector: ``component.connector``.
        unit: of the connector, empty where it has none.
        own: what of its name no other column has in common, or empty.
    """
    if label.unit and unit and not same_dimension(label.unit, unit):
        return 0.0
    return max(_likeness(name, connector) for name in (*_names(label), *([own] if own else ())))


def own_names(labels: Mapping[int, Label]) -> dict[int, str]:
    """Index of a column -> its name without what all columns have in theirs: `Flow (GPM) - Plot 0` is Flow beside others."""
    names = {k: words(without_unit(_UNIT_WITHIN.sub(" ", label.short))) for k, label in labels.items()}
    shared = set.intersection(*map(set, names.values())) if len(names) > 1 else set()
    left = {k: " ".join(w for w in own if w not in shared) for k, own in names.items()}
    return left if shared and all(left.values()) else {}


def _names(label: Label) -> list[str]:
    """What a column may be called: in a file with folders its own part, with its folders or without."""
    parts = label.name.split(".") if label.alias else [label.name]
    paths = [".".join(parts[k:]) for k in range(len(parts))]
    return list(dict.fromkeys([label.short, *paths]))


def _likeness(name: str, connector: str) -> float:
    """How well a name fits a connector, from 0 to 1."""
    component, _, variable = connector.rpartition(".")
    if plain(name) == plain(connector):
        return 1.0
    if plain(name) in (plain(variable), plain(f"{variable}{component}")):
        return 0.95
    own, wanted, beside = words(name), words(variable), words(component)
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
        doubts: index of a column of `taken` -> what is uncertain in its match.
        near: connector without a column -> the columns without a connector that come nearest to it, the nearest first.
    """

    labels: tuple[Label, ...]
    clock: int | None
    taken: dict[int, str]
    units: dict[str, str]
    doubts: Mapping[int, str] = field(default_factory=dict)
    near: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def check(self, column: int) -> str:
        """What is uncertain in a match, or empty."""
        return self.doubts.get(column, "")


def matches(
    system: System,
    labels: Sequence[Label],
    clock: int | None = None,
    stamps: frozenset[int] = frozenset(),
    other_way: Mapping[int, int] | None = None,
) -> Matches:
    """Columns matched to connectors by name and unit, the best pairs first.

    Args:
        system: the model as read.
        labels: the log's headings.
        clock: index of the time column; None where only its name can tell it.
        stamps: further columns that are no signals, such as those that hold time.
        other_way: column -> that of the other direction of the same command.
    """
    labels = tuple(heading(label, system) for label in labels)
    if clock is None:
        clock = next((k for k, label in enumerate(labels) if plain(label.short) in TIMES), None)
    times = stamps | ({clock} if clock is not None else set())
    # an input of the system and what it feeds are one signal
    feeds = {name: [str(wire.target) for wire in item.targets] for name, item in system.inputs.items()}
    fed = {target for targets in feeds.values() for target in targets}
    ports = [p for p in connectors(system) if p not in fed]
    # what only goes on inside is no connector, but a log that calls a column by its name has measured it
    called = {plain(name) for label in labels for name in _names(label)}
    ports += [p for p in internal(system) if {plain(p), plain(p.partition(".")[2])} & called]
    units = {p: _unit(system, p) for p in ports}
    told = {p: _told(system, p) for p in ports}
    driving = entering(system)
    own = own_names({k: label for k, label in enumerate(labels) if k not in times})
    scores = {
        (k, port): max(
            likeness(label, name, units[port], own.get(k, "")) for name in (port, *feeds.get(port, ()))
        )
        for k, label in enumerate(labels)
        if k not in times
        for port in ports
        if port_of(system, port) in driving or not behind(label.short, " ".join((port, *told[port])))
    }
    taken: dict[int, str] = {}
    doubts: dict[int, str] = {}
    # of columns that fit a name alike the description knows more, and what drives a model is rather a command
    meaning = Meaning([label.short for label in labels], words, akin)
    means = {
        (k, port): (
            round(meaning.fit(labels[k].short, *told[port]), 6),
            port_of(system, port) in driving and "command" in kinds_of(labels[k].short),
        )
        for (k, port), score in scores.items()
        if score >= ALIKE
    }
    for k, port in sorted(
        means, key=lambda pair: (scores[pair], pair[1] in feeds, *means[pair], *pair), reverse=True
    ):
        if k not in taken and port not in taken.values():
            taken[k] = port
    for k, port in taken.items():
        others = [n for n in range(len(labels)) if n not in taken and n not in times]
        equal = [n for n in others if scores.get((n, port), 0.0) > scores[k, port] - ABOUT]
        if equal and scores[k, port] < BY_NAME:
            doubts[k] = f"'{labels[equal[0]].shown}' fits its name as well"
    taken |= (placed := by_place(system, labels, taken))
    doubts |= dict.fromkeys(placed, "by its place among the outputs")
    # what a description says of the unit rules out less than what the FMU states, but here nothing else is sure either
    counts = {p: units[p] or unit_of_connector(system, p) for p in ports}
    fits = by_meaning(labels, times, taken, told, counts)
    taken |= (meant := clearly(fits, other_way))
    doubts |= {k: _because(told[port]) for k, port in meant.items()}
    taken |= (guessed := only_by_unit(labels, times, taken, counts, told))
    doubts |= dict.fromkeys(guessed, "only the unit fits")
    taken |= (lettered := by_letter(labels, times, taken, counts))
    doubts |= dict.fromkeys(lettered, "by the usual letter for what has its unit")
    sure = any(k not in meant for k in taken)  # what is left over from guesses is none
    taken |= (last := left_over(labels, times, taken, counts, told) if sure else {})
    doubts |= dict.fromkeys(last, "the only ones left over")
    return Matches(labels, clock, taken, units, doubts, nearest(fits, taken, ports))


def _told(system: System, connector: str) -> tuple[str, str, str]:
    """Name of a connector's variable, what the FMU says of it, and its component's name."""
    port = port_of(system, connector)
    said = " ".join(system.variable(p).description for p, _, _ in ends(system, port))
    component = port.component or " ".join(dict.fromkeys(p.component for p, _, _ in ends(system, port)))
    return port.variable, said, component


def _because(told: tuple[str, str, str]) -> str:
    said = " ".join(told[1].split())
    return f"as its description, '{said}', has it" if said else "by the quantity that its name tells"


def by_meaning(
    labels: Sequence[Label],
    times: Collection[int],
    taken: Mapping[int, str],
    told: Told,
    units: Mapping[str, str],
) -> dict[tuple[int, str], float]:
    """(Column, connector) of those left over -> how well the description fits the column, where the units may fit."""
    names = {k: label.short for k, label in enumerate(labels) if k not in times}
    meaning = Meaning(list(names.values()), words, akin)
    return {
        (k, port): meaning.fit(name, *told[port])
        for k, name in names.items()
        if k not in taken
        for port in told
        if port not in taken.values() and _may_be(labels[k], units[port])
    }


def _may_be(label: Label, unit: str) -> bool:
    """Whether a column's unit may be a connector's; an angle may be a pure number, but no per cent."""
    if not (label.unit and unit) or "1" in (label.unit, unit):
        return True
    one, other = definition(label.unit, {}), definition(unit, {})
    return one is None or other is None or one.exponents == other.exponents


def nearest(
    fits: Mapping[tuple[int, str], float], taken: Mapping[int, str], ports: Sequence[str]
) -> dict[str, tuple[int, ...]]:
    """Connector without a column -> the columns left over that come nearest to it."""
    free = {p: [k for k, port in fits if port == p and k not in taken and fits[k, p] > 0.0] for p in ports}
    return {
        p: tuple(sorted(columns, key=lambda k: -fits[k, p])[:NEAREST])
        for p, columns in free.items()
        if columns and p not in taken.values()
    }


def by_place(system: System, labels: Sequence[Label], taken: Mapping[int, str]) -> dict[int, str]:
    """Simulink's array `yout` without names, which holds the outputs in their order: of a single FMU these are its own."""
    columns = [k for k, label in enumerate(labels) if re.fullmatch(r"yout(\(:,\d+\))?", label.short)]
    if len(system.components) != 1:
        return {}
    (component,) = system.components.values()
    outputs = [
        f"{component.name}.{v.name}" for v in component.fmu.variables.values() if v.causality == "output"
    ]
    if len(columns) != len(outputs):
        return {}
    pairs = zip(columns, outputs, strict=True)
    return {k: port for k, port in pairs if k not in taken and port not in taken.values()}


def of_file(system: System, found: Overview) -> Matches:
    """`matches` of a file, whose time may be told by more than a name, units as a mapping takes them."""
    labels = [replace(c.label, unit=c.unit or c.label.unit) for c in found.columns]
    clock = found.clock.column if found.clock else None
    others = {c.index: opposite(c, list(found.columns)) for c in found.columns}
    ways = {k: other.index for k, other in others.items() if other is not None}
    # what lacks more values than it has was not logged over the run: the limits of a plot, say
    no_signals = _stamps(found) | {c.index for c in found.columns if c.missing > c.finite.size}
    made = matches(system, labels, clock, no_signals, ways)
    if clock is None or _is_time(found.columns[clock]):
        return made
    # what only rises evenly may be a ramp: it is one where its name is a connector's
    again = matches(system, labels, None, no_signals, ways)
    return again if clock in again.taken else made


def entering(system: System) -> set[Port]:
    """The inputs that a log may drive: those of the system, and all of a model by itself."""
    found = {port_of(system, name) for name in system.inputs}
    if len(system.components) == 1:
        (only,) = system.components.values()
        found |= {Port(only.name, v.name) for v in only.fmu.variables.values() if v.causality == "input"}
    return found


def _is_time(column: Column) -> bool:
    """Whether a column is called a time, or has its unit."""
    named = bool(TIME_WORDS.search(in_words(column.label.short)))
    return named or (dimensional(column.unit or "") and same_dimension(column.unit or "", "s"))


def _stamps(found: Overview) -> frozenset[int]:
    """The columns that hold stamps of others: every structure of Simulink has its own."""
    if found.clock is None or found.clock.column is not None:
        return frozenset()
    return frozenset(c.index for c in found.columns if plain(c.label.short) in TIMES)


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
    labels: Sequence[Label],
    times: Collection[int],
    taken: Mapping[int, str],
    units: Mapping[str, str],
    told: Told | None = None,
) -> dict[int, str]:
    """Columns left over of which the unit fits one connector that is left over, and this no other column."""
    left = [p for p in units if p not in taken.values() and dimensional(units[p])]
    rest = [
        k
        for k, label in enumerate(labels)
        if k not in times and k not in taken and dimensional(label.unit or "")
    ]
    fits = {
        k: [
            p
            for p in left
            if same_dimension(labels[k].unit or "", units[p]) and not _contradicts(labels[k], p, told)
        ]
        for k in rest
    }
    return {
        k: ports[0]
        for k, ports in fits.items()
        if len(ports) == 1 and sum(ports[0] in others for others in fits.values()) == 1
    }


def by_letter(
    labels: Sequence[Label], times: Collection[int], taken: Mapping[int, str], units: Mapping[str, str]
) -> dict[int, str]:
    """Columns left over and connectors without a unit whose name begins with the letter of such a quantity, one of each."""
    rest = [k for k, label in enumerate(labels) if k not in times and k not in taken]
    left = [p for p in units if p not in taken.values() and not dimensional(units[p])]
    fits = {k: [p for p in left if is_letter(p.rpartition(".")[2], labels[k].unit or "")] for k in rest}
    return {
        k: ports[0]
        for k, ports in fits.items()
        if len(ports) == 1 and sum(ports[0] in others for others in fits.values()) == 1
    }


def _contradicts(label: Label, connector: str, told: Told | None) -> bool:
    """Whether a column is another kind of quantity than a connector, by what its name and its description tell."""
    return conflicts(label.short, " ".join((told or {}).get(connector, (connector,))[:2]))


def left_over(
    labels: Sequence[Label],
    times: Collection[int],
    taken: Mapping[int, str],
    units: Mapping[str, str],
    told: Told,
) -> dict[int, str]:
    """The one column and the one connector that are left over where others were found, if their units may fit."""
    rest = [k for k in range(len(labels)) if k not in times and k not in taken]
    left = [p for p in units if p not in taken.values()]
    if not taken or len(rest) != 1 or len(left) != 1:
        return {}
    own, wanted = labels[rest[0]].unit, units[left[0]]
    if _contradicts(labels[rest[0]], left[0], told):
        return {}
    return {rest[0]: left[0]} if not (own and wanted) or same_dimension(own, wanted) else {}


def dimensional(unit: str) -> bool:
    """Whether a unit is known and no pure number."""
    found = definition(unit, {}) if unit else None
    return found is not None and any(found.exponents[:7])


def mapping_text(
    system: System, model: Path, log: Path, folder: Path
) -> tuple[str, list[str], list[str], str]:
    """A mapping as text, the columns that were matched, what is left to the user, and what a diagnosis cannot do without.

    Args:
        system: the model as read.
        model: its file.
        log: the log.
        folder: where the mapping will lie.

    Raises:
        DataError: the log cannot be read.
    """
    found = overview(log)
    matched = of_file(system, found)
    taken, units = matched.taken, matched.units
    if found.clock is not None and found.clock.column in taken:  # a ramp, no time
        found = replace(found, clock=None)
    clock = stamped(found, [found.columns[k] for k in taken])
    ports = list(units)
    lines = [
        f"# which column of {log.name} is which connector of {model.name}",
        f"model = {_quoted(_relative(model, folder))}",
        "",
        *([] if found.header else ["[file]", "header = false    # its first row holds numbers", ""]),
        *time_lines(found, clock),
    ]
    told, open_ = [], []
    # connector -> unit of an FMU that states none, and if a description has it
    counts: dict[str, tuple[str, bool]] = {}
    times = _stamps(found) | found.times
    driving = entering(system)
    ways = both_ways(system, found, matched)
    for k, column in enumerate(found.columns):
        if k in taken:
            port = taken[k]
            doubt = matched.check(k)
            said = "" if units[port] else unit_of_connector(system, port)
            unit = column.unit or units[port] or said or "1"
            note = "" if column.unit else "  # the heading has no unit: check"
            note = "  # as the FMU's description says: check" if said and not column.unit else note
            note = f"  # {doubt}: CHECK" if doubt else note
            column, other = ways.get(k, (column, None))
            lines += [
                "",
                f"[signals.{_quoted(port)}]",
                f"column = {column_of(found, column)}",
                f"unit = {_quoted(unit)}{note}",
            ]
            if other is not None:
                lines.append(
                    f"minus = {column_of(found, other)}    # the other direction of one command: CHECK, or delete the line"
                )
            if port_of(system, port) in driving:
                lines.append(
                    "held = true    # it moves in steps: each value stays until the next sample"
                    if column.held or (other is not None and other.held)
                    else "# held = true    # where each value stays until the next sample, as a controller makes it"
                )
            if not units[port] and (said or (column.unit and not in_si(column.unit))):
                counts[port] = (said or column.unit or "1", bool(said))
            shown = (
                f"{column.label.shown} minus {other.label.shown}" if other is not None else column.label.shown
            )
            told.append(f"{shown} -> {port}{f' ({doubt}: CHECK)' if doubt else ''}")
        elif k not in times and all(column is not other for pair in ways.values() for other in pair):
            what = _what(k, matched)
            lines += ["", what, '# [signals."component.connector"]']
            lines += [f"# column = {column_of(found, column)}", f"# unit = {_quoted(column.unit or '1')}"]
            open_.append(f"column '{column.label.shown}'")
    open_ += [
        f"connector {p} is not measured" for p in ports if p not in taken.values() and p in system.inputs
    ]
    if not taken and not ports:
        raise DataError(
            f"{log}: no column looks like a variable, and there are no connectors, of {model} "
            f"({', '.join(internal(system)[:20])}): write the mapping by hand"
        )
    if counts:
        lines += ["", "[compare.units]    # in which unit an FMU counts that states none"]
        lines += [
            f"{_quoted(port)} = {_quoted(unit)}"
            + ("    # as its description says" if sure else "    # taken from the log: CHECK")
            for port, (unit, sure) in counts.items()
        ]
        told += [
            f"{port}: the FMU states no unit, taken to count in {unit} as the log does: CHECK"
            for port, (unit, sure) in counts.items()
            if not sure
        ]
    begins = beginnings_of(system, found, matched)
    numbers = numbers_of(system, begins)
    read_in = {port: found.columns[k].unit or "" for k, port in taken.items()}
    lines += _start_lines(begins, read_in)
    told += [f"{b.connector} {began(b, read_in[b.connector])}" for b in begins if b.off]
    lines += [
        "",
        "[diagnose]",
        "# parameters that are known to a tolerance: one that is off by more is named as a cause",
    ]
    lines += (
        ["# trusted = { " + ", ".join(f'{_quoted(n)} = "1 %"' for n in numbers) + " }"] if numbers else []
    )
    lines += ["# parameters that nobody knows: fitted with every cause", "# free = []", ""]
    return "\n".join(lines), told, open_, lacking(system, found, matched)


def _what(column: int, matched: Matches) -> str:
    """The question of which connector a column is, those that it comes nearest to first."""
    rest = [p for p in matched.units if p not in matched.taken.values()]
    if not rest:
        return "# no connector is left for this column"
    near = [p for p in rest if column in matched.near.get(p, ())]
    first = f"perhaps {', '.join(near)}; " if near else ""
    return f"# what is this column? {first}connectors: {', '.join(rest)}"


def both_ways(system: System, found: Overview, matched: Matches) -> dict[int, tuple[Column, Column]]:
    """Index of an input's column -> the columns of its two directions, the positive one first, where it has two."""
    taken, driving = matched.taken, entering(system)
    times = _stamps(found) | found.times
    free = [c for k, c in enumerate(found.columns) if k not in taken and k not in times]
    shows = [found.columns[k] for k, port in taken.items() if port_of(system, port) not in driving]
    away = {k: opposite(found.columns[k], free) for k, p in taken.items() if port_of(system, p) in driving}
    return {
        k: directed(found.columns[k], other, named_like(taken[k], shows))
        for k, other in away.items()
        if other is not None
    }


def beginnings_of(system: System, found: Overview, matched: Matches) -> list[Beginning]:
    """Where a log begins with each output that it has, beside what the model begins with."""
    driving = entering(system)
    outputs = {p: found.columns[k] for k, p in matched.taken.items() if port_of(system, p) not in driving}
    outputs = {p: column for p, column in outputs.items() if port_of(system, p).component}
    units = {p: matched.units[p] or unit_of_connector(system, p) or c.unit or "" for p, c in outputs.items()}
    return beginnings(system, outputs, units, words, akin)


def began(start: Beginning, unit: str) -> str:
    """Where a log begins with an output, and what of the model begins there."""
    at = f"begins at {start.reading:.4g} {unit}".rstrip()
    if start.parameter:
        return f"{at}: the model begins there by {start.parameter}{'' if start.named else ' (CHECK)'}"
    if start.model is None:
        return (
            f"{at}; where the model begins the FMU does not say, and no parameter looks like its start: if it begins "
            "elsewhere, name one under [compare.start]"
        )
    return (
        f"{at}, the model at {start.model:.4g}, and no parameter looks like its start: name one under [compare.start], or "
        "expect an offset"
    )


def _start_lines(begins: Sequence[Beginning], units: Mapping[str, str]) -> list[str]:
    """The table of initial values that the log knows; in comments where it begins as the model does."""
    lines = []
    for b in begins:
        reading = f"the log begins at {b.reading:.4g} {units[b.connector]}".rstrip()
        own = (
            f", the model at {b.model:.4g}"
            if b.model is not None
            else "; where the model begins the FMU does not say"
        )
        if b.parameter:
            sure = "" if b.named else "; its description says so: CHECK"
            mark = "" if b.off else "# "
            lines.append(f"{mark}{_quoted(b.parameter)} = {_quoted(b.connector)}    # {reading}{own}{sure}")
        elif b.off:
            none = "no parameter looks like its start"
            lines.append(f'# "component.parameter" = {_quoted(b.connector)}    # {reading}{own}; {none}')
    if not lines:
        return []
    head = "[compare.start]" if any(not line.startswith("#") for line in lines) else "# [compare.start]"
    return ["", f"{head}    # an initial value -> the output whose first reading it takes", *lines]


def named_like(connector: str, columns: Sequence[Column]) -> Column | None:
    """Of columns that show what a model does the one that shares most words with a connector; None if none shares any."""
    own = set(words(connector.rpartition(".")[2]))
    shared = [(len(own & set(words(c.label.short))), c) for c in columns]
    most = max((n for n, _ in shared), default=0)
    return next((c for n, c in shared if n == most), None) if most else None


def lacking(system: System, found: Overview, matched: Matches) -> str:
    """What a diagnosis cannot do without and no column was found for; empty if nothing is."""
    known = set(matched.taken.values())
    outputs = [p for p in matched.units if p not in system.inputs]
    lacks = []
    if not known & set(outputs) and outputs:
        lacks.append(f"a column for what was measured ({', '.join(outputs[:20])})")
    if not known & system.inputs.keys() and system.inputs:
        lacks.append(f"a column for what drives it ({', '.join(list(system.inputs)[:20])})")
    if found.clock is None and found.interval is None:
        lacks.append("the interval between samples ('step', for which 0.001 s stands now)")
    return "; ".join(lacks)


def numbers_of(system: System, begins: Sequence[Beginning]) -> list[str]:
    """Parameters that may be trusted or fitted, ``component.parameter``; an initial value that the log gives is none."""
    from_log = {b.parameter for b in begins if b.parameter and b.off}
    names = [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if settable(v)
    ]
    return [name for name in names if name not in from_log and value_of(system, name) is not None]


def settable(variable: Variable) -> bool:
    """Whether it is a parameter that can be trusted or estimated."""
    return variable.kind == "Real" and variable.causality == "parameter" and variable.can_be_set


def _unit(system: System, connector: str) -> str:
    port = port_of(system, connector)
    return system.variable(port).unit if port.component else system.inputs[port.variable].unit


def unit_of_connector(system: System, connector: str) -> str:
    """The unit that the descriptions of a connector's variables end with; empty where there is none."""
    port = port_of(system, connector)
    units = (unit_in_words(system.variable(p)) for p, _, _ in ends(system, port))
    return next((unit for unit in units if unit), "")


def _relative(model: Path, folder: Path) -> str:
    try:
        return model.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(model.resolve())


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
