"""What stands where in a datagram: a small TOML file, by default as docs/live.md has it."""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from cosim.errors import DataError, UsageError
from cosim.logs.source import parse_label
from cosim.signals import LOG_SIGNALS, SIGNALS, SYNTHETIC_COLUMN, check_spelling, conversion
from cosim.ssp.hints import did_you_mean

SENSORS = tuple(n for n in LOG_SIGNALS if n not in ("u", "slew_estimate", "slew_rate_estimate"))
"""What the crane may send of a log's signals."""
COMMANDS = ("u1", "u2", "u3", "enable1", "enable2", "enable3")
FROM_CRANE = ("slew [deg]", "p_supply [bar]", "p_a [bar]", "p_b [bar]", "spool [mm]", "aux_1", "aux_2")


class Layout(BaseModel):
    """Order and byte order of both datagrams.

    Attributes:
        byte_order: of every float32.
        from_crane: the 7 values that come, ``name [unit]``. A name that is no signal of a log is recorded if it has a unit
            and ignored otherwise.
        to_crane: the 6 values that go, a permutation of `COMMANDS`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    byte_order: Literal["little", "big"] = "little"
    from_crane: Annotated[tuple[str, ...], Field(min_length=7, max_length=7)] = FROM_CRANE
    to_crane: Annotated[tuple[str, ...], Field(min_length=6, max_length=6)] = COMMANDS

    @field_validator("from_crane")
    @classmethod
    def _sensors(cls, texts: tuple[str, ...]) -> tuple[str, ...]:
        labels = [parse_label(text) for text in texts]
        names = [label.name for label in labels]
        for name, unit in ((label.name, label.unit) for label in labels):
            taken = (name in SIGNALS and name not in SENSORS) or name == SYNTHETIC_COLUMN
            if not name.isidentifier() or taken:
                raise ValueError(f"'{name}' cannot come from the crane{did_you_mean(name, SENSORS)}")
            if names.count(name) > 1:
                raise ValueError(f"'{name}' stands there twice")
            if name in SENSORS and unit is None:
                raise ValueError(f"'{name}' has no unit: write '{name} [{SIGNALS[name].unit}]'")
            try:
                if name in SENSORS:
                    conversion(unit or "", SIGNALS[name].si)
                elif unit is not None:
                    check_spelling(unit)
            except UsageError as error:
                raise ValueError(f"'{name}': {error}") from None
        if "slew" not in names:
            raise ValueError("'slew' is not among them; the observer and the controller need it")
        return texts

    @field_validator("to_crane")
    @classmethod
    def _commands(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if sorted(names) != sorted(COMMANDS):
            raise ValueError(f"each of {', '.join(COMMANDS)} must stand there once")
        return names


def load_layout(path: Path | None) -> Layout:
    """The layout in a TOML file, or the default one.

    Raises:
        DataError: the file is missing, is no TOML, or a key or value in it is wrong; the message names the key.
    """
    if path is None:
        return Layout()
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        return Layout.model_validate(content)
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(
            f"{path}: the layout cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{path}: the layout is not valid TOML: {error}") from None
    except ValidationError as error:
        raise DataError(f"{path}: " + "; ".join(_explained(item) for item in error.errors())) from None


def _explained(item: object) -> str:
    """One pydantic error as a sentence with its key."""
    assert isinstance(item, dict)
    key = ".".join(str(part) for part in item["loc"] if isinstance(part, str))
    if item["type"] == "extra_forbidden":
        return f"'{key}' is not a key of a layout{did_you_mean(key, list(Layout.model_fields))}"
    if item["type"] in ("too_short", "too_long"):
        bounds = item["ctx"]
        wanted = bounds.get("min_length") or bounds.get("max_length")
        return f"'{key}' has {bounds['actual_length']} values, a datagram has {wanted}"
    return f"'{key}': {str(item['msg']).removeprefix('Value error, ')}"
