"""Pictures of series for notebooks: plotly where it is installed, else matplotlib; either can be asked for."""

import importlib.util
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.errors import MissingExtraError

Array = NDArray[np.float64]
Backend = Literal["auto", "plotly", "matplotlib"]
Panels = Mapping[str, Mapping[str, Array]]
"""Title of a panel, such as ``slew [deg]`` -> label of a line -> (n,)."""

LINE_POINTS = 4000  # points of a line; beyond that the smallest and largest of each stretch


def draw(time: Array, panels: Panels, backend: Backend = "auto", title: str = "") -> Any:
    """A figure with a panel below another, all over the same time.

    Args:
        time: (n,) [s].
        panels: what to show.
        backend: "plotly", "matplotlib", or "auto" for plotly where it is installed.
        title: over all.

    Returns:
        A plotly or a matplotlib figure.

    Raises:
        MissingExtraError: plotly was asked for and is not installed.
    """
    there = importlib.util.find_spec("plotly") is not None
    if backend == "plotly" and not there:
        raise MissingExtraError("a plotly figure", "report")
    use_plotly = backend == "plotly" or (backend == "auto" and there)
    return (_plotly if use_plotly else _matplotlib)(time, panels, title)


def thinned(time: Array, values: Array, most: int = LINE_POINTS) -> tuple[Array, Array]:
    """A line of at most about `most` points that keeps every peak."""
    if values.size <= most:
        return time, values
    parts = np.array_split(np.arange(values.size), most // 2)
    filled = np.nan_to_num(values, nan=float(np.nanmean(values)) if np.isfinite(values).any() else 0.0)
    keep = {int(part[k]) for part in parts for k in (np.argmin(filled[part]), np.argmax(filled[part]))}
    places = np.array(sorted({0, *keep, values.size - 1}))
    return time[places], values[places]


def _plotly(time: Array, panels: Panels, title: str) -> Any:
    from plotly.colors import qualitative
    from plotly.graph_objects import Figure, Scatter
    from plotly.subplots import make_subplots

    figure: Figure = make_subplots(
        rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.12 / max(len(panels), 1)
    )
    colours: dict[str, str] = {}
    for row, (name, lines) in enumerate(panels.items(), 1):
        for label, values in lines.items():
            first = label not in colours
            colour = colours.setdefault(label, qualitative.Safe[len(colours) % len(qualitative.Safe)])
            x, y = thinned(time, values)
            figure.add_trace(
                Scatter(x=x, y=y, name=label, legendgroup=label, showlegend=first, line={"color": colour, "width": 1}),
                row=row,
                col=1,
            )  # fmt: skip
        figure.update_yaxes(title_text=name, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(panels), col=1)
    figure.update_layout(title=title or None, height=120 + 190 * len(panels), hovermode="x unified")
    return figure


def _matplotlib(time: Array, panels: Panels, title: str) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 0.8 + 2.0 * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, lines) in zip(rows, panels.items(), strict=True):
        for label, values in lines.items():
            axes.plot(*thinned(time, values), linewidth=0.8, label=label)
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
        if len(lines) > 1:
            axes.legend(loc="upper right", fontsize="small")
    rows[-1].set_xlabel("time [s]")
    figure.suptitle(title)
    return figure
