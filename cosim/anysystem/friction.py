"""Dry friction of a component: a loop of our own around it, from how fast an output moves to what an input gets.

Effects at ports act on a series that goes in or out. Friction depends on the motion that follows, so the component is run
together with an FMU before its input that reads its output. It is looked at last, where something is wrong: its runs are
dear, and no superposition spares one.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from cosim.anysystem.actions import Action
from cosim.anysystem.missing import PIECE_SIZE
from cosim.anysystem.model import GroupModel, Loop
from cosim.anysystem.search import NAMED, Candidate, Finding, Search
from cosim.errors import SimulationError
from cosim.ssp.read import read_fmu
from cosim.ssp.system import Port, System, Wire
from fmus.build import build_fmu
from fmus.compose import compose
from fmus.port_friction import BLOCK

EFFECT = "port.friction"
KICKED = 6  # intervals after the input has moved, in which a component's speed changes most


def rubs(search: Search, finding: Finding) -> Action | None:
    """Dry friction, alone or beside the causes found, where that explains a group better; None where it does not.

    From here on the model of the search can be run with it.

    Args:
        search: the group's, as it has ended.
        finding: what it found.
    """
    model, chosen = search.model, search.fits.scored(replace(finding.chosen))
    best, found = chosen, None
    for action, loop in places(model):
        if search.budget.over:
            break
        where = f"{action.port}|input"
        kept = model.loops.get(where)
        model.loops[where] = {EFFECT: loop}
        tries = [
            tried(search, base, action) for base in (search.known.null, *([chosen] if chosen.actions else []))
        ]
        nearest = max((c for c in tries if c is not None), key=lambda c: c.score, default=None)
        # where the noise is all that the causes found have left, how much nearer the run comes tells more
        far = nearest and (nearest.score > chosen.score + NAMED or search.fits.nearer(chosen, nearest))
        if nearest and far and nearest.score > best.score:
            best, found = nearest, action
        elif kept is None:
            del model.loops[where]
        else:
            model.loops[where] = kept
    return found


def tried(search: Search, base: Candidate, action: Action) -> Candidate | None:
    """Friction beside other causes; None where no level of it explains more than they do."""
    values = base.fit.values
    here = search.known.at(values)
    begins = [{**values, **own} for own in search.known.begins(action)]
    reached = [search.known.at(begin) for begin in begins]
    if max(reached) <= here:
        return None
    actions = (*base.actions, action)
    fit = search.fits.fit(actions, begins[int(np.argmax(reached))], 8)
    return None if fit is None else search.fits.scored(Candidate(actions, fit, search.fits.price(actions)))


def places(model: GroupModel) -> Iterator[tuple[Action, Loop]]:
    """Where friction may act: inputs of components that no loop holds, with each output that they move."""
    series = model.ports(model.base, 0)
    for full in [n.partition(":")[2] for n in series if n.startswith("in:")]:
        port = Port(*full.split(".", 1))
        if model.looped(port) or model.system.variable(port).kind != "Real":
            continue
        outputs = [n.partition(":")[2] for n in series if n.startswith(f"out:{port.component}.")]
        for moved in [Port(*n.split(".", 1)) for n in outputs]:
            for of_place in (True, False):
                try:
                    kick = kicked(model, port, moved, of_place)
                except SimulationError:
                    continue
                if kick > 0.0:
                    settings = {"acceleration": kick, "of_place": int(of_place)}
                    yield Action(EFFECT, port, "input"), Loop(beside(model, port, moved), moved, settings)


def beside(model: GroupModel, port: Port, moved: Port) -> str:
    """Name of the component, put beside those of the system, that rubs at an input against the motion of an output."""
    name = f"friction_{port.component}_{port.variable}_{moved.variable}"
    if name not in model.runs.system.components:
        wires = (Wire(moved, Port(name, "x")), Wire(Port(name, "y"), port))
        with tempfile.TemporaryDirectory() as folder:
            own: System = read_fmu(build_fmu(compose(BLOCK), Path(folder, f"{BLOCK.name}.fmu")))
        model.runs.add(own, name, wires)
    return name


def kicked(model: GroupModel, port: Port, moved: Port, of_place: bool) -> float:
    """How fast the speed of an output changes at most, per s, after a change of an input, over that."""
    series = model.ports(model.base, 0)
    reach = max(float(np.ptp(series[f"in:{port}"])), 1e-300)
    size, h = PIECE_SIZE * reach, model.segments[0].h
    begin = series[f"in:{port}"].size // 2
    step = (np.arange(series[f"in:{port}"].size) >= begin).astype(np.float64)
    model.added[f"{port}|input"] = [size * step] * len(model.segments)
    try:
        change = model.ports(model.base, 0)[f"out:{moved}"] - series[f"out:{moved}"]
    finally:
        model.added.clear()
    speed = np.diff(change) / h if of_place else change
    after = np.diff(speed)[max(begin - 2, 0) : begin + KICKED]
    return float(np.abs(after).max(initial=0.0)) / (size * h)
