"""Logs with something hidden in them, and what the diagnosis says, for the tests."""

import dataclasses

import numpy as np

from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.machine import Machine, our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import Noise, make_log
from cosim.rig.parameters import nominal_value
from cosim.rig.write import as_log

TRUSTED = ("dcv.K", "dcv.w0", "dcv.zeta", "continuity.K_c", "continuity.T", "mechanical.J", "mechanical.b")


def off(seed: int, *hidden: str) -> dict[str, float]:
    """Nominal parameters off by 1 % (one standard deviation), but for those that a hidden effect sets."""
    rng = np.random.default_rng(seed)
    values = {n: nominal_value(n) * (1.0 + 0.01 * float(np.clip(rng.normal(), -2.5, 2.5))) for n in TRUSTED}
    own = {
        "dcv.gain": "dcv.K",
        "dcv.bandwidth": "dcv.w0",
        "dcv.damping": "dcv.zeta",
        "continuity.flow_gain": "continuity.K_c",
        "mechanical.inertia": "mechanical.J",
        "mechanical.viscous_friction": "mechanical.b",
    }
    for name in hidden:
        values.pop(own.get(name, ""), None)
    return values


def only(*blocks: str) -> Machine:
    """Our crane, of which these blocks alone are judged: for what shows in them a diagnosis of a few seconds."""
    machine = our_machine("full_order")
    kept = tuple(group for group in machine.groups if group.name in blocks)
    assert len(kept) == len(blocks)
    return dataclasses.replace(machine, groups=kept)


def diagnosed(
    *hidden: str,
    seed: int,
    seconds: float = 30.0,
    kind: str = "white",
    excitation: str = "mixed",
    blocks: tuple[str, ...] = (),
) -> Diagnosis:
    """Diagnosis of a log with these effects at the rig's moderate size; of these blocks alone, where any are named."""
    noise = Noise(kind=kind, correlation_time=0.03)
    run = make_log(excitation, seconds, hidden, seed=seed, settings=off(seed, *hidden), noise=noise)
    return diagnose(as_log(run), model=only(*blocks) if blocks else "full_order")
