"""Random systems with something hidden: ``python benchmarks/any_system.py --count 60 --seed 1000``.

Two to eight components that nobody's diagnosis knows, in chains, branches, joins and loops, linear or not, as native FMUs
or (--python) plain pythonfmu's. Hidden: a port effect, a parameter, two at once, nothing, or something outside the
vocabulary. The log is made by a simulation of its own (`benchmarks.systems.truth`), with other steps than the FMUs'.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scipy.stats import binomtest

from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden, read, simulate
from cosim.anysystem.answer import answer
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.diagnosis.answer.schema import Answer, NamedCause
from cosim.ssp.read import read_system
from cosim.system.runs import Runs

H, COUNT, NOISE = 0.01, 3000, 0.01
CLASSES = ("port", "parameter", "two", "none", "outside")
NUMBERS = "numbers"  # several parameters at once, by --kind alone: the classes of the seeds stay as they were
EFFECTS = (
    "port.gain", "port.offset", "port.delay", "port.lag", "port.saturation", "port.dead_zone", "port.play",
    "port.rate_limit", "port.quantisation", "port.drift", "port.dropout",
)  # fmt: skip
READINGS = ("port.quantisation", "port.drift", "port.dropout")
OUTSIDE = ("strange.square", "strange.product", "strange.rectified", "strange.disturbance")


@dataclass
class Case:
    """A system and what is hidden in it."""

    seed: int
    kind: str
    kinds: dict[str, str]
    values: dict[str, dict[str, float]]
    wires: list[tuple[str, str]]
    measured: list[str]
    hidden: list[Hidden] = field(default_factory=list)
    # component.parameter: value, factor
    numbers: dict[str, tuple[float, float]] = field(default_factory=dict)


def command(rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """Steps and sines; `size` times as large."""
    t = H * np.arange(COUNT)
    every = int(rng.integers(80, 250))
    steps = np.repeat(rng.uniform(-1, 1, COUNT // every + 1), every)[:COUNT]
    sines = sum(
        rng.uniform(0.1, 0.4) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.11, 0.37, 0.9, 1.7)
    )
    return np.asarray(size * (steps + sines))


def values_of(kind: str, rng: np.random.Generator) -> dict[str, float]:
    """Parameters that keep signals near one."""
    found = {
        "K": float(rng.uniform(0.7, 1.5)),
        "T": float(rng.uniform(0.05, 0.4)),
        "W": float(rng.uniform(3.0, 12.0)),
        "ZETA": float(rng.uniform(0.3, 0.9)),
        "C": float(rng.uniform(0.2, 0.5)),
    }
    if kind == "saturating":
        found["C"] = float(rng.uniform(0.6, 1.5))
    if kind == "sum":
        found["C"] = float(rng.choice([-1, 1]) * rng.uniform(0.5, 1.0))
    return {n: round(found[n], 4) for n in parts.USES[kind]}


def system(
    rng: np.random.Generator, most: int, least: int = 2
) -> tuple[dict[str, str], dict[str, dict[str, float]], list[tuple[str, str]]]:
    """Components and wires: each new one follows an earlier one; sums join two, or close a loop."""
    count = int(rng.integers(least, most + 1))
    names = [f"part{k + 1}" for k in range(count)]
    kinds, wires = {}, []
    for k, name in enumerate(names):
        source = (
            "command" if k == 0 else f"{names[k - 1 if rng.random() < 0.75 else int(rng.integers(0, k))]}.y"
        )
        join = rng.random() < 0.25 and count > 2
        kinds[name] = (
            "sum" if join else str(rng.choice(["lag", "second", "saturating", "damped", "stiffening"]))
        )
        wires.append((source, f"{name}.u"))
    values = {n: values_of(kind, rng) for n, kind in kinds.items()}
    for k, name in enumerate(names):
        if kinds[name] == "sum":
            behind = int(rng.integers(k, count)) if k < count - 1 and rng.random() < 0.5 else None
            if behind is not None and behind > k:  # a loop, negative feedback
                wires.append((f"{names[behind]}.y", f"{name}.v2"))
                values[name]["C"] = -round(float(rng.uniform(0.2, 0.6)), 4)
            else:
                wires.append((f"{names[int(rng.integers(0, k))]}.y" if k else "command", f"{name}.v2"))
    return kinds, values, wires


def size(effect: str, series: np.ndarray, rng: np.random.Generator) -> dict[str, float]:
    """A moderate size for a signal."""
    low, high = np.quantile(series, [0.01, 0.99])
    a = 0.5 * (high - low)
    speed = np.gradient(series) / H
    pace = a / np.sqrt(np.mean(speed**2))
    sign = float(rng.choice([-1, 1]))
    if effect == "port.gain":
        return {"gain": float(1 + sign * rng.uniform(0.1, 0.3))}
    if effect == "port.offset":
        return {"offset": float(sign * rng.uniform(0.1, 0.3) * a)}
    if effect in ("port.delay", "port.lag"):
        return {effect.partition(".")[2]: float(max(rng.uniform(0.1, 0.4) * pace, 4 * H))}
    if effect == "port.saturation":
        centre = 0.5 * (low + high)
        return {
            "low": float(centre - rng.uniform(0.4, 0.75) * a),
            "high": float(centre + rng.uniform(0.4, 0.75) * a),
        }
    if effect == "port.dead_zone":
        return {"low": float(-rng.uniform(0.08, 0.25) * a), "high": float(rng.uniform(0.08, 0.25) * a)}
    if effect == "port.play":
        return {"half_width": float(rng.uniform(0.06, 0.2) * a)}
    if effect == "port.rate_limit":
        return {"rate": float(np.quantile(np.abs(speed), rng.uniform(0.6, 0.85)))}
    if effect == "port.quantisation":
        return {"quantum": float(rng.uniform(0.06, 0.2) * a)}
    if effect == "port.drift":
        return {"rate": float(sign * rng.uniform(0.15, 0.4) * a / (H * COUNT))}
    if effect == "port.dropout":
        return {"probability": float(rng.uniform(0.05, 0.4))}
    if effect == "strange.square":
        return {"size": float(rng.uniform(0.2, 0.4) / a)}
    return {
        "size": float(rng.uniform(0.2, 0.4) * (a if effect == "strange.disturbance" else 1.0)),
        "pace": float(rng.uniform(3, 9)),
    }


def place(
    effect: str,
    case_wires: list[tuple[str, str]],
    kinds: dict[str, str],
    measured: list[str],
    rng: np.random.Generator,
) -> tuple[str, str]:
    """A connector and where."""
    outputs = [f"{n}.y" for n in kinds]
    if effect in READINGS:
        return str(rng.choice([m for m in measured if m != "command"])), "sensor"
    where = str(
        rng.choice(["input", "output"] if effect.startswith("strange") else ["input", "output", "sensor"])
    )
    if where == "input":
        return case_wires[int(rng.integers(0, len(case_wires)))][1], where
    return str(rng.choice(outputs if where == "output" else [m for m in measured if m != "command"])), where


def make_case(seed: int, most: int = 8, kind: str | None = None, least: int = 2) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng(seed)
    kind = kind or CLASSES[seed % len(CLASSES)]
    kinds, values, wires = system(rng, most, least)
    outputs = [f"{n}.y" for n in kinds]
    handed_on = {source for source, _ in wires}
    measured = ["command", *(o for o in outputs if rng.random() < 0.85 or o not in handed_on)]
    case = Case(seed, kind, kinds, values, wires, measured)
    series = simulate(kinds, values, wires, {"command": command(rng)}, H, [])
    feeds = {end: source for source, end in wires}
    count = {"port": 1, "two": 2, "outside": 1}.get(kind, 0)
    while len(case.hidden) < count:
        effect = str(rng.choice(OUTSIDE if kind == "outside" else EFFECTS))
        port, where = place(effect, wires, kinds, measured, rng)
        if any(port == h.port for h in case.hidden):
            continue
        case.hidden.append(Hidden(effect, port, where, size(effect, series[feeds.get(port, port)], rng)))
    if kind == "parameter":
        name = str(rng.choice(list(kinds)))
        parameter = str(rng.choice(list(values[name])))
        factor = float(rng.choice([rng.uniform(0.6, 0.85), rng.uniform(1.2, 1.6)]))
        case.numbers[f"{name}.{parameter}"] = values[name][parameter], factor
    if kind == NUMBERS:  # those of one component, and some of the others'
        own = str(rng.choice(list(kinds)))
        for name in kinds:
            for parameter, value in values[name].items():
                if rng.random() < (0.9 if name == own else 0.15):
                    factor = float(rng.choice([rng.uniform(0.5, 0.9), rng.uniform(1.1, 1.8)]))
                    case.numbers[f"{name}.{parameter}"] = value, factor
    return case


def log_of(case: Case, rng: np.random.Generator | None = None, size: float = 1.0) -> dict[str, np.ndarray]:
    """What was measured; `rng` draws the command (`size` times as large) and the noise, by default those of the case."""
    rng = rng or np.random.default_rng(case.seed + 10**6)
    values = {n: dict(v) for n, v in case.values.items()}
    for name, (value, factor) in case.numbers.items():
        component, _, parameter = name.partition(".")
        values[component][parameter] = value * factor
    true = simulate(case.kinds, values, case.wires, {"command": command(rng, size)}, H, case.hidden)
    signals = read(true, case.hidden, H, NOISE, rng)
    return {n: signals[n] for n in case.measured}


def trusted_of(case: Case) -> dict[str, None]:
    """All parameters where one of them is hidden or nothing is, and in every second system of the other classes."""
    if case.kind in ("parameter", "none", NUMBERS) or case.seed // len(CLASSES) % 2:
        return {f"{n}.{p}": None for n, v in case.values.items() for p in v}
    return {}


def run(case: Case, fmus: dict[str, Path], folder: Path) -> tuple[Answer, float, int]:
    """Answer, time and runs of FMUs."""
    package = parts.write_ssp(
        folder / f"case{case.seed}.ssp", {n: fmus[k] for n, k in case.kinds.items()}, case.wires, case.values
    )
    signals = log_of(case)
    columns = {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
    trusted = trusted_of(case)
    begun = time.perf_counter()
    # the parts are known to behave: no process of its own, whose start costs more than most of its runs
    with read_system(package) as loaded, Runs(loaded, apart=False) as runs:
        log = Recording(folder / "log.csv", H * np.arange(COUNT), signals, columns)
        found = diagnose_system(loaded, [log], runs, AnyOptions(trusted=trusted))
        return answer(found), time.perf_counter() - begun, runs.count


def told(cause: NamedCause) -> set[str]:
    """Everything that a cause declares possible, in words."""
    return {named(cause), *cause.indistinguishable_from}


def named(cause: NamedCause) -> str:
    """What it is named, in words."""
    port = f"{cause.component}.{cause.connector or cause.parameter}"
    return f"parameter {port}" if cause.effect == "parameter" else f"{cause.effect} at {port} ({cause.where})"


def score(case: Case, found: Answer) -> dict[str, bool]:
    """What is right."""
    result: dict[str, bool] = {}
    wanted = [f"{h.effect} at {h.port} ({h.where})" for h in case.hidden]
    wanted += [f"parameter {name}" for name in case.numbers]
    sets = [told(c) for c in found.causes]
    if case.kind == "none":
        return {"clean": not found.causes, "adequate": found.verdict == "adequate"}
    if case.kind == "outside":
        component = case.hidden[0].port.partition(".")[0]
        near = {component, *(s.partition(".")[0] for s, e in case.wires if e == case.hidden[0].port)}
        blocks = {u.block for u in found.unexplained} | {x.block for x in found.localisation if x.share > 0.3}
        groups = {part for b in blocks for part in b.split("+")}
        return {"unexplained": found.verdict == "unexplained", "place": bool(near & groups)}
    result["exact"] = len(sets) == len(wanted) and all(any(w in s for s in sets) for w in wanted)
    result["named"] = all(any(w in s for s in sets) for w in wanted)
    result["component"] = bool(sets) and all(
        any(
            w.split(" at ")[-1].removeprefix("parameter ").partition(".")[0]
            in {t.split(" at ")[-1].removeprefix("parameter ").partition(".")[0] for t in s}
            for s in sets
        )
        for w in wanted
    )
    result["kind"] = all(any(w.split(" ")[0] in {t.split(" ")[0] for t in s} for s in sets) for w in wanted)
    if case.kind in ("port", "parameter") and result["exact"]:
        (cause,) = found.causes
        true = {n.partition(".")[2]: value * factor for n, (value, factor) in case.numbers.items()}
        true = case.hidden[0].values if case.hidden else true
        if named(cause) == wanted[0]:
            errors = [abs(p.value - true[n]) / max(abs(true[n]), 1e-12) for n, p in cause.parameters.items()]
            result["size 5 %"] = max(errors, default=1.0) < 0.05
            result["within ci"] = all(p.ci95[0] <= true[n] <= p.ci95[1] for n, p in cause.parameters.items())
    return result


def shows(case: Case) -> float:
    """How far the readings are changed by what is hidden: the largest RMS of a signal over that of its noise."""
    clean = log_of(replace(case, hidden=[], numbers={}))
    return max(
        float(np.sqrt(np.mean((values - clean[name]) ** 2)) / (NOISE * np.std(clean[name])))
        for name, values in log_of(case).items()
        if name != "command"
    )


def row_of(case: Case, found: Answer, seconds: float, runs: int) -> dict[str, object]:
    """Everything that is kept of a case."""
    hidden = [[h.effect, h.port, h.where, {n: round(v, 4) for n, v in h.values.items()}] for h in case.hidden]
    for name, (value, factor) in case.numbers.items():
        hidden.append(["parameter", name, "", {"was": value, "is": round(value * factor, 4)}])
    return {
        "seed": case.seed,
        "class": case.kind,
        "parts": len(case.kinds),
        "loop": looped(case),
        "trusted": bool(trusted_of(case)),
        "seconds": round(seconds, 1),
        "runs": runs,
        "right": score(case, found),
        "shows": round(shows(case), 2) if hidden else 0.0,
        "hidden": hidden,
        "verdict": found.verdict,
        "said": [
            [sorted(told(c)), {n: [p.value, *(p.ci95 or ())] for n, p in c.parameters.items()}]
            for c in found.causes
        ],
        "unexplained": [[u.block, u.what] for u in found.unexplained],
        "refused": [[r.effect, r.why] for r in found.refused],
        "wires": case.wires,
        "kinds": case.kinds,
        "measured": case.measured,
    }


def looped(case: Case) -> bool:
    """Whether a wire leads back."""
    order = list(case.kinds)
    return any(
        s != "command" and order.index(s.partition(".")[0]) >= order.index(e.partition(".")[0])
        for s, e in case.wires
    )


def report(rows: list[dict[str, Any]]) -> None:
    """Print how often each class was right, with 95 % intervals (Wilson), and what a case costs."""
    totals: Counter[str] = Counter()
    right: Counter[str] = Counter()
    for row in rows:
        for key, value in {"runs": "failed" not in row, **row.get("right", {})}.items():
            totals[f"{row['class']}: {key}"] += 1
            right[f"{row['class']}: {key}"] += bool(value)
    for key, count in sorted(totals.items()):
        interval = binomtest(right[key], count).proportion_ci(method="wilson")
        print(
            f"{key:28s} {right[key]:4d} of {count:4d} ({100 * interval.low:.0f} to {100 * interval.high:.0f} %)"
        )
    for count in sorted({r["parts"] for r in rows if "parts" in r}):
        own = [r for r in rows if r.get("parts") == count]
        print(
            f"{count} components, {len(own)} systems: {np.median([r['seconds'] for r in own]):.1f} s, "
            f"{np.median([r['runs'] for r in own]):.0f} runs of FMUs (medians)"
        )


def processor_time() -> float:
    """Of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])


def main() -> None:
    """Run the cases and print the score."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--most", type=int, default=8, help="components")
    parser.add_argument("--least", type=int, default=2, help="components")
    parser.add_argument("--kind", choices=(*CLASSES, NUMBERS))
    parser.add_argument("--python", action="store_true", help="FMUs of plain pythonfmu")
    parser.add_argument(
        "--rows", type=Path, help="a JSON line for each case; seeds that it holds are not run again"
    )
    parser.add_argument("--processor-time", type=float, default=float("inf"), help="s, after which to end")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if options.rows and options.rows.is_file():
        rows = [json.loads(line) for line in options.rows.read_text().splitlines()]
    known = {row["seed"] for row in rows}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make = parts.python if options.python else parts.native
        fmus = {kind: make(kind, folder) for kind in parts.KINDS}
        for seed in range(options.seed, options.seed + options.count):
            if seed in known:
                continue
            if processor_time() > options.processor_time:
                break
            case = make_case(seed, options.most, options.kind, options.least)
            try:
                row = row_of(case, *run(case, fmus, folder))
            except Exception as error:  # a case that fails is counted, and the others go on
                row = {"seed": seed, "class": case.kind, "failed": f"{type(error).__name__}: {error}"}
            rows.append(row)
            if options.rows:
                with options.rows.open("a") as file:
                    file.write(json.dumps(row) + "\n")
            wrong = [k for k, v in row.get("right", {}).items() if not v]
            if "failed" in row:
                print(f"{seed} {case.kind}: FAILED {row['failed']}", flush=True)
                continue
            line = f"{seed} {case.kind} {row['parts']} parts {row['seconds']:.0f} s {row['runs']} runs: "
            print(line + (f"wrong: {', '.join(wrong)}" if wrong else "right"), flush=True)
            if wrong:
                for key in (
                    "hidden",
                    "shows",
                    "wires",
                    "kinds",
                    "measured",
                    "verdict",
                    "said",
                    "unexplained",
                    "refused",
                ):
                    print(f"   {key}: {row[key]}", flush=True)
    report(rows)


if __name__ == "__main__":
    main()
