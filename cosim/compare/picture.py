"""Pictures of a comparison: signals with their error, blocks with their residual and the noise it should stay within."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.compare.outcome import BlockOutcome, Comparison, SignalOutcome
from cosim.files import whole

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SMOOTH = 0.1  # s, over which the residual is averaged for the dark line
MOST_POINTS = 200_000  # samples up to which every one is drawn
BINS = 10_000  # parts of a longer line: more than ten for each dot of the picture
MEASURED, SIMULATED, ERROR, BAND = "#7f8c8d", "#c0392b", "#2c3e50", "#f5d76e"
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "agg.path.chunksize": 20000,
}


def write_pictures(comparison: Comparison, folder: Path) -> dict[str, Path]:
    """Write ``signals.png`` and ``blocks.png``, as far as there is something to show.

    Returns:
        ``signals``, ``blocks`` -> file.
    """
    figures = {"signals": signals_figure, "blocks": blocks_figure}
    written = {}
    for name, draw in figures.items():
        if comparison.signals if name == "signals" else comparison.blocks:
            written[name] = write_figure(partial(draw, comparison), folder / f"{name}.png")
    return written


def write_figure(draw: Callable[[], "Figure"], path: Path) -> Path:
    """Draw a figure in our style, without a display, into a file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with mpl.rc_context(STYLE):
        figure = draw()
        FigureCanvasAgg(figure)
        with whole(path) as part:
            figure.savefig(part, dpi=110)
    return path


def signals_figure(comparison: Comparison) -> "Figure":
    """Of every signal: measured and simulated above, error with the noise band below."""
    found = list(comparison.signals.values())
    figure, columns, rows = _figure(len(found), 3.4)
    heights = [2.0, 1.0] * rows
    grid = figure.add_gridspec(2 * rows, columns, height_ratios=heights)
    for k, outcome in enumerate(found):
        row, column = divmod(k, columns)
        upper = figure.add_subplot(grid[2 * row, column])
        lower = figure.add_subplot(grid[2 * row + 1, column], sharex=upper)
        _overlay(upper, comparison, outcome)
        _residual(lower, comparison, outcome, "error")
        upper.tick_params(labelbottom=False)
    _frame(figure, comparison, f"driven by {', '.join(comparison.command)} alone")
    return figure


def blocks_figure(comparison: Comparison) -> "Figure":
    """Of every block: its residual when it is driven by what was measured, with the noise band."""
    found = [(block, outcome) for block in comparison.blocks for outcome in block.signals.values()]
    figure, columns, rows = _figure(len(found), 2.5)
    grid = figure.add_gridspec(rows, columns)
    for k, (block, outcome) in enumerate(found):
        axes = figure.add_subplot(grid[divmod(k, columns)])
        _residual(axes, comparison, outcome, "residual")
        axes.set_title(_block_title(block, outcome), loc="left")
    _frame(figure, comparison, "each block driven by what was measured")
    return figure


def _figure(count: int, height: float) -> "tuple[Figure, int, int]":
    from matplotlib.figure import Figure

    columns = 1 if count == 1 else 2
    rows = -(-count // columns)
    width = 9.0 if columns == 1 else 14.0
    return Figure(figsize=(width, height * rows + 1.0), layout="constrained"), columns, rows


def _frame(figure: "Figure", comparison: Comparison, how: str) -> None:
    """Title, and one legend for all axes."""
    log = comparison.log
    kind = "synthetic log" if log.synthetic else "measured log"
    entries: dict[str, Artist] = {}
    for axes in figure.axes[:2]:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=len(entries))
    figure.suptitle(f"{log.source.name} ({kind}) and model {comparison.model}, {how}", fontsize=11)


def _overlay(axes: "Axes", comparison: Comparison, outcome: SignalOutcome) -> None:
    unit, scale = comparison.shown(outcome.signal)
    measured = np.where(outcome.valid, outcome.measured * scale, np.nan)
    axes.plot(*drawn(comparison.time, measured), color=MEASURED, linewidth=1.3, label="measured")
    simulated = drawn(comparison.time, outcome.simulated * scale)
    axes.plot(*simulated, color=SIMULATED, linewidth=0.9, label="simulated")
    axes.set_ylabel(f"{outcome.signal} [{unit}]")
    score = outcome.score
    fit = (
        "constant within its noise"
        if score.constant or score.fit_percent is None
        else f"fit {score.fit_percent:.1f} %"
    )
    axes.set_title(f"{outcome.signal}: RMSE {score.rmse * scale:.3g} {unit}, {fit}", loc="left")


def _residual(axes: "Axes", comparison: Comparison, outcome: SignalOutcome, label: str) -> None:
    unit, scale = comparison.shown(outcome.signal)
    error = np.where(outcome.valid, outcome.error * scale, np.nan)
    floor = outcome.score.noise_floor * scale
    axes.axhspan(-2.0 * floor, 2.0 * floor, color=BAND, alpha=0.6, linewidth=0.0, label="sensor noise, ±2 sd")
    every = drawn(comparison.time, error)
    axes.plot(*every, color=MEASURED, linewidth=0.4, alpha=0.7, label="every sample")
    mean = drawn(comparison.time, _smoothed(error, comparison.step))
    axes.plot(*mean, color=ERROR, linewidth=1.0, label=f"mean over {SMOOTH:g} s")
    axes.set_ylabel(f"{label} [{unit}]")
    axes.set_xlabel("time [s]")
    axes.margins(x=0.01)


def drawn(time: Array, values: Array) -> tuple[Array, Array]:
    """A line with no more points than can be seen: of each of `BINS` parts its smallest and its largest value.

    Args:
        time: (n,) [s].
        values: (n,); missing ones are NaN.

    Returns:
        Both as they are up to `MOST_POINTS` samples, else (2 `BINS`,) each.
    """
    if len(values) <= MOST_POINTS:
        return time, values
    edges = np.linspace(0, len(values), BINS + 1).astype(np.intp)[:-1]
    low, high = (extreme.reduceat(values, edges) for extreme in (np.fmin, np.fmax))
    return np.repeat(time[edges], 2), np.column_stack([low, high]).ravel()


def _smoothed(values: Array, step: float) -> Array:
    """Moving average over `SMOOTH` that leaves missing samples out."""
    width = min(max(1, round(SMOOTH / step)), len(values))
    known = np.isfinite(values)
    count = _moving_sum(known.astype(np.float64), width)
    total = _moving_sum(np.where(known, values, 0.0), width)
    return np.divide(total, count, out=np.full(len(values), np.nan), where=count > 0.0)


def _moving_sum(values: Array, width: int) -> Array:
    """Sum of the `width` values about each one, zeros beyond both ends; as a difference of sums, whatever the width."""
    sums = np.pad(values, (width // 2 + 1, (width - 1) // 2))
    np.cumsum(sums, out=sums)
    return sums[width:] - sums[:-width]


def _block_title(block: BlockOutcome, outcome: SignalOutcome) -> str:
    ratio = outcome.score.ratio
    text = "" if ratio is None else f", {ratio:.3g} x noise"
    return f"{block.name}: {outcome.signal} from measured {', '.join(block.driven_by)}{text}"
