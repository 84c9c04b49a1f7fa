"""What the subcommands of ``cosim identify`` do with logs: from request to `Answer`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cosim.errors import DataError, UsageError
from cosim.identify import picture
from cosim.identify.answer import COLUMNS, Answer, parameter_table
from cosim.identify.blocks import form, parameters
from cosim.identify.candidates import HELD_OUT, Choice, compare_structures
from cosim.identify.data import Record, record
from cosim.identify.dead_zone import HELD_OUT_PARTS, DeadZone, identify_dead_zone, predicted_dead_zone
from cosim.identify.estimate import Quantity
from cosim.identify.other_machine import Other
from cosim.identify.smooth_dead_zone import SmoothDeadZone, smooth_dead_zone
from cosim.identify.transfer_function import Structure, TransferFunction, fit_records
from cosim.logs import Log
from cosim.report.names import known_as


@dataclass(frozen=True)
class Channel:
    """Which signals: those of a block, or any two.

    Attributes:
        block: of the drive, or empty for other signals.
        source: input signal.
        target: output signal.
        linear: take u without compensator and dead zone.
        cutoff: low-pass [Hz] on both, or None.
        integrates: whether the target is the integral of what follows the source; None: as on the crane.
    """

    block: str
    source: str
    target: str
    linear: bool = False
    cutoff: float | None = None
    integrates: bool | None = None

    @property
    def integrators(self) -> int:
        """Poles at 0 between the two signals: the slew angle is an integral."""
        if self.integrates is not None:
            return int(self.integrates)
        return int(self.target == "slew" and self.source != "slew")

    def __str__(self) -> str:
        return f"{self.target}/{self.source}"


def channel(
    block: str | None,
    source: str | None,
    target: str | None,
    linear: bool = False,
    cutoff: float | None = None,
) -> Channel:
    """The channel that block, or input and output, name.

    Raises:
        UsageError: both or neither are given, or the block is unknown.
    """
    if block is not None and (source is not None or target is not None):
        raise UsageError("give either --block, or --input and --output")
    if block is None and source is None and target is None:
        block = "simplified"
    if block is not None:
        item = form(block)
        return Channel(block, item.source, item.target, linear, cutoff)
    if source is None or target is None or source == target:
        raise UsageError(
            "--input and --output go together and name two signals, such as --input spool --output p_load"
        )
    return Channel("", source, target, linear, cutoff)


def channel_of(other: Other, log: Log, linear: bool = False, cutoff: float | None = None) -> Channel:
    """The channel from a machine's command to its motion."""
    return Channel("", other.command, other.motion, linear, cutoff, other.integrates(log))


def rows_of(chosen: Channel, other: Other | None) -> tuple[Structure, ...]:
    """Structures that are tried where none are asked for."""
    if chosen.block:
        return form(chosen.block).rows
    count = chosen.integrators
    if other is None or chosen.integrates is None:
        return (Structure(1 + count, 0, count),)
    # a lag, two, and a zero: of its slopes the drive shows no more
    return tuple(Structure(poles + count, zeros, count) for poles, zeros in ((1, 0), (2, 0), (2, 1), (3, 0)))


def records_of(logs: Sequence[Log], chosen: Channel, known: Mapping[str, float]) -> list[Record]:
    """The channel's record of each log."""
    return [
        record(log, chosen.source, chosen.target, known, linear=chosen.linear, cutoff=chosen.cutoff)
        for log in logs
    ]


def model_of(values: Mapping[str, Quantity], other: Other | None = None) -> str:
    """Our system that takes the numbers; none takes those of another machine."""
    if other is not None:
        return ""
    return "simplified" if any(name.startswith("simplified.") for name in values) else "full_order"


def record_notes(records: Sequence[Record]) -> list[str]:
    """What was done to the records."""
    return [f"{item.name}: {note}" for item in records for note in item.notes]


def log_data(logs: Sequence[Log]) -> dict[str, Any]:
    """The logs as plain data."""
    return {
        "logs": [{"path": str(log.source), "sha256": log.sha256, "synthetic": log.synthetic} for log in logs],
        "synthetic": any(log.synthetic for log in logs),
    }


def dead_zone_answer(
    log: Log,
    known: Mapping[str, float],
    response: str | None,
    cutoff: float | None,
    other: Other | None = None,
) -> Answer:
    """The dead zone from a slow ramp, or any log with command and response."""
    found = identify_dead_zone(log, known, response=response, cutoff=cutoff)
    values = dead_zone_parameters(found)
    nominal = {"dead_zone.b_r": known["dead_zone.b_r"], "dead_zone.b_l": known["dead_zone.b_l"]}
    nominal |= {"dead_zone.m_r": known["dead_zone.m_r"], "dead_zone.m_l": known["dead_zone.m_l"]}
    data = {
        **log_data([log]),
        "response": found.response,
        "sides": {side: {n: q.as_data() for n, q in of.items()} for side, of in found.sides.items()},
        "offset": None if found.offset is None else found.offset.as_data(),
        "lag": found.lag.as_data() | {"nominal": found.nominal_lag},
        "best_fit_percent": found.best_fit,
        # (4.9), Table 4.1: what a compensator for this valve would add
        "compensator": {
            name: abs(of["break_point"].value)
            for side, name in (("right", "d_plus"), ("left", "d_minus"))
            if (of := found.sides.get(side))
        },
    }
    held_out = predicted_dead_zone(found, known, cutoff)
    data["held_out_percent"] = {"as_found": held_out[0], "without_dead_zone": held_out[1]}
    answer = Answer("dead-zone", data, values, notes=list(found.notes), model=model_of({}, other))
    if other is not None:
        answer.following, answer.lexicon = other.following(log), other.lexicon
    title = f"dead zone from {found.response}, best fit {found.best_fit:.2f} %"
    answer.tables.append((title, COLUMNS, parameter_table(values, nominal)))
    low, high = found.lag.interval
    known_lag = f", nominal {found.nominal_lag * 1e3:.4g} ms" if other is None else ""
    answer.lines.append(
        f"lag {found.lag.value * 1e3:.4g} ms ({low * 1e3:.4g} to {high * 1e3:.4g}){known_lag}"
    )
    d_plus, d_minus = (known[f"compensator.{name}"] for name in ("d_plus", "d_minus"))
    if d_plus or d_minus:
        answer.lines.append(
            f"break points are those behind the compensator, which adds {d_plus * 100:.4g} % to the right and "
            f"{d_minus * 100:.4g} % to the left of what the log calls u; without one: --set compensator.d_plus=0 --set "
            "compensator.d_minus=0"
        )
    answer.lines.append(
        f"How well it fits: of {HELD_OUT_PARTS} parts of the log, each predicted from the others, it tells "
        f"{held_out[0]:.4g} % of the {known_as(found.response)} (best fit); without a dead zone {held_out[1]:.4g} %"
    )
    try:
        _add_smooth(answer, smooth_dead_zone(found))
    except DataError as error:
        data["smooth"], data["no_smooth"] = None, str(error)
    answer.draw = lambda: picture.dead_zone_figure(found)
    return answer


def _add_smooth(answer: Answer, curve: SmoothDeadZone) -> None:
    """What the tanh family (2.5), (4.9) makes of the measured curve."""
    half = [1.96 * deviation for deviation in curve.deviations]
    answer.data["smooth"] = {
        "d_plus": Quantity(curve.d_plus, curve.deviations[0], 1e6, "1").as_data(),
        "d_minus": Quantity(curve.d_minus, curve.deviations[1], 1e6, "1").as_data(),
        "S": None if curve.sharp else Quantity(curve.S, curve.deviations[2], 1e6, "1").as_data(),
        "rmse": curve.rmse,
        "rmse_of_sharp_edges": curve.rmse_sharp,
        "unit": "of the largest response",
    }
    sharpness = "sharper than the family can be" if curve.sharp else f"S {curve.S:.4g} +- {half[2]:.2g}"
    answer.details.append(
        f"smooth family (2.5), (4.9): d_plus {curve.d_plus * 100:.4g} +- {half[0] * 100:.2g} %, d_minus "
        f"{curve.d_minus * 100:.4g} +- {half[1] * 100:.2g} %, {sharpness}; off by {curve.rmse * 100:.2g} % of the largest "
        f"response, sharp edges (2.2) by {curve.rmse_sharp * 100:.2g} %"
    )


def dead_zone_parameters(found: DeadZone) -> dict[str, Quantity]:
    """Break points and slopes as parameters of the component `dead_zone`."""
    letters = {"right": "r", "left": "l"}
    values = {}
    for side, of in found.sides.items():
        values[f"dead_zone.b_{letters[side]}"] = of["break_point"]
        values[f"dead_zone.m_{letters[side]}"] = of["relative_slope"]
    return values


def transfer_function_answer(
    logs: Sequence[Log],
    chosen: Channel,
    structures: Sequence[Structure],
    known: Mapping[str, float],
    other: Other | None = None,
) -> Answer:
    """Transfer functions of several structures, and the one to use."""
    items = records_of(logs, chosen, known)
    choice = compare_structures(items, tuple(structures) or rows_of(chosen, other))
    choice.chosen.model.check_known()
    values, notes = _values(choice, chosen, known)
    data = {
        **log_data(logs),
        "block": chosen.block or None,
        "input": chosen.source,
        "output": chosen.target,
        "candidates": [_row(row) for row in choice.candidates],
        "failed": choice.failed,
        "chosen": choice.chosen.name,
        "why": choice.why,
        "held_out_share": HELD_OUT,
        "model": model_data(choice.chosen.model),
    }
    notes += record_notes(items) + [f"{name}: {text}" for name, text in choice.failed.items()]
    answer = Answer("transfer-function", data, values, notes=notes, model=model_of(values, other))
    answer.tables.append(_candidate_table(choice, str(chosen)))
    if chosen.block and len(logs) > 1:
        by_log = _by_log(items, chosen, known, choice)
        data["by_log"] = [
            {"log": name, "parameters": {n: q.as_data() for n, q in of.items()}} for name, of, _ in by_log
        ]
        answer.tables.append(_log_table(by_log))
    if values:
        answer.tables.append(
            (f"{chosen.block} {form(chosen.block).table}", COLUMNS, parameter_table(values, known))
        )
    answer.brief = _sentences(choice, chosen)
    (answer.details if values else answer.lines).extend(pole_lines(choice.chosen.model))
    answer.following = (
        other.following(logs[0])
        if other is not None
        else "Next: --out DIR writes the picture of fit and residual; --verbose shows every candidate"
    )
    answer.draw = lambda: picture.transfer_function_figure(
        f"{chosen} in {items[0].name}", choice, chosen.target
    )
    return answer


def _sentences(choice: Choice, chosen: Channel) -> list[str]:
    """What was found and how sure it is."""
    best, others = choice.chosen, [row for row in choice.candidates if row is not choice.chosen]
    found = f"Transfer function {between(chosen)}: {best.structure}; {choice.why}"
    part = f"{HELD_OUT * 100:.0f} % of the log"
    sure = f"on the last {part}, which its fit has not seen, it predicts {best.held_out:.2f} % (best fit)"
    if others:
        rival = max(others, key=lambda row: row.held_out)
        known = "" if rival.determined else ", with poles that the log does not determine"
        many = f"{len(others)} other{'s' * (len(others) > 1)}"
        sure += f"; the best of {many} ({rival.structure}) predicts {rival.held_out:.2f} %{known}"
    return [found, f"How sure: {sure}"]


def _values(
    choice: Choice, chosen: Channel, known: Mapping[str, float]
) -> tuple[dict[str, Quantity], list[str]]:
    """Parameters of the block, of the chosen candidate or else of the one with the block's own structure; and notes."""
    if not chosen.block:
        return {}, []
    for row in [choice.chosen, *choice.candidates]:
        values = parameters(chosen.block, row.model, known) if row.determined else {}
        if values and row is choice.chosen:
            return values, []
        if values:
            return values, [
                f"the block {chosen.block} has the structure of {row.name}, not of the chosen {choice.chosen.name}: its"
                f" parameters are those of {row.name}, and {100 - row.held_out:.3g} % of the held-out part is left"
            ]
    return {}, [
        f"no candidate whose poles the log determines has the structure of the block {chosen.block}: no parameter set is"
        " written"
    ]


def _row(row: Any) -> dict[str, Any]:
    return {
        "name": row.name,
        "poles": row.structure.poles,
        "zeros": row.structure.zeros,
        "integrators": row.structure.integrators,
        "delay": row.structure.delay,
        "best_fit_percent": row.best_fit,
        "fitting_percent": row.fitting,
        "held_out_percent": row.held_out,
        "bic": row.bic,
        "determined": row.determined,
    }


def model_data(found: TransferFunction) -> dict[str, Any]:
    """Coefficients, gain, poles and zeros as plain data, SI."""
    zeros = found.zeros()
    return {
        "numerator": found.numerator,
        "denominator": found.denominator,
        "gain": found.quantity("gain").as_data(),
        "poles": [{name: q.as_data() for name, q in pole.items()} for pole in found.poles()],
        "zeros": [{"re": float(z.real), "im": float(z.imag)} for z in zeros],
        "delay": found.quantity("delay").as_data() if found.structure.delay else None,
    }


def _candidate_table(choice: Choice, title: str) -> tuple[str, list[str], list[list[object]]]:
    lowest = min(row.bic for row in choice.candidates)
    rows: list[list[object]] = [
        [
            row.name + (" *" if row is choice.chosen else ""),
            str(row.structure),
            f"{row.best_fit:.2f}",
            f"{row.fitting:.2f}",
            f"{row.held_out:.2f}",
            f"{row.bic - lowest:.1f}",
            "yes" if row.determined else "no",
        ]
        for row in choice.candidates
    ]
    columns = [
        "fit",
        "structure",
        "best fit %",
        "fitting part %",
        "held out %",
        "BIC above lowest",
        "poles known",
    ]
    return f"{title}: candidates (* chosen)", columns, rows


def _by_log(
    items: Sequence[Record], chosen: Channel, known: Mapping[str, float], choice: Choice
) -> list[tuple[str, dict[str, Quantity], float]]:
    """The chosen structure fitted to each log alone and to all, as TF1 to TF4 of Tables 4.3 and 4.4."""
    found = []
    for item in items:
        model = fit_records([item], choice.chosen.structure, start=choice.chosen.model.fit.theta)
        found.append((item.name, parameters(chosen.block, model, known), model.best_fit))
    whole = choice.chosen.model
    return [*found, ("all data", parameters(chosen.block, whole, known), whole.best_fit)]


def _log_table(
    by_log: list[tuple[str, dict[str, Quantity], float]],
) -> tuple[str, list[str], list[list[object]]]:
    rows: list[list[object]] = []
    for name, of, best in by_log:
        rows.append(
            [name, *(f"{q.value:.5g} ± {q.interval[1] - q.value:.2g}" for q in of.values()), f"{best:.2f}"]
        )
    return "log by log (SI, ± half the 95 % interval)", ["log", *by_log[0][1], "best fit %"], rows


POLES = {"rate": "", "w0": "natural frequency", "zeta": "damping ratio"}


def pole_lines(found: TransferFunction) -> list[str]:
    """Poles and zeros in words."""
    texts = ["pole at 0"] * found.structure.integrators
    for pole in found.poles():
        parts = [f"{POLES[n]} {_about(q)}".strip() for n, q in pole.items()]
        texts.append(f"{'pole' if len(parts) == 1 else 'pair of poles'}: {', '.join(parts)}")
    texts += [f"zero at {z.real:.5g}{f' ± {abs(z.imag):.5g}i' if z.imag else ''} 1/s" for z in found.zeros()]
    return texts


def _about(quantity: Quantity) -> str:
    """``25.23 ± 0.82 rad/s``: two digits of half the 95 % interval, and as many of the value."""
    half = quantity.interval[1] - quantity.value
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    if not 0.0 < half < math.inf:
        return f"{quantity.value:.4g}{unit}"
    places = max(0, 1 - math.floor(math.log10(half)))
    return f"{quantity.value:.{places}f} ± {half:.2g}{unit}"


def between(chosen: Channel) -> str:
    """Input and output in words: "from the command (u) to the spool position (spool)"."""
    return f"from the {known_as(chosen.source)} to the {known_as(chosen.target)}"
