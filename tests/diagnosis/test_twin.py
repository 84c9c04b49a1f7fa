"""The compiled twin that the diagnosis fits is the model that the FMUs run: equal to 1e-9 of each signal's range."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.extension.packages import write_extended
from cosim.diagnosis.fitting.whole import ChainModel
from cosim.diagnosis.held_out.gain import run_package
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.record.record import Record

H = 1e-3
TIME = np.arange(4001) * H
COMMAND = 0.8 * np.sin(2.0 * TIME) * (TIME > 0.5) + 0.1 * np.sign(np.sin(9.0 * TIME))
START = {"mechanical.theta_0": 0.3}


@pytest.mark.parametrize(
    ("model", "values"),
    [
        ("full_order", {}),
        (
            "full_order",
            {"dcv.tau_d": 0.0123, "dcv.x_0": 5e-5, "continuity.c_l": 0.2, "mechanical.tau_c": 80.0},
        ),
        (
            "full_order",
            {
                "dead_zone.play": 0.02,
                "dcv.v_max": 0.02,
                "continuity.k_s": 1e9,
                "mechanical.gap": 0.003,
                "sensor.tau_l": 0.05,
            },
        ),
        (
            "full_order",
            {
                "mechanical.mu": 0.3,
                "mechanical.w_f": 9.0,
                "mechanical.tau_r": 40.0,
                "continuity.p_c": 8e4,
                "sensor.drift": 1e-4,
            },
        ),
        ("physical", {}),
        pytest.param(
            "physical",
            {
                "mechanical.tau_c": 80.0,
                "mechanical.mu": 0.3,
                "continuity.a_q": 0.1,
                "continuity.p_c": 8e4,
                "continuity.C_L": 6e-12,
                "continuity.R_s": 2e10,
            },
            marks=pytest.mark.slow,
        ),
    ],
    ids=["nominal", "first", "second", "third", "physical", "physical, changed"],
)
def test_the_twin_equals_the_fmus(model: str, values: dict[str, float], tmp_path: Path) -> None:
    machine = our_machine(model)
    twin = ChainModel(machine.groups, Record(H, {"u": COMMAND}), START | machine.base).simulate(values)
    packages = write_extended(machine.source, values | START, tmp_path, None)
    # what a log holds is what is recorded of the FMUs
    fmus = run_package(packages["open"], Record(H, {"u": COMMAND} | twin), machine, {})
    for signal in ("spool", "p_load", "p_supply", "slew"):
        scale = max(float(np.ptp(twin[signal])), 1e-9 * float(np.abs(twin[signal]).max()))
        assert (
            np.abs(twin[signal] - fmus[signal]).max() <= 1e-9 * scale + 1e-12 * np.abs(twin[signal]).max()
        ), signal
