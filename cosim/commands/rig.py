"""``cosim rig``: a synthetic log of the crane, with anything hidden in it."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cosim.rig import RigRun


Text = str | None
Texts = list[str] | None
Out = Annotated[Path, typer.Option("--out", "-o", help="Log to write: .csv, .parquet or .mat.")]
Excitation = Annotated[
    str, typer.Option(help="mixed, sweep, square, steps, small_steps, triangle, multisine, chirp or file.")
]
Played = Annotated[
    Path | None,
    typer.Option("--input", help="CSV with a time in s and a u column, for the excitation 'file'."),
]
Duration = Annotated[Text, typer.Option(help="Length of the log; '60 s', or that of the played file.")]
Amplitude = Annotated[float, typer.Option(help="Of the command, 0 to 1.")]
Seed = Annotated[int, typer.Option(help="The same seed gives the same file.")]
Start = Annotated[
    Text, typer.Option(help="Slew angle at the start, such as '10 deg' (a bare number is in rad).")
]
Hide = Annotated[
    Texts,
    typer.Option(help="Effect to hide, such as 'mechanical.coulomb_friction:tau_c=300 N.m'; repeatable."),
]
Settings = Annotated[
    Texts,
    typer.Option("--set", help="Nominal number that is off, such as 'mechanical.J=800 kg.m2'; repeatable."),
]
Model = Annotated[
    str,
    typer.Option(help="full_order, or physical: orifices and two chambers, where the motion takes up flow."),
]
Friction = Annotated[
    str, typer.Option(help="sharp, lugre (bristles with the same curve) or smooth (no sticking).")
]
NoiseScale = Annotated[float, typer.Option(help="Factor on the usual noise; 0 is none.")]
NoiseKind = Annotated[str, typer.Option(help="white, ar1 or pink.")]
NoiseTime = Annotated[str, typer.Option(help="Correlation time of ar1.")]
NoiseSize = Annotated[Texts, typer.Option(help="Noise of one signal, such as 'slew=0.02 deg'; repeatable.")]
WithObserver = Annotated[bool, typer.Option("--observer", help="Add the observer's estimates.")]
TrackerFile = Annotated[Path | None, typer.Option(help="File for the optical tracker's record.")]
MarkersFile = Annotated[
    Path | None,
    typer.Option(
        help="File for the positions of the tracker's markers; its angle then comes from their poses."
    ),
]
Card = Annotated[
    bool,
    typer.Option(
        "--card",
        help="Let every analogue channel pass the input card's filter: Butterworth, order 2, 1 kHz, in samples at 250 kHz.",
    ),
]
ListEffects = Annotated[bool, typer.Option("--effects", help="List what can be hidden, and stop.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object (path, truth) and nothing else.")]


def register(app: typer.Typer) -> None:
    """Add the command ``rig``."""
    app.command("rig")(rig)


def rig(
    out: Out = Path("synthetic.csv"),
    excitation: Excitation = "mixed",
    played: Played = None,
    duration: Duration = None,
    amplitude: Amplitude = 1.0,
    seed: Seed = 1,
    start: Start = None,
    hide: Hide = None,
    settings: Settings = None,
    model: Model = "full_order",
    friction: Friction = "sharp",
    noise: NoiseScale = 1.0,
    noise_kind: NoiseKind = "white",
    noise_time: NoiseTime = "10 ms",
    noise_size: NoiseSize = None,
    observer: WithObserver = False,
    tracker: TrackerFile = None,
    markers: MarkersFile = None,
    card: Card = False,
    effects: ListEffects = False,
    json: AsJson = False,
) -> None:
    """Make a synthetic log of the crane: nominal, or with effects hidden in it; the truth goes to <log>.truth.json."""
    if effects:
        _list_effects(json)
        return
    from cosim.api.rigging import Asked, make_files

    asked = Asked(excitation=excitation, played=played, duration=duration, amplitude=amplitude, seed=seed, start=start,
                  hide=hide or [], settings=settings or [], model=model, friction=friction, noise=noise,
                  noise_kind=noise_kind, noise_time=noise_time, noise_size=noise_size or [], observer=observer,
                  card=card)  # fmt: skip
    run, truth, models = make_files(asked, out, tracker, markers)
    _report(run, out, truth, [tracker, markers, models], json)


def _report(run: "RigRun", out: Path, truth: Path, others: list[Path | None], json: bool) -> None:
    """Say what was written: one JSON object, or a few lines that call it synthetic.

    `others` are the files of the tracker's record, its markers and their models, as far as they were asked for.
    """
    from cosim.console import emit_json, stderr_console, stdout_console, typed
    from cosim.report.screen import known_as

    if json:
        found: dict[str, object] = {
            "path": str(out),
            "truth_path": str(truth),
            "truth": run.truth,
            "synthetic": True,
        }
        keys = ("tracker_path", "markers_path", "models_path")
        found |= {name: str(path) for name, path in zip(keys, others, strict=True) if path is not None}
        emit_json(found)
    for note in run.notes:
        stderr_console().print(f"note: {note}", markup=False, soft_wrap=True)
    if json:
        return
    console = stdout_console()
    names = ", ".join(known_as(effect["effect"]) for effect in run.truth["hidden"]) or "nothing"
    console.print(f"synthetic log, {run.time[-1]:g} s, hidden in it: {names}", markup=False, soft_wrap=True)
    if run.markers is not None:
        step = run.truth["markers"]["seam"]["value"] * 180.0 / math.pi
        console.print(
            f"marker models: a seam of {step:.4f} deg; {run.markers.stitched.summary()}",
            markup=False,
            soft_wrap=True,
        )
    for path in filter(None, (out, *others, truth)):
        console.print(f"  {path}", markup=False, soft_wrap=True)
    tracker = next((path for path in others[:2] if path is not None), None)
    words = f"{typed(out)}{'' if tracker is None else f' --external {typed(tracker)}'}"
    model = run.truth["model"]
    words += "" if model == "full_order" else f" --model {model}"
    what = "looks for it" if run.truth["hidden"] else "shows what a diagnosis says of a log without a fault"
    console.print(f"Next: cosim diagnose {words} {what}", markup=False, soft_wrap=True)


def _list_effects(json: bool) -> None:
    """Print every effect with its parameters: off value, moderate size, range, meaning."""
    from cosim.api.rigging import effects_listed
    from cosim.console import emit_json, stdout_console

    rows = effects_listed()
    if json:
        emit_json({"effects": rows})
        return
    console, last = stdout_console(), ""
    console.print(
        "Effects: parameter, off -> moderate size, allowed range, meaning. All in SI units.",
        markup=False,
        soft_wrap=True,
    )
    for row in rows:
        if row["effect"] != last:
            last = str(row["effect"])
            console.print(last, markup=False, style="bold", soft_wrap=True)
        line = "  {parameter:8} {off:.6g} -> {moderate:.6g} {unit}  ({low:g} .. {high:g})  {meaning}"
        console.print(line.format(**row), markup=False, soft_wrap=True)
