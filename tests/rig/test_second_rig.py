"""Two simulators of the drive, written apart with integrators of their own, agree far below the sensors' noise."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from rig_helpers import clean, lively

from benchmarks.second.cases import FLAWS, draw
from benchmarks.second.machine import Machine, run
from benchmarks.second.out_of_library import FAULTS, draw_out_of_library
from benchmarks.second.record import NOISE, SEEN_BY
from benchmarks.second.trial import judged, off, shown
from cosim.rig import Hidden

START = 0.3  # rad, where the rig's own choice would lie elsewhere
# a value of every parameter in the library's own form, SI
VALUES = {
    "dead_zone.mismatch": {"b_r": 0.5, "b_l": -0.43},
    "dcv.gain": {"K": 2.1e-3},
    "dcv.bandwidth": {"w0": 20.0},
    "dcv.damping": {"zeta": 0.8},
    "dcv.delay": {"tau_d": 0.0205},
    "dcv.rate_limit": {"v_max": 0.01},
    "dcv.stroke_limit": {"x_max": 1.7e-3, "x_min": -1.4e-3},
    "dcv.hysteresis": {"play": 0.03},
    "dcv.offset": {"x_0": 1e-4},
    "continuity.flow_gain": {"K_c": 4.6e8},
    "continuity.flow_asymmetry": {"a_q": -0.1},
    "continuity.leakage": {"c_l": 0.2},
    "continuity.compressibility": {"c_beta": 0.4},
    "continuity.lag_asymmetry": {"r_T": 1.8},
    "continuity.supply_sag": {"k_s": 1.2e9, "tau_s": 0.2},
    "continuity.cracking_pressure": {"p_c": 1e5},
    "mechanical.coulomb_friction": {"tau_c": 100.0},
    "mechanical.stribeck_friction": {"tau_c": 100.0, "tau_s": 80.0, "omega_s": 0.008},
    "mechanical.viscous_friction": {"b": 32e3},
    "mechanical.inertia": {"J": 1000.0},
    "mechanical.gravity_load": {"tau_g": 100.0, "theta_g": 0.2},
    "mechanical.backlash": {"gap": 0.004},
    "mechanical.compliance": {"mu": 0.3, "w_f": 9.0, "zeta_f": 0.03},
    "mechanical.gear_ripple": {"tau_r": 50.0, "n_r": 22.0, "phi_r": 0.5},
    "sensor.lag": {"tau_l": 0.05},
}


def both(name):
    """The error-free signals of both simulators with one effect hidden, in units of the sensors' noise."""
    values = VALUES.get(name, {})
    own = {there: here for here, there in FLAWS[name].names.items()} if name else {}
    theirs = clean(lively(), *([Hidden(name, values)] if name else []), start=START)
    ours = run(theirs.u, Machine(theta_0=START, **{own.get(n, n): v for n, v in values.items()}))
    wanted = dict(theirs.true) | {"angle": theirs.slew}
    return {s: (ours[s] / NOISE[c], wanted[s] / NOISE[c]) for s, c in SEEN_BY.items()}


@pytest.mark.parametrize("name", ["", *VALUES])
def test_two_simulators_agree_to_a_hundredth_of_the_noise(name):
    for signal, (ours, theirs) in both(name).items():
        assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.01, signal


@pytest.mark.parametrize("name", sorted(n for n, f in FLAWS.items() if f.forms and not f.sensing))
def test_every_other_form_differs_from_the_librarys(name):
    flaw = FLAWS[name]
    values = {n: VALUES[name][flaw.names.get(n, n)] for n in flaw.sizes}
    u = lively()
    usual = run(u, Machine(**values))
    for form in flaw.forms:
        set_to = {n: v[1] if isinstance(v, tuple) else v for n, v in form.items()}
        other = run(u, Machine(**values, **set_to))
        apart = [float(np.max(np.abs(other[s] - usual[s]))) / NOISE[c] for s, c in SEEN_BY.items()]
        assert max(apart) > 0.5, form


def test_a_seed_draws_the_same_case_and_cases_are_plain_data():
    drawn = [draw(seed) for seed in range(400)]
    assert drawn == [draw(seed) for seed in range(400)]
    assert json.loads(json.dumps([asdict(c) for c in drawn]))[0]["seed"] == 0
    assert {n for c in drawn for n in c.hidden} == FLAWS.keys()


def answer(*effects, unexplained=(), interval=(90.0, 120.0)):
    """A diagnosis that names `effects`."""
    told = {"tau_c": {"value": 105.0, "unit": "N.m", "ci95": list(interval)}}
    causes = [
        {"effect": e, "block": e.partition(".")[0], "parameters": told, "indistinguishable_from": []}
        for e in effects
    ]
    return {"causes": causes, "unexplained": list(unexplained)}


def test_answers_are_judged_by_what_was_hidden():
    seed = next(s for s in range(500) if list(draw(s).hidden) == ["mechanical.coulomb_friction"])
    case = draw(seed)
    assert judged(case, answer("mechanical.coulomb_friction")) == "exact"
    assert judged(case, answer("mechanical.coulomb_friction", unexplained=["x"])) == "rest"
    assert judged(case, answer("mechanical.coulomb_friction", "dcv.gain")) == "extra"
    assert judged(case, answer("dcv.gain")) == "wrong"
    assert judged(case, answer()) == "missed"
    assert judged(case, answer(unexplained=["x"])) == "unexplained"


def test_an_interval_is_held_against_the_truth():
    cases = (draw(s) for s in range(2000))
    case = next(
        c for c in cases if c.hidden.keys() == {"mechanical.coulomb_friction"} and not any(c.forms.values())
    )
    truth = case.hidden["mechanical.coulomb_friction"]["tau_c"]
    told = off(case, answer("mechanical.coulomb_friction", interval=(95.0, 115.0)))
    assert told["mechanical.coulomb_friction.tau_c"] == pytest.approx([105.0, truth, (105.0 - truth) / 10.0])


@pytest.mark.parametrize("name", FAULTS)
def test_every_out_of_library_fault_changes_what_is_measured(name):
    cases = (c for c in map(draw_out_of_library, range(40)) if name in c.hidden)
    assert any(shown(case)[name] > 5.0 for case in cases)


def test_an_out_of_library_fault_is_to_be_called_unexplained_in_its_block():
    case = next(c for c in map(draw_out_of_library, range(400)) if "stranger.hose" in c.hidden)
    there, elsewhere = {"block": "continuity"}, {"block": "dcv"}
    assert judged(case, answer(unexplained=[there])) == "honest"
    assert judged(case, answer(unexplained=[elsewhere])) == "elsewhere"
    assert judged(case, answer()) == "missed"
    assert judged(case, answer("continuity.leakage", unexplained=[there])) == "named"
    assert judged(case, answer("dcv.gain", unexplained=[there])) == "extra"
