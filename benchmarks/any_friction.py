"""Dry friction that a stranger's FMU lacks: ``python benchmarks/any_friction.py --count 12 --seed 100``.

Random axes (mass, damping, in every second one a spring) as FMUs of plain pythonfmu; force to place or speed. The log has
dry friction besides, which in every third rises from rest (Stribeck), or nothing besides (``--without``), and is made by
scipy's LSODA. A case is right where friction alone is named, its level within a tenth (or between those of motion and of
rest), or where nothing is.
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scipy.integrate import solve_ivp

from benchmarks.systems import parts
from cosim.anysystem.answer import answer
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.diagnosis.answer.schema import Answer
from cosim.ssp.read import read_system
from cosim.system.runs import Runs

LEAST = 0.003  # of the usual speed: below it friction rises
NEAR = 0.1  # of the level
SCRIPT = """from pythonfmu import Fmi2Causality as Causality, Fmi2Slave, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.force, self.m, self.d, self.k, self.x, self.v = 0.0, 1.0, 1.0, 0.0, 0.0, 0.0
        self.register_variable(Real("force", causality=Causality.input))
        for name in ("m", "d", "k"):
            self.register_variable(Real(name, causality=Causality.parameter))
        self.register_variable(Real("{output}", causality=Causality.output))

    def do_step(self, t, step):
        h = step / 8
        for _ in range(8):
            middle = self.v + 0.5 * h * self.rate(self.x, self.v)
            self.v += h * self.rate(self.x + 0.5 * h * self.v, middle)
            self.x += h * middle
        return True

    def rate(self, x, v):
        return (self.force - self.d * v - self.k * x) / self.m
"""


@dataclass(frozen=True)
class Axis:
    """An axis, and the friction of the machine.

    Attributes:
        output: x (place) or v (speed).
        values: m, d and k of the FMU.
        level: dry friction in the force's unit; 0 for none.
        stiction: times the level, at rest.
        h, force, noise: of the log: interval [s], (n,) input, standard deviation of the reading.
    """

    output: str
    values: dict[str, float]
    level: float
    stiction: float
    h: float
    force: np.ndarray
    noise: float


def make_axis(seed: int, without: bool = False) -> Axis:
    """The axis of a seed."""
    rng = np.random.default_rng(seed)
    output = "x" if seed % 2 else "v"
    m, tau = float(rng.uniform(0.5, 3.0)), float(rng.uniform(0.1, 0.6))
    k = float(m * rng.uniform(2.0, 6.0) ** 2) if seed // 2 % 2 else 0.0
    h, count = float(rng.choice([0.005, 0.01])), 3000
    t = h * np.arange(count)
    every = int(rng.integers(80, 250))
    steps = np.repeat(rng.uniform(-1, 1, count // every + 1), every)[:count]
    sines = sum(
        rng.uniform(0.1, 0.4) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.11, 0.37, 0.9, 1.7)
    )
    level = 0.0 if without else float(rng.uniform(0.08, 0.3))
    stiction = float(rng.uniform(1.2, 1.5)) if seed % 3 == 0 else 1.0
    return Axis(output, {"m": m, "d": m / tau, "k": k}, level, stiction, h, steps + sines, 0.01)


def log_of(axis: Axis, seed: int) -> np.ndarray:
    """(n,) what was read of the output."""
    m, d, k = (axis.values[n] for n in ("m", "d", "k"))
    t = axis.h * np.arange(axis.force.size)
    usual = 0.5 / d

    def rate(at: float, state: np.ndarray) -> list[float]:
        x, v = state
        rise = axis.stiction + (1.0 - axis.stiction) * min(abs(v) / (0.2 * usual), 1.0)
        rubs = axis.level * rise * np.tanh(v / (LEAST * usual))
        return [v, (np.interp(at, t, axis.force) - d * v - k * x - rubs) / m]

    states = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], "LSODA", t, max_step=axis.h, rtol=1e-7, atol=1e-9).y
    series = states["xv".index(axis.output)]
    rng = np.random.default_rng(seed + 10**6)
    return np.asarray(series + axis.noise * np.std(series) * rng.standard_normal(series.size))


def run(axis: Axis, seed: int, fmus: dict[str, Path], folder: Path) -> tuple[Answer, int]:
    """Answer and runs of FMUs."""
    wires, values = [("force", "axis.force")], {"axis": axis.values}
    ports = ["force"], [f"axis.{axis.output}"]
    package = parts.write_ssp(folder / f"axis{seed}.ssp", {"axis": fmus[axis.output]}, wires, values, *ports)
    signals = {"force": axis.force, f"axis.{axis.output}": log_of(axis, seed)}
    columns = {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
    trusted = {f"axis.{n}": 0.05 for n, v in axis.values.items() if v}
    with read_system(package) as loaded, Runs(loaded, apart=False) as runs:
        log = Recording(folder / "log.csv", axis.h * np.arange(axis.force.size), signals, columns)
        return answer(diagnose_system(loaded, [log], runs, AnyOptions(trusted=trusted))), runs.count


def row_of(axis: Axis, seed: int, found: Answer, seconds: float, runs: int) -> dict[str, Any]:
    """What is kept of a case."""
    said = {c.effect + " " + (c.connector or c.parameter or ""): c for c in found.causes}
    rubs = next((c for n, c in said.items() if n == "port.friction force"), None)
    level = rubs.parameters["level"].value if rubs else 0.0
    gain = next(iter(found.gain.values()), None)
    near = (1.0 - NEAR) * axis.level <= level <= (1.0 + NEAR) * axis.level * axis.stiction
    return {
        "seed": seed,
        "output": axis.output,
        "spring": axis.values["k"] > 0.0,
        "stiction": round(axis.stiction, 2),
        "level": round(axis.level, 4),
        "found": round(level, 4),
        "ci95": list(rubs.parameters["level"].ci95 or ()) if rubs else [],
        "right": not said if axis.level == 0.0 else near and len(said) == 1,
        "near": near,
        "said": list(said),
        "unexplained": [u.what for u in found.unexplained],
        "ratio": round(gain.rmse_after / gain.rmse_before, 3) if gain else 1.0,
        "seconds": round(seconds, 1),
        "runs": runs,
    }


def main() -> None:
    """Run the cases and print a row each, and what is right in all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--seed", type=int, default=100, help="of the first case")
    parser.add_argument("--without", action="store_true", help="axes without friction")
    parser.add_argument("--rows", type=Path, help="write the rows to this file, one JSON object a line")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        fmus = {
            o: parts.by_pythonfmu(f"Axis{o}", SCRIPT.format(name=f"Axis{o}", output=o), folder) for o in "xv"
        }
        for seed in range(options.seed, options.seed + options.count):
            axis, begun = make_axis(seed, options.without), time.perf_counter()
            found, runs = run(axis, seed, fmus, folder)
            rows.append(row_of(axis, seed, found, time.perf_counter() - begun, runs))
            print(json.dumps(rows[-1]), flush=True)
            if options.rows:
                options.rows.write_text("".join(json.dumps(r) + "\n" for r in rows))
    right, near = (sum(r[k] for r in rows) for k in ("right", "near"))
    ratio = float(np.median([r["ratio"] for r in rows]))
    print(f"right {right} of {len(rows)}; level near {near}; error after over before {ratio:.2g} (median)")


if __name__ == "__main__":
    main()
