"""``cosim rig``: a synthetic log of the crane, with anything hidden in it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cosim.rig import Noise, RigRun


def register(app: typer.Typer) -> None:
    """Add the command ``rig``."""
    app.command("rig")(rig)


def rig(
    out: Annotated[Path, typer.Option("--out", "-o", help="Log to write: .csv, .parquet or .mat.")] = Path(
        "synthetic.csv"
    ),
    excitation: Annotated[
        str, typer.Option(help="mixed, sweep, steps, small_steps, triangle, multisine, chirp or file.")
    ] = "mixed",
    played: Annotated[
        Path | None,
        typer.Option("--input", help="CSV with 'time [s]' and 'u [1]' for the excitation 'file'."),
    ] = None,
    duration: Annotated[str, typer.Option(help="Length of the log, such as '60 s'.")] = "60 s",
    amplitude: Annotated[float, typer.Option(help="Of the command, 0 to 1.")] = 1.0,
    seed: Annotated[int, typer.Option(help="The same seed gives the same file.")] = 1,
    start: Annotated[
        str | None, typer.Option(help="Slew angle at the start, such as '10 deg' (a bare number is in rad).")
    ] = None,
    hide: Annotated[
        list[str] | None,
        typer.Option(help="Effect to hide, such as 'mechanical.coulomb_friction:tau_c=300 N.m'; repeatable."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Nominal number that is off, such as 'mechanical.J=800 kg.m2'."),
    ] = None,
    friction: Annotated[str, typer.Option(help="sharp, or lugre (bristles with the same curve).")] = "sharp",
    noise: Annotated[float, typer.Option(help="Factor on the usual noise; 0 is none.")] = 1.0,
    noise_kind: Annotated[str, typer.Option(help="white, ar1 or pink.")] = "white",
    noise_time: Annotated[str, typer.Option(help="Correlation time of ar1.")] = "10 ms",
    noise_size: Annotated[
        list[str] | None, typer.Option(help="Noise of one signal, such as 'slew=0.02 deg'; repeatable.")
    ] = None,
    observer: Annotated[bool, typer.Option(help="Add the observer's estimates.")] = False,
    tracker: Annotated[Path | None, typer.Option(help="File for the optical tracker's record.")] = None,
    effects: Annotated[bool, typer.Option("--effects", help="List what can be hidden, and stop.")] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object (path, truth) and nothing else.")
    ] = False,
) -> None:
    """Make a synthetic log of the crane: nominal, or with effects hidden in it; the truth goes to <log>.truth.json."""
    if effects:
        _list_effects(json)
        return
    from cosim.errors import UsageError
    from cosim.rig import make_log
    from cosim.rig.hidden import parse_setting
    from cosim.rig.write import check_suffix, write, write_tracker, write_truth
    from cosim.units import parse_quantity

    for path in filter(None, (out, tracker)):
        check_suffix(path)
    if tracker is not None and tracker.resolve() == out.resolve():
        raise UsageError(f"log and tracker record would both be written to {out}: give two names")
    run = make_log(
        excitation,
        _length(duration, excitation, played),
        hide or [],
        settings=dict(parse_setting(text) for text in settings or []),
        noise=_noise(noise, noise_kind, noise_time, noise_size or []),
        seed=seed,
        amplitude=amplitude,
        start=None if start is None else parse_quantity(start, "rad"),
        friction=friction,
        observer=observer,
        tracker=tracker is not None,
        command_file=played,
    )
    write(run, out)
    if tracker is not None:
        write_tracker(run, tracker)
    truth = write_truth(run, out)
    _report(run, out, truth, tracker, json)


def _length(text: str, excitation: str, played: Path | None) -> float:
    """Duration [s]: a played file's own length unless --duration is given otherwise than by default."""
    from cosim.units import parse_quantity

    if text == "60 s" and excitation == "file" and played is not None:
        from cosim.rig.excitation import read_command

        stamps, _ = read_command(played)
        return max(2, round(float(stamps[-1]) / 1e-3)) * 1e-3
    return parse_quantity(text, "s")


def _noise(scale: float, kind: str, time: str, sizes: list[str]) -> "Noise":
    """The noise the options describe."""
    from cosim.errors import UsageError
    from cosim.rig import Noise
    from cosim.rig.noise import SIZES, UNITS
    from cosim.units import parse_quantity

    chosen = {}
    for text in sizes:
        signal, equals, quantity = text.partition("=")
        if not equals or signal.strip() not in SIZES:
            raise UsageError(
                f"--noise-size '{text}' should read signal=size, with a signal of {', '.join(SIZES)}"
            )
        chosen[signal.strip()] = parse_quantity(quantity, UNITS[signal.strip()])
    return Noise(scale, kind, parse_quantity(time, "s"), chosen)


def _report(run: "RigRun", out: Path, truth: Path, tracker: Path | None, json: bool) -> None:
    """Say what was written: one JSON object, or a few lines that call it synthetic."""
    from cosim.console import emit_json, stderr_console, stdout_console

    if json:
        found: dict[str, object] = {
            "path": str(out),
            "truth_path": str(truth),
            "truth": run.truth,
            "synthetic": True,
        }
        if tracker is not None:
            found["tracker_path"] = str(tracker)
        emit_json(found)
    for note in run.notes:
        stderr_console().print(f"note: {note}", markup=False)
    if json:
        return
    console = stdout_console()
    hidden = run.truth["hidden"]
    names = ", ".join(item["effect"] for item in hidden) or "nothing"  # type: ignore[attr-defined]
    console.print(f"synthetic log, {run.time[-1]:g} s, hidden in it: {names}", markup=False)
    for path in filter(None, (out, tracker, truth)):
        console.print(f"  {path}", markup=False, soft_wrap=True)


def _list_effects(json: bool) -> None:
    """Print every effect with its parameters: off value, moderate size, range, meaning."""
    from cosim.console import emit_json, stdout_console
    from cosim.rig import EFFECTS, PARAMETERS
    from cosim.rig.parameters import nominal_value

    rows = []
    for effect, item in EFFECTS.items():
        for name, moderate in item.moderate.items():
            unit, low, high = PARAMETERS[name].unit, PARAMETERS[name].low, PARAMETERS[name].high
            rows.append({"effect": effect, "parameter": name.split(".")[1], "unit": unit, "off": nominal_value(name),
                         "moderate": moderate, "low": low, "high": high, "meaning": PARAMETERS[name].text})  # fmt: skip
    if json:
        emit_json({"effects": rows})
        return
    console, last = stdout_console(), ""
    console.print(
        "Effects: parameter, off -> moderate size, allowed range, meaning. All in SI units.", markup=False
    )
    for row in rows:
        if row["effect"] != last:
            last = str(row["effect"])
            console.print(last, markup=False, style="bold", soft_wrap=True)
        line = "  {parameter:8} {off:.6g} -> {moderate:.6g} {unit}  ({low:g} .. {high:g})  {meaning}"
        console.print(line.format(**row), markup=False, soft_wrap=True)
