"""What a user writes about a parameter: values to go through, or a distribution to draw from, with a unit.

Swept: ``700:900:5 kg.m2`` (from, to, how many), or ``700, 800, 900 kg.m2``. Drawn: ``700:900 kg.m2`` (uniform),
``763.9 +- 20 kg.m2`` (half the width of the 95 % interval), ``763.9 [745, 790] kg.m2`` (the 95 % interval).
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.ssp.fmu import parse_value
from cosim.ssp.system import Value, Variable
from cosim.units import parse_quantity

Array = NDArray[np.float64]
Z95 = 1.959963984540054  # half the width of a 95 % interval in standard deviations
MOST_VALUES = 1_000_000

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SPAN = re.compile(rf"\s*({_NUMBER})\s*:\s*({_NUMBER})(?:\s*:\s*(\d+))?(\s+\S.*|[^\W\d].*)?\s*$")
_HALF = re.compile(rf"\s*({_NUMBER})\s*(?:\+-|\+/-|±)\s*({_NUMBER})\s*(.*)$")
_INTERVAL = re.compile(rf"\s*({_NUMBER})\s*\[\s*({_NUMBER})\s*,\s*({_NUMBER})\s*\]\s*(.*)$")
_ITEM = re.compile(rf"\s*{_NUMBER}\s*$")


@dataclass(frozen=True)
class Distribution:
    """What a parameter is drawn from, in the FMU's unit, cut off at the bounds that the FMU declares.

    Attributes:
        kind: "uniform" between `low` and `high`; "normal" with `middle` as median and a 95 % interval from `low` to
            `high`, each side with a standard deviation of its own where they differ.
    """

    kind: str
    low: float
    high: float
    middle: float = 0.0
    least: float = -np.inf
    most: float = np.inf

    def quantile(self, part: Array) -> Array:
        """Values (n,) below which the given parts (n,) between 0 and 1 lie."""
        from scipy.special import ndtri  # a fifth of a second, which a sweep does not need

        if self.kind == "uniform":
            return self.low + part * (self.high - self.low)
        below, above = ((self.middle - self.low) / Z95, (self.high - self.middle) / Z95)
        first, last = (self._part(bound, below, above) for bound in (self.least, self.most))
        inside = np.clip(part, 1e-12, 1.0 - 1e-12)  # the ends of a normal distribution are infinite
        z = ndtri(first + inside * (last - first))
        drawn = self.middle + z * np.where(z < 0.0, below, above)
        return np.clip(drawn, self.least, self.most)

    def _part(self, value: float, below: float, above: float) -> float:
        deviation = below if value < self.middle else above
        if deviation == 0.0 or np.isinf(value):
            return float(value > self.middle) if value != self.middle else 0.5
        from scipy.special import ndtr

        return float(ndtr((value - self.middle) / deviation))


def split_setting(text: str, option: str, example: str) -> tuple[str, str]:
    """``name=rest`` as (name, rest).

    Raises:
        UsageError: there is no name or nothing behind it.
    """
    name, equals, rest = (part.strip() for part in text.partition("="))
    if not equals or not name or not rest:
        raise UsageError(f"{option} '{text}' should read name=..., such as '{example}'")
    return name, rest


def swept_values(name: str, text: "str | list[Any]", variable: Variable) -> list[Value]:
    """The values of a sweep, in the FMU's unit and of its type.

    Raises:
        UsageError: it cannot be read, or has the wrong unit; the message begins with the parameter's name.
    """
    try:
        return _swept([_text(item) for item in text] if isinstance(text, list) else text, variable)
    except (UsageError, ValueError) as error:
        raise UsageError(f"{name}: {error}") from None


def _text(item: Any) -> str:
    return str(item).lower() if isinstance(item, bool) else str(item)


def _swept(text: str | list[str], variable: Variable) -> list[Value]:
    unit = variable.unit or "1"
    if variable.kind != "Real":
        items = text if isinstance(text, list) else text.split(",")
        return [parse_value(variable.kind, item.strip()) for item in items]
    if isinstance(text, list):
        return [parse_quantity(item, unit) for item in text]
    span = _SPAN.match(text)
    if span and span[3]:
        count = int(span[3])
        if not 2 <= count <= MOST_VALUES:
            raise UsageError(f"'{text}': from 2 to {MOST_VALUES} values, not {count}")
        low, high = _with_unit(span[1], span[2], unit=span[4] or "", target=unit)
        return [float(v) for v in np.linspace(low, high, count)]
    if span:
        raise UsageError(f"'{text}' does not say how many values: write {text.strip().split(' ')[0]}:5")
    if ":" in text:
        raise UsageError(f"'{text}' should read from:to:how many, such as '700:900:5 {unit}'")
    items = text.split(",")
    last = re.match(rf"\s*{_NUMBER}\s*(.*)$", items[-1])
    common = last[1] if last else ""
    return [parse_quantity(f"{item} {common}" if _ITEM.match(item) else item, unit) for item in items]


def read_distribution(name: str, text: str, variable: Variable) -> Distribution:
    """What a parameter is to be drawn from.

    Raises:
        UsageError: it cannot be read, has the wrong unit, or its bounds make no sense.
    """
    try:
        return _read(text, variable)
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None


def _read(text: str, variable: Variable) -> Distribution:
    if variable.kind != "Real":
        raise UsageError(
            f"only Real parameters can be drawn, this is of type {variable.kind}: sweep it instead"
        )
    unit, bounds = variable.unit or "1", (variable.low, variable.high)
    if (span := _SPAN.match(text)) and not span[3]:
        low, high = _with_unit(span[1], span[2], unit=span[4] or "", target=unit)
        found = Distribution("uniform", low, high)
    elif half := _HALF.match(text):
        middle, width = _with_unit(half[1], half[2], unit=half[3], target=unit)
        found = Distribution("normal", middle - width, middle + width, middle, *bounds)
    elif interval := _INTERVAL.match(text):
        middle, low, high = _with_unit(*interval.groups()[:3], unit=interval[4], target=unit)
        found = Distribution("normal", low, high, middle, *bounds)
    else:
        raise UsageError(
            f"'{text}' is no distribution: write '700:900 {unit}' (uniform), '763.9 +- 20 {unit}' or "
            f"'763.9 [745, 790] {unit}' (95 % interval)"
        )
    return checked(found, unit)


def checked(found: Distribution, unit: str) -> Distribution:
    """The distribution, if it makes sense.

    Raises:
        UsageError: its bounds are in the wrong order, or outside of what the FMU allows.
    """
    middle = found.middle if found.kind == "normal" else found.low
    if not found.low <= middle <= found.high or found.low == found.high:
        raise UsageError(
            f"the interval from {found.low:g} to {found.high:g} {unit} is empty or does not hold {middle:g} {unit}"
        )
    if found.kind == "normal" and not found.least <= middle <= found.most:
        raise UsageError(f"{middle:g} {unit} is not within {found.least:g} to {found.most:g} {unit}")
    return found


def _with_unit(*numbers: str, unit: str, target: str) -> list[float]:
    return [parse_quantity(f"{number} {unit}", target) for number in numbers]
