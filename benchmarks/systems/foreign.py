"""Faults hidden in FMUs of other people; what really happened is fmpy's work, in a process of its own, not our master's.

``python -m benchmarks.systems.foreign SPEC.json OUT.npz`` runs one: FMUs stepped side by side in fine steps, each hearing
what the others gave at the step before; effects in the wires are those of `benchmarks.systems.truth`.
"""

import csv
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.parts import write_ssp
from benchmarks.systems.truth import Hidden, Wire, read

Array = NDArray[np.float64]
NOISE = 0.01  # of a reading's spread
RUN_LIMIT = 300.0  # s for one run of fmpy
START_ROUNDS = 20  # of outputs handed on before a run begins; no system has so many components in a row
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Case:
    """FMUs, what drives them, what is hidden.

    Attributes:
        name: for people.
        fmus: component -> end of its file's path.
        drives: input -> (centre, amplitude) of steps and sines.
        measured: outputs of the log, ``component.connector``.
        hidden: effects.
        faults: ``component.parameter`` -> factor.
        trusted: parameters that the mapping trusts to 1 %.
        constant: inputs that are not measured, with their values, which are those that they start with.
        stated: the same of the first component with other values, which the mapping gives.
        wires: between components; an input of the system feeds the input of its name.
        h: interval of the log [s].
        count: samples.
        fine: steps of fmpy in an interval.
        pace: time of a step of the drives [s].
        values: parameters of all runs.
        tolerance: of the solvers within the FMUs when the log is made; by default their own.
        noise: of a reading's spread.
    """

    name: str
    fmus: Mapping[str, str]
    drives: Mapping[str, tuple[float, float]]
    measured: tuple[str, ...]
    hidden: tuple[Hidden, ...] = ()
    faults: Mapping[str, float] = field(default_factory=dict)
    trusted: tuple[str, ...] = ()
    constant: Mapping[str, float] = field(default_factory=dict)
    stated: Mapping[str, float] = field(default_factory=dict)
    wires: tuple[tuple[str, str], ...] = ()
    h: float = 0.01
    count: int = 2000
    fine: int = 1
    pace: float = 1.0
    values: Mapping[str, float] = field(default_factory=dict)
    tolerance: float | None = None
    noise: float = NOISE


def drive(case: Case, seed: int) -> dict[str, Array]:
    """Series of the system's inputs: steps and three sines."""
    rng = np.random.default_rng(seed)
    t = case.h * np.arange(case.count)
    hold = max(round(case.pace / case.h), 1)
    found = {}
    for name, (centre, size) in case.drives.items():
        steps = np.repeat(rng.uniform(-1.0, 1.0, case.count // hold + 1), hold)[: case.count]
        sines = sum(
            rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * f / case.pace * t + rng.uniform(0, 6))
            for f in (0.1, 0.37, 0.9)
        )
        found[name] = centre + size * (0.7 * steps + sines)
    return found


def step_by_fmpy(spec: Mapping[str, Any], series: Mapping[str, Array]) -> dict[str, Array]:
    """Outputs of all components at every stamp."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    h, count, fine = spec["h"], spec["count"], spec["fine"]
    step = h / fine
    hidden = [Hidden(**e) for e in spec["hidden"]]
    at = {(e.port, e.where): Wire(e.effect, e.values, step) for e in hidden if e.where in ("input", "output")}
    slaves, numbers, parts = {}, {}, {}
    for name, path in spec["fmus"].items():
        folder = tempfile.mkdtemp(dir=spec["scratch"])
        fmpy.extract(path, folder)
        model = fmpy.read_model_description(path, validate=False)
        slave = FMU2Slave(
            guid=model.guid,
            unzipDirectory=folder,
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=name,
        )
        slave.instantiate()
        slaves[name] = slave
        numbers[name] = {v.name: v.valueReference for v in model.modelVariables}
        parts[name] = own_parts(model, step, fine)
        slave.setupExperiment(startTime=0.0, stopTime=count * h, tolerance=spec["tolerance"])
        for full, value in spec["values"].items():
            component, _, parameter = full.partition(".")
            if component == name:
                slave.setReal([numbers[name][parameter]], [value])
        slave.enterInitializationMode()
    feeds = dict(spec["feeds"])
    record = spec["record"]
    outputs = {p for p in [*record, *feeds.values()] if p not in series}

    def get(effects: Mapping[tuple[str, str], Wire]) -> dict[str, float]:
        got = {}
        for port in outputs:
            component, _, variable = port.partition(".")
            value = slaves[component].getReal([numbers[component][variable]])[0]
            effect = effects.get((port, "output"))
            got[port] = effect(value) if effect else value
        return got

    def put(heard: Mapping[str, float], effects: Mapping[tuple[str, str], Wire], i: int = 0) -> None:
        for end, source in feeds.items():
            component, _, variable = end.partition(".")
            effect = effects.get((end, "input"))
            value = effect(heard[source]) if effect else heard[source]
            if i % parts[component] == 0:  # it hears what is there when its own step begins
                slaves[component].setReal([numbers[component][variable]], [value])

    # what is handed straight on goes through all components before time runs; effects with a memory have none yet
    begun = {name: values[0] for name, values in series.items()}
    now = get(deepcopy(at))
    for _ in range(START_ROUNDS):
        put({**now, **begun}, deepcopy(at))
        before, now = now, get(deepcopy(at))
        if now == before:
            break
    else:
        raise RuntimeError("the start is no fixed point")
    for slave in slaves.values():
        slave.exitInitializationMode()
    now = get(at)
    found = {port: np.empty(count) for port in record}
    for k in range(count):
        for port in record:
            found[port][k] = now[port]
        if k == count - 1:
            break
        for i in range(fine):
            share = i / fine
            heard = dict(now)
            for name, values in series.items():
                heard[name] = (1 - share) * values[k] + share * values[k + 1]
            put(heard, at, i)
            until = (k * fine + i + 1) * step
            for name, slave in slaves.items():
                if (i + 1) % parts[name] == 0:
                    begin = (k * fine + i + 1 - parts[name]) * step
                    slave.doStep(currentCommunicationPoint=begin, communicationStepSize=until - begin)
            now = get(at)
    return found


def own_parts(model: Any, step: float, fine: int) -> int:
    """Fine steps [s] that an FMU makes in one, of the `fine` in an interval: it is not asked for less than it declares.

    20-sim and the Reference FMUs make steps of their own length until the communication point is reached: asked for a tenth
    of it they run ahead, by a step more or less as sums of steps are rounded.
    """
    declared = float((model.defaultExperiment is not None and model.defaultExperiment.stepSize) or step)
    return next(
        n for n in range(1, fine + 1) if fine % n == 0 and (n == fine or n * step > (1 - 1e-6) * declared)
    )


def feeds_of(case: Case) -> dict[str, str]:
    """What feeds each input."""
    found = {end: source for source, end in case.wires}
    (only, *_) = case.fmus
    for name in case.drives:
        if not any(source == name for source, _ in case.wires):
            found[f"{only}.{name}"] = name
    return found


def located(case: Case, paths: Sequence[Path]) -> dict[str, Path] | None:
    """The file of each component; None if one is not there."""
    found = {}
    for name, end in case.fmus.items():
        file = next((p for p in paths if str(p).endswith(end)), None)
        if file is None:
            return None
        found[name] = file.resolve()
    return found


def truth(case: Case, fmus: Mapping[str, Path], seed: int, scratch: Path) -> dict[str, Array]:
    """The log: inputs as they are, outputs as they were read."""
    series = drive(case, seed)
    held = {**case.constant, **case.stated}
    values = dict(case.values) | {f"{next(iter(case.fmus))}.{n}": v for n, v in held.items()}
    for name, factor in case.faults.items():
        values[name] = factor * nominal(fmus, name, values)
    spec = {
        "fmus": {n: str(p) for n, p in fmus.items()}, "h": case.h, "count": case.count, "fine": case.fine,
        "hidden": [asdict(e) for e in case.hidden], "values": values, "feeds": feeds_of(case),
        "record": list(case.measured), "scratch": str(scratch), "tolerance": case.tolerance,
    }  # fmt: skip
    (scratch / "spec.json").write_text(json.dumps(spec))
    np.savez(scratch / "in.npz", **series)
    (scratch / "out.npz").unlink(missing_ok=True)
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.systems.foreign", str(scratch / "spec.json"), str(scratch / "out.npz")],
        cwd=ROOT, capture_output=True, text=True, timeout=RUN_LIMIT, check=False,
    )  # fmt: skip
    if not (scratch / "out.npz").is_file():
        raise RuntimeError(done.stderr[-2000:])
    with np.load(scratch / "out.npz") as loaded:
        true = {n: loaded[n] for n in case.measured}
    return {**series, **read(true, case.hidden, case.h, case.noise, np.random.default_rng(seed + 1))}


def nominal(fmus: Mapping[str, Path], name: str, values: Mapping[str, float]) -> float:
    """Start value of ``component.parameter``."""
    import fmpy

    if name in values:
        return values[name]
    component, _, parameter = name.partition(".")
    model = fmpy.read_model_description(str(fmus[component]), validate=False)
    return float(next(v.start for v in model.modelVariables if v.name == parameter))


def quoted(names: Sequence[str]) -> str:
    """A list for TOML."""
    return "[" + ", ".join(f'"{n}"' for n in names) + "]"


def write_log(path: Path, signals: Mapping[str, Array], h: float) -> Path:
    """A CSV file with plain headings."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *signals])
        count = next(iter(signals.values())).size
        writer.writerows(zip(h * np.arange(count), *signals.values(), strict=True))
    return path


def run(case: Case, paths: Sequence[Path], scratch: Path, seed: int = 1) -> dict[str, Any] | None:
    """Hide, diagnose by the command line, score; None where an FMU is not there."""
    fmus = located(case, paths)
    if fmus is None:
        return None
    folder = scratch / case.name.replace(" ", "_")
    folder.mkdir(exist_ok=True)
    signals = truth(case, fmus, seed, folder)
    model = next(iter(fmus.values()))
    if len(fmus) > 1:
        own: dict[str, dict[str, float]] = {n: {} for n in fmus}
        for full, value in case.values.items():
            component, _, parameter = full.partition(".")
            own[component][parameter] = value
        model = write_ssp(folder / "system.ssp", fmus, case.wires, own, list(case.drives), case.measured)
    log = write_log(folder / "log.csv", signals, case.h)
    mapping = folder / "map.toml"
    single = len(fmus) == 1
    stem = model.stem.replace(".", "_")
    lines = ["[time]", 'column = "time"', 'unit = "s"']
    for name in signals:
        connector = f"{stem}.{name.partition('.')[2] or name}" if single and name not in case.drives else name
        lines += [f'[signals."{connector}"]', f'column = "{name}"', f'unit = "{unit_of(fmus, name)}"']
    lines += ["[diagnose]"]
    trusted = [n.replace(f"{next(iter(fmus))}.", f"{stem}.", 1) if single else n for n in case.trusted]
    if trusted:
        lines += [f"trusted = {quoted(trusted)}"]
    if case.stated:
        lines += ["constant = { " + ", ".join(f'"{stem}.{n}" = {v!r}' for n, v in case.stated.items()) + " }"]
    mapping.write_text("\n".join(lines) + "\n")
    command = [
        sys.executable,
        "-m",
        "cosim",
        "diagnose",
        str(log),
        "--model",
        str(model),
        "--mapping",
        str(mapping),
    ]
    begun = time.perf_counter()
    done = subprocess.run(
        [*command, "--out", str(folder / "out"), "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - begun
    if done.returncode:
        return {
            "name": case.name,
            "ok": False,
            "row": f"| {case.name} | | no answer | |",
            "line": f"FAILED {done.returncode}: {done.stderr[-600:]}",
        }
    return score(case, json.loads(done.stdout), seconds, fmus)


def unit_of(fmus: Mapping[str, Path], name: str) -> str:
    """Unit that an FMU declares for a connector; 1 where it has none."""
    import fmpy

    component, dot, variable = name.partition(".")
    for own, path in fmus.items():
        if dot and own != component:
            continue
        model = fmpy.read_model_description(str(path), validate=False)
        for v in model.modelVariables:
            if v.name == (variable if dot else name):
                declared = v.unit or (v.declaredType.unit if v.declaredType is not None else None)
                return declared or "1"
    return "1"


def score(case: Case, found: Mapping[str, Any], seconds: float, fmus: Mapping[str, Path]) -> dict[str, Any]:
    """What is right: component, kind, size, time."""
    stem = next(iter(fmus.values())).stem.replace(".", "_")
    single = len(fmus) == 1

    def ours(port: str) -> str:
        return f"{stem}.{port.partition('.')[2]}" if single else port

    wanted = [(f"{e.effect} at {ours(e.port)} ({e.where})", dict(e.values)) for e in case.hidden]
    wanted += [
        (f"parameter {ours(n)}", {n.partition(".")[2]: f * nominal(fmus, n, case.values)})
        for n, f in case.faults.items()
    ]
    said, errors, right = [], [], True
    sets = []
    for cause in found["causes"]:
        port = f"{cause['component']}.{cause['connector'] or cause['parameter']}"
        words = (
            f"parameter {port}"
            if cause["effect"] == "parameter"
            else f"{cause['effect']} at {port} ({cause['where']})"
        )
        numbers = {n: round(p["value"], 5) for n, p in cause["parameters"].items()}
        said.append(f"{words} {numbers} [{'; '.join(cause['indistinguishable_from'])}]")
        sets.append(({words, *cause["indistinguishable_from"]}, cause))
    for words, values in wanted:
        hit = next((c for s, c in sets if words in s), None)
        right &= hit is not None
        if hit is not None and set(hit["parameters"]) <= set(values):
            errors += [
                abs(p["value"] - values[n]) / max(abs(values[n]), 1e-12) for n, p in hit["parameters"].items()
            ]
    right &= len(sets) == len(wanted) and (bool(wanted) or found["verdict"] == "adequate")
    worst = f", size within {100 * max(errors):.1f} %" if errors else ""
    line = f"{'right' if right else 'WRONG'}{worst}, {seconds:.0f} s, {found['verdict']}; hidden "
    line += ", ".join(f"{w} { {k: round(x, 5) for k, x in v.items()} }" for w, v in wanted) or "nothing"
    if not right:
        rest = [u["what"] for u in found["unexplained"]]
        refused = [(r["effect"], r["why"]) for r in found["refused"]]
        line += f"\n    said {said} unexplained {rest} refused {refused} {found['warnings']}"
    kinds = [f"{e.effect} at {e.port} ({e.where})" for e in case.hidden] + [
        f"{f:g} times {n}" for n, f in case.faults.items()
    ]
    answer = "adequate" if right and not wanted else "named, with its place" if right else "WRONG"
    return {
        "name": case.name,
        "row": f"| {case.name} | {', '.join(kinds) or 'nothing'} | {answer}{worst} | {seconds:.0f} s |",
        "ok": right,
        "error": max(errors, default=None),
        "seconds": seconds,
        "line": line,
    }


MSD = "maestro__src__test__resources__MassSpringDamper1.fmu"
MSD2 = "maestro__src__test__resources__MassSpringDamper2.fmu"
ONE = {"one": MSD}
MASS = ("one.m1", "one.c1", "one.d1")
MACHINE = {"machine": "emachine_model.fmu"}
ELECTRIC = {"w": (0.0, 100.0), "phi": (0.0, 1.0), "U": (0.0, 12.0)}
CIRCUIT = ("machine.resistor.R", "machine.inductor.L", "machine.emf.k")
SPRING = {"part": "gemseo_fmu/MassSpringSubSystem1.fmu"}
BALL = {"ball": "2023x/2.0/BouncingBallGravitySwitch1D.fmu"}
SWITCHED = ("ball.gravity", "ball.damping", "ball.period")
RUBBING = {"part": "2023x/2.0/SpringFrictionPendulumExtForce1D.fmu"}
FREE = {"part": "2023x/2.0/SpringPendulum1D.fmu"}
SPRUNG = ("part.spring.c", "part.mass.m", "part.spring.s_rel0")
MINUTE: dict[str, Any] = {"h": 0.02, "count": 3000}
ROBOT = {"body": "Body_Block.fmu"}
SERVOS = {"servo_left_input": (0.0, 0.4), "servo_right_input": (0.0, 0.4)}
CASES: tuple[Case, ...] = (
    Case("20-sim mass clean", ONE, {"fk": (0.0, 2.0)}, ("one.x1", "one.v1"), trusted=MASS),
    Case("20-sim mass heavier", ONE, {"fk": (0.0, 2.0)}, ("one.x1", "one.v1"), faults={"one.m1": 1.3}, trusted=MASS),
    Case("20-sim mass dead zone", ONE, {"fk": (0.0, 2.0)}, ("one.x1", "one.v1"),
         hidden=(Hidden("port.dead_zone", "one.fk", "input", {"low": -0.3, "high": 0.4}),)),
    Case("20-sim two masses gain", {"one": MSD, "two": MSD2}, {}, ("one.x1", "one.v1", "two.fk", "two.x2", "two.v2"),
         hidden=(Hidden("port.gain", "two.fk", "sensor", {"gain": 1.2}),), fine=10, values={"two.dc": 5.0},
         wires=(("one.x1", "two.x1"), ("one.v1", "two.v1"), ("two.fk", "one.fk"))),
    Case("20-sim tanks outflow", {"tanks": "Threetank.fmu"}, {},
         ("tanks.Tank1_level", "tanks.Tank2_level", "tanks.Tank3_level"), h=0.02, count=1000,
         faults={"tanks.WaterTanks2.WaterTank3.Valve.resistance": 1.3},
         trusted=("tanks.WaterTanks1.Pipe.R.r", "tanks.WaterTanks1.WaterTank2.R1.r",
                  "tanks.WaterTanks2.WaterTank3.Valve.resistance")),
    Case("20-sim robot clean", ROBOT, SERVOS, ("body.robot_theta", "body.robot_x", "body.robot_y")),
    Case("20-sim robot servo dead zone", ROBOT, SERVOS, ("body.robot_theta", "body.robot_x", "body.robot_y"),
         hidden=(Hidden("port.dead_zone", "body.servo_left_input", "input", {"low": -0.06, "high": 0.08}),)),
    Case("20-sim heated room", {"room": "20sim__ControlledTemperature.fmu"}, {}, ("room.Temperature_Room",),
         h=0.02, count=1000, faults={"room.HeatCapacity1.C": 1.2}, trusted=("room.HeatCapacity1.C",)),
    Case("Dymola machine clean", MACHINE, ELECTRIC, ("machine.I", "machine.M"), pace=0.1, h=0.001, trusted=CIRCUIT),
    Case("Dymola machine resistance", MACHINE, ELECTRIC, ("machine.I", "machine.M"), pace=0.1, h=0.001,
         faults={"machine.resistor.R": 1.25}, trusted=CIRCUIT),
    Case("Dymola load torque limit", {"load": "edrive_mass.fmu"}, {"M_A": (0.0, 0.02), "M_B": (0.0, 0.01)},
         ("load.wA", "load.phiA"), hidden=(Hidden("port.saturation", "load.M_A", "input", {"low": -0.01, "high": 0.012}),)),
    Case("Dymola ball clean", BALL, {}, ("ball.mass_s", "ball.mass_v"), count=500, trusted=SWITCHED, tolerance=1e-8),
    Case("Dymola ball gravity", BALL, {}, ("ball.mass_s", "ball.mass_v"), count=500, trusted=SWITCHED, tolerance=1e-8,
         faults={"ball.gravity": 1.05}),
    Case("Dymola ball damping", BALL, {}, ("ball.mass_s", "ball.mass_v"), count=500, trusted=SWITCHED, tolerance=1e-8,
         faults={"ball.damping": 0.85}),
    Case("Dymola friction clean", RUBBING, {"extForce": (0.0, 3.0)}, ("part.v", "part.a"), trusted=SPRUNG, tolerance=1e-8),
    Case("Dymola friction delay", RUBBING, {"extForce": (0.0, 3.0)}, ("part.v", "part.a"), trusted=SPRUNG, tolerance=1e-8,
         hidden=(Hidden("port.delay", "part.extForce", "input", {"delay": 0.08}),)),
    Case("Dymola friction free delay", {"part": "2023x/2.0/SpringFrictionPendulum1D.fmu"}, {},
         ("part.mass.s", "part.mass.v"), count=1000, tolerance=1e-8,
         hidden=(Hidden("port.delay", "part.mass.s", "sensor", {"delay": 0.1}),)),
    Case("Dymola friction mass", RUBBING, {"extForce": (0.0, 3.0)}, ("part.v", "part.a"), trusted=SPRUNG, tolerance=1e-8,
         faults={"part.mass.m": 1.2}),
    Case("Dymola pendulum clean", FREE, {}, ("part.mass.s", "part.mass.v"), trusted=SPRUNG, tolerance=1e-8, **MINUTE),
    Case("Dymola pendulum spring", FREE, {}, ("part.mass.s", "part.mass.v"), trusted=SPRUNG, tolerance=1e-8,
         faults={"part.spring.c": 1.06}, **MINUTE),
    Case("Dymola pendulum mass", FREE, {}, ("part.mass.s", "part.mass.v"), trusted=SPRUNG, tolerance=1e-8,
         faults={"part.mass.m": 1.1}, **MINUTE),
    Case("Dymola air late reading", {"air": "embrace__resources__0004_Atmos.fmu"},
         {"Alt": (3000.0, 800.0), "Ma": (0.3, 0.1)}, ("air.Tamb", "air.Pamb"), h=0.05, count=1500, pace=5.0, fine=5,
         hidden=(Hidden("port.lag", "air.Tamb", "sensor", {"lag": 1.5}),)),
    Case("OpenModelica spring offset", SPRING, {"x2": (1.0, 0.5)}, ("part.x1", "part.v1"),
         constant={"k1": 1.0, "k2": 1.0, "m1": 1.0},
         hidden=(Hidden("port.offset", "part.x1", "sensor", {"offset": 0.1}),)),
    Case("OpenModelica spring, other mass", SPRING, {"x2": (1.0, 0.5)}, ("part.x1", "part.v1"), stated={"m1": 1.6},
         constant={"k1": 1.0, "k2": 1.0}, hidden=(Hidden("port.delay", "part.x2", "input", {"delay": 0.3}),)),
    Case("OpenModelica damper", {"part": "Mass_Damper.fmu"}, {"f": (0.0, 100.0)}, ("part.y",), h=0.001, pace=0.2,
         faults={"part.damper.d": 1.3}, trusted=("part.damper.d", "part.spring.c", "part.mass.m")),
    Case("OpenModelica sum", {"part": "gemseo_fmu/add.fmu"},
         {"u1": (0.0, 1.0), "u2": (0.5, 1.0)}, ("part.y",),
         hidden=(Hidden("port.gain", "part.u2", "input", {"gain": 0.8}),)),
    Case("Reference Dahlquist", {"part": "tests__data__fmi2__Dahlquist.fmu"}, {}, ("part.x",), h=0.1, count=100,
         faults={"part.k": 1.1}, trusted=("part.k",)),
    Case("Reference van der Pol", {"part": "VanDerPol__VanDerPol.fmu"}, {}, ("part.x0", "part.x1"), h=0.01, count=2000,
         faults={"part.mu": 1.2}, trusted=("part.mu",)),
    Case("Reference feedthrough drift", {"part": "Feedthrough__Feedthrough.fmu"}, {"real_continuous_in": (0.0, 1.0)},
         ("part.real_continuous_out",),
         hidden=(Hidden("port.drift", "part.real_continuous_out", "sensor", {"rate": 0.03}),)),
    Case("Simulink cooling gain", {"part": "embrace__resources__0002_ECS_SW.fmu"}, {"Input.TLiquid": (300.0, 10.0)},
         ("part.TCoolingPack",), h=1 / 30, count=1500, pace=3.0,
         hidden=(Hidden("port.gain", "part.TCoolingPack", "output", {"gain": 1.1}),)),
    Case("Simulink integrator", {"part": "StateInitExample.fmu"}, {}, ("part.Integrator_out1",), h=0.01, count=1000,
         faults={"part.Parameters.Constant_Value": 1.15}, trusted=("part.Parameters.Constant_Value",)),
    Case("Wheel of a truck", {"wheel": "quarter_truck__Wheel.fmu"}, {"in_vel": (0.0, 0.3)},
         ("wheel.position", "wheel.velocity", "wheel.out_spring_damper_f"), h=0.01, count=1500,
         faults={"wheel.dc": 0.7}, trusted=("wheel.dc", "wheel.kc", "wheel.mass")),
    Case("Hopsan volume", {"oil": "FMU_UQ_interface.fmu"}, {"q_A.out.y": (0.0, 0.001)}, ("oil.p_A.in.y",),
         h=0.01, count=1500, hidden=(Hidden("port.delay", "oil.q_A.out.y", "input", {"delay": 0.1}),)),
    Case("PythonFMU force", {"part": "crane_fmu/DrivingForce.fmu"}, {}, ("part.f[0]", "part.f[1]"), h=0.01, count=1000,
         faults={"part.ampl[0]": 1.2}, trusted=("part.ampl[0]", "part.freq[0]")),
)  # fmt: skip


def main() -> None:
    """The process that fmpy runs in."""
    spec = json.loads(Path(sys.argv[1]).read_text())
    with np.load(Path(sys.argv[1]).parent / "in.npz") as loaded:
        series = {n: loaded[n] for n in loaded.files}
    np.savez(sys.argv[2], **step_by_fmpy(spec, series))


if __name__ == "__main__":
    main()
