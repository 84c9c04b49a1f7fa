"""How often the diagnosis is right: ``python benchmarks/blind_suite.py --cases 100 --seed 7 [--no-fmus] [--json]``.

Draws cases (`benchmarks.blind.cases`), hides them in the virtual rig, diagnoses the logs in parallel, prints the scorecard.
Outcomes go to a JSON lines file, one case a line; a run that is started again goes on where it stopped. ``--cases 0``
only prints the scorecard of what the file holds.
"""

import argparse
import json
import sys
from collections.abc import Collection
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import islice
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console
from rich.table import Table

from benchmarks.blind.cases import KINDS, Case, cases
from benchmarks.blind.score import Metric, confusion, names, scorecard, true_names
from benchmarks.blind.sizes import GROUP_OF, RANGES, SIZES
from benchmarks.blind.trial import run_case


def read(file: Path) -> list[dict[str, Any]]:
    """The outcomes in a JSON lines file; a last line that was cut off is left out."""
    rows = []
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                continue
    return rows


def drawn(
    count: int,
    seed: int,
    duration: float,
    kinds: Collection[str] = (),
    sizes: Collection[str] = (),
    effects: Collection[str] = (),
) -> list[Case]:
    """The first `count` cases of a seed that are of these kinds and sizes and hide one of these effects; empty: of all."""
    asked = (
        c
        for c in cases(10**9, seed, duration)
        if (not kinds or c.kind in kinds)
        and (not sizes or c.size in sizes)
        and (not effects or not c.hidden.keys().isdisjoint(effects))
    )
    return list(islice(asked, count))


def run(
    file: Path,
    listed: list[Case],
    seed: int,
    workers: int,
    fmus: bool,
    console: Console,
    blocks: Collection[str] = (),
    without: Collection[str] = (),
) -> None:
    """Run the cases that `file` does not hold yet, and append each outcome as it comes."""
    done = {(r["seed"], r["case"]["number"]) for r in read(file)}
    todo = [c for c in listed if (seed, c.number) not in done]
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a", encoding="utf-8") as out, ProcessPoolExecutor(workers) as pool:
        pending = {pool.submit(run_case, case, fmus, blocks, without): case for case in todo}
        for finished, future in enumerate(as_completed(pending), 1):
            row = future.result() | {"seed": seed}
            out.write(json.dumps(row) + "\n")
            out.flush()
            case = pending[future]
            answer = "ERROR" if "error" in row else f"{row['verdict']} {names(row)}"
            console.print(
                f"{finished}/{len(todo)} {case.kind} {case.size} {list(case.hidden)} -> {answer}",
                highlight=False,
            )


def shown(metric: Metric) -> tuple[str, str, str, str]:
    """A line of the scorecard as words."""
    row = metric.plain()
    if row["value"] is None:
        return metric.name, metric.target, "no cases", "0"
    bounds = f" ({row['low']:.1%} .. {row['high']:.1%})" if "low" in row else ""
    value = f"{row['value']:.1%}{bounds}" if bounds else f"{row['value']:.3g}"
    return metric.name, metric.target, value, str(metric.count)


def show(rows: list[dict[str, Any]], console: Console) -> None:
    """Print scorecard, confusion matrix and the cases that went wrong."""
    table = Table("metric", "target", "measured (95 % Wilson)", "cases", title="Scorecard")
    for metric in scorecard(rows):
        table.add_row(*shown(metric))
    console.print(table)
    matrix = Table("hidden (left out of the library)", "answers", title="Confusion")
    for hidden, answers in confusion(rows).items():
        matrix.add_row(hidden, ", ".join(f"{count} x {said}" for said, count in answers.most_common()))
    console.print(matrix)


def main() -> int:
    """Run the suite and print its scorecard; 1 if a case failed with an error."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=100, help="number of cases")
    parser.add_argument("--seed", type=int, default=1, help="of the drawing")
    parser.add_argument(
        "--kinds", nargs="+", default=[], choices=list(KINDS), help="only cases of these kinds"
    )
    parser.add_argument("--sizes", nargs="+", default=[], choices=SIZES, help="only cases of these sizes")
    parser.add_argument(
        "--effects", nargs="+", default=[], choices=list(RANGES), help="only cases that hide one of these"
    )
    parser.add_argument(
        "--blocks", nargs="+", default=[], choices=sorted({*GROUP_OF.values()}),
        help="judge these blocks alone: a few seconds a case; without the FMUs"
    )  # fmt: skip
    parser.add_argument(
        "--without", nargs="+", default=[], choices=list(RANGES),
        help="effects that the diagnosis may not consider: what others are called without them"
    )  # fmt: skip
    parser.add_argument("--duration", type=float, default=60.0, help="of each log, s")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--no-fmus", action="store_true", help="do not run the extended model's FMUs")
    parser.add_argument(
        "--file", type=Path, default=Path("build/blind_suite.jsonl"), help="outcomes, JSON lines"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    options = parser.parse_args()
    console = Console(stderr=options.json, width=None if sys.stdout.isatty() else 160)
    listed = drawn(
        options.cases, options.seed, options.duration, options.kinds, options.sizes, options.effects
    )
    fmus = not options.no_fmus and not options.blocks
    run(options.file, listed, options.seed, options.workers, fmus, console, options.blocks, options.without)
    rows = read(options.file)
    if options.json:
        wrong = [
            {"hidden": true_names(r), "said": names(r)}
            for r in rows
            if "error" not in r and set(names(r)) != set(true_names(r))
        ]
        print(
            json.dumps(
                {
                    "scorecard": [m.plain() for m in scorecard(rows)],
                    "confusion": confusion(rows),
                    "wrong": wrong,
                },
                indent=1,
            )
        )
    else:
        show(rows, console)
    return 1 if any("error" in r for r in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
