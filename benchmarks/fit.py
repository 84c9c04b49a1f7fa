"""How fast a fit is: ``python benchmarks/fit.py [--duration 20] [--repeat 3] [--json FILE] [--coverage N]``.

The same least-squares problem, three unknowns of the mechanics fitted to the slew of a synthetic log with dry friction,
(a) by the compiled twin, (b) through the FMUs with our runner, (c) by scipy around fmpy as one would write it by hand:
instances unpacked and loaded once and reset for every simulation, one raw doStep after the other. All three see the same
residual with the same differences, so they must end at the same values; the table gives processor times (what else runs
on the machine does not count) and their ratios.

``--coverage N`` makes N logs of each kind of noise with seven parameters off nominal, and counts how often a 95 % interval
holds the truth.
"""

import argparse
import json
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from cosim.calibrate import calibrate, read_free
from cosim.calibrate.free import Free
from cosim.calibrate.pipeline import Options
from cosim.calibrate.problem import DIFFERENCE
from cosim.compare import Comparator, open_model
from cosim.diagnosis.model.cut import TRUSTED
from cosim.logs import Log
from cosim.paths import ssp_folder
from cosim.rig import Noise, as_log, make_log
from cosim.rig.parameters import nominal_value
from cosim.ssp.write import write_ssp

Array = NDArray[np.float64]
HIDDEN = "mechanical.coulomb_friction:tau_c=150 N.m"
FREE = ("mechanical.J=400:1500 kg.m2", "mechanical.b=10e3:50e3 N.m.s/rad", "mechanical.tau_c=0:500 N.m")
CHAIN = ("compensator", "dead_zone", "dcv", "continuity", "mechanical", "sensor")
SAME_FIT = 1e-5  # relative: five decimals
NOISES = {
    "white": Noise(),
    "ar1, 30 ms": Noise(kind="ar1", correlation_time=0.03),
    "ar1, 1 s": Noise(kind="ar1", correlation_time=1.0),
    "1/f": Noise(kind="pink"),
}


class ByHand:
    """The chain of FMUs run by fmpy's classes: loaded once, reset for each simulation, stepped in the order of the wires."""

    def __init__(self, package: Path, folder: Path, log: Log) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from lxml import etree

        self.log, self.h = log, log.step
        with zipfile.ZipFile(package) as archive:
            archive.extractall(folder)
        self.slaves: dict[str, Any] = {}
        self.references: dict[str, dict[str, int]] = {}
        self.starts: dict[str, dict[str, float]] = {}
        for name in CHAIN:
            unpacked = fmpy.extract(str(folder / "resources" / f"{name}.fmu"), str(folder / name))
            description = fmpy.read_model_description(unpacked, validate=False)
            slave = FMU2Slave(
                guid=description.guid,
                unzipDirectory=unpacked,
                modelIdentifier=description.coSimulation.modelIdentifier,
                instanceName=name,
            )
            slave.instantiate()
            self.slaves[name] = slave
            self.references[name] = {v.name: v.valueReference for v in description.modelVariables}
            self.starts[name] = {}
            values = etree.parse(str(folder / "resources" / f"{name}.ssv"))
            for node in values.iterfind(".//{*}Parameter"):
                if etree.QName(node[0]).localname == "Real":
                    self.starts[name][node.get("name")] = float(node[0].get("value"))

    def simulate(self, values: Mapping[str, float]) -> Array:
        """Slew angle (n,), rad."""
        ports = [("command", "demand"), ("command", "demand"), ("demand", "spool"), ("spool", "p_load"),
                 ("p_load", "theta"), ("theta", "slew")]  # fmt: skip
        stages = []
        for name, (source, target) in zip(CHAIN, ports, strict=True):
            slave, references = self.slaves[name], self.references[name]
            slave.reset()
            own = {k.partition(".")[2]: v for k, v in values.items() if k.startswith(name + ".")}
            for parameter, value in {**self.starts[name], **own}.items():
                slave.setReal([references[parameter]], [value])
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()
            stages.append((slave, [references[source]], [references[target]]))
        u = self.log["u"].tolist()
        signal = u[0]
        for slave, source, target in stages:
            slave.setReal(source, [signal])
            slave.exitInitializationMode()
            (signal,) = slave.getReal(target)
        slew = np.empty(len(u))
        slew[0] = signal
        for k in range(len(u) - 1):
            signal = u[k]
            for slave, source, target in stages:
                slave.setReal(source, [signal])
                slave.doStep(k * self.h, self.h)
                (signal,) = slave.getReal(target)
            slew[k + 1] = signal
        for slave, *_ in stages:
            slave.terminate()
        return slew

    def close(self) -> None:
        """Free the instances."""
        for slave in self.slaves.values():
            slave.freeInstance()


def by_hand(
    simulate: Callable[[Mapping[str, float]], Array], log: Log, free: Sequence[Free], start_angle: Free
) -> tuple[dict[str, float], int]:
    """Scipy's least squares around a simulation: estimates, and how many simulations they took."""
    unknowns = [*free, start_angle]
    sizes = np.array([f.size for f in unknowns])
    low, high = (np.array([getattr(f, end) for f in unknowns]) / sizes for end in ("low", "high"))
    count = 0

    def cost(z: Array) -> Array:
        nonlocal count
        count += 1
        values = {f.name: float(x * f.size) for f, x in zip(unknowns, z, strict=True)}
        return log["slew"] - simulate(values)

    def slopes(z: Array) -> Array:
        columns = []
        for i in range(z.size):
            up, down = z.copy(), z.copy()
            up[i], down[i] = min(z[i] + DIFFERENCE, high[i]), max(z[i] - DIFFERENCE, low[i])
            columns.append((cost(up) - cost(down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)

    first = np.array([f.start for f in unknowns]) / sizes
    found = least_squares(
        cost, first, slopes, bounds=(low, high), x_scale="jac", max_nfev=40, xtol=1e-8, ftol=1e-10
    )
    return {f.name: float(x * f.size) for f, x in zip(unknowns, found.x, strict=True)}, count


def command(duration: float) -> Array:
    """Steps of many sizes with rests between, 1 kHz."""
    levels = (0.0, 0.8, 0.0, -0.6, 0.3, -0.9, 0.5, 0.0, -0.2, 0.0)
    return np.repeat(levels, round(100 * duration))


def compare(duration: float, repeat: int) -> list[dict[str, Any]]:
    """Fit in all three ways; the fastest of `repeat` runs counts, loading left out, in processor time.

    Raises:
        SystemExit: they do not agree.
    """
    log = as_log(make_log(command(duration), hidden=[HIDDEN], seed=1))
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="fit_") as scratch:
        package = write_ssp(ssp_folder() / "full_order.ssd", Path(scratch, "full_order_open.ssp"), open=True)
        with Comparator(log, package) as comparator:
            free = read_free(comparator.system, FREE)
            options = Options(signals=("slew",), held_out=0.0, starts=1, coloured=False)
            for label, engine in (("compiled twin", "compiled"), ("FMUs, our runner", "fmu")):
                times = []
                for _ in range(repeat):
                    chosen = Options(**{**vars(options), "engine": engine})
                    began = time.process_time()
                    found = calibrate(comparator, free, chosen)
                    times.append(time.process_time() - began)
                values = {p.name: p.value for p in found.parameters}
                rows.append(
                    {"way": label, "seconds": min(times), "simulations": found.evaluations, "values": values}
                )
            angle = comparator.start_values()["mechanical.theta_0"]
        size = 10.0 * comparator.floors["slew"]
        start = Free("mechanical.theta_0", "rad", angle, -np.inf, np.inf, prior=(angle, size))
        hand = ByHand(package, Path(scratch, "unpacked"), log)
        times = []
        for _ in range(max(1, repeat - 2)):
            began = time.process_time()
            values, count = by_hand(hand.simulate, log, free, start)
            times.append(time.process_time() - began)
        hand.close()
        values.pop("mechanical.theta_0")
        rows.append(
            {"way": "scipy around fmpy", "seconds": min(times), "simulations": count, "values": values}
        )
    for row in rows:
        row["per_simulation"] = row["seconds"] / row["simulations"]
        row["ratio"] = row["seconds"] / rows[0]["seconds"]
        row["difference"] = max(abs(row["values"][n] / rows[0]["values"][n] - 1.0) for n in rows[0]["values"])
        if not row["difference"] < SAME_FIT:
            raise SystemExit(f"{row['way']} ends elsewhere: {row['values']} instead of {rows[0]['values']}")
    return rows


def coverage(count: int, kinds: Sequence[str], duration: float) -> list[dict[str, Any]]:
    """How often a 95 % interval holds the truth, for each kind of noise, over `count` logs with all of `TRUSTED` off."""
    names = [n for n in TRUSTED if not n.startswith("simplified")]
    rows = []
    for kind in kinds:
        noise = NOISES[kind]
        errors = []
        for seed in range(count):
            rng = np.random.default_rng(seed)
            truth = {n: nominal_value(n) * (1.0 + 0.05 * float(rng.uniform(-1.0, 1.0))) for n in names}
            log = as_log(make_log(command(duration), seed=seed, settings=truth, noise=noise))
            with Comparator(log, open_model("full_order")) as comparator:
                found = calibrate(
                    comparator, read_free(comparator.system, names), Options(starts=1, held_out=0.0)
                )
            errors.append([(p.value - truth[p.name]) / (p.deviation or np.nan) for p in found.parameters])
        z = np.array(errors)
        inside = (np.abs(z) < 1.959964).mean()
        rows.append(
            {"noise": kind, "logs": count, "inside": float(inside), "rms": float(np.sqrt(np.mean(z**2)))}
        )
    return rows


def main() -> int:
    """Run what is asked for."""
    from cosim.console import stdout_console, table

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--kinds", nargs="+", choices=list(NOISES), default=list(NOISES), help="of noise, for --coverage"
    )
    parser.add_argument("--duration", type=float, default=10.0, help="length of the log, s")
    parser.add_argument("--repeat", type=int, default=3, help="repetitions, of which the fastest counts")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    parser.add_argument("--coverage", type=int, default=0, help="logs of each kind of noise; then only this")
    options = parser.parse_args()
    if options.coverage:
        rows = coverage(options.coverage, options.kinds, options.duration)
        cells = [(r["noise"], r["logs"], r["inside"], r["rms"]) for r in rows]
        heads = ("noise", "logs", "truth inside", "error / deviation, rms")
    else:
        rows = compare(options.duration, options.repeat)
        cells = [
            (r["way"], r["simulations"], r["seconds"], r["per_simulation"], r["ratio"], r["difference"])
            for r in rows
        ]
        heads = ("way", "simulations", "s", "s a simulation", "ratio", "largest difference")
    stdout_console().print(
        table(
            "Fit of three parameters" if not options.coverage else "Coverage of 95 % intervals", heads, cells
        )
    )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
