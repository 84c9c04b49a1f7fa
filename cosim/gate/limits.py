"""The file of a check (TOML): reference logs, and the largest error that each signal and block may have.

margin = "10 %"

[[reference]]
log = "rest.csv"                 # relative to this file
model = "full_order"
[reference.signals]              # the model driven by the command alone
slew = { limit = "0.19 deg", was = "0.173 deg" }
[reference.blocks."mechanical + sensor"]   # driven by what was measured
slew = "0.2 deg"                 # written by hand
"""

import json
import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from cosim.errors import DataError, UsageError
from cosim.files import write_text

HEAD = """\
# Largest errors (root mean square) that a model may have on reference logs: `cosim check` holds it against them.
# `was` is the error when the file was written. Measured again by `cosim check FILE --update`; lines may be edited.
"""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Limit(_Strict):
    """The largest error of a signal.

    Attributes:
        limit: with its unit, such as ``0.19 deg``.
        was: the error when the limit was set, with its unit; None where it was set by hand.
    """

    limit: str
    was: str | None = None


Limits = dict[str, Limit]


class Reference(_Strict):
    """A log, and what a model may get wrong of it.

    Attributes:
        log: file, relative to the file of the check.
        model: name or file, relative to it as well; None for the mapping's, or full_order.
        mapping: mapping file of the log.
        signals: signal -> limit, the model driven by the command alone.
        blocks: block -> signal -> limit, each driven by what was measured.
        causes: what a diagnosis named when the limits were set, or None where none was run.
    """

    log: str
    model: str | None = None
    mapping: str | None = None
    causes: list[str] | None = None
    signals: Limits = {}
    blocks: dict[str, Limits] = {}

    @field_validator("signals", mode="before")
    @classmethod
    def _signals(cls, given: object) -> object:
        return _spelled_out(given)

    @field_validator("blocks", mode="before")
    @classmethod
    def _blocks(cls, given: object) -> object:
        return (
            {name: _spelled_out(item) for name, item in given.items()} if isinstance(given, dict) else given
        )


def _spelled_out(given: object) -> object:
    """``slew = "0.2 deg"`` as a limit."""
    if not isinstance(given, dict):
        return given
    return {name: {"limit": item} if isinstance(item, str) else item for name, item in given.items()}


class Check(_Strict):
    """The file.

    Attributes:
        margin: above the error found, at which a limit is set, in per cent.
        reference: the logs.
    """

    margin: Annotated[str, Field(pattern=r"^\d+(\.\d+)? ?%$")] = "10 %"
    reference: list[Reference] = []

    @property
    def factor(self) -> float:
        """Of a limit over the error found."""
        return 1.0 + float(self.margin.rstrip("% ")) / 100.0


def read_check(path: Path) -> Check:
    """Read the file.

    Raises:
        UsageError: there is no such file.
        DataError: it is no such file; the message names the entry.
    """
    if not path.is_file():
        raise UsageError(f"there is no '{path}': write it with `cosim check {path} --add LOG`")
    try:
        return Check.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DataError(f"{path} is no TOML file: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise DataError(f"{path}: {where}: {first['msg']}") from None


def write_check(path: Path, check: Check) -> Path:
    """Write the file.

    Raises:
        OSError: it cannot be written.
    """
    lines = [HEAD, f"margin = {_text(check.margin)}"]
    for item in check.reference:
        lines += ["", "[[reference]]", f"log = {_text(item.log)}"]
        lines += [f"{k} = {_text(v)}" for k in ("model", "mapping") if (v := getattr(item, k)) is not None]
        if item.causes is not None:
            lines.append(f"causes = [{', '.join(map(_text, item.causes))}]")
        tables = {"reference.signals": item.signals}
        tables |= {f"reference.blocks.{_text(name)}": limits for name, limits in item.blocks.items()}
        for name, limits in tables.items():
            lines += [f"[{name}]", *(f"{_text(signal)} = {_limit(one)}" for signal, one in limits.items())]
    return write_text(path, "\n".join(lines) + "\n")


def _limit(one: Limit) -> str:
    if one.was is None:
        return _text(one.limit)
    return f"{{ limit = {_text(one.limit)}, was = {_text(one.was)} }}"


def _text(text: str) -> str:
    """A basic string of TOML, whose escapes are those of JSON; DEL is the one character only TOML escapes."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
