"""A comparison for people (tables), programs (plain data) and other tools (a table of series)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import WINDOW
from cosim.compare.outcome import BlockOutcome, Comparison, SignalOutcome
from cosim.compare.recording import WHOLE
from cosim.files import whole
from cosim.report.names import known_as

if TYPE_CHECKING:
    from rich.table import Table

SIGNALS_TITLE = "Signals (model driven by the command alone)"
BLOCKS_TITLE = "Blocks (each driven by what was measured)"
NOISY = (
    1.2  # times its noise within which an error is not told from it: noise floors are known to a tenth or two
)
ROWS = 1 << 18  # written at a time, and to a row group: every series of a log at once is a lot
_NUMBERS = ("RMSE", "fit %", "largest", f"RMSE {WINDOW:g} s*", "noise", "x noise")


def tables(comparison: Comparison) -> "list[Table]":
    """The two tables, without rows where nothing can be judged; they fit a terminal of 80 columns."""
    signals = [_cells(comparison, found) for found in comparison.signals.values()]
    blocks: list[list[str]] = []
    for block in comparison.blocks:
        blocks.append([f"{block.name}, driven by {', '.join(block.driven_by)}"] + [""] * (len(_NUMBERS) - 1))
        for found in block.signals.values():
            name, *numbers = _cells(comparison, found)
            blocks.append([f"  {name}", *numbers[:2], *numbers[3:]])
    short = [name for name in _NUMBERS if name != "largest"]
    return [
        _table(SIGNALS_TITLE, "signal", _NUMBERS, signals),
        _table(BLOCKS_TITLE, "block, signal", short, blocks),
    ]


def above_noise(comparison: Comparison) -> bool:
    """Whether the simulation is off by more than noise anywhere, or that cannot be told."""
    ratios = [found.score.ratio for found in comparison.signals.values()]
    return any(ratio is None or ratio > NOISY for ratio in ratios)


def answer(comparison: Comparison) -> list[str]:
    """What a comparison says, in a few lines: what is most wrong, where it arises, what agrees, what was not judged."""
    found = []
    judged = [s for s in comparison.signals.values() if s.score.ratio is not None]
    off = sorted((s for s in judged if _ratio(s) > NOISY), key=_ratio, reverse=True)
    if off:
        found.append(f"Most wrong: {_error(comparison, off[0])}")
        worst = comparison.worst
        if worst is not None and _ratio(worst[1]) > NOISY:
            block, signal = worst
            driven = ", ".join(map(known_as, block.driven_by))
            found.append(
                f"It arises in: {block.name}, driven by {driven}, in the {known_as(signal.signal)}: "
                f"{_ratio(signal):.3g} times its noise"
            )
        if len(off) > 1:
            found.append("Also above noise: " + "; ".join(_error(comparison, s) for s in off[1:]))
    near = [known_as(s.signal) for s in judged if _ratio(s) <= NOISY]
    if near:
        found.append(f"Within noise: {', '.join(near)}")
    blind = [_error(comparison, s) for s in comparison.signals.values() if s.score.ratio is None]
    if blind:
        found.append("Error, with no noise to hold it against: " + "; ".join(blind))
    return found + _unjudged(comparison)


def _ratio(found: SignalOutcome) -> float:
    return found.score.ratio or 0.0


def _error(comparison: Comparison, found: SignalOutcome) -> str:
    """``slew angle (slew): 0.174 deg RMSE, fit 72.5 %, 13.8 times its noise``."""
    unit, scale = comparison.shown(found.signal)
    score = found.score
    text = f"{known_as(found.signal)}: {score.rmse * scale:.3g}{'' if unit == '1' else ' ' + unit} RMSE"
    if not score.constant and score.fit_percent is not None:
        text += f", fit {score.fit_percent:.1f} %"
    return text if score.ratio is None else f"{text}, {score.ratio:.3g} times its noise"


def _unjudged(comparison: Comparison) -> list[str]:
    return [f"Not judged: {' + '.join(item.components)}: {item.why}." for item in comparison.not_judged]


def _table(title: str, first: str, numbers: Sequence[str], rows: list[list[str]]) -> "Table":
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    result = Table(title=title, box=SIMPLE_HEAD, title_justify="left", padding=(0, 0, 0, 1))
    result.add_column(first, overflow="fold")
    for name in numbers:
        result.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        result.add_row(*(escape(cell) for cell in row))
    return result


def explanations(comparison: Comparison) -> list[str]:
    """What stands below the tables, one sentence each."""
    lines = []
    outcomes = [*comparison.signals.values(), *(s for b in comparison.blocks for s in b.signals.values())]
    if any(found.score.rmse_windows is not None for found in outcomes):
        lines.append(
            f"* root mean square error in windows of {WINDOW:g} s, each with a free offset, since integrating blocks let "
            "noise drift; 'x noise' is of it. Under Blocks, RMSE and fit of these signals have one free offset as well."
        )
    if any(found.score.constant for found in outcomes):
        lines.append("A fit of 'constant' means that the signal does not stand out from its noise.")
    worst = comparison.worst
    if worst is not None and worst[1].score.ratio is not None:
        block, found = worst
        lines.append(
            f"Largest block error against noise: {block.name}, in {found.signal}, {found.score.ratio:.3g} times its noise."
        )
    return lines + _unjudged(comparison)


def _cells(comparison: Comparison, found: SignalOutcome) -> list[str]:
    """``signal [unit]`` and the columns of `_NUMBERS`."""
    unit, scale = comparison.shown(found.signal)
    score = found.score
    fit = "constant" if score.constant or score.fit_percent is None else f"{score.fit_percent:.2f}"
    windows = "" if score.rmse_windows is None else f"{score.rmse_windows * scale:.3g}"
    ratio = "-" if score.ratio is None else f"{score.ratio:.3g}"
    rmse, largest, noise = (f"{x * scale:.3g}" for x in (score.rmse, score.max_error, score.noise_floor))
    return [f"{found.signal} [{unit}]", rmse, fit, largest, windows, noise, ratio]


def as_data(comparison: Comparison, source: Path | None = None) -> dict[str, Any]:
    """The comparison as plain data without arrays; numbers of a signal are in its ``unit``.

    Args:
        comparison: what was found.
        source: the model's file.
    """
    log = comparison.log
    return {
        "log": {
            "path": log.source,
            "synthetic": log.synthetic,
            "sha256": log.sha256,
            "samples": len(log),
            "duration": comparison.time[-1] - comparison.time[0],
            "step_size": comparison.step,
        },
        "model": {"name": comparison.model, "path": source, "parameters": comparison.parameters},
        "command": comparison.command,
        "signals": {name: _numbers(comparison, found) for name, found in comparison.signals.items()},
        "blocks": [_block(comparison, block) for block in comparison.blocks],
        "not_judged": comparison.not_judged,
        "window": WINDOW,
        "notes": comparison.notes,
    }


def _block(comparison: Comparison, block: BlockOutcome) -> dict[str, Any]:
    return {
        "block": block.name,
        "components": block.components,
        "driven_by": block.driven_by,
        "signals": {name: _numbers(comparison, found) for name, found in block.signals.items()},
    }


def _numbers(comparison: Comparison, found: SignalOutcome) -> dict[str, Any]:
    unit, scale = comparison.shown(found.signal)
    score = found.score
    return {
        "unit": unit,
        "rmse": score.rmse * scale,
        "fit_percent": score.fit_percent,
        "max_error": score.max_error * scale,
        "max_error_time": score.max_time,
        "rmse_windows": None if score.rmse_windows is None else score.rmse_windows * scale,
        "offset": None if score.offset is None else score.offset * scale,
        "noise_floor": score.noise_floor * scale,
        "error_to_noise": score.ratio,
        "constant": score.constant,
        "samples": score.samples,
    }


def series(comparison: Comparison, part: slice = WHOLE) -> dict[str, NDArray[np.float64]]:
    """Columns ``name [unit]`` (n,): time, then of each signal what was measured, simulated, and simulated block by block.

    A sample that was filled in is NaN in the measured column.

    Args:
        comparison: what was found.
        part: only these samples (a slice without step).
    """
    columns: dict[str, NDArray[np.float64]] = {"time [s]": comparison.time[part]}
    single = {name: found for block in comparison.blocks for name, found in block.signals.items()}
    for name in dict.fromkeys([*comparison.signals, *single]):
        found = comparison.signals.get(name) or single[name]
        unit, scale = comparison.shown(name)
        shown = np.where(found.valid[part], found.measured[part] * scale, np.nan)
        columns[f"{name}_measured [{unit}]"] = shown
        if name in comparison.signals:
            columns[f"{name}_simulated [{unit}]"] = comparison.signals[name].source(part) * scale
        if name in single:
            shifted = single[name].source(part) + (single[name].score.offset or 0.0)
            columns[f"{name}_by_block [{unit}]"] = shifted * scale
    return columns


def write_series(comparison: Comparison, path: Path) -> Path:
    """Write `series` as Parquet or CSV by the suffix; the Parquet file carries model, log and parameters as metadata."""
    import pyarrow as pa

    from cosim.console import to_jsonable

    about = {k: v for k, v in as_data(comparison).items() if k in ("log", "model", "notes")}
    schema = pa.table(series(comparison, slice(0, 0))).schema
    if path.suffix == ".parquet":
        schema = schema.with_metadata({"cosim": json.dumps(to_jsonable(about))})
    with whole(path) as part, _table_writer(part, schema) as writer:
        for first in range(0, len(comparison.time), ROWS):
            rows = series(comparison, slice(first, first + ROWS))
            writer.write_table(pa.table(rows).cast(schema))
    return path


def _table_writer(path: Path, schema: Any) -> Any:
    import pyarrow.csv
    import pyarrow.parquet

    if path.suffix == ".parquet":
        # measured numbers hardly repeat: a dictionary of them costs time and saves no room
        return pyarrow.parquet.ParquetWriter(path, schema, write_page_checksum=True, use_dictionary=False)
    return pyarrow.csv.CSVWriter(path, schema)
