"""A batch in a few lines of words."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.console import typed

if TYPE_CHECKING:
    from cosim.batch.conduct import Report


def headline(about: dict[str, Any]) -> str:
    """How many runs of what were done, and how fast."""
    rate = f", {about['runs_per_second']:.3g} runs a second" if about["runs_per_second"] else ""
    before = f", {about['runs_before']} of them before" if about["runs_before"] else ""
    return (
        f"{about['task']}, engine {about['engine']}: {about['done']} of {about['runs']} runs done{before}, "
        f"{about['failed']} failed{rate}"
    )


def threshold_lines(about: dict[str, Any]) -> list[str]:
    """Each threshold, kept or missed."""
    found = []
    for limit in about["thresholds"]:
        state = "kept" if limit["passed"] else f"MISSED by {limit['runs_missed']} runs"
        largest = "-" if limit["rmse"] is None else f"{limit['rmse']:.4g} {limit['unit']}"
        found.append(
            f"threshold {state}: RMSE of {limit['signal']} up to {largest}, limit {limit['limit']:.4g} {limit['unit']}"
        )
    return found


SHOWN_SCORES = (" rmse [", " final [", " max [")
FEW = 3  # scores in the answer
MANY = 20  # diagnoses in the answer


def telling(about: dict[str, Any]) -> list[str]:
    """The scores that differ between runs, those that people ask for first: the end of the chain."""
    scores = about["scores"]
    moving = [name for name, found in scores.items() if found["min"] != found["max"]] or list(scores)
    asked = [n for n in reversed(moving) if any(part in n for part in SHOWN_SCORES)] or moving
    return sorted(asked, key=lambda name: -_change(scores, name))


def _change(scores: dict[str, Any], name: str) -> float:
    """How much a score changes between runs, as a part of how large its signal gets in any: a rest of 1e-6 is none."""
    signal = _signal(name)
    size = max(
        abs(found[end])
        for other, found in scores.items()
        if _signal(other) == signal
        for end in ("min", "max")
    )
    return float(round((scores[name]["max"] - scores[name]["min"]) / size, 3)) if size > 0.0 else 0.0


def _signal(score: str) -> str:
    """The signal of a score: "sensor.slew" of "sensor.slew final [deg]"."""
    return score.rpartition(" [")[0].rpartition(" ")[0]


def strongest(about: dict[str, Any], names: list[str]) -> list[tuple[str, str, float]]:
    """(score, parameter, rank correlation), the strongest first."""
    found = [
        (name, parameter, rank)
        for name in names
        for parameter, rank in about["sensitivity"].get(name, {}).items()
    ]
    return sorted(found, key=lambda item: (-abs(item[2]), item[0], item[1]))


def lines(report: "Report") -> list[str]:
    """The whole answer: what was done, each diagnosis or the scores that tell most, thresholds, files, what next."""
    about = report.about
    told = [headline(about), *threshold_lines(about)]
    rows = about.get("diagnoses", [])
    told += [_diagnosed(row) for row in rows[:MANY]]
    if len(rows) > MANY:
        told.append(f"and {len(rows) - MANY} logs more")
    names = [] if rows else telling(about)
    for name in names[:FEW]:
        found = about["scores"][name]
        told.append(f"{name}: median {found['q50']:.4g}, {found['min']:.4g} to {found['max']:.4g}")
    for name, parameter, rank in strongest(about, names)[:1]:
        told.append(f"Strongest influence: {parameter} on {name}, rank correlation {rank:.2f}")
    if len(names) > FEW:
        told.append(f"{len(about['scores']) - FEW} more scores: --verbose, or {about['files']['runs']}")
    return [*told, *(f"written: {file}" for file in about["files"].values()), f"Next: {next_step(about)}"]


def _diagnosed(row: dict[str, Any]) -> str:
    """A log, its verdict and its causes by the names that people know."""
    from cosim.lexicon import CRANE, speaking
    from cosim.report.folder import lexicon_of, read_answer
    from cosim.report.screen import known_as

    written = Path(row.get("diagnosis") or "")
    with speaking(lexicon_of(read_answer(written.parent)) if written.is_file() else CRANE):
        causes = [known_as(effect) for effect in (row.get("causes") or "").split("; ") if effect]
    verdict = (row.get("verdict") or row["status"]).replace("_", " ")
    return ", ".join([f"{row['log']}: {verdict}", *causes])


def next_step(about: dict[str, Any]) -> str:
    """What to type next."""
    runs = about["files"]["runs"]
    if about["failed"]:
        reasons = runs.with_name("batch.json")
        return f"{typed(reasons)} has the reason of each failed run; the same command with --retry-failed runs them again"
    written = [row for row in about.get("diagnoses", []) if row.get("diagnosis")]
    for row in sorted(written, key=lambda row: row.get("verdict") == "adequate")[:1]:
        folder = Path(row["diagnosis"]).parent
        return f"cosim report {typed(folder)} writes the page of {row['log']}"
    if about["task"] == "compare":
        mapping = f" --mapping {typed(about['mapping'])}" if about.get("mapping") else ""
        return (
            f"cosim diagnose {typed(about['log_files'][0])}{mapping} says what is wrong in that log and why"
        )
    look = f"{about['files']['picture']} shows them, and " if "picture" in about["files"] else ""
    return f"{look}pandas.read_parquet('{runs}') has every run in Python"
