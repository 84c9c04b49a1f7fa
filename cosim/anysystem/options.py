"""What a mapping says of any system: connectors, trusted and free parameters.

[diagnose]
trusted = ["valve.K", "plant.T"]     # or a table: trusted = { "valve.K" = "2 %" }
free = ["plant.friction"]
exclude = ["port.gain"]
constant = { "valve.supply" = 2e7 }  # inputs that are not measured, and parameters: their value, in the unit of the FMU
"""

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator

from cosim.errors import DataError, UsageError
from cosim.ssp.system import Value
from cosim.system.effects import EFFECTS
from cosim.tables import checked
from cosim.units import parse_quantity

TABLE = "diagnose"


class AnyOptions(BaseModel):
    """The table ``[diagnose]`` of a mapping for any system.

    Attributes:
        trusted: ``component.parameter`` -> relative standard deviation, or None for the tolerance of the command line.
        free: parameters that are fitted freely with every cause.
        exclude: effects that are no candidates.
        constant: inputs that are not measured, and parameters -> their value all along, in the unit of the FMU.
        start: parameters that are an initial value -> the signal whose first reading they take in each log; the mapping
            has them in ``[compare.start]``.
        causes: causes looked for in one group at most.
        sample: what one sample counts as, s, where the log counts samples.
        given: ``component.variable`` -> what `constant` comes to there; no key of the file.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    trusted: dict[str, float | None] = {}
    free: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    constant: dict[str, float] = {}
    start: dict[str, str] = {}
    causes: Annotated[int, Field(ge=1, le=3)] = 3
    sample: float | None = None
    given: dict[str, Value] = Field(default={}, exclude=True)

    @field_validator("trusted", mode="before")
    @classmethod
    def _trusted(cls, value: object) -> object:
        if isinstance(value, (list, tuple)):
            return dict.fromkeys(map(str, value))
        if not isinstance(value, dict):
            raise ValueError('write a list of parameters, or a table such as { "valve.K" = "2 %" }')
        return {str(n): None if tolerance is None else _share(tolerance) for n, tolerance in value.items()}

    @field_validator("constant")
    @classmethod
    def _finite(cls, values: dict[str, float]) -> dict[str, float]:
        for name, value in values.items():
            if not math.isfinite(value):
                raise ValueError(f"'{name}' = {value}: write a finite number")
        return values

    @field_validator("sample", mode="before")
    @classmethod
    def _time(cls, value: object) -> float:
        if not isinstance(value, str):
            raise ValueError('write a time with its unit, such as "1 ms"')
        try:
            found = parse_quantity(value, "s")
        except UsageError as error:
            raise ValueError(str(error)) from None
        if not found > 0.0:
            raise ValueError("a time must be positive")
        return found

    @field_validator("exclude")
    @classmethod
    def _known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in EFFECTS:
                raise ValueError(f"no effect '{name}'; known: {', '.join(EFFECTS)}")
        return names


def _share(value: object) -> float:
    """A tolerance: 0.02 or "2 %"."""
    try:
        found = parse_quantity(value, "1") if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except (UsageError, TypeError, ValueError):
        raise ValueError(f"{value!r} is no tolerance: write 0.02 or '2 %'") from None
    if not 0.0 < found < 10.0:
        raise ValueError(f"a tolerance of {value!r} makes no sense: write a positive share such as '2 %'")
    return found


def options_of(content: dict[str, Any], source: object) -> AnyOptions:
    """The table, checked.

    Raises:
        DataError: a key or value is wrong; the message names it.
    """
    if "given" in content:
        raise DataError(f"{source}: '{TABLE}.given' is no key of a mapping: leave it out")
    return checked(AnyOptions, content, TABLE, "a mapping for any system", source)
