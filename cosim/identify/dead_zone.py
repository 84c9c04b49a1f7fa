"""The dead zone from a log: break points and slopes of both sides (2.2), with intervals.

    y = G(s) [ s_r max(x - b_r, 0) + s_l min(x - b_l, 0) ] + offset + start

x is the command behind the compensator (4.9); without a compensator, as in the source's own experiment, it is the command.
y is the spool, or where none was measured the load pressure, or the slew angle. G is the nominal chain from the dead zone
to y at unit gain, its time scale free: a slow ramp shows little more of it than its lag. A ramp up and down tells lag from
width. Slopes are those at y: metres, pascals or radians a second for a unit of command.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError
from cosim.identify.data import Record, record
from cosim.identify.estimate import Fit, Quantity, Rows, Series, fit
from cosim.identify.linear import free_responses, simulate
from cosim.identify.nominal import compensated
from cosim.logs import Log
from cosim.logs.filter import low_pass

Array = NDArray[np.float64]

RESPONSES = ("spool", "p_load", "slew")  # the nearest to the dead zone first
SIGNAL_UNITS = {"spool": "m", "p_load": "Pa", "slew": "rad/s"}
HIGHEST = 40.0  # Hz
REACH = 0.05  # of full command: a side that x does not enter by so much is not judged
SCALES = (0.05, 20.0)  # of the chain's time
SEARCH_POINTS = 3000
HELD_OUT_PARTS = 5  # of a log, predicted from the others in turn
NONE = 1e-4  # of full command: a dead zone that is none
GRID = np.linspace(0.04, 0.92, 12)  # of the way to the largest x, where the search for a break point begins


@dataclass(frozen=True)
class DeadZone:
    """An identified dead zone.

    Attributes:
        response: signal it was seen in.
        sides: ``right`` and ``left``, as far as the command entered them, each with ``break_point`` [1], ``slope``
            [response's unit per unit command] and ``relative_slope`` [1], the slope over the nominal one.
        offset: of the response at zero demand; None for the slew, whose zero is free.
        lag: of the response behind the demand at a slow ramp [s].
        nominal_lag: the same of the nominal chain [s].
        best_fit: best fit % of the response.
        record: compensated command, response.
        simulated: response (n,) of the fit.
        notes: what the user should know.
    """

    response: str
    sides: dict[str, dict[str, Quantity]]
    offset: Quantity | None
    lag: Quantity
    nominal_lag: float
    best_fit: float
    record: Record
    simulated: Array
    notes: tuple[str, ...]

    def static(self, x: Array) -> Array:
        """Response (n,) at rest to a compensated command (n,); of the slew its rate."""
        total = np.full(x.shape, 0.0 if self.offset is None else self.offset.value)
        for name, side in self.sides.items():
            beyond = x - side["break_point"].value
            total += side["slope"].value * (
                np.maximum(beyond, 0.0) if name == "right" else np.minimum(beyond, 0.0)
            )
        return total


def chain(response: str, known: Mapping[str, float]) -> tuple[Array, float, float]:
    """Denominator of the nominal chain from demand to a response, its gain, and its lag at a slow ramp [s].

    The denominator has falling powers; for the slew the last power, of the integrator, is left out.
    """
    w0, zeta, gain = known["dcv.w0"], known["dcv.zeta"], known["dcv.K"]
    denominator = np.array([1.0, 2.0 * zeta * w0, w0 * w0])
    lag = 2.0 * zeta / w0
    if response != "spool":
        denominator = np.polymul(denominator, [1.0, 1.0 / known["continuity.T"]])
        gain, lag = gain * known["continuity.K_c"], lag + known["continuity.T"]
    if response == "slew":
        pole = known["mechanical.b"] / known["mechanical.J"]
        denominator = np.polymul(denominator, [1.0, pole])
        gain = gain * known["mechanical.A"] * known["mechanical.r"] / known["mechanical.b"]
        lag += 1.0 / pole
    return denominator, gain, lag


class _Model:
    """Rows of the fit: right side, left side, offset; theta holds the break points and the log of the time scale."""

    def __init__(
        self, item: Record, response: str, known: Mapping[str, float], sides: list[str], cutoff: float | None
    ) -> None:
        self.item, self.sides, self.integrates, self.cutoff = item, sides, response == "slew", cutoff
        self.denominator, self.gain, self.lag = chain(response, known)
        self.slopes = {"right": known["dead_zone.m_r"], "left": known["dead_zone.m_l"]}
        self.limit = known["dead_zone.limit"]

    def opening(self, side: str, edge: float, x: Array) -> Array:
        """How far x (n,) is beyond the edge of a side, the valve's limit observed; a unit slope."""
        most = self.limit / self.slopes[side]
        beyond = x - edge
        return np.clip(beyond, 0.0, most) if side == "right" else np.clip(beyond, -most, 0.0)

    def __call__(self, theta: Array, k: int) -> Rows:
        item = self.item
        powers = np.arange(self.denominator.size)
        scaled = self.denominator * np.exp(-theta[-1] * powers)
        full = np.concatenate([scaled, [0.0]]) if self.integrates else scaled
        inputs = [self.opening(side, edge, item.input) for side, edge in zip(self.sides, theta, strict=False)]
        made = [simulate([scaled[-1]], full, row, item.step, item.held) for row in inputs]
        # an offset of the demand adds a constant, or a ramp of the angle, and what the free motion holds already
        offset = np.linspace(0.0, 1.0, item.input.size) if self.integrates else np.ones(item.input.size)
        rows = np.vstack([*made, offset])
        own = free_responses(full, item.input.size, item.step)
        if self.cutoff is not None:
            rows, own = (low_pass(part, item.step, self.cutoff) for part in (rows, own))
        return rows, own


def identify_dead_zone(
    log: Log, known: Mapping[str, float], *, response: str | None = None, cutoff: float | None = None
) -> DeadZone:
    """Find the dead zone.

    Args:
        log: with the command u and a response; a slow ramp through both sides tells most.
        known: nominal numbers; with ``compensator.d_plus`` and ``d_minus`` 0 where the compensator was off.
        response: signal to take; the nearest to the valve by default.
        cutoff: low-pass [Hz] on command (behind the nonlinearity) and response alike.

    Raises:
        DataError: a signal is missing or does not move, or neither side was entered.
    """
    taken = response or next((name for name in RESPONSES if name in log), "spool")
    item = record(log, "u", taken, known, linear=True)
    x = compensated(item.input, dict(known))
    y = item.output if cutoff is None else low_pass(item.output, item.step, cutoff)
    item = Record(item.name, item.step, x, y, item.keep, item.held, item.start, item.notes)
    sides = [side for side, far in (("right", x.max()), ("left", -x.min())) if far > REACH]
    model = _Model(item, taken, known, sides, cutoff)
    series = [Series(y, item.step, item.keep, item.name)]
    start, bounds = _start(model, sides)
    found = fit(series, model, start, highest=HIGHEST, bounds=bounds)
    _check(found, sides, x, log)
    return _result(found, model, taken, item, sides)


def _start(model: _Model, sides: list[str]) -> tuple[Array, tuple[Array, Array]]:
    """Break points that explain most without the chain's lag, and the bounds of the search."""
    every = slice(None, None, max(1, model.item.input.size // SEARCH_POINTS))
    x, y, keep = model.item.input[every], model.item.output[every], model.item.keep[every]
    grids = [GRID * (x.max() if side == "right" else x.min()) for side in sides]
    best, theta = np.inf, np.array([grid[grid.size // 2] for grid in grids] + [0.0])
    for edges in itertools.product(*grids):
        rows = [model.opening(side, edge, x) for side, edge in zip(sides, edges, strict=True)]
        if model.integrates:
            rows = [np.cumsum(row) for row in rows]
        matrix = np.vstack([*rows, np.ones(x.size), np.linspace(0.0, 1.0, x.size)])[:, keep].T
        left = np.linalg.lstsq(matrix, y[keep], rcond=None)[1]
        if left.size and left[0] < best:
            best, theta = float(left[0]), np.array([*edges, 0.0])
    return theta, _bounds(model.item.input, sides)


def _bounds(x: Array, sides: list[str]) -> tuple[Array, Array]:
    """Lowest and highest break points and time scale."""
    low = [NONE if side == "right" else float(x.min()) for side in sides]
    high = [float(x.max()) if side == "right" else -NONE for side in sides]
    return np.array([*low, np.log(SCALES[0])]), np.array([*high, np.log(SCALES[1])])


def _check(found: Fit, sides: list[str], x: Array, log: Log) -> None:
    """Refuse a break point that the command did not pass."""
    for i, side in enumerate(sides):
        edge = found.derived(_item(i, of_theta=True))
        low, high = edge.interval
        far = float(x.max() if side == "right" else x.min())
        if high - low > abs(far) or not abs(edge.value) < 0.98 * abs(far):
            raise DataError(
                f"{log.source}: the command does not open the valve to the {side}: behind the compensator it reaches"
                f" {far:.3g}, and the break point cannot be told; record a slow ramp well beyond the dead zone on both sides"
                " (`cosim identify experiment ramp`)"
            )


def _item(i: int, *, of_theta: bool = False, per: float = 1.0) -> Callable[[Array, Array], float]:
    """The i-th number of theta, or of the factors."""
    return lambda theta, b: float((theta if of_theta else b)[i]) / per


def _result(found: Fit, model: _Model, taken: str, item: Record, sides: list[str]) -> DeadZone:
    unit, notes = SIGNAL_UNITS[taken], list(item.notes)
    judged: dict[str, dict[str, Quantity]] = {}
    for i, side in enumerate(sides):
        judged[side] = {
            "break_point": found.derived(_item(i, of_theta=True)),
            "slope": found.derived(_item(i), unit),
            "relative_slope": found.derived(_item(i, per=model.gain)),
        }
    missing = [side for side in ("right", "left") if side not in sides]
    notes += [f"the command never went to the {side}: that side is not judged" for side in missing]
    lag = found.derived(lambda theta, b: model.lag * float(np.exp(theta[-1])), "s")
    if not lag.interval[0] <= model.lag <= lag.interval[1]:
        notes.append(
            f"the response lags {lag.value * 1e3:.3g} ms behind, the nominal chain {model.lag * 1e3:.3g} ms: play, a"
            " delay or slower dynamics; one rate of ramp cannot tell these apart"
        )
    simulated = item.output - found.residuals[0]
    y, e = item.output[item.keep], found.residuals[0][item.keep]
    best = 100.0 * (1.0 - float(np.linalg.norm(e) / np.linalg.norm(y - y.mean())))
    offset = None if taken == "slew" else found.derived(lambda theta, b: float(b[-1]), unit)
    return DeadZone(taken, judged, offset, lag, model.lag, best, item, simulated, tuple(notes))


def predicted_dead_zone(
    found: DeadZone, known: Mapping[str, float], cutoff: float | None = None
) -> tuple[float, float]:
    """Best fit % of parts of the log, each predicted from the others: with the dead zone, and without one.

    Args:
        found: the dead zone of the whole log.
        known: nominal numbers with which it was found.
        cutoff: low-pass [Hz] with which it was found.
    """
    item, sides = found.record, list(found.sides)
    model = _Model(item, found.response, known, sides, cutoff)
    scale = float(np.log(found.lag.value / model.lag))
    edges = np.array([found.sides[side]["break_point"].value for side in sides])
    shut = np.array([NONE if side == "right" else -NONE for side in sides])
    # the first part, in which the log's start is seen, is never left out
    part = np.arange(item.output.size) * (HELD_OUT_PARTS + 1) // item.output.size
    fits = []
    for start in (edges, shut):
        free = np.abs(start) > NONE
        off = np.zeros_like(item.output)
        for k in range(1, HELD_OUT_PARTS + 1):
            keep = item.keep & (part != k)
            low, high = _bounds(item.input, sides)
            low[:-1], high[:-1] = (
                np.where(free, low[:-1], shut - NONE),
                np.where(free, high[:-1], shut + NONE),
            )
            own = fit(
                [Series(item.output, item.step, keep, item.name)],
                model,
                np.clip(np.append(start, scale), low, high),
                highest=HIGHEST,
                bounds=(low, high),
            )
            rows, free_motion = model(own.theta, 0)
            told = own.shared @ rows + own.own[0] @ free_motion
            off[part == k] = (item.output - told)[part == k]
        judged = item.keep & (part > 0)
        y, e = item.output[judged], off[judged]
        fits.append(100.0 * (1.0 - float(np.linalg.norm(e) / np.linalg.norm(y - y.mean()))))
    return fits[0], fits[1]
