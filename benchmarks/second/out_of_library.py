"""Draws logs with a cause that no effect of the library is: the right answer is "unexplained", in its block."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.second.cases import Case, setting
from benchmarks.second.record import COLUMNS, COMMANDS, DEG


@dataclass(frozen=True)
class Fault:
    """A cause that the library lacks.

    Attributes:
        block: where diagnosis.json should say "unexplained".
        sizes: parameter of machine or sensing -> range of its value; a third entry "+-" gives either sign.
        sensing: the parameters belong to the sensors.
    """

    block: str
    sizes: dict[str, tuple[Any, ...]]
    sensing: bool = False


# friction in one direction only is none of them: Coulomb friction and a constant torque, as gravity is over a small angle
FAULTS: dict[str, Fault] = {
    "stranger.progressive_spool": Fault("dcv", {"progress": (1.1, 1.6)}),
    "stranger.sided_spool": Fault("dcv", {"k_side": (0.03, 0.15, "+-")}),
    "stranger.relief_valve": Fault("continuity", {"p_relief": (3e5, 7e5)}),
    "stranger.hose": Fault("continuity", {"line": (0.015, 0.1)}),
    "stranger.wind": Fault("mechanical", {"wind": (20.0, 150.0), "w_wind": (0.4, 4.0)}),
    "stranger.cushion": Fault("mechanical", {"cushion": (500.0, 5000.0), "theta_c": (0.003, 0.04)}),
    "stranger.patch": Fault("mechanical", {"patch": (60.0, 250.0), "theta_p": (-0.1, 0.1)}),
    "stranger.eccentric_encoder": Fault(
        "mechanical", {"ecc": (0.05 * DEG, 0.4 * DEG), "turns": (5.0, 25.0), "phase": (-3.0, 3.0)}, sensing=True
    ),
}  # fmt: skip


def draw_out_of_library(seed: int) -> Case:
    """The case of a seed: one cause that the library lacks, every signal, any command."""
    rng = np.random.default_rng([seed, 2021])
    name = str(rng.choice(list(FAULTS)))
    values = {}
    for parameter, (low, high, *how) in FAULTS[name].sizes.items():
        values[parameter] = float(rng.uniform(low, high)) * (-1.0 if how and rng.random() < 0.5 else 1.0)
    machine, sensing = setting(rng)
    sensing["columns"] = tuple(COLUMNS)
    if "theta_p" in values:
        values["theta_p"] += machine["theta_0"]  # where the drive comes by
    (sensing if FAULTS[name].sensing else machine).update(values)
    played = str(rng.choice(COMMANDS)), float(rng.uniform(0.55, 1.0)), float(rng.uniform(45.0, 75.0))
    return Case(seed, {name: values}, {name: {}}, machine, sensing, *played)


def judged_out_of_library(case: Case, answer: dict[str, Any]) -> str:
    """In a word: honest, named (a cause in its block), extra (honest, and a cause in another block), elsewhere or missed."""
    (name,) = case.hidden
    block = FAULTS[name].block
    # mechanics and slew sensor are judged as one
    own = {"mechanical", "sensor"} if block == "mechanical" else {block}
    if any(c["block"] in own for c in answer["causes"]):
        return "named"
    if any(block in r["block"].split("+") for r in answer["unexplained"]):
        return "extra" if answer["causes"] else "honest"
    return "elsewhere" if answer["causes"] or answer["unexplained"] else "missed"
