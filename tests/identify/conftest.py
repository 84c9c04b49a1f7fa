"""Logs of the rig that an identification needs, made once a session."""

import pytest
from identify_truth import UNCOMPENSATED

from cosim.identify.experiment import ramp
from cosim.identify.nominal import nominal
from cosim.rig import Noise, as_log, make_log


@pytest.fixture(scope="session")
def known():
    """The nominal numbers."""
    return nominal()


@pytest.fixture(scope="session")
def off():
    """The nominal numbers, the compensator being off."""
    return nominal([f"{name}={value:g}" for name, value in UNCOMPENSATED.items()])


@pytest.fixture(scope="session")
def mixed():
    """Makes logs of the nominal crane that move everything, 24 s."""

    def make(seed=1, seconds=24.0, **options):
        return as_log(make_log("mixed", seconds, seed=seed, **options))

    return make


@pytest.fixture(scope="session")
def clean(mixed):
    """One without noise, below the stops."""
    return mixed(noise=0.0, amplitude=0.9)


@pytest.fixture(scope="session")
def noisy(mixed):
    """One as the rig records it."""
    return mixed()


@pytest.fixture(scope="session")
def ramp_log():
    """Makes logs of a slow ramp without compensator, as the source's own, 16 s a period."""

    def make(seed=1, kind="white", scale=1.0, amplitude=1.0, hidden=(), **sizes):
        command = ramp(amplitude, 1, 16.0).command
        noise = Noise(scale=scale, kind=kind)
        return as_log(
            make_log(command, hidden=hidden, seed=seed, noise=noise, settings=UNCOMPENSATED | sizes)
        )

    return make
