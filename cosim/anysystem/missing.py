"""What is missing in a group that no cause explains: at which port it enters, and as what function of which signal.

A free function of the signals at a component's ports is added at each port in turn, piecewise linear in each signal and of
either direction of motion. What such an addition does to the readings is the model's own response to each piece, superposed;
the sizes are fitted on some windows of the log and measured on the others. At its own port a memoryless function tells most:
at another it would have to undo what lies between.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.model import GroupModel
from cosim.errors import SimulationError
from cosim.inference.problem import Problem
from cosim.ssp.system import Port
from cosim.system.runs import Runs

Array = NDArray[np.float64]
KNOTS = (
    0.02,
    0.15,
    0.35,
    0.5,
    0.65,
    0.85,
    0.98,
)  # quantiles of a signal between which its function is straight
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)  # quantiles at which it is shown
PIECE_SIZE = 0.05  # of a port's reach: of a piece, for its response
RIDGE = 1e-4  # of a piece's own power
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
        by: signal of which it is a function; empty where it takes several.
        told: share of the variance of what is left, on windows held out.
        at, of: (5,) values of that signal, and of the function there; empty where it takes several.
    """

    ports: tuple[str, ...]
    by: str
    told: float
    at: tuple[float, ...] = ()
    of: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Entry:
    name: str
    told: float
    by: str
    at: tuple[float, ...]
    of: tuple[float, ...]


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
    left = problem.residuals(values)
    here = model(values)
    names = problem.names
    weights = {n: 1.0 / spreads[n.partition("#")[0]] for n in names}
    target = np.concatenate([weights[n] * left[n] for n in names])
    inside = np.concatenate([problem.fitted[n] for n in names])
    if inside.all():  # whole logs are held out: windows of these are
        inside = np.concatenate([problem.window[n] % 3 != 1 for n in names])
    series = [model.ports(values, k) for k in range(len(model.segments))]
    found: list[_Entry] = []
    for port, where in _entries(model):
        signals = _signals(model, port, where, series)
        pieces = {s: _pieces(parts) for s, parts in signals.items()}
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
    found = sorted((e for e in found if e.told > TELLING), key=lambda e: -e.told)
    if not found:
        return None
    best = found[0]
    near = [e.name for e in found if 1.0 - e.told <= AS_LITTLE * (1.0 - best.told)]
    return Missing(tuple(near), best.by, best.told, best.at, best.of)


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
) -> dict[str, list[Array]]:
    """What the function may be of: signals at the ports of the same component, outputs as measured where they were.

    At an output it is of what the component would hand on by itself, which no reading shows.
    """
    measured = {str(p): s for s, p in model.group.judged}
    found = {}
    for name in (n for n in series[0] if all(n in part for part in series)):
        side, _, full = name.partition(":")
        if side in ("in", "out") and full.partition(".")[0] == port.component:
            signal = measured.get(full, "") if side == "out" and where == "input" else ""
            found[full] = [
                seg.signals[signal] if signal in seg.signals else part[name]
                for seg, part in zip(model.segments, series, strict=True)
            ]
    return found


def _pieces(parts: Sequence[Array]) -> list[list[Array]]:
    """Pieces of a function of a signal, in each log: itself, its ramps from each knot, its direction, a constant."""
    whole = np.concatenate(parts)
    low, high = np.quantile(whole, [0.01, 0.99])
    reach = float(high - low)
    if reach <= 1e-9 * max(1.0, float(np.abs(whole).max())):
        return []
    knots = np.unique((np.quantile(whole, KNOTS) - low) / reach)
    x = [(p - low) / reach for p in parts]
    rows = [x, *([np.maximum(p - knot, 0.0) for p in x] for knot in knots[1:-1])]
    far = max(1, whole.size // 400)  # samples, so that noise is no motion
    speed = [
        np.gradient(np.convolve(np.pad(p, far, mode="edge"), np.ones(2 * far + 1) / (2 * far + 1), "valid"))
        for p in x
    ]
    usual = float(np.sqrt(np.mean(np.concatenate(speed) ** 2))) or 1.0
    rows.append([np.tanh(3.0 * v / usual) for v in speed])
    rows.append([np.ones_like(p) for p in x])
    return [list(r) for r in rows]


def _best(
    name: str,
    signals: dict[str, list[Array]],
    columns: dict[str, list[Array]],
    target: Array,
    inside: NDArray[np.bool_],
) -> _Entry:
    """What functions of one signal, or of all, tell if they enter at a port."""
    each = {s: _told(own, target, inside) for s, own in columns.items()}
    together = _told([c for own in columns.values() for c in own], target, inside)
    by = max(each, key=lambda s: each[s][0], default="")
    if not by or each[by][0] < ALONE * together[0]:
        return _Entry(name, together[0], "", (), ())
    told, sizes = each[by]
    whole = np.concatenate(signals[by])
    at = np.quantile(whole, QUANTILES)
    low, high = np.quantile(whole, [0.01, 0.99])
    knots = np.unique((np.quantile(whole, KNOTS) - low) / (high - low))
    x = (at - low) / (high - low)
    table = [x, *(np.maximum(x - k, 0.0) for k in knots[1:-1]), np.zeros_like(x), np.ones_like(x)]
    return _Entry(name, told, by, tuple(at.tolist()), tuple((sizes @ np.stack(table)).tolist()))


def _told(columns: Sequence[Array], target: Array, inside: NDArray[np.bool_]) -> tuple[float, Array]:
    """Share of a target's variance told on the other part, and the sizes fitted on this one."""
    if not columns:
        return 0.0, np.zeros(0)
    table = np.stack(columns)
    part = table[:, inside]
    gram = part @ part.T
    gram[np.diag_indices_from(gram)] *= 1.0 + RIDGE
    sizes = np.linalg.solve(gram + 1e-300 * np.eye(len(gram)), part @ target[inside])
    rest = (target - sizes @ table)[~inside]
    whole = float(target[~inside] @ target[~inside])
    return 1.0 - float(rest @ rest) / max(whole, 1e-300), np.asarray(sizes, dtype=np.float64)
