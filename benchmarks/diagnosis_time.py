"""Processor time of a diagnosis with quick fits and longer steps and without: ``python benchmarks/diagnosis_time.py LOG``.

Takes ``--mapping``, ``--held-out`` and ``--calibrate`` as ``cosim diagnose`` does, and prints for each way processor time,
the simulations, the verdict and the causes with their sizes: the answer must be the same, only sooner.
"""

import argparse
import sys
import time
from pathlib import Path
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from rich.console import Console
from rich.table import Table

from cosim.diagnosis.fitting import pace, trials
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.logs import load_log

# name of the way -> (longest step of a search in intervals between samples, quick fits)
WAYS = {
    "without": (0.0, False),
    "longer steps": (pace.LONGEST_STEP_SHARE, False),
    "quick fits": (0.0, True),
    "both": (pace.LONGEST_STEP_SHARE, True),
}


def main() -> None:
    """Run the ways asked for, one after the other."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path)
    parser.add_argument("--mapping", type=Path)
    parser.add_argument("--held-out", type=Path)
    parser.add_argument("--calibrate", action="store_true")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=["without", "both"])
    asked = parser.parse_args()
    log = load_log(asked.log, asked.mapping)
    held = load_log(asked.held_out, asked.mapping) if asked.held_out else None
    machine = machine_of(None, log, asked.mapping)
    table = Table("way", "processor time [s]", "simulations", "verdict", "causes")
    runs: list[int] = []
    simulate = GroupModel.simulate

    def counted(model: GroupModel, values: dict[str, float]) -> dict[str, np.ndarray]:
        runs.append(1)
        return simulate(model, values)

    for way in asked.ways:
        longest, quick = WAYS[way]
        runs.clear()
        with (
            patch.object(pace, "LONGEST_STEP_SHARE", longest),
            patch.object(trials, "QUICK", quick),
            patch.object(GroupModel, "simulate", counted),
        ):
            begin = time.process_time()
            found = diagnose(log, model=machine, held_out=held, calibrate=asked.calibrate)
            taken = time.process_time() - begin
        causes = "; ".join(
            f"{c.effect.name} " + " ".join(f"{p}={v:.4g}" for p, (v, _) in c.parameters.items())
            for c in found.causes
        )
        table.add_row(way, f"{taken:.1f}", str(len(runs)), found.verdict, causes or "none")
    Console().print(table)


if __name__ == "__main__":
    main()
