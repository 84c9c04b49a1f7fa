"""Packages built once, short logs of the rig, and a system that has no twin."""

import numpy as np
import pytest

from cosim.paths import ssp_folder
from cosim.rig import as_log, make_log
from cosim.ssp.write import write_ssp


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    """The open packages by name."""
    folder = tmp_path_factory.mktemp("packages")
    return {
        name: write_ssp(ssp_folder() / f"{name}.ssd", folder / f"{name}_open.ssp", open=True)
        for name in ("simplified", "full_order", "physical")
    }


@pytest.fixture
def built(packages, monkeypatch):
    """The build folder of the command line: the packages under their names."""
    folder = packages["simplified"].parent
    if not (folder / "ssp").exists():
        (folder / "ssp").symlink_to(folder, target_is_directory=True)
    monkeypatch.setenv("COSIM_BUILD", str(folder))
    return folder


def command(seconds):
    """Steps of many sizes, 1 kHz."""
    levels = (0.0, 0.8, 0.0, -0.6, 0.0, 0.3, -0.9, 0.5, 0.0, -0.2)
    return np.repeat(levels, round(seconds * 1000 / len(levels)))


@pytest.fixture(scope="session")
def rig_log():
    """Makes a log with what is hidden in it."""

    def make(*hidden, seconds=6.0, seed=4, **options):
        return as_log(make_log(command(seconds), hidden=hidden, seed=seed, **options))

    return make


@pytest.fixture(scope="session")
def friction(rig_log):
    """Dry friction hidden."""
    return rig_log("mechanical.coulomb_friction:tau_c=150 N.m")
