"""``cosim init``: writes a first mapping for a log with other column names, for our crane or for anybody's model."""

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
    from cosim.api.matching import write_mapping

    log, asked = _log_and_model(first, second, model)
    matched = write_mapping(log, asked, machine, out, force)
    target, left, needed = matched.file, matched.left, matched.needed
    if as_json:
        console.emit_json({"mapping": str(target), "matched": matched.made, "open": left})
        return

    def say(line: str) -> None:
        console.stdout_console().print(line, markup=False, soft_wrap=True)

    for line in matched.made:
        say(line)
    if left:
        more = f"; and {len(left) - MOST} more" if len(left) > MOST else ""
        say(f"left without a signal: {'; '.join(left[:MOST])}{more}")
    check = "complete it" if needed else "check each line, above all those marked CHECK"
    say(f"written to {target}: {check}")
    if needed:
        own = machine or (asked or "").lower().endswith(MODELS)
        other = "" if own else ". Another machine than the crane: --machine; any FMU: --model"
        say(f"Missing: {needed}{other}")
        say(
            f"Next: complete {target} in an editor, or choose the columns on a page: cosim open {console.typed(log)}"
        )
        return
    words = f"{console.typed(log)} --mapping {console.typed(target)}"
    say(f"Next: cosim info {words}, then cosim diagnose {words}")


def _log_and_model(first: Path, second: Path | None, model: str | None) -> tuple[Path, str | None]:
    """The log, and the model by name or file if there is one.

    Raises:
        UsageError: there is no log, or two models.
    """
    if second is None:
        if first.suffix.lower() in MODELS:
            raise UsageError(f"{first} is a model: name the log too, as in 'cosim init {first} LOG'")
        return first, model
    if model is not None:
        raise UsageError(f"two models, {first} and {model}: give one, as in 'cosim init LOG --model {model}'")
    return second, str(first)
