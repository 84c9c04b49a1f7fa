"""Packages to export, built once."""

import numpy as np
import pytest

from cosim.paths import ssp_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.stimulus import stimulus_csv
from cosim.ssp.write import write_ssp


@pytest.fixture(scope="session")
def built(made_once):
    """Closed and open package of every system: name -> file."""
    stimulus = stimulus_csv(np.array([0.0, 0.2, 0.21, 0.5]), np.array([0.1, 0.4, -0.5, -0.5]))
    names = [name for system in SYSTEMS for name in (system, f"{system}_open")]

    def make(folder):
        for name in names:
            write_ssp(
                ssp_folder() / f"{name.removesuffix('_open')}.ssd",
                folder / f"{name}.ssp",
                stimulus=None if name.endswith("_open") else stimulus,
                open=name.endswith("_open"),
            )

    folder = made_once("exported", make)
    return {name: folder / f"{name}.ssp" for name in names}
