"""What a file holds: a log, a tracker's record, an FMU or a system, as plain data."""

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.console import typed as typed_as
from cosim.errors import ColumnsError, DataError, ModelError

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

    from cosim.logs import Log, Tracker
    from cosim.logs.guess import Guess
    from cosim.logs.source import Source
    from cosim.ssp.system import Port

# folders of FMI 3.0, by the names that 2.0 has for these machines
PLATFORMS = {
    "x86_64-linux": "linux64",
    "i686-linux": "linux32",
    "x86_64-windows": "win64",
    "x86-windows": "win32",
    "x86_64-darwin": "darwin64",
    "aarch64-darwin": "darwin64",
}
OTHER = "log with other columns"
OWN_STAMPS = "each column has stamps of its own"


def facts_of(file: Path, mapping: Path | None = None, plot: bool = False) -> dict[str, Any]:
    """What a file holds.

    Args:
        file: a log, a tracker's record, an .fmu, an .ssp, or one of our systems by its name.
        mapping: mapping file of a log.
        plot: with a row of bars for each column of a log.

    Raises:
        DataError, ModelError: there is no such file, or it is bad.
        MissingExtraError: its type needs an optional dependency.
    """
    file = _existing(file)
    kind = file.suffix.lower()
    if kind == ".fmu":
        return _fmu_facts(file)
    return _ssp_facts(file) if kind == ".ssp" else log_or_columns(file, mapping, plot)


def _existing(file: Path) -> Path:
    """The file itself, or the package of a system of ours by its name, such as ``full_order``.

    Raises:
        DataError: there is no such file; of a system of ours the message names the command that makes it.
        ModelError: a system of ours is not built, and cannot be.
    """
    if file.is_file():
        return file
    if file.is_dir():
        raise DataError(f"{file}: this is a folder")
    from cosim.files import why_no_file
    from cosim.request import model_path
    from cosim.ssp.build import CLOSED, SYSTEMS

    ours = (*SYSTEMS, *CLOSED)
    if str(file) in ours:
        return model_path(str(file))
    remedy = ""
    if file.suffix.lower() == ".ssp" and file.stem.removesuffix("_open") in ours:
        remedy = f": cosim build makes it, and cosim info {file.stem.removesuffix('_open')} finds it wherever it is"
    raise DataError(f"{file}: {why_no_file(file)}{remedy}")


def log_or_columns(path: Path, mapping: Path | None, plot: bool) -> dict[str, Any]:
    """What a log holds; of one whose columns are not our signals what stands in the file, and guesses.

    Raises:
        DataError: the file or the mapping is bad.
        MissingExtraError: its type needs an optional dependency.
    """
    from cosim.logs.load import open_source
    from cosim.logs.overview import overview

    source = None
    try:
        source = None if mapping else open_source(path)
        facts = log_facts(path, mapping, source)
    except ColumnsError as error:
        if mapping is not None:
            raise
        facts = column_facts(path, str(error), source)
    else:
        if source is not None and facts["kind"] == "log":
            facts |= _overlooked(source, facts)
    if plot:
        columns = overview(path, source=source).columns
        names = [c.label.shown for c in columns]
        wide = max(map(len, names))
        facts["plot"] = [f"{name:<{wide}}  {c.spark()}" for name, c in zip(names, columns, strict=True)]
    return facts


def _overlooked(source: "Source", facts: dict[str, Any]) -> dict[str, Any]:
    """Columns that are ignored for their names and look like signals of which the log has none; empty if none do."""
    if not any(text.startswith("ignored columns") for text in facts["warnings"]):
        return {}
    from cosim.logs.guess import guesses
    from cosim.logs.overview import overview

    known = {row["signal"] for row in facts["signals"]}
    found = {
        name: g for name, g in guesses(overview(source.path, source=source)).items() if name not in known
    }
    if not found:
        return {}
    typed = typed_as(source.path)
    return {
        "guesses": {name: _guess_facts(guess) for name, guess in found.items()},
        "next": f"Next: cosim init {typed} writes these guesses into a mapping to correct, for --mapping; without it "
        "these columns are ignored",
    }


def _guess_facts(guess: "Guess") -> dict[str, Any]:
    label = guess.column.label
    return {
        "column": label.shown,
        "unit": guess.unit,
        "gain": guess.gain,
        "zero": guess.zero,
        **({} if guess.minus is None else {"minus": guess.minus.label.shown}),
        "why": guess.why,
    }


def column_facts(path: Path, why: str, source: "Source | None" = None) -> dict[str, Any]:
    """A log whose columns are not our signals, as it stands in the file: columns, time, guesses, and what to do next.

    Args:
        path: the log.
        why: it cannot be read as it is.
        source: the file as it was opened, where it has a row of names.

    Raises:
        DataError: the file is bad.
    """
    from cosim.logs.guess import likely
    from cosim.logs.overview import measured

    found = measured(path, source)
    clock = found.clock
    facts: dict[str, Any] = {"file": path, "kind": OTHER, "samples": found.samples}
    if clock is None:
        facts["time"] = "no column looks like a time"
    else:
        named = "" if clock.column is None else found.columns[clock.column].label.text
        facts |= {
            "time_column": named or OWN_STAMPS,
            "time_unit": clock.unit + (f" (guessed: {clock.guessed})" if clock.guessed else ""),
            "duration": f"{clock.duration:.6g} s",
            "rate": f"{clock.rate:.6g} samples a second",
            "uniform": clock.even,
            "gaps": clock.gaps,
            "not_rising": clock.backwards,
        }
    (made, machine), typed = likely(found), typed_as(path)
    way = f"{typed} --machine" if machine else typed
    other = "" if machine else " (--machine: of another machine than the crane)"
    return facts | {
        "columns": [
            {
                "column": c.label.shown,
                "unit": c.unit or "?",
                "min": float(c.finite.min()) if c.finite.size else "",
                "mean": float(c.finite.mean()) if c.finite.size else "",
                "max": float(c.finite.max()) if c.finite.size else "",
                "missing": c.missing,
                "shape": c.kind,
            }
            for c in found.columns
        ],
        "machine": machine,
        "guesses": {name: _guess_facts(guess) for name, guess in made.items()},
        "warnings": [*found.warnings, *(f"'{c.label.text}': {c.why}" for c in found.columns if c.why)],
        "why": why,
        "next": f"Next: cosim init {way} writes {'these guesses' if made else 'the columns'} into a mapping to "
        f"correct{other}; cosim open {typed} does the same on a page",
    }


def log_facts(path: Path, mapping: Path | None = None, source: "Source | None" = None) -> dict[str, Any]:
    """What a log or a tracker's record holds, as plain data; ranges are in the units in which people read them.

    Args:
        path: the file.
        mapping: mapping file.
        source: the file as it was opened, where there is no mapping.

    Raises:
        DataError: the file or the mapping is bad.
        MissingExtraError: its type needs an optional dependency.
    """
    from cosim.logs import load_log, load_mapping, load_tracker
    from cosim.logs.load import open_source
    from cosim.logs.markers import holds_markers

    chosen = load_mapping(mapping) if mapping else None
    if chosen is not None:
        tracker = "slew_external" in chosen.signals
    else:
        source = source or open_source(path)
        tracker = holds_markers(source) or any(
            "slew_external" in (label.name, label.alias) for label in source.labels
        )
    record: Log | Tracker = (
        load_tracker(path, chosen, source) if tracker else load_log(path, chosen, source=source)
    )
    unit = getattr(record, "time_unit", "s")
    facts = {
        "file": path,
        "kind": "tracker" if tracker else "log",
        "origin": "synthetic" if record.synthetic else "measured",
        "sha256": record.sha256,
        "samples": len(record),
        "time_unit": unit,
        "start": float(record.time[0]),
        "duration": record.duration,
        "step": record.step,
        "uniform": record.uniform,
        "gaps": len(record.gaps),
        "next": f"Next: cosim diagnose {'LOG --external ' if tracker else ''}{typed_as(path)}"
        + (f" --mapping {typed_as(mapping)}" if mapping and not tracker else ""),
    }
    if getattr(record, "model", None):
        facts["model"] = record.model  # type: ignore[union-attr]
    return facts | {"signals": _signal_rows(record), "warnings": list(record.warnings)}


def _signal_rows(record: "Log | Tracker") -> list[dict[str, Any]]:
    from cosim.logs import Log
    from cosim.signals import SIGNALS

    if not isinstance(record, Log):
        signal = SIGNALS["slew_external"]
        columns = [
            ("slew_external", signal.unit, record.slew_external / signal.to_si, int((~record.valid).sum()))
        ]
    else:
        columns = [
            (name, record.display[name], record.in_display_units(name), int((~record.valid_mask(name)).sum()))
            for name in record.signals
        ]
    return [
        {
            "signal": name,
            "unit": unit,
            "min": float(values.min()),
            "mean": float(values.mean()),
            "max": float(values.max()),
            "filled": filled,
        }
        for name, unit, values, filled in columns
    ]


def _fmu_facts(path: Path) -> dict[str, Any]:
    """The main facts of an FMU's model description.

    Raises:
        ModelError: it is no FMU.
    """
    from cosim.ssp.archive import open_archive, read_entry
    from cosim.ssp.fmu import described, description_of, libraries, platform_of

    with open_archive(path, str(path)) as archive, tempfile.TemporaryDirectory() as folder:
        description_of(archive, str(path))  # refuses what harms
        text, names = read_entry(archive, "modelDescription.xml", str(path)), archive.namelist()
        Path(folder, "modelDescription.xml").write_bytes(text)
        model = described(Path(folder), str(path))
    typed, platforms = typed_as(path), sorted({PLATFORMS.get(p, p) for p in libraries(names)})
    sources = any(name.startswith("sources/") and name.endswith(".c") for name in names)
    types = [name for name, found in _interfaces(model).items() if found]
    return {
        "file": path,
        "kind": "fmu",
        "name": model.modelName,
        "description": model.description or "",
        "fmi_version": model.fmiVersion,
        "type": ", ".join(types),
        "guid": model.guid,
        "generation_tool": model.generationTool,
        "generation_date": model.generationDateAndTime,
        "platforms": ", ".join([*(["c-code"] if sources else []), *platforms]),
        "here": platform_of(model.fmiVersion) in libraries(names),
        "variables": [
            {
                "variable": variable.name,
                "causality": variable.causality,
                "variability": variable.variability,
                "unit": variable.unit
                or (variable.declaredType.unit if variable.declaredType else None)
                or "",
                "start": variable.start if variable.start is not None else "",
                "description": variable.description or "",
            }
            for variable in model.modelVariables
        ],
        "next": f"Next: cosim init {typed} LOG writes a mapping for a log of it, cosim simulate {typed} runs it"
        if "co-simulation" in types
        else f"It cannot be run here, since it is for {' and '.join(types)} only: export it for co-simulation",
    }


def _interfaces(model: "ModelDescription") -> dict[str, bool]:
    """Which interface types of FMI an FMU offers; cosim runs co-simulation."""
    return {
        "co-simulation": model.coSimulation is not None,
        "model exchange": model.modelExchange is not None,
        "scheduled execution": model.scheduledExecution is not None,
    }


def _ssp_facts(path: Path) -> dict[str, Any]:
    """The files in a system package.

    Raises:
        ModelError: it is no package.
    """
    from cosim.ssp.archive import open_archive

    with open_archive(path, str(path)) as package:
        files = [{"file": item.filename, "bytes": item.file_size} for item in package.infolist()]
    if not any(item["file"] == "SystemStructure.ssd" for item in files):
        raise ModelError(f"{path}: holds no SystemStructure.ssd, so it is no SSP package")
    return {"file": path, "kind": "ssp", **_loop_facts(path), **_system_facts(path), "files": files}


def _system_facts(path: Path) -> dict[str, Any]:
    """Components and their connectors, as the columns of a log would be called; why they cannot be told of a bad package."""
    from cosim.ssp.read import read_system
    from cosim.ssp.system import Port
    from cosim.system.graph import feeders

    try:
        with read_system(path) as system:
            fed = feeders(system)
            heard: dict[str, list[str]] = {}
            for target, (source, _, _) in fed.items():
                heard.setdefault(str(source) if source.component else source.variable, []).append(str(target))
            for outer, port in system.outputs.items():
                heard.setdefault(str(port), []).append(f"{outer} (to outside)")
            connectors = [
                {
                    "connector": name,
                    "kind": variable.causality,
                    "unit": variable.unit,
                    "joined with": ", ".join(heard.get(name, ()))
                    or joined(fed.get(port), variable.causality),
                }
                for c in system.components.values()
                for variable in c.fmu.variables.values()
                if variable.causality in ("input", "output")
                for port, name in [(Port(c.name, variable.name), f"{c.name}.{variable.name}")]
            ]
            components = [{"component": c.name, "fmu": c.fmu.source} for c in system.components.values()]
            typed = str(path.stem if ours(path) else typed_as(path))
            runs = f"cosim simulate {typed}" + (" --input LOG" if system.inputs else "")
            names = ", ".join(f"{c['component']} ({c['fmu']})" for c in components)
            return {
                "components": names,
                "parts": components,
                "inputs": ", ".join(system.inputs) or "none",
                "connectors": connectors,
                "warnings": list(system.notes),
                "next": f"Next: {runs} runs it; cosim diagnose LOG --model {typed} says what it gets wrong"
                if ours(path)
                else f"Next: {runs} runs it; cosim init {typed} LOG writes a mapping for a log of it (columns called "
                "like the connectors need none)",
            }
    except ModelError as error:
        return {"warnings": [f"it cannot be run here: {error}"]}


def ours(path: Path) -> bool:
    """Whether it is the package that a system of ours goes by its name for."""
    from cosim.ssp.build import SYSTEMS, package_of

    return path.stem in SYSTEMS and package_of(path.stem).resolve() == path.resolve()


def joined(source: "tuple[Port, float, float] | None", causality: str) -> str:
    """What enters a connector, for a table."""
    if source is None:
        return "nothing" if causality == "input" else ""
    port = source[0]
    return str(port) if port.component else f"{port.variable} (from outside)"


def _loop_facts(path: Path) -> dict[str, Any]:
    """Margins of a position loop, or the linearised physical hydraulics, in lines and as numbers; else nothing."""
    from cosim.closed_loop import is_loop, limit_cycle, margins
    from cosim.hydraulics import facts, is_physical
    from cosim.ssp.read import read_system

    try:
        system = read_system(path)
    except ModelError:
        return {}  # a package that no master would run can still be looked at
    try:
        if is_physical(system):
            return facts(system)
        if not is_loop(system):
            return {}
        loop, cycle = margins(system), limit_cycle(system)
    finally:
        system.close()
    limit = (
        f"swings by itself from {loop['gain_limit']:.4g} 1/deg on; gain margin {loop['gain_margin_db']:.4g} dB at"
        f" {loop['limit_frequency']:.4g} rad/s"
        if math.isfinite(loop["gain_margin"])
        else "swings by itself at any gain with this integral"
    )
    text = (
        f"gain {loop['gain']:.4g} 1/deg, {limit},"
        f" phase margin {loop['phase_margin']:.4g} deg at {loop['crossover']:.4g} rad/s"
    )
    swing = "none"
    if cycle is not None:
        swing = (
            f"{cycle['angle']:.3g} deg and {cycle['command']:.3g} of full command at {cycle['frequency']:.4g} rad/s:"
            " the inverse gives more than the dead zone takes"
        )
    return {"position_loop": text, "limit_cycle": swing, "loop": loop | {"limit_cycle": cycle}}
