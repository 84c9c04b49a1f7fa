"""The linear reference beside each group and the whole: what a linear model of free order makes of the same data.

Where it beats the extended model on data held out, linear dynamics are missing, and a nonlinear cause named on top of
them would only stand in for these.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.noise import Whitener, Windows
from cosim.diagnosis.record.record import Record, each_left_out
from cosim.diagnosis.residuals.cross_validation import held_windows, left_out_steps
from cosim.diagnosis.thresholds import AS_WELL, PART_CROSSINGS, REFERENCE_PARTS, REFERENCE_WINDOWS
from cosim.inference.freeform import HATS
from cosim.inference.held_out import left_out, ratio_ci95
from cosim.inference.held_out import mean_squares as begun_anew
from cosim.inference.linear import Data, LinearModel, model_of, reference
from cosim.inference.pieces import Cuts, by_piece
from cosim.system.effects import play

Array = NDArray[np.float64]
Fitted = dict[tuple[str, str], LinearModel]  # (drive, signal) -> model of a free run over what judges it not

POINTS = 3000  # that a reference is fitted to at most, in each minute or less
POINTS_OF_LONG = 9000  # of a longer log
SEGMENT = 512  # samples of the spectrum that says how fine the points must lie
SHARE_KEPT = 0.98  # of a signal's power below the highest frequency that counts
POINTS_A_CYCLE = 8  # of that frequency
COARSEST = 1000  # samples in one point
FINEST = 10  # times as many points as usual at most
PLAY = 0.02  # of a command's range, by which the way is told that it goes
ORDER_PARTS = 8  # of a log, left out in turn to find the order: long beside its slowest motion


@dataclass(frozen=True)
class Reference:
    """A linear reference held against a model on the same held-out windows.

    Attributes:
        model: the reference.
        squares: (windows,) mean square of its error in each, SI.
        ours: (windows,) the same of the model, SI.
        span: s of a window of the fitted log itself, in which both are judged, without its mean where the group integrates;
            0 where they run freely over data held out.
        unseen: (windows,) mean square of the error of the model whose order the data that judge had no part in, SI, where
            the reference is one of fewer poles that they prefer: a bar, and no evidence.
    """

    model: LinearModel = field(repr=False)
    squares: Array = field(repr=False)
    ours: Array = field(repr=False)
    span: float = 0.0
    unseen: Array | None = field(default=None, repr=False)

    @property
    def evidence(self) -> "Reference":
        """The reference of which the data that judge knew nothing."""
        return self if self.unseen is None else replace(self, squares=self.unseen, unseen=None)

    @property
    def ahead(self) -> bool:
        """True if the model surely errs more than a linear one, and by so much that anybody would mind."""
        one = self.evidence
        return ratio_ci95(one.ours, one.squares)[0] > 1.0 and one.ours_error >= AS_WELL * one.error

    @property
    def error(self) -> float:
        """RMSE of the reference, SI."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def ours_error(self) -> float:
        """RMSE of the model, SI."""
        return float(np.sqrt(self.ours.mean()))

    @property
    def clearly_better(self) -> bool:
        """True if the reference's error is smaller by more than chance and by so much that anybody would mind."""
        if self.squares.size < REFERENCE_WINDOWS or self.ours_error < AS_WELL * self.error:
            return False
        return ratio_ci95(self.squares, self.ours)[1] < 1.0

    @property
    def words(self) -> str:
        """Order, poles and delay in words."""
        return described(self.model)


def described(model: LinearModel) -> str:
    """Order, poles and delay of a linear model in words."""
    sections = model.sections
    if not model.order:
        return "a constant gain"
    parts = []
    for rate in sections.first:
        slow = rate * model.length < 1.0
        parts.append("an integrator" if slow else f"a lag of {1.0 / rate:.3g} s")
    for w, zeta in sections.second:
        if zeta >= 1.0:
            fast, slow_ = w * (zeta + np.sqrt(zeta**2 - 1.0)), w / (zeta + np.sqrt(zeta**2 - 1.0))
            parts.append(f"lags of {1.0 / slow_:.3g} and {1.0 / fast:.3g} s")
        else:
            parts.append(f"a mode at {w:.3g} rad/s with damping {zeta:.2g}")
    if sections.delay > 0.5 * model.h:
        parts.append(f"a delay of {sections.delay:.3g} s")
    return f"order {model.order}: {', '.join(parts)}"


@dataclass(frozen=True)
class Uniform:
    """A signal pair on even times, and the window of each point.

    Attributes:
        u, y: (n,) SI, every `h` s.
        window: (n,) number of the window of each point, -1 for none.
        cuts: first point of each log but the first.
    """

    u: Array
    y: Array
    h: float
    window: NDArray[np.int64]
    cuts: Cuts = ()


def quickest(y: Array, time: Array, h: float) -> int:
    """Samples (at most `COARSEST`) that may be taken as one without losing what a signal (m,) does, sampled every `h` s."""
    even = np.interp(np.arange(time[0], time[-1], h), time, y)
    if even.size < 2 * SEGMENT:
        return COARSEST
    frequency, power = welch(even, 1.0 / h, nperseg=SEGMENT)
    total = np.cumsum(power)
    highest = float(frequency[np.searchsorted(total, SHARE_KEPT * total[-1])])
    return int(np.clip(1.0 / (POINTS_A_CYCLE * max(highest, 1e-300) * h), 1, COARSEST))


def evened(
    u: Array,
    y: Array,
    time: Array,
    h: float,
    window: NDArray[np.int64],
    step: float | None = None,
    cuts: Cuts = (),
) -> Uniform:
    """A drive held from stamp to stamp and a signal (m,) at stamps (m,) on even times, few enough to fit often.

    Args:
        u: the drive, SI.
        y: the signal, SI.
        time: stamps, s.
        h: usual interval, s.
        window: (m,) window of each sample, -1 for none.
        step: interval wanted, s; by default whole samples, so many that there are not too many points.
        cuts: first sample of each log but the first.
    """
    length = float(time[-1] - time[0]) + h
    if step is None:
        wanted = max(1, int(np.ceil(length / h / min(POINTS_OF_LONG, max(POINTS, POINTS * length / 60.0)))))
        step = h * min(wanted, max(quickest(y, time, h), wanted // FINEST))
    if cuts:
        each = [
            evened(*part, step=step)
            for part in zip(
                np.split(u, cuts),
                np.split(y, cuts),
                np.split(time, cuts),
                [h] * (len(cuts) + 1),
                np.split(window, cuts),
                strict=True,
            )
        ]
        ends = np.cumsum([part.u.size for part in each])
        u, y, window = (np.concatenate([getattr(p, n) for p in each]) for n in ("u", "y", "window"))
        return Uniform(u, y, step, window, tuple(ends[:-1].tolist()))
    count = int(length / step + 1e-9)
    edges = time[0] + np.arange(count + 1) * step
    ends = np.append(time, time[-1] + h)
    area = np.concatenate([[0.0], np.cumsum(u * np.diff(ends))])
    mean = np.diff(np.interp(edges, ends, area)) / step
    # what the drive does within a bin shows from its end on
    at = edges[:-1]
    if step > 1.5 * h:
        area = np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(time))])
        low, high = np.clip(at - 0.5 * step, time[0], time[-1]), np.clip(at + 0.5 * step, time[0], time[-1])
        smooth = (np.interp(high, time, area) - np.interp(low, time, area)) / np.maximum(high - low, 1e-12)
    else:
        smooth = np.interp(at, time, y)
    near = np.clip(np.searchsorted(time, at - 0.5 * h), 0, time.size - 1)
    return Uniform(mean, np.asarray(smooth), step, window[near])


def data_of(pair: Uniform, demean: bool, keep: NDArray[np.bool_]) -> Data:
    """What a reference is fitted to: the points of some windows, each window with an offset of its own or not."""
    use = np.flatnonzero(keep)
    number = pair.window[use]
    starts = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    counts = np.diff(np.append(starts, number.size))

    def rows(signals: Array) -> Array:
        found = signals.take(use, axis=1)
        if demean:
            means = np.add.reduceat(found, starts, axis=1) / counts
            found = found - np.repeat(means, counts, axis=1)
        return np.asarray(found)

    return Data(pair.u, pair.y, pair.h, rows, number, pair.cuts)


def windows_of(rule: Whitener, count: int) -> NDArray[np.int64]:
    """(count,) window of each sample by a whitening rule, -1 for none."""
    return rule.layout.numbers(count)


def mean_squares(values: Array, window: NDArray[np.int64], demean: bool) -> Array:
    """(windows,) mean square of values (n,) in each window, with or without an offset of its own."""
    use = window >= 0
    number, counted = window[use], values[use]
    count = np.maximum(np.bincount(number), 1)
    squares = np.bincount(number, weights=counted**2) / count
    if demean:
        squares = squares - (np.bincount(number, weights=counted) / count) ** 2
    return np.asarray(squares)


def enough_parts(*errors: Array) -> int:
    """Parts into which errors (n,) may be cut such that each part says something of its own.

    A part holds several swings of the slower error: neighbouring parts of an error that drifts would count it twice.
    """
    crossings = min(int(np.count_nonzero(np.diff(np.signbit(e - e.mean())))) for e in errors)
    return min(REFERENCE_PARTS, crossings // PART_CROSSINGS)


def finer(window: NDArray[np.int64], errors: tuple[Array, Array]) -> NDArray[np.int64]:
    """(n,) windows numbered from 0, each cut in equal parts where they are few and the errors (n,) allow it; -1 for none."""
    inside = np.flatnonzero(window >= 0)
    known, number = np.unique(window[inside], return_inverse=True)
    each = max(1, enough_parts(*(e[inside] for e in errors)) // max(known.size, 1))
    found = np.full(window.size, -1)
    for k in range(known.size):
        for i, part in enumerate(np.array_split(inside[number == k], each)):
            found[part] = each * k + i
    return found


def centred(values: Array, window: NDArray[np.int64]) -> Array:
    """Values (n,), each window without its mean."""
    use = window >= 0
    means = np.bincount(window[use], weights=values[use]) / np.maximum(np.bincount(window[use]), 1)
    return np.asarray(values - np.where(use, means[np.maximum(window, 0)], 0.0))


def of_group(task: Task, found: Fit, time: Array) -> Reference:
    """The reference of a group's first signal, both judged in windows that had no share in their estimates.

    Args:
        task: data and model of the group.
        found: the fitted model.
        time: (n,) stamps, s.
    """
    return beside(task, found, time, reference)


def of_same_order(task: Task, found: Fit, time: Array) -> Reference:
    """The same with a linear model of no more dynamics than a drive by itself has, a lag, and without a delay."""
    group = task.model.group
    highest = 1 if group.is_speed(next(iter(task.measured))) or not group.integrates else 2

    def plain(data: Data) -> LinearModel:
        sections = replace(reference(data, highest).sections, delay=0.0)
        return model_of(data, sections, data.rows(data.y[None])[0])

    return beside(task, found, time, plain)


def beside(task: Task, found: Fit, time: Array, fit: Callable[[Data], LinearModel]) -> Reference:
    """A group's model beside the linear one that `fit` makes of the same data; as `of_group`."""
    signal = next(iter(task.measured))
    rule = task.rules[signal]
    y = task.measured[signal]
    window = windows_of(rule, y.size)
    cuts = task.model.cuts
    pair = evened(task.model.drive, y, time, task.model.h, window, cuts=cuts)
    model = fit(data_of(pair, rule.demean, pair.window >= 0))
    left = np.zeros(pair.u.size)
    left[pair.window >= 0] = model.left_out
    # the same smoothing for both: what lies within a bin is noise
    ours = y - left_out_prediction(task, found, signal)
    own = evened(task.model.drive, ours, time, task.model.h, window, pair.h, cuts)
    error = centred(own.y, own.window) if rule.demean else own.y  # of the reference it is so already
    parts = finer(own.window, (left, error))
    span = rule.bins * rule.window * task.model.h
    return Reference(model, mean_squares(left, parts, False), mean_squares(error, parts, False), span)


def of_curve(task: Task, record: Record, held: Record | None = None, first: int = 0) -> float:
    """RMSE of a free curve of the drive, one each way, in the windows or on the data that judge a reference, SI.

    It knows no time. Slow modes trace the bends of any curve where a command ramps up and down but once or twice.

    Args:
        task: data of the group.
        record: the log that is fitted.
        held: the record that holds the data held out; without it each window is judged by the others.
        first: sample of it from which errors count.
    """
    signal, drive = next(iter(task.measured)), task.model.group.drive
    rule, u, y = task.rules[signal], task.model.drive, task.measured[signal]
    window = windows_of(rule, y.size)
    pair = evened(u, y, record.time, task.model.h, window, cuts=task.model.cuts)
    data = data_of(pair, rule.demean and held is None, pair.window >= 0)
    knots = np.unique(np.quantile(pair.u, np.linspace(0.0, 1.0, HATS)))

    def curve(of: Array, cuts: Cuts) -> Array:
        hats = [np.interp(of, knots, one) for one in np.eye(knots.size)]
        half = {"half_width": PLAY * float(np.ptp(knots))}
        return np.stack([*hats, by_piece(lambda x: play(x, pair.h, half), cuts, of) - of])

    rows, slopes = data.rows(pair.y[None])[0], data.rows(curve(pair.u, pair.cuts)).T
    gains = np.linalg.lstsq(slopes, rows, rcond=None)[0]
    if held is None:
        return float(np.sqrt(np.mean(left_out(rows - slopes @ gains, slopes, data.block) ** 2)))
    error = held.signals[signal] - gains @ curve(held.signals[drive], held.cuts)
    return float(np.sqrt(np.mean(error[first:] ** 2)))


def left_out_prediction(task: Task, found: Fit, signal: str) -> Array:
    """(n,) prediction of a signal, each window with the estimate that the others give, SI."""
    names, steps = left_out_steps(task, found)
    at_best = task.model.simulate(found.values)[signal]
    predicted = at_best.copy()
    window = windows_of(task.rules[signal], predicted.size)
    inside = np.flatnonzero(window >= 0)
    for name, moves in zip(names, steps.T, strict=True):
        size = float(np.max(np.abs(moves)))
        if size > 0.0:
            other = task.model.simulate(found.values | {name: found.values[name] + size})[signal]
            predicted[inside] += (other - at_best)[inside] / size * moves[window[inside]]
    return np.asarray(predicted)


def over_logs(
    task: Task, record: Record, held: Record, first: int, squares: Array, fitted: Fitted
) -> Reference | None:
    """The reference of a group's first signal, fitted to one log as a free run and judged on held-out data as one.

    Args:
        task: data of the group.
        record: the log that is fitted.
        held: the record that holds the data held out; the same machine.
        first: sample of it from which errors count.
        squares: (windows,) mean square of the model's error there, SI.
        fitted: models of this log that are known; it grows.
    """
    signal, drive = next(iter(task.measured)), task.model.group.drive
    if signal not in held.signals or drive not in held.signals:
        return None
    model = fitted_to(record, drive, signal, fitted)
    left = free_run(model, held, first, drive, signal, squares.size, task.model.group.drifts)
    return Reference(model, np.maximum(left, held.rounding(signal) ** 2), squares)


def fitted_to(
    record: Record, drive: str, signal: str, fitted: Fitted, window: int | None = None
) -> LinearModel:
    """The linear model from a drive to a signal, a free run each log; into `fitted`, if it is not there.

    Fitted to a whole record, or to all its windows of `window` samples but those that judge it.
    """
    if (drive, signal) not in fitted:
        count = record.time.size
        if window is None:
            numbers, held = np.arange(count) * ORDER_PARTS // count, np.zeros(ORDER_PARTS, dtype=bool)
        else:
            numbers, held = judging_windows(record, window)
        pair = evened(
            record.signals[drive], record.signals[signal], record.time, record.h, numbers, cuts=record.cuts
        )
        model = reference(fit_data(pair, held))
        if pair.h > record.h:
            fine = evened(
                record.signals[drive],
                record.signals[signal],
                record.time,
                record.h,
                numbers,
                record.h,
                record.cuts,
            )
            model = with_gains_of(model, fit_data(fine, held))
        fitted[drive, signal] = model
    return fitted[drive, signal]


def fit_data(pair: Uniform, held: NDArray[np.bool_]) -> Data:
    """The points (n,) of all windows but those that judge (windows,)."""
    return data_of(pair, False, (pair.window >= 0) & ~held[np.maximum(pair.window, 0)])


def with_gains_of(model: LinearModel, data: Data) -> LinearModel:
    """A model with the gains that finer data give it, its poles kept.

    Of poles as quick as the samples coarser data show the sum only: gains that cancel there do not between these.
    """
    solved = data.solved(model.sections, data.rows(data.y[None])[0])
    lower = tuple(with_gains_of(one, data) for one in model.lower)
    # what is too slow to be told from an integrator depends on the length by which the gains were found
    return replace(model, gains=solved.gains, length=data.length, rest=data.rest, lower=lower)


def least_left(
    model: LinearModel, judge: Callable[[LinearModel], Array]
) -> tuple[LinearModel, Array, Array | None]:
    """The linear model, or the one of lower order, that leaves least of the data that judge.

    Blocks of a short log that are left out in turn may ask for poles that run off on other data. What is told of a linear
    model is a bar, which is as high as the best of no more poles sets it.

    Returns:
        It, what `judge` says of it, and of the model itself where that is another.
    """
    each = [(one, judge(one)) for one in (model, *reversed(model.lower))]
    best, left = min(each, key=lambda item: float(item[1].mean()))
    return best, left, None if best is model else each[0][1]


def free_run(
    model: LinearModel, held: Record, first: int, drive: str, signal: str, parts: int, anew: bool = False
) -> Array:
    """(parts,) mean squares of a linear model's error over a record from sample `first` on.

    With `anew` the prediction begins in each part where the machine stands.
    """
    window = parted(held.time.size, first, parts)
    # simulated as finely as it was measured: the poles do not know the steps of the fit
    other = evened(
        held.signals[drive], held.signals[signal], held.time, held.h, window, held.h, cuts=held.cuts
    )
    simulated = by_piece(lambda u, y: model.simulate(u, y, held.h), other.cuts, other.u, other.y)
    error, inside = other.y - simulated, np.flatnonzero(other.window >= 0)
    if not anew:
        return mean_squares(error, other.window, False)
    begins = tuple(c - int(inside[0]) for c in other.cuts)
    return begun_anew(error[inside], parts, True, begins)


def parted(count: int, first: int, parts: int) -> NDArray[np.int64]:
    """(count,) number of the part of each sample from `first` on, -1 before."""
    window = np.full(count, -1)
    for k, part in enumerate(np.array_split(np.arange(first, count), parts)):
        window[part] = k
    return window


def across(
    record: Record,
    held: Record,
    first: int,
    drive: str,
    signals: Iterable[str],
    after: Mapping[str, Array],
    window: int,
    anew: Collection[str],
    fitted: Fitted,
) -> dict[str, Reference]:
    """The reference from the command to each signal, fitted to one log and judged on held-out data, as free runs.

    Args:
        record: the log that is fitted.
        held: the record that holds the data held out.
        first: sample of it from which errors count.
        drive: the command.
        signals: those of which a reference is wanted.
        after: signal -> (n,) what the extended model makes of it over the held-out record, SI.
        window: samples in a window.
        anew: signals that are predicted over a window at a time, from where the machine stands.
        fitted: models of the fitted log that are known; it grows.
    """
    found = {}
    cuts = tuple(c - first for c in held.cuts)
    for signal in (s for s in signals if s in held.signals and s in after):
        error, begins = (held.signals[signal] - after[signal])[first:], signal in anew
        parts = max(1, round(error.size / window), 0 if begins else enough_parts(error))
        judge = partial(
            free_run, held=held, first=first, drive=drive, signal=signal, parts=parts, anew=begins
        )
        model, left, unseen = least_left(fitted_to(record, drive, signal, fitted), judge)
        found[signal] = Reference(model, left, begun_anew(error, parts, begins, cuts), unseen=unseen)
    return found


def judging_windows(record: Record, window: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(n,) window of `window` samples of each sample, -1 for none, and (windows,) true for those that judge."""
    numbers = Windows(window, 0, record.cuts).numbers(record.time.size)
    return numbers, held_windows(int(numbers.max()) + 1)


def of_whole(
    record: Record,
    drive: str,
    signals: Iterable[str],
    after: Mapping[str, Array],
    window: int,
    fitted: Fitted,
) -> dict[str, Reference]:
    """The reference from the command to each signal, both judged on every third window of one log as free runs.

    Args:
        record: the log.
        drive: the command.
        signals: those of which a reference is wanted.
        after: signal -> (n,) what the extended model makes of it, SI.
        window: samples in a window.
        fitted: models of the other windows that are known; it grows.
    """
    found = {}
    numbers, held = judging_windows(record, window)
    if not held.any():
        return {}
    for signal in signals:
        u, y = record.signals[drive], record.signals[signal]
        fine = evened(u, y, record.time, record.h, numbers, record.h)
        own = evened(u, y - after[signal], record.time, record.h, numbers, record.h)
        judges = (fine.window >= 0) & held[np.maximum(fine.window, 0)]

        def judge(model: LinearModel, of: Uniform = fine, at: NDArray[np.bool_] = judges) -> Array:
            return np.asarray((of.y - model.predicted(of.u, record.h))[at] ** 2)

        chosen = fitted_to(record, drive, signal, fitted, window)
        model, *_ = least_left(chosen, judge)
        errors = [fine.y - m.predicted(fine.u, record.h) for m in (model, chosen)]
        parts = finer(np.where(judges, fine.window, -1), (errors[1], own.y))
        left, unseen, ours = (mean_squares(e, parts, False) for e in (*errors, own.y))
        found[signal] = Reference(model, left, ours, unseen=None if model is chosen else unseen)
    return found


def in_turn(
    record: Record,
    drive: str,
    signals: Iterable[str],
    errors: Mapping[str, Array],
    window: int,
) -> dict[str, Reference]:
    """The reference from the command to each signal, fitted to all logs but one and judged on that one, each in turn.

    Args:
        record: the logs.
        drive: the command.
        signals: those of which a reference is wanted.
        errors: signal -> (n,) of the extended model, each log without a share in its estimates, SI.
        window: samples in a window.
    """
    found, folds = {}, each_left_out(record)
    for signal in signals:
        models, ours = [], []
        for (others, own), error in zip(folds, np.split(errors[signal], record.cuts), strict=True):
            parts = max(1, round(error.size / window))
            model = fitted_to(others, drive, signal, {})
            each = {m.order: (m, free_run(m, own, 0, drive, signal, parts)) for m in (*model.lower, model)}
            models.append(each)
            ours.append(mean_squares(error, parted(error.size, 0, parts), False))
        # of one order at most in all of them, as in `least_left`
        bars = [
            [each[max(k for k in each if k <= most)] for each in models]
            for most in range(max(map(min, models)), max(map(max, models)) + 1)
        ]
        best = min(bars, key=lambda bar: float(np.concatenate([left for _, left in bar]).mean()))
        middle = sorted((m for m, _ in best), key=lambda m: m.order)[len(best) // 2]  # of which the words are
        left, unseen = (np.concatenate([left for _, left in bar]) for bar in (best, bars[-1]))
        found[signal] = Reference(middle, left, np.concatenate(ours), unseen=unseen)
    return found
