"""A vessel that is filled and emptied by different ways (synthetic): its pressure falls with a lag of its own."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.thresholds import CALIBRATED_TRUST
from cosim.logs import load_log
from cosim.report.words import at_start, quantity, with_signals

STEP, MOST, NOISE = 0.05, 0.8, 5e-4  # s, bar at full command, bar
NAME = "continuity.lag_asymmetry"
MAPPING = """\
name = "vessel"
time = { column = "time", unit = "s" }
[signals]
u = { column = "pump", unit = "1" }
p_a = { column = "pressure", unit = "bar" }
[machine]
chain = ["dead_zone", "dcv", "continuity"]
output = "p_a"
"""


def vessel(folder: Path, up: float, down: float, seed: int = 3) -> tuple[Path, Path]:
    """A log of a pump in steps of several sizes, off between them, and its mapping."""
    rng = np.random.default_rng(seed)
    pump = np.repeat(rng.uniform(0.3, 1.0, 12) * np.tile([1.0, 0.0], 6), 300)
    pressure = np.zeros(pump.size)
    for k in range(1, pump.size):
        end = MOST * pump[k - 1]
        lag = up if end > pressure[k - 1] else down
        pressure[k] = end + (pressure[k - 1] - end) * np.exp(-STEP / lag)
    pressure += rng.normal(0.0, NOISE, pump.size)
    log, mapping = folder / "vessel.csv", folder / "vessel.toml"
    table = np.column_stack([STEP * np.arange(pump.size), pump, pressure])
    np.savetxt(log, table, delimiter=",", comments="", fmt="%.6g", header="time,pump,pressure")
    mapping.write_text(MAPPING, encoding="utf-8")
    return log, mapping


@pytest.mark.parametrize(("up", "down"), [(2.4, 5.8), (1.1, 0.4), (3.0, 3.0)])
def test_another_lag_of_a_falling_pressure_is_named(tmp_path: Path, up: float, down: float) -> None:
    """An air pump with a tank: "a missing opening that depends on pressure" was all that was said, one lag left 0.03 bar."""
    path, mapping = vessel(tmp_path, up, down)
    log = load_log(path, mapping)
    found = diagnose(log, model=machine_of(None, [log], mapping), calibrate=True, tolerance=CALIBRATED_TRUST)
    result = answer(found, log, None)
    named = [cause for cause in result.causes if cause.effect == NAME]
    assert [c.effect for c in result.causes] == [NAME] * (up != down)
    for cause in named:
        assert cause.parameters["r_T"].value == pytest.approx(down / up, rel=0.03)
    (finding,) = found.findings.values()
    assert np.std(finding.chosen.fit.residuals["p_a"]) / 1e5 < 3.0 * NOISE, (
        "and the pump's steps, between two samples"
    )


def test_a_rate_is_told_in_words() -> None:
    text = "a missing opening that depends on p_a_rate explains 91% of what is systematic in p_a"
    assert with_signals(text) == (
        "a missing opening that depends on the rate of change of the pressure at port A explains 91% of what is systematic "
        "in pressure at port A"
    )
    assert quantity("p_a_rate")[1:] == ("bar/s", 1e-5)
    assert at_start("pressure at port A") == "Pressure at port A", "it was port a in titles"
    assert quantity("p_a")[0] == "pressure at port A"
    assert quantity("spool_rate")[0] == "spool speed"
    assert with_signals("a missing demand that depends on spool_rate explains 5% of") == (
        "a missing demand that depends on spool speed explains 5% of"
    )
