"""What a batch costs: ``python benchmarks/batch.py [--repeat 3] [--json FILE] [--growth]``.

The same sweep of the inertia through `cosim batch` (FMUs and compiled twin) and through FMPy with Dask, on two processes:
the mechanics alone, and the full-order chain. Each sweep is a command of its own, repetitions are interleaved; times are
those of the whole command, the start of Python and of the processes included. ``--growth`` adds time and memory against
the number of runs.
"""

import argparse
import contextlib
import ctypes
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.batch_peers import HIGH, LOW, PRESSURE, WORKERS
from benchmarks.runner import machine

TOP = Path(__file__).resolve().parent.parent
AGREE = 1e-6  # rad, relative: what the ways may differ by in the final angle of the mechanics alone


@dataclass(frozen=True)
class Row:
    """One way to do a sweep.

    Attributes:
        what: which model.
        way: who does it.
        runs: how many.
        seconds: median duration of the whole command.
        cpu_seconds: median time its processes computed, which other work on the machine disturbs less.
        ratio: `cpu_seconds` per those of cosim batch with FMUs, for the same model.
    """

    what: str
    way: str
    runs: int
    seconds: float
    cpu_seconds: float
    ratio: float


def call(command: list[str]) -> tuple[float, float, dict[str, object]]:
    """Duration [s], time computed [s] and JSON of a command.

    Raises:
        RuntimeError: it failed.
    """
    adopt()
    began, before = time.perf_counter(), computed()
    done = subprocess.run([sys.executable, *command], cwd=TOP, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began
    if sys.platform == "linux":
        with contextlib.suppress(ChildProcessError):  # until none is left
            while True:
                os.wait()
    busy = computed() - before
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr[-2000:]}")
    found: dict[str, object] = json.loads(
        done.stdout.splitlines()[-1] if done.stdout[0] != "{" else done.stdout
    )
    return seconds, busy, found


def adopt() -> None:
    """From now on what a command leaves behind becomes a child of this process, which can then count its time.

    The process that forks those of `cosim batch` ends by itself a moment after the command, and did not count before.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER of linux/prctl.h


def computed() -> float:
    """Time that ended children of this process have computed, s; 0 where the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def ours(model: Path, runs: int, stop: float, engine: str, folder: Path, extra: list[str]) -> list[str]:
    """The command line of a sweep by `cosim batch`."""
    words = ["-m", "cosim", "batch", "--model", str(model), "--engine", engine, "--workers", str(WORKERS)]
    words += ["--sweep", f"mechanical.J={LOW}:{HIGH}:{runs} kg.m2", "--stop-time", f"{stop} s"]
    return [*words, "--record", "mechanical.theta", "--out", str(folder), "--fresh", "--json", *extra]


def sweeps(scratch: Path, runs: int, stop: float) -> dict[tuple[str, str], Callable[[], list[str]]]:
    """(model, way) -> what to call; the packages are built here."""
    from cosim.paths import ssp_folder
    from cosim.ssp.stimulus import default_command, stimulus_csv
    from cosim.ssp.write import write_ssp
    from fmus.build import build_fmu, composed_block

    fmu = build_fmu(composed_block("mechanical"), scratch / "mechanical.fmu")
    times, command = default_command(stop)
    package = scratch / "full_order.ssp"
    write_ssp(ssp_folder() / "full_order.ssd", package, stimulus=stimulus_csv(times, command))
    alone = ["--set", f"p_load={PRESSURE} Pa"]
    peer = ["-m", "benchmarks.batch_peers"]
    numbers = [str(runs), str(stop)]
    return {
        ("mechanics", "cosim batch, FMU"): lambda: ours(fmu, runs, stop, "fmu", scratch / "a", alone),
        ("mechanics", "cosim batch, compiled"): lambda: ours(
            fmu, runs, stop, "compiled", scratch / "b", alone
        ),
        ("mechanics", "FMPy's example, Dask"): lambda: [*peer, "loop", str(fmu), *numbers],
        ("mechanics", "fmpy simulate_fmu, Dask"): lambda: [*peer, "simulate_fmu", str(fmu), *numbers],
        ("chain", "cosim batch, FMU"): lambda: ours(package, runs, stop, "fmu", scratch / "c", []),
        ("chain", "cosim batch, compiled"): lambda: ours(package, runs, stop, "compiled", scratch / "d", []),
        ("chain", "fmpy simulate_ssp, Dask"): lambda: [*peer, "simulate_ssp", str(package), *numbers],
    }


def final_values(found: dict[str, object], folder: Path) -> np.ndarray:
    """The final angle of every run, rad: printed by the peers, in the cube of ours."""
    if "final" in found:
        return np.array(found["final"], dtype=float)
    import xarray as xr

    return np.asarray(xr.open_zarr(folder / "signals.zarr", chunks=None)["mechanical.theta"].values[:, -1])


def compare(runs: int, stop: float, repeat: int, scratch: Path) -> list[Row]:
    """Every way `repeat` times, interleaved; the mechanics' final angles must agree.

    Raises:
        RuntimeError: a way failed, or its results differ.
    """
    ways = sweeps(scratch, runs, stop)
    taken: dict[tuple[str, str], list[tuple[float, float]]] = {key: [] for key in ways}
    finals: dict[str, np.ndarray] = {}
    for turn in range(repeat):
        for (what, way), command in ways.items():
            words = command()
            seconds, busy, found = call(words)
            taken[what, way].append((seconds, busy))
            said = f"{what}, {way}: {seconds:.1f} s, {busy:.1f} s computed"
            print(f"  {turn + 1}/{repeat} {said}", file=sys.stderr, flush=True)
            if what == "mechanics":
                folder = Path(words[words.index("--out") + 1]) if "--out" in words else Path()
                values = final_values(found, folder)
                reference = finals.setdefault(what, values)
                if np.max(np.abs(values - reference)) > AGREE * np.max(np.abs(reference)):
                    raise RuntimeError(f"{way} gives other angles than the first way")
    medians = {
        key: [statistics.median(column) for column in zip(*values, strict=True)]
        for key, values in taken.items()
    }
    rows = []
    for (what, way), (seconds, busy) in medians.items():
        own = medians[what, "cosim batch, FMU"]
        ratio = busy / own[1] if own[1] else seconds / own[0]
        rows.append(Row(what, way, runs, seconds, busy, ratio))
    return rows


def growth(engine: str, counts: list[int], stop: float, scratch: Path) -> list[dict[str, float]]:
    """Time and memory of batches of several sizes, and how straight the line through the times is."""
    from cosim.paths import ssp_folder
    from cosim.ssp.stimulus import default_command, stimulus_csv
    from cosim.ssp.write import write_ssp

    times, command = default_command(stop)
    package = scratch / f"growth_{engine}.ssp"
    write_ssp(ssp_folder() / "full_order.ssd", package, stimulus=stimulus_csv(times, command))
    rows = []
    for count in counts:
        folder = scratch / f"{engine}_{count}"
        _, _, found = call(ours(package, count, stop, engine, folder, []))
        lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
        resident = max(line["resident"] for line in lines) / 2**20
        seconds = float(found["seconds"])  # type: ignore[arg-type]
        rows.append({"runs": count, "seconds": seconds, "largest_worker_mib": resident})
        print(f"  {engine}, {count} runs: {seconds:.1f} s, {resident:.0f} MiB", file=sys.stderr, flush=True)
    return rows


def straightness(rows: list[dict[str, float]]) -> tuple[float, float, float]:
    """(seconds to begin, seconds a run, R2) of the straight line through the times."""
    x, y = (np.array([row[key] for row in rows]) for key in ("runs", "seconds"))
    slope, first = np.polyfit(x, y, 1)
    rest = y - (first + slope * x)
    return float(first), float(slope), float(1.0 - np.sum(rest**2) / np.sum((y - y.mean()) ** 2))


def main() -> int:
    """Runs the comparison, and the growth if asked for."""
    from cosim.console import stdout_console, table

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=40, help="values of the inertia")
    parser.add_argument("--stop", type=float, default=5.0, help="simulated time of a run, s")
    parser.add_argument("--repeat", type=int, default=3, help="repetitions, of which the median counts")
    parser.add_argument(
        "--growth", action="store_true", help="time and memory against the number of runs too"
    )
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    options = parser.parse_args()
    result: dict[str, object] = {"machine": machine(), "runs": options.runs, "stop": options.stop}
    with tempfile.TemporaryDirectory(prefix="benchmark_") as name:
        rows = compare(options.runs, options.stop, options.repeat, Path(name))
        result["rows"] = [asdict(row) for row in rows]
        cells = [(row.what, row.way, row.seconds, row.cpu_seconds, row.ratio) for row in rows]
        title = f"{options.runs} runs of {options.stop:g} s at 1 ms, {WORKERS} processes"
        stdout_console().print(table(title, ("model", "way", "seconds", "CPU s", "ratio of CPU s"), cells))
        for engine, counts in (("fmu", [20, 40, 80, 160]), ("compiled", [250, 500, 1000, 2000])):
            if options.growth:
                found = growth(engine, counts, options.stop, Path(name))
                begin, each, straight = straightness(found)
                result[f"growth_{engine}"] = found
                memory = ", ".join(f"{row['largest_worker_mib']:.0f}" for row in found)
                text = (
                    f"{engine}: {begin:.1f} s + {1e3 * each:.1f} ms a run (R2 {straight:.4f}); MiB {memory}"
                )
                print(f"{text} at {counts} runs")
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
