"""What an identification hands back: numbers, a picture, a parameter set for the SSP, one JSON object."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim import console
from cosim.errors import UsageError
from cosim.files import write_bytes, write_text
from cosim.identify.estimate import Quantity
from cosim.identify.nominal import declared
from cosim.lexicon import CRANE, Lexicon, current, named, speaking
from cosim.report.names import kind_of_motion
from cosim.ssp.write import values_xml

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass
class Answer:
    """The result of a subcommand.

    Attributes:
        kind: the subcommand, and the stem of its files.
        data: for the JSON object, plain.
        parameters: ``component.parameter`` -> number (SI), for the .ssv.
        tables: titles, columns and rows for people.
        lines: sentences for people.
        brief: what was found and how sure, in sentences, before all else; tables are then shown on demand.
        model: system of ours that takes the parameters, for what to type next.
        following: what to type next, where no parameters go into a model; or what makes it of the written files.
        details: more of them, shown with the tables.
        notes: warnings.
        draw: makes the picture.
        texts: further files, name -> text.
        lexicon: units and words of the machine.
    """

    kind: str
    data: dict[str, Any]
    parameters: dict[str, Quantity] = field(default_factory=dict)
    tables: list[tuple[str, list[str], list[list[object]]]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    brief: list[str] = field(default_factory=list)
    model: str = ""
    following: str | Callable[[Mapping[str, Path]], str] = ""
    details: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    draw: "Callable[[], Figure] | None" = None
    texts: dict[str, str] = field(default_factory=dict)
    lexicon: Lexicon = CRANE

    @property
    def synthetic(self) -> bool:
        """A log was made by the virtual rig."""
        return bool(self.data.get("synthetic"))

    def summary(self) -> list[str]:
        """The answer in a few lines: each parameter with its interval in the unit people read, and the sentences."""
        with speaking(self.lexicon):
            return [*self.brief, *self._numbers(), *self.lines]

    def _numbers(self) -> list[str]:
        found = []
        for name, quantity in self.parameters.items():
            unit, scale = current().quantity(quantity.unit, declared(name).display)
            low, high = sorted(end * scale for end in quantity.interval)
            shown = "" if unit == "1" else f" {unit}"
            value = quantity.value * scale
            digits = _digits(value, high - low)
            # a choice has no interval
            known = f", {low:.{digits}g} to {high:.{digits}g} (95 %)" if low < high else ""
            found.append(
                f"{name} = {value:.{digits}g}{shown}{known}: {_within(kind_of_motion(declared(name).text))}"
            )
        return found

    def next_step(self, written: Mapping[str, Path]) -> str:
        """What to type next with the numbers; empty where there is nothing."""
        if not self.parameters or not self.model:
            return self.following if isinstance(self.following, str) else self.following(written)
        if "ssv" not in written:
            return (
                "Next: the same with --out DIR writes these numbers as a parameter set, which cosim simulate and "
                "cosim compare take (--parameter-set)"
            )
        words = f"{self.model} --parameter-set {console.typed(written['ssv'])}"
        return f"Next: cosim simulate {words} runs the model with these numbers"

    def as_data(self, files: Mapping[str, Path]) -> dict[str, Any]:
        """The JSON object."""
        found = {name: _in_words_of(self.lexicon, q).as_data() for name, q in self.parameters.items()}
        return {
            "identify": self.kind,
            **self.data,
            "parameters": found,
            "notes": self.notes,
            "files": {name: str(path) for name, path in files.items()},
        }


def _within(text: str) -> str:
    """A description as it goes on within a sentence: "Time constant" -> "time constant", "J of ..." as it is."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text


def _in_words_of(lexicon: Lexicon, quantity: Quantity) -> Quantity:
    """The same number in the unit that a machine has for it: an inertia of an axis that moves along a line is a mass."""
    if quantity.unit not in lexicon.units:
        return quantity
    unit, scale = named(lexicon.units[quantity.unit])
    return Quantity(quantity.value * scale, quantity.deviation * scale, quantity.freedom, unit)


def _digits(value: float, width: float) -> int:
    """Significant digits of a value, at least four, that leave two of its interval's width."""
    if not (value and 0.0 < width < math.inf):
        return 4
    return min(max(4, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(width))), 10)


def parameter_table(parameters: Mapping[str, Quantity], nominal: Mapping[str, float]) -> list[list[object]]:
    """Rows name, value, lower and upper end of the 95 % interval, unit, nominal, in the units people read."""
    rows: list[list[object]] = []
    for name, quantity in parameters.items():
        unit, scale = current().quantity(quantity.unit, declared(name).display)
        low, high = quantity.interval
        known = nominal.get(name)
        shown = "" if known is None else f"{known * scale:.5g}"
        rows.append([name, *(f"{v * scale:.6g}" for v in (quantity.value, low, high)), unit, shown])
    return rows


COLUMNS = ["parameter", "value", "95 % from", "to", "unit", "nominal"]


def write_ssv(parameters: Mapping[str, Quantity], path: Path) -> Path:
    """Write the values as a parameter set that ``--parameter-set`` takes; those outside their bounds are refused.

    Raises:
        UsageError: a value is outside the bounds of its declaration: the model would refuse it.
    """
    for name, quantity in parameters.items():
        variable = declared(name)
        if not variable.low <= quantity.value <= variable.high:
            raise UsageError(
                f"{name} came out as {quantity.value:.6g} {variable.unit}, outside {variable.low:g} .. {variable.high:g}:"
                " the model cannot take it, and the log probably does not fit the structure"
            )
    write_bytes(
        path, values_xml({n: declared(n) for n in parameters}, {n: q.value for n, q in parameters.items()})
    )
    return path


def write_files(answer: Answer, folder: Path) -> dict[str, Path]:
    """Write .ssv, .png, .json and further texts of an answer; returns name -> file.

    Raises:
        UsageError: the folder cannot be written to.
    """
    from cosim.identify.picture import save

    written: dict[str, Path] = {}
    stem = answer.kind.replace("-", "_")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if answer.parameters:
            written["ssv"] = write_ssv(answer.parameters, folder / f"{stem}.ssv")
        if answer.draw is not None:
            written["png"] = save(answer.draw, folder / f"{stem}.png", answer.synthetic)
        for name, text in answer.texts.items():
            written[name] = folder / name
            write_text(written[name], text)
        written["json"] = folder / f"{stem}.json"
        content = json.dumps(
            console.to_jsonable(answer.as_data(written)), indent=2, ensure_ascii=False, allow_nan=False
        )
        write_text(written["json"], content + "\n")
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return written


def finish(answer: Answer, out: Path | None, as_json: bool, verbose: bool = True) -> None:
    """Write the files, and print the answer: sentences, and a line for each number or with `verbose` the tables."""
    written = write_files(answer, out) if out is not None else {}
    for note in answer.notes:
        console.warn(note)
    if as_json:
        console.emit_json(answer.as_data(written))
        return
    output = console.stdout_console()
    if answer.synthetic:
        output.print("from a synthetic log", markup=False)
    if verbose or not (answer.parameters or answer.brief):  # without either the tables are the answer
        for line in answer.brief:
            output.print(line, markup=False, soft_wrap=True)
        for title, columns, rows in answer.tables:
            if rows:
                output.print(console.table(title, columns, rows))
        for line in (*answer.lines, *answer.details):
            output.print(line, markup=False, soft_wrap=True)
    else:
        for line in answer.summary():
            output.print(line, markup=False, soft_wrap=True)
    for path in written.values():
        output.print(f"written: {path}", markup=False, soft_wrap=True)
    following = answer.next_step(written)
    if following:
        output.print(following, markup=False, soft_wrap=True)
