"""A linear reference of free order: what any model must beat before something nonlinear is named.

One input and one output, with delay, constant offset and initial state, fitted to the simulated output (output error), so
that it is judged as a simulation is. The poles are first-order and second-order sections in continuous time; with poles
and delay given, gains, offset and initial state follow from linear least squares (variable projection: Golub and Pereyra
1973, with the slopes of Kaufman 1975), so the search is over few numbers. The order is the one that predicts
left-out blocks best (`cosim.inference.held_out`).
"""

import cmath
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm
from scipy.optimize import least_squares
from scipy.signal import lfilter

from cosim.inference.beginning import rests
from cosim.inference.held_out import gain_between, left_out
from cosim.inference.pieces import Cuts
from cosim.inference.thresholds import DECAY, HIGHEST_ORDER, LATEST, ORDER_WORTH, QUICKEST_POLE, SLOWEST_POLE

Array = NDArray[np.float64]
Rest = tuple[bool, ...]  # of each record whether it begins at rest; none does if empty
Rows = Callable[[Array], Array]  # (k, n) signals -> (k, values), residuals weighed as the data are

DAMPING = (0.003, 8.0)  # of second-order sections
FREQUENCIES = 7  # of a new section that are looked at
DAMPINGS = (0.05, 0.7)
BEGINNING = 0.05  # of a new record, from which its initial state is taken
STARTS = 3  # of each kind from which a search begins
FIRST_ROUNDS = 8  # of a search from each start
FINALISTS = 2  # searches that go on to their end, those that have come furthest
SEARCH_ROUNDS = 250  # of one search at most
SLOPE = 1e-4  # of a coordinate's size, over which slopes are differenced
CANCELLED = (
    1e-6  # part of a sum of squares below which products do not tell what is left: rounding is 1e-15 of it
)
REMEMBERED = 32  # sets of columns that are kept


@dataclass(frozen=True)
class Sections:
    """Poles and delay of a linear model.

    Attributes:
        first: rates of first-order sections, 1/s.
        second: (frequency rad/s, damping) of second-order sections.
        delay: s.
    """

    first: tuple[float, ...] = ()
    second: tuple[tuple[float, float], ...] = ()
    delay: float = 0.0

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.first) + 2 * len(self.second)

    @property
    def each(self) -> "tuple[Section | None, ...]":
        """The sections, those of first order first; one None if there is none."""
        return (*self.first, *self.second) or (None,)

    @property
    def slowest(self) -> "Section | None":
        """The section with the slowest pole; None if there is none."""
        return min(self.each, key=lambda one: min(map(abs, poles_of(one)), default=0.0))

    @property
    def poles(self) -> tuple[complex, ...]:
        """The poles, 1/s, the slowest first."""
        found = [p for section in self.each for p in poles_of(section)]
        return tuple(sorted(found, key=lambda p: (abs(p), p.imag)))

    def coordinates(self) -> Array:
        """(q,) logarithms of rates, frequencies and dampings, then the delay."""
        pairs = [(np.log(w), np.log(zeta)) for w, zeta in self.second]
        return np.array([*np.log(self.first), *np.ravel(pairs), self.delay])

    def moved(self, coordinates: Array) -> "Sections":
        """The sections at other coordinates (q,)."""
        one, two = len(self.first), len(self.second)
        values = np.exp(coordinates[:-1])
        pairs = values[one:].reshape(two, 2)
        second = tuple((float(w), float(z)) for w, z in pairs)
        return Sections(tuple(values[:one].tolist()), second, float(coordinates[-1]))

    def more(self, first: float | None = None, second: tuple[float, float] | None = None) -> "Sections":
        """With one section more."""
        return Sections(
            self.first + ((first,) if first is not None else ()),
            self.second + ((second,) if second is not None else ()),
            self.delay,
        )


@dataclass(frozen=True)
class LinearModel:
    """A fitted linear reference.

    Attributes:
        sections: poles and delay.
        gains: of the responses to the input, then of the free responses, then the offset.
        h: interval of the samples for which it holds, s.
        length: of the data it was fitted to, s.
        residuals: (values,) what it leaves, weighed.
        left_out: (values,) the same of each block with an estimate from the others.
        rest: of each record whether it begins at rest.
        lower: the models of lower order, that the data were fitted with first.
    """

    sections: Sections
    gains: Array = field(repr=False)
    h: float
    length: float
    residuals: Array = field(repr=False)
    left_out: Array = field(repr=False)
    rest: Rest = ()
    lower: "tuple[LinearModel, ...]" = field(default=(), repr=False)

    @property
    def order(self) -> int:
        """Number of poles."""
        return self.sections.order

    @property
    def integrates(self) -> bool:
        """True if a pole is too slow for the data to tell it from an integrator."""
        return any(slow(section, self.length) for section in self.sections.each)

    @property
    def settled(self) -> float:
        """Output for an input of 1 that has always been there, of what does not integrate."""
        gains = iter(self.gains)
        found = 0.0
        for section in self.sections.each:
            place = float(next(gains))
            if isinstance(section, tuple):
                next(gains)  # of its speed
            found += 0.0 if slow(section, self.length) else place
        return found

    def predicted(self, u: Array, h: float) -> Array:
        """(n,) output on the input (n,) that it was fitted to, from the initial state found there, every `h` s."""
        driven, free = columns(self.sections, u, h, self.length, rest=self.rest)
        return np.asarray(self.gains @ np.concatenate([driven, free, np.ones((1, u.size))]))

    def simulate(self, u: Array, y: Array, h: float) -> Array:
        """(n,) output on another input (n,) every `h` s, from where its output (n,) begins."""
        settled = rests(u, y)
        forced, free = self.responses(u, h, settled)
        begin = self._begun(settled, forced, free, y)
        return np.asarray(begin.level + forced + begin.states @ free)

    def responses(self, u: Array, h: float, settled: bool) -> tuple[Array, Array]:
        """(n,) response to an input (n,) that begins, or has always been at its first value, and (m, n) from each state."""
        sections = self.sections.each
        forced = [
            driven_columns(one, u, h, self.length, self.sections.delay, (), (settled,)) for one in sections
        ]
        frees = [free_columns(one, u.size, h, self.length, ()) for one in sections]
        drive = np.concatenate(forced)
        return np.asarray(self.gains[: drive.shape[0]] @ drive), np.concatenate(frees)

    def beginning(self, u: Array, y: Array, h: float) -> "Beginning":
        """Where a record of input and output (n,), every `h` s, begins, by the first part of its output.

        Of a record that begins at rest that is only where an integrator stands.
        """
        settled = rests(u, y)
        return self._begun(settled, *self.responses(u, h, settled), y)

    def _begun(self, settled: bool, forced: Array, free: Array, y: Array) -> "Beginning":
        """The same by the `responses`."""
        level = float(self.gains[-1])
        states = np.zeros(len(free))
        if not states.size or (settled and not self.integrates):
            return Beginning(settled, level, states)
        # an integrator has no level of its own but where it stands; at rest a second state would follow the noise
        own = [self.place_of_slowest] if settled else list(range(states.size))
        columns, rest = free[own], y - forced
        if settled or not self.integrates:
            rest = rest - level
        else:
            columns = np.concatenate([columns, np.ones((1, y.size))])
        first = min(y.size, max(round(BEGINNING * y.size), 4 * (len(columns) + 1)))
        found, *_ = np.linalg.lstsq(columns[:, :first].T, rest[:first], rcond=1e-3)
        states[own] = found[: len(own)]
        return Beginning(settled, float(found[-1]) if len(found) > len(own) else level, states)

    @property
    def place_of_slowest(self) -> int:
        """Which of the states, section by section, is the first of the section with the slowest pole."""
        each = self.sections.each
        return sum(2 if isinstance(s, tuple) else 1 for s in each[: each.index(self.sections.slowest)])


@dataclass(frozen=True)
class Beginning:
    """Where a record begins for a linear model.

    Attributes:
        settled: all but an integrator has settled on the first input.
        level: output at which the sections stand at 0.
        states: (m,) of the sections, in their order: of first order what is left of the output, of second order that and its
            speed over the frequency.
    """

    settled: bool
    level: float
    states: Array = field(repr=False)


Section = float | tuple[float, float]  # rate 1/s of a first-order section, or frequency rad/s and damping


def poles_of(section: Section | None) -> list[complex]:
    """Poles of a section, 1/s."""
    if isinstance(section, tuple):
        w, zeta = section
        quick = -w * (zeta + cmath.sqrt(zeta * zeta - 1.0))
        return [quick, w * w / quick]
    return [] if section is None else [complex(-section)]


def slow(section: Section | None, length: float) -> bool:
    """True if data of this length, s, do not tell a section from an integrator."""
    return any(abs(p) * length < 1.0 for p in poles_of(section))


def delayed(u: Array, delay: float, h: float, before: float = 0.0) -> Array:
    """(n,) an input (n,) every `h` s, `delay` s later, straight between its samples, and what it was before it begins."""
    whole, part = divmod(delay / h, 1.0)
    late = int(whole)
    found = np.full(u.size, (1.0 - part) * before)
    found[late:] = (1.0 - part) * u[: max(u.size - late, 0)]
    found[: late + 1] += part * before
    found[late + 1 :] += part * u[: max(u.size - late - 1, 0)]
    return found


# its states' responses to the input and those from a start are wanted one after the other
@lru_cache(maxsize=64)
def discrete(w: float, zeta: float, h: float) -> tuple[list[float], Array, Array]:
    """Denominator of a second-order section, its numerators (state, 2) from the input and (2, state, 2) from a start.

    States are the position over its static value, and the speed over w times that.
    """
    system = np.zeros((3, 3))
    system[:2, :2] = [[0.0, w], [-w, -2.0 * zeta * w]]
    system[1, 2] = w
    whole = expm(system * h)
    A, B = whole[:2, :2], whole[:2, 2]
    # adj(zI - A) = zI + A - tr(A) I
    adjoint = A - np.trace(A) * np.eye(2)
    bottom = [1.0, -float(np.trace(A)), float(np.linalg.det(A))]
    return bottom, np.stack([B, adjoint @ B], axis=1), np.stack([np.eye(2), adjoint], axis=2)


def driven(section: Section, u: Array, h: float, length: float) -> Array:
    """Responses (k, n) of a section's states to the input (n,), held over a step."""
    if not isinstance(section, tuple):
        decay = np.exp(-section * h)
        gain = max(section, 1.0 / length) * (-np.expm1(-section * h) / section if section * h > 1e-9 else h)
        return np.asarray(lfilter([0.0, gain], [1.0, -decay], u)[None])
    bottom, tops, _ = discrete(*section, h)
    return np.array([lfilter([0.0, *top], bottom, u) for top in tops])


def free(section: Section, count: int, h: float) -> Array:
    """Responses (k, n) of a section from each of its initial states."""
    impulse = np.zeros(count)
    impulse[0] = 1.0
    if not isinstance(section, tuple):
        return np.asarray(lfilter([1.0], [1.0, -np.exp(-section * h)], impulse)[None])
    bottom, _, starts = discrete(*section, h)
    return np.array([lfilter(starts[0, i], bottom, impulse) for i in range(2)])


def driven_columns(
    section: Section | None, u: Array, h: float, length: float, delay: float, cuts: Cuts, rest: Rest = ()
) -> Array:
    """Columns (k, n) that a section takes from the input; None stands for no section at all: the input itself.

    In a record that begins at rest the section has settled on the first input, on which an integrator stands.
    """
    parts = np.split(u, cuts) if cuts or section is None else [u]
    if section is None:
        return np.concatenate([delayed(part, delay, h, float(part[0])) for part in parts])[None]
    found = []
    for part, settled in zip(parts, rest or (False,) * len(parts), strict=True):
        first = float(part[0]) if settled else 0.0
        response = driven(section, delayed(part - first, delay, h), h, length)
        if first != 0.0 and not slow(section, length):
            response[0] += first
        found.append(response)
    return found[0] if len(found) == 1 else np.concatenate(found, axis=1)


def free_columns(
    section: Section | None, count: int, h: float, length: float, cuts: Cuts, rest: Rest = ()
) -> Array:
    """Columns (k, n) from a section's initial states, one set in each record; at rest only an integrator has one."""
    if section is None:
        return np.empty((0, count))
    ends, own = pairwise((0, *cuts, count)), slow(section, length)
    found = [
        free(section, last - first, h) if own or not settled else np.empty((0, last - first))
        for (first, last), settled in zip(ends, rest or (False,) * (len(cuts) + 1), strict=True)
    ]
    return found[0] if len(found) == 1 else np.asarray(block_diag(*found))


def columns(
    sections: Sections, u: Array, h: float, length: float, cuts: Cuts = (), rest: Rest = ()
) -> tuple[Array, Array]:
    """Responses (k, n) of each section's states to the input, held over a step, and (m, n) from each initial state.

    Where several records are behind one another, each begins in a state of its own, those in `rest` at rest.
    """
    each = sections.each
    return (
        np.concatenate(
            [driven_columns(section, u, h, length, sections.delay, cuts, rest) for section in each]
        ),
        np.concatenate([free_columns(section, u.size, h, length, cuts, rest) for section in each]),
    )


@dataclass(frozen=True)
class Data:
    """What a linear reference is fitted to.

    Attributes:
        u, y: (n,) input and output, every `h` s.
        rows: weighs residuals: (k, n) -> (k, values).
        block: (values,) block of each value, left out together.
        cuts: first sample of each record but the first, where several are behind one another.
    """

    u: Array
    y: Array
    h: float
    rows: Rows
    block: NDArray[np.int64]
    cuts: Cuts = ()
    _known: dict[tuple[Section | None, float | None], Array] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @cached_property
    def rest(self) -> Rest:
        """Of each record whether it begins at rest."""
        parts = zip(np.split(self.u, self.cuts), np.split(self.y, self.cuts), strict=True)
        return tuple(rests(u, y) for u, y in parts)

    @cached_property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(np.unique(self.block).size)

    @cached_property
    def level(self) -> Array:
        """(1, values) a constant, weighed."""
        return self.rows(np.ones((1, self.u.size)))

    @cached_property
    def moved(self) -> float:
        """By how much the output moves."""
        return float(np.ptp(self.y))

    @property
    def length(self) -> float:
        """Duration, s."""
        return float(self.u.size * self.h)

    def decaying(self, sections: Sections) -> Sections:
        """The sections with modes that die out over the data."""
        second = tuple((w, max(zeta, DECAY / (w * self.length))) for w, zeta in sections.second)
        return Sections(sections.first, second, sections.delay)

    def weighed(self, section: Section | None, delay: float | None) -> Array:
        """(k, values) columns of one section, weighed: from the input at this delay, or with None from its initial states.

        A search moves one section or the delay at a time.
        """
        key = (section, delay)
        found = self._known.pop(key, None)
        if found is None:
            if delay is None:
                plain = free_columns(section, self.u.size, self.h, self.length, self.cuts, self.rest)
            else:
                plain = driven_columns(section, self.u, self.h, self.length, delay, self.cuts, self.rest)
            found = self.rows(plain)
            while len(self._known) >= REMEMBERED:
                self._known.pop(next(iter(self._known)))
        self._known[key] = found  # the last used is the last
        return found

    def regressors(self, sections: Sections) -> Array:
        """(columns, values) everything that enters linearly, weighed."""
        each = sections.each
        return np.concatenate(
            [
                *(self.weighed(section, sections.delay) for section in each),
                *(self.weighed(section, None) for section in each),
                self.level,
            ]
        )

    @staticmethod
    def left(gram: Array, goal: Array, sizes: Array, rows: Array, target: Array) -> float:
        """Sum of squares that the regressors (k, values) leave, from their products (k, k) and (k,), each by its size."""
        gains = np.linalg.solve(gram, goal)
        whole = float(target @ target)
        found = whole + float(gains @ (gram @ gains - 2.0 * goal))
        if found > CANCELLED * whole:
            return found
        residuals = target - (gains / sizes) @ rows
        return float(residuals @ residuals)

    def solved(self, sections: Sections, target: Array) -> "Solved":
        """The best gains with these poles.

        A log with one step that begins soon after its start is described by slow states that cancel the response to the
        step, and nothing else is. So an initial state is as large as the output moves, as a prior against which each
        block counts as one observation with the model's error.
        """
        rows = self.regressors(sections)
        gram, goal = rows @ rows.T, rows @ target
        sizes = np.sqrt(np.diag(gram))
        sizes[sizes < 1e-12 * max(float(sizes.max()), 1e-300)] = np.inf
        gram, goal = gram / np.outer(sizes, sizes), goal / sizes
        gram[np.diag_indices_from(gram)] += 1e-10
        moved = self.moved
        # an output that never moves has no initial state, and nothing is left of it
        weight = (
            self.left(gram, goal, sizes, rows, target) / self.blocks / moved**2 if moved**2 > 0.0 else 0.0
        )
        states = np.zeros(sizes.size)
        states[max(sections.order, 1) : -1] = np.sqrt(weight)
        gram[np.diag_indices_from(gram)] += (states / sizes) ** 2
        gains = np.linalg.solve(gram, goal) / sizes
        return Solved(sections, gains, rows, target - gains @ rows, states, gram, sizes)

    def slope(self, at: "Solved", place: Array, i: int, step: float) -> Array:
        """(values,) change of what is predicted with coordinate `i`, the gains held.

        Args:
            at: the solution there.
            place: (q,) coordinates.
            i: which of them.
            step: over which it is differenced.
        """
        for signed in (step, -step):  # on one side it may become an integrator, or cease to be one
            moved = place.copy()
            moved[i] += signed
            other = self.regressors(self.decaying(at.sections.moved(moved)))
            if other.shape == at.rows.shape:
                return np.asarray(at.gains @ (other - at.rows)) / signed
        return np.zeros(at.rows.shape[1])


@dataclass(frozen=True)
class Solved:
    """The best gains with given poles.

    Attributes:
        sections: the poles, and the delay.
        gains: (k,) of the regressors.
        rows: (k, values) regressors, weighed.
        residuals: (values,) what they leave.
        states: (k,) weights of the priors of initial states.
        gram: (k, k) products of the regressors, each by its size, priors included.
        sizes: (k,) of the regressors.
    """

    sections: Sections
    gains: Array
    rows: Array
    residuals: Array
    states: Array
    gram: Array
    sizes: Array

    def beside(self, changes: Array) -> Array:
        """(q, values) what the regressors do not take up of changes (q, values): slopes of what is left (Kaufman 1975)."""
        taken = np.linalg.solve(self.gram, (self.rows @ changes.T) / self.sizes[:, None])
        return changes - (taken / self.sizes[:, None]).T @ self.rows


def reference(data: Data, highest: int = HIGHEST_ORDER) -> LinearModel:
    """The linear model whose order predicts left-out blocks best; of nearly equal ones the lowest order.

    Args:
        data: input, output and their weights.
        highest: order that is tried.
    """
    target = data.rows(data.y[None])[0]
    best = model_of(data, Sections(), target)
    found = [best]
    missed = 0
    for _ in range(highest):
        starts = list(wider(data, found, target))
        if not starts:
            break
        model = model_of(data, refined(data, starts, target), target)
        found.append(model)
        better = gain_between(model.left_out / scale_of(best), best.left_out / scale_of(best), data.block)
        if scale_of(model) >= (1.0 - ORDER_WORTH) * scale_of(best):
            missed += 1
        elif better.sure:  # if not, a higher order may be
            best, missed = model, 0
        if missed == 2:
            break
    return replace(best, lower=tuple(m for m in found if m.order < best.order))


def scale_of(model: LinearModel) -> float:
    """Size of what a model leaves of left-out blocks."""
    return max(float(np.sqrt(np.mean(model.left_out**2))), 1e-300)


def wider(data: Data, found: list[LinearModel], target: Array) -> Iterator[Sections]:
    """Where the search for the next order begins: one more first-order section, or one more of second order."""
    low, high = limits(data)
    rates = np.geomspace(max(low, 1.0 / data.length), 0.5 * high, FREQUENCIES)
    base = found[-1].sections
    delays = (0.0, data.h, 3.0 * data.h, 8.0 * data.h) if base.order == 0 else (base.delay,)
    one = [Sections((*base.first, a), base.second, d) for a, d in product([low, *rates], delays)]
    yield from promising(data, one, target)
    if len(found) > 1:
        before = found[-2].sections
        two = [before.more(second=(w, z)) for w, z in product(rates, DAMPINGS)]
        yield from promising(data, two, target)


def promising(data: Data, listed: list[Sections], target: Array) -> list[Sections]:
    """Those of several sets of sections that explain most: from one alone the search may end beside the best."""

    def left(sections: Sections) -> float:
        residuals = data.solved(data.decaying(sections), target).residuals
        return float(residuals @ residuals)

    return sorted(listed, key=left)[:STARTS]


def limits(data: Data) -> tuple[float, float]:
    """Slowest and quickest pole that is sought, 1/s."""
    return SLOWEST_POLE / data.length, QUICKEST_POLE / data.h


def refined(data: Data, starts: list[Sections], target: Array) -> Sections:
    """The best of the searches from these starts, over poles and delay; after some rounds only the `FINALISTS` go on."""
    ends = sorted((search(data, start, target, FIRST_ROUNDS) for start in starts), key=lambda end: end.left)
    last = [e if e.settled else search(data, e.sections, target, SEARCH_ROUNDS) for e in ends[:FINALISTS]]
    return min(last, key=lambda end: end.left).sections


@dataclass(frozen=True)
class End:
    """Where a search has ended.

    Attributes:
        sections: poles and delay.
        left: sum of squares that they leave, up to a factor of the data.
        settled: it ended by itself.
    """

    sections: Sections
    left: float
    settled: bool


def search(data: Data, start: Sections, target: Array, rounds: int) -> End:
    """A search for poles and delay from one start, at most so many rounds."""
    scale = max(float(np.sqrt(target @ target)), 1e-300)
    one, two = len(start.first), len(start.second)
    low, high = np.log(limits(data))
    least = np.array([low] * one + [low, np.log(DAMPING[0])] * two + [0.0])
    most = np.array([high] * one + [high, np.log(DAMPING[1])] * two + [LATEST * data.h])
    size = np.array([1.0] * (one + 2 * two) + [5.0 * data.h])
    last: dict[bytes, Solved] = {}

    def at(x: Array) -> Solved:
        key = x.tobytes()
        if key not in last:  # slopes are asked for where residuals were
            last.clear()
            last[key] = data.solved(data.decaying(start.moved(x)), target)
        return last[key]

    def slopes(x: Array) -> Array:
        changes = [data.slope(at(x), x, i, float(step)) for i, step in enumerate(SLOPE * size)]
        return -at(x).beside(np.array(changes)).T / scale

    found = least_squares(
        lambda x: at(x).residuals / scale,
        np.clip(start.coordinates(), least + 1e-6 * size, most - 1e-6 * size),
        slopes,
        bounds=(least, most),
        x_scale=size,
        ftol=1e-7,
        xtol=1e-6,
        gtol=1e-10,
        max_nfev=rounds,
    )
    return End(data.decaying(start.moved(found.x)), float(found.cost), found.status > 0)


def model_of(data: Data, sections: Sections, target: Array) -> LinearModel:
    """The model with these poles, and what it leaves of blocks that are left out."""
    at = data.solved(sections, target)
    place = sections.coordinates()
    steps = [SLOPE] * (place.size - 1) + [SLOPE * data.h]
    slopes = [-at.rows.T]
    if sections.order:
        slopes += [-data.slope(at, place, i, step)[:, None] for i, step in enumerate(steps)]
    jacobian = np.concatenate(slopes, axis=1)
    priors = np.zeros((at.gains.size, jacobian.shape[1]))
    priors[:, : at.gains.size] = -np.diag(at.states)
    jacobian = np.concatenate([jacobian, priors])
    sizes = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    jacobian = jacobian[:, sizes > 0.0] / sizes[sizes > 0.0]
    return LinearModel(
        sections,
        at.gains,
        data.h,
        data.length,
        at.residuals,
        left_out(at.residuals, jacobian, data.block),
        data.rest,
    )
