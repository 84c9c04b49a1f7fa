"""A calibration for people (tables), programs (plain data) and simulators (an .ssv file)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lxml import etree

from cosim.calibrate.outcome import Calibration, Parameter, SignalFit
from cosim.compare import Score
from cosim.compare.outcome import Comparison
from cosim.files import write_bytes
from cosim.report.names import known_as
from cosim.report.words import number, unit_text
from cosim.ssp.quantities import BASE_UNITS, UnitDefinition
from cosim.ssp.read import resolve
from cosim.ssp.system import System, Value
from cosim.ssp.write import NAMESPACES, SSC, SSV, xml_bytes

if TYPE_CHECKING:
    from rich.table import Table

SET_NAME = "calibrated"


def tables(found: Calibration, comparison: Comparison) -> "list[Table]":
    """Parameters, then errors before and after; they fit a terminal of 80 columns."""
    rows = [_cells(p) for p in found.parameters]
    parameters = _table("Calibrated parameters", ("parameter", "start", "value", "95 % interval"), rows, 1)
    held = any(s.held_after is not None for s in found.signals.values())
    heads = [
        "signal",
        "fitted: before",
        "after",
        *(["held out: before", "after", "fit %"] if held else []),
        "noise",
    ]
    scores = [_score_cells(comparison, n, s, held) for n, s in found.signals.items()]
    return [parameters, _table("RMSE (model driven by the command alone)", heads, scores, 1)]


def _table(title: str, heads: Sequence[str], rows: list[list[str]], left: int) -> "Table":
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    result = Table(title=title, box=SIMPLE_HEAD, title_justify="left", padding=(0, 0, 0, 1))
    for k, name in enumerate(heads):
        result.add_column(name, justify="left" if k < left else "right", overflow="fold")
    for row in rows:
        result.add_row(*(escape(cell) for cell in row))
    return result


def _cells(p: Parameter) -> list[str]:
    unit, scale = p.shown
    head = [f"{p.name} [{unit}]", f"{p.start * scale:.6g}"]
    if not p.determined:
        return [*head, f"({p.value * scale:.6g})", "not determined"]
    if p.ci95 is None or p.deviation is None:
        return [*head, f"{p.value * scale:.6g}", f"at {p.at_bound} bound"]
    low, high = sorted(x * scale for x in p.ci95)
    digits = significant(p.value, p.deviation)
    return [*head, f"{p.value * scale:.{digits}g}", f"{low:.{digits}g} .. {high:.{digits}g}"]


def significant(value: float, deviation: float) -> int:
    """Digits that a value deserves: two of its standard deviation."""
    from math import ceil, log10

    if value == 0.0 or deviation <= 0.0:
        return 6
    return min(max(ceil(log10(abs(value) / deviation)) + 2, 3), 9)


def _score_cells(comparison: Comparison, name: str, fit: SignalFit, held: bool) -> list[str]:
    unit, scale = comparison.shown(name)
    label = f"{name} [{unit}]" + ("" if fit.fitted else " (not fitted)")
    cells = [label, *(f"{s.rmse * scale:.3g}" for s in (fit.before, fit.after))]
    if held:
        pair = (fit.held_before, fit.held_after)
        cells += ["-" if s is None else f"{s.rmse * scale:.3g}" for s in pair]
        last = fit.held_after
        none = last is None or last.fit_percent is None
        cells.append(
            "-" if none or last is None else "constant" if last.constant else f"{last.fit_percent:.1f}"
        )
    return [*cells, f"{fit.after.noise_floor * scale:.3g}"]


def answer(found: Calibration, comparison: Comparison) -> list[str]:
    """What a calibration says, in a few lines: each parameter, what the log does not determine, how much better."""
    lines = []
    for p in found.parameters:
        unit, scale = p.shown
        head, _, *numbers = _cells(p)
        name, shown = head.rsplit(" [", 1)[0], f" {unit_text(unit)}".rstrip()
        if not p.determined:
            continue
        lines.append(
            f"Calibrated: {name} = {numbers[0]}{shown}, {_ends(numbers[1])}; it was {number(p.start * scale)}{shown}"
        )
    lines += [f"Not determined: {item.why}." for item in found.undetermined]
    same = []
    for name, fit in found.signals.items():
        if fit.held_before is None or fit.held_after is None:
            continue
        unit, scale = comparison.shown(name)
        before, after = (f"{s.rmse * scale:.3g}" for s in (fit.held_before, fit.held_after))
        if before == after:
            same.append(known_as(name))
            continue
        better = fit.held_after.rmse < fit.held_before.rmse
        lines.append(
            f"{'Better' if better else 'Worse'}: error of the {known_as(name)} on held-out data "
            f"{'falls' if better else 'rises'} from {before} to {after} {unit_text(unit)}".rstrip()
        )
    return lines + ([f"Unchanged on held-out data: {', '.join(same)}"] if same else [])


def _ends(text: str) -> str:
    """An interval of the table in words."""
    low, dots, high = text.partition(" .. ")
    return f"{low} to {high} (95 %)" if dots else text


def explanations(found: Calibration) -> list[str]:
    """What stands below the tables, one sentence each."""
    lines = [f"Not determined: {item.why}." for item in found.undetermined]
    lines += [f"{p.name}: {p.remark}." for p in found.parameters if p.remark and p.determined]
    for first, second, value in found.correlated:
        lines.append(
            f"{first} and {second} are only known together: their estimates have a correlation of {value:.3f}."
        )
    if len(found.starts) > 1:
        same = sum(start.same for start in found.starts)
        lines.append(f"{same} of {len(found.starts)} starts ended at the same error.")
    how = "compiled" if found.engine == "compiled" else f"by the FMUs ({found.why_fmu})"
    lines.append(f"{found.evaluations} simulations, {how}, in {found.seconds:.1f} s.")
    return lines + [note[0].upper() + note[1:] + "." for note in found.notes]


def as_data(found: Calibration, comparison: Comparison) -> dict[str, Any]:
    """The calibration as plain data: parameters in the FMU's unit, numbers of a signal in its ``unit``."""
    last = found.series[-1]
    return {
        "engine": found.engine,
        "why_not_compiled": found.why_fmu or None,
        "parameters": [_parameter(p) for p in found.parameters],
        "covariance": found.covariance,
        "not_determined": found.undetermined,
        "correlated": [{"parameters": [a, b], "correlation": r} for a, b, r in found.correlated],
        "start_values": found.start_values,
        "signals": {name: _signal(comparison, name, fit) for name, fit in found.signals.items()},
        "held_out": {
            "log": last.source,
            "from": float(last.time[last.held_from]) if last.held_from < len(last.time) else None,
            "to": float(last.time[-1]),
        },
        "starts": found.starts,
        "simulations": found.evaluations,
        "seconds": found.seconds,
        "notes": found.notes,
    }


def _parameter(p: Parameter) -> dict[str, Any]:
    names = (
        "name",
        "unit",
        "start",
        "value",
        "deviation",
        "ci95",
        "determined",
        "at_bound",
        "remark",
        "prior",
    )
    bounds = {"bounds": [p.low, p.high]}
    return {n: getattr(p, n) for n in names} | bounds


def _signal(comparison: Comparison, name: str, fit: SignalFit) -> dict[str, Any]:
    unit, scale = comparison.shown(name)

    def numbers(score: Score | None) -> dict[str, Any] | None:
        if score is None:
            return None
        windows = None if score.rmse_windows is None else score.rmse_windows * scale
        return {
            "rmse": score.rmse * scale,
            "rmse_windows": windows,
            "fit_percent": score.fit_percent,
            "samples": score.samples,
        }

    noise = None
    if fit.noise is not None:
        noise = {
            "rms": fit.noise.rms * scale,
            "white_rms": fit.noise.white**0.5 * scale,
            "effective_samples": fit.effective,
        }
    return {
        "unit": unit,
        "fitted": fit.fitted,
        "noise_floor": fit.after.noise_floor * scale,
        "residual_noise": noise,
        "before": numbers(fit.before),
        "after": numbers(fit.after),
        "held_out_before": numbers(fit.held_before),
        "held_out_after": numbers(fit.held_after),
    }


def write_ssv(system: System, values: Mapping[str, Value], path: Path, remarks: Mapping[str, str]) -> Path:
    """Write an SSP 1.0 parameter set that the system takes.

    Args:
        system: the model.
        values: name -> value in the FMU's unit.
        path: the file.
        remarks: name -> what to say about it in a comment.
    """
    root = etree.Element(
        f"{{{SSV}}}ParameterSet",
        nsmap={k: NAMESPACES[k] for k in ("ssv", "ssc")},
        version="1.0",
        name=SET_NAME,
    )
    parameters = etree.SubElement(root, f"{{{SSV}}}Parameters")
    units: dict[str, UnitDefinition] = {}
    for name, value in values.items():
        port = resolve(system, name)[0]
        variable, known = system.variable(port), system.components[port.component].fmu.units
        if remarks.get(name):
            parameters.append(etree.Comment(f" {name}: {remarks[name]} ".replace("--", "- ")))
        node = etree.SubElement(parameters, f"{{{SSV}}}Parameter", name=name)
        kind = "Integer" if variable.kind == "Enumeration" else variable.kind
        text = str(value).lower() if kind == "Boolean" else repr(value) if kind == "Real" else str(value)
        item = etree.SubElement(node, f"{{{SSV}}}{kind}", value=text)
        if kind == "Real" and variable.unit:
            item.set("unit", variable.unit)
            if variable.unit in known:
                units[variable.unit] = known[variable.unit]
    if units:
        _write_units(etree.SubElement(root, f"{{{SSV}}}Units"), units)
    return write_bytes(path, xml_bytes(root))


def _write_units(parent: etree._Element, units: Mapping[str, UnitDefinition]) -> None:
    for name, unit in sorted(units.items()):
        base = {n: str(power) for n, power in zip(BASE_UNITS, unit.exponents, strict=True) if power}
        if unit.factor != 1.0:
            base["factor"] = repr(unit.factor)
        if unit.offset != 0.0:
            base["offset"] = repr(unit.offset)
        etree.SubElement(etree.SubElement(parent, f"{{{SSC}}}Unit", name=name), f"{{{SSC}}}BaseUnit", base)
