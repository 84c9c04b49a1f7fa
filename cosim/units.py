"""Units: every number inside the program is SI; pint converts what users write.

FMI writes units as ``kg.m2`` or ``N.m.s/rad``; pint wants ``kg*m**2``. `fmi_to_pint` bridges the two spellings, the
rest is pint's.
"""

import re
import shutil
from functools import cache
from tokenize import TokenError
from typing import TYPE_CHECKING, Any

from cosim.errors import UsageError
from cosim.paths import cache_folder

if TYPE_CHECKING:
    import pint

_LONGEST = 100
_EXPONENT = re.compile(r"(?<=[A-Za-z])(-?\d+)")
# names with whole exponents, products, quotients and brackets; pint would compute any expression, 9**9**9 too
_POWER = r"\s*(?:\*\*|\^)"
_UNIT = re.compile(
    rf"(?:(?:[^\W\d]\w*|\))(?:{_POWER}\s*[-+]?\d{{1,2}}(?!\w|{_POWER}))?|/(?!/)|[*(\s]|1(?!\w))*"
)
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
_BASE_NAMES = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
               "candela": "cd", "radian": "rad"}  # fmt: skip

# what people write and pint would read as a gigaradian, a number of metres, an enzyme's activity
WRITTEN = {"Grad": "deg", "Grad/s": "deg/s", "Nm": "N.m", "kNm": "kN.m", "U/min": "rpm"}


@cache
def registry() -> "pint.UnitRegistry[Any]":
    """Pint's units and ours; made when the first unit is read, because a process that only runs models reads none."""
    import pint

    made: pint.UnitRegistry[Any] | None = None
    kept = cache_folder() / "units"
    for _ in range(2):
        try:  # to read the definitions takes a quarter of a second, to load what was read of them a hundredth
            made = pint.UnitRegistry(cache_folder=kept)
            break
        except Exception:
            # damaged, half written, not to be written to, or of a Python environment that is gone
            shutil.rmtree(kept, ignore_errors=True)
    if made is None:
        made = pint.UnitRegistry()
    made.define("percent = 0.01 = %")
    made.define("@alias turn = rev")
    return made


def fmi_to_pint(unit: str) -> str:
    """FMI's spelling of a unit in pint's: ``kg.m2`` becomes ``kg*m**2``; ``1`` and the empty text are dimensionless."""
    text = WRITTEN.get(unit.strip(), unit.strip())
    if text in ("", "1", "-"):
        return "dimensionless"
    text = (
        re.sub(r"(?<!\w)%(?!\w)", "percent", text)
        .replace("\N{DEGREE SIGN}", "deg")
        .replace("\N{MIDDLE DOT}", ".")
    )
    return _EXPONENT.sub(r"**\1", text).replace(".", "*")


@cache
def parse_unit(unit: str) -> "pint.Unit":
    """The pint unit of a text in FMI's or pint's spelling.

    Raises:
        UsageError: the text is not a unit.
    """
    text = fmi_to_pint(unit)
    if len(text) > _LONGEST or not _UNIT.fullmatch(text):
        shown = unit if len(unit) <= _LONGEST else f"{unit[:_LONGEST]}..."
        raise UsageError(
            f"{shown!r} is not a unit that can be read: write names with whole exponents, such as 'kg.m2' or 'N.m.s/rad'"
        )
    from pint.errors import PintError

    try:
        return registry().Unit(text)
    # what pint's parser lets through of Python's own tokenizer, of `assert` and of arithmetic
    except (PintError, TokenError, SyntaxError, AssertionError, ArithmeticError, ValueError, TypeError,
            AttributeError, KeyError) as error:  # fmt: skip
        reason = f": {error}" if isinstance(error, PintError) else ""
        raise UsageError(f"'{unit}' is not a unit that can be read{reason}") from None


def base_factor(unit: str) -> float:
    """Factor that turns a number in `unit` into one in SI base units.

    Raises:
        UsageError: the text is not a unit, or a number in it is no plain multiple (degC, dB).
    """
    from pint.errors import PintError

    parsed = parse_unit(unit)
    try:
        zero, one = (float(registry().Quantity(x, parsed).to_base_units().magnitude) for x in (0.0, 1.0))
    except (PintError, ArithmeticError):
        zero, one = 1.0, 1.0
    if zero != 0.0:
        raise UsageError(f"unit '{unit}' has an offset or is logarithmic: give one that is a plain multiple")
    if not 0.0 < one < float("inf"):
        raise UsageError(f"unit '{unit}' is beyond the range of numbers")
    return one


@cache
def own_zero(unit: str) -> tuple[float, float] | None:
    """Factor and offset to the SI unit, SI = factor * value + offset, of one with a zero of its own (degC); else None.

    Raises:
        UsageError: the text is not a unit.
    """
    from pint.errors import PintError

    parsed = parse_unit(unit)
    try:
        zero, one, ten = (
            float(registry().Quantity(x, parsed).to_base_units().magnitude) for x in (0.0, 1.0, 10.0)
        )
    except (PintError, ArithmeticError):
        return None
    straight = abs(ten - zero - 10.0 * (one - zero)) <= 1e-9 * abs(ten)
    return (one - zero, zero) if zero != 0.0 and straight else None


@cache
def factor(unit: str, target: str) -> float:
    """Factor that turns a number in `unit` into one in `target`; 1 for a unit and itself, degC and dB too.

    Raises:
        UsageError: the two have different dimensions, or one of them is no plain multiple (degC, dB).
    """
    source, goal = parse_unit(unit), parse_unit(target)
    if unit == target:
        return 1.0
    if source.dimensionality != goal.dimensionality:
        raise UsageError(f"unit '{unit}' has the wrong dimension: expected one like '{target}'")
    base_factor(unit), base_factor(target)
    return float(registry().Quantity(1.0, source).to(goal).magnitude)


def number_and_unit(text: str, like: str = "kg.m2") -> tuple[float, str]:
    """A number and the unit behind it, empty for none: ``number_and_unit("900 kg.m2") == (900.0, "kg.m2")``.

    Raises:
        UsageError: the text is no number with something behind it; `like` is the unit of the example given.
    """
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise UsageError(f"'{text}' is not a number with a unit, such as '900 {like}'")
    number, unit = match.groups()
    if abs(float(number)) == float("inf"):
        raise UsageError(f"'{text}' is beyond the range of numbers")
    return float(number), unit


def parse_quantity(text: str, target: str) -> float:
    """A number with or without unit, in `target`: ``parse_quantity("900 kg.m2", "kg.m2") == 900.0``.

    A bare number is taken as already being in `target`.

    Raises:
        UsageError: the text is not a number with a unit of `target`'s dimension.
    """
    number, unit = number_and_unit(text, target)
    return number * (factor(unit, target) if unit.strip() else 1.0)


def base_exponents(unit: str) -> tuple[dict[str, int], float]:
    """SI base-unit exponents (FMI's names kg, m, s, A, K, mol, cd, rad) and factor of a unit, for an FMI UnitDefinition.

    Raises:
        UsageError: the text is not a unit, is no plain multiple (degC, dB), or has a dimension that FMI does not know.
    """
    scale = base_factor(unit)
    exponents: dict[str, int] = {}
    for name, power in registry().Quantity(1.0, parse_unit(unit)).to_base_units().unit_items():
        whole = round(float(power))  # type: ignore[arg-type]  # pint allows complex powers, units have none
        if name not in _BASE_NAMES or power != whole:
            raise UsageError(
                f"unit '{unit}' cannot be written in FMI's base units: it contains {name}**{power}"
            )
        exponents[_BASE_NAMES[name]] = whole
    return exponents, scale


def same_kind(one: str, other: str) -> bool:
    """True if one unit can be converted into another.

    Raises:
        UsageError: one of them is not a unit.
    """
    return bool(parse_unit(one).dimensionality == parse_unit(other).dimensionality)


def is_speed(unit: str) -> bool:
    """True if a signal of this unit is a speed, of an angle, a length or a volume (a flow)."""
    return any(same_kind(unit, s) for s in ("rad/s", "m/s", "m3/s"))


def of_speed(unit: str) -> str:
    """The unit of the speed of a place that is told in a unit; of a speed its own."""
    return unit if is_speed(unit) else f"{unit}/s"
