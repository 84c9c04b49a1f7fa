"""Picture of a drive's static curve."""

from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.compare.picture import ERROR, MEASURED, SIMULATED
from cosim.identify.drive_curve import NAMES, DriveCurve
from cosim.identify.drive_fit import static
from cosim.identify.run_drive import Told

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIDES = {"low": "left", "high": "right"}


def drive_figure(curve: DriveCurve, told: Told) -> "Figure":
    """Speed over command: steady stretches, the free curve with its band, and the seven numbers as lines."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 6.0), layout="constrained")
    axes = figure.add_subplot()
    u, speed = told.command_scale, told.motion_scale
    measured(axes, curve, u, speed)
    lined(axes, curve, told)
    told_numbers(axes, curve, told)
    axes.set_xlabel(f"{told.command} [{told.command_unit}]")
    axes.set_ylabel(f"speed of {told.motion} [{told.speed_unit}]")
    axes.axhline(0.0, color=MEASURED, linewidth=0.5)
    tops = [abs(e.value) for n, e in curve.values.items() if n.startswith("top")]
    reach = 1.25 * speed * max([*tops, float(np.max(np.abs(curve.speeds)))])
    axes.set_ylim(-reach, reach)
    if told.column:

        def read(command: Any) -> Any:
            return told.zero + command / told.gain

        def commanded(reading: Any) -> Any:
            return told.gain * (reading - told.zero)

        above = axes.secondary_xaxis("top", functions=(read, commanded))
        above.set_xlabel(f"{told.column}, as read")
    axes.legend(loc="upper left", fontsize=8)
    count = len(curve.names)
    figure.suptitle(
        f"Static curve of the drive: {curve.names[0] if count == 1 else f'{count} logs'}", fontsize=11
    )
    return figure


def measured(axes: "Axes", curve: DriveCurve, u: float, speed: float) -> None:
    """Steady stretches and the free curve with its band; u and speed are shown per SI."""
    points = curve.points
    axes.plot(
        u * points[0],
        speed * points[1],
        ".",
        color=MEASURED,
        markersize=4.5,
        alpha=0.5,
        label="half a second of steady command",
    )
    low, high = np.sort(speed * curve.band, axis=0)
    axes.fill_between(
        u * curve.knots,
        low,
        high,
        color=SIMULATED,
        alpha=0.18,
        linewidth=0.0,
        label=f"free curve: 95 % band {'between logs' if curve.scattered else 'within a log'}",
    )
    if curve.scattered:
        for k, one in enumerate(curve.each):
            name = "free curve: each log" if k == 0 else None
            axes.plot(
                u * one.knots, speed * one.speeds, color=SIMULATED, linewidth=0.7, alpha=0.7, label=name
            )
    else:
        axes.plot(u * curve.knots, speed * curve.speeds, color=SIMULATED, linewidth=0.9, label="free curve")


def lined(axes: "Axes", curve: DriveCurve, told: Told) -> None:
    """The seven numbers as a line; dead zone and top speeds with their intervals."""
    values = {n: e.value for n, e in curve.values.items()}
    u, speed = told.command_scale, told.motion_scale
    low, high = float(curve.knots[0]), float(curve.knots[-1])
    full = {
        "dead_low": low,
        "dead_high": high,
        "slope_low": 0.0,
        "slope_high": 0.0,
        "top_low": -np.inf,
        "top_high": np.inf,
    }
    x = np.array([values.get(n, full[n]) for n in NAMES])
    at = np.linspace(low, high, 800)
    axes.plot(u * at, speed * static(at, x), color=ERROR, linewidth=1.8, label="dead zone, slope, top speed")
    for name, estimate in curve.values.items():
        if name.startswith("dead"):
            axes.axvspan(u * estimate.low, u * estimate.high, color=ERROR, alpha=0.12, linewidth=0.0)
        elif name.startswith("top"):
            axes.axhspan(speed * estimate.low, speed * estimate.high, color=ERROR, alpha=0.12, linewidth=0.0)


def told_numbers(axes: "Axes", curve: DriveCurve, told: Told) -> None:
    """Dead zone and top speeds in words, where they are."""
    u, speed = told.command_scale, told.motion_scale
    for name, estimate in curve.values.items():
        kind, _, side = name.partition("_")
        value = estimate.value
        if kind == "dead":
            text = f"{u * value:.3g}" + (f"\n({told.reading(u * value):.3g})" if told.column else "")
            axes.annotate(
                text, (u * value, 0.0), xytext=(0, -34 if side == "high" else 12), textcoords="offset points",
                ha="center", fontsize=8.5, color=ERROR,
            )  # fmt: skip
        elif kind == "top":
            end = curve.knots[0] if side == "low" else curve.knots[-1]
            axes.annotate(
                f"{speed * value:.3g} {told.speed_unit}", (u * end, speed * value),
                xytext=(0, 8 if side == "high" else -14), textcoords="offset points",
                ha=SIDES[side], fontsize=8.5, color=ERROR,
            )  # fmt: skip
