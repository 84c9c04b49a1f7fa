"""Logs of a simulator of its own, diagnosed from end to end: ``python benchmarks/second_rig.py --seeds 0 40``.

Draws none, one or two effects in the library's form or another one (`benchmarks.second.cases`), simulates the drive
with another integrator, writes the CSV, runs ``cosim diagnose`` on it and holds answer and intervals against the truth.
With ``--strangers`` each log hides a cause that the library lacks (`benchmarks.second.out_of_library`).
Outcomes go to a JSON lines file; a run that is started again goes on where it stopped.
"""

import argparse
import json
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console

from benchmarks.blind_suite import read
from benchmarks.second.cases import Case, draw
from benchmarks.second.out_of_library import draw_out_of_library
from benchmarks.second.trial import run_case

FAR_OFF = 3.0  # half-widths from which an interval is shown as wrong


def form(settings: dict[str, float]) -> str:
    """What makes another form of a law, as text."""
    return f" [{', '.join(f'{n} {v:.3g}' for n, v in settings.items())}]" if settings else ""


def line(row: dict[str, Any]) -> str:
    """A case as a line of text."""
    case = row["case"]
    sensing = case["sensing"]
    told = ", ".join(
        f"{n}{form(case['forms'][n])} ({row['shown'].get(n, 0.0):.2g} sd)" for n in case["hidden"]
    )
    said = "; ".join(
        f"{c['effect']}{' or ' + ', '.join(c['alike']) if c['alike'] else ''}" for c in row.get("causes", ())
    )
    wrong = {n: round(v[2], 1) for n, v in row.get("off", {}).items() if abs(v[2]) > FAR_OFF}
    signals = "+".join(sensing["columns"]) + (" tracker" if sensing.get("frames") else "")
    return (
        f"{case['seed']} {row.get('judged', 'ERROR')}: {told or 'clean'} -> {said or row.get('verdict', row.get('error'))}"
        f"{' | ' + '; '.join(row['unexplained']) if row.get('unexplained') else ''}{f' | off {wrong}' if wrong else ''}"
        f" [{case['command']} {sensing['rate']} Hz {signals}]"
    )


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts of the answers, and of the intervals that hold the truth."""
    inside = [abs(v[2]) <= 1.0 for r in rows for v in r.get("off", {}).values()]
    return {
        "logs": len(rows),
        "judged": dict(Counter(r.get("judged", "error") for r in rows).most_common()),
        "intervals": len(inside),
        "hold the truth": sum(inside),
    }


def main() -> int:
    """Run the seeds; 1 if a diagnosis ended in an error."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seeds", type=int, nargs=2, default=(0, 20), metavar=("FIRST", "END"), help="half-open range"
    )
    parser.add_argument("--strangers", action="store_true", help="hide causes that the library lacks")
    parser.add_argument("--workers", type=int, default=2, help="diagnoses at a time")
    parser.add_argument("--keep", type=Path, help="folder in which logs and answers stay")
    parser.add_argument(
        "--file", type=Path, default=Path("build/second_rig.jsonl"), help="outcomes, JSON lines"
    )
    options = parser.parse_args()
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    done = {row["case"]["seed"] for row in read(options.file)}
    drawn = draw_out_of_library if options.strangers else draw
    todo: list[Case] = [drawn(seed) for seed in range(*options.seeds) if seed not in done]
    options.file.parent.mkdir(parents=True, exist_ok=True)
    with options.file.open("a", encoding="utf-8") as out, ThreadPoolExecutor(options.workers) as pool:
        for future in as_completed([pool.submit(run_case, case, options.keep) for case in todo]):
            row = future.result()
            out.write(json.dumps(row) + "\n")
            out.flush()
            console.print(line(row))
    rows = read(options.file)
    print(json.dumps(summary(rows), indent=1))
    return 1 if any("error" in r for r in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
