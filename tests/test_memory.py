"""A process that diagnoses again and again holds what it uses."""

import sys

import numpy as np
import psutil
import pytest

from cosim.memory import returned

MIB = 2**20


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc alone keeps what is free")
def test_memory_freed_between_what_is_kept_goes_back():
    process = psutil.Process()
    with returned():
        # below the size from which on each array has a mapping of its own
        arrays = [np.ones(4096) for _ in range(4000)]
        kept = arrays[::40]
        full = process.memory_info().rss
        arrays.clear()
    assert process.memory_info().rss < full - 80 * MIB  # of 125 MiB
    assert all(array.sum() == 4096.0 for array in kept)
