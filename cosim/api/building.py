"""FMUs and packages as they are asked for: built, checked, written for other tools."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim import console
from cosim.errors import CosimError, UsageError

if TYPE_CHECKING:
    from cosim.ssp import Problem


def build(
    folder: Path,
    stimulus: Path | None = None,
    mapping: Path | None = None,
    *,
    native: bool = False,
    fmi: str = "2.0",
    platforms: Sequence[str] = (),
    told: Callable[[Path], None] = lambda file: None,
) -> dict[str, list[Path]]:
    """Build the FMU of each block and the packages of the systems.

    Args:
        folder: to build into.
        stimulus: a log whose command the closed packages play; by default 20 s of sine and steps.
        mapping: mapping file of that log.
        native: FMUs in C, which need no Python.
        fmi: 2.0 or, native, 3.0.
        platforms: further ones, native.
        told: called with each file that is there.

    Raises:
        UsageError: options that do not go together.
        DataError: the log is bad, or has no command or no time.
    """
    if fmi not in ("2.0", "3.0"):
        raise UsageError(f"--fmi {fmi}: FMUs of FMI 2.0 and 3.0 can be built")
    if fmi == "3.0" and not native:
        raise UsageError("--fmi 3.0 needs --native: the FMUs that run in Python are of FMI 2.0")
    if platforms and not native:
        raise UsageError(
            "--platform needs --native: the FMUs that run in Python hold the binaries of pythonfmu"
        )
    played = stimulus_of(stimulus, mapping)
    if native:
        from cosim.native.everything import build_everything_native

        return build_everything_native(folder, played, told, fmi, platforms)
    from cosim.ssp.build import build_everything

    return build_everything(folder, played, told)


def stimulus_of(log: Path | None, mapping: Path | None) -> bytes:
    """The CSV to play: the command of a log, from its first sample on, or the default one.

    Raises:
        DataError: the log is bad, or has no command or no time.
        UsageError: a mapping without a log.
    """
    from cosim.errors import DataError
    from cosim.ssp.stimulus import default_stimulus, stimulus_csv

    if log is None:
        if mapping is not None:
            raise UsageError("--mapping says how to read a log, so it needs --with-stimulus")
        return default_stimulus()
    from cosim.logs import load_log

    loaded = load_log(log, mapping)
    for warning in loaded.warnings:
        console.warn(warning)
    if loaded.time_unit != "s":
        raise DataError(f"'{log}' has no time, so its command cannot be played: add a column 'time [s]'")
    return stimulus_csv(loaded.time - loaded.time[0], loaded["u"])


def build_missing(folder: Path) -> None:
    """Build all FMUs and packages unless all are there.

    Raises:
        UsageError: the folder cannot be made.
    """
    from cosim.ssp.build import SYSTEMS, build_everything
    from cosim.ssp.stimulus import default_stimulus
    from fmus.registry import BLOCKS

    wanted = [folder / "fmus" / f"{name}.fmu" for name in BLOCKS]
    wanted += [folder / "ssp" / f"{name}{suffix}.ssp" for name in SYSTEMS for suffix in ("", "_open")]
    missing = [file for file in wanted if not file.is_file()]
    if missing:
        with console.progress("building FMUs and packages", len(wanted)) as advance:
            done: list[Path] = []

            def report(file: Path) -> None:
                done.append(file)
                advance(len(done))

            build_everything(folder, default_stimulus(), report)
        console.stderr_console().print(f"built {len(wanted)} files in {folder}", markup=False, soft_wrap=True)


def validate(files: Sequence[Path]) -> "dict[str, list[Problem]]":
    """Check files, or systems of ours by name, against FMI 2.0 or 3.0 and SSP 1.0, and for what makes clients stumble.

    Raises:
        UsageError: one is no .ssp, .fmu or .ssv.
        ModelError: a system of ours is not built, and cannot be.
    """
    from cosim.request import model_path
    from cosim.ssp import check_fmu, check_ssp, check_ssv
    from cosim.ssp.build import CLOSED, SYSTEMS

    files = [model_path(str(f)) if str(f) in (*SYSTEMS, *CLOSED) else f for f in files]
    checks = {".ssp": check_ssp, ".fmu": check_fmu, ".ssv": check_ssv}
    for file in files:
        if file.suffix.lower() not in checks:
            raise UsageError(f"{file}: only {', '.join(checks)} files can be checked")
    return {str(file): checks[file.suffix.lower()](file) for file in files}


def is_taken(file: Path) -> bool:
    """Whether a model that breaks its standard can be read here all the same, by those who run it."""
    from cosim.ssp.read import read_system

    try:
        with read_system(file):
            return True
    except CosimError:
        return False


def export(
    tool: str,
    model: str,
    out: Path,
    *,
    open_package: bool = False,
    parameter_sets: Sequence[Path] = (),
    settings: Sequence[str] = (),
    step_size: str | None = None,
    stop_time: str | None = None,
    overwrite: bool = False,
    equations: bool = False,
    blocks: str = "fmu",
) -> list[Path]:
    """Write a system for a tool that cannot read an SSP.

    A system by name is exported with native FMUs where there is a C compiler; a package with those that it has, unless
    S-functions need native ones in their place.

    Args:
        tool: simulink or modelica.
        model: simplified, full_order, physical, or an .ssp or .fmu file.
        out: folder, new or empty.
        open_package: of a model by name, the package whose inputs are ports.
        parameter_sets: .ssv files.
        settings: such as ``"mechanical.J=900 kg.m2"``, stronger than these.
        step_size: such as ``"1 ms"``; by default the FMUs' own.
        stop_time: such as ``"20 s"``; by default the system's, or 10 s.
        overwrite: write into a folder that holds files.
        equations: of Modelica: the blocks as equations, without FMUs.
        blocks: of Simulink: ``fmu`` or ``s-function``.

    Raises:
        UsageError, ModelError: the request or the model is bad.
        MissingCompilerError: S-functions need native FMUs, and there is no C compiler.
    """
    from cosim.api.simulating import native_or_not
    from cosim.export import prepare, write_modelica, write_simulink
    from cosim.request import model_path, parameters, seconds
    from cosim.ssp.read import read_system

    write = (
        partial(write_simulink, blocks=blocks)
        if tool == "simulink"
        else partial(write_modelica, equations=equations)
    )
    step = seconds(step_size, "--step-size") if step_size else None
    stop = seconds(stop_time, "--stop-time") if stop_time else None
    path = model_path(model, with_input=open_package)
    native = not equations and _to_be_native(path, by_name=not Path(model).suffix, must=blocks != "fmu")
    with native_or_not(path, native) as file, read_system(file) as system:
        values = parameters(system, list(parameter_sets), list(settings))
        prepared = prepare(system, values, step, stop)
        for note in system.notes:
            console.warn(note)
        return write(prepared, out, overwrite)


def _to_be_native(path: Path, by_name: bool, must: bool) -> bool:
    """Whether an export takes native FMUs in place of a package's Python ones."""
    from cosim.native.build import MissingCompilerError, compiler
    from cosim.ssp.read import read_system

    if must:
        with read_system(path) as system:
            return any(component.fmu.module is not None for component in system.components.values())
    if by_name:  # a system of ours, whose FMUs are Python ones
        try:
            compiler()
        except MissingCompilerError:
            console.warn(
                "there is no C compiler, so the FMUs exported are those that need Python on the host"
            )
            return False
    return by_name


def machine_model(mapping: Path, out: Path, log: Path | None = None) -> dict[str, Any]:
    """Write the model of a machine for other tools: wiring, values and package, made from its chain of blocks.

    Args:
        mapping: mapping file with a table ``machine``.
        out: folder for .ssd, .ssv and .ssp.
        log: of the machine; tells what the file leaves open.

    Returns:
        Chain, parameters with unit and source, files, and how to diagnose with it.

    Raises:
        DataError, UsageError: the mapping or the log is bad.
    """
    from cosim.logs import load_log
    from cosim.machines import write_machine

    loaded = load_log(log, mapping) if log is not None else None
    for warning in loaded.warnings if loaded is not None else ():
        console.warn(warning)
    made, files = write_machine(mapping, out, loaded)
    for note in made.table.notes:
        console.warn(note)
    values: dict[str, Any] = {}
    for name, value in made.numbers.values.items():
        unit = made.machine.unit(name)
        stated = name in made.machine.parameters and name not in made.numbers.from_log
        source = "stated" if stated else "from the log" if name in made.numbers.from_log else "by default"
        values[name] = {"value": value, "unit": unit, "source": source}
    return {"machine": str(mapping), "chain": list(made.machine.chain), "parameters": values,
            "diagnose": made.diagnose, "files": [str(f) for f in files]}  # fmt: skip
