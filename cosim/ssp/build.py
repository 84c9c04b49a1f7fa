"""Build everything: the FMU of each block, packages of the three systems and of those that are closed only."""

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from cosim.errors import UsageError
from cosim.files import write_bytes
from cosim.paths import build_folder, ssp_folder
from cosim.ssp.stimulus import default_stimulus
from cosim.ssp.write import STIMULUS, fmu_bytes, write_ssp
from fmus.registry import BLOCKS

SYSTEMS = ("simplified", "full_order", "physical")
# closed only: what a controller drives has no command of its own; the extended observer takes a pressure beside it
LOOPS = ("position_loop", "position_loop_observer")
CLOSED = (*LOOPS, "full_order_extended")
Report = Callable[[Path], None]


def package_of(system: str, open_package: bool = False) -> Path:
    """Where the package of a system of ours lies once it is built."""
    return build_folder() / "ssp" / f"{system}{'_open' if open_package else ''}.ssp"


def built_package(system: str, open_package: bool = False) -> Path:
    """The package of a system of ours, built if it is missing.

    Raises:
        UsageError, ModelError: as `cosim.ssp.write.write_ssp`.
    """
    package = package_of(system, open_package)
    if not package.is_file():
        played = None if open_package else default_stimulus()
        write_ssp(ssp_folder() / f"{system}.ssd", package, stimulus=played, open=open_package)
    return package


def build_everything(out: Path, stimulus: bytes, report: Report = lambda file: None) -> dict[str, list[Path]]:
    """Build all FMUs and packages into a folder.

    Args:
        out: the folder; it receives ``fmus`` and ``ssp``. Files of the same names are replaced.
        stimulus: CSV that the stimulus plays (`cosim.ssp.stimulus.stimulus_csv`).
        report: called with each file once it is there.

    Returns:
        The files by folder name.

    Raises:
        DataError: the stimulus is bad.
        UsageError: the folder cannot be made or written to.
        ModelError: the wiring is bad, or pythonfmu could not build an FMU.
    """
    files: dict[str, list[Path]] = {"fmus": [], "ssp": []}
    try:
        for name in files:
            (out / name).mkdir(parents=True, exist_ok=True)
        _build(out, stimulus, report, files)
    except OSError as error:  # of the folder, or of the temporary one in which FMUs are made
        place = f": {error.filename}" if error.filename else ""
        raise UsageError(
            f"cannot build into '{out}' ({error.strerror or error}{place}); name another folder"
        ) from None
    return files


def _build(out: Path, stimulus: bytes, report: Report, files: dict[str, list[Path]]) -> None:
    # each FMU is built by a process of its own, so threads are enough to keep all cores busy
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        fmus = {
            name: pool.submit(fmu_bytes, name, (), stimulus if name == STIMULUS else None) for name in BLOCKS
        }
        for name, fmu in fmus.items():
            files["fmus"].append(write_file(out / "fmus" / f"{name}.fmu", fmu))
            report(files["fmus"][-1])
    for name in (*SYSTEMS, *CLOSED):
        for suffix, is_open in (("", False), ("_open", True))[: 1 if name in CLOSED else 2]:
            package = out / "ssp" / f"{name}{suffix}.ssp"
            write_ssp(
                ssp_folder() / f"{name}.ssd", package, stimulus=None if is_open else stimulus, open=is_open
            )
            files["ssp"].append(package)
            report(package)


def write_file(destination: Path, content: "Future[bytes]") -> Path:
    """Write a file all at once, when its content is there."""
    return write_bytes(destination, content.result())
