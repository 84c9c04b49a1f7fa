"""What is free in a calibration: names, bounds, priors, as texts of the command line or of a mapping file.

mechanical.J                        within the bounds that its FMU declares
dcv.K=2:3 mm                        within these
mechanical.b=26e3+-500 N.m.s/rad    prior: mean and standard deviation
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cosim.compare.binding import TRUSTED
from cosim.errors import UsageError
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import resolve, settable_names
from cosim.ssp.system import System, Variable
from cosim.units import parse_quantity

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})?\s*:\s*({_NUMBER})?\s*(.*)")
_PRIOR = re.compile(rf"\s*({_NUMBER})\s*(?:\+-|\+/-|±)\s*({_NUMBER})\s*(.*)")
REACH = 3.0  # a start is drawn between a third and three times the first where no bounds are given


@dataclass(frozen=True)
class Free:
    """A parameter to be fitted; numbers in the FMU's unit.

    Attributes:
        name: as the user wrote it: ``component.variable``, or a parameter connector of the system.
        unit: the FMU's; empty where it declares none.
        start: value at which the search begins.
        low, high: bounds.
        given: the user gave both bounds.
        prior: (mean, standard deviation), or None.
        display: unit in which people read it and factor to it, where one is declared.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    given: bool = False
    prior: tuple[float, float] | None = None
    display: tuple[str, float] | None = None

    @property
    def size(self) -> float:
        """Size of a change that counts: the value itself, or half the range or the prior where that is less."""
        sizes = [abs(self.start)] if self.start != 0.0 else []
        if self.given:
            sizes.append(0.5 * (self.high - self.low))
        if self.prior is not None and not sizes:
            sizes.append(self.prior[1])
        return min(sizes)

    @property
    def reach(self) -> tuple[float, float]:
        """Range from which further starts are drawn."""
        if self.given:
            return self.low, self.high
        if self.start == 0.0:
            around = (-REACH * self.size, REACH * self.size)
        else:
            around = (
                min(self.start / REACH, self.start * REACH),
                max(self.start / REACH, self.start * REACH),
            )
        return max(self.low, around[0]), min(self.high, around[1])


def read_free(
    system: System,
    texts: Sequence[str],
    priors: Sequence[str] = (),
    values: Mapping[str, object] | None = None,
) -> list[Free]:
    """The free parameters that texts name.

    Args:
        system: the model.
        texts: such as ``dcv.K=2:3 mm``; where there are none, those of `TRUSTED` that the model has.
        priors: such as ``dcv.K=2.4+-0.1 mm``; each names a free parameter.
        values: ``component.variable`` -> value that replaces the model's own as the start.

    Raises:
        UsageError: a text cannot be read, or names something that does not exist or cannot be fitted; bounds are empty or
            leave out the start; nothing is named and the model has none of `TRUSTED`.
    """
    if not texts:
        texts = [name for name in TRUSTED if resolve(system, name)]
    if not texts:
        raise UsageError(f"nothing is free: name parameters with --free, such as {_examples(system)}")
    found: dict[str, Free] = {}
    for text in texts:
        name, equals, rest = (part.strip() for part in text.partition("="))
        if not name or (equals and not rest):
            raise UsageError(
                f"--free '{text}' should read name or name=low:high unit, such as 'dcv.K=2:3 mm'"
            )
        if name in found:
            raise UsageError(f"--free names '{name}' twice")
        found[name] = _free(system, name, rest, values or {})
    for text in priors:
        name, item = _with_prior(text, found)
        found[name] = item
    for item in found.values():
        _check_size(item)
    _check_overlap(system, found)
    return list(found.values())


def _examples(system: System) -> str:
    names = [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if v.causality == "parameter" and v.kind == "Real" and v.variability != "constant"
    ]
    return ", ".join(names[:6]) or "(this model has no Real parameters)"


def _free(system: System, name: str, rest: str, values: Mapping[str, object]) -> Free:
    ports = resolve(system, name)
    if not ports:
        raise UsageError(f"--free: there is no '{name}'{did_you_mean(name, settable_names(system))}")
    variable = system.variable(ports[0])
    _check_kind(name, variable)
    component = system.components[ports[0].component]
    given = values.get(name, values.get(str(ports[0])))
    start = given if given is not None else component.starts.get(ports[0].variable, variable.start)
    if start is None:
        raise UsageError(f"--free {name}: its FMU declares no start value: give one with --set '{name}=...'")
    value = float(start)  # type: ignore[arg-type]  # a Real
    low, high = variable.low, variable.high
    display = (variable.display_unit, variable.display_factor) if variable.display_unit else None
    if rest and _PRIOR.fullmatch(rest):
        prior = _prior(f"--free {name}", rest, variable.unit)
        return Free(name, variable.unit, value, low, high, prior=prior, display=display)
    if rest:
        low, high = _bounds(name, rest, variable)
    if not low <= value <= high:
        if given is not None or not rest:
            raise UsageError(
                f"--free {name}: its start value {value:.6g} {variable.unit} is outside {low:.6g} to {high:.6g}"
            )
        value = min(max(value, low), high)
    return Free(
        name, variable.unit, value, low, high, bool(rest) and math.isfinite(high - low), display=display
    )


def _check_kind(name: str, variable: Variable) -> None:
    if variable.kind != "Real":
        raise UsageError(f"--free: '{name}' is of type {variable.kind}: only Real parameters can be fitted")
    if variable.causality != "parameter" or not variable.can_be_set:
        raise UsageError(
            f"--free: '{name}' is a {variable.variability} {variable.causality}, not a parameter that can be set"
        )


def _bounds(name: str, text: str, variable: Variable) -> tuple[float, float]:
    match = _RANGE.fullmatch(text)
    if match is None or not (match[1] or match[2]):
        raise UsageError(
            f"--free {name}: '{text}' should read low:high unit, such as '2:3 mm', or mean+-sd unit"
        )
    try:
        ends = [
            parse_quantity(f"{part} {match[3]}", variable.unit or "1") if part else None
            for part in (match[1], match[2])
        ]
    except UsageError as error:
        raise UsageError(f"--free {name}: {error}") from None
    low = variable.low if ends[0] is None else ends[0]
    high = variable.high if ends[1] is None else ends[1]
    if not low < high:
        raise UsageError(f"--free {name}: the bounds {text} are empty: the lower comes first")
    if low < variable.low or high > variable.high:
        raise UsageError(
            f"--free {name}: {low:.6g} to {high:.6g} {variable.unit} goes beyond what its FMU allows, "
            f"{variable.low:.6g} to {variable.high:.6g}"
        )
    return low, high


def _prior(what: str, text: str, unit: str) -> tuple[float, float]:
    match = _PRIOR.fullmatch(text)
    if match is None:
        raise UsageError(f"{what}: '{text}' should read mean+-deviation unit, such as '2.4+-0.1 mm'")
    try:
        mean, deviation = (parse_quantity(f"{match[k]} {match[3]}", unit or "1") for k in (1, 2))
    except UsageError as error:
        raise UsageError(f"{what}: {error}") from None
    if not deviation > 0.0:
        raise UsageError(f"{what}: the standard deviation must be above 0; to fix a parameter use --set")
    return mean, deviation


def _with_prior(text: str, found: Mapping[str, Free]) -> tuple[str, Free]:
    from dataclasses import replace

    name, equals, rest = (part.strip() for part in text.partition("="))
    if not equals or not rest:
        raise UsageError(
            f"--prior '{text}' should read name=mean+-deviation unit, such as 'dcv.K=2.4+-0.1 mm'"
        )
    if name not in found:
        raise UsageError(f"--prior: '{name}' is not free{did_you_mean(name, found)}: add --free {name}")
    return name, replace(found[name], prior=_prior(f"--prior {name}", rest, found[name].unit))


def _check_size(item: Free) -> None:
    if item.start == 0.0 and not item.given and item.prior is None:
        raise UsageError(
            f"--free {item.name}: it starts at 0, so its size is not known: give bounds, such as "
            f"'{item.name}={max(item.low, -1.0):g}:1 {item.unit}', or a prior"
        )


def _check_overlap(system: System, found: Mapping[str, Free]) -> None:
    """Two names for one variable would fight over it."""
    owners: dict[str, str] = {}
    for name in found:
        for port in resolve(system, name):
            other = owners.setdefault(str(port), name)
            if other != name:
                raise UsageError(f"--free: '{other}' and '{name}' both set {port}: free one of them")
