"""The slew sensor beside the external tracker (fig. 5.16 of the source), once the tracker's clock is known."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.beside.extended import Readings
from cosim.compare.metrics import rms
from cosim.compare.picture import BAND, ERROR, MEASURED, SIMULATED, write_figure
from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.tracker.comparison import TrackerFinding, compare_tracker
from cosim.diagnosis.tracker.model import NOMINAL, SEAM, SEAM_ANGLE
from cosim.logs import Log, load_tracker

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
DEG = float(np.pi / 180.0)
NORMAL = 1.959964
NEAR = 5.0  # times the noise of a reading within which the seam leaves its side open
BIAS, TOGETHER = "sensor.bias", "tracker.seam - sensor.bias"
# parameter: unit people read, factor to it, what it is
SHOWN = {
    "tracker.offset": ("s", 1.0, "time of the log at the tracker's zero"),
    "tracker.rate": ("1", 1.0, "seconds of the log per second of the tracker"),
    "tracker.seam": ("deg", 1.0 / DEG, "added below 12 deg (marker model 1)"),
    "sensor.gain": ("1", 1.0, "slew sensor per true angle"),
    "sensor.bias": ("deg", 1.0 / DEG, "slew sensor at angle zero"),
    "sensor.drift": ("deg/s", 1.0 / DEG, "of the slew sensor"),
    TOGETHER: ("deg", 1.0 / DEG, "tracker minus slew sensor below 12 deg; either, or both"),
}
HEADS = ("", "value", "+- (95 %)", "unit", "what")


@dataclass(frozen=True)
class TrackerRun:
    """A tracker's record laid over a log.

    Attributes:
        finding: what was found.
        log: the log's file and the tracker's.
        time: (m,) instants of the log at which the tracker reads, s.
        sensor: (m,) slew sensor at these instants, rad.
        reading: (m,) tracker, rad.
        corrected: (m,) tracker less its seam minus slew sensor less its errors, rad.
    """

    finding: TrackerFinding
    log: tuple[Path, Path]
    time: Array = field(repr=False)
    sensor: Array = field(repr=False)
    reading: Array = field(repr=False)
    corrected: Array = field(repr=False)

    @property
    def difference(self) -> Array:
        """(m,) slew sensor minus tracker, synchronised and nothing else, rad."""
        return self.sensor - self.reading

    @property
    def below(self) -> bool:
        """Whether the motion stays below the seam, so that seam and bias are one number."""
        unknown = not np.isfinite(self.finding.everything.deviations[SEAM])
        return unknown and SEAM not in self.finding.never


def run_tracker(log: Log, file: Path) -> TrackerRun:
    """Lay a tracker's record over a log and find clock, seam and sensor errors.

    Raises:
        DataError: a file is bad, the log has no slew, or the two cannot be laid over each other.
    """
    log.require("slew", "the tracker")
    tracker = load_tracker(file)
    even = log if log.uniform else log.resample(log.step)
    record = Record(even.step, {"slew": even["slew"]})
    finding = compare_tracker(record, tracker)
    time = finding.time + even.time[0]
    sensor = np.interp(finding.time, record.time, even["slew"])
    return TrackerRun(
        finding, (log.source, file), time, sensor, finding.measured, finding.measured - finding.predicted
    )


def readings_of(run: TrackerRun) -> Readings:
    """The tracker's readings on the log's clock, its seam taken out, for the extended observer.

    On which side of the seam a reading lies is told by the slew sensor less its errors; those too near to it are left out.
    """
    found = run.finding.fit.values
    seam, time = found.get(SEAM, 0.0), run.finding.time
    drift = found.get("sensor.drift", 0.0) * time
    true = (run.sensor - found.get(BIAS, 0.0) - drift) / found.get("sensor.gain", 1.0)
    sure = np.abs(true - SEAM_ANGLE) > NEAR * run.finding.noise if seam else np.ones(true.size, dtype=bool)
    angle = run.reading - np.where(true < SEAM_ANGLE, seam, 0.0)
    return Readings(time[sure], angle[sure], run.finding.noise)


def estimates(run: TrackerRun) -> dict[str, tuple[float, float, bool]]:
    """Parameter -> (value, standard deviation, whether it differs from nothing wrong), SI.

    Errors that were not accepted come from the fit of everything, so that a reader sees how small they are. Where the motion
    stays below the seam, seam and bias have no size of their own, accepted or not; the size of their sum has.
    """
    fit, all_of_them = run.finding.fit, run.finding.everything
    found = {
        n: (fit.values[n], fit.deviations[n], True)
        if n in fit.values
        else (all_of_them.values[n], all_of_them.deviations[n], False)
        for n in NOMINAL
    }
    if run.below:
        for n in (SEAM, BIAS):
            found[n] = (found[n][0], float("nan"), found[n][2])
        found[TOGETHER] = together(fit if {SEAM, BIAS} & set(fit.values) else all_of_them, fit)
    return found


def together(source: Fit, accepted: Fit) -> tuple[float, float, bool]:
    """Tracker minus slew sensor below the seam, seam - bias / gain, its standard deviation, rad; whether it was accepted."""
    names = list(source.values)
    slopes = np.zeros(len(names))
    for name, slope in ((SEAM, 1.0), (BIAS, -1.0 / source.values.get("sensor.gain", 1.0))):
        if name in names:
            slopes[names.index(name)] = slope
    value = float(slopes @ np.array([source.values[n] for n in names]))
    return value, float(np.sqrt(slopes @ source.covariance @ slopes)), source is accepted


def rows(run: TrackerRun) -> list[list[object]]:
    """Rows of the table."""
    found: list[list[object]] = []
    for name, (value, deviation, accepted) in estimates(run).items():
        unit, scale, text = SHOWN[name]
        if not np.isfinite(deviation):
            found.append([name, "-", "-", unit, f"{text}: not determined"])
            continue
        digits = max(3, int(np.ceil(np.log10(max(abs(value / max(deviation, 1e-300)), 1.0)))) + 2)
        what = text if accepted else f"{text}: none found"
        found.append([name, f"{value * scale:.{digits}g}", f"{NORMAL * deviation * scale:.2g}", unit, what])
    return found


def answer(run: TrackerRun) -> str:
    """Where sensor and tracker differ, in a sentence: every error that was found, with half its 95 % interval."""
    found = []
    for name, (value, deviation, accepted) in estimates(run).items():
        if not accepted or not np.isfinite(deviation):
            continue
        unit, scale, text = SHOWN[name]
        digits = max(3, int(np.ceil(np.log10(max(abs(value / max(deviation, 1e-300)), 1.0)))) + 2)
        known = f"{value * scale:.{digits}g} +- {NORMAL * deviation * scale:.2g}"
        found.append(f"{name} {known}{'' if unit == '1' else ' ' + unit} ({text})")
    wrong = [text for text in found if not text.startswith(("tracker.offset", "tracker.rate"))]
    clock = [text for text in found if text not in wrong]
    return (
        f"Slew sensor and tracker: {'; '.join(wrong) if wrong else 'the two agree, no error of either is found'}"
        + (f"; the tracker's clock: {'; '.join(clock)}" if clock else "")
        + " (95 %)"
    )


def lines(run: TrackerRun) -> list[str]:
    """What stands below the table, one sentence each."""
    finding = run.finding
    found = [
        f"{finding.measured.size} readings overlap with the log; noise of one {finding.noise / DEG:.3g} deg; slew sensor "
        f"minus tracker {rms(run.difference) / DEG:.3g} deg rms, {rms(run.corrected) / DEG:.3g} deg with the errors above "
        "taken out. The intervals are the Cramer-Rao bound for this noise."
    ]
    if run.below:
        found.append(
            f"The motion stays below {SEAM_ANGLE / DEG:g} deg: a seam cannot be told from a bias of the sensor, only "
            f"{TOGETHER} is known. Let it pass {SEAM_ANGLE / DEG:g} deg to tell them apart."
        )
    elif finding.seam_angle is not None:
        best, low, high = (x / DEG for x in finding.seam_angle)
        found.append(
            f"The seam fits best at {best:.4g} deg (95 %: {low:.4g} to {high:.4g}); the two marker models are said to meet "
            f"at {SEAM_ANGLE / DEG:g} deg."
        )
    elif not np.isfinite(finding.everything.deviations[SEAM]):
        found.append(
            f"The motion stays above {SEAM_ANGLE / DEG:g} deg, where a seam does not show; there may be one."
        )
    return found


def as_data(run: TrackerRun) -> dict[str, Any]:
    """The run as plain data; parameters in SI."""
    finding = run.finding
    angle = finding.seam_angle
    return {
        "file": run.log[1],
        "parameters": [
            {
                "name": name,
                "value": value if np.isfinite(deviation) else None,
                "deviation": deviation if np.isfinite(deviation) else None,
                "ci95": [value - NORMAL * deviation, value + NORMAL * deviation]
                if np.isfinite(deviation)
                else None,
                "accepted": accepted,
                "unit": {"deg": "rad", "deg/s": "rad/s"}.get(SHOWN[name][0], SHOWN[name][0]),
            }
            for name, (value, deviation, accepted) in estimates(run).items()
        ],
        "seam_angle": None
        if angle is None or run.below
        else {"value": angle[0], "ci95": list(angle[1:]), "unit": "rad"},
        "causes": [cause.effect.name for cause in finding.causes],
        "indistinguishable_from": {
            cause.effect.name: sorted(
                {
                    *cause.indistinguishable,
                    *({SEAM, BIAS} if run.below and cause.effect.name in (SEAM, BIAS) else ()),
                }
                - {cause.effect.name}
            )
            for cause in finding.causes
        },
        "readings": finding.measured.size,
        "noise": finding.noise,
        "rms_difference": rms(run.difference),
        "rms_corrected": rms(run.corrected),
        "unit": "rad",
    }


def write_picture(run: TrackerRun, path: Path) -> Path:
    """Draw sensor, tracker and difference into a file."""
    return write_figure(lambda: tracker_figure(run), path)


def tracker_figure(run: TrackerRun) -> "Figure":
    """Both angles over time, their difference over time, and the difference over the angle with the seam."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    upper, middle, lower = figure.subplots(3, 1, height_ratios=[2.0, 1.2, 1.2])
    upper.plot(run.time, run.sensor / DEG, color=SIMULATED, linewidth=1.2, label="slew sensor")
    upper.plot(
        run.time, run.reading / DEG, color=ERROR, linewidth=0.9, linestyle="--", label="tracker, synchronised"
    )
    upper.set_ylabel("slew [deg]")
    band = 2.0 * run.finding.noise / DEG
    for axes, x, label in ((middle, run.time, "time [s]"), (lower, run.reading / DEG, "tracker [deg]")):
        axes.axhspan(-band, band, color=BAND, alpha=0.6, linewidth=0.0, label="noise of a reading, ±2 sd")
        axes.plot(x, run.difference / DEG, ".", color=MEASURED, markersize=1.5, label="slew sensor - tracker")
        axes.plot(x, -run.corrected / DEG, ".", color=ERROR, markersize=1.2, label="errors taken out")
        axes.set_xlabel(label)
        axes.set_ylabel("difference [deg]")
    upper.axhline(SEAM_ANGLE / DEG, color=MEASURED, linewidth=0.8, linestyle=":")
    lower.axvline(SEAM_ANGLE / DEG, color=MEASURED, linewidth=0.8, linestyle=":")
    upper.legend(loc="upper right")
    middle.legend(loc="center right", markerscale=5.0, frameon=True)
    parts = []
    for name, (value, deviation, accepted) in estimates(run).items():
        unit, scale, _ = SHOWN[name]
        if accepted and np.isfinite(deviation):
            short = name if name == TOGETHER else name.partition(".")[2]
            parts.append(f"{short} {value * scale:.6g} {unit.removesuffix('1')}".rstrip())
    upper.set_title(", ".join(parts), loc="left")
    figure.suptitle(f"Slew sensor of {run.log[0].name} and tracker {run.log[1].name}", fontsize=11)
    return figure
