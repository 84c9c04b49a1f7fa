"""A model made ready to be held against a log: its groups, its values, what the log's signals stand for."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cosim.compare.binding import TRUSTED
from cosim.compare.mapping import CompareTable
from cosim.diagnosis.model.cut import Bound, bound, cut, start_values
from cosim.diagnosis.model.groups import COMPONENT_VALUES, MODELS, Group
from cosim.diagnosis.model.options import Options
from cosim.diagnosis.model.wiring import Wiring, wiring_of
from cosim.errors import DataError, ModelError, UsageError
from cosim.lexicon import Lexicon, Shown
from cosim.logs import Log
from cosim.logs.mapping import Mapping as LogMapping
from cosim.paths import ssp_folder
from cosim.signals import SIGNALS
from cosim.ssp.write import STIMULUS, read_values
from cosim.units import factor
from fmus import registry


@dataclass(frozen=True)
class Machine:
    """A model and how it is diagnosed.

    Attributes:
        name: of the model.
        wiring: its components and wires.
        source: the .ssd from which packages are written.
        groups: cut at every signal that it has.
        signals: what they stand for.
        values: ``component.parameter`` -> SI in which the machine differs from the values that the .ssd binds.
        options: what the mapping says.
        lexicon: units and words for people.
        mapping: with which its logs are read.
        aside: signal that counts as not measured -> why.
        notes: what to say of its file.
    """

    name: str
    wiring: Wiring
    source: Path
    groups: tuple[Group, ...]
    signals: dict[str, Bound]
    values: dict[str, float] = field(default_factory=dict)
    options: Options = field(default_factory=Options)
    lexicon: Lexicon = field(default_factory=Lexicon)
    mapping: LogMapping | None = None
    aside: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def drive(self) -> str:
        """The command: what drives the first group."""
        return self.groups[0].drive

    @property
    def base(self) -> dict[str, float]:
        """``component.parameter`` -> SI in which the machine differs from what its blocks declare, start angles left out."""
        starts = {n for g in self.groups for n, _ in g.starts}
        found = {}
        for name, value in (self.wiring.values | self.values).items():
            component, _, parameter = name.partition(".")
            declared = registry.block(self.wiring.blocks[component]).parameters.get(parameter)
            nominal = COMPONENT_VALUES.get(name, declared.start if declared is not None else None)
            if name not in starts and value != nominal:
                found[name] = value
        return found

    def inputs(self) -> tuple[tuple[str, ...], float]:
        """Names of the open package's inputs that the command drives, and the variable per signal, SI."""
        item = self.signals[self.drive]
        if STIMULUS in self.wiring.blocks:
            return (self.drive,), item.gain
        named = tuple(n for n, targets in self.wiring.inputs.items() if set(targets) == set(item.targets))
        return named or tuple(map(str, item.targets)), item.gain


def our_machine(name: str, values: Mapping[str, float] | None = None) -> Machine:
    """One of the models that come with the package.

    Raises:
        UsageError: no such model.
    """
    if name not in MODELS:
        raise UsageError(f"no model '{name}' for the diagnosis; {registry.suggestion(name, list(MODELS))}")
    source = ssp_folder() / f"{name}.ssd"
    wiring = wiring_of(source)
    return Machine(name, wiring, source, MODELS[name], bound(wiring), dict(values or {}))


def machine_for(
    source: Path | str, log: Log, mapping: LogMapping, table: CompareTable, options: Options
) -> Machine:
    """A model for a log that came with a mapping: one of ours by name, or any chain of our blocks (.ssd).

    Args:
        source: the model.
        log: the log.
        mapping: the mapping with which it was read.
        table: what the mapping says its signals stand for, and values of its own.
        options: how it is diagnosed.

    Raises:
        UsageError, DataError, ModelError: no such model, or mapping and model do not fit together.
    """
    path = ssp_folder() / f"{source}.ssd" if str(source) in MODELS else Path(source)
    if not path.is_file():
        raise ModelError(f"there is no model '{path}'")
    if path.suffix.lower() != ".ssd":
        raise UsageError(f"'{path}' with a mapping's signals: give the wiring (.ssd) or the name of a model")
    wiring = wiring_of(path)
    signals = bound(wiring, table, log.units)
    trusted = options.named if options.named is not None else TRUSTED
    values: dict[str, float] = {}
    for file in table.parameter_files:
        values |= read_values(file)
    own = [n for n in options.scale if n.partition(".")[0] in wiring.blocks]  # the others are units
    check_names(wiring, [*values, *own, *(options.named or ())], path)
    for key in ("absolute", "drifting", "held"):
        for name in getattr(options, key):
            if name not in signals:
                nearest = registry.suggestion(name, list(signals))
                raise UsageError(f"{mapping.path or path}: [diagnose] {key}: no signal '{name}'; {nearest}")
    groups = [
        replace(
            group,
            absolute=group.absolute or bool(set(group.observed) & set(options.absolute)),
            drifting=bool(set(group.observed) & set(options.drifting)),
            place=bool(set(group.observed) & set(options.held)),
            asked=options.consider,
            excluded=options.exclude,
            scale=tuple(sorted(options.scale.items())),
        )
        for group in cut(wiring, signals, start_values(wiring, table, signals), trusted)
    ]
    lexicon = Lexicon(shown_signals(log, mapping, signals), dict(options.units), dict(options.blocks))
    aside, notes = table.aside, table.notes
    return Machine(
        wiring.name, wiring, path, tuple(groups), signals, values, options, lexicon, mapping, aside, notes
    )


def shown_signals(log: Log, mapping: LogMapping, signals: Mapping[str, Bound]) -> dict[str, Shown]:
    """How signals that are not ours are shown: in the unit of the log."""
    found = {}
    for name, item in signals.items():
        if name in log.signals and (name not in SIGNALS or item.gain != 1.0):
            unit = log.display[name]
            described = mapping.signals.get(name)
            text = (described.text if described else "") or name.replace("_", " ")
            found[name] = Shown(unit, factor(log.units[name], unit) / item.gain, text)
    return found


def check_names(wiring: Wiring, names: list[str], path: Path) -> None:
    """Refuse ``component.parameter`` that the system does not have.

    Raises:
        DataError: one does not exist.
    """
    effects = registry.effects().values()
    known = [f"{c}.{p}" for c, b in wiring.blocks.items() for p in registry.block(b).parameters]
    known += [f"{e.component}.{p}" for e in effects if e.component in wiring.blocks for p in e.parameters]
    for name in names:
        if name not in known:
            raise DataError(f"{path.name} has no '{name}'; {registry.suggestion(name, known)}")
