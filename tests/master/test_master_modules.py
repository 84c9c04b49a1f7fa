"""Modules of FMUs that nobody runs any more are given up, and those that somebody holds are not."""

import gc
import subprocess
import sys

import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from cosim.master import Runner, modules
from cosim.ssp.read import read_system
from fmus.build import build_fmu, composed_block

# more of them than may wait, each once more after it was given up, and the end of the process
AGAIN = """
import gc, sys
from pathlib import Path
from cosim.master import Runner, modules
modules.MOST_IDLE = 1
found = []
for file in 2 * sys.argv[1:]:
    with Runner(Path(file)) as runner:
        found.append(float(runner.run(0.05, 1e-3)["mechanical.omega"][-1]))
    gc.collect()
    modules.give_up()
    assert len(modules._idle) == 1
assert found[:2] == found[2:], found
assert len([name for name in sys.modules if name.startswith("mechanical_")]) == 1
print("done")
"""


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Two FMUs of one block with other start values, so with modules of their own."""
    folder = tmp_path_factory.mktemp("two")
    starts = ({"J": 700.0, "omega_0": 0.1}, {"J": 800.0, "omega_0": 0.2})
    return [
        build_fmu(composed_block("mechanical"), folder / f"mechanical_{k}" / "mechanical.fmu", own)
        for k, own in enumerate(starts)
    ]


def module_of(file):
    with read_system(file) as system:
        return next(iter(system.components.values())).fmu.module[0]


def test_one_given_up_runs_again_and_the_process_ends_cleanly(two):
    command = [sys.executable, "-c", AGAIN, *map(str, two)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


def test_one_in_which_another_client_holds_an_instance_stays(two, tmp_path, monkeypatch):
    monkeypatch.setattr(modules, "MOST_IDLE", 0)
    folder = extract(str(two[0]), str(tmp_path / "held"))
    description = read_model_description(folder)
    held = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="held",
    )
    held.instantiate()
    held.setupExperiment(startTime=0.0)
    held.enterInitializationMode()
    held.exitInitializationMode()
    with Runner(two[0]) as runner:
        runner.run(0.01, 1e-3)
    module = module_of(two[0])
    assert hasattr(sys.modules[module], "BlockSlave")
    held.doStep(0.0, 1e-3)
    held.terminate()
    held.freeInstance()
    with Runner(two[0]) as runner:
        runner.run(0.01, 1e-3)
    gc.collect()
    modules.give_up()
    assert module not in sys.modules
