"""The diagnosis from log to answer, on one page: prepare, localise and name block by block, extend, measure the gain."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cosim.diagnosis.chain import WINDOW, Known, fixed_values, task_for
from cosim.diagnosis.data import Record
from cosim.diagnosis.extend import closed, fitted_chain, write_extended
from cosim.diagnosis.gain import Gain, measure, run_package
from cosim.diagnosis.grid import grid_of
from cosim.diagnosis.groups import Group, GroupModel, merged
from cosim.diagnosis.heldout import Held, Refused, confirm
from cosim.diagnosis.machine import Machine, our_machine
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
from cosim.errors import DataError
from cosim.logs import Log, Tracker
from cosim.ssp.stimulus import stimulus_csv

Array = NDArray[np.float64]
Report = Callable[[str], None]

TOLERANCE = 0.01
FREE = 1.0  # relative trust when the nominal parameters are calibrated: as good as none
SHORTEST = 15.0  # s: three windows, one of them held out
FAST = 1e-3  # s: at this interval and below the drive has no news between samples


@dataclass
class Diagnosis:
    """Everything the diagnosis found.

    Attributes:
        verdict: "adequate", "explained", "partly_explained" or "unexplained".
        record: the prepared log.
        machine: the model.
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
        held: the part of the log, or the other log, on which gains are measured; None for every third window.
        held_before, held_after: as before, after, over the held-out log.
        refused: causes that the fitting log asks for and the held-out one does not bear out.
    """

    verdict: str
    record: Record
    machine: Machine
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
    held: Held | None = None
    held_before: dict[str, Array] = field(default_factory=dict)
    held_after: dict[str, Array] = field(default_factory=dict)
    refused: list[Refused] = field(default_factory=list)

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.machine.name

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


def prepare(log: Log, machine: Machine) -> Record:
    """The log in the model's units, sampled as it was measured, with the load pressure.

    Raises:
        DataError: there is no command, or the log is too short to hold anything out.
    """
    log.require(machine.drive, "anything")
    second = 1.0 if log.time_unit == "s" else machine.options.sample
    if second is None:
        raise DataError(
            f"{log.source}: the log counts samples and has no time: say in the mapping what one sample counts as, such as "
            '[diagnose] sample = "10 ms"'
        )
    if log.duration * second < SHORTEST:
        raise DataError(
            f"{log.source}: the log lasts {log.duration * second:.1f} s; a diagnosis needs at least {SHORTEST:.0f} s"
        )
    if (
        not log.uniform and log.step <= FAST
    ):  # jitter of a fast log: straight lines between its samples lose nothing
        log = log.resample(log.step)
    grid, interval = grid_of(log.time * second, machine.options.step)
    gains = {n: item.gain for n, item in machine.signals.items()}
    signals = {n: v if gains.get(n, 1.0) == 1.0 else gains[n] * v for n, v in log.signals.items()}
    if "p_load" in log:
        signals["p_load"] = log.p_load
    return Record(interval, signals, grid)


def settled(groups: tuple[Group, ...], seen: TrackerFinding | None) -> tuple[Group, ...]:
    """The groups without the effects that a tracker has settled already."""
    if seen is None:
        return groups
    known = ("sensor.gain", "sensor.bias", "sensor.drift")
    return tuple(replace(g, excluded=(*g.excluded, *known)) for g in groups)


def judge(
    groups: tuple[Group, ...],
    record: Record,
    tolerance: float,
    report: Report,
    constants: Mapping[str, float] | None = None,
    most: int = 3,
) -> tuple[dict[str, Finding], dict[str, list[str]]]:
    """Findings of all groups whose drive and first observed signal were measured; what is missing for the others.

    Args:
        groups: the groups of the model, in order.
        record: the log.
        tolerance: trust in the nominal parameters.
        report: called with a line about each group.
        constants: ``component.parameter`` -> SI that is known already, such as a sensor's scale.
        most: causes looked for in one group.
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
        finding = find(task, record, tolerance, most)
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
    model: str | Machine = "full_order",
    base: Mapping[str, float] | None = None,
    held_out: Log | None = None,
    tolerance: float = TOLERANCE,
    calibrate: bool = False,
    folder: Path | None = None,
    report: Report = lambda text: None,
) -> Diagnosis:
    """Compare a log with a model, name what the model gets wrong, extend it and measure the gain.

    Args:
        log: the log.
        tracker: the external tracker's record, on its own clock.
        model: the model, or the name of one of ours.
        base: ``component.parameter`` -> SI in which the model at hand differs from the nominal one.
        held_out: another log of the machine: gains are measured on it, and a cause that does not help there is refused.
        tolerance: standard deviation of the trust in each nominal parameter, relative.
        calibrate: fit the nominal parameters freely, so that only missing structure is a cause.
        folder: where the extended packages go; without one they are not written and the FMUs are not run.
        report: called with a line about each stage.

    Raises:
        UsageError: an unknown model.
        DataError: the log lacks the command or is too short, or the tracker does not fit to it.
    """
    machine = our_machine(model, base) if isinstance(model, str) else model
    trust = FREE if calibrate else tolerance
    record, held = parted(prepare(log, machine), machine)
    if held_out is not None:
        held = Held(prepare(held_out, machine), 0, held_out.name, held_out.sha256)
    with threadpool_limits(1):  # small matrices: more threads only wait for one another
        seen = None
        if tracker is not None:
            report("slew sensor against tracker")
            seen = compare_tracker(record, tracker)
        groups = settled(merged(machine.groups, record.signals), seen)
        constants = dict(machine.base)
        if seen:
            constants |= {n: v for n, v in seen.fit.values.items() if n.startswith("sensor.")}
        most = machine.options.causes
        findings, unjudged = judge(groups, record, trust, report, constants, most)
        if not findings and seen is None:
            missing = sorted({s for names in unjudged.values() for s in names})
            raise DataError(f"{log.source}: no block can be judged; missing signals: {', '.join(missing)}")
        refused = []
        if held is not None:
            report("causes tried on the held-out data")
            refused = [r for f in findings.values() for r in confirm(f, record, held, trust)]
        diagnosis = concluded(record, machine, findings, unjudged, seen, trust)
        diagnosis.held, diagnosis.refused = held, refused
        report("extended model")
        estimate(diagnosis, groups, trust, constants)
    if folder is not None:
        report("gain on held-out data, by the FMUs")
        gain_by_fmus(diagnosis, folder)
    return diagnosis


def parted(record: Record, machine: Machine) -> tuple[Record, Held | None]:
    """The part of a log that is fitted, and the log with the part that the mapping holds out.

    Raises:
        DataError: nothing is left to fit, or nothing is held out.
    """
    start = machine.options.held_out_from
    if start is None:
        return record, None
    first = int(np.searchsorted(record.time, start * (machine.options.sample or 1.0) * (1.0 - 1e-12)))
    if first * record.h < SHORTEST or first > record.time.size - 2:
        raise DataError(
            f"diagnose.held_out_from = {start:g} leaves too little of the log to fit or to hold out"
        )
    return record.until(first), Held(record, first)


def concluded(
    record: Record,
    machine: Machine,
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
    return Diagnosis(verdict, record, machine, findings, unjudged, named, left, never, tracker=seen)


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
    mask = ~held_windows(count) if diagnosis.held is None else None
    chain = fitted_chain(groups, diagnosis.record, rules, effects, near, start, tolerance, mask, constants)
    diagnosis.values = constants | {n: v for n, v in chain.values.items() if n not in start}
    diagnosis.deviations = chain.deviations
    diagnosis.start = {n: chain.values[n] for n in start}


def gain_by_fmus(diagnosis: Diagnosis, folder: Path) -> None:
    """Write both packages, run their FMUs on the log's command, and measure the errors on what was held out."""
    machine, record, held = diagnosis.machine, diagnosis.record, diagnosis.held
    folder.mkdir(parents=True, exist_ok=True)
    stimulus = None
    if closed(machine.source) and record.grid is None:
        stimulus = stimulus_csv(record.time, record.signals[machine.drive])
    values = diagnosis.values | diagnosis.start
    nominal = write_extended(machine.source, machine.values, folder / "nominal", None)["open"]
    diagnosis.packages = write_extended(machine.source, values, folder, stimulus)
    extended = diagnosis.packages["open"]
    diagnosis.before = run_package(nominal, record, machine, diagnosis.start)
    diagnosis.after = run_package(extended, record, machine, {})
    if held is None:
        diagnosis.gains = measure(record, diagnosis.before, diagnosis.after, window_of(diagnosis))
        return
    start = {n: v for g in machine.groups for n, v in fixed_values(held.record, g).items()}
    diagnosis.held_before = run_package(nominal, held.record, machine, start)
    diagnosis.held_after = run_package(extended, held.record, machine, start)
    window = window_of(diagnosis)
    diagnosis.gains = measure(held.record, diagnosis.held_before, diagnosis.held_after, window, held.first)


def window_of(diagnosis: Diagnosis) -> int:
    """Samples in a window: those of the fits, so that what they left out is what is judged."""
    for finding in diagnosis.findings.values():
        for rule in finding.task.rules.values():
            return rule.bins * rule.window
    return round(WINDOW / diagnosis.record.h)
