"""Run a package in one engine, in a process of its own: ``python benchmarks/engines.py ENGINE PACKAGE OUT.npz``.

The engines differ in what they record and how; this brings their results to one form: named arrays of equal length and
``time``, the time that the engine itself puts beside each row. `run_engine` starts the process.
"""

import argparse
import contextlib
import ctypes
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TOP = Path(__file__).resolve().parent.parent
SIGNALS = ("dcv.spool", "continuity.p_load", "mechanical.theta", "sensor.slew", "observer.slew_estimate")
PARAMETER_SET = "nominal"


def run_fmpy(package: Path, steps: int, h: float, signals: Sequence[str]) -> tuple[dict[str, Array], float]:
    """The simulate_ssp of fmpy; the whole call is timed, since it cannot be split."""
    from fmpy.ssp.simulation import simulate_ssp

    began = time.perf_counter()
    rows = simulate_ssp(str(package), stop_time=(steps - 0.5) * h, step_size=h)
    seconds = time.perf_counter() - began
    return {"time": rows["time"], **{name: rows[name] for name in signals}}, seconds


def keep_loaded() -> None:
    """To be called before ecospy is imported: a library that TBB loads beside itself stays until the process is gone.

    When its last worker thread ends, TBB unloads libtcm. At the end of the process the main thread runs that library's
    destructor, and if the code is gone meanwhile, a process that has done all its work dies of SIGSEGV.
    """
    with contextlib.suppress(OSError):  # a TBB without it has nothing to unload
        ctypes.CDLL("libtcm.so.1", mode=os.RTLD_NODELETE)


def run_ecos(package: Path, steps: int, h: float, signals: Sequence[str]) -> tuple[dict[str, Array], float]:
    """Ecos, with the parameter set applied by name; read through its interface, because its CSV has six digits."""
    keep_loaded()
    from ecospy import EcosLib, EcosSimulation

    EcosLib.set_log_level("warn")
    names = [name.replace(".", "::") for name in signals]
    table = np.empty((steps + 1, len(names) + 1))
    with EcosSimulation(h, ssp_path=str(package)) as simulation:
        if not simulation.init(parameter_set=PARAMETER_SET):
            raise RuntimeError(EcosLib.get_last_error())
        read = simulation.get_real
        table[0] = [simulation.get_time(), *map(read, names)]
        began = time.perf_counter()
        for k in range(1, steps + 1):
            table[k] = [simulation.step(), *map(read, names)]
        seconds = time.perf_counter() - began
        simulation.terminate()
    return {"time": table[:, 0], **dict(zip(signals, table[:, 1:].T, strict=True))}, seconds


def run_ecos_csv(
    package: Path, steps: int, h: float, signals: Sequence[str]
) -> tuple[dict[str, Array], float]:
    """Ecos with its own CSV writer (six digits) and one call for all steps: the fastest way to use it."""
    keep_loaded()
    from ecospy import EcosLib, EcosSimulation

    EcosLib.set_log_level("warn")
    file = Path("ecos.csv").absolute()
    with EcosSimulation(h, ssp_path=str(package)) as simulation:
        simulation.add_csv_writer(str(file), identifiers=[name.replace(".", "::") for name in signals])
        if not simulation.init(parameter_set=PARAMETER_SET):
            raise RuntimeError(EcosLib.get_last_error())
        began = time.perf_counter()
        simulation.step(steps)
        seconds = time.perf_counter() - began
        simulation.terminate()
    header = [cell.strip().partition("[")[0] for cell in file.read_text().partition("\n")[0].split(",")]
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    columns = {name: table[:, header.index(name.replace(".", "::"))] for name in signals}
    return {"time": h * np.arange(steps + 1.0), **columns}, seconds  # its stamps have six digits too


def run_cosim(package: Path, steps: int, h: float, signals: Sequence[str]) -> tuple[dict[str, Array], float]:
    """Our own runner, after a run of ten steps that loads the compiled loop; an open package gets the usual command."""
    from cosim.master import Runner
    from cosim.ssp.stimulus import default_command

    with Runner(package, apart=False) as runner:  # the floor is no build of ours
        inputs = {"u": default_command(steps * h)} if "u" in runner.system.inputs else {}
        runner.run(10 * h, h, record=list(signals), inputs=inputs)
        began = time.perf_counter()
        result = runner.run(steps * h, h, record=list(signals), inputs=inputs)
        seconds = time.perf_counter() - began
        return {"time": result.time, **{name: result.signals[name] for name in signals}}, seconds


def run_libcosim(
    package: Path, steps: int, h: float, signals: Sequence[str]
) -> tuple[dict[str, Array], float]:
    """libcosim, with the step that the package's own annotation asks for and its time series observer."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_ssp_file(str(package))
    observer = CosimObserver.create_time_series(buffer_size=steps + 1)
    execution.add_observer(observer)
    places = []
    for name in signals:
        slave, _, variable = name.partition(".")
        index = execution.slave_index_from_instance_name(slave)
        reference = next(v.reference for v in execution.slave_variables(index) if v.name.decode() == variable)
        observer.start_time_series(index, reference, CosimVariableType.REAL)
        places.append((index, reference))
    began = time.perf_counter()
    if not execution.step(steps):
        raise RuntimeError("libcosim could not step")
    seconds = time.perf_counter() - began
    columns = [observer.time_series_real_samples(*place, 1, steps) for place in places]
    stamps = np.array(columns[0][0], dtype=float) * 1e-9
    values = {name: np.array(column[2], dtype=float) for name, column in zip(signals, columns, strict=True)}
    return {"time": stamps, **values}, seconds


def run_fmucontainer(
    package: Path, steps: int, h: float, signals: Sequence[str]
) -> tuple[dict[str, Array], float]:
    """FMUContainer of the FMU Manipulation Toolbox: its own master as one FMU around ours, which fmpy runs.

    It reads the package. What no wire takes it leaves out, so the signals are added to what it read.
    """
    import fmpy
    from fmpy.ssp.ssd import read_ssd

    source = package.resolve()
    # it writes where it stands
    with tempfile.TemporaryDirectory(prefix="container_") as scratch, contextlib.chdir(scratch):
        own = Path(package.name)
        shutil.copyfile(source, own)
        sources = {
            component.name: Path(component.source).name for component in read_ssd(str(own)).system.elements
        }
        with zipfile.ZipFile(own) as outer:
            first = next(n for n in outer.namelist() if n.endswith(".fmu"))
            version = fmpy.read_model_description(io.BytesIO(outer.read(first)), validate=False).fmiVersion[0]
        _make_container("-container", f"{own}:{h!r}", "-dump-json")
        read = json.loads(Path(f"{own.stem}-dump.json").read_text(encoding="utf-8"))
        places = {Path(file).name: file for file in read["fmu"]}
        outputs = []
        for signal in signals:
            component, _, variable = signal.partition(".")
            outputs.append([places[sources[component]], variable, f"wanted.{signal}"])
        Path("wanted.json").write_text(
            json.dumps(read | {"name": "wanted.fmu", "output": outputs}), encoding="utf-8"
        )
        for name in read["fmu"]:  # which it has taken away
            Path(name).parent.mkdir(exist_ok=True)
            with zipfile.ZipFile(own) as outer:
                Path(name).write_bytes(outer.read(f"resources/{Path(name).name}"))
        _make_container("-container", "wanted.json", "-fmi", version)
        began = time.perf_counter()
        rows = fmpy.simulate_fmu(
            "wanted.fmu",
            stop_time=steps * h,
            output_interval=h,
            output=[f"wanted.{signal}" for signal in signals],
        )
        seconds = time.perf_counter() - began
    if len(rows) != steps + 1:
        raise RuntimeError(f"{len(rows)} rows instead of {steps + 1}")
    return {"time": rows["time"], **{name: rows[f"wanted.{name}"] for name in signals}}, seconds


def _make_container(*words: str) -> None:
    from fmu_manipulation_toolbox.cli import fmucontainer

    sys.argv = ["fmucontainer", *words]
    fmucontainer.fmucontainer()


# a client -> the module that its package brings
MODULES = {
    "fmpy": "fmpy",
    "ecos": "ecospy",
    "libcosim": "libcosimpy",
    "fmucontainer": "fmu_manipulation_toolbox",
}

ENGINES: dict[str, Callable[[Path, int, float, Sequence[str]], tuple[dict[str, Array], float]]] = {
    "cosim": run_cosim,
    "fmpy": run_fmpy,
    "ecos": run_ecos,
    "ecos_csv": run_ecos_csv,
    "libcosim": run_libcosim,
    "fmucontainer": run_fmucontainer,
}


def tbb_folder() -> Path:
    """Folder of the libtbb that ecos needs, as the package tbb installs it."""
    return Path(sys.prefix) / "lib"


def environment() -> Mapping[str, str]:
    """The environment of this process, with what ecos and this package need to be found."""
    extended = dict(os.environ)
    for name, folder in {"LD_LIBRARY_PATH": tbb_folder(), "PYTHONPATH": TOP}.items():
        extended[name] = os.pathsep.join([str(folder), *filter(None, [os.environ.get(name)])])
    return extended


def run_engine(
    engine: str,
    package: Path,
    *,
    steps: int,
    h: float = 1e-3,
    signals: Sequence[str] = SIGNALS,
    timeout: float = 300.0,
    core: int | None = None,
) -> tuple[dict[str, Array], float]:
    """Run a package in an engine, in a process of its own.

    Args:
        engine: a name of `ENGINES`.
        package: the .ssp file.
        steps: how many steps.
        h: step size, s.
        signals: what to record, "component.variable".
        timeout: s, for the whole process.
        core: the only processor core to use, or None for all.

    Returns:
        Results by name, with "time", and the seconds that stepping took.

    Raises:
        RuntimeError: the process failed; the message holds what it wrote.
    """
    with tempfile.TemporaryDirectory(prefix="engine_") as scratch:
        out = Path(scratch, "out.npz")
        command = [sys.executable, str(Path(__file__).resolve()), engine, str(package.resolve()), str(out)]
        command += ["--steps", str(steps), "--step-size", repr(h), "--signals", *signals]
        if core is not None:
            command += ["--core", str(core)]
        done = subprocess.run(
            command,
            env=environment(),
            cwd=scratch,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        if done.returncode != 0 or not out.exists():
            raise RuntimeError(
                f"{engine} ended with {done.returncode}: {done.stderr[-2000:]}{done.stdout[-2000:]}"
            )
        with np.load(out) as stored:
            results = {name: stored[name] for name in stored.files}
    return results, float(results.pop("seconds"))


def main() -> None:
    """Runs one engine in this process and stores its results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("engine", choices=sorted(ENGINES))
    parser.add_argument("package", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--step-size", type=float, default=1e-3)
    parser.add_argument("--signals", nargs="+", default=list(SIGNALS))
    parser.add_argument("--core", type=int)
    options = parser.parse_args()
    if options.core is not None:
        os.sched_setaffinity(0, {options.core})
    results, seconds = ENGINES[options.engine](
        options.package, options.steps, options.step_size, options.signals
    )
    np.savez(options.out, **results | {"seconds": np.array(seconds)})


if __name__ == "__main__":
    main()
