"""``cosim identify frf``: from logs to a frequency response, a transfer function and an `Answer`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.identify import picture
from cosim.identify.answer import COLUMNS, Answer, parameter_table
from cosim.identify.blocks import form, parameters
from cosim.identify.data import Record, even
from cosim.identify.frf import Frf, stepped, welch_frf
from cosim.identify.frf_fit import fit_frf, frf_best_fit, without_transients
from cosim.identify.other_machine import Other
from cosim.identify.run import (
    Channel,
    between,
    log_data,
    model_data,
    model_of,
    pole_lines,
    record_notes,
    records_of,
)
from cosim.identify.transfer_function import Structure, TransferFunction
from cosim.logs import Log

Array = NDArray[np.float64]
NORMAL = 1.959964  # 95 % of a normal distribution lie within so many standard deviations
TURN = 2.0 * np.pi  # rad
METHODS = {"welch": "Welch's method", "stepped sine": "stepped sines"}


@dataclass(frozen=True)
class FrfRequest:
    """How a frequency response is wanted.

    Attributes:
        method: ``stepped`` or ``welch``.
        amplitude: of a stepped sine's response, ``least squares`` or ``extremes``.
        structure: of the fit; None for the block's own.
        segment: of Welch's method [s].
        low, high: band [rad/s].
        smooth: order and window of a Savitzky-Golay filter, before the fit.
    """

    method: str = "stepped"
    amplitude: Literal["least squares", "extremes"] = "least squares"
    structure: Structure | None = None
    segment: float | None = None
    low: float = 0.0
    high: float = np.inf
    smooth: tuple[int, int] | None = None


def frf_answer(
    logs: Sequence[Log],
    chosen: Channel,
    known: Mapping[str, float],
    wanted: FrfRequest,
    other: Other | None = None,
) -> Answer:
    """A frequency response with its uncertainty, and a transfer function fitted to it."""
    items = records_of(logs, chosen, known)
    if wanted.method == "welch":
        if len(items) > 1:
            raise UsageError("--method welch takes one log")
        raw = welch_frf(items[0], segment=wanted.segment, integrates=bool(chosen.integrators))
        driven = []
    elif wanted.method == "stepped":
        commands = [
            even(log)[0].require("u" if other is None else other.command, "the periods")[: i.input.size]
            for log, i in zip(logs, items, strict=True)
        ]
        driven = list(zip(items, commands, strict=True))
        raw = stepped(driven, wanted.amplitude)
    else:
        raise UsageError(f"--method '{wanted.method}' is unknown: stepped or welch")
    raw = raw.band(wanted.low, wanted.high)
    shown = raw.smoothed(*wanted.smooth) if wanted.smooth else raw
    structure = wanted.structure
    if structure is None:
        structure = (
            form(chosen.block).structure
            if chosen.block
            else Structure(1 + chosen.integrators, 0, chosen.integrators)
        )
    model = fit_frf(shown, structure)
    corrected: Frf | None = None
    whole = wanted.low <= 0.0 and wanted.high == np.inf  # the correction reads every period again
    if driven and whole and not wanted.smooth and wanted.amplitude == "least squares":
        corrected, model = without_transients(raw, driven, model)
    answer = _frf_answer(logs, chosen, known, (raw, shown if corrected is None else corrected, model), items)
    if other is not None:  # whose numbers no model of ours takes
        answer.model = ""
    return answer


def _frf_answer(
    logs: Sequence[Log], chosen: Channel, known: Mapping[str, float], found: tuple[Frf, Frf, TransferFunction],
    items: Sequence[Record],
) -> Answer:  # fmt: skip
    raw, used, model = found
    model_name = f"{chosen} in {items[0].name}"
    model.check_known(items[0].name)
    values = parameters(chosen.block, model, known) if chosen.block else {}
    points = {
        "frequency": {"value": used.frequency, "unit": "rad/s"},
        "magnitude": {"value": used.magnitude, "unit": "dB of SI"},
        "phase": {"value": used.phase, "unit": "deg"},
        "sd_relative": used.deviation / np.abs(used.response),
        "coherence": used.coherence,
        "as_read": {"magnitude": raw.magnitude, "phase": raw.phase},
    }
    data = {
        **log_data(logs),
        "block": chosen.block or None,
        "input": chosen.source,
        "output": chosen.target,
        "method": raw.method,
        "points": points,
        "model": model_data(model) | {"best_fit_percent": frf_best_fit(used, model)},
    }
    answer = Answer("frf", data, values, notes=record_notes(items), model=model_of(values))
    low, high = used.frequency[0], used.frequency[-1]
    how = METHODS.get(raw.method, raw.method)
    spread = NORMAL * used.deviation / np.abs(used.response)
    answer.brief = [
        f"Frequency response {between(chosen)}: {used.frequency.size} points from {low:.3g} to {high:.3g} rad/s "
        f"({low / TURN:.2g} to {high / TURN:.2g} Hz) by {how} in {items[0].name}; a fit with {model.structure} "
        f"follows them by {frf_best_fit(used, model):.2f} %",
        f"How sure: half of the points are good to {_share(np.median(spread))} of their size, the worst to "
        f"{_share(np.max(spread))} (95 %)",
    ]
    (answer.details if values else answer.lines).extend(pole_lines(model))
    answer.tables.append(_points_table(used, spread))
    answer.following = "Next: --out DIR writes the points (frf.csv) and the Bode plot; --verbose shows them"
    if values:
        answer.tables.append(
            (f"{chosen.block} {form(chosen.block).table}", COLUMNS, parameter_table(values, known))
        )
    answer.draw = lambda: picture.bode_figure(model_name, raw, None if used is raw else used, model)
    answer.texts["frf.csv"] = frf_text(used)
    return answer


def _share(part: float) -> str:
    """A part of 1 in percent, two digits."""
    return f"{100.0 * part:.2g} %"


def _points_table(frf: Frf, spread: Array) -> tuple[str, list[str], list[list[object]]]:
    rows: list[list[object]] = [
        [f"{w:.4g}", f"{w / TURN:.3g}", f"{magnitude:.2f}", f"{phase:.1f}", _share(part)]
        for w, magnitude, phase, part in zip(frf.frequency, frf.magnitude, frf.phase, spread, strict=True)
    ]
    return "Points", ["rad/s", "Hz", "magnitude dB (SI)", "phase deg", "good to (95 %)"], rows


def frf_text(frf: Frf) -> str:
    """The points as CSV."""
    lines = ["frequency [rad/s],magnitude [dB],phase [deg],sd_relative [1]"]
    relative = frf.deviation / np.abs(frf.response)
    rows = zip(frf.frequency, frf.magnitude, frf.phase, relative, strict=True)
    lines += [",".join(f"{float(value):.9g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"
