"""The plain C host of the table of clients: a master without Python, for what a foreign host meets.

`host.c` reads a plan that is written here, and prints the outputs of each step.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.export import ExportedModel
from cosim.native.build import PLATFORMS, MissingCompilerError, cross_compiler

Array = NDArray[np.float64]
TIMEOUT = 120.0
# what runs a program for another platform here, and what a path of ours begins with there
EMULATED = ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu")
LAUNCHERS: dict[str, tuple[tuple[str, ...], str]] = {
    "win64": (("wine",), "Z:"),
    "aarch64-linux": (EMULATED, ""),
    "x86_64-darwin": ((), ""),
    "aarch64-darwin": (EMULATED, ""),
}
# a Mac's library is brought into a host of Linux by a loader of ours (`macho.c`): what the host is compiled for
LOADED_ON = {"x86_64-darwin": None, "aarch64-darwin": "aarch64-linux"}


class EndError(RuntimeError):
    """A process gave all its results and then crashed; `found` holds them."""

    def __init__(self, message: str, found: dict[str, Array]) -> None:
        super().__init__(message)
        self.found = found


def run_host(
    host: Path,
    model: ExportedModel,
    steps: int,
    h: float,
    signals: Sequence[str],
    preload: Path | None,
    platform: str | None = None,
) -> dict[str, Array]:
    """Run a system in the plain C host, or in that of another platform; each signal of shape (steps + 1,).

    Raises:
        EndError: the process crashed after its last row.
        RuntimeError: it failed before; the message holds what it wrote.
    """
    with tempfile.TemporaryDirectory(prefix="host_") as scratch:
        plan = Path(scratch, "plan.txt")
        plan.write_text(_plan(model, signals, platform), encoding="utf-8")
        variables = dict(os.environ)
        if preload is not None:
            variables |= {"LD_PRELOAD": str(preload), "PYTHONPATH": sysconfig.get_paths()["purelib"]}
        launcher, root = LAUNCHERS[platform] if platform else ((), "")
        words = [*launcher, str(host), root + str(plan), str(steps), repr(h)]
        done = subprocess.run(
            words, env=variables, cwd=scratch, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    lines = done.stdout.splitlines()
    message = f"ended with {done.returncode}: {done.stderr[-2000:]}"
    if len(lines) != steps + 1:
        raise RuntimeError(message)
    rows = np.array([line.split() for line in lines], dtype=float)
    found = {"time": rows[:, 0], **dict(zip(signals, rows[:, 1:].T, strict=True))}
    if done.returncode != 0:
        raise EndError(f"all results are there, then the process {message}", found)
    return found


def _plan(model: ExportedModel, signals: Sequence[str], platform: str | None) -> str:
    system = model.system
    place = {name: k for k, name in enumerate(model.order)}
    lines = []
    for name in model.order:
        component = system.components[name]
        fmu = component.fmu
        third = fmu.version != "2.0"
        known = PLATFORMS[platform or "linux64"]
        root = LAUNCHERS[platform][1] if platform else ""
        library = f"{root}{fmu.folder}/binaries/{known.folders[fmu.version]}/{fmu.identifier}{known.suffix}"
        uri = f"file:///{root}{fmu.folder}" if root else f"file://{fmu.folder}"
        resources = f"{root}{fmu.folder}/resources/" if third else f"{uri}/resources"
        lines.append(f"component {name} {library} {resources} {fmu.guid}")
        for key, value in component.starts.items():
            declared = fmu.variables[key]
            lines.append(f"{declared.kind.lower()} {declared.reference} {value!r}")
    for wire in system.wires:
        ends = (wire.source, wire.target)
        numbers = " ".join(f"{place[p.component]} {system.variable(p).reference}" for p in ends)
        lines.append(f"wire {numbers} {int(wire in model.late)}")
    for signal in signals:
        owner, _, port = signal.partition(".")
        lines.append(f"output {place[owner]} {system.components[owner].fmu.variables[port].reference}")
    return "\n".join(lines) + "\n"


def libpython() -> Path | None:
    """The shared library of this Python, or None if it has none."""
    variables = sysconfig.get_config_vars()
    library = Path(variables.get("LIBDIR") or "", variables.get("INSTSONAME") or "")
    return library if library.is_file() and ".so" in library.name else None


def compiled_host(folder: Path, fmi: int = 2, platform: str | None = None) -> Path | None:
    """The plain C host for FMI 2.0 or 3.0, for this or another platform, compiled, or None where that is not possible."""
    if not sys.platform.startswith("linux"):
        return None
    mac = platform in LOADED_ON
    runs_on = LOADED_ON[platform] if mac and platform else platform
    if runs_on is not None:
        try:
            command = cross_compiler(runs_on)
        except MissingCompilerError:
            return None
    else:
        command = [shutil.which("cc") or ""]
    if not command[0]:
        return None
    host = folder / f"host{fmi}{'.exe' if platform == 'win64' else ''}"
    files = [str(Path(__file__).with_name(name)) for name in ("host.c", *(["macho.c"] if mac else []))]
    libraries = [] if platform == "win64" else ["-ldl"]
    # its libraries ask for libm's functions, which are there only if the host has them
    loader = ["-Ddlopen=mac_open", "-Ddlsym=mac_symbol", "-Ddlerror=mac_error", "-Wl,--no-as-needed", "-lm"]
    options = [
        "-std=gnu99",
        "-O1",
        "-Wall",
        f"-DFMI={fmi}",
        *(loader if mac else []),
        "-o",
        str(host),
        *files,
        *libraries,
    ]
    subprocess.run([*command, *options], check=True)
    return host
