"""The next experiment: the excitation that would best separate two explanations that a log cannot tell apart.

T-optimality: the two fitted models are simulated on each feasible excitation, and the one in which their predictions
differ most, in units of the noise, wins; the nominal parameters may hide part of the difference at the price of their trust.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.data import Record
from cosim.diagnosis.extend import ChainModel
from cosim.diagnosis.groups import Group
from cosim.diagnosis.noise import Whitener

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Proposal:
    """An experiment to make.

    Attributes:
        why: which explanations it separates.
        excitation: shape, amplitude, duration and what else describes it.
        predicted_gain: log-likelihood by which it would separate them.
        command: (n,) the command at 1 kHz.
        file: CSV with the command, once written.
    """

    why: str
    excitation: dict[str, float | str | list[float]]
    predicted_gain: float
    command: Array
    file: Path | None = None


def menu(duration: float, h: float) -> list[tuple[dict[str, float | str | list[float]], Array]]:
    """Feasible excitations of one duration, s: shapes, amplitudes and frequencies within the rig's limits, |u| <= 1, mean about zero."""
    time = np.arange(round(duration / h) + 1) * h
    found: list[tuple[dict[str, float | str | list[float]], Array]] = []
    for amplitude in (0.05, 0.1, 0.25, 0.5, 1.0):
        for omega in (0.3, 1.0, 3.0, 10.0):
            found.append(({"shape": "sine", "amplitude": amplitude, "frequency_rad_s": omega, "duration_s": duration}, amplitude * np.sin(omega * time)))  # fmt: skip
        for hold in (0.5, 1.5, 4.0):
            square = amplitude * np.sign(np.sin(np.pi * time / hold + 1e-9))
            rest = square * (np.floor(time / hold / 2.0) % 2 == 0)
            found.append(
                ({"shape": "steps", "amplitude": amplitude, "hold_s": hold, "duration_s": duration}, square)
            )
            found.append(
                (
                    {
                        "shape": "steps with rests",
                        "amplitude": amplitude,
                        "hold_s": hold,
                        "duration_s": duration,
                    },
                    rest,
                )
            )
        for period in (5.0, 20.0):
            ramp = amplitude * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * time / period))
            found.append(
                (
                    {"shape": "triangle", "amplitude": amplitude, "period_s": period, "duration_s": duration},
                    ramp,
                )
            )
    return found


def difference(
    model: ChainModel, first: Mapping[str, float], second: Mapping[str, float], rules: Mapping[str, Whitener]
) -> float:
    """Half the squared difference of two models' predictions in units of noise: the log-likelihood that separates them."""
    a, b = model.simulate(dict(first)), model.simulate(dict(second))
    return 0.5 * sum(float(np.sum(rule(a[s] - b[s]) ** 2)) for s, rule in rules.items() if s in a)


def propose(
    groups: tuple[Group, ...],
    first: Mapping[str, float],
    second: Mapping[str, float],
    rules: Mapping[str, Whitener],
    why: str,
    fixed: dict[str, float],
    duration: float = 30.0,
    h: float = 1e-3,
) -> Proposal | None:
    """The excitation of the menu that separates two sets of parameter values best; None if none does."""
    best: Proposal | None = None
    for description, command in menu(duration, h):
        model = ChainModel(groups, Record(h, {"u": command}), fixed)
        gain = difference(model, first, second, rules)
        if best is None or gain > best.predicted_gain:
            best = Proposal(why, description, gain, command)
    return best if best is not None and best.predicted_gain > 1.0 else None


def proposal_for(groups: tuple[Group, ...], findings: Mapping[str, "object"], causes: list, fixed: dict[str, float], values: Mapping[str, float]) -> Proposal | None:  # type: ignore[type-arg]  # fmt: skip
    """An experiment for the first cause that has a twin in this log, or None."""
    for cause in causes:
        if not cause.alike:
            continue
        finding = findings[cause.group]
        twins = [
            t
            for t in finding.rivals.get(cause.effect.name, [])
            if any(e.name == cause.alike[0] for e in t.effects)
        ]  # type: ignore[attr-defined]
        if not twins:
            continue
        rules = {s: r for f in findings.values() for s, r in f.task.rules.items()}  # type: ignore[attr-defined]
        own = set(finding.chosen.fit.values) | set(twins[0].fit.values)  # type: ignore[attr-defined]
        base = {n: v for n, v in values.items() if n not in own}
        first = base | finding.chosen.fit.values  # type: ignore[attr-defined]
        second = base | twins[0].fit.values
        why = f"tells {cause.effect.name} from {cause.alike[0]}, which this log cannot"
        return propose(groups, first, second, rules, why, fixed)
    return None


def write_command(proposal: Proposal, folder: Path, h: float = 1e-3) -> Proposal:
    """Write the command as a CSV that the rig plays (``cosim rig --excitation file``)."""
    file = folder / "next_experiment.csv"
    rows = "".join(f"{k * h:.3f},{u:.6f}\n" for k, u in enumerate(proposal.command.tolist()))
    file.write_text(f"time [s],u [1]\n{rows}", encoding="utf-8")
    return Proposal(proposal.why, proposal.excitation, proposal.predicted_gain, proposal.command, file)
