"""What the extension gains, measured on held-out windows by running the real FMUs of both packages on the log's command."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import fit_percent, rms
from cosim.diagnosis.fitting.noise import Windows
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.record.grid import Grid, of_piece
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.cross_validation import held_windows
from cosim.inference.thresholds import FEWEST_PARTS, STANDS
from cosim.master import Runner

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gain:
    """Error of one signal on held-out windows, before and after the extension, SI.

    Attributes:
        before, after: RMSE.
        ratio_ci95: interval of after/before, by resampling windows.
        fit_before, fit_after: best fit %, MATLAB's NRMSE fit.
        horizon: s after which the prediction begins anew where the machine stands; infinite for one run over all.
        each: RMSE before and after in each of several logs that are held out.
    """

    before: float
    after: float
    ratio_ci95: tuple[float, float]
    fit_before: float
    fit_after: float
    horizon: float = float("inf")
    each: tuple[tuple[float, float], ...] = ()


def run_package(path: Path, record: Record, machine: Machine, start: Mapping[str, float]) -> dict[str, Array]:
    """Simulate an open package on a log's command with its FMUs; the signals that it has, at the log's samples, SI.

    Args:
        path: the package.
        record: the log, or several: one run for each.
        machine: the model.
        start: ``component.parameter`` -> SI of the start, of each log its own.
    """
    pieces = record.pieces
    each = [run_alone(path, piece, machine, of_piece(start, i)) for i, piece in enumerate(pieces)]
    return {s: np.concatenate([found[s] for found in each]) for s in each[0]}


def run_alone(path: Path, record: Record, machine: Machine, start: Mapping[str, float]) -> dict[str, Array]:
    """Simulate an open package on the command of one log."""
    wanted = {s: item.parts for s, item in machine.signals.items() if s in record.signals and item.parts}
    judged = {s for g in machine.groups for s in g.observed}
    wanted = {s: parts for s, parts in wanted.items() if s in judged}
    names, _ = machine.inputs()
    outputs = sorted({str(port) for parts in wanted.values() for port, _ in parts})
    shown = on_command(path, record, machine, names, start, outputs)
    return {
        signal: np.asarray(sum(factor * shown[str(port)] for port, factor in parts))
        for signal, parts in wanted.items()
    }


def on_command(
    path: Path,
    record: Record,
    machine: Machine,
    names: Sequence[str],
    start: Mapping[str, float],
    outputs: Sequence[str],
) -> dict[str, Array]:
    """Outputs of an open package, ``component.variable``, at the samples of one log whose command drives these inputs."""
    grid, held = record.grid, machine.groups[0].held
    drive = record.signals[machine.drive]
    time, step = record.time, record.h
    if isinstance(grid, Grid):
        time, step, drive = grid.time, grid.step, grid.driven(drive, held)
    with Runner(path) as runner:
        result = runner.run(
            float(time[-1]),
            step,
            parameters=dict(start),
            inputs=dict.fromkeys(names, (time, drive)),
            hold=names if held else (),
            record=outputs,
        )
    return {n: grid.sampled(v) if isinstance(grid, Grid) else v for n, v in result.signals.items()}


def begun_anew(
    record: Record, simulated: Mapping[str, Array], signals: Collection[str], window: int, first: int
) -> dict[str, Array]:
    """What was simulated, of some signals shifted in each window to where the machine stands at its start.

    Args:
        record: the log.
        simulated: signal -> (n,) of a free run, SI.
        signals: those of axes that drift.
        window: samples in a window.
        first: sample where the first begins.
    """
    edges = np.unique([*range(first, record.time.size, window), *record.cuts, record.time.size])
    found = dict(simulated)
    for signal in (s for s in signals if s in simulated and s in record.signals):
        shifted = simulated[signal].copy()
        for low, high in pairwise(edges[edges >= first]):
            there = slice(low, low + max(1, round(STANDS * (high - low))))
            shifted[low:high] += np.mean(record.signals[signal][there] - simulated[signal][there])
        found[signal] = shifted
    return found


def fit_or_nan(measured: Array, simulated: Array) -> float:
    """Best fit %, not a number where the measured signal is constant."""
    fit = fit_percent(measured, simulated)
    return float("nan") if fit is None else fit


def measure(
    record: Record,
    before: Mapping[str, Array],
    after: Mapping[str, Array],
    window: int,
    first: int | None = None,
    seed: int = 1,
) -> dict[str, Gain]:
    """Errors on what was held out; intervals from 2000 resamplings of whole windows, of a short log of parts of them.

    Args:
        record: the log.
        before: signal -> (n,) simulated by the nominal model.
        after: the same by the extended model.
        window: samples in a window.
        first: hold out all from this sample on; without it every third window is held out.
        seed: of the resampling.
    """
    found = {}
    for signal in before:
        if signal not in record.signals:
            continue
        y = record.signals[signal]
        start = first or 0
        edges = [start, *(cut for cut in record.cuts if cut > start), y.size]  # of the logs
        own = window
        if first is not None:
            # parts enough for an interval, none longer than the shortest log that is held out
            own = max(1, min(window, (y.size - start) // FEWEST_PARTS, int(np.diff(edges).min())))
        # whole windows of each log, as those of the fits
        rule = Windows(own, start, record.cuts)
        inside = rule.inside(y.size)
        count = inside.size // own
        held = held_windows(count) if first is None else np.ones(count, dtype=bool)
        if not held.any():
            continue
        pick = np.zeros(y.size, dtype=bool)
        pick[inside] = np.repeat(held, own)
        if first is not None:
            pick[start:] = True  # the last, shorter window too
        parts = -(-FEWEST_PARTS // int(held.sum()))  # of a short log's few windows, for an interval
        squares, whole = [], []
        for simulated in (before[signal], after[signal]):
            error = y - simulated
            cut = np.array_split(rule.rows(error)[held], min(parts, own), axis=1)
            squares.append(np.concatenate([np.mean(rows**2, axis=1) for rows in cut]))
            whole.append(float(np.sqrt(squares[-1].mean() if first is None else np.mean(error[pick] ** 2))))
        rows = np.random.default_rng(seed).integers(0, squares[0].size, (2000, squares[0].size))
        ratios = np.sqrt(squares[1][rows].sum(axis=1) / np.maximum(squares[0][rows].sum(axis=1), 1e-300))
        low, high = np.quantile(ratios, [0.025, 0.975])
        fits = [fit_or_nan(y[pick], simulated[signal][pick]) for simulated in (before, after)]
        logs = [slice(a, b) for a, b in pairwise(edges)] if first is not None and len(edges) > 2 else []
        each = tuple((rms((y - before[signal])[log]), rms((y - after[signal])[log])) for log in logs)
        found[signal] = Gain(whole[0], whole[1], (float(low), float(high)), fits[0], fits[1], each=each)
    return found
