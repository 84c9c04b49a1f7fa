"""The committed example is what docs/rig.md says it is."""

import json
from pathlib import Path

import numpy as np

from cosim.logs import load_log
from cosim.rig import make_log
from cosim.rig.parameters import DEG

DEMO = Path(__file__).parents[2] / "examples" / "synthetic_demo.csv"


def test_demo_is_synthetic_and_can_be_made_again():
    log = load_log(DEMO)
    assert log.synthetic
    truth = json.loads(DEMO.with_name("synthetic_demo.csv.truth.json").read_text(encoding="utf-8"))
    assert [effect["effect"] for effect in truth["hidden"]] == ["mechanical.coulomb_friction"]
    run = make_log("steps", 15.0, ["mechanical.coulomb_friction"], seed=1)
    # other machines may round exp and sin differently: compare to a hundredth of the noise
    for name, tolerance in {"u": 1e-9, "spool": 5e-8, "p_a": 100.0, "p_b": 100.0, "slew": 1e-4 * DEG}.items():
        assert np.allclose(log[name], run.signals[name], rtol=0, atol=tolerance), name


def test_demo_moves_and_sticks():
    run = make_log("steps", 15.0, ["mechanical.coulomb_friction"], seed=1, noise=0)
    stuck = run.true["omega"] == 0.0
    assert 0.05 < stuck.mean() < 0.95
    assert np.ptp(run.slew) > 1 * DEG
