"""``cosim live``: the controller, or the crane, at one end of the UDP link of section 3.6."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim import console

if TYPE_CHECKING:
    from cosim.live.codec import Codec
    from cosim.live.crane import Crane, Plant
    from cosim.live.link import Link
    from cosim.live.master import Master
    from cosim.live.recorder import Recorder

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
    from cosim.errors import UsageError
    from cosim.live.codec import Codec
    from cosim.live.layout import load_layout
    from cosim.live.link import Link, parse_peer
    from cosim.live.recorder import check_suffix
    from cosim.request import seconds

    _check_side(
        crane,
        {"--excitation": excitation, "--input": played, "--commands": commands, "--target": target, "--gain": gain,
         "--automatic": automatic, "--synthetic": synthetic},
        {"--model": model, "--effect": effect, "--set": settings, "--start": start},
    )  # fmt: skip
    if crane and peer is None:
        raise UsageError("--crane sends first, so it must know where to: --peer HOST:PORT")
    codec, length = Codec(load_layout(layout)), None if duration is None else seconds(duration, "--duration")
    if length is not None and not 0.0 < length < 1e8:
        raise UsageError(f"--duration {duration} is no length of time for a run")
    if out is not None:
        check_suffix(out)
    with contextlib.ExitStack() as stack:
        size = codec.to_size if crane else codec.from_size
        link = Link(listen, size, None if peer is None else parse_peer(peer), bind)
        stack.callback(link.close)
        if crane:
            plant, truth = _plant(stack, model, effect, settings, noise, start, friction, seed, compensated)
            side: Master | Crane = _crane_side(link, codec, plant, out, truth)
        else:
            from cosim.live.operator import commands_of

            recorded = commands_of(excitation, played, amplitude, seed, length)
            side = _master_side(stack, link, codec, out, recorded, commands, automatic, target, gain, compensated,
                                synthetic)  # fmt: skip
        lines = _lines(commands) if commands == "-" else lambda: None
        facts = _run(side, link, length, lines, real_time, as_json)
    _show(facts, as_json)


def _check_side(crane: bool, of_master: dict[str, Any], of_crane: dict[str, Any]) -> None:
    """Refuse options of the other side, which would be ignored."""
    from cosim.errors import UsageError

    for option, value in (of_master if crane else of_crane).items():
        if value:
            raise UsageError(f"{option} is for the {'controller' if crane else 'crane'}'s side of the link")


def _plant(
    stack: contextlib.ExitStack, model: str | None, effects: Texts, settings: Texts, noise: float, start: str | None,
    friction: str, seed: int, compensated: bool,
) -> "tuple[Plant, dict[str, Any]]":  # fmt: skip
    """The crane and what is hidden in it."""
    from cosim.errors import UsageError
    from cosim.rig.hidden import Hidden, assemble, parse_setting
    from cosim.units import parse_quantity

    hidden = [Hidden.parse(text) for text in effects or []]
    truth: dict[str, Any] = {"synthetic": True, "hidden": [item.truth() for item in hidden], "seed": seed}
    bare = {"compensator.d_plus": 0.0, "compensator.d_minus": 0.0} if compensated else {}
    if model is not None:
        if start is not None:
            raise UsageError("--start is for the rig; with --model use --set mechanical.theta_0")
        texts = [f"{name}={value!r}" for item in hidden for name, value in item.numbers().items()]
        texts += [f"{name}={value!r}" for name, value in bare.items()]
        return _system(stack, model, [*texts, *(settings or [])]), truth | {"model": model}
    from cosim.rig.noise import Noise
    from cosim.rig.recipe import FRICTIONS
    from cosim.rig.sensing import SEAM_ANGLE
    from cosim.rig.stepping import SteppedCrane

    if friction not in FRICTIONS:
        raise UsageError(f"unknown friction '{friction}': known are {', '.join(FRICTIONS)}")
    numbers = bare | dict(parse_setting(text) for text in settings or [])
    if start is not None:
        numbers["mechanical.theta_0"] = parse_quantity(start, "rad")
    numbers.setdefault("mechanical.theta_0", SEAM_ANGLE)
    sensors = Noise(noise)
    plant = SteppedCrane(assemble(hidden, numbers), sensors, seed, friction)
    return plant, truth | {"settings": numbers, "noise": sensors.truth(), "friction": friction}


def _system(stack: contextlib.ExitStack, model: str, settings: list[str]) -> "Plant":
    """A system of FMUs, native ones where there is a compiler."""
    from cosim.api.simulating import native_or_not
    from cosim.live.crane import SystemPlant
    from cosim.native.build import MissingCompilerError, compiler
    from cosim.request import model_path

    path = model_path(model, with_input=True)
    try:
        compiler()
        path = stack.enter_context(native_or_not(path, True))
    except MissingCompilerError:
        console.warn(
            "there is no C compiler: the FMUs run in Python, which may take longer than a millisecond"
        )
    return stack.enter_context(SystemPlant(path, settings))


def _crane_side(
    link: "Link", codec: "Codec", plant: "Plant", out: Path | None, truth: dict[str, Any]
) -> "Crane":
    import json

    from cosim.errors import DataError
    from cosim.files import write_text
    from cosim.live.crane import Crane, columns
    from cosim.live.pace import PERIOD
    from cosim.live.recorder import Recorder

    recorder = None
    if out is not None:
        recorder = Recorder(out, columns(codec), PERIOD)
        try:
            write_text(
                out.with_name(out.name + ".truth.json"), json.dumps(truth, indent=2, sort_keys=True) + "\n"
            )
        except OSError as error:
            raise DataError(f"{out}.truth.json: cannot be written: {error.strerror or error}") from None
    return Crane(link, codec, plant, recorder)


def _master_side(
    stack: contextlib.ExitStack, link: "Link", codec: "Codec", out: Path | None, played: list[float], commands: str | None,
    automatic: bool, target: str | None, gains: Texts, compensated: bool, synthetic: bool,
) -> "Master":  # fmt: skip
    from cosim.live.master import Controller, Master, columns
    from cosim.live.observer import make_observer
    from cosim.live.operator import Operator, read_script
    from cosim.live.pace import PERIOD
    from cosim.live.recorder import Recorder

    operator = Operator(automatic)
    if target is not None:
        operator.obey(f"target {target}")
    script = [] if commands in (None, "-") else read_script(Path(commands or ""))
    control = Controller(_gains(gains or []))
    observer = make_observer()
    stack.callback(observer.close)
    return Master(
        link,
        codec,
        observer,
        operator,
        None if out is None else Recorder(out, columns(codec), PERIOD),
        control=control,
        played=played,
        script=script,
        outgoing=_compensator() if compensated else float,
        synthetic=synthetic,
    )


def _gains(texts: list[str]) -> dict[str, float]:
    """Parameters of the controller from ``name=value unit``."""
    from cosim.errors import UsageError
    from cosim.units import parse_quantity
    from fmus import registry
    from fmus.controller import BLOCK

    found, known = {}, BLOCK.parameters
    for text in texts:
        name, equals, quantity = (part.strip() for part in text.partition("="))
        if not equals or name not in known:
            hint = registry.suggestion(name, list(known))
            raise UsageError(f"--gain '{text}' should read name=value; {hint}")
        found[name] = parse_quantity(quantity, known[name].unit)
        if not known[name].low <= found[name] <= known[name].high:
            raise UsageError(
                f"--gain '{text}': from {known[name].low:g} to {known[name].high:g} {known[name].unit}"
            )
    return found


def _compensator() -> Callable[[float], float]:
    """(4.9) with its nominal widths, limited to 1."""
    from fmus import dead_zone

    p = dead_zone.Parameters(*(v.start for v in dead_zone.BLOCK.parameters.values()))._replace(form=3.0)
    return lambda u: dead_zone.limited(u, p)


def _lines(commands: str | None) -> Callable[[], str | None]:
    """Lines from stdin."""
    from cosim.live.operator import Lines

    return Lines().take


def _run(
    side: "Master | Crane", link: "Link", duration: float | None, lines: Callable[[], str | None], real_time: bool,
    as_json: bool,
) -> dict[str, Any]:  # fmt: skip
    """Runs one side to its end and returns the account."""
    import psutil

    from cosim.interrupts import stoppable
    from cosim.live.master import Master
    from cosim.live.pace import Pace, priority, steady

    host, port = link.address
    away = "whoever sends" if link.peer is None else f"{link.peer[0]}:{link.peer[1]}"
    what = "controller" if isinstance(side, Master) else "crane"
    asked: list[str] = []

    def ask() -> bool:
        """The first signal ends the run in order, a second one at once."""
        asked.append("interrupted")
        return len(asked) == 1

    memory = psutil.Process().memory_info
    try:
        with stoppable(ask), _emergency(side), steady(), priority(real_time), _screen(side, link):
            console.stderr_console().print(
                f"{what} at {host}:{port}, peer {away}", markup=False, soft_wrap=True
            )
            first = memory().rss
            if isinstance(side, Master):
                ended = side.run(Pace(), duration, lambda: asked[0] if asked else None, lines)
            else:
                ended = side.run(Pace(), duration, lambda: asked[0] if asked else None)
            last = memory().rss
    finally:
        recorder: Recorder | None = side.recorder
        if recorder is not None:
            recorder.close()
    log = None
    if recorder is not None:
        log = {
            "path": recorder.path,
            "rows": recorder.rows,
            "rows_lost": recorder.rows_lost,
            "error": recorder.error,
        }
    return {
        "role": what,
        "listen": f"{host}:{port}",
        "peer": None if link.peer is None else f"{link.peer[0]}:{link.peer[1]}",
        "ended": ended,
        **side.facts(),
        "log": log,
        "memory": {"unit": "B", "first": first, "last": last},
    }


@contextlib.contextmanager
def _emergency(side: "Master | Crane") -> Iterator[None]:
    """SIGUSR1 is an emergency stop of the controller."""
    from cosim.live.master import Master

    number = getattr(signal, "SIGUSR1", None)
    if (
        number is None
        or not isinstance(side, Master)
        or threading.current_thread() is not threading.main_thread()
    ):
        yield
        return
    operator = side.operator

    def struck(_number: int, _frame: object) -> None:
        operator.stopped = True

    before = signal.signal(number, struck)
    try:
        yield
    finally:
        signal.signal(number, before)


@contextlib.contextmanager
def _screen(side: "Master | Crane", link: "Link") -> Iterator[None]:
    """A line a second on a terminal, from a thread: a terminal that is held (Ctrl-S) must not hold the loop."""
    import os
    import sys

    if not sys.stderr.isatty():
        yield
        return
    over = threading.Event()

    def show() -> None:
        while not over.wait(1.0):
            c = link.counts
            text = (
                f"\r{max(side.slot, 0) / 1000:8.1f} s  in {c.received}  lost {c.lost}  late {c.late}  repeated {c.repeated}"
                f"  bad {c.short + c.long + c.nan + c.beyond}  worst {1e3 * side.lateness.worst:.2f} ms \033[K"
            )
            os.write(2, text.encode())

    thread = threading.Thread(target=show, name="screen", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(0.1)
        os.write(2, b"\n")


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
    output.print(console.table(title, ["datagrams", "number"], [*rows, ["sent", facts["sent"]]]))
    figures = ", ".join(f"{name} {1e3 * late[name]:.3f} ms" for name in ("p50", "p99", "p99.9", "worst"))
    output.print(f"ended: {facts['ended']}", markup=False)
    output.print(f"lateness: {figures}; {facts['overrun']} slots overrun", markup=False, soft_wrap=True)
    for event in facts.get("events", ()):
        output.print(f"  {event['time']:9.3f} s  {event['what']}", markup=False, soft_wrap=True)
    if log is not None:
        kind = "synthetic log" if facts["synthetic"] else "log"
        output.print(f"{kind}: {log['path']}, {log['rows']} rows", markup=False, soft_wrap=True)
