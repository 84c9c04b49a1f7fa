"""From the form of the page to a mapping file."""

import json
import math
from collections.abc import Mapping
from typing import Any

from cosim.browser.form import OWN, Form, Row, find, known_in, named
from cosim.errors import UsageError
from cosim.logs.overview import Overview, longest
from cosim.ssp.stated import in_si

Content = dict[str, Any]
MOST = 200  # characters of a text that comes from the page


class FormError(UsageError):
    """Something in the form is wrong.

    Attributes:
        row: the signal, ``time``, or empty.
    """

    def __init__(self, message: str, row: str = "") -> None:
        super().__init__(message)
        self.row = row


def mapping_of(given: Any, form: Form, found: Overview, base: Content) -> Content:
    """The content of a mapping file.

    Args:
        given: ``{"time": {...}, "rows": {signal: {...}}, "numbers": {parameter: {...}}}`` as the page has it; nothing in it
            is trusted.
        form: the form that was shown.
        found: the log.
        base: what else the mapping says: the model, or all that a dropped file said.

    Raises:
        FormError: a signal is missing, or a value is no number or unit; the message names it.
    """
    rows = _table(_table(given, "the form").get("rows"), "rows")
    entries: Content = {}
    chosen: dict[int, str] = {}
    counts: dict[str, str] = {}
    for row in form.rows:
        sent = _table(rows.get(row.signal, {}), row.signal)
        column = sent.get("column")
        if column is None:
            if row.needed:
                raise FormError(
                    f"{row.signal} ({row.text}) has no column: choose the one that holds it", row.signal
                )
            continue
        if not isinstance(column, int) or isinstance(column, bool):
            raise FormError(f"{row.signal}: {column!r} is no column", row.signal)
        if column in chosen:
            raise FormError(
                f"{chosen[column]} and {row.signal} are the same column '{found.columns[column].label.text}': choose one",
                row.signal,
            )
        before = base.get("signals", {}).get(row.signal, {})
        entries[row.signal] = {
            **before,
            "column": named(found, column),
            **_scaling(sent, row),
        }
        if row.held is not None:
            entries[row.signal]["held"] = sent.get("held", row.held) is True
        if row.minus is not None and column == row.minus[0]:
            entries[row.signal]["minus"] = named(found, row.minus[1])
        unit = entries[row.signal]["unit"]
        if row.counts and (row.counts != OWN or not in_si(unit)):
            counts[row.signal] = unit if row.counts == OWN else row.counts
        chosen[column] = row.signal
    if not entries:
        raise FormError("no signal has a column: choose at least the command and what was measured")
    if form.least and not entries.keys() & set(form.least):
        raise FormError(f"there is nothing to compare the model with: choose a column for {form.named}")
    clock = _time(_table(given.get("time", {}), "time"), found, list(chosen))
    made = {**base, "time": clock, "signals": entries}
    start = {parameter: signal for parameter, signal in form.start.items() if signal in entries}
    for key, own in (("units", counts), ("start", start)):
        compare = made.get("compare", {})
        if own:
            made["compare"] = {**compare, key: {**own, **compare.get(key, {})}}
    if form.numbers:
        made["diagnose"] = {**base.get("diagnose", {}), **_known(given.get("numbers", {}), form)}
        made["diagnose"] = {key: value for key, value in made["diagnose"].items() if value not in ({}, [])}
    if "held_out" in base:  # of what has a column now
        known = entries.keys() | ({"time"} if "column" in clock else set())
        made["held_out"] = {name: column for name, column in base["held_out"].items() if name in known}
    return made


def remember(form: Form, content: Content, found: Overview) -> None:
    """Put what was chosen into the form, so that a page that is opened again shows it."""
    for row in form.rows:
        entry = content["signals"].get(row.signal)
        row.column = None if entry is None else find(found, entry["column"])
        if entry is not None:
            row.unit, row.gain, row.zero = entry["unit"], entry["gain"], entry["zero"]
            row.reversed = entry["sign"] < 0
            row.held = entry.get("held", row.held)
    known_in(form.numbers, content.get("diagnose", {}))
    if not form.time.own:
        named = content["time"].get("column")
        form.time.column = None if named is None else find(found, named)
        form.time.step, form.time.unit = content["time"].get("step"), content["time"]["unit"]


def _known(given: Any, form: Form) -> Content:
    """The parameters that are trusted to a tolerance, and those that are fitted."""
    sent = _table(given, "parameters")
    trusted: dict[str, str] = {}
    free: list[str] = []
    for row in form.numbers:
        own = _table(sent.get(row.name, {}), row.name)
        text = own.get("trusted", row.trusted)
        if own.get("free", row.free) is True:
            free.append(row.name)
        elif not isinstance(text, str) or len(text) > MOST:
            raise FormError(f"{row.name}: how well it is known must be a text such as 2 %", row.name)
        elif text.strip():
            trusted[row.name] = _tolerance(text.strip(), row.name)
    return {"trusted": trusted, "free": free}


def _tolerance(text: str, name: str) -> str:
    """A tolerance as a mapping has it: a bare number is one in per cent."""
    bare = text.replace(",", ".").removesuffix("%").strip()
    try:
        value = float(bare)
    except ValueError:
        raise FormError(
            f"{name}: '{text[:40]}' does not say how well it is known: write a share such as 2 %", name
        ) from None
    if not 0.0 < value < 1000.0:
        raise FormError(f"{name}: it cannot be known to '{text[:40]}': write a share such as 2 %", name)
    return f"{bare} %"


def _scaling(sent: Content, row: Row) -> Content:
    unit = sent.get("unit", row.unit)
    if not isinstance(unit, str) or not unit.strip() or len(unit) > MOST:
        raise FormError(f"{row.signal} has no unit: write one such as bar or deg, or 1 for none", row.signal)
    gain = sent.get("gain", row.gain)
    name = isinstance(gain, str) and gain == row.gain  # of a number stored in the file
    made: Content = {"unit": unit.strip(), "gain": gain if name else _number(gain, row.signal, "gain")}
    made["zero"] = _number(sent.get("zero", row.zero), row.signal, "zero")
    made["sign"] = -1 if sent.get("reversed", row.reversed) is True else 1
    return made


def _time(sent: Content, found: Overview, columns: list[int]) -> Content:
    unit = sent.get("unit")
    if not isinstance(unit, str) or not unit.strip() or len(unit) > MOST:
        raise FormError("time has no unit: write s, ms or us", "time")
    if sent.get("own") is True:
        return {"column": named(found, longest(found.columns[k] for k in columns).index), "unit": "s"}
    column = sent.get("column")
    if isinstance(column, int) and not isinstance(column, bool):
        if column in columns:
            raise FormError(
                f"'{found.columns[column].label.text}' cannot be time and a signal at once", "time"
            )
        return {"column": named(found, column), "unit": unit.strip()}
    step = sent.get("step")
    if step in (None, ""):
        raise FormError("time has no column: choose it, or give the interval between samples", "time")
    value = _number(step, "time", "the interval between samples")
    if not value > 0.0:
        raise FormError("the interval between samples must be positive", "time")
    return {"step": value, "unit": unit.strip()}


def _number(value: Any, row: str, what: str) -> float:
    try:
        if isinstance(value, bool):
            raise ValueError
        number = float(value.replace(",", ".") if isinstance(value, str) else value)
    except (TypeError, ValueError):
        raise FormError(f"{row}: {what} '{str(value)[:40]}' is no number", row) from None
    if not math.isfinite(number):
        raise FormError(f"{row}: {what} must be a finite number", row)
    return number


def _table(value: Any, what: str) -> Content:
    if not isinstance(value, dict):
        raise FormError(f"{what} is no table")
    return value


def toml_text(content: Mapping[str, Any], head: str) -> str:
    """A mapping file: plain values first, then a table for each key and each signal.

    Args:
        content: texts, numbers, lists and tables.
        head: a comment for the first line.
    """
    lines = [f"# {head}"]
    lines += [f"{_key(k)} = {_inline(v)}" for k, v in content.items() if not isinstance(v, dict)]
    for key, table in content.items():
        if not isinstance(table, dict):
            continue
        if key == "signals":
            for name, entry in table.items():
                lines += ["", f"[signals.{_key(name)}]"]
                lines += [f"{_key(k)} = {_inline(v)}" for k, v in entry.items() if v != _DEFAULTS.get(k)]
        elif table:
            lines += ["", f"[{_key(key)}]", *(f"{_key(k)} = {_inline(v)}" for k, v in table.items())]
    return "\n".join(lines) + "\n"


_DEFAULTS = {"gain": 1.0, "zero": 0.0, "sign": 1, "offset": 0.0}


def _key(name: str) -> str:
    return name if name.isascii() and name.replace("_", "a").replace("-", "a").isalnum() else _inline(name)


def _inline(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {_inline(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_inline, value))}]"
    # a basic string of TOML, whose escapes are those of JSON; DEL is the one character only TOML escapes
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
