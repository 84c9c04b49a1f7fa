"""Packages to export, built once."""

import numpy as np
import pytest

from cosim.paths import ssp_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.stimulus import stimulus_csv
from cosim.ssp.write import write_ssp


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Closed and open package of every system: name -> file."""
    folder = tmp_path_factory.mktemp("built")
    stimulus = stimulus_csv(np.array([0.0, 0.2, 0.21, 0.5]), np.array([0.1, 0.4, -0.5, -0.5]))
    return {
        name: write_ssp(
            ssp_folder() / f"{name.removesuffix('_open')}.ssd",
            folder / f"{name}.ssp",
            stimulus=None if name.endswith("_open") else stimulus,
            open=name.endswith("_open"),
        )
        for system in SYSTEMS
        for name in (system, f"{system}_open")
    }
