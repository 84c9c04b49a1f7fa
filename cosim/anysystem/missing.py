"""What is missing in a group that no cause explains: at which port it enters, and as what function of which signal.

A free function of the signals at a component's ports is added at each port in turn, piecewise linear in each signal and of
either direction of motion; at an input also one of how fast each output changes, which friction is. What such an addition
does to the readings is the model's own response to each piece, superposed; the sizes are fitted on some windows of the log
and measured on the others. At its own port a memoryless function tells most: at another it would have to undo what lies
between.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.model import GroupModel
from cosim.errors import SimulationError
from cosim.inference.held_out import gain_of_errors, squares_by_block
from cosim.inference.problem import Problem
from cosim.ssp.system import Port
from cosim.system.runs import Runs

Array = NDArray[np.float64]
# quantiles of a signal between which its function is straight
KNOTS = (0.02, 0.15, 0.35, 0.5, 0.65, 0.85, 0.98)
QUANTILES = np.linspace(0.02, 0.98, 13)  # at which it is shown
PIECE_SIZE = 0.05  # of a port's reach: of a piece, for its response
RIDGE = 1e-4  # of a piece's own power
DIRECTIONS = (3.0, 30.0)  # over the usual speed: how sharply a function of the direction turns with it
SPEED_OF = "speed of "  # before the name of a signal: the function is of how fast it changes, per s
TELLING = 0.3  # of the variance on windows held out: a function that tells less tells nothing
ALONE = 0.95  # of what functions of all signals tell, from which one signal alone will do
AS_LITTLE = 1.5  # times what the best port leaves: another that leaves no more may be it as well
SPENT = 0.5  # of the runs that a diagnosis made: so many may be made here, in all groups
FEWEST_RUNS = 100  # runs that may be made in any case


@dataclass(frozen=True)
class Missing:
    """What an added function tells of what stays wrong in a group.

    Attributes:
        ports: where it enters, ``component.connector (input)``, the best first; several where the log cannot tell.
        by: signal of which it is a function, or `SPEED_OF` it; empty where it takes several.
        told: share of the variance of what is left, on windows held out.
        at, of: (k,) values of that signal, or of its speed per s, and of the function there; empty where it takes several.
    """

    ports: tuple[str, ...]
    by: str
    told: float
    at: tuple[float, ...] = ()
    of: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Entry:
    """What a function tells that enters at a port, as `Missing` has it.

    Attributes:
        rest: what it leaves on windows held out, each reading over its spread.
    """

    name: str
    told: float
    rest: Array
    by: str
    at: tuple[float, ...] = ()
    of: tuple[float, ...] = ()


def allowed(runs: Runs) -> int:
    """Runs that may have been made when what is missing has been looked for."""
    return runs.count + max(FEWEST_RUNS, round(SPENT * runs.count))


def missing(
    model: GroupModel, problem: Problem, values: Mapping[str, float], spreads: Mapping[str, float], most: int
) -> Missing | None:
    """Where what is missing enters; None if no function tells enough, or the runs (`most` in all) do not suffice.

    Args:
        model: the group.
        problem: its readings.
        values: of the causes, and of all else that was fitted.
        spreads: signal -> standard deviation of its reading.
        most: runs that may have been made then.
    """
    found = sorted(
        (e for e in _each(model, problem, values, spreads, most) if e.told > TELLING), key=lambda e: -e.told
    )
    if not found:
        return None
    best = found[0]
    near = [e.name for e in found if 1.0 - e.told <= AS_LITTLE * (1.0 - best.told)]
    return Missing(tuple(near), best.by, best.told, best.at, best.of)


def outdone(
    model: GroupModel,
    problem: Problem,
    values: Mapping[str, float],
    null: Mapping[str, float],
    spreads: Mapping[str, float],
    most: int,
) -> bool:
    """Whether an added function in the place of causes leaves less than they do, as the windows held out bear out.

    Then they are the nearest that the library has: friction of an axis passes for play at its input.

    Args:
        model: the group.
        problem: its readings.
        values: of the causes, and of all else that was fitted.
        null: without them.
        spreads: signal -> standard deviation of its reading.
        most: runs that may have been made then.
    """
    left, inside, number = _weighed(problem, problem.residuals(values), spreads)
    causes = squares_by_block(left[~inside], number[~inside])
    best = max(_each(model, problem, null, spreads, most), key=lambda e: e.told, default=None)
    if best is None:
        return False
    return gain_of_errors(squares_by_block(best.rest, number[~inside]), causes, placed=True).borne_out


def _weighed(
    problem: Problem, left: Mapping[str, Array], spreads: Mapping[str, float]
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Residuals (n,) of all readings, each over its spread; which of them functions are fitted to; their windows."""
    names = problem.names
    target = np.concatenate([left[n] / spreads[n.partition("#")[0]] for n in names])
    number = np.concatenate([problem.window[n] for n in names]).astype(np.float64)
    inside = np.concatenate([problem.fitted[n] for n in names])
    # where whole logs are held out, windows of those that are fitted are
    return target, number % 3 != 1 if inside.all() else inside, number


def _each(
    model: GroupModel, problem: Problem, values: Mapping[str, float], spreads: Mapping[str, float], most: int
) -> list[_Entry]:
    """What a function at each port tells of what is left with these values."""
    here = model(values)
    names = problem.names
    weights = {n: 1.0 / spreads[n.partition("#")[0]] for n in names}
    target, inside, _ = _weighed(problem, problem.residuals(values), spreads)
    series = [model.ports(values, k) for k in range(len(model.segments))]
    found: list[_Entry] = []
    for port, where in _entries(model):
        signals = _signals(model, port, where, series)
        pieces = {s: driver.pieces() for s, driver in signals.items()}
        if (
            where == "input"
            and model.runs.count + sum(map(len, pieces.values())) * len(model.segments) > most
        ):
            continue
        reach = max(float(np.ptp(np.concatenate([p[f"{_side(where)}:{port}"] for p in series]))), 1e-300)
        columns: dict[str, list[Array]] = {}
        try:
            for signal, own in pieces.items():
                for piece in own:
                    model.added[f"{port}|{where}"] = [PIECE_SIZE * reach * p for p in piece]
                    moved = model(values)
                    columns.setdefault(signal, []).append(
                        np.concatenate([weights[n] * (moved[n] - here[n]) for n in names])
                        / (PIECE_SIZE * reach)
                    )
        except SimulationError:
            continue
        finally:
            model.added.clear()
        found.append(_best(f"{port} ({where})", signals, columns, target, inside))
    return found


def _entries(model: GroupModel) -> list[tuple[Port, str]]:
    """Ports at which something may be added: those that are no part of a loop stepped as one; outputs first."""
    group = model.group
    inputs = [*(d.port for d in group.drives), *(w.target for w in group.inner)]
    outputs = [*(p for _, p in group.judged), *(w.source for w in group.inner)]
    found = [(p, "output") for p in dict.fromkeys(outputs)] + [(p, "input") for p in dict.fromkeys(inputs)]
    return [
        (p, where) for p, where in found if not model.looped(p) and model.system.variable(p).kind == "Real"
    ]


def _side(where: str) -> str:
    return "in" if where == "input" else "out"


def _signals(
    model: GroupModel, port: Port, where: str, series: Sequence[dict[str, Array]]
) -> dict[str, "_Driver"]:
    """What the function may be of: signals at the ports of the same component, outputs as measured where they were.

    At an output it is of what the component would hand on by itself, which no reading shows.
    """
    measured = {str(p): s for s, p in model.group.judged}
    found = {}
    for name in (n for n in series[0] if all(n in part for part in series)):
        side, _, full = name.partition(":")
        if side in ("in", "out") and full.partition(".")[0] == port.component:
            signal = measured.get(full, "") if side == "out" and where == "input" else ""
            parts = [
                seg.signals[signal] if signal in seg.signals else part[name]
                for seg, part in zip(model.segments, series, strict=True)
            ]
            speeds = [_speed(part, segment.h) for part, segment in zip(parts, model.segments, strict=True)]
            moves = side == "out" and where == "input"
            # its direction is a function of its speed, which is told apart
            found[full] = _Driver(parts, [] if moves else speeds)
            if moves:
                found[SPEED_OF + full] = _Driver(speeds, speeds)
    return found


def _speed(series: Array, h: float) -> Array:
    """(n,) how fast a series changes, per s, over so many samples that noise is no motion."""
    far = max(1, series.size // 400)
    mean = np.convolve(np.pad(series, far, mode="edge"), np.ones(2 * far + 1) / (2 * far + 1), "valid")
    return np.asarray(np.gradient(mean, h))


class _Driver:
    """A signal of which a function may be.

    Attributes:
        parts: (n,) its values in each log.
        speeds: (n,) how fast that changes of whose direction the function is as well; none where it is of none.
    """

    def __init__(self, parts: Sequence[Array], speeds: Sequence[Array]) -> None:
        """Knots of the function at quantiles of the signal."""
        self.parts, self.speeds = list(parts), list(speeds)
        self.whole = np.concatenate(self.parts)
        self.low, high = (float(q) for q in np.quantile(self.whole, [0.01, 0.99]))
        self.reach = high - self.low
        self.still = self.reach <= 1e-9 * max(1.0, float(np.abs(self.whole).max()))
        if not self.still:
            self.knots = np.unique((np.quantile(self.whole, KNOTS) - self.low) / self.reach)[1:-1]
        if self.speeds:
            self.usual = float(np.sqrt(np.mean(np.concatenate(self.speeds) ** 2))) or 1.0

    def rows(self, values: Array, speeds: Array | None) -> list[Array]:
        """Pieces of the function at values (n,) of the signal: itself, ramps from each knot, its direction, a constant."""
        x = (values - self.low) / self.reach
        ramps = [np.maximum(x - knot, 0.0) for knot in self.knots]
        turns = [] if speeds is None else [np.tanh(sharp * speeds / self.usual) for sharp in DIRECTIONS]
        return [x, *ramps, *turns, np.ones_like(x)]

    def pieces(self) -> list[list[Array]]:
        """Each piece in each log; none where the signal has one value."""
        if self.still:
            return []
        logs = [self.rows(p, v) for p, v in zip_longest(self.parts, self.speeds)]
        return [list(piece) for piece in zip(*logs, strict=True)]

    def shown(self, sizes: Array, name: str) -> tuple[Array, Array]:
        """Values (k,) of the signal and of the function there, at rest where it is no speed itself."""
        at = np.quantile(self.whole, QUANTILES)
        speeds = at if name.startswith(SPEED_OF) else np.zeros_like(at)
        return at, np.asarray(sizes @ np.stack(self.rows(at, speeds if self.speeds else None)))


def _best(
    name: str,
    signals: Mapping[str, _Driver],
    columns: dict[str, list[Array]],
    target: Array,
    inside: NDArray[np.bool_],
) -> _Entry:
    """What functions of one signal, or of all, tell if they enter at a port."""
    each = {s: _told(own, target, inside) for s, own in columns.items()}
    # with how fast it changes beside it any reading of a first-order part tells what drives it, whatever that is
    turns = slice(-1 - len(DIRECTIONS), -1)
    together = [c for s, own in columns.items() for c in (own[turns] if s.startswith(SPEED_OF) else own)]
    share, _, rest = _told(together, target, inside)
    by = max(each, key=lambda s: each[s][0], default="")
    if not by or each[by][0] < ALONE * share:
        return _Entry(name, share, rest, "")
    told, sizes, left = each[by]
    at, of = signals[by].shown(sizes, by)
    return _Entry(name, told, left, by, tuple(at.tolist()), tuple(of.tolist()))


def _told(columns: Sequence[Array], target: Array, inside: NDArray[np.bool_]) -> tuple[float, Array, Array]:
    """Share of a target's variance told on the other part, the sizes fitted on this one, and what is left on the other."""
    if not columns:
        return 0.0, np.zeros(0), target[~inside]
    table = np.stack(columns)
    part = table[:, inside]
    gram = part @ part.T
    gram[np.diag_indices_from(gram)] *= 1.0 + RIDGE
    sizes = np.linalg.solve(gram + 1e-300 * np.eye(len(gram)), part @ target[inside])
    rest = (target - sizes @ table)[~inside]
    whole = float(target[~inside] @ target[~inside])
    return 1.0 - float(rest @ rest) / max(whole, 1e-300), np.asarray(sizes, dtype=np.float64), rest
