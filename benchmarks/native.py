"""How fast native FMUs are: ``python benchmarks/native.py [--duration 60] [--repeat 7] [--json FILE]``.

The full-order chain at 1 ms in one process, the ways interleaved, in CPU time of the stepping, the best of each. The limit
is a C loop over the same equations, compiled with the same options and without FMI; rows of all outputs are kept everywhere.
"""

import argparse
import ctypes
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.runner import machine
from cosim.console import stdout_console, table
from cosim.master import Runner, engine
from cosim.native.build import FLAGS, OPTIMISED, compiler, write_fmu
from cosim.native.container import container
from cosim.native.package import write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.stimulus import default_command
from cosim.ssp.write import write_ssp

Array = NDArray[np.float64]
H = 1e-3


class CpuClock:
    """In place of the clock by which our runner measures its loop: other work on the machine shall not count."""

    perf_counter = staticmethod(time.thread_time)


SSD = ssp_folder() / "full_order.ssd"
# driven through FMI as a host in C would, and the equations alone
LOOPS = """
#include "fmu.c"

int through_fmi(const char *resources, const double *u, long n, double *rows) {
    static const fmi2CallbackFunctions host = {NULL, NULL, NULL, NULL, NULL};
    const fmi2ValueReference entry = 0;
    fmi2ValueReference outputs[N_OUTPUTS];
    fmi2Component c = fmi2Instantiate("c", fmi2CoSimulation, MODEL_GUID, resources, &host, 0, 0);
    int status = 0;
    long k;
    for (k = 0; k < N_OUTPUTS; k++) {
        outputs[k] = (fmi2ValueReference)(N_INPUTS + k);
    }
    status |= fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) | fmi2SetReal(c, &entry, 1, u);
    status |= fmi2EnterInitializationMode(c) | fmi2ExitInitializationMode(c);
    for (k = 0; k < n; k++) {
        status |= fmi2SetReal(c, &entry, 1, u + k);
        status |= fmi2DoStep(c, (double)k * 1e-3, 1e-3, fmi2True);
        status |= fmi2GetReal(c, outputs, N_OUTPUTS, rows + k * N_OUTPUTS);
    }
    fmi2FreeInstance(c);
    return status;
}

int equations_alone(const double *u, long n, double *rows) {
    static Model model;
    double outputs[N_OUTPUTS];
    int fault = 0;
    long k;
    model_link(&model);
    model_parameters(&model, model_starts + N_INPUTS + N_OUTPUTS);
    model_begin(&model, u, outputs, 0.0, &fault);
    model_coefficients(&model, 1e-3, &fault);
    for (k = 0; k < n; k++) {
        model_step(&model, u + k, outputs, (double)(k + 1) * 1e-3, &fault);
        memcpy(rows + k * N_OUTPUTS, outputs, sizeof outputs);
    }
    return fault;
}
"""


def in_runner(runner: Runner, signal: str, times: Array, command: Array) -> Callable[[], tuple[float, Array]]:
    """A run under our runner: seconds of its loop, and the slew angle after each step."""

    def run() -> tuple[float, Array]:
        result = runner.run(float(times[-1]), H, inputs={"u": (times, command)})
        return result.wall_time, result.signals[signal][1:]

    return run


def in_c(
    function: Callable[..., int], *first: object, command: Array, place: int
) -> Callable[[], tuple[float, Array]]:
    """A run of one of the C loops."""
    n = len(command) - 1
    rows = np.zeros((n, 13))
    pointer = ctypes.POINTER(ctypes.c_double)

    def run() -> tuple[float, Array]:
        began = time.thread_time()
        status = function(
            *first, command.ctypes.data_as(pointer), ctypes.c_long(n), rows.ctypes.data_as(pointer)
        )
        seconds = time.thread_time() - began
        assert status == 0
        return seconds, rows[:, place].copy()

    return run


def c_loops(fmu: Path, folder: Path) -> ctypes.CDLL:
    """The C loops over the sources of an FMU."""
    sources = Path(fmpy.extract(str(fmu), str(folder))) / "sources"
    (sources / "loops.c").write_text(LOOPS, encoding="utf-8")
    flags = [f for f in FLAGS if not f.startswith("-fvisibility")]
    command = [*compiler(), *flags, OPTIMISED, "loops.c", "-lm", "-o", "loops.so"]
    subprocess.run(command, cwd=sources, check=True)
    return ctypes.CDLL(str(sources / "loops.so"))


def measure(duration: float, repeat: int) -> list[dict[str, object]]:
    """As `compare`, with our runner's loop in CPU time too."""
    kept, engine.clock = engine.clock, CpuClock
    try:
        return compare(duration, repeat)
    finally:
        engine.clock = kept


def compare(duration: float, repeat: int) -> list[dict[str, object]]:
    """All ways, interleaved; the best of each, and the largest difference of the slew angle from the first way."""
    times, command = default_command(duration)
    with tempfile.TemporaryDirectory(prefix="native_") as scratch:
        folder = Path(scratch)
        python = write_ssp(SSD, folder / "python.ssp", open=True)
        native = write_native_ssp(SSD, folder / "native.ssp", open=True)
        model = container(SSD)
        whole = write_fmu(model, folder / f"{model.name}.fmu")
        loops = c_loops(whole, folder / "unpacked")
        place = [n for n, _ in model.of("output")].index("theta")
        resources = ctypes.c_char_p(str(folder).encode())
        with Runner(python) as one, Runner(native) as two, Runner(whole) as three:
            ways = {
                "Python FMUs, our runner": in_runner(one, "mechanical.theta", times, command),
                "native FMUs, our runner": in_runner(two, "mechanical.theta", times, command),
                "one native FMU, our runner": in_runner(three, f"{model.name}.theta", times, command),
                "one native FMU, host in C": in_c(loops.through_fmi, resources, command=command, place=place),
                "limit: equations in a C loop": in_c(loops.equations_alone, command=command, place=place),
            }
            runs: dict[str, list[float]] = {label: [] for label in ways}
            angles = {}
            for turn in range(repeat + 1):
                for label, run in ways.items():
                    seconds, angles[label] = run()
                    if turn:  # the first run only warms up
                        runs[label].append(seconds)
    best = {label: min(found) for label, found in runs.items()}
    slowest, limit = next(iter(best.values())), list(best.values())[-1]
    reference = next(iter(angles.values()))
    return [
        {
            "way": label,
            "microseconds_per_step": seconds / (len(times) - 1) * 1e6,
            "times_real_time": duration / seconds,
            "times_python_fmus": slowest / seconds,
            "times_limit": seconds / limit,
            "largest_difference": float(np.max(np.abs(angles[label] - reference))),
        }
        for label, seconds in best.items()
    ]


def main() -> int:
    """Runs the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=60.0, help="simulated time, s")
    parser.add_argument("--repeat", type=int, default=7, help="repetitions, of which the best counts")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    options = parser.parse_args()
    rows = measure(options.duration, options.repeat)
    headers = ("way", "us a step", "x real time", "x Python FMUs", "limit x", "difference rad")
    title = f"Full order, {options.duration:g} s at 1 ms"
    stdout_console().print(table(title, headers, [tuple(row.values()) for row in rows]))
    found = machine()
    print(", ".join(f"{name} {value}" for name, value in found.items()))
    if options.json:
        result = {"machine": found, "duration": options.duration, "repeat": options.repeat, "rows": rows}
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
