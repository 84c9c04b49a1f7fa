"""A mapping for a log: columns matched to signals by name, unit and shape."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from cosim.errors import UsageError
from cosim.files import write_text
from cosim.logs.load import stem

MODELS = (".ssp", ".fmu")


@dataclass(frozen=True)
class Matched:
    """What became of a log's columns.

    Attributes:
        file: the mapping.
        made: a line for each signal that has a column.
        left: what has no signal.
        needed: what a diagnosis cannot do without and is not there; empty if nothing is.
    """

    file: Path
    made: list[str]
    left: list[str]
    needed: str


def write_mapping(
    log: Path, model: str | None = None, machine: bool = False, out: Path | None = None, force: bool = False
) -> Matched:
    """Write a mapping file for a log.

    Args:
        log: the log.
        model: full_order, simplified, or any .ssp or .fmu; by default full_order.
        machine: another machine than the crane, of which the log tells speed and lag.
        out: the file to write; by default that of the log with .toml.
        force: write over a file that exists.

    Raises:
        UsageError: the file exists, or model and machine exclude each other.
        DataError, ModelError: log or model are bad.
    """
    target = out or log.with_name(f"{stem(log)}.toml")
    if target.exists() and not force:
        raise UsageError(f"{target} exists: name another file (--out), or write over it (--force)")
    if machine and model is not None:
        raise UsageError("--machine makes a model of its own: give no other beside it")
    asked = model or "full_order"
    if asked.lower().endswith(MODELS):
        text, made, left, needed = _of_connectors(Path(asked), log, target)
    else:
        text, made, left, needed = _of_signals(None if machine else asked, log)
    write_text(target, text)
    return Matched(target, made, left, needed)


def _of_connectors(model: Path, log: Path, target: Path) -> tuple[str, list[str], list[str], str]:
    """A mapping for any system; raises as `cosim.anysystem.start.mapping_text`."""
    from cosim.anysystem.start import mapping_text
    from cosim.ssp.read import read_system

    with read_system(model) as system:
        return mapping_text(system, model, log, target.parent)


def _lacking(made: Collection[str], texts: Mapping[str, str]) -> str:
    """What of the signals a diagnosis cannot do without and no column was found for; empty if nothing is.

    Args:
        made: the signals that have a column.
        texts: what each signal is.
    """
    drives = [name for name in ("u", "torque", "force") if name in texts]
    others = ", or for the torque or force that drives the axis" if drives[1:] else ""
    lacks = [] if set(drives) & set(made) else [f"a column for u ({texts['u']}){others}"]
    if not set(made) - set(drives):
        also = "travel, speed, " if "travel" in texts else ""
        lacks.append(
            f"{'one' if lacks else 'a column'} for what was measured, such as {also}slew, spool or the pressures"
        )
    return " and ".join(lacks)


def _of_signals(model: str | None, log: Path) -> tuple[str, list[str], list[str], str]:
    """A mapping for the signals of the crane or of a machine of its own (None), and what it lacks.

    Raises:
        DataError: as `cosim.logs.overview.measured`.
    """
    from cosim.logs.guess import (
        clock_column,
        guesses,
        mapping_text,
        of_other_axis,
        once_more,
        second_record,
        texts_of,
        used_by,
    )
    from cosim.logs.overview import measured

    found = measured(log)
    made = guesses(found, machine=model is None)
    told = [
        f"{g.column.label.shown}{f' minus {g.minus.label.shown}' if g.minus else ''} -> {name} [{g.unit}]: {g.why}"
        for name, g in made.items()
    ]
    if model is not None and (other := of_other_axis(made)):
        told.append(
            f"'{other}' is no slew angle by its name: for a drive of its own take cosim init --machine: CHECK"
        )
    second = second_record(found, made, clock_column(found, made))
    told += [f"{column.label.text} -> {name} of a record held out" for name, column in second.items()]
    used = used_by(made) | found.times | {column.index for column in second.values()}
    copies = once_more(found, used)
    used |= {column.index for column in copies}
    left = [f"column '{c.label.shown}'" for c in found.columns if c.index not in used]
    if copies:
        left.append(f"the same readings once more ({', '.join(c.label.text for c in copies)})")
    needed = _lacking(made, texts_of(model))
    if found.clock is None and found.interval is None:
        left.insert(0, "no column looks like a time")
        interval = "the interval between samples ('step', for which 0.001 s stands now)"
        needed = f"{needed}; {interval}" if needed else interval
    return mapping_text(found, made, model), told, left, needed
