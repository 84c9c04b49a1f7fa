"""Every real log in turn held out: ``python benchmarks/real_logs.py [--sample 12] [--only boom] [--json] [--page FILE]``.

The logs lie in the folder that COSIM_DATA names (docs/machines.md says where to get them). Each case fits one log of a
machine, or several, and holds out another one of the same axis; it runs ``cosim diagnose ... --calibrate --json`` as a user
would, in a process of its own. Each result is appended to a file of JSON lines as soon as it is there, and a case that is
in the file already is not run again: an interrupted run goes on. `--from-rows` runs nothing and prints what is there.
"""

import argparse
import json
import os
import resource
import shlex
import signal
import statistics
import subprocess
import sys
import tempfile
import textwrap
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from itertools import combinations, zip_longest
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console
from rich.table import Table

TOP = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("COSIM_DATA", TOP.parent / "shared" / "data"))
MAPPINGS = TOP / "examples" / "mappings"
DUTIES = ("50", "70", "90")
AXES = ("boom", "stick", "bucket", "swing")
KILLED = 60.0  # s that a process has to write what it found after SIGTERM
PROGRAM = (sys.executable, "-m", "cosim")
WORSE = 1.005  # after over before: three digits are printed
MISSING = "linear dynamics are missing"
BETTER = "on data held out a linear model"  # with what is not clear enough to be called missing


@dataclass(frozen=True)
class Case:
    """One log held out, or several.

    Attributes:
        machine, axis: what the case belongs to; names are compared from log to log of one axis.
        mapping: name of the mapping's file.
        fit: logs that are fitted, below the folder of the data.
        held: the logs held out; none where the mapping holds out a part of the only log.
    """

    machine: str
    axis: str
    mapping: str
    fit: tuple[str, ...]
    held: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Unambiguous, for people."""
        fit, held = (" + ".join(Path(f).stem for f in files) for files in (self.fit, self.held))
        return f"{self.axis}: {fit} -> {held or 'its own end'}"


@dataclass
class Row:
    """What came of a case.

    Attributes:
        machine, axis, fit, held: the case.
        before, after: error on the held-out log by the real FMUs, in `unit`; None where nothing was measured.
        linear, extended: error of the linear reference and of the extended model in the same windows of the held-out log.
        linear_missing: whether the answer says that a linear model predicts as well or better.
        causes: effect -> parameter -> value with unit.
        alike: effects declared indistinguishable from those named.
        refused: effects that the held-out log did not bear out.
        unexplained: what the answer leaves open.
        cpu: s, user and system.
        code: exit code; negative for a signal.
        budget: as asked for.
        error: last line on stderr where there is no answer.
    """

    machine: str
    axis: str
    fit: list[str]
    held: list[str]
    unit: str = ""
    verdict: str = ""
    before: float | None = None
    after: float | None = None
    linear: float | None = None
    extended: float | None = None
    linear_missing: bool = False
    causes: dict[str, dict[str, str]] = field(default_factory=dict)
    alike: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    unexplained: list[str] = field(default_factory=list)
    cpu: float = 0.0
    code: int = 0
    budget: str = ""
    error: str = ""
    version: str = ""

    @property
    def name(self) -> str:
        """As of its case."""
        return Case(self.machine, self.axis, "", tuple(self.fit), tuple(self.held)).name

    @property
    def worse(self) -> bool:
        """True if the extension made the held-out error larger."""
        return self.before is not None and self.after is not None and self.after > WORSE * self.before

    @property
    def honest(self) -> bool:
        """True if the extended model is at least as good as the linear reference, or the answer says that it is not."""
        if self.linear is None or self.extended is None:
            return False
        return self.extended <= WORSE * self.linear or self.linear_missing


Motion = tuple[str, str, str, str]  # axis, direction, pose, coupling


def excavator_logs() -> dict[Motion, dict[str, str]]:
    """The logs of each motion of the excavator: duty -> file below the folder of the data."""
    groups: dict[Motion, dict[str, str]] = defaultdict(dict)
    for file in sorted((DATA / "excavator").glob("*.csv")):
        axis, direction, duty, pose, coupling = file.stem.split("-")
        groups[axis, direction, pose, coupling][duty] = f"excavator/{file.name}"
    return groups


def other_poses() -> Iterator[Case]:
    """All duties of one pose or load fitted, all those of the other held out: only together they show a valve's curve."""
    logs = excavator_logs()
    for (axis, direction, pose, coupling), fitted in logs.items():
        held = logs.get((axis, direction, "L" if pose == "H" else "H", coupling), {})
        if coupling == "single" and held:
            fit, other = tuple(fitted.values()), tuple(held.values())
            yield Case("excavator", f"{axis} {direction}, all", f"excavator_{axis}.toml", fit, other)


def both_ways() -> Iterator[Case]:
    """All logs of one pose or load of an axis fitted, out and back, all those of the other held out."""
    poses: dict[tuple[str, str], list[str]] = defaultdict(list)
    for (axis, _, pose, coupling), logs in excavator_logs().items():
        if coupling == "single":
            poses[axis, pose] += logs.values()
    for (axis, pose), fitted in poses.items():
        if held := poses.get((axis, "L" if pose == "H" else "H")):
            yield Case(
                "excavator", f"{axis}, both ways", f"excavator_{axis}.toml", tuple(fitted), tuple(held)
            )


def excavator(together: bool) -> Iterator[Case]:
    """Each duty held out, fitted on all others of the same axis, direction, pose and coupling, or on the nearest one."""
    for (axis, direction, *_), logs in excavator_logs().items():
        for duty, held in logs.items():
            others = [other for other in DUTIES if other != duty and other in logs]
            if not others:
                continue
            # of two that are as near the faster motion shows less of the drive, so the slower one is fitted
            near = min(others, key=lambda o: (abs(int(o) - int(duty)), int(o)))
            fit = tuple(logs[o] for o in (others if together else [near]))
            yield Case("excavator", f"{axis} {direction}", f"excavator_{axis}.toml", fit, (held,))


def mini_excavator() -> Iterator[Case]:
    """Each log held out, fitted on the one before it."""
    logs = sorted(f"mini_excavator/{file.name}" for file in (DATA / "mini_excavator").glob("*.csv"))
    for k, held in enumerate(logs):
        for axis in AXES:
            yield Case(
                "mini excavator", f"mini {axis}", f"mini_excavator_{axis}.toml", (logs[k - 1],), (held,)
            )


def cases(together: bool) -> list[Case]:
    """All of them, those of one axis together."""
    emps = ("emps/DATA_EMPS.mat", "emps/DATA_EMPS_PULSES.mat")
    one = [
        Case(
            "forest crane",
            "forest crane",
            "actuator_forest_crane.toml",
            ("actuator_forest_crane/actuator.mat",),
        ),
        Case("EMPS", "EMPS", "emps.toml", (emps[0],), (emps[1],)),
        Case("EMPS", "EMPS", "emps.toml", (emps[1],), (emps[0],)),
    ]
    found = [*one, *mini_excavator(), *excavator(together), *other_poses(), *both_ways()]
    return [c for c in found if all((DATA / f).is_file() for f in (*c.fit, *c.held))]


def stratified(found: Sequence[Case], count: int) -> list[Case]:
    """The first of each axis, then the second of each, until there are enough."""
    by_axis: dict[str, list[Case]] = defaultdict(list)
    for case in found:
        by_axis[case.axis].append(case)
    dealt = [c for turn in zip_longest(*by_axis.values()) for c in turn if c is not None]
    return dealt[:count]


def command(case: Case, budget: str, out: str, mappings: Path = MAPPINGS) -> list[str]:
    """What a user would type behind ``cosim``."""
    words = ["diagnose", *(str(DATA / f) for f in case.fit)]
    words += ["--mapping", str(mappings / case.mapping), "--calibrate", "--json", "--out", out]
    for held in case.held:
        words += ["--held-out", str(DATA / held)]
    return words + (["--budget", budget] if budget else [])


def run(
    case: Case, budget: str, limit: float, program: Sequence[str] = PROGRAM, mappings: Path = MAPPINGS
) -> Row:
    """Diagnose a case in a process of its own.

    Args:
        case: what is fitted and held out.
        budget: as ``--budget`` takes it, or empty.
        limit: s after which the process is asked to end, and later killed.
        program: what stands for ``cosim``.
        mappings: folder of the mappings.
    """
    row = Row(case.machine, case.axis, list(case.fit), list(case.held), budget=budget, version=version())
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.Popen(
            [*program, *command(case, budget, folder, mappings)],
            cwd=TOP,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(TOP), "COLUMNS": "400"},
        )
        try:
            out, err = child.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGTERM)
            try:
                out, err = child.communicate(timeout=KILLED)
            except subprocess.TimeoutExpired:
                child.kill()
                out, err = child.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    row.cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    row.code = child.returncode
    try:
        read(row, json.loads(out))
    except (ValueError, KeyError) as error:
        lines = err.strip().splitlines()
        row.error = lines[-1] if lines else repr(error)
    return row


def sizes_of(cause: dict[str, Any]) -> dict[str, Any]:
    """Parameter -> its size, of a stop the speed at it, which can be read off the machine."""
    return dict(cause["parameters"] | cause["top_speed"])


def read(row: Row, answer: dict[str, Any]) -> None:
    """Put an answer into its row."""
    row.verdict = answer["verdict"]
    for name, gain in answer["gain"].items():
        row.unit, row.before, row.after = gain["unit"], gain["rmse_before"], gain["rmse_after"]
        if name in answer["linear"]:
            row.linear = answer["linear"][name]["rmse"]
            row.extended = answer["linear"][name]["rmse_extended"]
        break
    for cause in answer["causes"]:
        row.causes[cause["effect"]] = {n: f"{p['value']:.3g} {p['unit']}" for n, p in sizes_of(cause).items()}
        row.alike += cause["indistinguishable_from"]
    row.refused = [r["effect"] for r in answer["refused"]]
    row.unexplained = [r["what"] for r in answer["unexplained"]]
    row.linear_missing = any(
        t in what for what in [*row.unexplained, *answer["warnings"]] for t in (MISSING, BETTER)
    )


def version() -> str:
    """Commit of the program, with a plus where files were changed since; empty without git."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty=+"], cwd=TOP, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return found.stdout.strip()


def pairs(rows: Sequence[Any]) -> list[tuple[Any, Any]]:
    """Pairs of rows, each with an `axis` and `causes`, of one axis, one of them at least naming a cause."""
    return [(a, b) for a, b in combinations(rows, 2) if a.axis == b.axis and (a.causes or b.causes)]


def same_names(rows: Sequence[Row]) -> tuple[int, int]:
    """Pairs of one axis's answers that name the same effects, one of them at least naming any, and all such pairs."""
    found = pairs([row for row in rows if row.verdict])
    return sum({*a.causes} == {*b.causes} for a, b in found), len(found)


def agreeing(rows: Sequence[Row]) -> tuple[int, int]:
    """Pairs as of `same_names` in which all that one names the other names, too, or declares alike with it."""
    found = pairs([row for row in rows if row.verdict])
    agree = [{*a.causes} <= {*b.causes, *b.alike} and {*b.causes} <= {*a.causes, *a.alike} for a, b in found]
    return sum(agree), len(found)


def summary(rows: Sequence[Row]) -> list[str]:
    """What the rows come to, a sentence each."""
    judged = [row for row in rows if row.before is not None]
    times = [row.cpu for row in rows]
    same, pairs = same_names(rows)
    agree, _ = agreeing(rows)
    lines = [
        f"ended without an error: {sum(row.code == 0 for row in rows)} of {len(rows)}",
        f"as good as the linear reference, or says that it is not: {sum(r.honest for r in judged)} of {len(judged)}",
        f"worse after than before: {sum(row.worse for row in judged)} of {len(judged)}",
        f"the same names from log to log of one axis: {same} of {pairs} pairs; "
        f"{agree} with those declared indistinguishable",
    ]
    if judged:
        gained = [row.after / row.before for row in judged if row.after is not None and row.before]
        lines.append(f"error after over before: {statistics.median(gained):.2f} in the median")
    if times:
        lines.append(
            f"processor time: {statistics.median(times):.0f} s in the median, {max(times):.0f} s at most"
        )
    return lines


HEAD = (
    "axis",
    "fitted",
    "held out",
    "before",
    "after",
    "linear",
    "same windows",
    "named",
    "left",
    "s",
    "code",
)


def cells(row: Row) -> tuple[str, ...]:
    """A line of the table."""

    def error(value: float | None) -> str:
        return "" if value is None else f"{value:.3g}"

    short = [effect.partition(".")[2] + " " + ", ".join(p.values()) for effect, p in row.causes.items()]
    missing = ["linear dynamics"] if any(MISSING in what for what in row.unexplained) else []
    missing += ["(linear as good, it says)"] if row.linear_missing and not missing else []
    rest = [what for what in row.unexplained if MISSING not in what]
    fitted = ", ".join(Path(f).stem for f in row.fit)
    return (
        row.axis,
        fitted,
        ", ".join(Path(f).stem for f in row.held) or "its own end",
        f"{error(row.before)} {row.unit}".strip(),
        error(row.after),
        error(row.linear),
        error(row.extended),
        "; ".join(short) or (row.error or "none"),
        "; ".join([*missing, *(textwrap.shorten(what, 60, placeholder=" ...") for what in rest)]),
        f"{row.cpu:.0f}",
        str(row.code),
    )


def page(rows: Sequence[Row], asked: Sequence[str]) -> str:
    """The table as a page of the documentation; nothing of the data but errors stands in it."""
    date = datetime.now(UTC).date().isoformat()
    versions = ", ".join(sorted({row.version for row in rows if row.version}))
    made = shlex.join(["python", "benchmarks/real_logs.py", *asked])
    lines = [
        "# Real logs, each held out in turn",
        "",
        f"Made by `{made}` on {date} (program {versions}); do not edit by hand.",
        "",
        "Each line is one `cosim diagnose FITTED --mapping examples/mappings/... --held-out HELD --calibrate`.",
        "",
        "- `axis`: with `, all`, all duties of one pose or load of the machine are fitted, and all those of the other are",
        "  held out. With `, both ways`, those out and those back are fitted together.",
        "- `before` and `after`: error of the whole held-out log, from the command alone, by the FMUs.",
        "- `linear`: error of the linear reference of free order. `same windows`: that of the extended model in the windows",
        "  in which the linear one was scored. If an axis drifts and the extension does not make its free run over minutes",
        "  better, all four are errors of predictions over 5 s each, from where the machine stands.",
        "- `linear` begins at rest where the log does. Where linear dynamics are missing, `after` is that of the linear",
        "  model, which the extended model then has in the place of the blocks; `same windows` is that of the blocks.",
        "- `left`: what stays unexplained. `s`: processor time on two cores shared with other work. `code`: exit code.",
        "",
        "In short:",
        "",
        *(f"- {line}" for line in summary(rows)),
        "",
    ]
    for machine in dict.fromkeys(row.machine for row in rows):
        budgets = {row.budget for row in rows if row.machine == machine and row.budget}
        said = f" (with `--budget {', '.join(sorted(budgets))}`)" if budgets else ""
        lines += [f"## {machine[0].upper()}{machine[1:]}{said}", ""]
        lines += ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
        mine = sorted((row for row in rows if row.machine == machine), key=lambda row: (row.axis, row.held))
        lines += ["| " + " | ".join(cell.replace("|", "/") for cell in cells(row)) + " |" for row in mine] + [
            ""
        ]
    return "\n".join(lines)


def stored(file: Path) -> list[Row]:
    """The rows of an earlier run; a line that an interruption cut short is left out."""
    rows = []
    known = {item.name for item in fields(Row)}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        try:
            rows.append(Row(**{k: v for k, v in json.loads(line).items() if k in known}))
        except ValueError:
            continue
    return rows


def main() -> None:
    """Run what is asked for and not there yet, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sample", type=int, help="that many cases, spread over the axes")
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument(
        "--one", action="store_true", help="excavator: fit the nearest other duty, not all others"
    )
    parser.add_argument("--budget", default="", help="for every case, as `cosim diagnose` takes it")
    parser.add_argument("--limit", type=float, default=600.0, help="s after which a case is ended")
    parser.add_argument(
        "--rows", type=Path, default=Path("build/real_logs.jsonl"), help="JSON lines, one a case"
    )
    parser.add_argument("--mappings", type=Path, default=MAPPINGS, help="folder with mappings of these names")
    parser.add_argument("--from-rows", action="store_true", help="run nothing")
    parser.add_argument("--page", type=Path, help="write the table as Markdown")
    parser.add_argument("--json", action="store_true", help="print one object")
    asked = parser.parse_args()
    chosen = [c for c in cases(not asked.one) if asked.only in c.name]
    chosen = chosen[:0] if asked.from_rows else stratified(chosen, asked.sample or len(chosen))
    if not chosen and not asked.from_rows:
        sys.exit(f"no log of these machines below {DATA}: set COSIM_DATA to the folder that has them")
    rows = stored(asked.rows)
    done = {row.name for row in rows}
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    for case in chosen:
        if case.name in done:
            continue
        row = run(case, asked.budget, asked.limit, mappings=asked.mappings.resolve())
        rows.append(row)
        with asked.rows.open("a", encoding="utf-8") as file:
            file.write("\n" + json.dumps(asdict(row)))  # first the line's end: the last one may be cut short
        print(" | ".join(cells(row)), file=sys.stderr, flush=True)
    if not asked.from_rows:
        rows = [row for row in rows if row.name in {case.name for case in chosen}]
    if asked.page:
        asked.page.write_text(page(rows, sys.argv[1:]), encoding="utf-8")
    if asked.json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "summary": summary(rows)}))
        return
    table = Table(*HEAD)
    for row in rows:
        table.add_row(*cells(row))
    Console().print(table)
    for line in summary(rows):
        print(line)


if __name__ == "__main__":
    main()
