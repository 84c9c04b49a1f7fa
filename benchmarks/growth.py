"""How time and memory of compare and diagnose grow: with the length of the log, the candidates, the blocks.

    python benchmarks/growth.py [--lengths 30,60,600] [--candidates 5,15,29] [--blocks] [--json]

Each point is a process of its own on a synthetic log, so that its peak memory is its own. Time counts from the loaded
program to the written result; what the program needs before that is the first line. CPU seconds tell more than wall
seconds where other work runs beside it.
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HIDDEN = ("mechanical.coulomb_friction:tau_c=120 N.m", "continuity.leakage:c_l=0.15")
LENGTHS = (10.0, 30.0, 60.0, 300.0, 600.0, 1800.0, 10800.0)
SHORTEST = 30.0  # s, of a diagnosis
CANDIDATES = (3, 8, 15, 22, 29)
# signals of the log, and the blocks that they let judge
BLOCKS = {
    ("u", "spool"): 3,
    ("u", "spool", "p_a", "p_b", "p_supply"): 4,
    ("u", "spool", "p_a", "p_b", "p_supply", "slew"): 6,
}


def make(folder: Path, duration: float) -> Path:
    """A synthetic log of that length, s, made once in `folder`."""
    from cosim.rig import make_log, write

    path = folder / f"log_{duration:g}.parquet"
    if not path.exists():
        run = make_log("mixed" if duration >= 21.0 else "steps", duration, HIDDEN, seed=3, observer=True)
        write(run, path)
    return path


def compare(log: Path) -> None:
    """What ``cosim compare LOG --out FOLDER`` does."""
    from cosim.beside.run import beside

    with tempfile.TemporaryDirectory() as out:
        beside(log, out=Path(out))


def diagnose(log: Path, signals: Sequence[str], without: Sequence[str]) -> None:
    """What ``cosim diagnose LOG`` does, with some signals or candidates only."""
    from cosim.diagnosis.model.groups import left_out
    from cosim.logs import load_log
    from cosim.report.deliver import diagnose_into

    with tempfile.TemporaryDirectory() as out, left_out(*without):
        loaded = load_log(log, select=signals or None)
        diagnose_into(Path(out), loaded, None, "full_order", 0.01, calibrate=False)


def child(request: dict[str, Any]) -> None:
    """One point, in a process of its own: prints its figures."""
    import cosim.compare
    import cosim.report.deliver  # noqa: F401

    wall, cpu = time.perf_counter(), time.process_time()
    if request["what"] == "make":
        make(Path(request["log"]).parent, request["duration"])
    elif request["what"] == "compare":
        compare(Path(request["log"]))
    elif request["what"] == "diagnose":
        diagnose(Path(request["log"]), request.get("signals", ()), request.get("without", ()))
    used, below = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    figures = {
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu + below.ru_utime + below.ru_stime,
        "peak_MiB": used.ru_maxrss / 1024.0,
    }
    print(json.dumps(figures))


def measured(what: str, **more: Any) -> dict[str, float]:
    """Figures of one point."""
    done = subprocess.run(
        [sys.executable, __file__, "--child", json.dumps({"what": what, **more})],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(f"{what} {more}: {done.stderr[-2000:]}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


def slope(rows: list[dict[str, Any]], of: str, column: str) -> str:
    """How a column grows with `of`: exponent between the last two points."""
    if len(rows) < 2:
        return "-"
    a, b = rows[-2], rows[-1]
    rise = math.log(max(b[column], 1e-9) / max(a[column], 1e-9)) / math.log(b[of] / a[of])
    return f"{rise:.2f}"


def table(title: str, of: str, rows: list[dict[str, Any]]) -> None:
    """Print one series of points."""
    print(f"\n{title}\n{of:>12} {'wall [s]':>10} {'CPU [s]':>10} {'peak [MiB]':>11}")
    for row in rows:
        print(f"{row[of]:12g} {row['wall_s']:10.2f} {row['cpu_s']:10.2f} {row['peak_MiB']:11.0f}")
    print(
        f"last exponent: CPU {slope(rows, of, 'cpu_s')}, memory {slope(rows, of, 'peak_MiB')} (1: a straight line)"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lengths", default=",".join(f"{x:g}" for x in LENGTHS), help="s")
    parser.add_argument("--candidates", default=",".join(map(str, CANDIDATES)), help="empty: left out")
    parser.add_argument("--blocks", action="store_true", help="also against the number of blocks")
    parser.add_argument("--folder", type=Path, help="keeps the logs [default: a temporary one]")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(json.loads(options.child))
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        results = measure(folder, options)
    if options.json:
        print(json.dumps(results, indent=2))
        return
    print(f"the program alone: {results['program']['peak_MiB']:.0f} MiB")
    for title, of in (
        ("compare", "seconds"),
        ("diagnose", "seconds"),
        ("candidates", "candidates"),
        ("blocks", "blocks"),
    ):
        if results.get(title):
            table(
                f"{title} of 60 s" if of != "seconds" else f"{title}, 1000 rows a second", of, results[title]
            )


def measure(folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """All points."""
    found: dict[str, Any] = {"program": measured("nothing"), "compare": [], "diagnose": []}
    for seconds in [float(x) for x in options.lengths.split(",") if x]:
        log = str(folder / f"log_{seconds:g}.parquet")
        measured("make", log=log, duration=seconds)
        found["compare"].append({"seconds": seconds} | measured("compare", log=log))
        if seconds >= SHORTEST:
            found["diagnose"].append({"seconds": seconds} | measured("diagnose", log=log))
    log = str(make(folder, 60.0))
    from fmus import registry

    names = [n for n in registry.effects() if not n.startswith("tracker.")]
    counts = [int(x) for x in options.candidates.split(",") if x]
    # those that are hidden in the log stay, the others leave from the end
    hidden = [text.partition(":")[0] for text in HIDDEN]
    order = hidden + [n for n in names if n not in hidden]
    found["candidates"] = [
        {"candidates": min(k, len(order))} | measured("diagnose", log=log, without=order[k:]) for k in counts
    ]
    if options.blocks:
        found["blocks"] = [
            {"blocks": count} | measured("diagnose", log=log, signals=signals)
            for signals, count in BLOCKS.items()
        ]
    return found


if __name__ == "__main__":
    main()
