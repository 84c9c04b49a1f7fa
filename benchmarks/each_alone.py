"""What one log says of a machine: ``python benchmarks/each_alone.py [--axes boom swing] [--rows FILE]``.

Each log of the small excavator (folder in COSIM_DATA) is diagnosed by itself, with nothing held out, and the extended model
is compared with the four other logs of the same axis, which had no share in it. Counted is, over pairs of logs of one axis,
how often the same causes are named, what share of the causes two logs have in common (Jaccard), and how often a size of
both agrees within their intervals.
"""

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console
from rich.table import Table

from benchmarks.real_logs import AXES, DATA, MAPPINGS, TOP, pairs, sizes_of

Size = tuple[float, tuple[float, float]]  # value and 95 % interval, in the answer's unit


@dataclass
class Alone:
    """What one log says.

    Attributes:
        axis, log: what was diagnosed.
        causes: effect -> parameter -> value and 95 % interval.
        others: RMSE of the extended model on each other log, in the signal's unit.
        cpu: processor time of the diagnosis, s.
    """

    axis: str
    log: str
    causes: dict[str, dict[str, Size]] = field(default_factory=dict)
    others: list[float] = field(default_factory=list)
    cpu: float = 0.0


def cosim(*arguments: str) -> dict[str, Any]:
    """The JSON that a command prints.

    Raises:
        RuntimeError: it ended with an error.
    """
    done = subprocess.run(
        [sys.executable, "-c", "from cosim.cli import main; main()", *arguments, "--json"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(TOP)},
    )
    if done.returncode:
        raise RuntimeError(f"cosim {' '.join(arguments)}: {done.stderr or done.stdout}")
    return dict(json.loads(done.stdout))


def diagnosed(axis: str, log: Path, others: Iterable[Path]) -> Alone:
    """One log diagnosed by itself, and its model held against the others."""
    row, mapping = Alone(axis, log.stem), str(MAPPINGS / f"mini_excavator_{axis}.toml")
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        answer = cosim("diagnose", str(log), "--mapping", mapping, "--calibrate", "--out", folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        row.cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        for cause in answer["causes"]:
            sizes = {n: (p["value"], tuple(p["ci95"])) for n, p in sizes_of(cause).items() if p["ci95"]}
            row.causes[cause["effect"]] = sizes
        for other in others:
            told = cosim("compare", str(other), "--mapping", mapping, "--model", f"{folder}/extended.ssp")
            row.others.append(next(iter(told["signals"].values()))["rmse"])
    return row


def in_common(one: Alone, other: Alone) -> float:
    """Share of the causes of two logs that both name."""
    return len({*one.causes} & {*other.causes}) / len({*one.causes} | {*other.causes})


def agreeing(one: Alone, other: Alone) -> tuple[int, int]:
    """Sizes that two logs tell alike, within both intervals together, and all that both tell."""
    both = [
        (one.causes[e][p], other.causes[e][p])
        for e in {*one.causes} & {*other.causes}
        for p in {*one.causes[e]} & {*other.causes[e]}
    ]
    near = [abs(a - b) <= math.hypot(0.5 * (i[1] - i[0]), 0.5 * (k[1] - k[0])) for (a, i), (b, k) in both]
    return sum(near), len(near)


def summary(rows: Sequence[Alone]) -> list[str]:
    """What the rows come to, a sentence each."""
    found = pairs(rows)
    same = sum({*a.causes} == {*b.causes} for a, b in found)
    sizes = [agreeing(a, b) for a, b in found]
    errors = [math.log(e) for row in rows for e in row.others if e > 0.0]
    return [
        f"the same causes in {same} of {len(found)} pairs of logs",
        f"causes in common: {sum(in_common(a, b) for a, b in found) / max(len(found), 1):.2f}",
        f"sizes that agree within both intervals: {sum(n for n, _ in sizes)} of {sum(n for _, n in sizes)}",
        f"error on other logs, geometric mean: {math.exp(sum(errors) / max(len(errors), 1)):.3g}",
        f"processor time: {sum(r.cpu for r in rows) / max(len(rows), 1):.0f} s on average",
    ]


def main() -> None:
    """Diagnose each, and print a row for each and what they come to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--axes", nargs="+", default=list(AXES), choices=list(AXES))
    parser.add_argument("--rows", type=Path, help="file to which each row is added as a line of JSON")
    options = parser.parse_args()
    logs = sorted((DATA / "mini_excavator").glob("*.csv"))
    if not logs:
        sys.exit("no logs of the small excavator: say in COSIM_DATA where the folder mini_excavator is")
    rows = []
    table = Table("axis", "log", "named", "error on each other log", "s")
    for axis in options.axes:
        for log in logs:
            row = diagnosed(axis, log, [other for other in logs if other != log])
            rows.append(row)
            named = ", ".join(sorted(e.partition(".")[2] for e in row.causes))
            table.add_row(axis, log.stem, named, ", ".join(f"{e:.3g}" for e in row.others), f"{row.cpu:.0f}")
            if options.rows is not None:
                with options.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(row)) + "\n")
    Console(width=160).print(table)
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
