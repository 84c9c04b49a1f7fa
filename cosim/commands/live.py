"""``cosim live``: the controller, or the crane, at one end of the UDP link of section 3.6."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cosim import console

Text = str | None
Texts = list[str] | None
Listen = Annotated[int, typer.Option(help="Port to listen on; 0 takes a free one, which is told.")]
Peer = Annotated[
    Text, typer.Option(help="HOST:PORT to send to [default: whoever sends; a crane must be told].")
]
Bind = Annotated[str, typer.Option(help="Address of this machine to listen on.")]  # fmt: skip
LayoutFile = Annotated[Path | None, typer.Option("--layout", help="Of the datagrams (TOML).", metavar="FILE")]  # fmt: skip
Duration = Annotated[Text, typer.Option(help="Such as '60 s'; without it until Ctrl-C.")]
Out = Annotated[Path | None, typer.Option("--out", "-o", help="Log to write while it runs: .csv or .parquet.")]  # fmt: skip
Excitation = Annotated[
    Text, typer.Option(help="Manual command: mixed, sweep, steps, small_steps, triangle, multisine, chirp.")
]
Played = Annotated[
    Path | None,
    typer.Option(
        "--input",
        "--stimulus",
        help="Manual command: CSV with columns for time in s and u, -1 to 1.",
        metavar="FILE",
    ),
]
Amplitude = Annotated[float, typer.Option(help="Of the excitation or the played command, 0 to 1.")]
Seed = Annotated[int, typer.Option(help="Of the excitation, or of the crane's noise.")]
Commands = Annotated[
    Text,
    typer.Option(
        help="Lines such as 'u 0.3', 'auto', 'target 20 deg', 'stop', 'quit': from stdin (-), or from a file with the time"
        " in s before each.",
        metavar="-|FILE",
    ),
]
Automatic = Annotated[bool, typer.Option("--automatic", help="Begin in automatic.")]
Target = Annotated[Text, typer.Option(help="Where automatic goes, such as '20 deg'.")]
Gains = Annotated[Texts, typer.Option("--gain", help="Of the controller, such as 'k_p=0.5 1/deg'; repeatable.")]  # fmt: skip
Compensated = Annotated[
    bool, typer.Option("--compensated", help="The command on the wire is behind the dead zone's compensator.")
]
Synthetic = Annotated[bool, typer.Option("--synthetic", help="Mark the log as synthetic.")]
RealTime = Annotated[bool, typer.Option("--real-time", help="Ask for real-time priority (Linux).")]  # fmt: skip
IsCrane = Annotated[bool, typer.Option("--crane", help="Be the crane: the virtual rig, or --model.")]
Model = Annotated[Text, typer.Option(help="Crane: full_order, ... or an open .ssp instead of the rig.")]  # fmt: skip
Effect = Annotated[
    Texts,
    typer.Option("--effect", "--hide", help="Crane: effect to switch on, such as 'dcv.delay:tau_d=20 ms'."),
]
Settings = Annotated[Texts, typer.Option("--set", help="Crane: such as 'mechanical.J=800 kg.m2'; repeatable.")]  # fmt: skip
NoiseScale = Annotated[float, typer.Option(help="Crane: factor on the usual noise; 0 is none.")]
Start = Annotated[Text, typer.Option(help="Crane: slew angle at the start [default: 12 deg].")]
Friction = Annotated[str, typer.Option(help="Crane: sharp, lugre or smooth.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def register(app: typer.Typer) -> None:
    """Adds the command ``live``."""
    app.command()(live)


def live(
    listen: Listen = 5001,
    peer: Peer = None,
    bind: Bind = "127.0.0.1",
    layout: LayoutFile = None,
    duration: Duration = None,
    out: Out = None,
    excitation: Excitation = None,
    played: Played = None,
    amplitude: Amplitude = 1.0,
    seed: Seed = 1,
    commands: Commands = None,
    automatic: Automatic = False,
    target: Target = None,
    gain: Gains = None,
    compensated: Compensated = False,
    synthetic: Synthetic = False,
    real_time: RealTime = False,
    crane: IsCrane = False,
    model: Model = None,
    effect: Effect = None,
    settings: Settings = None,
    noise: NoiseScale = 1.0,
    start: Start = None,
    friction: Friction = "sharp",
    as_json: AsJson = False,
) -> None:
    """Run the controller at the crane's UDP link, 1 kHz: samples in, commands out, everything on a log; or be the crane.

    SIGUSR1 is an emergency stop. Ctrl-C and SIGTERM end the run in order; the log then is as whole as after its duration.
    """
    from cosim.live.run import Asked, run

    asked = Asked(listen=listen, peer=peer, bind=bind, layout=layout, duration=duration, out=out, excitation=excitation,
                  played=played, amplitude=amplitude, seed=seed, commands=commands, automatic=automatic, target=target,
                  gain=gain, compensated=compensated, synthetic=synthetic, real_time=real_time, crane=crane, model=model,
                  effect=effect, settings=settings, noise=noise, start=start, friction=friction)  # fmt: skip
    _show(run(asked), as_json)


def _show(facts: dict[str, Any], as_json: bool) -> None:
    """The account of the run; what went wrong as warnings."""
    counts, log = facts["datagrams"], facts["log"]
    if not counts["received"]:
        console.warn(f"no datagram came to {facts['listen']}: does the other side send there?")
    if log is not None and log["rows_lost"]:
        console.warn(f"{log['path']}: {log['rows_lost']} rows could not be written: {log['error']}")
    if as_json:
        console.emit_json(facts)
        return
    output = console.stdout_console()
    late = facts["lateness"]
    title = f"{facts['role']}: {facts['slots']} slots of 1 ms"
    always = ("received", "lost", "late")
    rows = [[name.replace("_", " "), n] for name, n in counts.items() if n or name in always]
    output.print(title, markup=False, soft_wrap=True)  # a title would be as narrow as the table
    output.print(console.table("", ["datagrams", "number"], [*rows, ["sent", facts["sent"]]]))
    figures = ", ".join(f"{name} {1e3 * late[name]:.3f} ms" for name in ("p50", "p99", "p99.9", "worst"))
    output.print(f"ended: {facts['ended']}", markup=False)
    output.print(f"lateness: {figures}; {facts['overrun']} slots overrun", markup=False, soft_wrap=True)
    for event in facts.get("events", ()):
        output.print(f"  {event['time']:9.3f} s  {event['what']}", markup=False, soft_wrap=True)
    if log is not None:
        kind = "synthetic log" if facts["synthetic"] else "log"
        output.print(f"{kind}: {log['path']}, {log['rows']} rows", markup=False, soft_wrap=True)
