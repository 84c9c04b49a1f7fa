"""``calibration.png``: every fitted signal before and after, its error, the held-out part, and the parameters."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.calibrate.outcome import Calibration, Series
from cosim.compare.outcome import Comparison
from cosim.compare.picture import BAND, ERROR, MEASURED, SIMULATED, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER, HELD = SIMULATED, "#1f6fb4", "#eef3f7"
MOST_POINTS = 20_000


def write_picture(found: Calibration, comparison: Comparison, path: Path) -> Path:
    """Draw a calibration into a file."""
    return write_figure(lambda: calibration_figure(found, comparison), path)


def calibration_figure(found: Calibration, comparison: Comparison) -> "Figure":
    """Of every fitted signal that changes: measured, before and after, both errors below; the parameters at the end."""
    from matplotlib.figure import Figure

    series = found.series[-1]
    fitted = [n for n, s in found.signals.items() if s.fitted and n in series.measured]
    names = [n for n in fitted if _moved(found, series, n)] or fitted
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    last = 0.3 * len(found.parameters) + 0.8
    figure = Figure(figsize=(7.5 * columns, 3.2 * rows + last + 1.0), layout="constrained")
    grid = figure.add_gridspec(2 * rows + 1, columns, height_ratios=[1.9, 1.1] * rows + [last])
    for k, name in enumerate(names):
        row, column = divmod(k, columns)
        upper = figure.add_subplot(grid[2 * row, column])
        lower = figure.add_subplot(grid[2 * row + 1, column], sharex=upper)
        _signal(upper, lower, found, comparison, series, name)
        upper.tick_params(labelbottom=False)
        if k == 0:
            lines = [*upper.get_lines()[:3]]
            figure.legend(lines, ["measured", "before", "after"], loc="outside lower center", ncols=3)
    _parameters(figure.add_subplot(grid[-1, :]), found)
    kind = "synthetic log" if comparison.log.synthetic else "measured log"
    where = "" if series.held_from >= len(series.time) else ", shaded: held out"
    title = f"{found.model} calibrated to {found.series[0].source.name} ({kind}); shown: {series.source.name}{where}"
    figure.suptitle(title, fontsize=11)
    return figure


def _moved(found: Calibration, series: Series, name: str) -> bool:
    """Whether calibration changes a signal by more than a tenth of its noise somewhere."""
    change = float(np.max(np.abs(series.after[name] - series.before[name])))
    return change > 0.1 * found.signals[name].after.noise_floor


def _signal(
    upper: "Axes", lower: "Axes", found: Calibration, comparison: Comparison, series: Series, name: str
) -> None:
    unit, scale = comparison.shown(name)
    fit = found.signals[name]
    thin = slice(None, None, max(1, len(series.time) // MOST_POINTS))
    time = series.time[thin]
    measured = series.measured[name][thin] * scale
    parts = (("before", BEFORE, 0.9), ("after", AFTER, 1.0))
    upper.plot(time, measured, color=MEASURED, linewidth=1.6)
    for part, colour, width in parts:
        values = getattr(series, part)[name][thin] * scale
        upper.plot(time, values, color=colour, linewidth=width)
        lower.plot(time, measured - values, color=colour, linewidth=0.6)
    floor = 2.0 * fit.after.noise_floor * scale
    lower.axhspan(-floor, floor, color=BAND, alpha=0.6, linewidth=0.0)
    if series.held_from < len(series.time):
        for axes in (upper, lower):
            axes.axvspan(float(series.time[series.held_from]), float(time[-1]), color=HELD, zorder=0)
    before, after = fit.held_before or fit.before, fit.held_after or fit.after
    where = "held out" if fit.held_after else "fitted"
    upper.set_title(
        f"{name}: RMSE {before.rmse * scale:.3g} -> {after.rmse * scale:.3g} {unit} ({where})", loc="left"
    )
    upper.set_ylabel(f"{name} [{unit}]")
    lower.set_ylabel(f"error [{unit}]")
    lower.set_xlabel("time [s]")
    upper.margins(x=0.01)


def _parameters(axes: "Axes", found: Calibration) -> None:
    """Each parameter with its interval, in percent of its start (of its reach where it starts at 0)."""
    rows = list(range(len(found.parameters)))[::-1]
    for row, p in zip(rows, found.parameters, strict=True):
        size = abs(p.start) or p.high - p.low
        middle = 100.0 * (p.value - p.start) / size
        if p.ci95 is not None:
            low, high = (100.0 * (x - p.start) / size for x in p.ci95)
            axes.plot([low, high], [row, row], color=AFTER, linewidth=2.2, solid_capstyle="butt")
        axes.plot(
            [middle],
            [row],
            "o" if p.determined else "x",
            color=AFTER if p.determined else ERROR,
            markersize=4,
        )
    labels = []
    for p in found.parameters:
        unit, scale = p.shown
        tail = "" if p.determined else " (not determined)"
        tail = f" (at {p.at_bound} bound)" if p.at_bound else tail
        labels.append(f"{p.name} = {p.value * scale:.5g} {unit}{tail}")
    axes.set_yticks(rows, labels)
    axes.axvline(0.0, color=MEASURED, linewidth=0.8)
    axes.set_ylim(-0.7, len(rows) - 0.3)
    spread = float(np.max(np.abs(axes.get_xlim())))
    axes.set_xlim(-spread, spread)
    axes.set_xlabel("change from the start [%], with 95 % interval")
