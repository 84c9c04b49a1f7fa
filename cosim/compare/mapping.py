"""The table ``[compare]`` of a mapping file: which variable of the model a signal stands for.

[compare]
parameters = ["axis.ssv"]

[compare.signals.position]
variable = "mechanical.theta"
factor = "1 rad/m"

[compare.start]
"mechanical.theta_0" = "position"

[compare.units]
"axis.p_up" = "bar"

[compare.calibrate]
free = ["mechanical.J", "mechanical.b=0:500 N.m.s/rad"]
"""

import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from cosim.errors import DataError
from cosim.logs.mapping import Mapping
from cosim.logs.mapping import load_mapping as load_plain

TABLE, CONSTANT = "compare", "constant"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Target(_Strict):
    """What a signal stands for.

    Attributes:
        variable: ``component.variable``, or a connector of the system.
        factor: the variable per signal, a number with a unit such as ``1 Pa/N``; by default the unit is converted.
    """

    variable: Annotated[str, Field(min_length=1)]
    factor: str | None = None


class CalibrateTable(_Strict):
    """The table ``[compare.calibrate]``: what `cosim compare --calibrate` frees unless the command line says otherwise.

    Attributes:
        free: texts as of --free, such as ``mechanical.J`` or ``dcv.K=2:3 mm``.
        prior: texts as of --prior, such as ``dcv.K=2.4+-0.1 mm``.
        fit_to: signals as of --fit-to.
    """

    free: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()
    fit_to: tuple[str, ...] = ()


class CompareTable(_Strict):
    """The table ``[compare]``.

    Attributes:
        parameters: .ssv files to apply, relative to the mapping file.
        signals: signal -> variable of the model, before the names that are known anyway.
        start: ``component.parameter`` -> the signal whose first value it takes.
        units: ``component.variable`` -> the unit in which its FMU counts, where that states none.
        calibrate: what a calibration frees.
        folder: where the mapping file lies.
        constant: what ``[diagnose]`` says of parameters and of inputs that were not measured; no key of this table.
        notes: what to say of the file; no key of it.
        aside: signal that stands for nothing in the model although its name is known -> why; no key of the file.
    """

    parameters: tuple[str, ...] = ()
    signals: dict[str, Target] = {}
    start: dict[str, str] = {}
    units: dict[str, str] = {}
    calibrate: CalibrateTable = CalibrateTable()
    folder: Path = Field(default=Path(), exclude=True)
    constant: dict[str, FiniteFloat] = Field(default={}, exclude=True)
    notes: tuple[str, ...] = Field(default=(), exclude=True)
    aside: dict[str, str] = Field(default={}, exclude=True)

    @property
    def parameter_files(self) -> tuple[Path, ...]:
        """The .ssv files."""
        return tuple(self.folder / name for name in self.parameters)


def load_mapping(path: Path) -> tuple[Mapping, CompareTable]:
    """Reads a mapping file that may hold a table ``[compare]``.

    Raises:
        DataError: it is missing, is no TOML, or a key or value in it is wrong; the message names the key.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        content = {}  # `load_plain` says what is wrong with the file
    table = _table(content.get(TABLE, {}), path)
    plain = load_plain(path)
    if not plain.machine and (stated := plain.diagnose.get(CONSTANT)):
        table = table.model_copy(update={CONSTANT: _constants(stated, path)})
    return plain, table


def _constants(stated: object, path: Path) -> dict[str, float]:
    try:
        return CompareTable.model_validate({CONSTANT: stated}).constant
    except ValidationError as error:
        raise DataError(
            f"{path}: {_sentences(error, 'diagnose')}: write a number, in the unit of the FMU"
        ) from None


def _table(content: object, path: Path) -> CompareTable:
    if not isinstance(content, dict) or {"folder", "aside", "notes", CONSTANT} & content.keys():
        raise DataError(
            f"{path}: '{TABLE}' must be a table with the keys parameters, signals, start, units, calibrate"
        )
    try:
        return CompareTable.model_validate({**content, "folder": path.resolve().parent})
    except ValidationError as error:
        raise DataError(f"{path}: {_sentences(error, TABLE)}") from None


def _sentences(error: ValidationError, *where: str) -> str:
    """Every fault with the path of its key."""
    found = []
    for item in error.errors():
        key = ".".join([*where, *map(str, item["loc"])])
        known = (
            "; known keys: see docs/compare.md and docs/logs.md" if item["type"] == "extra_forbidden" else ""
        )
        found.append(f"'{key}': {item['msg'].removeprefix('Value error, ')}{known}")
    return "; ".join(found)
