"""A spool that just meets its stops: the search finds the right valley among many."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import make_log
from cosim.rig.write import as_log

FASTER = {"dcv.K": 2.3935e-3, "dcv.w0": 25.634, "dcv.zeta": 0.5393}


@pytest.mark.slow
def test_a_clean_log_in_which_the_spool_grazes_its_stops_is_adequate() -> None:
    t = np.arange(60_001) * 1e-3
    rising = np.log(3.0 / 0.08)
    command = 0.995 * np.sin(2.0 * np.pi * 0.08 * 60.0 / rising * (np.exp(t / 60.0 * rising) - 1.0))
    command[:300] = command[-400:] = 0.0
    command = command[np.arange(t.size) // 10 * 10]
    run = make_log(command, 60.0, seed=3, settings=FASTER)
    assert run.true["spool"].max() > 2.59e-3
    log = as_log(run)
    log = replace(log, time=log.time[::10], signals={n: v[::10] for n, v in log.signals.items()})
    found = diagnose(log)
    assert found.verdict == "adequate"
