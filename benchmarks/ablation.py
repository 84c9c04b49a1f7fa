"""What each rule of the diagnosis is worth: ``python benchmarks/ablation.py --rig 40 --second 20 --strangers 20 --real 8``.

Each log is diagnosed with all rules and again with each rule switched off in turn, by the same command, and the answers are
compared log by log: of the rig's and the second simulator's logs (synthetic) whether the answer is right, of real logs the
error on the log held out. Answers are kept in a file of JSON lines, so that a run that is started again goes on, and a
later run with more logs adds to it; ``--from-rows`` prints the table of what is there. ``--page FILE`` writes it for docs.
"""

import argparse
import json
import math
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import real_logs
from benchmarks.blind.cases import cases
from benchmarks.blind.score import honest, knowable, names, reported, true_names
from benchmarks.blind.trial import run_case as rig_case
from benchmarks.second import trial as second_trial
from benchmarks.second.cases import draw
from benchmarks.second.out_of_library import draw_out_of_library

ALL = "none"  # the rule that is switched off where none is
RIG_DURATION = 60.0


@dataclass(frozen=True)
class Rule:
    """A decision rule of the diagnosis, and how it is switched off.

    Attributes:
        name: short, for tables.
        text: what it decides.
        off: dotted name of a function -> what stands in its place.
    """

    name: str
    text: str
    off: dict[str, Callable[..., Any]]


def first(*given: Any, **named: Any) -> Any:
    """The first argument."""
    return given[0]


def second(*given: Any, **named: Any) -> Any:
    """The second argument."""
    return given[1]


def third(*given: Any, **named: Any) -> Any:
    """The third argument."""
    return given[2]


def nothing(*_: Any, **__: Any) -> None:
    """None."""


def empty(*_: Any, **__: Any) -> list[Any]:
    """An empty list."""
    return []


def no_set(*_: Any, **__: Any) -> set[str]:
    """An empty set."""
    return set()


def zero(*_: Any, **__: Any) -> float:
    """0."""
    return 0.0


def yes(*_: Any, **__: Any) -> bool:
    """True."""
    return True


def as_chosen(finding: Any, *_: Any, **__: Any) -> Any:
    """A finding and what was named, as they are."""
    return finding, finding.chosen.effects


def as_found(_: Any, finding: Any, known: Any, *__: Any, **___: Any) -> Any:
    """The blocks before and the finding, as they are."""
    return known, finding


def no_event(*_: Any, **__: Any) -> Any:
    """Nothing that stands out."""
    from cosim.diagnosis.residuals.local import NO_EVENT

    return NO_EVENT


S, N, T, H, V, P = (
    f"cosim.diagnosis.{m}."
    for m in (
        "pipeline.diagnose",
        "hypotheses.naming",
        "fitting.trials",
        "held_out.causes",
        "verdict.verdict",
        "hypotheses.pruning",
    )
)
RULES = (
    Rule("labels first", "a log is held against its own labels", {S + "contradictions": empty, S + "clock": empty}),
    Rule("coarse search", "the search begins with what most reduces the error itself", {N + "coarsely": nothing}),
    Rule("not one number", "what free parameters make up for is no candidate", {N + "identifiable": third}),
    Rule("away from stops", "the nominal fit is tried clear of limits", {N + "away_from_stops": second}),
    Rule("beside rivals", "pairs are sought beside close rivals of a single cause", {N + "beside_rivals": empty}),
    Rule("led on", "a fit that went astray begins again where a nested one ended", {T + "led_on": nothing}),
    Rule("forms of a law", "a law may have another form", {N + "forms": empty}),
    Rule("plain form", "a form that gains nothing is taken back", {N + "in_plain_form": second}),
    Rule("exchanges", "single effects of a set are exchanged or dropped", {N + "swapped": second}),
    Rule("size is sure", "a cause whose size may be none, or does not matter, is none", {N + "worth_naming": yes}),
    Rule("sizes together", "several sizes of one effect may be sure together", {N + "joint": zero}),
    Rule("no pressed bounds", "a cause pressed against a bound is none", {N + "impossible": empty, P + "impossible": empty}),
    Rule("windows left out", "a cause must gain on windows left out", {P + "refuted": empty}),
    Rule("outweighed", "a cause that explains less than what it leaves is none", {P + "drop_outweighed": first}),
    Rule("simplified", "one effect in the place of a set that leaves more than the difference", {P + "simplified": first}),
    Rule("moderated", "a usual size in the place of one beyond all sizes", {P + "moderated": first}),
    Rule("little left", "a cause that leaves much is none where nominals are trusted", {V + "stands": yes}),
    Rule("bent laws", "two laws that both had to be bent are alike", {V + "indistinguishable_in_any_form": empty}),
    Rule("origin", "an effect is traced to the block before", {S + "traced": as_found}),
    Rule("event", "something that happens once stands out", {N + "burst": no_event}),
    Rule("line", "something that rings at one frequency stands out", {N + "line": no_event}),
    Rule("slow oscillation", "a slow oscillation stands out", {N + "slow_oscillation": no_event}),
    Rule("strained", "a trusted parameter bent far is a rest", {V + "strained": empty}),
    Rule("rivals held out", "close rivals are held against a cause on held-out data", {S + "reconsider": as_chosen}),
    Rule("cancelling", "two causes of which only the sum is known are not both named", {H + "cancelling": no_set}),
    Rule("linear reference", "nothing is named where a linear model is clearly better", {S + "beside_linear": first}),
)  # fmt: skip


@contextmanager
def without(name: str) -> Iterator[None]:
    """Within this context the rule of that name is switched off."""
    rule = next((r for r in RULES if r.name == name), None)
    with ExitStack() as stack:
        for target, stand_in in (rule.off if rule else {}).items():
            stack.enter_context(patch(target, stand_in))
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
    """A job's outcome as plain data: whether the answer is right, or how large the error on the log held out is."""
    began = time.process_time()
    found: dict[str, Any] = {"source": job.source, "case": job.case, "rule": job.rule}
    if job.source == "rig":
        number = int(job.case.partition(":")[2])
        case = next(c for c in cases(10**9, seed, RIG_DURATION) if c.number == number)
        with without(job.rule):
            row = rig_case(case, fmus=False)
        found |= {"error": row["error"]} if "error" in row else {"right": right_of_rig(row)}
        return found | {"cpu": time.process_time() - began}
    program = (sys.executable, str(Path(__file__).resolve()), "--as", job.rule)
    children = os.times()
    if job.source == "real":
        case_of = {c.name: c for c in real_logs.cases(True)}
        row_of = real_logs.run(case_of[job.case], "", 600.0, program)
        found |= {
            "after": row_of.after if row_of.after is not None else row_of.before,
            "before": row_of.before,
        }
        found |= (
            {"named": list(row_of.causes), "error": row_of.error}
            if row_of.error
            else {"named": list(row_of.causes)}
        )
    else:
        number = int(job.case.partition(":")[2])
        with patch.object(second_trial, "PROGRAM", program):
            told = second_trial.run_case((draw if job.source == "second" else draw_out_of_library)(number))
        good = ("exact", "alike", "rest") if job.source == "second" else ("honest",)
        found |= {"error": told["error"]} if "error" in told else {"right": told["judged"] in good}
    ended = os.times()
    return found | {"cpu": sum(ended[2:4]) - sum(children[2:4])}


def jobs(counts: dict[str, int], seed: int, rules: Sequence[str]) -> list[Job]:
    """All that is asked for: every log with all rules first, then rule by rule."""
    listed = [("rig", f"{seed}:{c.number}") for c in cases(counts["rig"], seed, RIG_DURATION)]
    listed += [("second", f"seed:{seed + k}") for k in range(counts["second"])]
    listed += [("strangers", f"seed:{seed + k}") for k in range(counts["strangers"])]
    listed += [("real", c.name) for c in real_logs.stratified(real_logs.cases(True), counts["real"])]
    return [Job(source, case, rule) for rule in (ALL, *rules) for source, case in listed]


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
        changed: logs whose answer differs.
    """

    count: int
    value: float
    low: float
    high: float
    changed: int

    def __str__(self) -> str:
        return f"{self.value:+.2f} ({self.low:+.2f}..{self.high:+.2f}; {self.changed} of {self.count})"


def worth(rows: dict[tuple[str, str, str], dict[str, Any]], source: str, rule: str) -> Worth | None:
    """What a rule is worth on a source's logs; None without any."""
    both = [
        (rows[source, case, ALL], row)
        for (own, case, name), row in rows.items()
        if own == source and name == rule and (source, case, ALL) in rows
    ]
    if source == "real":
        pairs = [(a["after"], b["after"]) for a, b in both if a.get("after") and b.get("after")]
        if not pairs:
            return None
        ratio = np.log([b / a for a, b in pairs])
        half = 1.96 * float(np.std(ratio, ddof=1)) / math.sqrt(len(pairs)) if len(pairs) > 1 else math.inf
        mean = float(np.mean(ratio))
        return Worth(len(pairs), mean, mean - half, mean + half, int(np.sum(np.abs(ratio) > 0.005)))
    known = [(a["right"], b.get("right", False)) for a, b in both if "right" in a]
    if not known:
        return None
    lost, won = sum(a and not b for a, b in known), sum(b and not a for a, b in known)
    return Worth(len(known), *paired(lost, won, len(known)), lost + won)


SOURCES = {
    "rig": "rig",
    "second": "second simulator",
    "strangers": "out of the library",
    "real": "real logs (log ratio)",
}


def table(rows: dict[tuple[str, str, str], dict[str, Any]]) -> list[tuple[str, ...]]:
    """Lines of the table: rule, what it decides, its worth on each source, processor time without it."""
    lines = []
    for rule in RULES:
        found = [worth(rows, source, rule.name) for source in SOURCES]
        if not any(found):
            continue
        times = [
            (rows[source, case, ALL]["cpu"], row["cpu"])
            for (source, case, name), row in rows.items()
            if name == rule.name and (source, case, ALL) in rows
        ]
        ratio = sum(b for _, b in times) / max(sum(a for a, _ in times), 1e-9)
        lines.append((rule.name, rule.text, *("" if w is None else str(w) for w in found), f"{ratio:.2f}"))
    return lines


HEAD = ("rule", "what it decides", *SOURCES.values(), "time without")


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
    lines = [
        "# What each rule is worth",
        "",
        f"Made by `python benchmarks/ablation.py` on {datetime.now(UTC).date().isoformat()}; do not edit by hand.",
        f"Logs: {told}.",
        "",
        "Each log was diagnosed with all rules, and again with each rule switched off. Synthetic logs: the share of logs",
        "that are right thanks to the rule, its 95 % interval (paired), and how many answers of how many changed. Real",
        "logs: logarithm of the held-out error without the rule over that with it. Positive speaks for the rule. The last",
        "column is the processor time without the rule over that with it.",
        "",
        "| " + " | ".join(HEAD) + " |",
        "|" + "---|" * len(HEAD),
        *("| " + " | ".join(line) + " |" for line in table(rows)),
        "",
    ]
    return "\n".join(lines)


def as_command(rule: str, arguments: list[str]) -> int:
    """``cosim`` with a rule switched off."""
    from cosim.cli import main as cosim_main

    with without(rule):
        return int(cosim_main(arguments) or 0)


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
        todo = [
            j for j in jobs(counts, asked.seed, asked.rules or [r.name for r in RULES]) if j.key not in rows
        ]
        asked.rows.parent.mkdir(parents=True, exist_ok=True)
        with asked.rows.open("a", encoding="utf-8") as out, ProcessPoolExecutor(asked.workers) as pool:
            for count, future in enumerate(as_completed([pool.submit(done, j, asked.seed) for j in todo]), 1):
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
