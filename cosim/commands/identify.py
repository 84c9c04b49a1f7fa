"""``cosim identify``: numbers of the drive from logs, chapter 4 of the source."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.options import Verbose

Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Folder for .ssv or mapping, picture and JSON.", metavar="DIR"),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def register(app: typer.Typer) -> None:
    """Adds the command ``identify`` with its subcommands."""
    from cosim.api import numbers

    group = typer.Typer(
        help="Numbers of the drive from logs: dead zone, frequency response, transfer functions, mechanics, static "
        "curve, observer.",
        no_args_is_help=True,
    )
    answered: dict[str, Callable[..., Any]] = {
        "all": numbers.everything,
        "dead-zone": numbers.dead_zone,
        "frf": numbers.frf,
        "transfer-function": numbers.transfer_function,
        "mechanics": numbers.mechanics,
        "drive": numbers.drive,
        "observer": numbers.observer,
        "kalman": numbers.kalman,
        "scaling": numbers.scaling,
        "linearisation": numbers.linearisation,
        "markers": numbers.markers,
    }
    for name, identify in answered.items():
        group.command(name)(_command(identify, _finish))
    group.command("experiment")(_command(numbers.experiment, _show))
    app.add_typer(group, name="identify")


def _command(identify: Callable[..., Any], end: Callable[..., None]) -> Callable[..., None]:
    """The command that takes the arguments of `identify` and those of `end` after the result, which ends it."""
    own = inspect.signature(identify)
    ending = [p.replace(kind=p.KEYWORD_ONLY) for p in list(inspect.signature(end).parameters.values())[1:]]

    def command(**given: Any) -> None:
        options = {p.name: given.pop(p.name) for p in ending}
        end(identify(**given), **options)

    command.__doc__ = identify.__doc__
    command.__signature__ = own.replace(  # type: ignore[attr-defined]
        parameters=[*own.parameters.values(), *ending], return_annotation=None
    )
    return command


def _finish(found: Any, out: Out = None, verbose: Verbose = False, as_json: AsJson = False) -> None:
    from cosim.identify.answer import finish

    finish(found, out, as_json, verbose)


def _show(found: dict[str, Any], as_json: AsJson = False) -> None:
    from cosim import console

    if as_json:
        console.emit_json(found)
        return
    output = console.stdout_console()
    name, travel, length = found["experiment"], found["travel"]["value"], found["duration"]["value"]
    for text in (
        f"{name}: {length:.6g} s, about {travel:.3g} deg of slew peak to peak at the nominal gain",
        *(f"written: {file}" for file in found["files"].values()),
    ):
        output.print(text, markup=False, soft_wrap=True)
