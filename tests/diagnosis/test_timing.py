"""Signals that are in step to a part of a sample only: no cause is made of it, and real delays are still found."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_logs import off, only
from numpy.typing import NDArray

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.logs import Log
from cosim.rig import make_log
from cosim.rig.parameters import nominal_value
from cosim.rig.write import as_log

Array = NDArray[np.float64]


def coarse(u: Array, h: float, changed: dict[str, float]) -> dict[str, Array]:
    """The drive by explicit Euler steps, block by block, as a plain loop in a spreadsheet or a controller has it."""

    def of(name: str) -> float:
        return changed.get(name, nominal_value(name))

    gain, w0, zeta = of("dcv.K"), of("dcv.w0"), of("dcv.zeta")
    k_c, lag = of("continuity.K_c"), of("continuity.T")
    inertia, damping, level = of("mechanical.J"), of("mechanical.b"), changed.get("mechanical.tau_c", 0.0)
    area = of("mechanical.A") * of("mechanical.r")
    demand = u + np.where(u > 0.0, 0.45, 0.40) * np.tanh(50.0 * u)
    demand = np.clip(np.where(demand > 0.45, demand - 0.45, np.minimum(demand + 0.40, 0.0)), -1.0, 1.0)
    found = np.zeros((3, u.size))
    spool = rate = pressure = speed = angle = 0.0
    for k in range(u.size):
        found[:, k] = spool, pressure, angle
        rate += h * (w0**2 * (gain * demand[k] - spool) - 2.0 * zeta * w0 * rate)
        free = spool + h * rate
        spool = min(max(free, of("dcv.x_min")), of("dcv.x_max"))
        rate = rate if spool == free else 0.0
        pressure += h * (k_c * spool - pressure) / lag
        free = speed + h * (area * pressure - damping * speed) / inertia
        speed = np.sign(free) * max(abs(free) - h * level / inertia, 0.0)
        angle += h * speed
    return dict(zip(("spool", "p_load", "angle"), found, strict=True))


def computed(changed: dict[str, float], seed: int) -> Log:
    """A log of the coarse drive, with the rig's command and noise."""
    run = make_log("steps", 14.0, [], seed=seed, settings=off(seed))
    log, true = as_log(run), run.true
    own = coarse(log.signals["u"], log.step, off(seed) | changed)
    supply = nominal_value("continuity.p_s")
    made = {
        "spool": own["spool"] - true["spool"],
        "p_a": 0.5 * (supply + own["p_load"]) - 0.5 * (true["p_supply"] + true["p_load"]),
        "p_b": 0.5 * (supply - own["p_load"]) - 0.5 * (true["p_supply"] - true["p_load"]),
        "slew": own["angle"] + true["theta"][0] - true["seen"],
    }
    return replace(log, signals={n: v + made.get(n, 0.0) for n, v in log.signals.items()})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({}, []),
        ({"mechanical.tau_c": 60.0}, ["mechanical.coulomb_friction"]),
        ({"dcv.K": 2.52e-3}, ["dcv.gain"]),
    ],
    ids=["nothing", "dry friction", "the valve's gain"],
)
def test_explicit_steps_of_a_millisecond_call_for_no_cause(
    changed: dict[str, float], named: list[str]
) -> None:
    found = diagnose(computed(changed, seed=31))
    assert [c.effect.name for c in found.causes] == named
    assert not found.rests


@pytest.mark.parametrize(
    ("signal", "late", "blocks"),
    [
        # late spool: late behind the valve, early before the column
        ("spool", 0.5e-3, ("dcv", "continuity")),
        pytest.param("spool", 0.5e-3, ("dcv", "continuity", "mechanical"), marks=pytest.mark.slow),
        pytest.param("spool", -0.5e-3, ("dcv", "continuity", "mechanical"), marks=pytest.mark.slow),
        pytest.param("slew", 0.5e-3, ("dcv", "continuity", "mechanical"), marks=pytest.mark.slow),
    ],
)
def test_a_signal_half_a_sample_late_calls_for_no_cause(
    signal: str, late: float, blocks: tuple[str, ...]
) -> None:
    log = as_log(make_log("mixed", 21.0, [], seed=77, settings=off(77)))
    moved = np.interp(log.time - late, log.time, log.signals[signal])
    found = diagnose(replace(log, signals=log.signals | {signal: moved}), model=only(*blocks))
    assert found.verdict == "adequate"


@pytest.mark.slow
def test_a_delay_of_a_few_samples_is_found_as_well_as_the_timing_is_known() -> None:
    run = make_log("steps", 40.0, ["dcv.delay:tau_d=3 ms"], seed=78, settings=off(78))
    (cause,) = diagnose(as_log(run)).causes
    assert cause.effect.name == "dcv.delay"
    value, deviation = cause.parameters["tau_d"]
    assert deviation >= 0.2e-3
    assert value == pytest.approx(3e-3, abs=2.0 * deviation)
