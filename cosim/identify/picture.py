"""Pictures of identifications."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.compare.picture import ERROR, MEASURED, SIMULATED, STYLE
from cosim.files import whole
from cosim.identify.candidates import Choice
from cosim.identify.dead_zone import DeadZone
from cosim.identify.frf import Frf
from cosim.identify.frf_fit import response_of
from cosim.identify.inverse_dynamics import Mechanics
from cosim.identify.scaling import Channel
from cosim.identify.state_space import Observer, RootLocus
from cosim.identify.transfer_function import TransferFunction
from cosim.lexicon import Lexicon
from cosim.signals import SIGNALS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

POINTS = 20_000  # drawn of a long series
RATE_WINDOW = 0.2  # s, over which a slew rate is taken for the picture


def save(draw: "Callable[[], Figure]", path: Path, synthetic: bool = False) -> Path:
    """Draw and write a PNG that says whether its log is synthetic."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with mpl.rc_context(STYLE):
        figure = draw()
        if synthetic:
            figure.supxlabel("synthetic log", x=0.995, ha="right", fontsize=8)
        FigureCanvasAgg(figure)
        with whole(path) as part:
            figure.savefig(part, dpi=110)
    return path


def _figure(width: float = 10.0, height: float = 6.0) -> "Figure":
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _thin(count: int) -> slice:
    return slice(None, None, max(1, count // POINTS))


def dead_zone_figure(found: DeadZone) -> "Figure":
    """Response over the compensated command with the identified characteristic; response and error over time."""
    figure = _figure(11.0, 5.5)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.0, 1.2])
    left, upper = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    item, unit = found.record, SIGNALS[found.response].unit
    scale = 1.0 / SIGNALS[found.response].to_si
    y, simulated, label = item.output * scale, found.simulated * scale, f"{found.response} [{unit}]"
    if found.response == "slew":
        width = max(1, round(RATE_WINDOW / item.step))
        y_static = np.gradient(
            np.convolve(np.pad(y, width, "edge"), np.ones(width) / width, "same")[width:-width], item.step
        )
        rate = f"slew rate [{unit}/s]"
    else:
        y_static, rate = y, label
    part = _thin(item.input.size)
    left.plot(item.input[part], y_static[part], ".", color=MEASURED, markersize=2.0, label="measured")
    x = np.linspace(item.input.min(), item.input.max(), 500)
    left.plot(x, found.static(x) * scale, color=SIMULATED, linewidth=1.4, label="identified, at rest")
    for side in found.sides.values():
        left.axvspan(*side["break_point"].interval, color=SIMULATED, alpha=0.25, linewidth=0.0)
        left.axvline(side["break_point"].value, color=SIMULATED, linewidth=0.7, linestyle=":")
    left.set_xlabel("command behind the compensator [1]")
    left.set_ylabel(rate)
    left.legend(loc="upper left")
    parts = [f"{side} {q['break_point'].value:+.4f}" for side, q in found.sides.items()]
    left.set_title(f"break points: {', '.join(parts)}", loc="left")
    lower = figure.add_subplot(grid[1, 1], sharex=upper)
    _over_time(upper, lower, item.start + np.arange(y.size) * item.step, y, simulated, item.keep, label)
    upper.set_title(f"best fit {found.best_fit:.2f} %", loc="left")
    figure.suptitle(f"Dead zone in {item.name}", fontsize=11)
    return figure


def _over_time(
    upper: "Axes", lower: "Axes", time: Any, y: Array, model: Array, keep: Mask, label: str
) -> None:
    part = _thin(time.size)
    shown = np.where(keep, y, np.nan)
    upper.plot(time[part], shown[part], color=MEASURED, linewidth=1.3, label="measured")
    upper.plot(time[part], model[part], color=SIMULATED, linewidth=0.9, label="model")
    upper.set_ylabel(label)
    upper.legend(loc="best")
    upper.tick_params(labelbottom=False)
    lower.plot(time[part], (shown - model)[part], color=ERROR, linewidth=0.5)
    lower.set_ylabel("measured - model")
    lower.set_xlabel("time [s]")


def bode_figure(title: str, raw: Frf, corrected: Frf | None, model: TransferFunction | None) -> "Figure":
    """Magnitude and phase with two standard deviations, every amplitude, and the fitted transfer function."""
    figure = _figure(9.5, 6.5)
    upper = figure.add_subplot(2, 1, 1)
    lower = figure.add_subplot(2, 1, 2, sharex=upper)
    for amplitude, values in raw.amplitudes.items():
        known = np.isfinite(values)
        magnitude = 20.0 * np.log10(np.abs(values[known]))
        upper.plot(
            raw.frequency[known], magnitude, ".", markersize=3.0, label=f"{100 * amplitude:.0f} %, as read"
        )
    shown, name = (raw, "mean") if corrected is None else (corrected, "mean, transient taken off")
    relative = 2.0 * shown.deviation / np.abs(shown.response)
    style = {"fmt": ".", "color": ERROR, "markersize": 4.0, "elinewidth": 0.8, "label": f"{name}, ±2 sd"}
    upper.errorbar(shown.frequency, shown.magnitude, 20.0 / np.log(10.0) * relative, **style)  # type: ignore[arg-type]
    lower.errorbar(shown.frequency, shown.phase, np.rad2deg(relative), **style)  # type: ignore[arg-type]
    if model is not None:
        w = np.geomspace(shown.frequency[0], shown.frequency[-1], 400)
        line = response_of(model, w)
        phase = np.rad2deg(np.unwrap(np.angle(line)))
        phase += 360.0 * np.round((shown.phase[0] - phase[0]) / 360.0)
        upper.plot(
            w, 20.0 * np.log10(np.abs(line)), color=SIMULATED, linewidth=1.0, label=f"fit: {model.structure}"
        )
        lower.plot(w, phase, color=SIMULATED, linewidth=1.0)
    if raw.coherence is not None:
        side = upper.twinx()
        side.plot(raw.frequency, raw.coherence, color=MEASURED, linewidth=0.8)
        side.set_ylim(0.0, 1.05)
        side.set_ylabel("coherence (grey)")
    upper.set_xscale("log")
    upper.set_ylabel("magnitude [dB of SI]")
    lower.set_ylabel("phase [deg]")
    lower.set_xlabel("frequency [rad/s]")
    upper.legend(loc="lower left")
    upper.tick_params(labelbottom=False)
    figure.suptitle(f"{title} ({raw.method})", fontsize=11)
    return figure


def transfer_function_figure(title: str, choice: Choice, target: str) -> "Figure":
    """Fit and held-out fit of the candidates; response and error of the chosen one, its poles and zeros."""
    figure = _figure(12.0, 6.5)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.5, 1.0])
    upper = figure.add_subplot(grid[0, 0])
    lower = figure.add_subplot(grid[1, 0], sharex=upper)
    model, unit = choice.chosen.model, SIGNALS[target].unit
    item, scale = model.records[0], 1.0 / SIGNALS[target].to_si
    time = item.start + np.arange(item.output.size) * item.step
    _over_time(
        upper, lower, time, item.output * scale, model.simulated(0) * scale, item.keep, f"{target} [{unit}]"
    )
    upper.set_title(
        f"{choice.chosen.name}: {choice.chosen.structure}, best fit {choice.chosen.best_fit:.2f} %",
        loc="left",
    )
    bars, places = figure.add_subplot(grid[0, 1]), np.arange(len(choice.candidates))
    for shift, name, values in ((-0.2, "fitting part", "fitting"), (0.2, "held out", "held_out")):
        bars.bar(places + shift, [getattr(row, values) for row in choice.candidates], 0.38, label=name)
    bars.set_xticks(
        places, [f"{row.name}\n{row.structure.poles}/{row.structure.zeros}" for row in choice.candidates]
    )
    lowest = min(min(row.fitting, row.held_out) for row in choice.candidates)
    bars.set_ylim(max(0.0, lowest - 5.0), 104.0 + 0.12 * (100.0 - lowest))
    bars.set_ylabel("best fit [%]")
    bars.set_title("candidates: poles/zeros", loc="left")
    bars.legend(loc="upper center", ncols=2)
    plane = figure.add_subplot(grid[1, 1])
    poles, zeros = np.roots(model.denominator), model.zeros()
    plane.plot(poles.real, poles.imag, "x", color=SIMULATED, markersize=8, label="poles")
    plane.plot(zeros.real, zeros.imag, "o", color=ERROR, fillstyle="none", label="zeros")
    _plane(plane)
    plane.legend(loc="best")
    figure.suptitle(title, fontsize=11)
    return figure


def _plane(axes: "Axes") -> None:
    axes.axhline(0.0, color=MEASURED, linewidth=0.6)
    axes.axvline(0.0, color=MEASURED, linewidth=0.6)
    axes.set_xlabel("real part [1/s]")
    axes.set_ylabel("imaginary part [rad/s]")


def root_locus_figure(loci: dict[str, RootLocus], observer: Observer) -> "Figure":
    """Root loci side by side (fig. 5.2), the observer's poles in the first."""
    figure = _figure(5.5 * len(loci), 5.0)
    for k, (name, locus) in enumerate(loci.items(), 1):
        axes = figure.add_subplot(1, len(loci), k)
        for branch in locus.poles.T:
            axes.plot(branch.real, branch.imag, ".", markersize=2.0)
        axes.plot(locus.poles[0].real, locus.poles[0].imag, "kx", markersize=8, label="open loop")
        if k == 1:
            axes.plot(observer.placed, np.zeros(observer.placed.size), "r*", markersize=9, label="observer")
        stable = (
            f"stable below {locus.limit:.3g} /deg" if np.isfinite(locus.limit) else "stable at every gain"
        )
        axes.set_title(f"{name}: {stable}", loc="left")
        _plane(axes)
        axes.legend(loc="best")
    figure.suptitle("Root locus of proportional slew control (5.2)", fontsize=11)
    return figure


def scaling_figure(channels: Sequence[Channel]) -> "Figure":
    """Value over voltage of every channel, with the points measured."""
    columns = min(3, len(channels))
    rows = -(-len(channels) // columns)
    figure = _figure(4.0 * columns, 3.2 * rows)
    for k, channel in enumerate(channels, 1):
        axes = figure.add_subplot(rows, columns, k)
        points = np.array(channel.points).reshape(-1, 2)
        ends = (
            (points[:, 0].min(), points[:, 0].max())
            if points.size
            else (0.0, 10.0 if channel.zero == 0.0 else 5.0)
        )
        volts = np.array(ends)
        axes.plot(volts, channel.gain * (volts - channel.zero), color=SIMULATED)
        axes.plot(points[:, 0], points[:, 1], "o", color=ERROR, markersize=4.0)
        axes.set_title(
            f"{channel.signal}: {channel.gain:.5g} {channel.unit}/V about {channel.zero:.4g} V", loc="left"
        )
        axes.set_xlabel("voltage [V]")
        axes.set_ylabel(f"{channel.signal} [{channel.unit}]")
    return figure


def mechanics_figure(found: Mechanics, lexicon: Lexicon) -> "Figure":
    """Torque without its inertial part over velocity, with the friction found; torque and its error over time."""
    figure = _figure(11.0, 5.5)
    grid = figure.subplot_mosaic([["law", "time"], ["law", "error"]], width_ratios=[1.0, 1.2])
    motion, (unit, scale), (speed, to_speed) = (
        found.motion,
        lexicon.quantity("N.m"),
        lexicon.quantity("rad/s", "deg/s"),
    )
    torque, model = scale * motion.torque, np.where(found.used, scale * found.torque(), np.nan)
    values = {name: q.value for name, q in found.values.items()}
    part = np.flatnonzero(found.used)[_thin(int(found.used.sum()))]
    friction = torque - scale * values["J"] * found.acceleration
    law = grid["law"]
    law.plot(
        to_speed * found.velocity[part], friction[part], ".", color=MEASURED, markersize=1.5, label="measured"
    )
    top = float(np.abs(found.velocity[part]).max())
    for speeds in (np.linspace(-top, -1e-9, 2), np.linspace(1e-9, top, 2)):
        level = (
            values["b"] * speeds + values.get("tau_c", 0.0) * np.sign(speeds) + values.get("tau_load", 0.0)
        )
        law.plot(to_speed * speeds, scale * level, color=SIMULATED, linewidth=1.4)
    law.set_xlabel(f"velocity [{speed}]")
    law.set_ylabel(f"torque without J dω/dt [{unit}]")
    law.set_title("friction and load", loc="left")
    grid["error"].sharex(grid["time"])
    time = motion.start + np.arange(torque.size) * motion.step
    _over_time(grid["time"], grid["error"], time, torque, model, found.used, f"torque [{unit}]")
    grid["time"].set_title(f"up to {found.highest:.3g} Hz, best fit {found.fit:.2f} %", loc="left")
    figure.suptitle(f"Mechanics in {motion.name}", fontsize=11)
    return figure
