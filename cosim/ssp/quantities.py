"""Units of foreign files: two units agree when their definitions do, whatever they are called."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

from lxml import etree

from cosim.errors import ModelError, UsageError
from cosim.ssp.xml import number
from cosim.units import base_exponents, own_zero, same_kind

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
ANGLE = 7  # place of the radian among them: exporters disagree whether it is one
ROUNDED = 0.01  # a unit is rounded, or of another country, by less: calories differ by 0.07 %


@dataclass(frozen=True)
class UnitDefinition:
    """A unit by its SI exponents: SI value = factor * value + offset (FMI 2.0, section 2.2.2).

    Attributes:
        exponents: powers of BASE_UNITS, shape (8,).
    """

    name: str
    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0

    def agrees_with(self, other: "UnitDefinition") -> bool:
        """Whether numbers in both units mean the same."""
        return (
            self.exponents == other.exponents
            and abs(self.factor - other.factor) <= 1e-12 * abs(self.factor)
            and abs(self.offset - other.offset) <= 1e-9
        )


def from_xml(parent: etree._Element, where: str) -> dict[str, UnitDefinition]:
    """Unit definitions below ``Units`` (SSP) or ``UnitDefinitions`` (FMI), whatever the namespace; `where` is for messages.

    Raises:
        ModelError: a power is no whole number, or a factor or offset no finite one, or a factor 0.
    """
    found = {}
    for unit in parent.iterfind("{*}Unit"):
        name = unit.get("name", "")
        for display in unit.iterfind("{*}DisplayUnit"):
            _scale(display, f"{where}: the display unit '{display.get('name', '')}' of the unit '{name}'")
        base = unit.find("{*}BaseUnit")
        if base is None:
            continue
        what = f"{where}: the unit '{name}'"
        powers = tuple(_power(base, symbol, what) for symbol in BASE_UNITS)
        found[name] = UnitDefinition(name, powers, *_scale(base, what))
    return found


def _power(base: etree._Element, symbol: str, what: str) -> int:
    try:
        return int(base.get(symbol, "0"))
    except ValueError:
        raise ModelError(f"{what}: {symbol}='{base.get(symbol)}' is no whole number: correct it") from None


def _scale(element: etree._Element, what: str) -> tuple[float, float]:
    """Factor and offset of a unit."""
    factor, offset = number(element, "factor", what, 1.0), number(element, "offset", what, 0.0)
    if not factor:
        raise ModelError(f"{what}: factor='{element.get('factor')}' makes every number 0: correct it")
    return factor, offset or 0.0


def definition(name: str, known: Mapping[str, UnitDefinition]) -> UnitDefinition | None:
    """Definition of a unit: the file's own, else what the name means by itself, else None."""
    if name in known:
        return known[name]
    try:
        exponents, scale = base_exponents(name)
    except (UsageError, KeyError):
        return _with_own_zero(name)
    return UnitDefinition(name, tuple(exponents.get(base, 0) for base in BASE_UNITS), scale)


def _with_own_zero(name: str) -> UnitDefinition | None:
    """Definition of a temperature in degC or degF; None of anything else."""
    with suppress(UsageError):
        if (found := own_zero(name)) is not None and same_kind(name, "K"):
            kelvin = tuple(int(base == "K") for base in BASE_UNITS)
            return UnitDefinition(name, kelvin, *found)
    return None


def contradiction(unit: str, known: Mapping[str, UnitDefinition]) -> str:
    """How what the file says of a unit differs from what its name means, by more than rounding; empty where it does not."""
    own, named = known.get(unit), definition(unit, {})
    if own is None or named is None or own.exponents != named.exponents or own.offset:
        return ""
    if abs(own.factor / named.factor - 1.0) <= ROUNDED:
        return ""
    return f"the unit '{unit}' is defined as {own.factor:.6g} of the SI unit, but by its name it is {named.factor:.6g}"


def misshown(unit: str, display: str, factor: float, known: Mapping[str, UnitDefinition]) -> bool:
    """Whether a display unit (shown = factor * value) contradicts its name by more than rounding.

    Some exporters write the inverse of the factor: degree as 0.01745 of a radian, where FMI has 57.3 of them shown.
    """
    own, named = definition(unit, known), definition(display, {})
    if own is None or named is None or own.exponents != named.exponents or own.offset:
        return False
    return abs(factor * named.factor / own.factor - 1.0) > ROUNDED


def of_reading(
    label: str, si: str, unit: str, known: Mapping[str, UnitDefinition]
) -> tuple[float, float] | None:
    """Factor and offset from a log's SI number to the number of an FMU's variable; None where the dimensions differ.

    Where log and FMU call their unit alike they mean the same, whatever the FMU says of that unit.

    Args:
        label: unit that the log names.
        si: the SI unit that its numbers were brought to.
        unit: the variable's; empty where it has none.
        known: units that the FMU defines.
    """
    if not unit or si == unit:
        return 1.0, 0.0
    one = definition(si, {})
    other = (definition(label, {}) if label == unit else None) or definition(unit, known)
    if one is None or other is None or _dimension(one) != _dimension(other):
        return None
    return one.factor / other.factor, (one.offset - other.offset) / other.factor


def _dimension(unit: UnitDefinition) -> tuple[int, ...]:
    return tuple(e for k, e in enumerate(unit.exponents) if k != ANGLE)


def agree(
    first: str,
    first_known: Mapping[str, UnitDefinition],
    second: str,
    second_known: Mapping[str, UnitDefinition],
) -> bool:
    """Whether two units mean the same; a side that declares none agrees with everything."""
    if not first or not second:
        return True
    one, two = definition(first, first_known), definition(second, second_known)
    if one is None or two is None:
        return first == second
    return one.agrees_with(two)


def convert(
    value: float,
    unit: str,
    known: Mapping[str, UnitDefinition],
    target: str,
    target_known: Mapping[str, UnitDefinition],
) -> float:
    """A number in `unit` as one in `target`; unchanged where either is not declared.

    Raises:
        ModelError: the units have different dimensions, or one is unknown.
    """
    if agree(unit, known, target, target_known):
        return value
    one, two = definition(unit, known), definition(target, target_known)
    if one is None or two is None or one.exponents != two.exponents:
        raise ModelError(f"unit '{unit}' cannot be converted to '{target}'")
    return (one.factor * value + one.offset - two.offset) / two.factor
