"""What a finished batch says: quantiles of the scores, what they depend on, thresholds, failures."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cosim.batch.parameters import Varied
from cosim.errors import UsageError
from cosim.signals import SIGNALS
from cosim.ssp.hints import did_you_mean
from cosim.units import parse_quantity

Array = NDArray[np.float64]

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
FEWEST = 4  # runs from which a rank correlation is given
FIRST = ("run", "model", "log", "status", "reason", "seconds", "worker")


def heading(parameter: Varied) -> str:
    """Column of a parameter in the table of runs."""
    return f"{parameter.name} [{parameter.display[0]}]" if parameter.numeric else parameter.name


def score_columns(frame: pd.DataFrame, varied: Sequence[Varied]) -> list[str]:
    """The columns of numbers that came out of the runs."""
    inputs = {heading(parameter) for parameter in varied}
    return [
        name
        for name in frame.columns
        if name not in inputs and name not in FIRST and pd.api.types.is_numeric_dtype(frame[name])
    ]


def quantiles(frame: pd.DataFrame, columns: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """Of each column: smallest and largest value and QUANTILES, over the runs that were done."""
    found: dict[str, dict[str, float | None]] = {}
    done = frame[frame["status"] == "done"]
    for name in columns:
        values = done[name].to_numpy(dtype=float)
        values = values[np.isfinite(values)]
        if values.size:
            levels = np.quantile(values, (0.0, *QUANTILES, 1.0)).tolist()
            names = ("min", *(f"q{round(100 * q):02d}" for q in QUANTILES), "max")
            found[name] = dict(zip(names, levels, strict=True))
    return found


def sensitivity(
    frame: pd.DataFrame, varied: Sequence[Varied], columns: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Spearman's rank correlation of each score with each parameter: score -> parameter -> from -1 to 1.

    Where several models or logs are in the table, ranks are taken within each of them.
    """
    done = frame[frame["status"] == "done"]
    numeric = [parameter for parameter in varied if parameter.numeric]
    found: dict[str, dict[str, float]] = {}
    groups = [part for _, part in done.groupby(["model", "log"], dropna=False)]
    for name in columns:
        row = {}
        for parameter in numeric:
            parts = [_rank_correlation(part[heading(parameter)], part[name]) for part in groups]
            known = [value for value in parts if value is not None]
            if known:
                row[parameter.name] = float(np.mean(known))
        if row:
            found[name] = row
    return found


def _rank_correlation(x: "pd.Series[Any]", y: "pd.Series[Any]") -> float | None:
    pair = np.column_stack([x.to_numpy(dtype=float), y.to_numpy(dtype=float)])
    pair = pair[np.isfinite(pair).all(axis=1)]
    if len(pair) < FEWEST or np.ptp(pair[:, 0]) == 0.0 or _constant(pair[:, 1]):
        return None
    ranks = pd.DataFrame(pair).rank()
    return float(ranks[0].corr(ranks[1]))


def _constant(values: Array) -> bool:
    """Whether values (n,) differ by no more than rounding."""
    return bool(np.ptp(values) <= 1e-12 * np.max(np.abs(values)))


def check_thresholds(texts: Mapping[str, str], known: Sequence[str]) -> None:
    """Refuse a threshold that can never be judged, before any run.

    Raises:
        UsageError: an unknown signal, or a text that is no number with a unit of its kind.
    """
    for name, text in texts.items():
        if name not in known and name not in SIGNALS:
            names = [*known, *SIGNALS]
            raise UsageError(f"--threshold: there is no signal '{name}'{did_you_mean(name, names)}")
        if name in SIGNALS:
            _limit(name, text, SIGNALS[name].unit)


def _limit(name: str, text: str, unit: str) -> float:
    try:
        return parse_quantity(text, unit)
    except UsageError as error:
        raise UsageError(f"--threshold {name}: {error}") from None


def thresholds(frame: pd.DataFrame, texts: Mapping[str, str]) -> list[dict[str, Any]]:
    """Each limit, the largest RMSE of its signal over all runs, how many runs miss it, and whether it is kept.

    Raises:
        UsageError: no run compares the signal.
    """
    results = []
    done = frame[frame["status"] == "done"]
    for name, text in texts.items():
        column = next((c for c in frame.columns if str(c).startswith(f"{name} rmse [")), None)
        if column is None:
            raise UsageError(f"--threshold {name}: no run compares this signal")
        unit = column[column.rindex("[") + 1 : -1]
        limit, values = _limit(name, text, unit), done[column].to_numpy(dtype=float)
        missed = int(np.sum(~(values[np.isfinite(values)] <= limit)))
        largest = float(np.nanmax(values)) if np.isfinite(values).any() else None
        results.append(
            {
                "signal": name,
                "unit": unit,
                "limit": limit,
                "rmse": largest,
                "runs_missed": missed,
                "passed": not missed and largest is not None,
            }
        )
    return results


def failures(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Number and reason of each failed run."""
    failed = frame[frame["status"] == "failed"]
    return [{"run": int(row.run), "reason": row.reason} for row in failed.itertuples()]
