"""``cosim validate``: check an FMU or a system package against its standard."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console

_BAD_FILE = 3


def register(app: typer.Typer) -> None:
    """Adds the command ``validate``."""
    app.command()(validate)


def validate(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="FMUs (.fmu), systems (.ssp, or full_order and the like), parameter sets (.ssv)."
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Check files against FMI 2.0 or 3.0 and SSP 1.0, and for what makes clients stumble.

    Exit code 0: no errors (there may be warnings); 3: a file breaks its standard or cannot be run here.
    """
    from cosim.api import building

    found = building.validate(files)
    invalid = [file for file, problems in found.items() if any(p.severity == "error" for p in problems)]
    bad, taken = bool(invalid), [file for file in invalid if building.is_taken(Path(file))]
    if as_json:
        console.emit_json({"valid": not bad, "files": found, "invalid_but_taken": taken})
    else:
        output = console.stdout_console()
        for file, problems in found.items():
            output.print(f"{file}: {'invalid' if file in invalid else 'valid'}", markup=False, soft_wrap=True)
            for problem in problems:
                output.print(f"  {problem}", markup=False, soft_wrap=True)
            if file in taken:
                output.print(
                    "  cosim simulate, compare and diagnose take it all the same; strict clients may not",
                    soft_wrap=True,
                )
    if bad:
        raise typer.Exit(_BAD_FILE)
