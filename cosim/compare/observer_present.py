"""The observer's run for people (table, picture) and programs (plain data)."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.compare.observer import ANGLE, DERIVATIVE_WINDOW, RATE, REFERENCE, SETTLING, ObserverRun
from cosim.compare.picture import ERROR, MEASURED, SIMULATED, write_figure
from cosim.signals import SIGNALS
from cosim.units import factor

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def shown(signal: str) -> tuple[str, float]:
    """Unit in which people read an estimate, and the factor to it."""
    item = SIGNALS[signal]
    return item.unit, factor(item.si, item.unit)


def as_data(run: ObserverRun) -> dict[str, Any]:
    """The run as plain data, numbers in each trace's ``unit``."""
    rows = []
    for trace in run.traces:
        unit, scale = shown(trace.estimate)
        rows.append(
            {
                "estimate": trace.estimate,
                "against": trace.against,
                "unit": unit,
                "rmse": trace.rmse * scale,
                "largest": trace.largest * scale,
                "fit_percent": trace.fit_percent,
                "lag": trace.lag,
                "error_of_reference": None if trace.floor is None else trace.floor * scale,
            }
        )
    return {
        "traces": rows,
        "real_time_factor": run.real_time_factor,
        "step_seconds": run.step_seconds,
        "step_size": run.step,
        "settling": SETTLING,
        "notes": run.notes,
    }


SIGNAL_NAMES = {ANGLE: "slew angle", RATE: "slew speed"}


def answer(run: ObserverRun) -> list[str]:
    """How far the estimates are off, a sentence for each comparison, and how sure that is."""
    found = []
    for trace in run.traces:
        unit, scale = shown(trace.estimate)
        text = (
            f"Observer: its {SIGNAL_NAMES[trace.estimate]} is {trace.rmse * scale:.3g} {unit} RMSE off the {trace.against}, "
            f"{trace.largest * scale:.3g} {unit} at most"
        )
        if trace.fit_percent is not None:
            text += f" (fit {trace.fit_percent:.1f} %)"
        if not math.isnan(trace.lag):
            late = "late" if trace.lag > 0.0 else "early"
            text += f", {abs(trace.lag) * 1e3:.3g} ms {late}" if trace.lag else ", without lag"
        if trace.floor is not None:
            text += f"; that derivative is itself uncertain by {trace.floor * scale:.2g} {unit}"
        found.append(text)
    return found + [_said(note) for note in run.notes]


def _said(note: str) -> str:
    return f"{note[0].upper()}{note[1:]}."


def lines(run: ObserverRun) -> list[str]:
    """What stands below the table, one sentence each."""
    text = (
        f"The FMU's steps took {run.step_seconds * 1e6:.3g} us each, {run.real_time_factor:.3g} times as fast as real time; "
        f"the first {SETTLING:g} s do not count."
    )
    floors = [t for t in run.traces if t.floor is not None]
    if floors:
        unit, scale = shown(floors[0].estimate)
        noise = f"{(floors[0].floor or 0.0) * scale:.2g} {unit}"
        text += f" The derivative itself (cubic over {DERIVATIVE_WINDOW:g} s) is uncertain by {noise} of sensor noise."
    return [text, *map(_said, run.notes)]


def rows(run: ObserverRun) -> list[list[object]]:
    """Rows of the table: estimate, what it is compared with, RMSE, largest error, fit, lag in ms."""
    found: list[list[object]] = []
    for trace in run.traces:
        unit, scale = shown(trace.estimate)
        fit = "-" if trace.fit_percent is None else f"{trace.fit_percent:.2f}"
        lag = "-" if math.isnan(trace.lag) else f"{trace.lag * 1e3:.1f}"
        label = f"{trace.estimate} [{unit}]"
        found.append(
            [label, trace.against, f"{trace.rmse * scale:.3g}", f"{trace.largest * scale:.3g}", fit, lag]
        )
    return found


HEADS = ("estimate of the FMU", "against", "RMSE", "largest", "fit %", "lag ms")


def write_picture(run: ObserverRun, path: Path) -> Path:
    """Draw estimates and differences into a file."""
    return write_figure(lambda: observer_figure(run), path)


def observer_figure(run: ObserverRun) -> "Figure":
    """Of angle and rate: measured, logged and the FMU's above; the FMU's minus the others below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 6.0), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, height_ratios=[2.0, 1.0])
    for k, name in enumerate((ANGLE, RATE)):
        unit, scale = shown(name)
        upper, lower = axes[:, k]
        upper.plot(
            run.time,
            run.others["measured"][name] * scale,
            color=MEASURED,
            linewidth=1.4,
            label=REFERENCE[name],
        )
        lower.plot(
            run.time,
            (run.estimates[name] - run.others["measured"][name]) * scale,
            color=MEASURED,
            linewidth=0.8,
            label=f"FMU - {REFERENCE[name]}",
        )
        if name in run.others["logged"]:
            logged = run.others["logged"][name]
            upper.plot(
                run.time, logged * scale, color=ERROR, linewidth=1.0, linestyle="--", label="logged estimate"
            )
            difference = (run.estimates[name] - logged) * scale
            lower.plot(run.time, difference, color=ERROR, linewidth=0.8, label="FMU - logged estimate")
        upper.plot(
            run.time, run.estimates[name] * scale, color=SIMULATED, linewidth=0.9, label="FMU's estimate"
        )
        upper.set_ylabel(f"{name} [{unit}]")
        lower.set_ylabel(f"difference [{unit}]")
        lower.set_xlabel("time [s]")
        for part in (upper, lower):
            part.legend(loc="best")
    figure.suptitle(
        f"Observer FMU on the log, {run.real_time_factor:.3g} times as fast as real time", fontsize=11
    )
    return figure
