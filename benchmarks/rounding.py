"""Whether rounding decides the answer: ``python benchmarks/rounding.py [--sample 10] [--shakes 2] [--rows FILE]``.

Cases of `real_logs.py` are diagnosed as they are and with every signal scaled by one plus or minus up to 5e-12, far below
any sensor's digit. Another processor, whose sums round otherwise, does the same. It prints the names each time and how far
apart the errors on data held out lie. The logs lie in the folder that COSIM_DATA names.
"""

import argparse
import json
import math
import sys
from collections import defaultdict
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.real_logs import DATA, Row, cases, run, stratified

SHAKEN = 5e-12
LIMIT = 600.0  # s a case


def shaken_cosim(seed: int, arguments: list[str]) -> None:
    """The command `cosim` with the signals of each log scaled, by a seed; 0 leaves them as they are."""
    from cosim.cli import main
    from cosim.diagnosis.pipeline import diagnose
    from cosim.diagnosis.record.record import Record

    prepared = diagnose.prepare

    def prepare(*given: object) -> Record:
        record, rng = prepared(*given), np.random.default_rng(seed)  # type: ignore[arg-type]
        scaled = {n: v * (1.0 + SHAKEN * rng.uniform(-1.0, 1.0)) for n, v in record.signals.items()}
        return replace(record, signals=scaled)

    if seed:
        diagnose.prepare = prepare
    sys.argv = ["cosim", *arguments]
    main()


def error_of(row: Row) -> float:
    """Error on data held out with what was found, in the row's unit."""
    return (row.after if row.after is not None else row.before) or math.nan


def summary(rows: list[tuple[int, Row]]) -> list[str]:
    """A line a case, and one of all: same names, and the largest error over the smallest."""
    each: dict[str, list[Row]] = defaultdict(list)
    for _, row in sorted(rows, key=lambda item: item[0]):
        each[row.name].append(row)
    lines, same, apart = [], 0, []
    for name, own in each.items():
        names = [" ".join(sorted(c.partition(".")[2] for c in r.causes)) or "none" for r in own]
        errors = [error_of(r) for r in own]
        same += len(set(names)) == 1
        apart.append(max(errors) / min(errors))
        told = names[0] if len(set(names)) == 1 else " | ".join(names)
        lines.append(f"{name[:60]:60} {' '.join(f'{e:.4g}' for e in errors)} {own[0].unit}  {told}")
    lines.append(
        f"{same} of {len(each)} with the same names each time; largest error over smallest: "
        f"{np.median(apart):.3f} in the median, {max(apart):.3f} at most"
    )
    return lines


def main() -> None:
    """Run what is asked for and not there yet, and print the summary."""
    if sys.argv[1:2] == ["--as-cosim"]:
        shaken_cosim(int(sys.argv[2]), sys.argv[3:])
        return
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sample", type=int, default=10, help="that many cases, spread over the axes")
    parser.add_argument(
        "--shakes", type=int, default=2, help="times that each is diagnosed with scaled signals"
    )
    parser.add_argument(
        "--rows", type=Path, default=Path("build/rounding.jsonl"), help="JSON lines, one a diagnosis"
    )
    asked = parser.parse_args()
    chosen = stratified(cases(True), asked.sample)
    if not chosen:
        sys.exit(f"no log of these machines below {DATA}: set COSIM_DATA to the folder that has them")
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    lines = asked.rows.read_text(encoding="utf-8").splitlines() if asked.rows.is_file() else []
    rows = [(seed, Row(**row)) for seed, row in map(json.loads, lines)]
    done = {(seed, row.name) for seed, row in rows}
    for case in chosen:
        for seed in range(asked.shakes + 1):
            if (seed, case.name) not in done:
                program = (sys.executable, str(Path(__file__).resolve()), "--as-cosim", str(seed))
                rows.append((seed, run(case, "", LIMIT, program)))
                with asked.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps((seed, asdict(rows[-1][1]))) + "\n")
    wanted = {case.name for case in chosen}
    print("\n".join(summary([item for item in rows if item[1].name in wanted])))


if __name__ == "__main__":
    main()
