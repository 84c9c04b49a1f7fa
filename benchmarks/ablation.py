"""What each rule of the diagnosis is worth: ``python benchmarks/ablation.py --rig 40 --second 20 --strangers 20 --real 8``.

Each log is diagnosed with all rules, and each rule is watched meanwhile: it fires where what it decides differs from what
stands in its place. Where a rule does not fire, switching it off changes nothing, and nothing is run; where it fires, the
log is diagnosed again without it, by the same command, and the answers are compared log by log: of the rig's and the
second simulator's logs (synthetic) whether the answer is right, of real logs the error on the log held out. Answers are
kept in a file of JSON lines, so that a run that is started again goes on, and a later run with more logs adds to it;
``--from-rows`` prints the table of what is there. ``--page FILE`` writes it for docs.
"""

import argparse
import itertools
import json
import math
import os
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import t as student

from benchmarks import real_logs
from benchmarks.blind.cases import cases
from benchmarks.blind.score import honest, knowable, names, reported, true_names
from benchmarks.blind.trial import run_case as rig_case
from benchmarks.rules import GONE, RULES, STAYS, Rule
from benchmarks.second import trial as second_trial
from benchmarks.second.cases import draw
from benchmarks.second.out_of_library import draw_out_of_library
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.residuals.local import Event
from cosim.diagnosis.thresholds import INDISTINGUISHABLE, LOCAL
from fmus.contract import Effect

ALL = "none"  # the rule that is switched off where none is
RIG_DURATION = 60.0
DRAWN = 200  # logs of the rig among which the sample is taken, kind by kind
FIRED = "COSIM_ABLATION_FIRED"  # file into which a child process writes which rules fired


@contextmanager
def without(name: str) -> Iterator[None]:
    """Within this context the rule of that name is switched off."""
    rule = next((r for r in RULES if r.name == name), None)
    with ExitStack() as stack:
        for target, stand_in in (rule.off if rule else {}).items():
            stack.enter_context(patch(target, stand_in))
        yield


def same(one: Any, other: Any) -> bool:
    """True if two results of a rule can make no difference to what follows; False when in doubt.

    Of a finding what only tells of a linear model beside it, and causes further upstream that explain clearly less, change
    no answer; nor does an event that is no more than chance.
    """
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, Event) and min(one.p_value, other.p_value) >= LOCAL:
        return True
    if isinstance(one, Finding) and not one.lacks_linear and not other.lacks_linear:
        one, other = (replace(f, reference=None, upstream=alike_upstream(f)) for f in (one, other))
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one) if f.compare)
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and bool(np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"))
    if isinstance(one, Mapping):
        return list(one) == list(other) and all(same(one[k], other[k]) for k in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, (str, int, float, np.generic, set, frozenset)):
        return bool(one == other or (one != one and other != other))  # NaN
    return False


def alike_upstream(finding: Finding) -> list[tuple[Effect, float]]:
    """Causes further upstream that a finding is declared indistinguishable from."""
    return [(e, behind) for e, behind in finding.upstream if behind < INDISTINGUISHABLE]


def watching(target: str, rules: Collection[Rule], fired: set[str]) -> Any:
    """A function, or a property, that notes which of the rules that act or show in it made a difference.

    Args:
        target: its dotted name.
        rules: those watched here; none changes what it is given.
        fired: names are added.
    """
    real = resolve_name(target)

    decide = real.fget if isinstance(real, property) else real

    def watched_function(*given: Any, **named: Any) -> Any:
        found = decide(*given, **named)
        found = list(found) if isinstance(found, Iterator) else found
        for rule in rules:
            if rule.name in fired:
                continue
            if target in rule.off:
                other = rule.off[target](*given, **named)
            else:
                before = set(fired)
                with without(rule.name):
                    other = decide(*given, **named)
                fired.intersection_update(before)  # not what only fires where this rule does not hold
            if not same(found, other):
                fired.add(rule.name)
        return found

    return property(watched_function) if isinstance(real, property) else watched_function


@contextmanager
def watched(fired: set[str]) -> Iterator[None]:
    """Within this context all rules hold, and the names of those that make a difference are put into `fired`."""
    at: dict[str, list[Rule]] = defaultdict(list)
    for rule in RULES:
        for target in rule.shows or rule.off:
            at[target].append(rule)
    with ExitStack() as stack:
        for target, rules in at.items():
            stack.enter_context(patch(target, watching(target, rules, fired)))
        yield


@dataclass(frozen=True)
class Job:
    """One log with one rule switched off.

    Attributes:
        source: "rig", "second", "strangers" or "real".
        case: which of them.
        rule: name of the rule, or `ALL`.
    """

    source: str
    case: str
    rule: str

    @property
    def key(self) -> tuple[str, str, str]:
        """Unambiguous."""
        return self.source, self.case, self.rule


def right_of_rig(row: dict[str, Any]) -> bool:
    """True if the answer is the hidden truth, or holds it among what cannot be told apart, or honestly names nothing."""
    case = row["case"]
    if case["kind"] == "clean":
        return row["verdict"] == "adequate"
    if case["kind"] == "unknown" or case["removed"]:
        return honest(row) or (not knowable(row) and len(row["causes"]) <= 1)
    hidden = set(true_names(row))
    return hidden <= reported(row) and len(names(row)) <= len(hidden)


def done(job: Job, seed: int) -> dict[str, Any]:
    """A job's outcome as plain data: whether the answer is right, or how large the error on the log held out is.

    With all rules also the names of those that fired; they are missing where the process ended before it could say.
    """
    began = time.process_time()
    found: dict[str, Any] = {"source": job.source, "case": job.case, "rule": job.rule}
    if job.source == "rig":
        number = int(job.case.partition(":")[2])
        case = next(c for c in cases(10**9, seed, RIG_DURATION) if c.number == number)
        fired: set[str] = set()
        with watched(fired) if job.rule == ALL else without(job.rule):
            row = rig_case(case, fmus=False)
        if job.rule == ALL:
            found |= {"kind": case.kind, "fired": sorted(fired)}
        found |= (
            {"error": row["error"]}
            if "error" in row
            else {"right": right_of_rig(row), "named": list(names(row)), "told": sorted(reported(row))}
        )
        return found | {"cpu": time.process_time() - began}
    with TemporaryDirectory() as folder:
        said = Path(folder) / "fired.json"
        with patch.dict(os.environ, {FIRED: str(said)}):
            found |= in_child(job)
        if job.rule == ALL and said.is_file():
            found["fired"] = json.loads(said.read_text(encoding="utf-8"))
    return found


def in_child(job: Job) -> dict[str, Any]:
    """The outcome of a log that is diagnosed in a process of its own."""
    program = (sys.executable, str(Path(__file__).resolve()), "--as", job.rule)
    children = os.times()
    found: dict[str, Any] = {}
    if job.source == "real":
        row = real_logs.run({c.name: c for c in real_logs.cases(True)}[job.case], "", 600.0, program)
        after = row.after if row.after is not None else row.before
        told = [row.verdict, *sorted(row.alike), *sorted(f"not {name}" for name in row.refused)]
        found = {"after": after, "before": row.before, "named": list(row.causes), "told": told}
        found |= {"error": row.error} if row.error else {}
    else:
        number = int(job.case.partition(":")[2])
        with patch.object(second_trial, "PROGRAM", program):
            ended = second_trial.run_case((draw if job.source == "second" else draw_out_of_library)(number))
        good = ("exact", "alike", "rest") if job.source == "second" else ("honest",)
        if "error" in ended:
            found = {"error": ended["error"]}
        else:
            alike = sorted({name for c in ended["causes"] for name in c["alike"]})
            found = {"right": ended["judged"] in good, "named": [c["effect"] for c in ended["causes"]]}
            found["told"] = [ended["verdict"], *alike]
    after_all = os.times()
    return found | {"cpu": sum(after_all[2:4]) - sum(children[2:4])}


def logs(counts: Mapping[str, int], seed: int, hidden: Collection[str] = ()) -> list[tuple[str, str]]:
    """Source and case of all logs asked for, the sources in turn; of the rig the first of each kind, then the second.

    Args:
        counts: source -> logs.
        seed: of the synthetic ones.
        hidden: effects of which a log of the rig or of the second simulator must hide one; any log without.
    """
    kinds: dict[str, list[int]] = defaultdict(list)
    for case in cases(DRAWN, seed, RIG_DURATION):
        if not hidden or case.hidden.keys() & set(hidden):
            kinds[case.kind].append(case.number)
    seeds = (k for k in itertools.count(seed) if not hidden or draw(k).hidden.keys() & set(hidden))
    order = [
        number for turn in itertools.zip_longest(*kinds.values()) for number in turn if number is not None
    ]
    listed = {
        "rig": [f"{seed}:{number}" for number in order[: counts["rig"]]],
        "second": [f"seed:{k}" for k in itertools.islice(seeds, counts["second"])],
        "strangers": [f"seed:{seed + k}" for k in range(counts["strangers"])],
        "real": [c.name for c in real_logs.stratified(real_logs.cases(True), counts["real"])],
    }
    turns = itertools.zip_longest(*([(source, case) for case in own] for source, own in listed.items()))
    return [log for turn in turns for log in turn if log is not None]


def jobs(
    asked: Sequence[tuple[str, str]],
    rules: Sequence[str],
    rows: Mapping[tuple[str, str, str], dict[str, Any]],
    most: int = 1,
) -> list[Job]:
    """What is to be run next, log by log, so that a run may be stopped at any time.

    A log that was never run with all rules is; then it is run without each that fired on it.

    Args:
        asked: the logs, in order.
        rules: the rules.
        rows: what has been run.
        most: logs, of those with something to do.
    """
    found: list[Job] = []
    for source, case in asked:
        whole = Job(source, case, ALL)
        fired = rows[whole.key].get("fired", rules) if whole.key in rows else ()
        todo = [Job(source, case, r) for r in rules if r in fired and (source, case, r) not in rows]
        todo = todo if whole.key in rows else [whole]
        found += todo
        most -= bool(todo)
        if not most:
            break
    return found


def stored(file: Path) -> dict[tuple[str, str, str], dict[str, Any]]:
    """Outcomes of earlier runs; a line that was cut off is left out."""
    found = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        found[row["source"], row["case"], row["rule"]] = row
    return found


def paired(lost: int, won: int, count: int) -> tuple[float, float, float]:
    """Difference of two shares of the same logs, with its 95 % interval (Agresti and Min 2005, their adjusted Wald).

    Args:
        lost: logs right with the rule only.
        won: logs right without it only.
        count: logs.
    """
    b, c, n = lost + 0.5, won + 0.5, count + 2.0
    half = 1.96 * math.sqrt(max(b + c - (b - c) ** 2 / n, 0.0)) / n
    return (lost - won) / count, max((b - c) / n - half, -1.0), min((b - c) / n + half, 1.0)


@dataclass(frozen=True)
class Worth:
    """What a rule is worth on the logs of one source.

    Attributes:
        count: logs with an answer both ways.
        value, low, high: of synthetic logs the share that is right thanks to the rule; of real ones the logarithm of the
            held-out error without the rule over that with it; with its 95 % interval.
        changed: logs whose answer is right or wrong through it, or whose error differs.
        named: logs in which something else is named without it.
        told: logs in which something else is named, declared indistinguishable or refused, or the verdict another.
        fired: logs on which it made any difference on the way.
        waiting: further logs on which it fired, and which were not run without it.
    """

    count: int
    value: float
    low: float
    high: float
    changed: int
    named: int
    told: int
    fired: int
    waiting: int = 0

    def __str__(self) -> str:
        if not self.fired:
            return (
                f"{self.waiting} of {self.count + self.waiting}, not run"
                if self.waiting
                else f"0 of {self.count}"
            )
        left = f", {self.waiting} not run" if self.waiting else ""
        interval = f"{self.low:+.2f}..{self.high:+.2f}" if math.isfinite(self.high) else "one log"
        return f"{self.value:+.2f} ({interval}); {self.changed}/{self.named}/{self.told}/{self.fired} of {self.count}{left}"


def named_and_told(row: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """What an answer names, and what else it says of causes."""
    return sorted(row.get("named", ())), list(row.get("told", ()))


def worth(rows: dict[tuple[str, str, str], dict[str, Any]], source: str, rule: str) -> Worth | None:
    """What a rule is worth on a source's logs; None without any. Where it did not fire, nothing changes without it."""
    both, waiting = [], 0
    for (own, case, name), row in rows.items():
        if own != source or name != ALL:
            continue
        unfired = "fired" in row and rule not in row["fired"]
        if unfired or (source, case, rule) in rows:
            both.append((row, row if unfired else rows[source, case, rule]))
        elif "fired" in row:
            waiting += 1
    named = sum(sorted(a.get("named", ())) != sorted(b.get("named", ())) for a, b in both)
    told = sum(named_and_told(a) != named_and_told(b) for a, b in both)
    fired = sum(a is not b for a, b in both)
    unknown = Worth(0, *[math.nan] * 3, 0, 0, 0, 0, waiting) if waiting else None
    if source == "real":
        pairs = [(a["after"], b["after"]) for a, b in both if a.get("after") and b.get("after")]
        if not pairs:
            return unknown
        ratio = np.log([b / a for a, b in pairs])
        few = float(student.isf(0.025, len(pairs) - 1)) if len(pairs) > 1 else math.inf
        half = few * float(np.std(ratio, ddof=1)) / math.sqrt(len(pairs)) if len(pairs) > 1 else math.inf
        mean = float(np.mean(ratio))
        changed = int(np.sum(np.abs(ratio) > 0.005))
        return Worth(len(pairs), mean, mean - half, mean + half, changed, named, told, fired, waiting)
    known = [(a["right"], b.get("right", False)) for a, b in both if "right" in a]
    if not known:
        return unknown
    lost, won = sum(a and not b for a, b in known), sum(b and not a for a, b in known)
    return Worth(len(known), *paired(lost, won, len(known)), lost + won, named, told, fired, waiting)


SOURCES = {
    "rig": "rig",
    "second": "second simulator",
    "strangers": "out of the library",
    "real": "real logs (log ratio)",
}


def times(rows: Mapping[tuple[str, str, str], dict[str, Any]]) -> dict[tuple[str, str], float]:
    """Source and case -> median processor time of its diagnoses without one rule each: no rule is watched in those."""
    found: dict[tuple[str, str], list[float]] = defaultdict(list)
    for (source, case, rule), row in rows.items():
        if rule != ALL:
            found[source, case].append(row["cpu"])
    return {log: statistics.median(each) for log, each in found.items()}


def table(rows: dict[tuple[str, str, str], dict[str, Any]]) -> list[tuple[str, ...]]:
    """Lines of the table: rule, what it decides, its worth on each source, processor time without it."""
    lines, usual = [], times(rows)
    for rule in RULES:
        found = [worth(rows, source, rule.name) for source in SOURCES]
        if not any(found):
            continue
        own = [(usual[source, case], row["cpu"]) for (source, case, n), row in rows.items() if n == rule.name]
        ratio = f"{sum(b for _, b in own) / sum(a for a, _ in own):.2f}" if own else ""
        lines.append((rule.name, rule.text, *("" if w is None else str(w) for w in found), ratio))
    return lines


HEAD = ("rule", "what it decides", *SOURCES.values(), "time without")


PAGE = """# What each rule is worth

Made by `python benchmarks/ablation.py` on {today}; do not edit by hand. Logs: {told}.

Each log was diagnosed with all rules, and each rule was watched meanwhile: it fires where what it decides differs from what
stands in its place when it is off. Where it does not fire, nothing changes without it; where it fires, the log was diagnosed
again without it.

A cell has the worth with its 95 % interval: of synthetic logs the share that is right thanks to the rule, of real logs the
logarithm of the held-out error without the rule over that with it. Positive speaks for the rule. Then a cell has four counts
of logs, and the number of logs with both answers:

- the answer went from right to wrong or back (real logs: the error changed by more than 0.5 %);
- other causes were named;
- other causes were named, declared indistinguishable or refused, or the verdict is another;
- the rule fired.

Where it fired on none, the cell has that only. "Not run" are logs on which it fired and which were not diagnosed without it,
for want of time. The last column is processor time without the rule over that without
any other one, on the logs on which it fired.

The logs are few and the intervals wide: one that holds none says that these logs show no worth, not that there is none.
Where no error of a real log changed, its interval has no width and says nothing of other logs.

{table}

## Rules of which these logs show no worth, and why they stay

{stay}

## Rules that went

{gone}
"""


def in_short(found: Sequence[Worth]) -> str:
    """On how many logs of all sources a rule fired, and how many answers it changed."""
    fired, waiting = sum(w.fired for w in found), sum(w.waiting for w in found)
    told = f"fired on {fired + waiting} of {sum(w.count + w.waiting for w in found)} logs"
    if not fired:
        return told + (", none of which was run without it" if waiting else "")
    run = f" ({waiting} not run without it)" if waiting else ""
    return f"{told}{run} and changed {sum(w.changed for w in found)} answers"


def page(rows: dict[tuple[str, str, str], dict[str, Any]]) -> str:
    """The table as a page of the documentation."""
    counts: dict[str, int] = defaultdict(int)
    right: dict[str, int] = defaultdict(int)
    for (source, _, rule), row in rows.items():
        if rule == ALL:
            counts[source] += 1
            right[source] += bool(row.get("right"))
    told = ", ".join(
        f"{counts[s]} of {text.split(' (')[0]}" + (f" ({right[s]} right)" if s != "real" else "")
        for s, text in SOURCES.items()
        if counts[s]
    )
    unshown = [
        (rule, found)
        for rule in RULES
        if (found := [w for s in SOURCES if (w := worth(rows, s, rule.name))])
        and not any(w.low > 0.0 for w in found)
    ]
    table_lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    table_lines += ["| " + " | ".join(line) + " |" for line in table(rows)]
    stay = [f"- **{rule.name}** {in_short(found)}. {STAYS[rule.name]}" for rule, found in unshown]
    today = datetime.now(UTC).date().isoformat()
    return PAGE.format(
        today=today,
        told=told,
        table="\n".join(table_lines),
        stay="\n".join(stay),
        gone="\n".join(f"- {text}" for text in GONE),
    )


def as_command(rule: str, arguments: list[str]) -> int:
    """``cosim`` with a rule switched off."""
    from cosim.cli import main as cosim_main

    fired: set[str] = set()
    try:
        with watched(fired) if rule == ALL else without(rule):
            return int(cosim_main(arguments) or 0)
    finally:
        if rule == ALL and FIRED in os.environ:
            Path(os.environ[FIRED]).write_text(json.dumps(sorted(fired)), encoding="utf-8")


def main() -> int:
    """Run what is asked for and not there yet, and print the table."""
    if sys.argv[1:2] == ["--as"]:
        return as_command(sys.argv[2], sys.argv[3:])
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for source, text in SOURCES.items():
        parser.add_argument(f"--{source}", type=int, default=0, help=f"number of logs: {text}")
    parser.add_argument("--seed", type=int, default=1, help="of the synthetic logs")
    parser.add_argument(
        "--hidden", nargs="+", default=[], help="only synthetic logs that hide one of these effects"
    )
    parser.add_argument("--rules", nargs="+", default=[], choices=[r.name for r in RULES], help="only these")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument(
        "--rows", type=Path, default=Path("build/ablation.jsonl"), help="outcomes, JSON lines"
    )
    parser.add_argument("--from-rows", action="store_true", help="run nothing")
    parser.add_argument("--page", type=Path, help="write the table as Markdown")
    asked = parser.parse_args()
    rows = stored(asked.rows)
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    if not asked.from_rows:
        counts = {source: getattr(asked, source) for source in SOURCES}
        wanted, chosen = logs(counts, asked.seed, asked.hidden), asked.rules or [r.name for r in RULES]
        asked.rows.parent.mkdir(parents=True, exist_ok=True)
        with asked.rows.open("a", encoding="utf-8") as out, ProcessPoolExecutor(asked.workers) as pool:
            while todo := jobs(wanted, chosen, rows, asked.workers):
                running = [pool.submit(done, job, asked.seed) for job in todo]
                for count, future in enumerate(as_completed(running), 1):
                    row = future.result()
                    rows[row["source"], row["case"], row["rule"]] = row
                    out.write(json.dumps(row) + "\n")
                    out.flush()
                    console.print(f"{count}/{len(todo)} {row}")
    if asked.page:
        asked.page.write_text(page(rows), encoding="utf-8")
    shown = Table(*HEAD)
    for line in table(rows):
        shown.add_row(*line)
    Console(width=200).print(shown)
    return 0


if __name__ == "__main__":
    sys.exit(main())
