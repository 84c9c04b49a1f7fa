"""Packages built once, short logs of the rig, and a system that has no twin."""

import numpy as np
import pytest

from cosim.rig import as_log, make_log


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
