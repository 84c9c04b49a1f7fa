"""Reference inputs and results of every FMU, as in Reference-FMUs: ``python tests/reference/make.py``.

Per FMU three small files: <name>_in.csv, the inputs over time (a time that stands twice is a jump); <name>_ref.csv, the
outputs; <name>_ref.opt, the experiment. The results are what the FMUs gave when they were last made: they show that nothing
has changed, on any machine and in any client. That they are right is shown by the tests of the blocks.

Run it after a deliberate change of the equations, and look at the difference before you commit it.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
from fmpy import simulate_fmu

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent.parent))

from fmus import registry  # noqa: E402
from fmus.build import build_blocks  # noqa: E402

STEP = 0.01
STIMULUS = b"time,u\n0,0\n0.25,1\n1.5,-0.75\n2.75,0.35\n3.5,0\n"
BAR, DEG, MM = 1e5, np.pi / 180, 1e-3

Rows = list[tuple[float, ...]]


def held(*pieces: tuple[float, float]) -> Rows:
    """Rows of an input that keeps each value from its time on."""
    rows: Rows = []
    for time, value in pieces:
        if rows:
            rows.append((time, rows[-1][1]))
        rows.append((time, value))
    return rows


# what exercises each block; the experiment ends at the last time
INPUTS: dict[str, Rows] = {
    # once round, across both dead bands and both limits
    "dead_zone": [(0.0, 0.0), (1.0, 1.6), (3.0, -1.6), (4.0, 0.0)],
    # hits both stops, rings freely, follows a small step
    "dcv": held((0.0, 0.0), (0.1, 1.0), (0.8, -1.0), (1.5, 0.3), (2.2, -0.1), (3.0, -0.1)),
    "continuity": [
        (0.0, 0.0),
        (0.2, 2.4 * MM),
        (1.0, 2.4 * MM),
        (1.05, -1.0 * MM),
        (2.0, -1.0 * MM),
        (3.0, 0.0),
    ],
    # spool open while the column speeds up, stops and turns
    "continuity_physical": [
        (0.0, 0.0, 0.0),
        (0.3, 2.4 * MM, 2.2 * DEG),
        (1.0, 2.4 * MM, 2.2 * DEG),
        (1.3, -1.2 * MM, 0.0),
        (2.0, -1.2 * MM, -1.1 * DEG),
        (3.0, 0.0, 0.0),
    ],
    "mechanical": [
        (0.0, 0.0),
        (0.3, 12 * BAR),
        (1.2, 12 * BAR),
        (1.4, -8 * BAR),
        (2.5, -8 * BAR),
        (2.7, 0.0),
        (4.0, 0.0),
    ],
    "simplified": held((0.0, 0.0), (0.2, 1.0), (2.0, -0.5), (4.0, 0.0), (4.5, 0.0)),
    "linear_drive": held((0.0, 0.0), (0.2, 1.0), (2.0, -0.5), (4.0, 0.0), (4.5, 0.0)),
    "linear_speed": held((0.0, 0.0), (0.2, 1.0), (2.0, -0.5), (4.0, 0.0), (4.5, 0.0)),
    "sensor": [(0.0, 0.0), (2.0, 58 * DEG), (3.0, -3 * DEG)],
    # the measured angle starts away from the model's
    "observer": [
        (0.0, 0.0, 5 * DEG),
        (0.5, 0.0, 5 * DEG),
        (0.5, 1.0, 5 * DEG),
        (3.0, 1.0, 10 * DEG),
        (4.0, 0.0, 10.5 * DEG),
    ],
    # a torque that the model lacks, and a reading of a tracker, 20 ms old, that differs from the sensor
    "observer_extended": [
        (0.0, 0.0, 5 * DEG, 0.0, -1.0),
        (0.5, 8 * BAR, 5 * DEG, 0.0, -1.0),
        (2.0, 8 * BAR, 7 * DEG, 7 * DEG, -1.0),
        (2.0, 8 * BAR, 7 * DEG, 6.9 * DEG, 0.02),
        (2.01, 8 * BAR, 7.01 * DEG, 6.9 * DEG, 0.02),
        (2.01, 8 * BAR, 7.01 * DEG, 6.9 * DEG, -1.0),
        (3.0, -2 * BAR, 8 * DEG, 0.0, -1.0),
    ],
    # there and back at full rate, while the measured angle lags behind
    "reference": [
        (0.0, 0.0, 0.0),
        (0.2, 0.0, 0.0),
        (0.2, 0.3, 0.0),
        (2.5, 0.3, 3 * DEG),
        (2.5, -0.2, 3 * DEG),
        (5.0, -0.2, -1 * DEG),
    ],
    # manual, then automatic with a ramp and a limit, then manual again
    "controller": [
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (1.0, 1 * DEG, 1 * DEG, 0.5 * DEG, 1 * DEG, 0.4, 0.0),
        (1.0, 1 * DEG, 1 * DEG, 0.5 * DEG, 1 * DEG, 0.4, 1.0),
        (3.0, 3 * DEG, 1 * DEG, 2.8 * DEG, 1 * DEG, 0.4, 1.0),
        (3.5, 8 * DEG, 0.0, 3 * DEG, 0.0, -0.2, 1.0),
        (3.5, 8 * DEG, 0.0, 3 * DEG, 0.0, -0.2, 0.0),
        (5.0, 8 * DEG, 0.0, 3 * DEG, 0.0, 0.3, 0.0),
    ],
}
STOP = {name: rows[-1][0] for name, rows in INPUTS.items()} | {"stimulus": 4.0}


def signals(name: str) -> np.ndarray:
    """The inputs of an FMU as fmpy wants them."""
    names = ["time", *(n for n, v in registry.block(name).inputs.items() if v.kind != "time")]
    return np.array(INPUTS[name], dtype=[(n, float) for n in names])


def simulate(fmu: Path, inputs: np.ndarray | None, stop: float, step: float) -> np.ndarray:
    """Run an FMU; one row at time 0 and one after each step, with the columns time and outputs."""
    return simulate_fmu(str(fmu), stop_time=stop, step_size=step, output_interval=step, input=inputs)


def write_csv(path: Path, table: np.ndarray) -> None:
    """Numbers in the shortest text that reads back as the same value."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(table.dtype.names)
        rows.writerows([repr(float(v)) for v in row] for row in table)


def make(folder: Path = FOLDER) -> None:
    """Write the reference files of every FMU into `folder`."""
    with tempfile.TemporaryDirectory() as scratch:
        for fmu in build_blocks(Path(scratch), STIMULUS):
            name = fmu.stem
            inputs = None
            if name in INPUTS:
                inputs = signals(name)
                write_csv(folder / f"{name}_in.csv", inputs)
            result = simulate(fmu, inputs, STOP[name], STEP)
            write_csv(folder / f"{name}_ref.csv", result)
            lines = [
                "StartTime,0.0",
                f"StopTime,{STOP[name]}",
                f"StepSize,{STEP}",
                f"OutputInterval,{STEP}",
                "RelTol,1e-9",
            ]
            (folder / f"{name}_ref.opt").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
            print(name, len(result), "rows")


if __name__ == "__main__":
    make()
