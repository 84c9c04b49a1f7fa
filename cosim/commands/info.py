"""``cosim info``: what a file holds: a log, a tracker's record, an FMU or a system."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cosim import console
from cosim.options import Verbose

MOST_ROWS = 2000  # of a table for a person; laying out more takes seconds
CAUSALITIES = ("input", "output", "parameter")
WHOLE = {  # what is told of a system as a whole
    "position_loop": "Position loop",
    "limit_cycle": "Limit cycle",
    "flow_gains": "Flow gains",
    "pressure_and_motion": "Pressure and motion",
}


def register(app: typer.Typer) -> None:
    """Adds the command ``info``."""
    app.command()(info)


def info(
    file: Annotated[
        Path,
        typer.Argument(
            help="A log, a tracker's record, an .fmu, an .ssp, or one of our systems by its name."
        ),
    ],
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping file (TOML), for a log whose columns have other names.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="A row of bars for each column of a log.")] = False,
    verbose: Verbose = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Show what a file holds: signals, units, ranges, sampling and damage of a log; the main facts of a model.

    A log whose columns have other names is shown as it stands, with guesses which column is which signal.

    Exit code 3: the file is bad; 5: its type needs an optional dependency.
    """
    from cosim.api.looking import facts_of

    facts = facts_of(file, mapping, plot)
    variables = [shortened(row) for row in facts.get("variables", ())]
    kinds = ("signals", "columns", "connectors", "files")
    rows = variables or next((facts[kind] for kind in kinds if facts.get(kind)), [])
    if as_json:
        console.emit_json(facts)
        return
    output = console.stdout_console()
    first = headline(facts)
    if first:
        output.print(first, soft_wrap=True, markup=False)
    for key, value in facts.items() if verbose or not first else ():
        if key not in ("why", "next") and not isinstance(value, (list, dict)):
            text = f"{value:.12g}" if isinstance(value, float) else value
            output.print(f"{key}: {text}", soft_wrap=True, markup=False)
    if rows:
        shown = [list(row.values()) for row in rows[:MOST_ROWS]]
        output.print(console.table("", list(rows[0]), shown))
        if len(rows) > MOST_ROWS:
            output.print(f"and {len(rows) - MOST_ROWS} more: see them all with --json", markup=False)
    for warning in facts.get("warnings", ()):
        console.warn(warning)
    for line in facts.get("plot", ()):
        output.print(line, markup=False, soft_wrap=True)
    for line in (*_guessed(facts.get("guesses", {})), facts.get("next", "")):
        if line:
            output.print(line, markup=False, soft_wrap=True)


def headline(facts: dict[str, Any]) -> str:
    """What a log is, in a line: how long, how fast, how whole, and what of it is known; empty for a model."""
    samples = f"{facts['samples']} samples" if "samples" in facts else ""
    if facts["kind"] in ("log", "tracker"):
        what = f"{facts['origin']} {'log' if facts['kind'] == 'log' else 'record of the tracker'}"
        unit = facts["time_unit"]
        rate = f" at {1.0 / facts['step']:.5g} a {'second' if unit == 's' else unit}" if facts["step"] else ""
        even = "" if facts["uniform"] else ", unevenly spaced"
        holes = f", {facts['gaps']} gaps" if facts["gaps"] else ", no gap"
        model = f", for the model {facts['model']}" if "model" in facts else ""
        return (
            f"{facts['file']}: {what}, {samples}, {facts['duration']:.5g} {unit}{rate}{even}{holes}, "
            f"{len(facts['signals'])} signals{model}"
        )
    if facts["kind"] == "fmu":
        return _fmu_line(facts)
    if facts["kind"] == "ssp":
        return _ssp_line(facts)
    time = facts.get("time", "")
    if not time:
        from cosim.api.looking import OWN_STAMPS

        holes = f", {facts['gaps']} gaps" if facts["gaps"] else ", no gap"
        even = "" if facts["uniform"] else ", unevenly spaced"
        back = f", time stands or goes back {facts['not_rising']} times" if facts["not_rising"] else ""
        name, (unit, _, guessed) = facts["time_column"], facts["time_unit"].partition(" (")
        called = f"column {name}" if name.isdigit() else f"'{name}'"
        told = f"time is {called}{', taken to count' if guessed else ' in'} {unit}"
        time = (
            f"{facts['duration']} at {facts['rate'].replace(' samples', '')}{even}{holes}{back}; "
            f"{OWN_STAMPS if name == OWN_STAMPS else told}"
        )
    whose = "a drive of its own" if facts["machine"] else "the crane"
    likely = f"{len(facts['guesses'])} of {len(facts['columns'])} columns look like signals of {whose}"
    return f"{facts['file']}: {samples}, {time}; {likely}"


def _fmu_line(facts: dict[str, Any]) -> str:
    """What an FMU is, in a line."""
    count = {kind: sum(v["causality"] == kind for v in facts["variables"]) for kind in CAUSALITIES}
    what = ", ".join(f"{n} {kind}{'s' * (n != 1)}" for kind, n in count.items())
    text = f": {facts['description']}" if facts["description"] else ""
    others = f", only for {facts['platforms']}" if facts["platforms"] else ""
    here = "" if facts["here"] else f"; without a binary for this machine{others}"
    return f"{facts['file']}: FMU {facts['name']}{text} (FMI {facts['fmi_version']}, {facts['type']}); {what}{here}"


def _ssp_line(facts: dict[str, Any]) -> str:
    """What a package is, and with names and units what is known of the system as a whole."""
    from cosim.api.looking import ours
    from cosim.report.names import BLOCK_NAMES

    if "connectors" not in facts:
        return f"{facts['file']}: system package (SSP)"
    inputs = [] if facts["inputs"] == "none" else facts["inputs"].split(", ")
    open_ = [row["connector"] for row in facts["connectors"] if row["joined with"] == "nothing"]
    own = (
        f"driven by a log at {', '.join(open_)}, which nothing in it feeds"
        if open_
        else "with its own stimulus"
    )
    outside = f"driven from outside by {', '.join(inputs)}" if inputs else own
    told = [f"{facts['file']}: system of {len(facts['parts'])} components (SSP), {outside}"]
    names = BLOCK_NAMES if ours(facts["file"]) else {}
    for part in facts["parts"]:
        own = part["component"]
        name = names.get(own, own.replace("_", " "))
        told.append(f"  {own}{'' if name == own.replace('_', ' ') else f', {name}'}: {part['fmu']}")
    told += [f"{title}: {facts[key]}" for key, title in WHOLE.items() if key in facts]
    return "\n".join(told)


def _guessed(guesses: dict[str, dict[str, Any]]) -> list[str]:
    return [
        f"{name} is probably {'column ' if g['column'].isdigit() else ''}'{g['column']}' [{g['unit']}]: {g['why']}"
        for name, g in guesses.items()
    ]


def shortened(row: dict[str, Any]) -> dict[str, Any]:
    """A variable for a table: its start value by what counts of it."""
    try:
        return row | {"start": f"{float(row['start']):.8g}"}
    except ValueError:
        return row
