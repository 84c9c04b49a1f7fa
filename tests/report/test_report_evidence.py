"""Evidence must convict: the true law passes through the data, the nominal model and a wrong size do not."""

import importlib
import pkgutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from report_helpers import empty_answer, hidden_material, material_of, named

from cosim.diagnosis.answer.schema import Words
from cosim.lexicon import Lexicon, Shown, speaking
from cosim.report.evidence import MAKERS, driver, free_form, pictures
from cosim.report.folder import keep, load
from cosim.report.material import (
    BLOCK_EXTENDED,
    EXTENDED,
    KINDS,
    MEASURED,
    NOMINAL,
    Curve,
    Material,
    Noise,
    Part,
)
from cosim.report.overview import held_out, held_signals, signals, window
from cosim.report.picture import Panel
from cosim.report.reading import speed_over_angle
from cosim.report.torque import Motion
from cosim.report.words import PHRASES
from cosim.rig import EFFECTS, Hidden, make_log
from fmus import effects, registry

# effects that the rig can hide whose picture shows means (or responses) beside the two models' lines
BESIDE = [
    e
    for e in MAKERS
    if e in EFFECTS
    and e not in ("mechanical.compliance", "sensor.quantisation", "sensor.dropout", "dcv.stroke_limit")
    and e not in ("mechanical.end_stop", "sensor.saturation")
]
JUMPS = {
    "mechanical.coulomb_friction",
    "mechanical.stribeck_friction",
    "continuity.cracking_pressure",
    "tracker.seam",
    "dead_zone.mismatch",
}


def needs_tracker(effect):
    return effect.startswith("tracker.") or effect == "sensor.bias"


@cache
def nominal(name):
    """Nominal value of ``component.parameter``, SI, as the material of any log has it."""
    return material_of(make_log("steps", 5.0, [], seed=3), []).nominal(name)


@cache
def hidden(effect):
    """A log with the effect in it, made once for all claims about it."""
    return begun(effect)


def begun(effect, **options):
    return make_log("mixed", 30.0, [Hidden(effect)], seed=3, tracker=needs_tracker(effect), **options)


@pytest.fixture(scope="module", autouse=True)
def _logs_go():
    yield
    hidden.cache_clear()


def made(effect, scale=1.0, **options):
    """Material of a log with the effect in it, its parameters claimed to be `scale` times their true deviation."""
    run = begun(effect, **options) if options else hidden(effect)
    values = {}
    for name, value in Hidden(effect).numbers().items():
        short = name.partition(".")[2]
        values[short] = value
    key = registry.effects()[effect].key
    off = nominal(f"{registry.effects()[effect].component}.{key}")
    # of a limit the off value is out of reach: its own size is scaled
    values[key] = scale * values[key] if effect == "dcv.rate_limit" else off + scale * (values[key] - off)
    return material_of(run, [named(effect, values)])


def distances(panel: Panel, effect: str) -> tuple[float, float]:
    """RMS distance of the data (means, or else the measured line) from the extended and from the nominal line."""
    lines = {layer.role: layer for layer in panel.layers if layer.kind == "line"}
    data = [layer for layer in panel.layers if layer.kind == "means"] or [lines["measured"]]
    x, y = data[0].x, data[0].y
    away = np.ones(x.size, dtype=bool)
    if effect in JUMPS:  # smoothing rounds a jump
        at = 12.0 if effect == "tracker.seam" else 0.0
        away = np.abs(x - at) > 0.2 * np.max(np.abs(x - at))
    both = []
    for role in ("extended", "nominal"):
        line = lines[role]
        both.append(float(np.sqrt(np.mean((np.interp(x, line.x, line.y) - y)[away] ** 2))))
    return both[0], both[1]


@pytest.mark.parametrize("effect", [e for e in BESIDE if e != "dcv.hysteresis"])
def test_the_law_passes_through_the_data_and_the_nominal_model_does_not(effect):
    material = made(effect)
    for picture in pictures(material, material.answer.causes[0]):
        extended, nominal = distances(picture.panels[-1], effect)
        assert extended < 0.2 * nominal, picture.title


@pytest.mark.parametrize(
    "effect", [e for e in BESIDE if e not in ("dcv.hysteresis", "dcv.delay", "sensor.gain", "tracker.clock")]
)
def test_a_wrong_size_shows(effect):
    right, wrong = made(effect), made(effect, scale=1.6)
    at_right = distances(pictures(right, right.answer.causes[0])[0].panels[-1], effect)[0]
    at_wrong = distances(pictures(wrong, wrong.answer.causes[0])[0].panels[-1], effect)[0]
    assert at_wrong > 2.0 * at_right


def test_a_cause_claimed_of_a_clean_log_is_refuted_by_its_picture():
    run = make_log("mixed", 30.0, seed=5)
    material = material_of(run, [named("mechanical.coulomb_friction", {"tau_c": 100.0})])
    picture = pictures(material, material.answer.causes[0])[0]
    extended, nominal = distances(picture.panels[0], "mechanical.coulomb_friction")
    assert nominal < 0.1 * extended


def test_friction_is_seen_behind_another_named_cause():
    material = hidden_material("mechanical.coulomb_friction", also=("mechanical.viscous_friction",))
    friction, viscous = material.answer.causes
    for cause in (friction, viscous):
        picture = pictures(material, cause)[0]
        extended, nominal = distances(picture.panels[0], "mechanical.coulomb_friction")
        assert extended < 0.2 * nominal, cause.effect


def test_hysteresis_opens_a_loop_of_its_width():
    material = made("dcv.hysteresis")
    picture = pictures(material, material.answer.causes[0])[0]
    half = 100.0 * material.size(material.answer.causes[0], "play")
    for role, sign in (("rising", -1.0), ("falling", 1.0)):
        layer = picture.layer(role, kind="means")
        inner = (np.abs(layer.x) > 15.0) & (np.abs(layer.x) < 85.0)
        assert inner.sum() >= 5
        assert np.median(layer.y[inner]) == pytest.approx(sign * half, rel=0.1)


def test_a_flexible_mode_is_a_peak_that_goes():
    material = made("mechanical.compliance")
    picture = pictures(material, material.answer.causes[0])[0]
    without, extended = picture.layer("nominal"), picture.layer("extended")
    peak = int(np.argmax(without.y))
    assert without.y[peak] > 10.0 * extended.y[peak]
    assert 1.0 < without.x[peak] < 3.0  # the coupled mode lies above the boom's 10 rad/s alone


def test_a_stop_flattens_the_measured_spool():
    material = made("dcv.stroke_limit")
    first = pictures(material, material.answer.causes[0])[0]
    data, extended = first.layer("measured"), first.layer("extended")
    beyond = data.x > extended.y.max() + 0.3
    assert beyond.sum() > 20
    assert np.median(data.y[beyond]) == pytest.approx(extended.y.max(), abs=0.02)


@pytest.mark.parametrize("effect", ["mechanical.end_stop", "sensor.saturation"])
def test_a_reading_that_stays_at_an_end_is_followed_with_it_alone(effect):
    material = made(effect, settings={"mechanical.theta_0": np.radians(15.0)})  # between the ends
    picture = pictures(material, material.answer.causes[0])[0]
    measured, without, extended = (picture.layer(r).y for r in ("measured", "nominal", "extended"))
    assert np.max(np.abs(extended - measured)) < 0.02
    assert np.max(np.abs(without - measured)) > 0.2


def test_a_coarse_reading_is_a_staircase():
    material = made("sensor.quantisation")
    picture = pictures(material, material.answer.causes[0])[0]
    levels = np.unique(np.round(picture.layer("measured").y, 6))
    step = np.degrees(material.size(material.answer.causes[0], "quantum"))
    assert 2 <= levels.size <= 8
    assert np.diff(levels) == pytest.approx(np.full(levels.size - 1, step), rel=1e-3)


def test_stale_samples_come_as_often_as_named():
    material = made("sensor.dropout")
    picture = pictures(material, material.answer.causes[0])[0]
    measured, expected = picture.layer("measured").y, picture.layer("extended").y
    assert abs(measured[0] - expected[0]) < 5.0 * np.sqrt(expected[0])


def test_every_effect_of_the_library_has_a_picture_and_words_of_its_own():
    library = {
        importlib.import_module(f"fmus.effects.{m.name}").EFFECT.name
        for m in pkgutil.iter_modules(effects.__path__)
    }
    assert len(library) > 25
    assert library == set(MAKERS) == set(PHRASES)


def test_an_effect_without_a_picture_gets_its_residual(monkeypatch):
    material = made("mechanical.gravity_load")
    monkeypatch.delitem(MAKERS, "mechanical.gravity_load")
    (picture,) = pictures(material, material.answer.causes[0])
    size = {role: float(np.std(picture.layer(role, kind="points").y)) for role in ("nominal", "extended")}
    assert size["extended"] < 0.1 * size["nominal"]


def test_a_log_without_what_the_picture_needs_gets_its_residual_too():
    material = made("mechanical.coulomb_friction")
    del material.measured["p_load"]
    (picture,) = pictures(material, material.answer.causes[0])
    assert picture.title.startswith("Residual of the slew angle")


def test_free_form_curve_in_units_people_read():
    curve = Curve("supply(abs(spool))", 12.0, np.array([0.0, 1e-3]), np.array([0.0, -2e5]))
    picture = free_form("continuity", "p_supply", curve, "rest")
    assert picture.x == "spool opening [mm]"
    assert picture.panels[0].layers[0].x.tolist() == [0.0, 1.0]
    assert picture.panels[0].layers[0].y.tolist() == [0.0, -2.0]


def test_the_curve_of_a_factor_stands_over_what_it_changes_with():
    """Over 0 to 62 deg of a boom it was labelled "speed, changing with angle [deg/s]"."""
    knots, factor = np.radians([0.0, 62.0]), np.array([0.0, 5.0])  # N m per rad/s
    curve = Curve("torque(omega, changing with theta)", 31.0, knots, factor)
    picture = free_form("mechanical", "slew", curve, "rest")
    assert picture.x == "slew angle [deg]"
    assert picture.title.startswith("Missing torque per slew speed against slew angle")
    (panel,) = picture.panels
    assert panel.y == "missing torque per slew speed [N m per deg/s]"
    np.testing.assert_allclose(panel.layers[0].x, [0.0, 62.0])
    np.testing.assert_allclose(panel.layers[0].y, [0.0, np.radians(5.0)])
    of = "torque(acceleration, changing with time)"
    (panel,) = free_form("mechanical", "slew", replace(curve, label=of), "rest").panels
    assert panel.y == "missing torque per slew acceleration [N m per deg/s²]"


def test_without_steps_a_response_is_shown_where_the_models_differ_most():
    run = make_log("sweep", 30.0, [Hidden("dcv.bandwidth")], seed=3)
    values = {n.partition(".")[2]: v for n, v in Hidden("dcv.bandwidth").numbers().items()}
    material = material_of(run, [named("dcv.bandwidth", values)])
    (picture,) = pictures(material, material.answer.causes[0])
    assert picture.x == "time [s]"
    extended, nominal = distances(picture.panels[-1], "dcv.bandwidth")
    assert extended < 0.2 * nominal


def servo(span=0.8, h=1.0 / 1500.0):
    """Torque and speed of a drive over 0.8 s: 0.01 kg m2, 0.02 N m s/rad, 3 N m of dry friction; no pressure."""
    time = np.arange(round(span / h)) * h
    speed = 100.0 * np.sin(2.0 * np.pi * 2.0 * time)
    torque = 0.01 * np.gradient(speed, h) + 0.02 * speed + 3.0 * np.sign(speed)
    part = Part("mechanical", "torque", {"speed": Noise(15, 20, True, 0.1)}, {}, {})
    values = {"mechanical.A": 1.0, "mechanical.r": 1.0, "mechanical.J": 0.01, "mechanical.b": 0.02}
    words = Words(signals={}, units={}, blocks={"mechanical": "motor"}, values=values)
    friction = named("mechanical.coulomb_friction", {"tau_c": 3.0})
    answer = empty_answer(causes=[friction], words=words)
    series = {"measured": {"torque": torque, "speed": speed}}
    return Material(answer, h, series, {"mechanical": part}), friction


SERVO = Lexicon(
    signals={"speed": Shown("rpm", 30.0 / np.pi, "speed"), "torque": Shown("N.m", 1.0, "applied torque")},
    blocks={"mechanical": "motor"},
)


def test_a_measured_speed_is_no_angle():
    material, friction = servo()
    with speaking(SERVO):
        motion = Motion(material, friction)
    assert np.abs(motion.omega).max() == pytest.approx(100.0, rel=0.02)
    fast = np.abs(motion.omega) > 50.0
    # a third-order filter at 25 Hz rounds off the jumps of friction within some 40 ms
    assert np.median(motion.missing[fast] * np.sign(motion.omega[fast])) == pytest.approx(3.0, rel=0.05)


def test_the_caption_of_a_measured_torque_speaks_of_no_pressure():
    material, friction = servo()
    with speaking(SERVO):
        [picture] = pictures(material, friction)[:1]
    assert picture.caption.startswith("Torque that was measured, less what inertia")
    # what is missing is not the signal of the same name
    assert picture.title.startswith("Missing torque against speed")


def test_friction_at_standstill_goes_on_top_of_the_dry_one():
    material, friction = servo()
    more = named("mechanical.stribeck_friction", {"tau_c": 3.0, "tau_s": 2.0, "omega_s": 5.0})
    material.answer = material.answer.model_copy(update={"causes": [friction, more]})
    with speaking(SERVO):
        motion = Motion(material, friction)
    fast = np.abs(motion.omega) > 50.0
    assert np.median(motion.missing[fast] * np.sign(motion.omega[fast])) == pytest.approx(3.0, rel=0.05)


def test_windows_held_out_of_a_short_log_are_those_of_the_fits():
    material, _ = servo()
    assert window(material) == 300
    assert held_out(material) == [pytest.approx((0.4, 0.6))]


def test_pictures_of_a_held_out_log_shade_nothing():
    """All of it was held out; the spans of the fitted log are not its own, and it may be longer."""
    material, _ = servo()
    time = material.time
    series = {"measured": {"slew": np.sin(time)}, NOMINAL: {"slew": 0.0 * time}, EXTENDED: {}}
    fitted = replace(material, series=series)
    end = fitted.answer.model_copy(update={"held_out_from": 0.5 * float(time[-1])})
    both = replace(fitted, answer=end, other=replace(fitted, answer=end))
    (own,), (other,) = signals(both), held_signals(both)
    assert own.shaded == [pytest.approx((0.5 * time[-1], time[-1]))]
    assert own.caption.endswith("Shaded: not used for fitting.")
    assert other.shaded == []
    assert "Shaded" not in other.caption


def test_nothing_is_differentiated_or_smoothed_across_the_seam_of_two_logs(tmp_path):
    """The speeds over an excavator's boom, 10 to 30 deg/s, were told as 600 where the second log began anew."""
    h, ramp = 0.01, np.radians(np.concatenate([60.0 - 12.0 * np.arange(0.0, 5.0, 0.01)] * 2))
    cause = named("mechanical.linkage", {"e_l": 0.3, "theta_l": 0.0})
    series = {kind: {} for kind in KINDS} | {
        MEASURED: {"slew": ramp},
        BLOCK_EXTENDED: {"slew": ramp},
        "without mechanical.linkage": {"slew": ramp},
    }
    material = Material(empty_answer(causes=[cause]), h, series, {}, cuts=(500,))
    (panel,) = speed_over_angle(material, cause).panels
    for layer in panel.layers:
        assert layer.y.size > 300
        np.testing.assert_allclose(layer.y, -12.0, rtol=1e-3)
    np.testing.assert_allclose(driver(material, "omega", cause), np.radians(-12.0))
    keep(material, tmp_path)  # and from its folder
    (tmp_path / "diagnosis.json").write_text(material.answer.model_dump_json())
    assert load(tmp_path).cuts == (500,)
