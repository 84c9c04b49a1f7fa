"""``cosim machine``: the wiring, the values and the package of a machine that one file describes."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cosim import console


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(machine)


def machine(
    mapping: Annotated[
        Path, typer.Argument(help="Mapping file (TOML) with a table 'machine'.", metavar="FILE")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for .ssd, .ssv and .ssp.", metavar="DIR")],
    log: Annotated[
        Path | None,
        typer.Option(help="Log of the machine: tells what the file leaves open ('?').", metavar="LOG"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Write the model of a machine for other tools: wiring, values and package, made from its chain of blocks.

    The commands that take a log make it by themselves (--mapping FILE).
    """
    from cosim.logs import load_log
    from cosim.machines import write_machine

    loaded = load_log(log, mapping) if log is not None else None
    for warning in loaded.warnings if loaded is not None else ():
        console.warn(warning)
    made, files = write_machine(mapping, out, loaded)
    rows: list[list[object]] = []
    values: dict[str, Any] = {}
    for name, value in made.numbers.values.items():
        component, _, parameter = name.partition(".")
        variable = made.machine.variable(name)
        unit = made.machine.units.get(variable.unit, variable.unit)
        stated = name in made.machine.parameters and name not in made.numbers.from_log
        source = "stated" if stated else "from the log" if name in made.numbers.from_log else "by default"
        rows.append([component, parameter, f"{value:.4g}", unit, source])
        values[name] = {"value": value, "unit": unit, "source": source}
    if as_json:
        console.emit_json({"machine": str(mapping), "chain": list(made.machine.chain), "parameters": values,
                           "diagnose": made.diagnose, "files": [str(f) for f in files]})  # fmt: skip
        return
    output = console.stdout_console()
    output.print(
        console.table(
            f"{mapping.name}: {' -> '.join(made.machine.chain)}",
            ["block", "parameter", "value", "unit", ""],
            rows,
        )
    )
    for file in files:
        output.print(f"written: {file}", markup=False, soft_wrap=True)
