"""The diagnosis of any system in the contract's form, in the units of the log."""

import platform
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import PARAMETER, Action
from cosim.anysystem.missing import SPEED_OF, Missing
from cosim.anysystem.model import Segment
from cosim.anysystem.pipeline import NO_LOGS, AnyDiagnosis, listed
from cosim.anysystem.read import value_of
from cosim.anysystem.readings import ON, Grid, Stale
from cosim.anysystem.search import CLOSE, Finding, errors, extended
from cosim.compare.metrics import fit_percent, rms
from cosim.diagnosis.answer.schema import (
    Answer,
    Calibration,
    Location,
    MissingFunction,
    NamedCause,
    NextExperiment,
    OfLog,
    Packages,
    Parameter,
    RefusedCause,
    Rival,
    Separable,
    Signal,
    SignalGain,
    Unexplained,
)
from cosim.inference.between import Between
from cosim.inference.held_out import ratio_ci95, squares_by_block
from cosim.inference.problem import Fit
from cosim.inference.unknowns import Unknown
from cosim.packages import project_version
from cosim.paths import called
from cosim.ssp.system import Port
from cosim.system.effects import EFFECTS

Array = NDArray[np.float64]
SHOWN_RIVALS = 8
TWO_SIDED = ("port.saturation", "port.dead_zone")  # effects of which a log may meet one side alone


def answer(found: AnyDiagnosis, package: Packages | None = None, file: Path | None = None) -> Answer:
    """The answer; `file` is where the inputs of the next experiment lie."""
    cut_short = found.budget.ended and found.budget.why in found.unjudged.values()
    return Answer(
        verdict="interrupted" if cut_short else found.verdict,  # type: ignore[arg-type]
        interrupted=found.stage if found.budget.ended else None,
        synthetic=all(log.synthetic for log in found.logs),
        model=called(found.system.path),
        signals=signals(found),
        localisation=localisation(found),
        causes=[named(found, group, action) for group, action in found.causes()],
        extended=package,
        span=found.span,
        gain=gains(found),
        unexplained=unexplained(found),
        next_experiment=next_experiment(found, file),
        not_exercised=[a.words for f in found.findings.values() for a in f.never],
        not_judged=found.unjudged,
        isolability=[
            Separable(residual=list(where), effects=list(names)) for where, names in found.structure.classes
        ],
        helpful_signals=list(found.structure.advice),
        nominal=nominal(found),
        calibrated=calibrated(found),
        warnings=[
            *(
                w if len(found.logs) == 1 or w.startswith(str(log.source)) else f"{log.source.name}: {w}"
                for log in found.logs
                for w in log.warnings
            ),
            *found.notes,
            *(
                f"{action.words}: in {listed(own)} alone"
                for finding in found.findings.values()
                for action in finding.read
                if (own := stale_in(found, finding, action))
            ),
        ],
        advice=found.advice,
        held_out=held_out(found),
        refused=[
            RefusedCause(effect=a.words, block=block_of(f, a), why=why, parameters=nearest(found, f, a))
            for f in found.findings.values()
            for a, why in f.refused
        ],
        made={
            "cosim": project_version(),
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "scipy", "numba", "fmpy")},
            **{log.source.name: log.sha256 for log in found.logs if log.sha256},
            "runs of FMUs": str(found.runs),
            "steps of FMUs": str(found.steps),
        },
    )


def held_out(found: AnyDiagnosis) -> str:
    """What takes no part in fits: the logs given for it, windows, or both."""
    whole = {n: any(not s.fitted.any() for s in f.model.segments) for n, f in found.findings.items()}
    windows = [n for n, own in whole.items() if not own]
    if len(windows) == len(whole):
        return "every third window of the log"
    rest = f"; of {listed(windows)} every third window" if windows else ""
    return f"the logs given to --held-out{rest}"


def next_experiment(found: AnyDiagnosis, file: Path | None) -> NextExperiment | None:
    """The proposed experiment, if one would help."""
    if found.proposal is None:
        return None
    return NextExperiment(
        why=found.proposal.why,
        excitation=found.proposal.excitation,
        predicted_gain=found.proposal.gain,
        file=str(file) if file else None,
    )


def block_of(finding: Finding, action: Action) -> str:
    """The component of a cause."""
    return action.port.component or finding.model.group.name


def column_scale(found: AnyDiagnosis, connector: str) -> tuple[str, float, float]:
    """Unit in which people read a connector, and factor and offset of (value - offset) / factor."""
    column = next((log.columns[connector] for log in found.logs if connector in log.columns), None)
    return (column.unit, column.factor, column.offset) if column else ("1", 1.0, 0.0)


def unit_at(found: AnyDiagnosis, action: Action) -> tuple[str, float, float]:
    """The same of the port at which an effect acts: as the log has it, or its FMU's unit."""
    if any(str(action.port) in log.columns for log in found.logs):
        return column_scale(found, str(action.port))
    for finding in found.findings.values():
        for drive in finding.model.group.drives:
            if drive.port == action.port and (drive.factor, drive.offset) == (1.0, 0.0):
                return column_scale(found, drive.signal)
        for signal, port in finding.model.group.judged:
            if port == action.port:
                return column_scale(found, signal)
    return found.system.variable(action.port).unit or "1", 1.0, 0.0


def named(found: AnyDiagnosis, group: str, action: Action) -> NamedCause:
    """One cause."""
    finding = found.findings[group]
    gain = finding.held[action]
    low, high = gain.ci95
    told = shown_action(found, group, action)
    alike = [a.words for a in finding.alike.get(action, []) if not ruled_out(found, group, action, a)]
    for one in (action, *finding.alike.get(action, [])):
        alike += [w for w in behind_wire(finding, one) if w not in alike]
    alike += [w for w in found.undecided.get((group, action), []) if w not in alike]
    rivals = [
        Rival(effect=a.words, why_not=reason(behind))
        for a, behind in finding.rivals.get(action, [])[:SHOWN_RIVALS]
    ]
    return NamedCause(
        effect=action.effect,
        block=action.port.component,
        component=action.port.component,
        connector=action.port.variable,
        parameter=action.port.variable if action.effect == PARAMETER else None,
        where=told.where or None,
        parameters=numbers(found, finding, action),
        evidence={
            "log_likelihood_gain": finding.gains[action],
            "held_out_gain": gain.gain,
            "held_out_gain_low": low,
            "held_out_gain_high": high,
        },
        rivals=rivals,
        indistinguishable_from=alike,
        logs=[found.logs[k].source.name for k in sorted(found.only.get(group, NO_LOGS)[0])]
        or stale_in(found, finding, action),
    )


def stale_in(found: AnyDiagnosis, finding: Finding, action: Action) -> list[str]:
    """The logs in which samples of a reading repeat themselves, where others have none; empty where all have some."""
    shown = finding.read.get(action)
    if not isinstance(shown, Stale):
        return []
    (signal,) = (s for s, port in finding.model.group.judged if port == action.port)
    segments = [finding.model.segments[k] for k in finding.model.judging(signal)]
    own = [
        s.number for s, held in zip(segments, shown.held, strict=True) if np.any(held != np.arange(held.size))
    ]
    return [] if len(own) == len(segments) else [found.logs[k].source.name for k in sorted(set(own))]


def behind_wire(finding: Finding, action: Action) -> list[str]:
    """The other end of a wire that was not measured, where it has two ends only."""
    if action.where != "output" or EFFECTS[action.effect].reading:
        return []
    ends = [w.target for w in finding.model.group.inner if w.source == action.port]
    if len(ends) != 1 or action.port in [p for _, p in finding.model.group.judged]:
        return []
    return [Action(action.effect, ends[0], "input").words]


def shown_action(found: AnyDiagnosis, group: str, action: Action) -> Action:
    """The cause as its neighbours have it."""
    where = found.where.get((group, action), action.where)
    return Action(action.effect, action.port, where)  # type: ignore[arg-type]


def ruled_out(found: AnyDiagnosis, group: str, action: Action, other: Action) -> bool:
    """Whether what the reading drives has shown that it alone is off, and not the quantity, which the other would change."""
    asked = found.votes.get((group, action))
    return bool(asked) and found.where.get((group, action)) == "sensor" and other.where != "sensor"


def reason(behind: float) -> str:
    """Words for how far a rival lies behind."""
    if behind < CLOSE:
        return f"only {max(behind, 0.0):.1f} in log-likelihood behind: this log cannot tell the two apart"
    return f"explains the log worse by {behind:.0f} in log-likelihood (less the price of its parameters)"


def nearest(found: AnyDiagnosis, finding: Finding, action: Action) -> dict[str, Parameter]:
    """The parameters of a refused cause, where it is one of those that come nearest."""
    near = finding.nearest
    if near is None or action not in near.actions or finding.chosen.actions:
        return {}
    return numbers(found, finding, action, near.fit)


def numbers(
    found: AnyDiagnosis, finding: Finding, action: Action, fit: Fit | None = None
) -> dict[str, Parameter]:
    """The parameters of a cause with their intervals, in the log's units; by default of the fit that was chosen."""
    if action in finding.read:
        return read_numbers(found, action, finding.read[action])
    fit = fit or finding.chosen.fit
    known = {u.name: u for u in fit.unknowns}
    result = {}
    if action.effect == PARAMETER:
        name = f"{PARAMETER}|{action.port}"
        reach = 1.96 * fit.deviation(name)
        value = fit.values[name]
        unit = found.system.variable(action.port).unit or "1"
        ends = finding.between[name].ci95 if name in finding.between else (value - reach, value + reach)
        told = over_logs(finding.between.get(name), lambda x: x)
        instead = value_of(found.system, str(action.port))
        return {
            action.port.variable: Parameter(value=value, unit=unit, ci95=ends, instead_of=instead, **told)
        }
    signal, factor, _ = unit_at(found, action)
    met = [p for p in EFFECTS[action.effect].parameters if fit.deviation(action.key(p)) > 0.0]
    for parameter, declared in EFFECTS[action.effect].parameters.items():
        key = action.key(parameter)
        scale = factor if declared.kind in ("signal", "signal/s") else 1.0
        offset = 0.0
        if action.effect == "port.saturation":
            offset = unit_at(found, action)[2]
        value = fit.values[key]
        reach = 1.96 * fit.deviation(key)
        unknown = known[key]
        if action.effect == "port.saturation" and not unknown.low < value < unknown.high:
            continue  # beyond what the signal reaches
        if action.effect in TWO_SIDED and met and parameter not in met:
            continue  # of which the log shows nothing: no sample comes to this side
        ends = finding.between[key].ci95 if key in finding.between else (value - reach, value + reach)

        def shown(
            x: float, unknown: Unknown = unknown, scale: float = scale, offset: float = offset
        ) -> float:
            """In the log's unit, and no further than it can be."""
            return (min(max(x, unknown.low), unknown.high) - offset) / scale

        result[parameter] = Parameter(
            value=(value - offset) / scale,
            unit=EFFECTS[action.effect].unit(parameter, signal),
            ci95=ordered(shown(ends[0]), shown(ends[1])),
            **over_logs(finding.between.get(key), shown),
        )
    return result


def ordered(one: float, other: float) -> tuple[float, float]:
    """Both, the smaller first."""
    return min(one, other), max(one, other)


def over_logs(told: Between | None, shown: Callable[[float], float]) -> dict[str, Any]:
    """Where each of several logs draws a number, and what another would give; nothing for one log."""
    if told is None or told.values.size < 2:
        return {}
    each = []
    for own, deviation in zip(told.values, told.deviations, strict=True):
        reach = 1.96 * deviation
        ends = ordered(shown(own - reach), shown(own + reach)) if np.isfinite(reach) else None
        each.append(OfLog(value=shown(own), ci95=ends))
    low, high = told.next_ci95
    return {"per_log": each, "next_log_ci95": ordered(shown(low), shown(high))}


def read_numbers(found: AnyDiagnosis, action: Action, shown: Grid | Stale) -> dict[str, Parameter]:
    """The same of what a reading shows by itself."""
    if isinstance(shown, Grid):
        unit, factor, _ = unit_at(found, action)
        step = shown.step / abs(factor)
        reach = ON * step
        return {"quantum": Parameter(value=step, unit=unit, ci95=(step - reach, step + reach))}
    reach = 1.96 * shown.deviation
    return {
        "probability": Parameter(
            value=shown.share, unit="1", ci95=(max(shown.share - reach, 0.0), shown.share + reach)
        )
    }


def judged_signals(found: AnyDiagnosis) -> list[tuple[Finding, str]]:
    """Findings and the connectors by which they are judged."""
    return [(f, s) for f in found.findings.values() for s, _ in f.model.group.judged]


def series(finding: Finding, connector: str, values: Mapping[str, float]) -> Array:
    """Error of a connector in the logs that judge by it, behind one another."""
    return finding.model.whole(errors(finding, values), connector)


def judging(finding: Finding, connector: str) -> list[Segment]:
    """These logs."""
    return [finding.model.segments[k] for k in finding.model.judging(connector)]


def signals(found: AnyDiagnosis) -> dict[str, Signal]:
    """Errors of the nominal model, each group driven by what was measured."""
    result = {}
    for finding, connector in judged_signals(found):
        unit, scale, _ = column_scale(found, connector)
        left = series(finding, connector, finding.null.fit.values)
        measured = finding.model.measured(connector)
        result[connector] = Signal(
            rmse=rms(left) / abs(scale),
            fit_percent=fit_percent(measured, measured - left) or 0.0,
            unit=unit,
            noise_floor=finding.floors[connector] / abs(scale),
        )
    return result


def localisation(found: AnyDiagnosis) -> list[Location]:
    """Groups by how far their residual is above the noise; shares add up to one."""
    rows = []
    for finding, connector in judged_signals(found):
        left = rms(series(finding, connector, finding.null.fit.values))
        floor = finding.floors[connector]
        wrong = bool(finding.named) or connector in finding.unexplained
        weight = max((left / max(floor, 1e-300)) ** 2 - 1.0, 0.0) if wrong else 0.0
        rows.append((found.cuts.part_of(connector), connector, weight, left, floor))
    total = sum(row[2] for row in rows)
    result = []
    for name, connector, weight, left, floor in sorted(rows, key=lambda row: -row[2]):
        unit, scale, _ = column_scale(found, connector)
        result.append(
            Location(
                block=name,
                signal=connector,
                share=weight / total if total > 0.0 else 0.0,
                residual_rms=left / abs(scale),
                noise_floor=floor / abs(scale),
                unit=unit,
            )
        )
    return result


def held_windows(finding: Finding, connector: str) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Of what was read of a connector (n,): what is held out, and the numbers of these windows."""
    own, read = judging(finding, connector), finding.model.known(connector)
    out = ~np.concatenate([s.fitted for s in own])[read]
    return out, np.concatenate([s.windows for s in own])[read][out]


def by_window(out: NDArray[np.bool_], windows: NDArray[np.int64], *errors: Array) -> list[Array]:
    """Of each error (n,) the sums of squares in each window of what is held out."""
    return [squares_by_block(e[out], windows) for e in errors]


def gains(found: AnyDiagnosis) -> dict[str, SignalGain]:
    """Errors on held-out windows without and with the causes, from runs of the FMUs."""
    result = {}
    for finding, connector in judged_signals(found):
        if not finding.named:
            continue
        before = series(finding, connector, finding.null.fit.values)
        after = series(finding, connector, extended(finding, finding.fitted or finding.chosen))
        measured = finding.model.measured(connector)
        out, windows = held_windows(finding, connector)
        if not out.any():  # the logs held out lack it
            continue
        squares = by_window(out, windows, after, before)
        unit, scale, _ = column_scale(found, connector)
        result[connector] = SignalGain(
            rmse_before=rms(before[out]) / abs(scale),
            rmse_after=rms(after[out]) / abs(scale),
            unit=unit,
            noise_floor=finding.floors[connector] / abs(scale),
            fit_percent_before=fit_percent(measured[out], (measured - before)[out]) or 0.0,
            fit_percent_after=fit_percent(measured[out], (measured - after)[out]) or 0.0,
            ci95_of_ratio=ratio_ci95(squares[0], squares[1]),
        )
    return result


def unexplained(found: AnyDiagnosis) -> list[Unexplained]:
    """What stays wrong, with what it depends on."""
    result = []
    for finding, connector in judged_signals(found):
        if connector not in finding.unexplained:
            continue
        unit, scale, _ = column_scale(found, connector)
        left = rms(series(finding, connector, extended(finding, finding.chosen)))
        port = dict(finding.model.group.judged)[connector]
        lost = found.missing.get(finding.model.group.name)
        result.append(
            Unexplained(
                block=port.component,
                what=f"{connector}: {finding.unexplained[connector]}"
                + (f"; {entering(lost)}" if lost else ""),
                residual_rms=left / abs(scale),
                unit=unit,
                missing=shape(found, lost) if lost else None,
            )
        )
    return result


def entering(lost: Missing) -> str:
    """Words for where what is missing enters."""
    what = f"a function of {driver(lost.by)}" if lost.by else "a function of several signals"
    return f"{what} added at {' or '.join(lost.ports)} would tell {100 * lost.told:.0f} % of it"


def driver(name: str) -> str:
    """What a function is of, within a sentence."""
    return f"the {name} (as friction is)" if name.startswith(SPEED_OF) else name


def shape(found: AnyDiagnosis, lost: Missing) -> MissingFunction:
    """The same for programs, in the units of the log."""
    factor = unit_at(found, entry_of(lost.ports[0]))[1]
    _, scale, offset = driver_unit(found, lost.by) if lost.by else ("", 1.0, 0.0)
    return MissingFunction(
        enters_at=list(lost.ports),
        depends_on=lost.by or None,
        share=lost.told,
        points=[((x - offset) / scale, y / factor) for x, y in zip(lost.at, lost.of, strict=True)],
    )


def entry_of(place: str) -> Action:
    """What acts where something is missing, ``component.connector (input)``."""
    return Action("port.gain", Port(*place.rpartition(" ")[0].split(".", 1)), "input")


def driver_unit(found: AnyDiagnosis, by: str) -> tuple[str, float, float]:
    """Unit, factor and zero of the signal of which a function is, as `unit_at` tells them."""
    signal = Action("port.gain", Port(*by.removeprefix(SPEED_OF).split(".", 1)), "input")
    unit, scale, offset = unit_at(found, signal)
    # where a scale has its zero is nothing to a speed
    return (f"{unit or '1'}/s", scale, 0.0) if by.startswith(SPEED_OF) else (unit, scale, offset)


def calibrated(found: AnyDiagnosis) -> dict[str, Calibration]:
    """What free parameters gain over the numbers that the FMUs state, on held-out data."""
    result = {}
    for finding, connector in judged_signals(found):
        if not finding.free:
            continue
        stated = {f"{PARAMETER}|{n}": value_of(found.system, n) or 0.0 for n in finding.free}
        out, windows = held_windows(finding, connector)
        if not out.any():
            continue
        measured = finding.model.measured(connector)
        values = finding.null.fit.values
        before = measured - finding.model.whole(finding.model({**values, **stated}), connector)
        after = series(finding, connector, values)
        squares = by_window(out, windows, after, before)
        unit, scale, _ = column_scale(found, connector)
        result[connector] = Calibration(
            rmse_stated=rms(before[out]) / abs(scale),
            rmse_fitted=rms(after[out]) / abs(scale),
            unit=unit,
            ci95_of_ratio=ratio_ci95(squares[0], squares[1]),
        )
    return result


def nominal(found: AnyDiagnosis) -> dict[str, Parameter]:
    """Parameters that are no causes as the extended model has them: free ones, and trusted ones within their tolerance."""
    result = {}
    for finding in found.findings.values():
        for name, (value, deviation) in (finding.free | finding.settled).items():
            component, _, variable = name.partition(".")
            unit = found.system.components[component].fmu.variables[variable].unit or "1"
            reach = 1.96 * deviation
            instead = value_of(found.system, name)
            result[name] = Parameter(
                value=value, unit=unit, ci95=(value - reach, value + reach), instead_of=instead
            )
    return result
