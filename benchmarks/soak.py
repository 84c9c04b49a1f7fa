"""Whether memory and descriptors stay flat: ``python benchmarks/soak.py --diagnoses 200 --runs 1000 --hours 1 [--json]``.

Three things that a user does for long: the chain simulated piece by piece in one process, one diagnosis after the other in
one process, every fifth with its extended FMUs run and its report written, and a batch whose worker processes are killed
now and then. Of each the resident memory and the open descriptors are read again and again; growth is from the second third
on, when what is loaded once is loaded, and is also given as the slope of a straight line.
"""

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
import psutil

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import make_log
from cosim.rig.write import as_log

TOP = Path(__file__).resolve().parent.parent
PIECE = 300.0  # s of the chain simulated at once
LOG = 5.0  # s, of each log diagnosed
WHOLE = 5  # every so many diagnoses go the whole way, with FMUs and report
WORKERS = 2  # of the batch
CLOSING = 2  # readings from which the last runs are done
BETWEEN_KILLS = 10.0  # s: a new worker takes seconds to begin


def used(process: psutil.Process) -> tuple[float, int]:
    """Resident memory, MiB, and open descriptors of a process."""
    return process.memory_info().rss / 2**20, process.num_fds()


def watched(things: Iterable[Callable[[], object]]) -> list[tuple[float, int]]:
    """Memory and descriptors of this process after each of these, every tenth told on stderr."""
    process, found = psutil.Process(), []
    for thing in things:
        thing()
        gc.collect()
        found.append(used(process))
        tell(found)
    return found


def tell(readings: list[tuple[float, int]]) -> None:
    """Every tenth reading on stderr."""
    if len(readings) % 10 == 0:
        memory, descriptors = readings[-1]
        print(f"{len(readings)}: {memory:.0f} MiB, {descriptors} descriptors", file=sys.stderr, flush=True)


def told(seen: list[tuple[float, int]]) -> dict[str, Any]:
    """Growth from the second third of what was seen to its end."""
    rows = np.array(seen, dtype=float)
    half = rows[len(rows) // 3 :]
    return {
        "readings": len(rows),
        "MiB_first": float(half[0, 0]),
        "MiB_last": float(half[-1, 0]),
        "kB_each": 1024.0 * float(np.polyfit(np.arange(len(half)), half[:, 0], 1)[0]),
        "descriptors_first": int(half[0, 1]),
        "descriptors_last": int(half[-1, 1]),
    }


def chain(hours: float, systems: Path) -> dict[str, Any]:
    """So many hours of the full-order chain by the FMUs, in pieces, in this process."""
    import cosim

    def piece() -> None:
        cosim.simulate(systems / "full_order.ssp", stop_time=PIECE, record=["mechanical.theta"])

    return told(watched([piece] * max(3, round(3600.0 * hours / PIECE))))


def diagnoses(count: int) -> dict[str, Any]:
    """So many diagnoses of short logs, every third one clean, in this process."""
    import cosim

    hidden = ([], ["mechanical.coulomb_friction:tau_c=100"], ["continuity.leakage:c_l=0.3"])

    def one(k: int) -> Callable[[], object]:
        log = as_log(make_log("multisine", LOG, hidden[k % 3], seed=k))
        if k % WHOLE:
            return lambda: diagnose(log)

        def whole() -> None:
            with tempfile.TemporaryDirectory() as folder:
                cosim.diagnose(log, out=folder)

        return whole

    return told(watched(one(k) for k in range(count)))


def batch(runs: int, systems: Path, seed: int = 1) -> dict[str, Any]:
    """A batch whose workers are killed now and then: a run whose process died has failed, all others are done.

    Readings are those of the process that conducts it, while it has all its workers; table, cube and picture of all runs
    come after that, and what they take at most is told apart.
    """
    rng = np.random.default_rng(seed)
    killed, at_end, seen = 0, 0.0, []
    with tempfile.TemporaryDirectory() as scratch:
        words = ["batch", "--model", str(systems / "simplified.ssp"), "--engine", "fmu", "--stop-time", "5 s"]
        words += [
            "--vary",
            "simplified.a=2:4 1/s",
            "--samples",
            str(runs),
            "--workers",
            str(WORKERS),
            "--json",
        ]
        process = subprocess.Popen(
            [sys.executable, "-m", "cosim", *words, "--out", str(Path(scratch, "out"))],
            cwd=TOP,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": str(TOP)},
        )
        parent, at = psutil.Process(process.pid), time.monotonic()
        while process.poll() is None:
            time.sleep(0.5)
            try:
                reading = used(parent)
                helper = "multiprocessing.resource_tracker"  # its process outlives the workers
                below = [c for c in parent.children(recursive=True) if helper not in " ".join(c.cmdline())]
                # on Linux one process, from which the workers are forked, stands between; it is killed in its turn
                forked = [c for c in below if c.ppid() != parent.pid]
                if len(forked or below) == WORKERS:
                    seen.append(reading)
                    tell(seen)
                else:
                    at_end = max(at_end, reading[0])
                if below and time.monotonic() > at + BETWEEN_KILLS:
                    at = time.monotonic()
                    below[int(rng.integers(len(below)))].kill()
                    killed += 1
            except psutil.Error:  # it has just ended
                continue
        said = json.loads(process.stdout.read()) if process.stdout is not None else {}
    counts = {name: said.get(name) for name in ("runs", "done", "failed", "workers_replaced")}
    return (
        told(seen[:-CLOSING]) | {"MiB_at_end": at_end, "killed": killed, "code": process.returncode} | counts
    )


def main() -> int:
    """Run what is asked for and print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=1.0, help="of the chain, simulated")
    parser.add_argument("--diagnoses", type=int, default=200)
    parser.add_argument("--runs", type=int, default=1000, help="of the batch")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        built = [sys.executable, "-m", "cosim", "build", "--out", scratch]
        subprocess.run(built, cwd=TOP, check=True, capture_output=True)
        systems = Path(scratch, "ssp")
        if asked.hours:
            found["chain"] = chain(asked.hours, systems)
        if asked.diagnoses:
            found["diagnoses"] = diagnoses(asked.diagnoses)
        if asked.runs:
            found["batch"] = batch(asked.runs, systems)
    if asked.json:
        print(json.dumps(found))
        return 0
    for name, row in found.items():
        print(
            f"{name}: {row['MiB_first']:.0f} to {row['MiB_last']:.0f} MiB ({row['kB_each']:.0f} kB each), "
            f"{row['descriptors_first']} to {row['descriptors_last']} descriptors over {row['readings']} readings"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
