"""Build all native FMUs and packages: the twins of `cosim.ssp.build.build_everything`, and each chain as one FMU."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from cosim.errors import UsageError
from cosim.native.build import compiler, further, write_fmu
from cosim.native.container import container
from cosim.native.package import native_bytes, write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.build import CLOSED, SYSTEMS, write_file
from cosim.ssp.write import STIMULUS
from fmus.registry import BLOCKS

Report = Callable[[Path], None]


FOLDERS = {"2.0": "native", "3.0": "native_fmi3"}


def build_everything_native(
    out: Path,
    stimulus: bytes,
    report: Report = lambda file: None,
    fmi: str = "2.0",
    platforms: Sequence[str] = (),
) -> dict[str, list[Path]]:
    """Build into the folder ``native`` of `out`: ``fmus`` with every block and every chain, ``ssp`` with every package.

    Those of FMI 3.0 go into ``native_fmi3``; the packages are of SSP 1.0 too, and few clients take both.

    Args:
        out: the folder that the Python FMUs are built into; files of the same names are replaced.
        stimulus: CSV that the stimulus plays (`cosim.ssp.stimulus.stimulus_csv`).
        report: called with each file once it is there.
        fmi: version of the standard, 2.0 or 3.0.
        platforms: other platforms whose binaries each FMU gets too (`cosim.native.build.PLATFORMS`).

    Returns:
        The files by folder name.

    Raises:
        MissingCompilerError: there is no C compiler, for this machine or another platform.
        DataError: the stimulus is bad.
        UsageError: the folder cannot be made, or a platform is not known.
        ModelError: the wiring is bad, an equation has no translation, or the compiler failed.
    """
    compiler()
    others = further(platforms)
    top = out / FOLDERS[fmi]
    found: dict[str, list[Path]] = {"fmus": [], "ssp": []}
    try:
        for name in found:
            (top / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot build into '{top}' ({error.strerror}); name another folder") from None

    def done(kind: str, file: Path) -> None:
        found[kind].append(file)
        report(file)

    # the compiler is a process of its own, so threads are enough to keep all cores busy
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        blocks: dict[str, Future[bytes]] = {
            name: pool.submit(native_bytes, name, (), stimulus if name == STIMULUS else None, fmi, others)
            for name in BLOCKS
        }
        chains = [container(ssp_folder() / f"{name}.ssd") for name in SYSTEMS]
        made = [
            pool.submit(write_fmu, model, top / "fmus" / f"{model.name}.fmu", fmi=fmi, platforms=others)
            for model in chains
        ]
        for name, fmu in blocks.items():
            done("fmus", write_file(top / "fmus" / f"{name}.fmu", fmu))
        for chain in made:
            done("fmus", chain.result())
    for name in SYSTEMS:
        wiring = ssp_folder() / f"{name}.ssd"
        done(
            "ssp",
            write_native_ssp(
                wiring, top / "ssp" / f"{name}.ssp", stimulus=stimulus, fmi=fmi, platforms=others
            ),
        )
        done(
            "ssp",
            write_native_ssp(wiring, top / "ssp" / f"{name}_open.ssp", open=True, fmi=fmi, platforms=others),
        )
    for name in CLOSED:
        done(
            "ssp",
            write_native_ssp(
                ssp_folder() / f"{name}.ssd",
                top / "ssp" / f"{name}.ssp",
                stimulus=stimulus,
                fmi=fmi,
                platforms=others,
            ),
        )
    return found
