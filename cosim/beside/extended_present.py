"""The extended observer's run for people (sentences, picture, CSV) and programs (plain data)."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.beside.extended import Consistency, ExtendedRun
from cosim.compare.observer import SETTLING
from cosim.compare.picture import BAND, SIMULATED, write_figure
from cosim.files import whole
from cosim.identify.kalman import DEG
from cosim.identify.run_kalman import SHOWN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATE_OF = {
    "slew_estimate": "theta",
    "slew_rate_estimate": "omega",
    "disturbance": "tau",
    "sensor_error": "beta",
}
MIDDLE = (2.5, 97.5)  # %, of the samples that a stated range holds


def lines(run: ExtendedRun) -> list[str]:
    """What it says, one sentence each."""
    found, deviations = [], run.designed.deviations
    source = "measured load pressure" if run.measured_pressure else "the model's load pressure"
    begin = round(SETTLING / run.designed.noises.step)
    low, high = np.percentile(run.estimates["disturbance"][begin:], MIDDLE)
    good = 1.96 * deviations.get("tau", 0.0)
    shows = max(abs(low), abs(high)) > good
    what = (
        "the model lacks a torque of" if shows else "no torque that the model lacks stands out: it is within"
    )
    found.append(
        f"Extended observer on {source}: {what} {low:.3g} to {high:.3g} N m 95 % of the time (one estimate is good to "
        f"+-{good:.2g} N m)."
    )
    if "beta" in deviations:
        error = run.estimates["sensor_error"][begin:] / DEG
        found.append(
            f"Fused with the tracker: the slew sensor reads {np.mean(error):.4g} deg too much on average, between "
            f"{np.min(error):.3g} and {np.max(error):.3g} deg; the fused angle is good to "
            f"+-{1.96 * deviations['theta'] / DEG:.2g} deg."
        )
    for name, nis in (("slew sensor", run.nis), ("tracker", run.nis_external)):
        if nis is not None:
            found.append(f"By the readings of the {name} {_judged(nis)}.")
    return [*found, *(f"{note[0].upper()}{note[1:]}." for note in run.notes)]


def _judged(nis: Consistency) -> str:
    low, high = nis.interval
    ratio = f"normalised innovation squared {nis.mean:.4g}, as stated {low:.4g} to {high:.4g}"
    if low <= nis.mean <= high:
        return f"noise and disturbance are as stated ({ratio})"
    return f"there is {'more' if nis.mean > high else 'less'} noise or disturbance than stated ({ratio})"


def as_data(run: ExtendedRun) -> dict[str, Any]:
    """The run as plain data, numbers in the units people read."""
    noises, begin = run.designed.noises, round(SETTLING / run.designed.noises.step)
    estimates = {}
    for name, state in STATE_OF.items():
        if state in run.designed.states:
            _, unit, scale = SHOWN[state]
            values = run.estimates[name][begin:] / scale
            estimates[name] = {
                "unit": unit,
                "mean": float(values.mean()),
                "range95": [float(v) for v in np.percentile(values, MIDDLE)],
                "deviation": run.designed.deviations[state] / scale,
            }
    return {
        "load_pressure": "measured" if run.measured_pressure else "model",
        "estimates": estimates,
        "stated": {
            "slew": {"value": noises.slew / DEG, "unit": "deg"},
            "p_load": {"value": noises.p_load, "unit": "Pa"},
            "disturbance": {"value": noises.disturbance, "unit": "N.m"},
            "disturbance_time": {"value": noises.T_tau, "unit": "s"},
            "sensor_error": {"value": noises.sensor_error / DEG, "unit": "deg"},
            "sensor_error_time": {"value": noises.T_beta, "unit": "s"},
            "tracker": {"value": noises.tracker / DEG, "unit": "deg"},
        },
        "parameters": {f"observer.{n}": v for n, v in run.designed.values().items()},
        "nis": _plain(run.nis),
        "nis_external": None if run.nis_external is None else _plain(run.nis_external),
        "settling": SETTLING,
        "notes": run.notes,
    }


def _plain(nis: Consistency) -> dict[str, Any]:
    return {"mean": nis.mean, "interval95": list(nis.interval), "innovations": nis.count}


def write_estimates(run: ExtendedRun, path: Path) -> Path:
    """Write time and estimates as CSV, one row a sample, in the units of a log."""
    names = [n for n, state in STATE_OF.items() if state in run.designed.states]
    columns = [run.time, *(run.estimates[n] / SHOWN[STATE_OF[n]][2] for n in names)]
    with whole(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(["time [s]", *(f"{n} [{SHOWN[STATE_OF[n]][1]}]" for n in names)])
        rows.writerows([f"{v:.9g}" for v in row] for row in zip(*columns, strict=True))
    return path


def write_picture(run: ExtendedRun, path: Path) -> Path:
    """Draw velocity, disturbance and sensor error into a file."""
    return write_figure(lambda: extended_figure(run), path)


def extended_figure(run: ExtendedRun) -> "Figure":
    """Each estimate over time with twice its stated standard deviation."""
    from matplotlib.figure import Figure

    names = [n for n, state in STATE_OF.items() if state in run.designed.states and n != "slew_estimate"]
    figure = Figure(figsize=(12.0, 2.6 * len(names)), layout="constrained")
    for axes, name in zip(
        figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0], names, strict=True
    ):
        text, unit, scale = SHOWN[STATE_OF[name]]
        value = run.estimates[name] / scale
        width = 2.0 * run.designed.deviations[STATE_OF[name]] / scale
        axes.fill_between(
            run.time, value - width, value + width, color=BAND, linewidth=0.0, label="±2 sd as stated"
        )
        axes.plot(run.time, value, color=SIMULATED, linewidth=0.9, label=text)
        axes.set_ylabel(f"{text} [{unit}]")
        axes.legend(loc="best")
    axes.set_xlabel("time [s]")
    figure.suptitle("Extended observer on the log", fontsize=11)
    return figure
