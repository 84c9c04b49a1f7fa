"""A picture as plain data, and how plotly draws it."""

import re
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Role = Literal["measured", "nominal", "extended", "noise", "rising", "falling", "plain"]
Kind = Literal["line", "points", "means", "band", "bars"]

COLOURS: dict[Role, str] = {
    "measured": "#6b7280",
    "nominal": "#d1495b",
    "extended": "#1f6fb2",
    "noise": "#f2c14e",
    "rising": "#2a9d8f",
    "falling": "#8d5a97",
    "plain": "#374151",
}


TOP, MARGINS = 30, 74  # px above, and above and below the axes
LETTER = 8.0  # px of a letter of an axis' title
# what is drawn beside the models differs in its dashes too, for readers who see these colours alike
DASHES: dict[Role, str] = {"rising": "dash", "falling": "dot"}


@dataclass(frozen=True)
class Layer:
    """One set of marks.

    Attributes:
        kind: line; points (single values); means (with two standard errors); band (between low and high); bars.
        name: for the legend.
        role: what it stands for, which gives the colour.
        x, y: (n,) in the units of the axes; NaN breaks a line. For a band y is its lower, `error` its upper edge.
        error: (n,) half-length of the error bars, or the upper edge of a band.
        hidden: drawn only when the reader asks for it.
    """

    kind: Kind
    name: str
    role: Role
    x: Array
    y: Array
    error: Array | None = None
    hidden: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes: label of the ordinate with its unit, and what is drawn; `log` for a logarithmic ordinate."""

    y: str
    layers: list[Layer]
    log: bool = False


@dataclass(frozen=True)
class Picture:
    """Panels above each other over one abscissa.

    Attributes:
        key: identifier within the page.
        title: what it shows.
        x: label of the abscissa with its unit.
        panels: from top to bottom.
        caption: what to see in it, one or two sentences.
        shaded: spans of x that were held out.
        log: logarithmic abscissa.
        labels: x -> text, for bars.
        evidence: it stands beside a cause, and is higher for its width.
    """

    key: str
    title: str
    x: str
    panels: list[Panel]
    caption: str
    shaded: list[tuple[float, float]] = field(default_factory=list)
    log: bool = False
    labels: tuple[str, ...] = ()
    evidence: bool = False

    @property
    def height(self) -> int:
        """Pixels on the screen."""
        return (290 if self.evidence else 240) + 105 * (len(self.panels) - 1)

    def layer(self, role: Role, panel: int = 0, kind: Kind | None = None) -> Layer:
        """The first layer of a role (and kind) in a panel; LookupError if there is none."""
        for layer in self.panels[panel].layers:
            if layer.role == role and kind in (None, layer.kind):
                return layer
        raise LookupError(f"picture '{self.key}' has no layer '{role}' in panel {panel}")


def figure(picture: Picture) -> dict[str, Any]:
    """The picture as plotly's JSON: data and layout."""
    import plotly.graph_objects as go

    rows = len(picture.panels)
    drawing = go.Figure(layout=_layout(picture, rows))
    listed: set[tuple[str, str]] = set()
    for row, panel in enumerate(picture.panels, 1):
        for layer in panel.layers:
            axis = "" if row == 1 else str(row)
            first = (layer.name, layer.role) not in listed and layer.name != ""
            listed.add((layer.name, layer.role))
            for trace in _traces(layer, picture):
                group = f"{layer.name} {layer.role}"
                trace |= {"xaxis": "x", "yaxis": f"y{axis}", "legendgroup": group}
                if layer.hidden:
                    trace["visible"] = "legendonly"
                trace["showlegend"] = first and trace.get("showlegend", True)
                drawing.add_trace(trace)
    import json

    found: dict[str, Any] = json.loads(drawing.to_json())
    return found


def _traces(layer: Layer, picture: Picture) -> list[dict[str, Any]]:
    colour = COLOURS[layer.role]
    x, y = layer.x.astype(np.float32), layer.y.astype(np.float32)
    base: dict[str, Any] = {"type": "scatter", "y": y, "name": layer.name} | _abscissa(layer.x)
    if layer.kind == "line":
        width = 1.0 if layer.role in ("measured", "plain") else 1.6
        line = {"color": colour, "width": width, "dash": DASHES.get(layer.role, "solid")}
        return [base | {"mode": "lines", "line": line}]
    if layer.kind == "points":
        return [base | {"mode": "markers", "marker": {"color": colour, "size": 3.5, "opacity": 0.35}}]
    if layer.kind == "means":
        bar = {
            "type": "data",
            "array": np.asarray(layer.error, dtype=np.float32),
            "width": 2,
            "thickness": 1.2,
        }
        marker = {"color": colour, "size": 7, "line": {"color": "white", "width": 1}}
        return [base | {"mode": "markers", "marker": marker, "error_y": bar | {"color": colour}}]
    if layer.kind == "bars":
        labels = list(picture.labels) if picture.labels else x
        return [{"type": "bar", "x": labels, "y": y, "name": layer.name, "marker": {"color": colour}}]
    upper = np.asarray(layer.error, dtype=np.float32)
    none = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    lower = base | none | {"showlegend": False}
    fill = {"fill": "tonexty", "fillcolor": _faint(colour), "y": upper}
    return [lower, base | none | fill]


def _abscissa(x: Array) -> dict[str, Any]:
    """Values, or start and step where they are equally spaced: half the size in the page."""
    steps = np.diff(x)
    if x.size > 100 and np.ptp(steps) <= 1e-6 * abs(steps[0]):
        return {"x0": float(x[0]), "dx": float((x[-1] - x[0]) / (x.size - 1))}
    return {"x": x.astype(np.float32)}


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.4)"


def _layout(picture: Picture, rows: int) -> dict[str, Any]:
    """Axes one above the other, the lower ones less high; a plain, light look."""
    grid = {
        "gridcolor": "#e5e7eb",
        "zerolinecolor": "#cbd5e1",
        "linecolor": "#9ca3af",
        "ticks": "outside",
        "automargin": True,
    }
    layout: dict[str, Any] = {
        "template": None,
        "height": picture.height,
        "margin": {"l": 70, "r": 15, "t": TOP, "b": MARGINS - TOP},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {
            "family": "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif",
            "size": 12.5,
            "color": "#1f2937",
        },
        "legend": {
            "orientation": "h",
            "x": 0.0,
            "y": 1.01,
            "yanchor": "bottom",
            "xanchor": "left",
            "font": {"size": 11.5},
        },
        "hovermode": "closest",
        "bargap": 0.35,
        "barmode": "group",
        "xaxis": grid | {"title": {"text": picture.x}, "anchor": f"y{rows if rows > 1 else ''}"},
    }
    if picture.log:
        ticks = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100]
        layout["xaxis"] |= {"type": "log", "tickvals": ticks}
    layout |= _ordinates(picture, grid)
    layout["shapes"] = [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": a,
            "x1": b,
            "y0": 0,
            "y1": 1,
            "layer": "below",
            "line": {"width": 0},
            "fillcolor": "rgba(31,111,178,0.07)",
        }
        for a, b in picture.shaded
    ]
    return layout


def wrapped(label: str, most: int) -> list[str]:
    """A label in lines of at most so many letters where its words allow it; a unit stays in one piece."""
    words = re.findall(r"\S*\[[^\]]*\]\S*|\S+", label)
    lines = words[:1]
    for word in words[1:]:
        if len(lines[-1]) + 1 + len(word) <= most:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def _ordinates(picture: Picture, grid: dict[str, Any]) -> dict[str, Any]:
    """One vertical axis a panel, from top to bottom."""
    found: dict[str, Any] = {}
    weights = [1.0] + [0.6] * (len(picture.panels) - 1)
    gap = 0.06
    unit = (1.0 - gap * (len(picture.panels) - 1)) / sum(weights)
    top = 1.0
    for row, (panel, weight) in enumerate(zip(picture.panels, weights, strict=True), 1):
        low = max(0.0, top - unit * weight)
        room = int(unit * weight * (picture.height - MARGINS) / LETTER)
        axis = grid | {
            "title": {"text": "<br>".join(wrapped(panel.y, room))},
            "domain": [low, min(1.0, top)],
            "anchor": "x",
        }
        if panel.log:
            axis |= {"type": "log", "exponentformat": "power", "dtick": 1}
        found["yaxis" if row == 1 else f"yaxis{row}"] = axis
        top = low - gap
    return found
