"""The diagnosis from log to answer, on one page: prepare, localise and name block by block, extend, measure the gain."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cosim.diagnosis.chain import WINDOW, Known, task_for
from cosim.diagnosis.data import Record
from cosim.diagnosis.extend import fitted_chain, write_extended
from cosim.diagnosis.gain import Gain, measure, run_package
from cosim.diagnosis.groups import MODELS, Group, GroupModel, merged
from cosim.diagnosis.naming import Finding, find
from cosim.diagnosis.noise import Whitener
from cosim.diagnosis.tracker import TrackerFinding, compare_tracker
from cosim.diagnosis.verdict import (
    Cause,
    Rest,
    adequate,
    causes,
    held_windows,
    never_exercised,
    rests,
    stands,
)
from cosim.errors import DataError, UsageError
from cosim.logs import Log, Tracker
from cosim.ssp.stimulus import stimulus_csv
from fmus import registry

Array = NDArray[np.float64]
Report = Callable[[str], None]

TOLERANCE = 0.01
FREE = 1.0  # relative trust when the nominal parameters are calibrated: as good as none
SHORTEST = 15.0  # s: three windows, one of them held out


@dataclass
class Diagnosis:
    """Everything the diagnosis found.

    Attributes:
        verdict: "adequate", "explained", "partly_explained" or "unexplained".
        record: the prepared log.
        model: name of the model.
        findings: group -> what was found in it, for the groups that could be judged.
        unjudged: group -> the signals whose absence keeps it from being judged.
        causes: named causes, the largest gain first.
        rests: what stays unexplained.
        never: effects that the log could not have shown.
        values: ``component.parameter`` -> value of the extended model, SI.
        deviations: standard deviation of those estimated.
        start: the start angle.
        before, after: signals of the nominal and the extended model's FMUs on the log's command.
        gains: signal -> error on held-out windows.
        packages: files of the extended model.
        tracker: what the external tracker says, if there was one.
    """

    verdict: str
    record: Record
    model: str
    findings: dict[str, Finding]
    unjudged: dict[str, list[str]]
    causes: list[Cause]
    rests: list[Rest]
    never: list[str]
    values: dict[str, float] = field(default_factory=dict)
    deviations: dict[str, float] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    before: dict[str, Array] = field(default_factory=dict)
    after: dict[str, Array] = field(default_factory=dict)
    gains: dict[str, Gain] = field(default_factory=dict)
    packages: dict[str, Path] = field(default_factory=dict)
    tracker: TrackerFinding | None = None

    @property
    def noise(self) -> dict[str, float]:
        """Signal -> size of its noise per sample, SI: what is left where everything is explained."""
        return {
            s: float(np.std(high_pass(self.record.signals[s])))
            for f in self.findings.values()
            for s in f.task.rules
        }


def high_pass(signal: Array) -> Array:
    """Second differences scaled to the size of white noise: what no drive of this bandwidth can produce."""
    return np.diff(signal, 2) / np.sqrt(6.0)


def prepare(log: Log) -> Record:
    """The log on a uniform step, at least as fine as a millisecond, with the load pressure.

    Raises:
        DataError: there is no command, or the log is too short to hold anything out.
    """
    log.require("u", "anything")
    if log.duration < SHORTEST:
        raise DataError(
            f"{log.source}: the log lasts {log.duration:.1f} s; a diagnosis needs at least {SHORTEST:.0f} s"
        )
    even = log if log.uniform and log.step <= 1e-3 else log.resample(min(log.step, 1e-3))
    signals = dict(even.signals)
    if "p_load" in even:
        signals["p_load"] = even.p_load
    return Record(even.step, signals)


def settled(groups: tuple[Group, ...], seen: TrackerFinding | None) -> tuple[Group, ...]:
    """The groups without the effects that a tracker has settled already."""
    if seen is None:
        return groups
    return tuple(replace(g, excluded=("sensor.gain", "sensor.bias", "sensor.drift")) for g in groups)


def judge(
    groups: tuple[Group, ...],
    record: Record,
    tolerance: float,
    report: Report,
    constants: Mapping[str, float] | None = None,
) -> tuple[dict[str, Finding], dict[str, list[str]]]:
    """Findings of all groups whose drive and first observed signal were measured; what is missing for the others.

    Args:
        groups: the groups of the model, in order.
        record: the log.
        tolerance: trust in the nominal parameters.
        report: called with a line about each group.
        constants: ``component.parameter`` -> SI that is known already, such as a sensor's scale.
    """
    findings: dict[str, Finding] = {}
    unjudged: dict[str, list[str]] = {}
    known: list[Known] = []
    for group in groups:
        missing = [s for s in (group.drive, *group.observed[:1]) if s not in record.signals]
        if missing:
            unjudged[group.name] = missing
            known = []
            continue
        report(f"{group.name}: {len(group.effects())} candidates")
        # mechanics integrate: what upstream is known to deliver drives them; elsewhere the measured signal does
        task = task_for(group, record, known if group.integrates else [])
        settle(task.model, constants or {})
        finding = find(task, record, tolerance)
        findings[group.name] = finding
        upstream = known if not known or known[-1].model.group.observed[0] == group.drive else []
        known = [*upstream, Known(finding.task.model, finding.chosen.fit)] if adequate(finding) else []
    return findings, unjudged


def settle(model: GroupModel, constants: Mapping[str, float]) -> None:
    """Take over what is known already; the start angle was read through the sensor."""
    own = {n: v for n, v in constants.items() if n.partition(".")[0] in model.group.components}
    if own:
        for name in [n for n in model.fixed if n.endswith(".theta_0")]:
            model.fixed[name] = (model.fixed[name] - own.get("sensor.bias", 0.0)) / own.get(
                "sensor.gain", 1.0
            )
        model.fixed = model.fixed | own


def verdict_of(findings: Mapping[str, Finding], named: list[Cause], left: list[Rest]) -> str:
    """One word for the whole."""
    if not named:
        return "unexplained" if left else "adequate"
    return "partly_explained" if left else "explained"


def diagnose(
    log: Log,
    *,
    tracker: Tracker | None = None,
    model: str = "full_order",
    base: Mapping[str, float] | None = None,
    tolerance: float = TOLERANCE,
    calibrate: bool = False,
    folder: Path | None = None,
    report: Report = lambda text: None,
) -> Diagnosis:
    """Compare a log with a model, name what the model gets wrong, extend it and measure the gain.

    Args:
        log: the log.
        tracker: the external tracker's record, on its own clock.
        model: name of the model.
        base: ``component.parameter`` -> SI in which the model at hand differs from the nominal one.
        tolerance: standard deviation of the trust in each nominal parameter, relative.
        calibrate: fit the nominal parameters freely, so that only missing structure is a cause.
        folder: where the extended packages go; without one they are not written and the FMUs are not run.
        report: called with a line about each stage.

    Raises:
        UsageError: an unknown model.
        DataError: the log lacks the command or is too short, or the tracker does not fit to it.
    """
    if model not in MODELS:
        raise UsageError(f"no model '{model}' for the diagnosis; {registry.suggestion(model, list(MODELS))}")
    trust = FREE if calibrate else tolerance
    record = prepare(log)
    with threadpool_limits(1):  # small matrices: more threads only wait for one another
        seen = None
        if tracker is not None:
            report("slew sensor against tracker")
            seen = compare_tracker(record, tracker)
        groups = settled(merged(MODELS[model], record.signals), seen)
        constants = dict(base or {})
        if seen:
            constants |= {n: v for n, v in seen.fit.values.items() if n.startswith("sensor.")}
        findings, unjudged = judge(groups, record, trust, report, constants)
        if not findings and seen is None:
            missing = sorted({s for names in unjudged.values() for s in names})
            raise DataError(f"{log.source}: no block can be judged; missing signals: {', '.join(missing)}")
        diagnosis = concluded(record, model, findings, unjudged, seen, trust)
        report("extended model")
        estimate(diagnosis, groups, trust, constants)
    if folder is not None:
        report("gain on held-out data, by the FMUs")
        gain_by_fmus(diagnosis, folder, base or {})
    return diagnosis


def concluded(
    record: Record,
    model: str,
    findings: dict[str, Finding],
    unjudged: dict[str, list[str]],
    seen: TrackerFinding | None,
    tolerance: float,
) -> Diagnosis:
    """Causes, what stays unexplained, what was never exercised, and the verdict."""
    named = [c for f in findings.values() for c in causes(f, tolerance)] + (seen.causes if seen else [])
    named.sort(key=lambda c: -c.gain)
    left = [rest for f in findings.values() for rest in rests(f, tolerance)]
    never = [name for f in findings.values() for name in never_exercised(f, tolerance)]
    never += [] if seen else ["tracker.clock", "tracker.seam"]
    verdict = verdict_of(findings, named, left)
    return Diagnosis(verdict, record, model, findings, unjudged, named, left, never, tracker=seen)


def estimate(
    diagnosis: Diagnosis, groups: tuple[Group, ...], tolerance: float, constants: dict[str, float]
) -> None:
    """Values of the extended model, from all windows but the held-out ones.

    Where every block is understood they are fitted together, driven by the command alone; otherwise block by block, so
    that a block that is not understood does not bend the others.
    """
    findings = diagnosis.findings
    effects = tuple(c.effect for c in diagnosis.causes if c.group in findings)
    near: dict[str, float] = {}
    deviations: dict[str, float] = {}
    start: dict[str, float] = {}
    rules: dict[str, Whitener] = {}
    for finding in findings.values():
        fit = (finding.chosen if stands(finding) else finding.null).fit
        start |= {n: v for n, v in finding.task.model.fixed.items() if n.endswith(".theta_0")}
        near |= fit.values
        deviations |= fit.deviations
        rules |= finding.task.rules
    diagnosis.values, diagnosis.deviations, diagnosis.start = constants | near, deviations, start
    if diagnosis.rests or diagnosis.unjudged or not findings:
        return
    count = min(r.windows(diagnosis.record.signals[s]).shape[0] for s, r in rules.items())
    chain = fitted_chain(
        groups, diagnosis.record, rules, effects, near, start, tolerance, ~held_windows(count), constants
    )
    diagnosis.values = constants | {n: v for n, v in chain.values.items() if n not in start}
    diagnosis.deviations = chain.deviations
    diagnosis.start = {n: chain.values[n] for n in start}


def gain_by_fmus(diagnosis: Diagnosis, folder: Path, base: Mapping[str, float]) -> None:
    """Write both packages, run their FMUs on the log's command, and measure the errors on held-out windows."""
    record = diagnosis.record
    folder.mkdir(parents=True, exist_ok=True)
    stimulus = stimulus_csv(record.time, record.signals["u"])
    nominal = write_extended(diagnosis.model, base, folder / "nominal", None)
    diagnosis.packages = write_extended(diagnosis.model, diagnosis.values | diagnosis.start, folder, stimulus)
    diagnosis.before = run_package(nominal["open"], record, diagnosis.start)
    diagnosis.after = run_package(diagnosis.packages["open"], record, {})
    diagnosis.gains = measure(record, diagnosis.before, diagnosis.after, window_of(diagnosis))


def window_of(diagnosis: Diagnosis) -> int:
    """Samples in a window: those of the fits, so that what they left out is what is judged."""
    for finding in diagnosis.findings.values():
        for rule in finding.task.rules.values():
            return rule.bins * rule.window
    return round(WINDOW / diagnosis.record.h)
