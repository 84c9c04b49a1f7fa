"""The extension where linear dynamics are missing: a linear model of free order in the place of the blocks, as a package.

What the blocks cannot do, whatever causes they are given, a cause would only bend. So none is named, and the user still gets
a model that predicts: the linear reference as the FMU `linear_drive`.
"""

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.extension.packages import write_values
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.held_out.gain import measure, on_command
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.reference import evened, fitted_to
from cosim.files import Scratch
from cosim.inference.linear import LinearModel
from cosim.machines.table import MachineTable
from cosim.machines.wiring import files, write_files
from cosim.ssp.write import write_as_wired
from fmus import linear_drive, linear_speed
from fmus.contract import Block

Array = NDArray[np.float64]
SECTIONS = 3  # of the FMU, of second order each
BLOCKS = {"rad": linear_drive.BLOCK, "rad/s": linear_speed.BLOCK}  # by the unit of what they put out


def lags(model: LinearModel) -> list[tuple[int, int | None]]:
    """Places of the lags that make a section together, the slowest first; a last one may be alone."""
    order = sorted(range(len(model.sections.first)), key=model.sections.first.__getitem__)
    return list(zip_longest(order[::2], order[1::2]))


def drive_values(model: LinearModel, factor: float = 1.0) -> dict[str, float]:
    """Parameters of a linear block, for an angle or a speed, that make it a fitted linear model, SI, without its start.

    Args:
        model: of order 1 to 6.
        factor: the output of the block per signal that was fitted.
    """
    rates = model.sections.first
    quick = [max(a, 1.0 / model.length) for a in rates]
    gains = (factor * model.gains).tolist()
    found = []
    for i, k in lags(model):
        top = gains[i] * quick[i]
        # a lag alone: numerator and denominator with one more root in common
        b, second = (quick[i], 0.0) if k is None else (rates[k], gains[k] * quick[k])
        found.append((top + second, top * b + second * rates[i], rates[i] + b, rates[i] * b))
    for j, (w, zeta) in enumerate(model.sections.second):
        place, rate = gains[len(rates) + 2 * j : len(rates) + 2 * j + 2]
        found.append((rate * w, place * w * w, 2.0 * zeta * w, w * w))
    values = {"delay": model.sections.delay, "settled": float(not model.integrates)}
    for k in range(SECTIONS):
        section = found[k] if k < len(found) else (0.0, 0.0, 1.0, 1.0)
        values |= dict(zip((f"{n}_{k + 1}" for n in ("b1", "b0", "a1", "a0")), section, strict=True))
    return values


def begun(model: LinearModel, states: Array, factor: float) -> dict[str, float]:
    """Where the sections of a linear block start, for (m,) states of the model's; `factor` as `drive_values`."""
    rates, y = model.sections.first, (factor * states).tolist()
    found = []
    for i, k in lags(model):
        own = [i] if k is None else [i, k]
        found.append((sum(y[j] for j in own), -sum(rates[j] * y[j] for j in own)))
    for j, (w, _) in enumerate(model.sections.second):
        place, speed = y[len(rates) + 2 * j : len(rates) + 2 * j + 2]
        found.append((place, w * speed))
    return {
        f"{n}_{k}": v for k, own in enumerate(found, 1) for n, v in zip(("start", "rate"), own, strict=True)
    }


def starts(
    model: LinearModel, record: Record, drive: str, signal: str, factor: float
) -> list[dict[str, float]]:
    """Where each log starts, as parameters of the block: as the linear model begins it.

    Args:
        model: the model.
        record: one log or several.
        drive: the command.
        signal: the output.
        factor: the output of the block per signal.
    """
    found = []
    for piece in record.pieces:
        one = np.zeros(piece.time.size, dtype=np.int64)  # window for all
        even = evened(piece.signals[drive], piece.signals[signal], piece.time, piece.h, one, piece.h)
        begin = model.beginning(even.u, even.y, piece.h)
        at = {"offset": factor * begin.level, "settled": float(begin.settled and not model.integrates)}
        if begin.settled and model.integrates:  # all but the integrator has settled on the first command
            at |= {
                "offset": at["offset"] + factor * model.settled * float(even.u[0]),
                "u_0": float(even.u[0]),
            }
        found.append(at | begun(model, begin.states, factor))
    return found


def can_replace(found: Diagnosis) -> bool:
    """True where linear dynamics are missing from the command to an angle or a speed, and nothing between was measured.

    In a block's own windows, or in the free run of the whole where nothing is named.
    """
    if len(found.groups) != 1 or len(found.findings) != 1:
        return False
    (finding,) = found.findings.values()
    group, signal = finding.task.model.group, next(iter(finding.task.measured))
    if group.drive != found.machine.drive:
        return False
    whole = found.references.get(signal)
    of_all = bool(found.rests) and not found.causes and whole is not None and whole.clearly_better
    if finding.reference is None or finding.lacks_curve or not (finding.lacks_linear or of_all):
        return False
    parts = found.machine.signals[signal].parts
    return len(parts) == 1 and found.machine.wiring.unit(parts[0][0]) in BLOCKS


def replaced(found: Diagnosis, folder: Path) -> None:
    """Put a linear model in the place of the blocks where they lack its dynamics and it predicts held-out data better.

    Args:
        found: with the gains of the blocks; packages, series and gains are those of the linear model afterwards.
        folder: where its packages are made.
    """
    (finding,) = found.findings.values()
    signal, record, machine, held = next(iter(finding.task.measured)), found.record, found.machine, found.held
    assert finding.reference is not None
    # the reference of held-out logs was fitted to all of this one; windows of it must not judge what was fitted to them
    model = (
        finding.reference.model
        if held is not None
        else fitted_to(record, machine.drive, signal, found.linear, found.window)
    )
    if not 0 < model.order <= 2 * SECTIONS:  # a constant gain would be no drive
        return
    ((_, factor),) = machine.signals[signal].parts
    values = drive_values(model, 1.0 / factor)
    begin = starts(model, record, machine.drive, signal, 1.0 / factor)
    block = BLOCKS[machine.wiring.unit(machine.signals[signal].parts[0][0])]
    drafts = write_linear(block, machine, signal, values | begin[0], folder / "linear")
    package = drafts["open"]
    after = {signal: factor * run_linear(block, package, machine, record, begin)}
    before, judged, first = found.before, after, None
    record_held = record
    if held is not None:
        record_held, first, before = held.record, held.first, found.held_before
        at = starts(model, record_held, machine.drive, signal, 1.0 / factor)
        judged = {signal: factor * run_linear(block, package, machine, record_held, at)}
    gains = measure(record_held, {signal: before[signal]}, judged, found.window, first)
    if not gains or gains[signal].after >= found.gains[signal].after:
        return
    found.gains, found.after, found.drafts = gains, after, drafts
    if held is not None:
        found.held_after = judged
    found.in_place = model


def write_linear(
    block: Block, machine: Machine, signal: str, values: Mapping[str, float], folder: Path
) -> dict[str, Path]:
    """The open package of a linear drive, with the connectors of the machine's own, and its parameter set."""
    ((port, _),) = machine.signals[signal].parts
    outlet = next((n for n, behind in machine.wiring.outputs.items() if behind == port), signal)
    table = MachineTable(chain=(block.name,), input=entry(machine), output=outlet)
    full = {f"{block.name}.{n}": v for n, v in values.items()}
    text = f"{machine.name}: a linear model in the place of the blocks, fitted to a log"
    with Scratch("linear_") as scratch:
        content = files(table, full, f"{machine.name}_linear", text, machine.source)
        write_files(content, Path(scratch))
        package = write_as_wired(Path(scratch, f"{machine.name}_linear.ssd"), folder / "extended.ssp")
    return {
        "open": package,
        "ssv": write_values({block.name: values}, {block.name: block.name}, folder / "extended.ssv"),
    }


def entry(machine: Machine) -> str:
    """Name of the package's input: the connector of the machine's own that the command drives, or the command's."""
    names, _ = machine.inputs()
    return names[0] if "." not in names[0] else machine.drive


def run_linear(
    block: Block, package: Path, machine: Machine, record: Record, begin: Sequence[Mapping[str, float]]
) -> Array:
    """(n,) output of a linear package on the command of each log, from its own start, at the log's samples."""
    output = f"{block.name}.{next(iter(block.outputs))}"
    each = []
    for piece, start in zip(record.pieces, begin, strict=True):
        own = {f"{block.name}.{n}": v for n, v in start.items()}
        each.append(on_command(package, piece, machine, (entry(machine),), own, [output])[output])
    return np.concatenate(each)
