"""Holds a model against its reference logs: compare measures, diagnose names the cause, nothing is computed here."""

import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cosim.errors import CosimError, UsageError
from cosim.gate.found import Checked, GateResult, Held
from cosim.gate.junit import write_junit
from cosim.gate.limits import Check, Limit, Limits, Reference, read_check, write_check
from cosim.report.screen import wrong
from cosim.units import parse_quantity

Compare = Callable[..., Any]
"""`cosim.compare`: log, model, mapping -> ComparisonResult; handed in, since `cosim.api` calls this package."""
Diagnose = Callable[..., Any]
"""`cosim.diagnose`: log, model, mapping, budget -> DiagnosisResult."""


def check(
    file: Path,
    compare: Compare,
    diagnose: Diagnose,
    *,
    model: str | None = None,
    mapping: Path | None = None,
    add: list[Path],
    update: bool = False,
    margin: str | None = None,
    cause: bool | None = None,
    budget: str | None = None,
    junit: Path | None = None,
) -> GateResult:
    """Compare with every reference log, or measure the limits anew.

    Args:
        file: of limits.
        compare: `cosim.compare`.
        diagnose: `cosim.diagnose`.
        model: in place of the models that the file names; with `add` the model that it will name.
        mapping: of the logs that are added.
        add: logs to add; their limits are measured, the others stay.
        update: measure all limits anew.
        margin: of limits over errors, such as ``10 %``, from now on.
        cause: True: always a diagnosis; False: never; None: where a limit is missed.
        budget: of each diagnosis, such as ``60s``.
        junit: file of JUnit XML to write.

    Raises:
        UsageError: the request makes no sense.
        DataError: the file of limits is bad; with `add` and `update`, also a log.
        ModelError, SimulationError: with `add` and `update`, a model; else it is in the result.
    """
    if margin is not None and not (add or update):
        raise UsageError("--margin belongs to --add or --update: limits are only set there")
    if mapping is not None and not add:
        raise UsageError("--mapping belongs to --add: the file names the mappings of its logs")
    kept = Check() if add and not file.exists() else read_check(file)
    if margin is not None:
        kept = Check.model_validate({**kept.model_dump(), "margin": _margin(margin)})
    added = [_reference(file, log, model, mapping) for log in add]
    known = {item.log for item in kept.reference}
    for item in added:
        if item.log in known:
            raise UsageError(f"{file} has the log {item.log} already: measure it again with --update")
    if not kept.reference and not added:
        raise UsageError(f"{file} names no log: add one with `cosim check {file} --add LOG`")
    setting = update or bool(added)
    asked = [*(kept.reference if update or not added else []), *added]

    checked: list[Checked] = []
    fresh: list[Reference] = []
    for item in asked:
        started = time.monotonic()
        given = _request(file, item, None if added else model)
        try:
            numbers = compare(**given).to_dict()
            new = _measured(item, numbers, kept.factor) if setting else item
            limits, notes = _held(new, numbers)
            broken = not all(held.kept for held in limits)
            causes, names = _causes(diagnose, given, budget) if _wanted(cause, broken) else (None, None)
        except CosimError as error:
            if setting:
                raise
            checked.append(Checked(item.log, seconds=time.monotonic() - started, error=error))
            continue
        fresh.append(new if names is None or not setting else new.model_copy(update={"causes": names}))
        before = item.causes or []
        checked.append(
            Checked(
                log=item.log,
                model=numbers["model"]["name"],
                seconds=time.monotonic() - started,
                limits=limits,
                causes=causes,
                new=None if names is None or setting else [name for name in names if name not in before],
                gone=[] if names is None or setting else [name for name in before if name not in names],
                notes=notes,
            )
        )
    if setting:
        untouched = [] if update else kept.reference
        write_check(file, kept.model_copy(update={"reference": [*untouched, *fresh]}))
    found = GateResult(file, checked, {} if junit is None else {"junit": junit}, setting)
    if junit is not None:
        write_junit(found, junit)
    return found


def _wanted(cause: bool | None, broken: bool) -> bool:
    return broken if cause is None else cause


def _margin(text: str) -> str:
    try:
        value = float(text.strip().rstrip("%"))
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise UsageError(f"--margin '{text}' is no share in per cent: give one such as '10 %'")
    return f"{value:g} %"


def _reference(file: Path, log: Path, model: str | None, mapping: Path | None) -> Reference:
    """An entry, its files relative to the file of limits."""
    from cosim.ssp.build import SYSTEMS

    named = model if model is None or model in SYSTEMS else _relative(Path(model), file)
    return Reference(
        log=_relative(log, file), model=named, mapping=None if mapping is None else _relative(mapping, file)
    )


def _relative(path: Path, file: Path) -> str:
    try:
        return Path(os.path.relpath(path, file.parent)).as_posix()
    except ValueError:  # another drive
        return path.resolve().as_posix()


def _request(file: Path, item: Reference, model: str | None) -> dict[str, Any]:
    """Log, model and mapping of an entry, for `cosim.compare` and `cosim.diagnose`."""
    from cosim.ssp.build import SYSTEMS

    named = item.model if item.model is None or item.model in SYSTEMS else str(file.parent / item.model)
    return {
        "log": str(file.parent / item.log),
        "model": named if model is None else model,
        "mapping": None if item.mapping is None else file.parent / item.mapping,
    }


def _measured(item: Reference, numbers: Mapping[str, Any], factor: float) -> Reference:
    """The entry with limits from what was found."""

    def limits(found: Mapping[str, Mapping[str, Any]]) -> Limits:
        return {
            name: Limit(
                limit=f"{one['rmse'] * factor:.4g} {one['unit']}", was=f"{one['rmse']:.4g} {one['unit']}"
            )
            for name, one in found.items()
        }

    blocks = {block["block"]: limits(block["signals"]) for block in numbers["blocks"]}
    return item.model_copy(update={"signals": limits(numbers["signals"]), "blocks": blocks, "causes": None})


def _held(item: Reference, numbers: Mapping[str, Any]) -> tuple[list[Held], list[str]]:
    """Each limit beside the error, and what has an error but no limit.

    Raises:
        UsageError: a limit is no quantity of the signal's dimension.
    """
    found: dict[str | None, Mapping[str, Any]] = {None: numbers["signals"]}
    found |= {block["block"]: block["signals"] for block in numbers["blocks"]}
    asked: dict[str | None, Limits] = {None: item.signals}
    asked.update(item.blocks)
    held = [
        _one(b, s, limit, found.get(b, {}).get(s))
        for b, limits in asked.items()
        for s, limit in limits.items()
    ]
    loose = [b or "the whole model" for b, signals in found.items() if set(signals) - set(asked.get(b, {}))]
    notes = [f"no limit for some signals of {', '.join(loose)}: --update sets them"] if loose else []
    return held, notes


def _one(block: str | None, signal: str, limit: Limit, found: Mapping[str, Any] | None) -> Held:
    unit = found["unit"] if found is not None else limit.limit.strip().partition(" ")[2] or "1"
    where = signal if block is None else f"{signal} of {block}"
    try:
        allowed = parse_quantity(limit.limit, unit)
        was = None if limit.was is None else parse_quantity(limit.was, unit)
    except UsageError as error:
        raise UsageError(f"limit of {where}: {error}") from None
    return Held(block, signal, unit, None if found is None else found["rmse"], allowed, was)


def _causes(diagnose: Diagnose, given: Mapping[str, Any], budget: str | None) -> tuple[list[str], list[str]]:
    """What a diagnosis says in lines, and the names of its causes."""
    found = diagnose(**given, budget=budget)
    names = [_name(cause) for cause in found.causes]
    return [f"Diagnosis: {found.verdict.replace('_', ' ')}", *wrong(found.answer)], names


def _name(cause: Any) -> str:
    """An effect, and where it acts in a system of any FMUs."""
    places = [part for part in (cause.component, cause.connector or cause.parameter) if part]
    return f"{cause.effect} at {'.'.join(places)}" if places else str(cause.effect)
