"""Units: every number inside the program is SI; pint converts what users write.

FMI writes units as ``kg.m2`` or ``N.m.s/rad``; pint wants ``kg*m**2``. `fmi_to_pint` bridges the two spellings, the
rest is pint's.
"""

import re
from functools import cache

import pint

from cosim.errors import UsageError

registry = pint.UnitRegistry()
registry.define("percent = 0.01 = %")

_EXPONENT = re.compile(r"(?<=[A-Za-z])(-?\d+)")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")


def fmi_to_pint(unit: str) -> str:
    """FMI's spelling of a unit in pint's: ``kg.m2`` becomes ``kg*m**2``; ``1`` and the empty text are dimensionless."""
    text = unit.strip()
    if text in ("", "1", "-"):
        return "dimensionless"
    if text == "%":
        return "percent"
    return _EXPONENT.sub(r"**\1", text.replace("\N{DEGREE SIGN}", "deg")).replace(".", "*")


@cache
def parse_unit(unit: str) -> pint.Unit:
    """The pint unit of a text in FMI's or pint's spelling.

    Raises:
        UsageError: the text is not a unit.
    """
    try:
        return registry.Unit(fmi_to_pint(unit))
    except (pint.errors.PintError, ValueError, TypeError, AttributeError) as error:
        raise UsageError(f"'{unit}' is not a unit that can be read: {error}") from None


@cache
def factor(unit: str, target: str) -> float:
    """Factor that turns a number in `unit` into one in `target` (both multiplicative units).

    Raises:
        UsageError: the two have different dimensions.
    """
    source, goal = parse_unit(unit), parse_unit(target)
    if source.dimensionality != goal.dimensionality:
        raise UsageError(f"unit '{unit}' has the wrong dimension: expected one like '{target}'")
    return float((1.0 * source).to(goal).magnitude)


def parse_quantity(text: str, target: str) -> float:
    """A number with or without unit, in `target`: ``parse_quantity("900 kg.m2", "kg.m2") == 900.0``.

    A bare number is taken as already being in `target`.

    Raises:
        UsageError: the text is not a number with a unit of `target`'s dimension.
    """
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise UsageError(f"'{text}' is not a number with a unit, such as '900 {target}'")
    number, unit = match.groups()
    return float(number) * (factor(unit, target) if unit.strip() else 1.0)


def base_exponents(unit: str) -> tuple[dict[str, int], float]:
    """SI base-unit exponents (FMI's names kg, m, s, A, K, mol, cd, rad) and factor of a unit, for an FMI UnitDefinition."""
    quantity = 1.0 * parse_unit(unit)
    exponents: dict[str, int] = {}
    radians = 0
    for name, power in quantity.unit_items():
        if name in ("radian", "degree", "milliradian"):
            radians += int(power)
    base = quantity.to_base_units()
    short = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
             "candela": "cd", "radian": "rad"}  # fmt: skip
    for name, power in base.unit_items():
        exponents[short[name]] = int(power)
    exponents.pop("rad", None)
    if radians:
        exponents["rad"] = radians
    return exponents, float(base.magnitude)
