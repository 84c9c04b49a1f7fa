"""The parameters of a batch: which of them differ between runs, and the values of each run."""

import re
from dataclasses import dataclass

from cosim.batch.design import Row, crossed, drawn, grid, side_by_side
from cosim.batch.plan import Plan
from cosim.batch.sources import Estimates
from cosim.batch.values import read_distribution, swept_values
from cosim.errors import ModelError, UsageError
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import resolve, settable_names
from cosim.ssp.system import System, Value, Variable

SAMPLES = 200  # draws, where the user does not say


@dataclass(frozen=True)
class Varied:
    """A parameter that differs between runs.

    Attributes:
        name: as the user gave it.
        unit: the FMU's.
        display: (unit people read, factor, offset).
        numeric: its values are numbers.
    """

    name: str
    unit: str
    display: tuple[str, float, float]
    numeric: bool


@dataclass(frozen=True)
class Table:
    """The values of all runs of a model.

    Attributes:
        rows: parameter -> value in the FMU's unit, of each run.
        varied: the parameters in them.
        random: they are draws.
        notes: what the user should know.
    """

    rows: list[Row]
    varied: list[Varied]
    random: bool = False
    notes: tuple[str, ...] = ()


def parameter_table(plan: Plan, estimates: Estimates | None, system: System) -> Table:
    """The values of the runs.

    Args:
        plan: what is asked for.
        estimates: what the plan's file of estimates holds.
        system: the model.

    Raises:
        UsageError: a name, value or combination makes no sense.
        ModelError: a name of the file with estimates is not the model's.
    """
    vary = _to_vary(plan, estimates, system)
    variables = {name: _variable(system, name) for name in (*plan.sweep, *vary)}
    varied = [_varied(name, variable) for name, variable in variables.items()]
    distributions = {name: read_distribution(name, text, variables[name]) for name, text in vary.items()}
    design = plan.design or "grid"
    swept: list[Row] = [{}]
    if design in ("grid", "zip"):
        values = {name: swept_values(name, text, variables[name]) for name, text in plan.sweep.items()}
        for name, column in values.items():
            for value in column:
                _check_bounds(name, value, variables[name])
        swept = side_by_side(values) if design == "zip" and values else grid(values)
    else:
        ranges = {name: _range_of(name, text, design) for name, text in plan.sweep.items()}
        distributions |= {
            name: read_distribution(name, text, variables[name]) for name, text in ranges.items()
        }
    if not distributions:
        if plan.samples:
            raise UsageError(
                "--samples is how many to draw: it needs --vary, --from, or a --design that draws"
            )
        return Table(swept, varied)
    for name, found in distributions.items():
        if found.kind == "uniform":
            for end in (found.low, found.high):
                _check_bounds(name, end, variables[name])
    way = plan.design if plan.design in ("latin_hypercube", "sobol") else "random"
    # what the plan itself varies takes the place of the file's estimate, and of its correlations
    known = estimates.correlations if estimates else {}
    together = {p: r for p, r in known.items() if not {*p} & {*plan.vary, *plan.sweep}}
    rows, notes = drawn(distributions, plan.samples or SAMPLES, way, plan.seed, together)
    return Table(crossed(swept, rows), varied, random=True, notes=tuple(notes))


def _to_vary(plan: Plan, estimates: Estimates | None, system: System) -> dict[str, str]:
    """Parameter -> distribution as text: what the plan says, then what its file of estimates adds."""
    vary = dict(plan.vary)
    for estimate in estimates.uncertain if estimates else ():
        if not resolve(system, estimate.name):
            raise ModelError(
                f"{plan.from_file} has '{estimate.name}', which '{system.name}' does not"
                f"{did_you_mean(estimate.name, settable_names(system))}"
            )
        if estimate.name not in (*vary, *plan.set, *plan.sweep):
            vary[estimate.name] = estimate.text
    ways = ((vary, "vary"), (plan.sweep, "sweep"), (plan.set, "set"))
    for name in (*vary, *plan.sweep):
        said = [way for known, way in ways if name in known]
        if len(said) > 1:
            raise UsageError(f"'{name}' is given twice, by {' and '.join(said)}: keep one")
    return vary


def _range_of(name: str, text: object, design: str) -> str:
    """The range of a sweep whose values are drawn: ``700:900:5 kg.m2`` without its number of values.

    Raises:
        UsageError: it is a list.
    """
    if not isinstance(text, str) or ":" not in text:
        raise UsageError(f"{name}: design '{design}' draws from a range such as '700:900', not from a list")
    return re.sub(r"^([^:]*:[^:]*?)\s*:\s*\d+", r"\1", text)


def _varied(name: str, variable: Variable) -> Varied:
    shown = variable.display_unit or variable.unit or "1", variable.display_factor, variable.display_offset
    return Varied(name, variable.unit or "1", shown, variable.kind in ("Real", "Integer", "Enumeration"))


def _variable(system: System, name: str) -> Variable:
    ports = resolve(system, name)
    if not ports:
        raise UsageError(
            f"'{system.name}' has no '{name}' to vary{did_you_mean(name, settable_names(system))}"
        )
    variable = system.variable(ports[0])
    if not variable.can_be_set:
        raise UsageError(f"'{name}' is a {variable.variability} {variable.causality} and cannot be set")
    return variable


def _check_bounds(name: str, value: Value, variable: Variable) -> None:
    if variable.kind != "String" and not variable.low <= float(value) <= variable.high:
        raise UsageError(
            f"{name} = {value:g} {variable.unit} is not within {variable.low:g} to {variable.high:g} {variable.unit}"
        )
