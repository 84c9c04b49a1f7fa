import math
import string

import pytest
from report_helpers import empty_answer, named

from cosim.diagnosis.answer.schema import SignalGain, Unexplained
from cosim.lexicon import Lexicon, Shown, speaking
from cosim.report.evidence import MAKERS
from cosim.report.language import reported_in, said
from cosim.report.material import Material, Noise, Part
from cosim.report.words import (
    CAPTIONS,
    PHRASES,
    PHYSICAL,
    axis,
    block_name,
    called,
    doubts,
    effect_in_block,
    few,
    fit_text,
    number,
    phrase,
    prose,
    quantity,
    sentence,
    shows_speed,
    two_digits,
    unit_text,
    with_signals,
    without_tracker,
)
from cosim.rig import EFFECTS, Hidden
from fmus import registry


def gain(before, after, noise):
    return SignalGain(
        rmse_before=before,
        rmse_after=after,
        unit="deg",
        noise_floor=noise,
        fit_percent_before=80.0,
        fit_percent_after=99.0,
        ci95_of_ratio=(0.05, 0.07),
    )


def material(**changes):
    parts = {n: Part(n, "u", {"slew": Noise(10, 500, True, 0.1)}, {}, {}) for n in ("dcv", "mechanical")}
    return Material(empty_answer(**changes), 1e-3, {"measured": {}}, parts)


def friction(**changes):
    cause = named("mechanical.coulomb_friction", {"tau_c": 100.0}, spread=0.015)
    return cause.model_copy(update=changes)


@pytest.mark.parametrize(
    ("value", "spread", "text"),
    [
        (100.0104, 1.5, "100.0"),
        (26653.76, 65.0, "26654"),
        (26653.76, 0.0, "26650"),
        (0.0123456, 0.0, "0.01235"),
        (2e-5, 1e-6, "2e-05"),
        (float("nan"), 1.0, "unknown"),
        (3.0, float("nan"), "3"),
        (-0.28, 10.0, "0"),
    ],
)
def test_numbers_have_the_digits_they_deserve(value, spread, text):
    assert number(value, spread) == text


def test_units_as_people_write_them():
    assert unit_text("N.m.s/rad") == "N m s/rad"
    assert unit_text("kg.m2") == "kg m²"
    assert unit_text("1") == ""


def test_a_fit_of_nothing_has_no_sign():
    assert fit_text(-0.003) == "0.0 %"
    assert fit_text(-12.3) == "-12.3 %"
    assert fit_text(float("nan")) == "unknown"


def test_the_verdict_is_what_a_person_would_say():
    told = sentence(material(causes=[friction()], gain={"slew": gain(0.16, 0.0098, 0.0098)}))
    assert told == (
        "The simulation gets the friction wrong: 100.0 N m Coulomb friction (98.5 to 101.5) is missing in the "
        "mechanics; with it the error of the slew angle on data not used for fitting falls from "
        "0.16 to 0.0098 deg, which is the sensor's noise."
    )


def test_several_causes_are_told_one_by_one():
    causes = [friction(), named("dcv.damping", {"zeta": 0.75})]
    said = sentence(material(causes=causes, gain={"slew": gain(0.16, 0.0098, 0.0098)}))
    assert said.startswith("The simulation gets 2 things wrong. The friction: 100.0 N m Coulomb friction")
    assert "The valve's damping: its damping ratio is 0.750 (0.735 to 0.765) instead of 0.545." in said
    assert "With all of them the error of the slew angle on data not used for fitting falls from 0.16" in said


def test_a_rest_above_the_noise_is_not_called_noise():
    told = sentence(material(causes=[friction()], gain={"slew": gain(0.16, 0.02, 0.01)}))
    assert told.endswith("falls from 0.16 to 0.02 deg, against a noise of 0.01 deg.")


def test_what_a_torque_depends_on_is_the_signal_of_that_name():
    friction = "a missing torque that depends on torque explains 64% of it"
    assert with_signals(friction) == "a missing torque that depends on missing torque explains 64% of it"
    with speaking(Lexicon(signals={"torque": Shown("N.m", 1.0, "applied torque")})):
        assert with_signals(friction) == "a missing torque that depends on applied torque explains 64% of it"


def test_no_gain_is_not_called_a_gain():
    told = sentence(material(causes=[friction()], gain={"slew": gain(0.16, 0.17, 0.01)}))
    assert told.endswith("on data not used for fitting stays at 0.16 deg.")


def test_another_machine_has_no_slew_and_a_line_no_torque():
    coarse = named("sensor.quantisation", {"quantum": math.radians(2.5e-5)}, spread=0.01)
    coarse.parameters["quantum"].unit = "m"
    friction = "a missing torque that depends on omega explains 93% of it"
    own = {"sensor": "sensor"}
    assert called("sensor.quantisation") == "coarse steps of the slew sensor"
    with speaking(Lexicon(blocks=own)):
        assert called("sensor.quantisation") == "coarse steps of the sensor"
        assert with_signals(friction) == "a missing torque that depends on speed explains 93% of it"
        assert axis("measured slew speed", "deg/s") == "measured speed [deg/s]"
    with speaking(Lexicon(blocks=own | {"mechanical": "axis"}, units={"rad": "m"})):
        assert with_signals(friction) == "a missing force that depends on speed explains 93% of it"
        assert quantity("theta")[0] == "position"
        assert block_name("dcv+mechanical+sensor") == "valve + axis + sensor"
        assert "in steps of 0.02500 mm (0.02" in sentence(material(causes=[coarse]))
        with reported_in("de"):
            assert said(called("sensor.quantisation")) == "grobe Stufen des Sensors"


def test_an_adequate_model_is_said_to_agree():
    told = sentence(material(verdict="adequate"))
    assert told.startswith("The simulation agrees with the log: in valve and mechanics")


def test_an_unexplained_rest_names_its_block_and_no_cause():
    rest = Unexplained(block="mechanical", what="a missing torque", residual_rms=0.1, unit="deg")
    told = sentence(material(verdict="unexplained", unexplained=[rest]))
    assert "in the mechanics" in told
    assert "friction" not in told
    both = sentence(material(verdict="partly_explained", causes=[friction()], unexplained=[rest]))
    assert both.endswith("Something else in the mechanics stays unexplained.")


def test_a_long_list_is_cut():
    assert few("x would show: a, b, c") == "x would show: a, b, c"
    assert few("x would show: " + ", ".join("abcdefgh")) == "x would show: a, b, c, d, e and 3 more"
    assert few("no list at all") == "no list at all"


def test_doubt_is_said():
    cause = friction(indistinguishable_from=["continuity.cracking_pressure"])
    assert doubts(empty_answer(causes=[cause])) == [
        "This log cannot tell dry friction from cracking pressure of the counterbalance valve."
    ]
    assert doubts(empty_answer(causes=[friction()])) == []


@pytest.mark.parametrize("effect", sorted(PHYSICAL))
def test_the_physical_hydraulics_have_words_of_their_own(effect):
    here = registry.effect_on(effect, "continuity_physical")
    values = {n: item.starts[-1] for n, item in here.free.items()}
    _, how = phrase(named(effect, values), material())
    assert " to " in how
    assert "its nominal value" not in how
    assert "is missing" not in how, "the general words"


@pytest.mark.parametrize("effect", sorted(PHRASES))
def test_every_effects_words_use_its_own_parameters(effect):
    wanted = {
        field.partition(".")[0] for _, field, _, _ in string.Formatter().parse(PHRASES[effect][1]) if field
    }
    assert wanted
    assert wanted <= set(registry.effects()[effect].free)
    free = registry.effects()[effect].free
    values = {n: item.starts[-1] for n, item in free.items()}
    if effect in EFFECTS:  # the rig's sizes where it can hide the effect
        values = {n.partition(".")[2]: v for n, v in Hidden(effect).numbers().items()}
    noun, how = phrase(named(effect, values), material())
    assert noun
    assert " to " in how  # an interval
    assert "its nominal value" not in how


def test_a_made_up_effect_is_named_with_its_parameters():
    cause = friction(effect="mechanical.snow_load")
    noun, how = phrase(cause, material())
    assert noun == "the snow load"
    assert how == "snow load (mechanics) with tau_c = 100.0 N m (98.5 to 101.5) is missing"


def test_prose_calls_effects_by_name():
    assert effect_in_block("dcv.rate_limit") == "a limit of the spool's speed"
    assert effect_in_block("mechanical.snow_load") == "snow load (mechanics)"
    # names of a model of any system stay as they are
    assert effect_in_block("parameter boom.spool.p_c[1]") == "parameter boom.spool.p_c[1]"
    assert effect_in_block("port.dead_zone at boom.p_up (input)") == "dead zone at boom.p_up (input)"
    assert (
        prose("tells dcv.delay from sensor.lag") == "tells a delay of the valve from a lag of the slew sensor"
    )


def test_what_a_missing_thing_depends_on_is_told_in_words():
    assert quantity("omega, changing with theta") == (
        "slew speed, changing with slew angle",
        "deg/s",
        pytest.approx(57.29578),
    )
    told = with_signals(
        "a missing torque that depends on omega, changing with theta explains 83% of what is left"
    )
    assert (
        told
        == "a missing torque that depends on slew speed, changing with slew angle explains 83% of what is left"
    )


def test_without_a_tracker_its_faults_are_not_listed():
    line = "slew_external would make visible: sensor.gain, tracker.clock, tracker.seam"
    assert without_tracker(line) == "slew_external would make visible: sensor.gain"
    assert without_tracker("slew_external would make visible: tracker.clock") == ""


def test_captions_are_there_for_every_maker():
    names = {maker.__name__ for makers in MAKERS.values() for maker in makers}
    assert {"over_speed", "curve", "spectrum"} <= names & set(CAPTIONS)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (250.4, "250"),
        (1943.0, "1900"),
        (14.66, "15"),
        (0.0061, "0.0061"),
        (0.0, "0"),
        (99.6, "100"),
        (3.1e7, "3.1e+07"),
    ],
)
def test_two_digits_are_written_without_an_exponent(value, text):
    assert two_digits(value) == text


def test_a_speed_is_told_by_its_unit():
    shown = {
        "w": Shown("rpm", 9.55, "speed"),
        "q": Shown("l/min", 6e4, "flow"),
        "x": Shown("mm", 1e3, "place"),
    }
    with speaking(Lexicon(signals=shown | {"z": Shown("full command", 1.0, "z")})):
        assert [shows_speed(s) for s in ("w", "q", "x", "z", "slew")] == [True, True, False, False, False]


def test_the_speed_of_a_machine_that_measures_one_has_its_unit() -> None:
    """A motor's speed was drawn in rad/s, and its friction against 12 000 deg/s."""
    assert quantity("omega") == ("slew speed", "deg/s", pytest.approx(math.degrees(1.0)))
    with speaking(Lexicon({"speed": Shown("rad/s", 1.0, "speed")}, {}, {})):
        assert quantity("omega")[1:] == ("rad/s", 1.0)
        assert quantity("omega, changing with theta")[1:] == ("rad/s", 1.0)
