"""How long a step of the native chain takes at the worst, from a host in C at a fixed rate.

    python benchmarks/real_time.py [--seconds 60]     # a minute alone, a minute beside a busy process on each core

Prints a table for docs/native.md. Linux with a C compiler; as root, or with the right to it, the host runs first in line
(SCHED_FIFO) with its memory locked, and says so.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import fmpy

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.load import load
from cosim.native.build import compiler, write_fmu
from cosim.native.container import container
from cosim.paths import ssp_folder

SOURCE = Path(__file__).with_name("real_time.c")
PERIOD = 1_000_000  # ns
# effects of each kind in the chain at once: iterations within a step are where its time varies
EFFECTS = {
    "dead_zone": {"play": 0.01},
    "dcv": {"tau_d": 0.0123, "c_a": 1.0, "v_max": 0.02, "x_max": 2.0e-3},
    "continuity": {"k_s": 1e9, "p_c": 4e5, "s_c": 0.3},
    "mechanical": {"tau_c": 200.0, "z_s": 1e-5, "tau_s": 100.0, "tau_r": 50.0, "gap": 1e-4},
    "sensor": {"p_drop": 0.01, "tau_l": 0.01, "quantum": 1e-5},
}


@dataclass(frozen=True)
class Host:
    """The compiled host and an unpacked FMU with the input `u` and the output `slew`."""

    program: Path
    words: tuple[str, ...]

    def command(self, steps: int, period: int) -> list[str]:
        """What runs it for a number of steps."""
        return [str(self.program), *self.words, str(steps), str(period)]

    def run(self, steps: int, period: int = PERIOD) -> dict[str, float]:
        """Its figures by name; see `real_time.c`.

        Raises:
            CalledProcessError: it failed.
        """
        done = subprocess.run(self.command(steps, period), capture_output=True, text=True, check=True)
        words = done.stdout.split()
        return {name: float(value) for name, value in zip(words[::2], words[1::2], strict=True)}


def host(
    folder: Path, values: Mapping[str, Mapping[str, float]] | None = None, optimise: str | None = None
) -> Host:
    """Compile the host and the chain of the full-order model with these parameters, in a folder."""
    fmu = write_fmu(
        container(ssp_folder() / "full_order.ssd", "crane", values), folder / "crane.fmu", optimise=optimise
    )
    unpacked = Path(fmpy.extract(str(fmu), unzipdir=str(folder / "crane")))
    description = fmpy.read_model_description(str(unpacked), validate=False)
    references = {v.name: v.valueReference for v in description.modelVariables}
    program = folder / "real_time"
    options = ["-std=gnu99", "-O2", "-Wall", "-Wextra", "-o", str(program), str(SOURCE), "-ldl", "-lm"]
    subprocess.run([*compiler(), *options], check=True)
    library = unpacked / "binaries" / fmpy.platform / f"crane{fmpy.sharedLibraryExtension}"
    words = (str(library), (unpacked / "resources").as_uri(), description.guid)
    return Host(program, (*words, str(references["u"]), str(references["slew"])))


def calls_while_stepping(given: Host, steps: int, folder: Path) -> list[str]:
    """System calls between the two marks of the loop, as strace writes them; it runs as fast as it can.

    Raises:
        RuntimeError: there is no strace, or it may not trace.
    """
    if shutil.which("strace") is None:
        raise RuntimeError("strace is not installed")
    told = folder / "calls.txt"
    command = ["strace", "-f", "-o", str(told), *given.command(steps, 0)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"strace could not run it: {done.stderr[-300:]}")
    lines = told.read_text().splitlines()
    first, last = (k for k, line in enumerate(lines) if re.search(r"\bgetppid\(", line))
    return lines[first + 1 : last]


def row(what: str, found: Mapping[str, float]) -> str:
    """A line of the table, in microseconds."""
    times = [f"{found[n] / 1e3:.2f}" for n in ("half", "p999", "most", "late_half", "late_p999", "late_most")]
    counts = [f"{found[n]:.0f}" for n in ("missed", "allocations", "faults", "preempted")]
    return f"| {' | '.join([what, *times, *counts])} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=int, default=60, help="of each run at 1 kHz")
    steps = parser.parse_args().seconds * 1000
    with tempfile.TemporaryDirectory(prefix="real_time_") as scratch:
        folders = [Path(scratch, n) for n in ("nominal", "effects")]
        for folder in folders:
            folder.mkdir()
        nominal, effects = host(folders[0]), host(folders[1], EFFECTS)
        try:
            print(f"system calls in 100 000 steps: {len(calls_while_stepping(effects, 100_000, folders[1]))}")
        except RuntimeError as error:
            print(f"system calls were not counted: {error}")
        print(
            "| | step, half | 99.9 % | most | late, half | 99.9 % | most | missed | allocations | page faults | preempted |"
        )
        print("|---|---|---|---|---|---|---|---|---|---|---|")
        for what, given in (("nominal", nominal), ("effects on", effects)):
            print(row(f"{what}, as fast as it can", given.run(steps, 0)), flush=True)
        alone = effects.run(steps)
        print(row("effects on, 1 kHz, alone", alone), flush=True)
        with load(os.cpu_count() or 1):
            print(row("effects on, 1 kHz, beside busy processes", effects.run(steps)), flush=True)
        print(
            f"first in line: {'yes' if alone['fifo'] else 'no'}; memory locked: {'yes' if alone['locked'] else 'no'}"
        )


if __name__ == "__main__":
    main()
