"""The scorecard of the blind suite: counts, Wilson bounds and the confusion matrix."""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from scipy.stats import binomtest

from benchmarks.blind.cases import FORMS
from benchmarks.blind.sizes import GROUP_OF, UNKNOWN
from cosim.diagnosis.fitting.phases import usual
from cosim.rig.parameters import nominal_value
from fmus import registry

Row = dict[str, Any]
DETECTABLE = (
    20.0  # log-likelihood that the truth must gain for a weak effect to count (the scorecard's own bound)
)


@dataclass(frozen=True)
class Metric:
    """One line of the scorecard.

    Attributes:
        name: what is measured.
        target: as the scorecard states it.
        hits, count: cases, or `value` where it is no share.
    """

    name: str
    target: str
    hits: int = 0
    count: int = 0
    value: float | None = None

    def plain(self) -> dict[str, Any]:
        """As plain data, with the 95 % Wilson interval of a share."""
        row: dict[str, Any] = {"metric": self.name, "target": self.target, "cases": self.count}
        if self.value is not None:
            return row | {"value": None if math.isnan(self.value) else self.value}
        if not self.count:
            return row | {"value": None}
        bounds = binomtest(self.hits, self.count).proportion_ci(0.95, "wilson")
        return row | {"value": self.hits / self.count, "low": float(bounds.low), "high": float(bounds.high)}


def names(row: Row) -> list[str]:
    """Effects that were named, in order."""
    return [c["effect"] for c in row["causes"]]


def true_names(row: Row) -> list[str]:
    """Effects that were hidden."""
    return list(row["case"]["hidden"])


def reported(row: Row) -> set[str]:
    """The named effects and those declared indistinguishable from them."""
    return {n for c in row["causes"] for n in (c["effect"], *c["alike"])}


def detectable(row: Row, measure: str = "gain") -> bool:
    """True if the truth gains enough in this log; sampling effects are seen otherwise and always count."""
    marked = any(n in ("sensor.quantisation", "sensor.dropout") for n in true_names(row))
    return (marked or bool(row["truth"])) and all(v[measure] >= DETECTABLE for v in row["truth"].values())


def noise_leaves_it(row: Row) -> bool:
    """True if the truth would gain enough in this log for one who knows the noise."""
    known = row.get("noise_known") or {}
    return bool(known) and all(gain >= DETECTABLE for gain in known.values())


def both_detectable(row: Row) -> bool:
    """True if each of several effects gains enough beyond the others in this log."""
    return detectable(row, "least")


def first(row: Row) -> bool:
    """True if the hidden effect is named first, or stands in the class declared indistinguishable from the first."""
    if not row["causes"]:
        return False
    best = row["causes"][0]
    return true_names(row)[0] in (best["effect"], *best["alike"])


def strictly_first(row: Row) -> bool:
    """True if the hidden effect itself is named first and nothing else is named."""
    return names(row) == true_names(row)


def true_block(row: Row) -> str:
    """Group in which the hidden effect shows."""
    name = true_names(row)[0]
    return UNKNOWN.get(name) or GROUP_OF[name]


def honest(row: Row) -> bool:
    """True if an unknown cause is called unexplained in its block and nothing is named there."""
    block = true_block(row)
    return any(r["block"] == block for r in row["rests"]) and not any(
        c["group"] == block for c in row["causes"]
    )


def knowable(row: Row) -> bool:
    """True if the log can tell the hidden cause, unknown to the library, from what the library offers instead."""
    return bool(row["truth"]) and all(v["ahead"] >= DETECTABLE for v in row["truth"].values())


def shown(row: Row) -> bool:
    """False if the motion never crosses the tracker's seam that is hidden: nothing could show it."""
    return "tracker.seam" not in row["case"]["hidden"] or bool(row.get("crossed", True))


def errors(rows: Iterable[Row]) -> tuple[list[float], list[bool]]:
    """Relative errors of the sizes of named effects, and whether each 95 % interval holds the truth."""
    sizes, held = [], []
    for row in rows:
        for cause in row["causes"]:
            component = cause["effect"].partition(".")[0]
            effect = registry.effects()[cause["effect"]]
            true = row["case"]["hidden"].get(cause["effect"], {})
            true = usual(effect, true) if true else {}
            for i, (parameter, value) in enumerate(true.items()):
                estimate, deviation = cause["parameters"].get(parameter, (math.nan, math.nan))
                if not deviation > 0.0:
                    continue
                phase = parameter in effect.free and effect.free[parameter].phase
                off = abs(math.remainder(estimate - value, math.tau) if phase else estimate - value)
                held.append(off <= 1.96 * deviation)
                if i == 0:
                    change = value - nominal_value(f"{component}.{parameter}")
                    sizes.append(off / max(abs(change), 1e-300))
    return sizes, held


def share(name: str, target: str, chosen: list[Row], test: Callable[[Row], bool]) -> Metric:
    """A line that counts cases."""
    return Metric(name, target, sum(test(r) for r in chosen), len(chosen))


def middle(name: str, target: str, values: list[float], at: float = 0.5) -> Metric:
    """A line with a quantile."""
    value = sorted(values)[min(int(at * len(values)), len(values) - 1)] if values else math.nan
    return Metric(name, target, count=len(values), value=value)


def of(rows: list[Row], kind: str, *more: Callable[[Row], bool]) -> list[Row]:
    """The cases of one kind that pass all tests."""
    return [r for r in rows if r["case"]["kind"] == kind and all(m(r) for m in more)]


def scorecard(all_rows: list[Row]) -> list[Metric]:
    """All lines of the scorecard."""
    rows = [r for r in all_rows if "error" not in r]
    return [
        *single_lines(rows),
        *honesty_lines(rows),
        *size_lines(rows),
        Metric("cases that failed with an error", "0", len(all_rows) - len(rows), len(all_rows)),
    ]


def single_lines(rows: list[Row]) -> list[Metric]:
    """One hidden effect that the log can show."""
    large = of(rows, "single", lambda r: r["case"]["size"] != "weak", detectable)
    weak = of(rows, "single", lambda r: r["case"]["size"] == "weak", detectable)
    named = [r for r in large + weak if r["causes"]]
    mean_set = sum(len(reported(r)) for r in named) / len(named) if named else math.nan
    return [
        share("cause named first or declared alike, moderate and strong", ">= 97 %", large, first),
        share("cause named alone and exactly, moderate and strong", "-", large, strictly_first),
        share("cause named first or declared alike, weak but detectable", ">= 90 %", weak, first),
        share(
            "cause named first or declared alike, all sizes, where the noise leaves as much to see",
            "-",
            of(rows, "single", noise_leaves_it),
            first,
        ),
        share(
            "cause named first or declared alike, or said to be more than the log could show",
            "-",
            of(rows, "single"),
            lambda r: first(r) or true_names(r)[0] in r.get("never", ()),
        ),
        share("true cause in the reported set", ">= 99 %", named, lambda r: true_names(r)[0] in reported(r)),
        Metric("mean size of the reported set", "<= 1.5", count=len(named), value=mean_set),
        share("block right", ">= 98 %", named, lambda r: r["causes"][0]["group"] == true_block(r)),
    ]


def honesty_lines(rows: list[Row]) -> list[Metric]:
    """Clean logs, unknown causes, several causes, and friction of another law."""
    clean, left_out = of(rows, "clean"), of(rows, "left_out", knowable)
    understood = of(rows, "single", detectable) + clean
    pairs = [r for k in ("pair_across", "pair_within") for r in of(rows, k, both_detectable)]
    unknown = "unexplained in its block, none named there"
    return [
        share("a cause named in a clean log", "<= 1 %", clean, lambda r: bool(r["causes"])),
        share("clean log called adequate", "-", clean, lambda r: r["verdict"] == "adequate"),
        share(f"unknown cause (rig) {unknown}", "-", of(rows, "unknown"), honest),
        share("the same, where the log can tell", ">= 95 %", of(rows, "unknown", knowable), honest),
        share("unknown cause (left out, where the log can tell) likewise", ">= 95 %", left_out, honest),
        share("false 'unexplained' (clean or known cause)", "<= 2 %", understood, lambda r: bool(r["rests"])),
        share("two effects, exactly", ">= 90 %", pairs, lambda r: set(names(r)) == set(true_names(r))),
        share(
            "two effects, both in the reported set", "-", pairs, lambda r: set(true_names(r)) <= reported(r)
        ),
        share(
            "with a tracker: named first, moderate and strong",
            ">= 97 %",
            of(rows, "tracker", lambda r: r["case"]["size"] != "weak", shown),
            first,
        ),
        share(
            "a seam that the motion never crosses is said not to be exercised",
            "-",
            of(rows, "tracker", lambda r: not shown(r)),
            lambda r: "tracker.seam" in r.get("never", ()),
        ),
        *(
            share(f"friction of another form ({form}): {words}", "-", of(rows, form), right)
            for form in FORMS
            for words, right in (("named first or declared alike", first), ("named alone and exactly", alone))
        ),
    ]


def alone(row: Row) -> bool:
    """True if the hidden effects are named, no other one is, and nothing stays unexplained."""
    return set(names(row)) == set(true_names(row)) and not row["rests"]


def size_lines(rows: list[Row]) -> list[Metric]:
    """Estimates, gains and times."""
    sizes, _ = errors(r for r in of(rows, "single") if r["case"]["size"] == "moderate")
    _, held = errors(of(rows, "single"))
    ratios = [after / max(before, 1e-300) for r in rows for before, after in r["fmu_gain"].values()]
    cpu = [r["cpu_seconds"] for r in rows]
    return [
        middle("parameter error of the size, moderate, median", "<= 5 %", sizes),
        Metric("95 % intervals that hold the truth", "90-98 %", sum(held), len(held)),
        middle("held-out RMS by the FMUs, after to before, median", "-", ratios),
        middle("held-out RMS by the FMUs over the noise, named exactly, median", "<= 1.05", over_noise(rows)),
        middle("held-out RMS by the FMUs over the noise, named exactly, 95 %", "-", over_noise(rows), 0.95),
        middle("seconds a case, median", "<= 30 s", [r["seconds"] for r in rows]),
        middle("CPU seconds a case, median", "-", cpu),
        middle("CPU seconds a case, 95 %", "-", cpu, 0.95),
    ]


def over_noise(rows: list[Row]) -> list[float]:
    """Held-out RMS of the extended model by the sensors' noise, each signal of the cases whose one cause was named."""
    named = [r for r in of(rows, "single", strictly_first) if r["case"]["hidden"]]
    return [
        after / r["noise"][s] for r in named for s, (_, after) in r["fmu_gain"].items() if r["noise"].get(s)
    ]


def confusion(rows: list[Row]) -> dict[str, Counter[str]]:
    """Hidden effect -> how often each answer was given, single detectable effects and clean logs."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        if "error" in row or row["case"]["kind"] not in ("single", "clean", "unknown", "left_out"):
            continue
        if row["case"]["kind"] == "single" and not detectable(row):
            continue
        hidden = "+".join(true_names(row)) or "clean"
        if row["case"]["kind"] == "left_out":
            hidden = f"({hidden})"
        said = " + ".join(names(row)) or row["verdict"]
        found.setdefault(hidden, Counter())[said] += 1
    return dict(sorted(found.items()))
