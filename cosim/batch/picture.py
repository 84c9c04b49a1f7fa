"""The picture of a batch: a fan chart for draws, main effects for sweeps, a table for diagnoses, a map for comparisons."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cosim.batch.overview import diagnoses_figure, new_figure, scores_figure
from cosim.batch.parameters import Varied
from cosim.batch.summary import heading, score_columns, sensitivity
from cosim.compare.picture import STYLE
from cosim.files import whole

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_SIGNALS, MOST_SCORES, MOST_PARAMETERS = 6, 4, 5
BANDS = ((0.05, 0.95, 0.2), (0.25, 0.75, 0.35))
LINE, BAND, DOTS, MEASURED = "#1f4e79", "#3182bd", "#7f8c8d", "#c0392b"
SAME = 0.9999  # rank correlation from which two scores tell the same
# of the scores, what is most worth a picture first
PREFERRED = (" rmse [", " final [", " max [")


def write_picture(
    path: Path,
    kind: str,
    frame: pd.DataFrame,
    varied: Sequence[Varied],
    cube: "xr.Dataset | None",
    measured: Mapping[str, tuple[Array, Array]] | None = None,
) -> Path | None:
    """Draw what fits the batch.

    Args:
        path: PNG to write.
        kind: "diagnose", "compare" or "simulate".
        frame: the table of runs.
        varied: the parameters that differ.
        cube: the signals, where a fan chart is wanted.
        measured: signal -> (time [s] from the start, values in the unit people read), to lie over the fans.

    Returns:
        `path`, or None where there is nothing to show.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with mpl.rc_context(STYLE):
        figure: Figure | None
        if kind == "diagnose":
            figure = diagnoses_figure(frame)
        elif cube is not None:
            figure = fan_figure(cube, frame, measured or {})
        elif varied:
            figure = effects_figure(frame, varied)
        else:
            figure = scores_figure(frame)
        if figure is None:
            return None
        FigureCanvasAgg(figure)
        with whole(path) as part:
            figure.savefig(part, dpi=110)
    return path


# Draws


def fan_figure(
    cube: "xr.Dataset", frame: pd.DataFrame, measured: Mapping[str, tuple[Array, Array]]
) -> "Figure | None":
    """Quantiles over time of each signal, over the runs that were done."""
    runs = frame.loc[frame["status"] == "done", "run"].to_numpy(dtype=int)
    names = _moving(cube, runs)
    if not names or not runs.size:
        return None
    columns = min(2, len(names))
    lines = -(-len(names) // columns)
    figure = new_figure(4.8 * columns + 0.4, 2.5 * lines + 0.5)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True)
    for axis, name in zip(axes.flat, names, strict=False):
        _fan(axis, cube, name, runs, measured.get(name))
    for axis in axes.flat[len(names) :]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    handles, labels = max((a.get_legend_handles_labels() for a in axes.flat), key=lambda found: len(found[0]))
    axes.flat[0].legend(handles, labels, loc="best")
    left = len(frame) - runs.size
    figure.suptitle(
        f"{runs.size} simulated runs" + (f", {left} failed or not done" if left else ""), fontsize=10
    )
    return figure


def _moving(cube: "xr.Dataset", runs: NDArray[np.int64]) -> list[str]:
    """Signals that differ between runs, in the order of the chain; of two that look the same the later one."""
    kept: dict[str, Array] = {}
    chain = [str(name) for name in cube.attrs.get("signals", [])]
    for name in reversed(chain):
        # enough to judge by
        part = cube[name].isel(run=runs[:200], time=slice(None, None, 10)).to_numpy()
        part = part[:, np.isfinite(part).all(axis=0)]
        if not part.size:
            continue
        span = float(np.ptp(part))
        if span > 0.0 and float(part.std(axis=0).max()) > 1e-6 * span:
            shape = (part - part.min()) / span
            if not any(_alike(shape, other) for other in kept.values()):
                kept[name] = shape
    return [name for name in chain if name in list(kept)[:MOST_SIGNALS]]


def _alike(one: Array, other: Array) -> bool:
    """Whether two signals, scaled to their range, are the same, or the same upside down."""
    if one.shape != other.shape:
        return False
    return bool(np.max(np.abs(one - other)) < 1e-3 or np.max(np.abs(one - (1.0 - other))) < 1e-3)


def _fan(
    axis: "Axes", cube: "xr.Dataset", name: str, runs: NDArray[np.int64], log: tuple[Array, Array] | None
) -> None:
    array = cube[name]
    values = array.isel(run=runs).to_numpy() * array.attrs["display_factor"] + array.attrs["display_offset"]
    time = cube["time"].to_numpy()
    low_high = [q for low, high, _ in BANDS for q in (low, high)]
    levels = _quantiles(values, [*low_high, 0.5])
    for k, (low, high, alpha) in enumerate(BANDS):
        label = f"{100 * low:g} to {100 * high:g} % of runs"
        axis.fill_between(time, levels[2 * k], levels[2 * k + 1], color=BAND, alpha=alpha, lw=0, label=label)
    axis.plot(time, levels[-1], color=LINE, lw=1.1, label="median")
    if log is not None:
        axis.plot(*log, color=MEASURED, lw=0.7, label="measured")
    axis.set_title(name, loc="left")
    axis.set_ylabel(array.attrs["display_unit"])


def _quantiles(values: Array, levels: Sequence[float]) -> Array:
    """Quantiles (levels, m) over runs of values (runs, m); runs that have ended leave the others behind."""
    if np.isfinite(values).all():
        return np.quantile(values, levels, axis=0)
    keep = np.isfinite(values).any(axis=0)
    found = np.full((len(levels), values.shape[1]), np.nan)
    found[:, keep] = np.nanquantile(values[:, keep], levels, axis=0)
    return found


# Sweeps


def effects_figure(frame: pd.DataFrame, varied: Sequence[Varied]) -> "Figure | None":
    """Main effects: each score over each parameter, a dot a run, a line through the means; rank correlation above."""
    done = frame[frame["status"] == "done"]
    ranks = sensitivity(frame, varied, score_columns(frame, varied))
    scores = _to_show(done, score_columns(frame, varied), ranks)
    parameters = list(varied)[:MOST_PARAMETERS]
    if not scores or not parameters:
        return None
    figure = new_figure(2.9 * len(parameters) + 1.0, 2.3 * len(scores) + 0.6)
    axes = figure.subplots(len(scores), len(parameters), squeeze=False, sharex="col", sharey="row")
    for row, score in zip(axes, scores, strict=True):
        for axis, parameter in zip(row, parameters, strict=True):
            column = heading(parameter)
            x = done[column].astype(str) if not parameter.numeric else done[column]
            axis.plot(x, done[score], ".", color=DOTS, ms=3.5, alpha=0.5)
            means = done.groupby(x, sort=True)[score].mean()
            if 1 < len(means) <= len(done) / 2 or len(means) == len(done) < 60:
                axis.plot(means.index, means.to_numpy(), "-", color=LINE, lw=1.3)
            rank = ranks.get(score, {}).get(parameter.name)
            axis.set_title("" if rank is None else f"rank correlation {rank:+.2f}", fontsize=8.5)
        name, _, unit = score.rpartition(" [")
        row[0].set_ylabel(f"{name}\n[{unit}", fontsize=8.5)
    for axis, parameter in zip(axes[-1], parameters, strict=True):
        axis.set_xlabel(heading(parameter))
    failed = int((frame["status"] == "failed").sum())
    hidden = len(varied) - len(parameters)
    more = f", {failed} failed" if failed else ""
    more += f", {hidden} more parameters in the table" if hidden else ""
    figure.suptitle(f"Main effects, {len(done)} runs{more}", fontsize=10)
    return figure


def _to_show(
    done: pd.DataFrame, columns: Sequence[str], ranks: Mapping[str, Mapping[str, float]]
) -> list[str]:
    """The scores that most parameters act on, later ones in the chain first; each tells something else than the others."""
    found: list[str] = []
    for part in PREFERRED:
        fitting = [name for name in reversed(columns) if part in name and ": " not in name and name in ranks]
        for name in sorted(fitting, key=lambda n: -round(sum(map(abs, ranks[n].values())), 2)):
            signal = name.rpartition(part)[0]
            if any(shown.startswith(f"{signal} ") or _same_order(done, shown, name) for shown in found):
                continue
            found.append(name)
    return found[:MOST_SCORES]


def _same_order(done: pd.DataFrame, one: str, other: str) -> bool:
    """Whether two scores put the runs in the same order, or in the reverse one."""
    pair = done[[one, other]].dropna()
    return abs(float(np.corrcoef(pair.rank().to_numpy().T)[0, 1])) > SAME if len(pair) > 2 else False


def measured_signals(log: Any) -> dict[str, tuple[Array, Array]]:
    """Signals of a log (`cosim.logs.Log`) as `write_picture` lays them over the fans."""
    from cosim.signals import SIGNALS, conversion

    found = {}
    for name in (*log.signals, "p_load"):
        if name in log:
            si = log.units.get(name) or SIGNALS[name].si
            unit = log.display.get(name) or (SIGNALS[name].unit if name in SIGNALS else si)
            found[name] = (log.time - log.time[0], log[name] / conversion(unit, si))
    return found
