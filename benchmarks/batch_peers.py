"""Parameter sweeps as FMPy's documentation shows them, with Dask: ``python -m benchmarks.batch_peers WAY MODEL RUNS STOP``.

The functions that Dask hands to its processes stand in this module, not in ``__main__``, or each call would load the FMU
anew. Prints one JSON object: seconds of the sweep without the start of Python, and the final value of every run.
"""

import json
import shutil
import sys
import time
from pathlib import Path

import dask
import fmpy
import numpy as np
from dask import bag
from fmpy.fmi2 import FMU2Slave

H = 1e-3
LOW, HIGH = 700.0, 900.0  # kg.m2, of the inertia
PRESSURE = 1e6  # Pa, on the mechanics alone
WORKERS = 2


def sweep_loop(indices: list[int], fmu: str, runs: int, stop: float) -> list[tuple[int, float]]:
    """FMPy's example ``parameter_variation.py``: one instance a chunk, reset for every run, stepped by FMPy's methods."""
    description = fmpy.read_model_description(fmu)
    folder = fmpy.extract(fmu)
    references = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="m",
    )
    slave.instantiate()
    values = np.linspace(LOW, HIGH, runs)
    found = []
    for i in indices:
        slave.reset()
        slave.setupExperiment(startTime=0.0)
        slave.setReal([references["J"], references["p_load"]], [float(values[i]), PRESSURE])
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        rows = []
        for k in range(round(stop / H)):
            slave.doStep(currentCommunicationPoint=k * H, communicationStepSize=H)
            rows.append(slave.getReal([references["theta"]])[0])
        found.append((i, rows[-1]))
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
    return found


def sweep_simulate_fmu(indices: list[int], fmu: str, runs: int, stop: float) -> list[tuple[int, float]]:
    """`fmpy.simulate_fmu` once a run, the FMU unpacked once a chunk."""
    folder = fmpy.extract(fmu)
    description = fmpy.read_model_description(folder)
    values = np.linspace(LOW, HIGH, runs)
    found = []
    for i in indices:
        result = fmpy.simulate_fmu(
            folder,
            model_description=description,
            start_values={"J": float(values[i]), "p_load": PRESSURE},
            output=["theta"],
            stop_time=stop,
            output_interval=H,
        )
        found.append((i, float(result["theta"][-1])))
    shutil.rmtree(folder, ignore_errors=True)
    return found


def sweep_simulate_ssp(indices: list[int], package: str, runs: int, stop: float) -> list[tuple[int, float]]:
    """`fmpy.ssp.simulation.simulate_ssp` once a run; it takes parameters only as sources, so the .ssv decides here."""
    from fmpy.ssp.simulation import simulate_ssp

    found = []
    for i in indices:
        result = simulate_ssp(package, stop_time=stop, step_size=H)
        found.append((i, float(result["mechanical.theta"][-1])))
    return found


SWEEPS = {"loop": sweep_loop, "simulate_fmu": sweep_simulate_fmu, "simulate_ssp": sweep_simulate_ssp}


def main() -> int:
    """Runs one sweep in Dask's processes, as many chunks as processes."""
    way, model, runs, stop = sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
    dask.config.set(scheduler="processes", num_workers=WORKERS)
    began = time.perf_counter()
    parts = bag.from_sequence(range(runs), npartitions=WORKERS)
    found = parts.map_partitions(SWEEPS[way], str(Path(model).absolute()), runs, stop).compute()
    seconds = time.perf_counter() - began
    print(json.dumps({"seconds": seconds, "final": [value for _, value in sorted(found)]}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
