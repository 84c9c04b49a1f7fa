"""Do intervals from several logs of any system hold? ``python benchmarks/any_several_logs.py --count 40 --seed 1``.

Random systems as in `any_system.py`, one port effect or parameter hidden, three to five logs each. Its size scatters from
log to log by none, 5 or 10 % of itself, as a machine does: counted is how often the interval holds the machine's mean size,
and how often that of the next log holds what another log of this machine has.
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

from benchmarks.any_system import COUNT, Case, H, log_of, make_case
from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden
from cosim.anysystem.actions import PARAMETER
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.ssp.read import read_system
from cosim.system.runs import Runs

SCATTERS = (0.0, 0.05, 0.1)
NEUTRAL = {"gain": 1.0}  # where a number has no effect; none of the others


def scattered(case: Case, factor: float) -> Case:
    """The case with what is hidden in it this many times as far from none."""
    if case.parameter:
        name, value, times = case.parameter
        return replace(case, parameter=(name, value, 1.0 + factor * (times - 1.0)))
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
    if case.parameter:
        return {f"{PARAMETER}|{case.parameter[0]}": case.parameter[1] * case.parameter[2]}
    (h,) = case.hidden
    return {f"{h.effect}|{h.port}|{h.where}|{n}": v for n, v in h.values.items()}


def run(seed: int, fmus: dict[str, Path], folder: Path) -> dict[str, object]:
    """One machine: its intervals, and whether they hold."""
    rng = np.random.default_rng(seed + 10**7)
    case = make_case(seed, most=3, kind="parameter" if seed % 3 == 0 else "port")
    scatter, count = SCATTERS[seed // 3 % 3], int(rng.integers(3, 6))
    factors = 1.0 + scatter * rng.normal(size=count + 1)
    package = parts.write_ssp(
        folder / f"case{seed}.ssp", {n: fmus[k] for n, k in case.kinds.items()}, case.wires, case.values
    )
    logs = []
    for k, factor in enumerate(factors[:-1]):
        signals = log_of(scattered(case, float(factor)), np.random.default_rng(1000 * case.seed + k))
        columns = {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
        logs.append(Recording(folder / f"log{k}.csv", H * np.arange(COUNT), signals, columns))
    trusted = {case.parameter[0]: None} if case.parameter else {}
    begun = time.perf_counter()
    with read_system(package) as system, Runs(system, apart=False) as runs:
        found = diagnose_system(system, logs, runs, AnyOptions(trusted=trusted))
    row: dict[str, object] = {"seed": seed, "logs": count, "scatter": scatter, "runs": runs.count}
    row["seconds"] = round(time.perf_counter() - begun, 1)
    between = {n: b for f in found.findings.values() for n, b in f.between.items()}
    holds, following = [], []
    next_sizes = true_sizes(scattered(case, float(factors[-1])))
    for name, mean in true_sizes(case).items():
        if name in between:
            low, high = between[name].ci95
            holds.append(bool(low <= mean <= high))
            low, high = between[name].next_ci95
            following.append(bool(low <= next_sizes[name] <= high))
    return row | {"holds": holds, "next": following, "named": [a.words for _, a in found.causes()]}


def main() -> None:
    """Run the machines and print the coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="a JSON line for each machine")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fmus = {kind: parts.native(kind, folder) for kind in parts.KINDS}
        for seed in range(options.seed, options.seed + options.count):
            rows.append(run(seed, fmus, folder))
            print(rows[-1], flush=True)
            if options.rows:
                with options.rows.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
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
