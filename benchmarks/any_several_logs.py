"""Do intervals from several logs of any system hold? ``python benchmarks/any_several_logs.py --count 40 --seed 1``.

Random systems as in `any_system.py`, one port effect or parameter hidden, three to five logs each. Its size scatters from
log to log by none, 5 or 10 % of itself, as a machine does: counted is how often the interval holds the machine's mean size,
and how often that of the next log holds what another log of this machine has.

With ``--lacking`` no size scatters. The first log has every signal and is quiet; the others lack a signal in the middle and
move fully. A port effect, a parameter or nothing is hidden: counted is how often the answer is right.
With ``--limits`` what is hidden is a limit (or nothing), and it scatters by a tenth of itself.
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scipy.stats import binomtest

from benchmarks.any_system import COUNT, NOISE, Case, H, log_of, make_case, score, shows
from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden
from cosim.anysystem.actions import PARAMETER
from cosim.anysystem.answer import answer
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.ssp.read import read_system
from cosim.system.runs import Runs

SCATTERS = (0.0, 0.05, 0.1)
NEUTRAL = {"gain": 1.0}  # where a number has no effect; none of the others
QUIET = 0.15  # of the other logs' command: no limit is met
LIMITS = ("port.saturation", "port.dead_zone", "port.play", "port.rate_limit")
SHOWS = 3.0  # times its noise, by which what is hidden changes a reading of one of the logs at least


def scattered(case: Case, factor: float) -> Case:
    """The case with what is hidden in it this many times as far from none."""
    if case.numbers:
        numbers = {n: (value, 1.0 + factor * (times - 1.0)) for n, (value, times) in case.numbers.items()}
        return replace(case, numbers=numbers)
    hidden = [
        Hidden(
            h.effect,
            h.port,
            h.where,
            {n: NEUTRAL.get(n, 0.0) + factor * (v - NEUTRAL.get(n, 0.0)) for n, v in h.values.items()},
        )
        for h in case.hidden
    ]
    return replace(case, hidden=hidden)


def true_sizes(case: Case) -> dict[str, float]:
    """Numbers of what is hidden, by the keys of the diagnosis."""
    if case.numbers:
        return {f"{PARAMETER}|{n}": value * times for n, (value, times) in case.numbers.items()}
    (h,) = case.hidden
    return {f"{h.effect}|{h.port}|{h.where}|{n}": v for n, v in h.values.items()}


def limited_case(seed: int) -> Case:
    """A machine with a limit, every fourth with nothing."""
    if seed % 4 == 3:
        return make_case(seed, most=3, kind="none")
    draws = (make_case(seed + 10**5 * draw, most=3, kind="port") for draw in range(1000))
    return next(c for c in draws if c.hidden[0].effect in LIMITS and shows(c) > SHOWS)


def run_limits(seed: int, fmus: dict[str, Path], folder: Path) -> dict[str, object]:
    """One machine with a limit that is another in each log."""
    return run(seed, fmus, folder, limited_case(seed), SCATTERS[-1])


def run(
    seed: int, fmus: dict[str, Path], folder: Path, case: Case | None = None, scatter: float | None = None
) -> dict[str, object]:
    """One machine: its intervals, and whether they hold."""
    rng = np.random.default_rng(seed + 10**7)
    case = case or make_case(seed, most=3, kind="parameter" if seed % 3 == 0 else "port")
    scatter, count = SCATTERS[seed // 3 % 3] if scatter is None else scatter, int(rng.integers(3, 6))
    factors = 1.0 + scatter * rng.normal(size=count + 1)
    package = parts.write_ssp(
        folder / f"case{seed}.ssp", {n: fmus[k] for n, k in case.kinds.items()}, case.wires, case.values
    )
    logs = []
    for k, factor in enumerate(factors[:-1]):
        signals = log_of(scattered(case, float(factor)), np.random.default_rng(1000 * case.seed + k))
        columns = {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
        logs.append(Recording(folder / f"log{k}.csv", H * np.arange(COUNT), signals, columns))
    trusted = dict.fromkeys(case.numbers)
    begun = time.perf_counter()
    with read_system(package) as system, Runs(system, apart=False) as runs:
        found = diagnose_system(system, logs, runs, AnyOptions(trusted=trusted))
        told = answer(found)
    row: dict[str, object] = {"seed": seed, "logs": count, "scatter": scatter, "runs": runs.count}
    row["seconds"] = round(time.perf_counter() - begun, 1)
    between = {n: b for f in found.findings.values() for n, b in f.between.items()}
    holds, following = [], []
    next_sizes = true_sizes(scattered(case, float(factors[-1]))) if case.kind != "none" else {}
    for name, mean in (true_sizes(case) if next_sizes else {}).items():
        if name in between:
            low, high = between[name].ci95
            holds.append(bool(low <= mean <= high))
            low, high = between[name].next_ci95
            following.append(bool(low <= next_sizes[name] <= high))
    row |= {"class": case.kind, "right": score(case, told), "verdict": told.verdict}
    row["hidden"] = [[h.effect, h.port, h.where, dict(h.values)] for h in case.hidden] or case.numbers
    row["factors"] = [round(float(f), 3) for f in factors]
    row["refused"] = [[r.effect, r.why] for r in told.refused]
    return row | {"holds": holds, "next": following, "named": [a.words for _, a in found.causes()]}


def lacking_case(seed: int) -> tuple[Case, str, int]:
    """A machine of which all is measured, the signal in its middle that some logs lack, and how many these are."""
    rng = np.random.default_rng(seed + 2 * 10**7)
    kind = ("port", "port", "parameter", "none")[seed % 4]
    for draw in range(1000):
        case = make_case(seed + 10**5 * draw, most=4, kind=kind)
        case.measured = ["command", *(f"{n}.y" for n in case.kinds)]
        middle = sorted({source for source, _ in case.wires if "." in source})
        lacked, count = str(rng.choice(middle)), int(rng.integers(1, 3))
        if kind == "none" or max(shown(case, k, lacked) for k in range(count + 1)) > SHOWS:
            return case, lacked, count
    raise RuntimeError(f"seed {seed}: nothing shows")


def seen(case: Case, k: int, lacked: str) -> dict[str, np.ndarray]:
    """The log number k: the first is quiet and whole."""
    signals = log_of(case, np.random.default_rng(1000 * case.seed + k), 1.0 if k else QUIET)
    return {n: s for n, s in signals.items() if not k or n != lacked}


def shown(case: Case, k: int, lacked: str) -> float:
    """How far what is hidden changes the readings of a log: the largest RMS over the noise."""
    clean = seen(replace(case, hidden=[], parameter=None), k, lacked)
    return max(
        float(np.sqrt(np.mean((s - clean[n]) ** 2)) / (NOISE * np.std(clean[n])))
        for n, s in seen(case, k, lacked).items()
        if n != "command"
    )


def run_lacking(seed: int, fmus: dict[str, Path], folder: Path) -> dict[str, object]:
    """One machine of which some logs lack a signal: whether the answer is right."""
    case, lacked, count = lacking_case(seed)
    package = parts.write_ssp(
        folder / f"case{seed}.ssp", {n: fmus[k] for n, k in case.kinds.items()}, case.wires, case.values
    )
    logs = []
    for k in range(count + 1):
        signals = seen(case, k, lacked)
        columns = {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
        logs.append(Recording(folder / f"log{k}.csv", H * np.arange(COUNT), signals, columns))
    trusted = {f"{n}.{p}": None for n, v in case.values.items() for p in v} if case.kind != "port" else {}
    begun = time.perf_counter()
    with read_system(package) as system, Runs(system, apart=False) as runs:
        found = diagnose_system(system, logs, runs, AnyOptions(trusted=trusted))
        told = answer(found)
    return {
        "seed": seed,
        "class": case.kind,
        "lacked": lacked,
        "logs": count + 1,
        "wires": case.wires,
        "hidden": [[h.effect, h.port, h.where, dict(h.values)] for h in case.hidden] or case.numbers,
        "right": score(case, told),
        "verdict": told.verdict,
        "named": [a.words for _, a in found.causes()],
        "runs": runs.count,
        "seconds": round(time.perf_counter() - begun, 1),
    }


def print_right(rows: list[dict[str, object]]) -> None:
    """How many are right of each class."""
    for kind in dict.fromkeys(r["class"] for r in rows):
        own: list[dict[str, bool]] = [r["right"] for r in rows if r["class"] == kind]  # type: ignore[misc]
        for key in dict.fromkeys(k for r in own for k in r):
            held = [r[key] for r in own if key in r]
            interval = binomtest(sum(held), len(held)).proportion_ci(method="wilson")
            print(
                f"{kind}: {key} {sum(held)} of {len(held)} "
                f"({100 * interval.low:.0f} to {100 * interval.high:.0f} %)"
            )


def main() -> None:
    """Run the machines and print the coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="a JSON line for each machine")
    parser.add_argument("--limits", action="store_true", help="limits that scatter by a tenth")
    parser.add_argument("--lacking", action="store_true", help="logs that lack a signal in the middle")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fmus = {kind: parts.native(kind, folder) for kind in parts.KINDS}
        for seed in range(options.seed, options.seed + options.count):
            one = run_lacking if options.lacking else run_limits if options.limits else run
            rows.append(one(seed, fmus, folder))
            print(rows[-1], flush=True)
            if options.rows:
                with options.rows.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    print_right(rows)
    if options.lacking:
        return
    for scatter in SCATTERS:
        for key, what in (("holds", "the machine's mean"), ("next", "the next log's")):
            found = [x for r in rows if r["scatter"] == scatter for x in r[key]]  # type: ignore[attr-defined]
            if found:
                interval = binomtest(sum(found), len(found)).proportion_ci(method="wilson")
                print(
                    f"scatter {scatter:g}: interval holds {what} size {sum(found)} of {len(found)} "
                    f"({100 * interval.low:.0f} to {100 * interval.high:.0f} %)"
                )
    print(f"{sum(r['runs'] for r in rows)} runs of FMUs, {sum(r['seconds'] for r in rows):.0f} s")  # type: ignore[misc]


if __name__ == "__main__":
    main()
