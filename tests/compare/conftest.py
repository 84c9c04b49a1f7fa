"""Packages built once, and logs of the rig that show everything within seconds."""

import numpy as np
import pytest

from cosim.rig import as_log, make_log


def command(seconds):
    """Steps of many sizes with rests between, 1 kHz."""
    levels = (0.0, 0.8, 0.0, -0.6, 0.0, 0.3, -0.3, 0.0)
    return np.repeat(levels, round(seconds * 1000 / len(levels)))


@pytest.fixture(scope="session")
def rig_log():
    """Makes a log with what is hidden in it."""

    def make(*hidden, seconds=8.0, **options):
        return as_log(make_log(command(seconds), hidden=hidden, seed=4, **options))

    return make


@pytest.fixture(scope="session")
def clean(rig_log):
    """A log of the nominal crane, observer and all."""
    return rig_log(observer=True)
