"""The next experiment: its command, what the two explanations predict, and where they part."""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.experiment import FULL
from cosim.diagnosis.answer.remarks import shown
from cosim.report.material import Experiment, Material
from cosim.report.overview import judged
from cosim.report.picture import Layer, Panel, Picture, Role
from cosim.report.series import averaged, bucket, envelope
from cosim.report.words import CAPTIONS, axis, effect_in_block, signal_name

Array = NDArray[np.float64]

ROLES: tuple[Role, Role] = ("extended", "nominal")
PIECE = 0.25  # s in which evidence is counted


def picture(material: Material) -> Picture | None:
    """The command of the next experiment and the predictions; None if none is proposed or its file is gone."""
    proposed = material.answer.next_experiment
    if proposed is None:
        return None
    found = material.experiment
    if found is None:
        return _command_alone(material)
    signal = telling(found)
    unit, scale = shown(signal)
    size = bucket(found.command.size, found.h)
    names = [effect_in_block(model) for model in found.models]
    of_command, drawn = command_axis(found.drive, found.command)
    at, u = envelope(found.command, size)
    panels = [Panel(of_command, [Layer("line", "command", "measured", at * found.h, drawn * u)])]
    layers = []
    for name, role, values in zip(names, ROLES, found.predicted[signal], strict=True):
        middle, mean = averaged(values * scale, size)
        layers.append(Layer("line", name, role, middle * found.h, mean))
    panels.append(Panel(axis(signal_name(signal), unit), layers))
    at, apart, size_of_noise = difference(found, signal)
    ends = np.array([0.0, (found.command.size - 1) * found.h])
    band = np.full(2, 2.0 * size_of_noise * scale)
    off = Layer("line", "difference of the two", "plain", at * found.h, apart * scale)
    panels.append(
        Panel(axis("difference", unit), [Layer("band", "noise, ±2 sd", "noise", ends, -band, band), off])
    )
    size = round(PIECE / found.h)
    at, rising = averaged(np.cumsum(found.evidence), size)
    panels.append(
        Panel("log-likelihood [1]", [Layer("line", "evidence so far", "rising", at * found.h, rising)])
    )
    parted = telling_spans(found.evidence, found.h)
    told = CAPTIONS["experiment"].format(
        first=names[0],
        second=names[1],
        bin=1e3 * found.noise[signal].bins * found.h,
        parted=sum(b - a for a, b in parted),
        length=ends[1],
    )
    return Picture(
        "next-experiment",
        f"The command to play, and the {signal_name(signal)} that each explanation predicts",
        axis("time", "s"),
        panels,
        told,
        parted,
    )


def command_axis(drive: str, command: Array) -> tuple[str, float]:
    """Words at the axis of a command (n,) SI, and the factor from SI: full command is 100 %, another drive has its unit."""
    unit, scale = shown(drive)
    if drive == "u" and unit == "1" and np.abs(command).max() <= FULL[1]:
        return axis("command u", "%"), 100.0
    return axis(signal_name(drive), unit), scale


def difference(found: Experiment, signal: str) -> tuple[Array, Array, float]:
    """Positions in samples and difference of the two predictions as a residual is judged, SI, and the noise of a value."""
    noise = found.noise[signal]
    one, other = found.predicted[signal]
    at, values = judged(one - other, noise)
    return at, values, noise.rms


def telling(found: Experiment) -> str:
    """The signal in which the predictions differ most, in units of its noise."""

    def size(signal: str) -> float:
        _, values, noise = difference(found, signal)
        return float(np.nanmean(values**2)) / max(noise, 1e-300) ** 2

    return max(found.predicted, key=size)


def telling_spans(evidence: Array, h: float) -> list[tuple[float, float]]:
    """The fewest pieces of `PIECE` s that carry half of the evidence, as spans of time, s; neighbours are joined."""
    size = round(PIECE / h)
    count = evidence.size // size
    sums = evidence[: count * size].reshape(count, size).sum(axis=1)
    order = np.argsort(-sums, kind="stable")
    enough = int(np.searchsorted(np.cumsum(sums[order]), 0.5 * sums.sum())) + 1
    joined: list[tuple[float, float]] = []
    for k in np.sort(order[:enough]).tolist():
        start, end = k * size * h, (k + 1) * size * h
        if joined and start - joined[-1][1] < 0.5 * h:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return joined


def _command_alone(material: Material) -> Picture | None:
    """The command as its file has it: of a folder without predictions."""
    import pandas as pd

    proposed = material.answer.next_experiment
    if proposed is None or proposed.file is None or material.folder is None:
        return None
    file = material.folder / proposed.file.replace("\\", "/").rpartition("/")[2]
    if not file.is_file():
        return None
    table = pd.read_csv(file)
    time, u = table.iloc[:, 0].to_numpy(np.float64), table.iloc[:, 1].to_numpy(np.float64)
    drive = str(table.columns[1]).partition(" [")[0]
    of_command, drawn = command_axis(drive, u / shown(drive)[1])
    at, values = envelope(u / shown(drive)[1], bucket(u.size, float(time[1] - time[0])))
    layer = Layer("line", "command", "extended", time[at.astype(int)], drawn * values)
    return Picture(
        "next-experiment",
        "The command to play",
        axis("time", "s"),
        [Panel(of_command, [layer])],
        f"In {file.name}.",
    )
