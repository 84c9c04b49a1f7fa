"""``cosim init``: writes a first mapping for a log with other column names, for our crane or for anybody's model."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated

import typer

from cosim import console
from cosim.errors import UsageError

MODELS = (".ssp", ".fmu")
MOST = 8  # columns without a signal that the screen lists; the mapping has them all


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(init)


def init(
    first: Annotated[
        Path, typer.Argument(help="The log; or a package or FMU, and then the log.", metavar="[MODEL] LOG")
    ],
    second: Annotated[Path | None, typer.Argument(help="The log.", metavar="LOG", hidden=True)] = None,
    model: Annotated[
        str | None,
        typer.Option(help="full_order, simplified, or any .ssp or .fmu [default: full_order]."),
    ] = None,
    machine: Annotated[
        bool, typer.Option("--machine", help="Another machine than the crane: its log tells speed and lag.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Mapping file [default: LOG with .toml].", metavar="FILE"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Write a mapping: columns matched to signals by name, unit and shape, what is left in comments.

    With a package or FMU the signals are its connectors, else those of the crane.
    """
    from cosim.files import write_text
    from cosim.logs.load import stem

    log, asked = _log_and_model(first, second, model)
    target = out or log.with_name(f"{stem(log)}.toml")
    if target.exists() and not force:
        raise UsageError(f"{target} exists: name another file (--out), or write over it (--force)")
    if machine and (model is not None or second is not None):
        raise UsageError("--machine makes a model of its own: give no other beside it")
    if asked.lower().endswith(MODELS):
        (text, told, left), needed = _of_connectors(Path(asked), log, target), ""
    else:
        text, told, left, needed = _of_signals(None if machine else asked, log)
    write_text(target, text)
    if as_json:
        console.emit_json({"mapping": str(target), "matched": told, "open": left})
        return

    def say(line: str) -> None:
        console.stdout_console().print(line, markup=False, soft_wrap=True)

    for line in told:
        say(line)
    if left:
        more = f"; and {len(left) - MOST} more" if len(left) > MOST else ""
        say(f"left without a signal: {'; '.join(left[:MOST])}{more}")
    check = "complete it" if needed else "check each line, above all those marked CHECK"
    say(f"written to {target}: {check}")
    if needed:
        other = "" if machine else ". Another machine than the crane: --machine; any FMU: --model"
        say(f"Missing: {needed}{other}")
        say(
            f"Next: complete {target} in an editor, or choose the columns on a page: cosim open {console.typed(log)}"
        )
        return
    words = f"{console.typed(log)} --mapping {console.typed(target)}"
    say(f"Next: cosim info {words}, then cosim diagnose {words}")


def _log_and_model(first: Path, second: Path | None, model: str | None) -> tuple[Path, str]:
    """The log, and the model by name or file.

    Raises:
        UsageError: there is no log, or two models.
    """
    if second is None:
        if first.suffix.lower() in MODELS:
            raise UsageError(f"{first} is a model: name the log too, as in 'cosim init {first} LOG'")
        return first, model or "full_order"
    if model is not None:
        raise UsageError(f"two models, {first} and {model}: give one, as in 'cosim init LOG --model {model}'")
    return second, str(first)


def _of_connectors(model: Path, log: Path, target: Path) -> tuple[str, list[str], list[str]]:
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
    from cosim.logs.guess import clock_column, guesses, mapping_text, second_record, texts_of, used_by
    from cosim.logs.overview import measured

    found = measured(log)
    made = guesses(found, machine=model is None)
    told = [
        f"{g.column.label.shown}{f' minus {g.minus.label.shown}' if g.minus else ''} -> {name} [{g.unit}]: {g.why}"
        for name, g in made.items()
    ]
    second = second_record(found, made, clock_column(found, made))
    told += [f"{column.label.text} -> {name} of a record held out" for name, column in second.items()]
    used = used_by(made) | found.times | {column.index for column in second.values()}
    left = [f"column '{c.label.shown}'" for c in found.columns if c.index not in used]
    needed = _lacking(made, texts_of(model))
    if found.clock is None and found.interval is None:
        left.insert(0, "no column looks like a time")
        interval = "the interval between samples ('step', for which 0.001 s stands now)"
        needed = f"{needed}; {interval}" if needed else interval
    return mapping_text(found, made, model), told, left, needed
