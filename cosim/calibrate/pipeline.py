"""The calibration on one page: search, find what the log determines, hold the rest, score on what was held out."""

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cosim.calibrate.determined import BLIND, correlated, described
from cosim.calibrate.estimates import at_bound, estimates
from cosim.calibrate.free import Free
from cosim.calibrate.outcome import Calibration, Series, SignalFit, Undetermined
from cosim.calibrate.problem import Problem
from cosim.calibrate.search import Found, refined, search
from cosim.calibrate.twin import Twin
from cosim.compare import Comparator, rms
from cosim.compare.metrics import Score, score
from cosim.errors import UsageError
from cosim.inference.sight import sight
from cosim.ssp.system import Value

Array = NDArray[np.float64]
HELD_OUT = 0.3  # of the log, at its end
STARTS = 4
LACKING = (
    2.0  # times its sensor's noise that a residual may have before a note says that the model lacks something
)
LEAST = 100  # samples to fit to


@dataclass(frozen=True)
class Options:
    """How to calibrate.

    Attributes:
        signals: fit to these; by default to all measured ones that are not made of others.
        held_out: part of the log, at its end, that is not fitted, 0 to 0.9.
        starts: of the search.
        seed: of the points from which further starts are taken.
        engine: "auto", "compiled" or "fmu".
        coloured: learn the noise from the residuals; otherwise it is white, of the size that each signal shows by itself.
        given: values that differ from the model's own and are not fitted, ``component.variable`` -> FMU's unit.
    """

    signals: Sequence[str] = ()
    held_out: float = HELD_OUT
    starts: int = STARTS
    seed: int = 1
    engine: str = "auto"
    coloured: bool = True
    given: Mapping[str, Value] | None = None


UNSETTLED = "the search had not settled when it ended: take the values with care, or give closer bounds"


def calibrate(
    comparator: Comparator,
    free: Sequence[Free],
    options: Options | None = None,
    *,
    second: Comparator | None = None,
    progress: Callable[[int], None] | None = None,
) -> Calibration:
    """Fit a model's free parameters to a log.

    Args:
        comparator: log and model.
        free: what to fit.
        options: how.
        second: another log with the same model, held out; then all of the first is fitted.
        progress: called with the number of simulations so far.

    Raises:
        UsageError: an unknown signal, a held-out part that makes no sense, or start values that the model refuses.
        DataError: the log holds nothing to fit to.
        SimulationError: the model fails at the values that fit best.
    """
    options, begun = options or Options(), clock.perf_counter()
    count = len(comparator.log)
    stop = count if second is not None else _fitted_samples(count, options.held_out)
    problem = _problem(comparator, free, options, stop, progress)
    with threadpool_limits(1):
        found, blind, unseen = _determined(problem, options)
        parameters, spread, notes = estimates(problem, found, unseen)
    names = [f.name for f in free]
    values = {**(options.given or {}), **{p.name: p.value for p in parameters}}
    before = {**(options.given or {}), **{f.name: f.start for f in free}}
    series = [_series(comparator, problem.simulate, before, values, stop)]
    if second is not None:
        series.append(_series(second, _simulator(second, problem), before, values, 0))
    return Calibration(
        model=comparator.system.name,
        engine=problem.engine,
        why_fmu=problem.why_fmu,
        parameters=parameters,
        covariance=spread,
        undetermined=blind,
        correlated=correlated(spread, names),
        start_values=_start_values(problem, found),
        signals=_signals(problem, found, series, [comparator, *([second] if second else [])]),
        starts=found.starts,
        evaluations=problem.evaluations,
        seconds=clock.perf_counter() - begun,
        series=series,
        notes=notes + _lacking(problem, found),
    )


def _fitted_samples(count: int, held_out: float) -> int:
    if not 0.0 <= held_out <= 0.9:
        raise UsageError(
            f"the held-out part {held_out:g} must be between 0 and 0.9 of the log, or another log"
        )
    stop = count - round(held_out * count)
    if stop < LEAST:
        raise UsageError(f"{stop} samples are too few to fit to: hold less out, or take a longer log")
    return stop


def _determined(problem: Problem, options: Options) -> tuple[Found, list[Undetermined], dict[str, float]]:
    """Fit all; where the log is blind to a change of them, keep one of its parameters at its start and fit the rest.

    Returns:
        The fit, what the log does not see, and the parameters that it does not determine with their deviation in sizes.
    """
    blind: list[Undetermined] = []
    unseen: dict[str, float] = {}
    found = search(problem, starts=options.starts, seed=options.seed, coloured=options.coloured)
    while True:
        unknowns = problem.unknowns
        rows = found.jacobian.shape[0] - len(problem.priors)
        # a prior speaks for its parameter, so that the log need not; a bound ends what the log could say
        judged = [
            i
            for i, u in enumerate(unknowns)
            if u not in problem.nuisances and u.prior is None and not at_bound(u, found.z[i])
        ]
        if not judged:
            return found, blind, unseen
        others = [
            i for i in range(len(unknowns)) if i not in judged and not at_bound(unknowns[i], found.z[i])
        ]
        seen = sight(found.jacobian[:rows, judged], found.jacobian[:rows, others])
        worst = int(np.argmax(seen.deviations))
        if not seen.deviations[worst] > BLIND:
            return found, blind, unseen
        names = [unknowns[i].name for i in judged]
        unseen |= {
            n: max(d, unseen.get(n, 0.0)) for n, d in zip(names, seen.own.tolist(), strict=True) if d > BLIND
        }
        at = np.array([found.z[i] for i in judged])
        blind.append(described(seen.directions[worst], float(seen.deviations[worst]), names, at))
        kept = blind[-1].most
        unseen.setdefault(kept, float(seen.own[names.index(kept)]))
        rest = np.array([z for u, z in zip(unknowns, found.z, strict=True) if u.name != kept])
        problem.fix(kept)
        found = refined(problem, rest, found.starts, options.coloured)


def _simulator(other: Comparator, problem: Problem) -> Callable[[Mapping[str, Value]], dict[str, Array]]:
    return Twin(other).simulate if problem.twin is not None else other.simulate


def _series(
    comparator: Comparator,
    simulate: Callable[[Mapping[str, Value]], dict[str, Array]],
    before: Mapping[str, Value],
    after: Mapping[str, Value],
    held_from: int,
) -> Series:
    names = [n for n in comparator.outputs if not comparator.missing(n)]
    first, then = (simulate(values) for values in (before, after))
    return Series(
        comparator.log.source,
        comparator.log.time[0] + comparator.time,
        {n: comparator.log[n] for n in names},
        {n: first[n] for n in names},
        {n: then[n] for n in names},
        held_from,
    )


def _signals(
    problem: Problem, found: Found, series: Sequence[Series], comparators: Sequence[Comparator]
) -> dict[str, SignalFit]:
    """Scores of every signal on the fitted and the held-out part."""
    first, last = series[0], series[-1]
    result = {}
    for name in first.measured:
        fitted = slice(0, problem.count)
        held = slice(last.held_from, None)
        scores = [_score(comparators[0], first, name, part, fitted) for part in ("before", "after")]
        outside: list[Score | None] = [None, None]
        if name in last.measured and last.held_from < len(last.time):
            outside = [_score(comparators[-1], last, name, part, held) for part in ("before", "after")]
        noise = found.noise.get(name)
        samples = scores[0].samples
        effective = None if noise is None else noise.effective(samples)
        result[name] = SignalFit(name in problem.signals, noise, samples, effective, *scores, *outside)
    return result


def _score(comparator: Comparator, series: Series, name: str, part: str, where: slice) -> Score:
    simulated = getattr(series, part)[name]
    return score(
        series.measured[name][where],
        simulated[where],
        series.time[where],
        comparator.log.valid_mask(name)[where],
        comparator.floors[name],
        drifts=name in comparator.starts.values(),
        free_offset=False,
    )


def _problem(
    comparator: Comparator,
    free: Sequence[Free],
    options: Options,
    stop: int,
    progress: Callable[[int], None] | None,
) -> Problem:
    """What is fitted to what, as the options ask."""
    given, asked, engine = options.given, options.signals, options.engine
    return Problem(comparator, free, given=given, signals=asked, stop=stop, engine=engine, progress=progress)


def _start_values(problem: Problem, found: Found) -> dict[str, float]:
    """Initial values that were estimated besides."""
    pairs = zip(problem.unknowns, found.z, strict=True)
    return {u.name: float(z * u.size) for u, z in pairs if u in problem.nuisances}


def _lacking(problem: Problem, found: Found) -> list[str]:
    """Notes where the search has not settled, or a residual is more than noise.

    The values are then those that make up best for what is missing.
    """
    ratios = {n: rms(found.residuals[n]) / problem.floor(n) for n in problem.signals}
    large = [f"{n} {ratio:.2g} times" for n, ratio in ratios.items() if ratio > LACKING]
    notes = [] if found.settled else [UNSETTLED]
    if not large:
        return notes
    return [
        *notes,
        f"the calibrated model still misses more than the sensors' noise ({', '.join(large)}): it lacks something, and the "
        "values make up for that as well as they can; `cosim diagnose --calibrate` looks for what it is",
    ]
