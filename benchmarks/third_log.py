"""Are causes borne out by a third log? ``python benchmarks/third_log.py [--cases 60] [--rows FILE]``.

A case of `benchmarks/real_logs.py` fits one log of a machine, or several, and holds out another, which decides what is
named. Here each cause that the fitted logs ask for is judged again on further logs of the same axis, which had no share in
either: what do they lose without it? Each set of causes is simulated as it was estimated from the fitted logs.

Printed are the share of named causes that a third log bears out; that of all asked for, which is `ASKED_FOR` of
`cosim/inference/thresholds.py`; and that of those asked for, by how sure the held-out log is of them.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console
from rich.table import Table
from scipy.stats import beta

from benchmarks import real_logs
from benchmarks.real_logs import MAPPINGS, Case, cases, excavator_logs, stratified
from cosim.diagnosis.held_out.causes import Held, Step, Steps, compared, errs, held_logs
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.pipeline import diagnose as pipeline
from cosim.diagnosis.residuals.finding import Finding
from cosim.inference.thresholds import MOST_BLOCKS
from cosim.logs import load_log

MOST = 4  # further logs of a case
# edges of classes by the gain over the distance to the lower end of its 95 % interval
SURE = (-math.inf, 0.0, 0.5, 1.0, math.inf)


@dataclass(frozen=True)
class Asked:
    """A cause that the fitted logs ask for, beside the others that are named.

    Attributes:
        case, group, effect: what it is.
        named: the held-out log bears it out.
        sized: the fitted logs determine its size.
        gain, low: logarithm of the ratio of the errors without and with it on the held-out log, and the lower end of its
            95 % interval.
        third: the same logarithm on the further logs.
    """

    case: str
    group: str
    effect: str
    named: bool
    sized: bool
    gain: float
    low: float
    third: float

    @property
    def sure(self) -> float:
        """Gain on the held-out log over the distance to the lower end of its interval: 1 where that is at none."""
        return self.gain / max(self.gain - self.low, 1e-12)


def further_logs(case: Case) -> list[str]:
    """Logs of the same axis, of the same directions, that a case neither fits nor holds out."""
    used = {*case.fit, *case.held}
    if case.machine == "mini excavator":
        found = [f"mini_excavator/{f.name}" for f in (real_logs.DATA / "mini_excavator").glob("*.csv")]
    elif case.machine == "excavator":
        axis = Path(case.fit[0]).stem.split("-")[0]
        ways = {Path(f).stem.split("-")[1] for f in case.fit}
        found = [
            f
            for (own, way, *_), logs in excavator_logs().items()
            if own == axis and way in ways
            for f in logs.values()
        ]
    else:
        found = []
    return sorted(f for f in found if f not in used)[:MOST]


def on(held: Held, finding: Finding, step: Step, signal: str) -> Step:
    """A set of causes, as it was estimated, on other data."""
    squares, course = errs(finding, step.fit, held, signal)
    return Step(step.effects, step.fit, step.fitted, 0.0, step.unsure, squares, course is not None, course)


def a_part(step: Step, other: Step) -> tuple[float, float]:
    """Gain of a set of causes over another in each part of the data, and the lower end of its 95 % interval."""
    gain, parts = step.gain_over(other), min(step.squares.size, MOST_BLOCKS)
    return gain.gain / parts, gain.ci95[0] / parts


def asked_for(case: Case, mappings: Path = MAPPINGS) -> Iterator[Asked]:
    """Diagnose a case and judge on its further logs what the fitted ones ask for."""
    mapping = mappings / case.mapping
    fit, held, further = (
        [load_log(real_logs.DATA / f, mapping) for f in files]
        for files in (case.fit, case.held, further_logs(case))
    )
    machine = machine_of(None, fit, mapping)
    third = held_logs([pipeline.prepare(log, machine) for log in further], further)
    seen: list[tuple[Group, Finding, tuple[str, ...], Steps]] = []
    inner = pipeline.borne_out

    def watched(found: Any, group: Group, finding: Finding, held: Held, *rest: Any) -> Finding:
        out = inner(found, group, finding, held, *rest)
        if compared(finding.task, held):
            seen.append((group, finding, tuple(e.name for e in out.chosen.effects), dict(rest[-1])))
        return out

    with patch.object(pipeline, "borne_out", watched):
        pipeline.diagnose(fit, model=machine, held_out=held, calibrate=True)
    for group, finding, named, done in seen:
        signal = compared(finding.task, third)
        sets = {frozenset(e.name for e in step.effects): step for step in done.values()}
        for effect in finding.chosen.effects if signal else ():
            richer = sets.get(frozenset({*named, effect.name}))
            poorer = sets.get(frozenset(named) - {effect.name})
            if richer is None or poorer is None:
                continue  # it was never held against the named set
            again = [on(third, finding, step, signal) for step in (richer, poorer)]
            name, is_named = effect.name, effect.name in named
            sized = name not in richer.unsure
            yield Asked(
                case.name, group.name, name, is_named, sized, *a_part(richer, poorer), a_part(*again)[0]
            )


def share(asked: list[Asked]) -> str:
    """How many a third log bears out, with the 95 % interval of the share (Jeffreys)."""
    count, borne = len(asked), sum(a.third > 0.0 for a in asked)
    if not count:
        return "none"
    low, high = beta.ppf([0.025, 0.975], borne + 0.5, count - borne + 0.5)
    return f"{borne} of {count} ({low:.2f} to {high:.2f})"


def tables(asked: list[Asked]) -> Iterator[Table]:
    """What is printed."""
    known = Table("causes", "borne out by a third log (95 %)", title="Of what the fitted logs ask for")
    known.add_row("named", share([a for a in asked if a.named]))
    known.add_row("not named", share([a for a in asked if not a.named]))
    known.add_row("all", share(asked))
    yield known
    sure = Table(
        "gain over its reach", "borne out by a third log (95 %)", title="By the held-out log's own certainty"
    )
    for low, high in pairwise(SURE):
        sure.add_row(f"{low:g} to {high:g}", share([a for a in asked if a.sized and low < a.sure <= high]))
    yield sure


def stored(file: Path) -> dict[str, list[Asked]]:
    """Case -> what came of it, of an earlier run."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    return {row["case"]: [Asked(**a) for a in row["asked"]] for row in map(json.loads, lines)}


def main() -> None:
    """Judge the cases that a file of rows does not have yet, and print what all come to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--rows", type=Path, default=Path("third_log.jsonl"))
    options = parser.parse_args()
    known = stored(options.rows)
    for case in stratified([c for c in cases(True) if further_logs(c)], options.cases):
        if case.name in known:
            continue
        known[case.name] = list(asked_for(case))
        with options.rows.open("a", encoding="utf-8") as stream:
            row = {"case": case.name, "asked": [asdict(a) for a in known[case.name]]}
            stream.write(json.dumps(row) + "\n")
    for table in tables([a for asked in known.values() for a in asked]):
        Console().print(table)


if __name__ == "__main__":
    main()
