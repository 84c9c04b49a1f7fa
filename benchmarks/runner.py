"""How fast and how exact the masters are: ``python benchmarks/runner.py [--repeat 3] [--json FILE] [--memory]``.

The full-order chain of real pythonfmu FMUs, 60 s at 1 ms, the same package in every engine: eight FMUs, since the command
is played by one and the sensor is another; "six blocks" is the chain from compensator to observer alone, the command as an
input. Each run is a process of its own, the repetitions are interleaved so that a busy moment of the machine meets all.
Errors are those of the slew angle against the exact solution of the same equations, at the time that the engine itself
puts beside each row.
"""

import argparse
import json
import math
import os
import platform
import statistics
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.engines import run_engine
from benchmarks.floor import emptied
from benchmarks.six import six_blocks
from cosim.paths import ssp_folder
from cosim.ssp.stimulus import default_command, stimulus_csv
from cosim.ssp.write import write_ssp

Array = NDArray[np.float64]
H = 1e-3
THETA = "mechanical.theta"
PACKAGES = ("pythonfmu", "fmpy", "ecospy", "libcosimpy", "fmu-manipulation-toolbox", "numba", "numpy")
# label: engine, the only core it may use
FLOOR = "floor: empty FMUs in our runner"
SIX = "cosim, six blocks"
SIX_FLOOR = "floor of the six"
WAYS: dict[str, tuple[str, int | None]] = {
    "cosim": ("cosim", None),
    FLOOR: ("cosim", None),
    SIX: ("cosim", None),
    SIX_FLOOR: ("cosim", None),
    "fmpy simulate_ssp": ("fmpy", None),
    "ecos": ("ecos_csv", None),
    "ecos, one core": ("ecos_csv", 0),
    "libcosim": ("libcosim", None),
}


@dataclass(frozen=True)
class Row:
    """Result of one way to run the package.

    Attributes:
        label: engine, and how it was run.
        seconds: median time of stepping; of the whole call for fmpy, which loads the FMUs in the same call.
        process_seconds: median time of the whole process, start and loading included.
        times_real_time: simulated time per `seconds`.
        ratio: `seconds` per those of our runner.
        error_deg: largest error of the slew angle, deg; NaN where nothing is computed.
    """

    label: str
    seconds: float
    process_seconds: float
    times_real_time: float
    ratio: float | None
    error_deg: float


def exact_theta(times: Array, command: Array) -> Array:
    """Slew angle of the nominal crane, rad, for a command held over each step: exact but for rounding.

    The static blocks are written out, valve, pressure and mechanics are one linear system, discretised for held inputs;
    valid while the spool keeps away from its stops, which is checked.
    """
    from scipy.signal import cont2discrete, dlsim

    d = np.where(command > 0.0, 0.45, 0.40)
    compensated = command + d * np.tanh(50.0 * command)
    demand = np.where(
        compensated >= 0.45, compensated - 0.45, np.where(compensated <= -0.40, compensated + 0.40, 0.0)
    )
    demand = np.clip(demand, -1.0, 1.0)
    k, w0, zeta, k_c, T = 2.375e-3, 25.23, 0.545, 5.28e8, 0.11
    # (4.34): 7.5e-6 deg per (bar mm3 s2), in SI
    inverse_inertia = math.radians(7.5e-6) / 1e-4
    gain = 8.4193e-3 * 0.1 * inverse_inertia
    a = np.zeros((5, 5))  # spool, speed, pressure, omega, theta
    a[0, 1], a[1, 0], a[1, 1] = 1.0, -w0 * w0, -2.0 * zeta * w0
    a[2, 0], a[2, 2] = k_c / T, -1.0 / T
    a[3, 2], a[3, 3] = gain, -34.9
    a[4, 3] = 1.0
    b = np.array([[0.0], [w0 * w0 * k], [0.0], [0.0], [0.0]])
    h = float(times[1] - times[0])
    system = cont2discrete((a, b, np.eye(5), np.zeros((5, 1))), h, "zoh")
    _, states, _ = dlsim(system, demand)
    assert np.max(np.abs(states[:, 0])) < 2.6e-3, (
        "the spool reaches a stop, where this solution does not hold"
    )
    theta: Array = states[:, 4]
    return theta


def one_run(label: str, package: Path, steps: int, exact: Array) -> tuple[float, float, float]:
    """Stepping time and process time of one run, s, and its largest error, deg."""
    engine, core = WAYS[label]
    began = time.perf_counter()
    found, seconds = run_engine(engine, package, steps=steps, h=H, signals=[THETA], timeout=600.0, core=core)
    whole = time.perf_counter() - began
    rows = np.rint(found["time"] / H).astype(int)
    error = math.nan if label in (FLOOR, SIX_FLOOR) else float(np.max(np.abs(found[THETA] - exact[rows])))
    return seconds, whole, math.degrees(error)


def compare(duration: float, repeat: int, labels: list[str]) -> list[Row]:
    """Run every way `repeat` times, interleaved, and take medians."""
    times, command = default_command(duration)
    steps = len(times) - 1
    exact = exact_theta(times, command)
    runs: dict[str, list[tuple[float, float, float]]] = {label: [] for label in labels}
    with tempfile.TemporaryDirectory(prefix="benchmark_") as scratch:
        package = Path(scratch, "full_order.ssp")
        write_ssp(ssp_folder() / "full_order.ssd", package, stimulus=stimulus_csv(times, command))
        six = six_blocks(Path(scratch), Path(scratch, "six.ssp"))
        packages = {
            FLOOR: emptied(package, Path(scratch, "empty.ssp")),
            SIX: six,
            SIX_FLOOR: emptied(six, Path(scratch, "empty_six.ssp")),
        }
        for turn in range(repeat):
            for label in labels:
                runs[label].append(one_run(label, packages.get(label, package), steps, exact))
                print(
                    f"  {turn + 1}/{repeat} {label}: {runs[label][-1][0]:.2f} s", file=sys.stderr, flush=True
                )
    medians = {
        label: [statistics.median(column) for column in zip(*found, strict=True)]
        for label, found in runs.items()
    }
    ours = medians.get("cosim", [math.nan])[0]
    return [
        Row(label, seconds, whole, duration / seconds, None if math.isnan(ours) else seconds / ours, error)
        for label, (seconds, whole, error) in medians.items()
    ]


def memory(runs: int, duration: float) -> dict[str, float]:
    """Resident memory of one process that runs our runner again and again, MiB: after the 10th run and after the last."""
    import psutil

    from cosim.master import Runner

    times, command = default_command(duration)
    resident = []
    with tempfile.TemporaryDirectory(prefix="benchmark_") as scratch:
        package = Path(scratch, "full_order.ssp")
        write_ssp(ssp_folder() / "full_order.ssd", package, stimulus=stimulus_csv(times, command))
        with Runner(package) as runner:
            for k in range(runs):
                runner.run(duration, H, parameters={"mechanical.J": 700.0 + k}, record=[THETA])
                resident.append(psutil.Process().memory_info().rss / 2**20)
    settled = min(10, runs) - 1
    return {"runs": runs, "settled_mib": resident[settled], "last_mib": resident[-1]}


def machine() -> dict[str, str]:
    """What the figures depend on."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [
            line.partition(":")[2].strip()
            for line in cpuinfo.read_text().splitlines()
            if "model name" in line
        ]
        model = names[0] if names else model
    found = {"processor": model, "cores": str(os.cpu_count()), "system": platform.platform()}
    found["python"] = platform.python_version()
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def show(rows: list[Row], duration: float) -> None:
    """Print the table."""
    from cosim.console import stdout_console, table

    headers = ("engine", "stepping s", "process s", "x real time", "ratio", "max error deg")
    cells = [
        (r.label, r.seconds, r.process_seconds, r.times_real_time, r.ratio or "", r.error_deg) for r in rows
    ]
    stdout_console().print(table(f"Full order, {duration:g} s at 1 ms", headers, cells))


def main() -> int:
    """Runs the comparison, and the memory check if asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=60.0, help="simulated time, s")
    parser.add_argument("--repeat", type=int, default=3, help="repetitions, of which the median counts")
    parser.add_argument("--only", nargs="+", choices=list(WAYS), default=list(WAYS), help="these ways only")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    parser.add_argument("--memory", action="store_true", help="also run our runner 100 times in one process")
    options = parser.parse_args()
    result: dict[str, object] = {"machine": machine(), "duration": options.duration, "repeat": options.repeat}
    rows = compare(options.duration, options.repeat, options.only)
    result["rows"] = [asdict(row) for row in rows]
    show(rows, options.duration)
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    if options.memory:
        found = memory(100, 5.0)
        result["memory"] = found
        print(
            f"memory after {found['runs']} runs: {found['last_mib']:.1f} MiB, settled {found['settled_mib']:.1f} MiB"
        )
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
