"""Do intervals between logs hold? ``python benchmarks/between_logs.py [--axes boom swing] [--rows FILE]``.

Each of the five logs of an axis of the small excavator (folder in COSIM_DATA) is held out in turn. The four others are
diagnosed together, and the one held out by itself. Of the sizes that both answers tell, it is counted how often what the log
held out says lies where the others say that the next log lies (`next_log_ci95`), within its own interval, too.
"""

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console
from rich.table import Table

from benchmarks.each_alone import cosim
from benchmarks.real_logs import AXES, DATA, MAPPINGS, sizes_of

Size = tuple[
    float, tuple[float, float], tuple[float, float]
]  # value, its 95 % interval, that of the next log's


@dataclass
class HeldOut:
    """What the logs of an axis say of another one.

    Attributes:
        axis, log: which was held out.
        together, alone: effect -> parameter -> size, by the others and by this log.
    """

    axis: str
    log: str
    together: dict[str, dict[str, Size]] = field(default_factory=dict)
    alone: dict[str, dict[str, Size]] = field(default_factory=dict)


def told(axis: str, logs: Iterable[Path]) -> dict[str, dict[str, Size]]:
    """The causes that some logs of an axis have in common, with their sizes."""
    mapping = str(MAPPINGS / f"mini_excavator_{axis}.toml")
    with tempfile.TemporaryDirectory() as folder:
        answer = cosim("diagnose", *map(str, logs), "--mapping", mapping, "--calibrate", "--out", folder)
    return {
        cause["effect"]: {
            name: (size["value"], tuple(size["ci95"]), tuple(size["next_log_ci95"] or size["ci95"]))
            for name, size in sizes_of(cause).items()
            if size["ci95"]
        }
        for cause in answer["causes"]
    }


def compared(row: HeldOut) -> list[tuple[str, Size, Size, bool]]:
    """Effect and parameter, what the others say, what the log says, and whether that agrees, of each size that both tell."""
    found = []
    for effect in row.together.keys() & row.alone.keys():
        for name in row.together[effect].keys() & row.alone[effect].keys():
            others, own = row.together[effect][name], row.alone[effect][name]
            reach = math.hypot(0.5 * (others[2][1] - others[2][0]), 0.5 * (own[1][1] - own[1][0]))
            found.append((f"{effect} {name}", others, own, abs(own[0] - others[0]) <= reach))
    return sorted(found, key=lambda item: item[0])


def summary(rows: Sequence[HeldOut]) -> list[str]:
    """How often the intervals hold, a sentence an axis and one for all."""
    lines = []
    for axis in [*dict.fromkeys(r.axis for r in rows), ""]:
        agree = [same for r in rows if axis in ("", r.axis) for *_, same in compared(r)]
        lines.append(
            f"{axis or 'all'}: {sum(agree)} of {len(agree)} sizes of a log held out lie where the others say"
        )
    return lines


def main() -> None:
    """Hold each log out in turn, and print each size and how often the intervals hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--axes", nargs="+", default=list(AXES), choices=list(AXES))
    parser.add_argument("--rows", type=Path, help="file to which each row is added as a line of JSON")
    options = parser.parse_args()
    logs = sorted((DATA / "mini_excavator").glob("*.csv"))
    if not logs:
        sys.exit("no logs of the small excavator: say in COSIM_DATA where the folder mini_excavator is")
    rows = []
    table = Table(
        "axis", "held out", "size", "from the others, 95 % of the next log", "its own, 95 %", "holds"
    )
    for axis in options.axes:
        for log in logs:
            row = HeldOut(
                axis, log.stem, told(axis, [other for other in logs if other != log]), told(axis, [log])
            )
            rows.append(row)
            for name, others, own, same in compared(row):
                first, second = (
                    f"{value:.4g} ({low:.4g} to {high:.4g})"
                    for value, (low, high) in ((others[0], others[2]), own[:2])
                )
                table.add_row(axis, log.stem, name, first, second, "yes" if same else "no")
            if options.rows is not None:
                with options.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(row)) + "\n")
    Console(width=160).print(table)
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
