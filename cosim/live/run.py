"""The controller, or the crane, at one end of the UDP link as it is asked for."""

import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from cosim import console
from cosim.api.simulating import native_or_not
from cosim.errors import DataError, UsageError
from cosim.files import write_text
from cosim.interrupts import stoppable
from cosim.live import crane, master
from cosim.live.codec import Codec
from cosim.live.crane import Crane, Plant, SystemPlant
from cosim.live.layout import load_layout
from cosim.live.link import Link, parse_peer
from cosim.live.master import Controller, Master
from cosim.live.observer import make_observer
from cosim.live.operator import Lines, Operator, commands_of, read_script
from cosim.live.pace import PERIOD, Pace, priority, steady
from cosim.live.recorder import Recorder, check_suffix
from cosim.native.build import MissingCompilerError, compiler
from cosim.request import model_path, seconds
from cosim.rig.hidden import Hidden, assemble, parse_setting
from cosim.rig.noise import Noise
from cosim.rig.recipe import FRICTIONS
from cosim.rig.sensing import SEAM_ANGLE
from cosim.rig.stepping import SteppedCrane
from cosim.units import parse_quantity
from fmus import dead_zone, registry
from fmus.controller import BLOCK

Texts = list[str] | None


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What is asked for; the attributes are the options of `cosim live`."""

    listen: int = 5001
    peer: str | None = None
    bind: str = "127.0.0.1"
    layout: Path | None = None
    duration: str | None = None
    out: Path | None = None
    excitation: str | None = None
    played: Path | None = None
    amplitude: float = 1.0
    seed: int = 1
    commands: str | None = None
    automatic: bool = False
    target: str | None = None
    gain: Texts = None
    compensated: bool = False
    synthetic: bool = False
    real_time: bool = False
    crane: bool = False
    model: str | None = None
    effect: Texts = None
    settings: Texts = None
    noise: float = 1.0
    start: str | None = None
    friction: str = "sharp"


def run(asked: Asked) -> dict[str, Any]:
    """Run one side of the link to its end; the account of it.

    Raises:
        UsageError, DataError: the request or a file is bad.
    """
    _check_side(
        asked.crane,
        {"--excitation": asked.excitation, "--input": asked.played, "--commands": asked.commands,
         "--target": asked.target, "--gain": asked.gain, "--automatic": asked.automatic, "--synthetic": asked.synthetic},
        {"--model": asked.model, "--effect": asked.effect, "--set": asked.settings, "--start": asked.start},
    )  # fmt: skip
    if asked.crane and asked.peer is None:
        raise UsageError("--crane sends first, so it must know where to: --peer HOST:PORT")
    codec = Codec(load_layout(asked.layout))
    length = None if asked.duration is None else seconds(asked.duration, "--duration")
    if length is not None and not 0.0 < length < 1e8:
        raise UsageError(f"--duration {asked.duration} is no length of time for a run")
    if asked.out is not None:
        check_suffix(asked.out)
    with contextlib.ExitStack() as stack:
        size = codec.to_size if asked.crane else codec.from_size
        link = Link(asked.listen, size, None if asked.peer is None else parse_peer(asked.peer), asked.bind)
        stack.callback(link.close)
        if asked.crane:
            plant, truth = _plant(stack, asked.model, asked.effect, asked.settings, asked.noise, asked.start,
                                  asked.friction, asked.seed, asked.compensated)  # fmt: skip
            side: Master | Crane = _crane_side(link, codec, plant, asked.out, truth)
        else:
            recorded = commands_of(asked.excitation, asked.played, asked.amplitude, asked.seed, length)
            side = _master_side(stack, link, codec, asked.out, recorded, asked.commands, asked.automatic,
                                asked.target, asked.gain, asked.compensated, asked.synthetic)  # fmt: skip
        lines: Callable[[], str | None] = Lines().take if asked.commands == "-" else lambda: None
        return _run(side, link, length, lines, asked.real_time)


def _check_side(crane: bool, of_master: dict[str, Any], of_crane: dict[str, Any]) -> None:
    """Refuse options of the other side, which would be ignored."""
    for option, value in (of_master if crane else of_crane).items():
        if value:
            raise UsageError(f"{option} is for the {'controller' if crane else 'crane'}'s side of the link")


def _plant(
    stack: contextlib.ExitStack, model: str | None, effects: Texts, settings: Texts, noise: float, start: str | None,
    friction: str, seed: int, compensated: bool,
) -> tuple[Plant, dict[str, Any]]:  # fmt: skip
    """The crane and what is hidden in it."""
    hidden = [Hidden.parse(text) for text in effects or []]
    truth: dict[str, Any] = {"synthetic": True, "hidden": [item.truth() for item in hidden], "seed": seed}
    bare = {"compensator.d_plus": 0.0, "compensator.d_minus": 0.0} if compensated else {}
    if model is not None:
        if start is not None:
            raise UsageError("--start is for the rig; with --model use --set mechanical.theta_0")
        texts = [f"{name}={value!r}" for item in hidden for name, value in item.numbers().items()]
        texts += [f"{name}={value!r}" for name, value in bare.items()]
        return _system(stack, model, [*texts, *(settings or [])]), truth | {"model": model}

    if friction not in FRICTIONS:
        raise UsageError(f"unknown friction '{friction}': known are {', '.join(FRICTIONS)}")
    numbers = bare | dict(parse_setting(text) for text in settings or [])
    if start is not None:
        numbers["mechanical.theta_0"] = parse_quantity(start, "rad")
    numbers.setdefault("mechanical.theta_0", SEAM_ANGLE)
    sensors = Noise(noise)
    plant = SteppedCrane(assemble(hidden, numbers), sensors, seed, friction)
    return plant, truth | {"settings": numbers, "noise": sensors.truth(), "friction": friction}


def _system(stack: contextlib.ExitStack, model: str, settings: list[str]) -> Plant:
    """A system of FMUs, native ones where there is a compiler."""
    path = model_path(model, with_input=True)
    try:
        compiler()
        path = stack.enter_context(native_or_not(path, True))
    except MissingCompilerError:
        console.warn(
            "there is no C compiler: the FMUs run in Python, which may take longer than a millisecond"
        )
    return stack.enter_context(SystemPlant(path, settings))


def _crane_side(link: Link, codec: Codec, plant: Plant, out: Path | None, truth: dict[str, Any]) -> Crane:

    recorder = None
    if out is not None:
        recorder = Recorder(out, crane.columns(codec), PERIOD)
        try:
            write_text(
                out.with_name(out.name + ".truth.json"), json.dumps(truth, indent=2, sort_keys=True) + "\n"
            )
        except OSError as error:
            raise DataError(f"{out}.truth.json: cannot be written: {error.strerror or error}") from None
    return Crane(link, codec, plant, recorder)


def _master_side(
    stack: contextlib.ExitStack, link: Link, codec: Codec, out: Path | None, played: list[float], commands: str | None,
    automatic: bool, target: str | None, gains: Texts, compensated: bool, synthetic: bool,
) -> Master:  # fmt: skip

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
        None if out is None else Recorder(out, master.columns(codec), PERIOD),
        control=control,
        played=played,
        script=script,
        outgoing=_compensator() if compensated else float,
        synthetic=synthetic,
    )


def _gains(texts: list[str]) -> dict[str, float]:
    """Parameters of the controller from ``name=value unit``."""
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
    p = dead_zone.Parameters(*(v.start for v in dead_zone.BLOCK.parameters.values()))._replace(form=3.0)
    return lambda u: dead_zone.limited(u, p)


def _run(
    side: Master | Crane, link: Link, duration: float | None, lines: Callable[[], str | None], real_time: bool,
) -> dict[str, Any]:  # fmt: skip
    """Runs one side to its end and returns the account."""
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
def _emergency(side: Master | Crane) -> Iterator[None]:
    """SIGUSR1 is an emergency stop of the controller."""
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
def _screen(side: Master | Crane, link: Link) -> Iterator[None]:
    """A line a second on a terminal, from a thread: a terminal that is held (Ctrl-S) must not hold the loop."""
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
