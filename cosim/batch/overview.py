"""Pictures that are tables: the error of every model against every log, and the diagnoses of a folder of logs."""

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_PANELS, MOST_ROWS, COLUMNS = 9, 40, 3
VERDICTS = {
    "adequate": "#2e8b57",
    "explained": "#3182bd",
    "partly_explained": "#e6a817",
    "unexplained": "#c0392b",
}
FAILED = "#7f8c8d"


def new_figure(width: float, height: float) -> "Figure":
    """A figure of a size in inches whose parts make room for one another."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def scores_figure(frame: pd.DataFrame) -> "Figure | None":
    """RMSE of each signal: a row a log, a column a model."""
    columns = [c for c in frame.columns if " rmse [" in str(c) and ": " not in str(c)][:MOST_PANELS]
    if not columns or frame["log"].isna().all():
        return None
    logs, models = (list(dict.fromkeys(frame[key])) for key in ("log", "model"))
    shown = logs[:MOST_ROWS]
    across = min(COLUMNS, len(columns))
    lines = -(-len(columns) // across)
    height = 1.0 + 0.28 * len(shown)
    figure = new_figure(1.6 + 1.05 * (0.4 + len(models)) * across, 0.5 + height * lines)
    axes = figure.subplots(lines, across, squeeze=False, sharex=True, sharey=True)
    done = frame.assign(failed=frame["status"] != "done")
    failed = done.pivot_table(index="log", columns="model", values="failed", aggfunc="all")
    failed = failed.reindex(index=shown, columns=models).to_numpy(dtype=bool)
    for axis, column in zip(axes.flat, columns, strict=False):
        table = frame.pivot_table(index="log", columns="model", values=column, aggfunc="mean", dropna=False)
        _map(axis, table.reindex(index=shown, columns=models).to_numpy(dtype=float), failed)
        axis.set_xticks(range(len(models)), models, rotation=20, ha="right")
        axis.set_yticks(range(len(shown)), shown)
        axis.set_title(column.replace(" rmse", ""), loc="left")
    for axis in axes.flat[len(columns) :]:
        axis.set_visible(False)
    more = f" (the first {len(shown)} of {len(logs)} logs)" if len(logs) > len(shown) else ""
    figure.suptitle(f"RMSE of each model against each log{more}; dark is large in its panel", fontsize=10)
    return figure


def _map(axis: "Axes", values: Array, failed: NDArray[np.bool_]) -> None:
    """One panel: numbers on a shade; a dash where the model has no such signal."""
    top = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
    axis.imshow(values, aspect="auto", cmap="Blues", vmin=0.0, vmax=1.3 * top or 1.0)
    axis.grid(False)
    for (row, column), value in np.ndenumerate(values):
        text = f"{value:.3g}" if np.isfinite(value) else "failed" if failed[row, column] else "-"
        colour = "white" if np.isfinite(value) and value > 0.85 * top and top > 0.0 else "black"
        axis.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)


def diagnoses_figure(frame: pd.DataFrame) -> "Figure | None":
    """One line a log: verdict, causes, what stays unexplained, error before and after."""
    from matplotlib.transforms import Bbox

    rows = []
    for _, row in frame.head(MOST_ROWS).iterrows():
        if row["status"] != "done":
            rows.append([row["log"], row["status"], fill(str(row["reason"])[:160], 58), "", ""])
            continue
        before, after = row.get("slew rmse before [deg]"), row.get("slew rmse after [deg]")
        known = pd.notna(before) and pd.notna(after)
        gain = f"{before:.3g} → {after:.3g} deg" if known else ""
        causes = fill(str(row["causes"]), 58) if row["causes"] else "none"
        rows.append([row["log"], row["verdict"], causes, row["unexplained"] or "-", gain])
    if not rows:
        return None
    heights = [1 + max(str(cell).count("\n") for cell in row) for row in rows]
    figure = new_figure(11.0, 0.9 + 0.27 * sum(heights))
    axis = figure.add_subplot()
    axis.axis("off")
    heads = ["log", "verdict", "causes", "unexplained", "slew RMSE, held out"]
    table = axis.table(
        cellText=rows,
        colLabels=heads,
        colWidths=[0.18, 0.13, 0.4, 0.12, 0.17],
        cellLoc="left",
        bbox=Bbox.unit(),
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    unit = 1.0 / (1 + sum(heights))
    for (line, column), cell in table.get_celld().items():
        cell.set_height(unit * (1 if line == 0 else heights[line - 1]))
        cell.set_edgecolor("#d0d0d0")
        if line == 0:
            cell.set_text_props(weight="bold")
        elif column == 1:
            cell.set_text_props(color=VERDICTS.get(rows[line - 1][1], FAILED), weight="bold")
    more = f", the first {MOST_ROWS} of {len(frame)}" if len(frame) > MOST_ROWS else ""
    figure.suptitle(f"Diagnoses{more}", fontsize=10)
    return figure
