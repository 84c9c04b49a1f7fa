"""A vessel that is filled and emptied by different ways (synthetic): no block has two lags, and the answer tells them."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.answer.lags import fitted
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.thresholds import CALIBRATED_TRUST
from cosim.logs import load_log
from cosim.report.words import at_start, quantity, with_signals

STEP, MOST = 0.05, 0.8  # s, bar at full command
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
    pressure += rng.normal(0.0, 5e-4, pump.size)
    log, mapping = folder / "vessel.csv", folder / "vessel.toml"
    table = np.column_stack([STEP * np.arange(pump.size), pump, pressure])
    np.savetxt(log, table, delimiter=",", comments="", fmt="%.6g", header="time,pump,pressure")
    mapping.write_text(MAPPING, encoding="utf-8")
    return log, mapping


@pytest.mark.parametrize(("up", "down"), [(2.4, 5.8), (1.1, 0.3)])
def test_both_lags_are_found_beside_an_end_that_one_lag_has_put_too_high(up: float, down: float) -> None:
    end = np.repeat(np.tile([1.0, 0.0], 4), 300)
    reading = np.zeros(end.size)
    for k in range(1, end.size):
        lag = up if end[k - 1] > reading[k - 1] else down
        reading[k] = end[k - 1] + (reading[k - 1] - end[k - 1]) * np.exp(-STEP / lag)
    record = SimpleNamespace(time=STEP * np.arange(end.size), cuts=(900,))
    found, errs = fitted(record, reading, 1.1 * end - 0.02, near=3.0, ways=2)  # type: ignore[arg-type]
    assert found == pytest.approx([up, down], rel=0.01)
    assert errs < 1e-3
    (_,), of_one = fitted(record, reading, 1.1 * end - 0.02, near=3.0, ways=1)  # type: ignore[arg-type]
    assert of_one > 10.0 * errs


@pytest.mark.parametrize(("up", "down", "told"), [(2.4, 5.8, True), (3.0, 3.0, False)])
def test_the_answer_tells_that_a_vessel_rises_and_falls_with_lags_of_their_own(
    tmp_path: Path, up: float, down: float, told: bool
) -> None:
    """An air pump with a soft actuator: "a missing opening that depends on pressure explains 65 %" was all that was said."""
    path, mapping = vessel(tmp_path, up, down)
    log = load_log(path, mapping)
    found = diagnose(log, model=machine_of(None, [log], mapping), calibrate=True, tolerance=CALIBRATED_TRUST)
    result = answer(found, log, None)
    said = [rest.what for rest in result.unexplained if "rises with a lag of" in rest.what]
    assert bool(said) == told
    if told:
        lags = [float(v) for v in re.findall(r"(?:lag|one) of ([\d.]+) s", said[0])]
        assert lags == pytest.approx([up, down], rel=0.06), said[0]
        assert "rises with a lag of" in result.unexplained[0].what, "before linear dynamics, which are none"


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
