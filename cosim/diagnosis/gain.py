"""What the extension gains, measured on held-out windows by running the real FMUs of both packages on the log's command."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import fit_percent
from cosim.diagnosis.data import Record
from cosim.diagnosis.verdict import held_windows
from cosim.master import Runner

Array = NDArray[np.float64]

RECORDED = {
    "spool": ("dcv.spool",),
    "p_load": ("continuity.p_a", "continuity.p_b"),
    "p_supply": ("continuity.p_supply",),
    "slew": ("sensor.slew",),
}


@dataclass(frozen=True)
class Gain:
    """Error of one signal on held-out windows, before and after the extension, SI.

    Attributes:
        before, after: RMSE.
        ratio_ci95: interval of after/before, by resampling windows.
        fit_before, fit_after: best fit %, MATLAB's NRMSE fit.
    """

    before: float
    after: float
    ratio_ci95: tuple[float, float]
    fit_before: float
    fit_after: float


def run_package(path: Path, record: Record, start: Mapping[str, float]) -> dict[str, Array]:
    """Simulate an open package on the log's command with its FMUs; the signals that a log has, (n,) SI."""
    time = record.time
    with Runner(path) as runner:
        names = set(runner.system.components)
        wanted = {s: p for s, p in RECORDED.items() if all(n.partition(".")[0] in names for n in p)}
        record_names = [n for parts in wanted.values() for n in parts]
        result = runner.run(
            float(time[-1]),
            record.h,
            parameters=dict(start),
            inputs={"u": (time, record.signals["u"])},
            record=record_names,
        )
    found = {}
    for signal, parts in wanted.items():
        values = result.signals[parts[0]]
        found[signal] = values - result.signals[parts[1]] if len(parts) == 2 else values
    return found


def fit_or_nan(measured: Array, simulated: Array) -> float:
    """Best fit %, not a number where the measured signal is constant."""
    fit = fit_percent(measured, simulated)
    return float("nan") if fit is None else fit


def measure(
    record: Record, before: Mapping[str, Array], after: Mapping[str, Array], window: int, seed: int = 1
) -> dict[str, Gain]:
    """Errors on the held-out windows of `window` samples; intervals from 2000 resamplings of whole windows."""
    found = {}
    for signal in before:
        if signal not in record.signals:
            continue
        measured = record.signals[signal]
        count = measured.size // window
        held = held_windows(count)
        if not held.any():
            continue
        pick = np.repeat(held, window)
        y = measured[: count * window]
        squares = []
        for simulated in (before[signal], after[signal]):
            error = (y - simulated[: count * window]).reshape(count, window)[held]
            squares.append(np.mean(error**2, axis=1))
        rows = np.random.default_rng(seed).integers(0, held.sum(), (2000, int(held.sum())))
        ratios = np.sqrt(squares[1][rows].sum(axis=1) / np.maximum(squares[0][rows].sum(axis=1), 1e-300))
        low, high = np.quantile(ratios, [0.025, 0.975])
        found[signal] = Gain(
            float(np.sqrt(squares[0].mean())),
            float(np.sqrt(squares[1].mean())),
            (float(low), float(high)),
            fit_or_nan(y[pick], before[signal][: count * window][pick]),
            fit_or_nan(y[pick], after[signal][: count * window][pick]),
        )
    return found
