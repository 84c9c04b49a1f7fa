"""Hiding effects and setting nominal numbers: reading, units, refusals, truth."""

import json
from pathlib import Path

import numpy as np
import pytest
from rig_helpers import clean, held

from cosim.errors import UsageError
from cosim.rig import EFFECTS, PARAMETERS, Hidden, make_log
from cosim.rig.hidden import assemble, parse_setting
from cosim.rig.parameters import DEG, NOMINAL, nominal_value

DESIGN = (Path(__file__).parents[2] / "docs" / "design.md").read_text(encoding="utf-8")
PROMISED_EFFECTS = [
    "dead_zone.mismatch",
    "dcv.gain",
    "dcv.bandwidth",
    "dcv.damping",
    "dcv.delay",
    "dcv.rate_limit",
    "dcv.stroke_limit",
    "dcv.hysteresis",
    "dcv.offset",
    "continuity.flow_gain",
    "continuity.flow_asymmetry",
    "continuity.leakage",
    "continuity.compressibility",
    "continuity.supply_sag",
    "continuity.cracking_pressure",
    "mechanical.coulomb_friction",
    "mechanical.stribeck_friction",
    "mechanical.viscous_friction",
    "mechanical.inertia",
    "mechanical.gravity_load",
    "mechanical.backlash",
    "mechanical.compliance",
    "mechanical.gear_ripple",
    "sensor.bias",
    "sensor.gain",
    "sensor.drift",
    "sensor.quantisation",
    "sensor.lag",
    "sensor.dropout",
    "tracker.clock",
    "tracker.seam",
]
BEYOND = [  # of the library
    "dcv.amplitude_damping",
    "continuity.flow_pressure",
    "continuity.lag_asymmetry",
    "mechanical.end_stop",
    "mechanical.constant_load",
    "sensor.saturation",
]


def test_every_effect_of_the_contract_can_be_hidden():
    assert {*PROMISED_EFFECTS, *BEYOND} == {name for name in EFFECTS if not name.startswith("unknown.")}
    assert len([name for name in EFFECTS if name.startswith("unknown.")]) >= 5


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_is_complete(name):
    parameter = PARAMETERS[name]
    assert parameter.low < parameter.high
    assert parameter.allows(nominal_value(name))
    assert parameter.text
    assert parameter.source
    if not name.startswith("unknown."):
        assert name.split(".")[1] in DESIGN


def test_every_number_of_the_crane_is_in_the_table():
    fields = {f"{block}.{name}" for block, values in NOMINAL._asdict().items() for name in values._fields}
    assert fields == set(PARAMETERS)


@pytest.mark.parametrize("effect", EFFECTS)
def test_moderate_size_is_allowed_and_is_not_off(effect):
    item = EFFECTS[effect]
    assert all(PARAMETERS[name].allows(value) for name, value in item.moderate.items())
    assert item.moderate != item.off()


def test_units_are_converted():
    hidden = Hidden.parse("mechanical.stribeck_friction: tau_c = 0.3 kN.m, omega_s = 1 deg/s")
    assert hidden.numbers() == {
        "mechanical.tau_c": pytest.approx(300.0), "mechanical.tau_s": 0.0, "mechanical.omega_s": pytest.approx(DEG),
    }  # fmt: skip
    assert Hidden.parse("dcv.stroke_limit:x_max=2 mm").numbers()["dcv.x_max"] == pytest.approx(2e-3)
    assert parse_setting("mechanical.J=800 kg.m2") == ("mechanical.J", 800.0)
    assert parse_setting("continuity.K_c=5 bar/mm") == ("continuity.K_c", pytest.approx(5e8))


def test_bare_name_takes_the_moderate_size_and_a_part_keeps_the_rest_off():
    assert Hidden("dcv.delay").numbers() == {"dcv.tau_d": 0.02}
    assert Hidden.parse("mechanical.stribeck_friction:tau_s=50").numbers()["mechanical.tau_c"] == 0.0


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("mechanical.coulomb_fricton", "did you mean mechanical.coulomb_friction"),
        ("mechanical.coulomb_friction:tau=3", "no parameter 'tau'.*tau_c"),
        ("mechanical.coulomb_friction:tau_c", "name=value"),
        ("mechanical.coulomb_friction:tau_c=3 kg", "dimension"),
        ("mechanical.coulomb_friction:tau_c=-3 N.m", "outside"),
        ("mechanical.coulomb_friction:tau_c=much", "not a number"),
        ("sensor.lag:tau_l=1 us", "or 0 for none"),
        ("dcv.delay:tau_d=1e999", "beyond the range"),
    ],
)
def test_bad_effects_are_refused_with_a_remedy(text, word):
    with pytest.raises(UsageError, match=word):
        Hidden.parse(text)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("mechanical.K=3", "unknown parameter"),
        ("mechanical.j=3", "mechanical.J"),
        ("mechanical.J", "component.parameter=value"),
        ("mechanical.J=0", "outside"),
        ("simplified.k=3", "unknown"),
    ],
)
def test_bad_settings_are_refused_with_a_remedy(text, word):
    with pytest.raises(UsageError, match=word):
        parse_setting(text)


def test_contradicting_wishes_are_refused_and_agreeing_ones_taken():
    coulomb, stribeck = Hidden("mechanical.coulomb_friction"), Hidden("mechanical.stribeck_friction")
    assert assemble([coulomb, stribeck], {}).mechanical.tau_c == 100.0
    with pytest.raises(UsageError, match="give one value"):
        assemble([Hidden("mechanical.coulomb_friction", {"tau_c": 50.0}), stribeck], {})
    with pytest.raises(UsageError, match="--set"):
        assemble([Hidden("mechanical.inertia")], {"mechanical.J": 800.0})
    with pytest.raises(UsageError, match="given twice"):
        make_log(held((0.1, 0.1)), settings={"mechanical.theta_0": 0.1}, start=0.1)


def test_crane_too_fast_for_the_steps_is_refused():
    with pytest.raises(UsageError, match="substeps"):
        clean(held((0.5, 0.1)), settings={"mechanical.J": 1.0, "mechanical.b": 1e6})
    with pytest.raises(UsageError, match="tau_c > 0"):
        clean(held((0.5, 0.1)), "mechanical.stribeck_friction:tau_s=50", friction="lugre")
    with pytest.raises(UsageError, match="sharp"):
        clean(held((0.5, 0.1)), friction="rough")
    with pytest.raises(UsageError, match="substeps"):
        clean(held((0.5, 0.1)), substeps=0)


@pytest.mark.slow
def test_nominal_errors_change_the_crane():
    run = clean(held((0.8, 3.0)), settings={"dcv.K": 2.0e-3})
    assert run.true["spool"][-1] == pytest.approx(1.6e-3, rel=1e-6)


def test_truth_tells_all_and_is_plain_json():
    run = make_log(
        "steps", 5.0, ["mechanical.backlash"], settings={"mechanical.J": 800.0}, seed=9, friction="lugre"
    )
    truth = json.loads(json.dumps(run.truth, allow_nan=False))
    assert truth["synthetic"] is True
    assert truth["hidden"] == [
        {"effect": "mechanical.backlash", "block": "mechanical",
         "parameters": {"gap": {"value": 0.2 * DEG, "unit": "rad"}}}
    ]  # fmt: skip
    assert truth["settings"] == {"mechanical.J": {"value": 800.0, "unit": "kg.m2"}}
    assert (truth["seed"], truth["friction"], truth["excitation"]["name"]) == (9, "lugre", "steps")
    assert np.isclose(truth["start"]["value"], run.true["theta"][0])
    assert {"mechanical.J", "mechanical.gap", "mechanical.theta_0"} == set(truth["not_nominal"])
    assert truth["versions"]["numpy"] == np.__version__
