"""``cosim doctor``: what this host lacks, each with its remedy."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from cosim import console

_COLOURS = {"ok": "green", "warning": "yellow", "missing": "red"}
_HOST_UNFIT = 4
_EXTRA_MISSING = 5


def register(app: typer.Typer) -> None:
    """Adds the command ``doctor``."""
    app.command()(doctor)


def doctor(
    paths: Annotated[list[Path] | None, typer.Argument(help="Further folders you mean to work in.")] = None,
    require: Annotated[
        list[str] | None, typer.Option(help="An optional-dependency group that must be there; repeatable.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Show what this host lacks to build, run and compare the components.

    Exit code 0: all that is required is there; 4: it is not; 5: only an extra asked for with --require is missing.
    """
    from cosim.doctor import examine

    findings = examine(paths or (), require or ())
    missing = [finding for finding in findings if finding.state == "missing"]
    code = (
        _EXTRA_MISSING
        if missing and all(finding.extra for finding in missing)
        else _HOST_UNFIT
        if missing
        else 0
    )
    counts = {state: sum(finding.state == state for finding in findings) for state in _COLOURS}
    if as_json:
        console.emit_json({"exit_code": code, "counts": counts, "findings": findings})
    else:
        from rich.text import Text

        output = console.stdout_console()
        order = list(_COLOURS)
        for finding in sorted(findings, key=lambda finding: order.index(finding.state)):
            label = Text(f"{finding.state:>8}  ", style=_COLOURS[finding.state])
            text = f": {finding.detail}" + (f"; remedy: {finding.remedy}" if finding.remedy else "")
            output.print(Text.assemble(label, (finding.name, "bold"), text), soft_wrap=True)
        output.print(_answer(code, counts), markup=False, soft_wrap=True)
    if code:
        raise typer.Exit(code)


def _answer(code: int, counts: Mapping[str, int]) -> str:
    """What the findings come to, in one sentence."""
    fit = {
        0: "This host builds, runs and compares the models",
        _EXTRA_MISSING: "This host builds, runs and compares the models, but an extra that was asked for is absent",
    }.get(code, "This host cannot build or run the models: see the lines marked missing")
    optional = counts["warning"]
    return fit + (
        f"; {optional} optional thing{'s' if optional > 1 else ''} absent or at risk." if optional else "."
    )
