"""The first screen for people who run the machine."""

import numpy as np
import pytest
from report_helpers import empty_answer, named

from cosim.diagnosis.answer.schema import Location, RefusedCause, Rival, Signal, SignalGain
from cosim.lexicon import ELECTRIC_DRIVER, Lexicon, speaking
from cosim.machines.make import DRIVER
from cosim.report.material import Material, Noise, Part
from cosim.report.overview import nothing_to_extend
from cosim.report.plain import ADVICE, MOTOR, advice, chain, ordered, quiet_signals, three_sentences
from fmus import registry


def friction(**changes):
    found = named("mechanical.coulomb_friction", {"tau_c": 99.8})
    return found.model_copy(update=changes)


def material(parts=(), **changes):
    return Material(
        empty_answer(**changes), 1e-3, {"measured": {"slew": np.zeros(3)}}, {p.name: p for p in parts}
    )


def part(name, drive, *signals):
    return Part(name, drive, {s: Noise(1, 1, False, 1.0) for s in signals}, {}, {})


def test_every_effect_of_the_library_has_something_to_check():
    assert {name for name in ADVICE if "." in name and not name.startswith("port.")} == set(
        registry.effects()
    )
    for name, steps in (*ADVICE.items(), *MOTOR.items()):
        assert 1 <= len(steps) <= 3, name
        for step in steps:
            assert step.endswith("."), name
            assert 30 < len(step) < 200, name


def test_a_motor_is_no_slewing_drive():
    """What can be named on a motor has steps of its own, which speak of no oil, boom or rack."""
    oil = {n for n in registry.effects() if n.partition(".")[0] in ("dcv", "continuity")} - set(DRIVER)
    nameable = {
        n for n in registry.effects() if n.partition(".")[0] in ("dead_zone", "dcv", "mechanical")
    } - oil
    assert nameable - set(MOTOR) == {"mechanical.end_stop", "mechanical.linkage"}
    words = ("oil", "boom", "rack", "spool", "valve", "pressure", "slew")
    assert not [s for steps in MOTOR.values() for s in steps if any(w in s.lower().split() for w in words)]
    answer = material(causes=[friction()]).answer
    with speaking(Lexicon(blocks={"dcv": ELECTRIC_DRIVER})):
        assert advice(answer)[0][1] == MOTOR["mechanical.coulomb_friction"]
    assert advice(answer)[0][1] == ADVICE["mechanical.coulomb_friction"]


def test_a_cause_in_three_sentences():
    gain = SignalGain(rmse_before=0.16, rmse_after=0.0098, noise_floor=0.01, ci95_of_ratio=(0.05, 0.07), unit="deg",
                      fit_percent_before=70.0, fit_percent_after=98.0)  # fmt: skip
    alike = friction(indistinguishable_from=["continuity.cracking_pressure"])
    told = three_sentences(material(causes=[alike], gain={"slew": gain}))
    assert [label for label, _ in told] == ["What is wrong", "How sure", "What it explains"]
    assert "Coulomb friction" in told[0][1]
    assert told[1][1] == "This log cannot tell it from cracking pressure of the counterbalance valve."
    assert "from 0.16 to 0.0098 deg" in told[2][1]
    assert all(text.count(". ") == 0 and "log-likelihood" not in text for _, text in told)


def test_a_prediction_over_the_whole_log_has_no_span(diagnosed):
    text = (diagnosed / "report.html").read_text(encoding="utf-8")
    assert "nan s at a time" not in text


def test_what_to_check_follows_the_causes_and_what_they_cannot_be_told_from():
    alike = friction(indistinguishable_from=["continuity.cracking_pressure"])
    found = advice(material(causes=[alike]).answer)
    assert [name for name, _ in found] == ["Dry friction", "Cracking pressure of the counterbalance valve"]
    assert "cosim check" in advice(material(verdict="adequate").answer)[0][1][0]
    assert "No part of the machine" in advice(material(verdict="unexplained").answer)[0][1][0]


def test_the_chain_follows_the_wires_and_is_coloured_by_the_share():
    parts = [
        part("mechanical", "p_load", "slew"),
        part("continuity", "spool", "p_load"),
        part("dcv", "u", "spool"),
    ]
    rows = [
        Location(block="mechanical", signal="slew", share=0.9, residual_rms=9.0, noise_floor=1.0, unit="deg"),
        Location(block="dcv", signal="spool", share=0.1, residual_rms=1.0, noise_floor=1.0, unit="mm"),
    ]
    found = chain(material(parts, localisation=rows, causes=[friction()], not_judged={"sensor": "no slew"}))
    assert [link.block for link in found] == ["valve", "hydraulics", "mechanics", "slew sensor"]
    assert [link.share for link in found] == [0.1, 0.0, 0.9, None]
    assert found[2].target == "cause-1"
    assert found[0].target == "residual-dcv-spool"
    assert (found[0].within, found[2].within) == (True, False)


def test_a_loop_has_an_order_too():
    loop = [part("a", "y", "x"), part("b", "x", "y")]
    assert {p.name for p in ordered(loop)} == {"a", "b"}


def test_each_of_several_causes_says_what_it_cannot_be_told_from():
    told = friction().model_copy(update={"indistinguishable_from": ["continuity.cracking_pressure"]})
    other = named("mechanical.inertia", {"J": 900.0})
    text = dict(three_sentences(material(causes=[other, told])))["How sure"]
    assert text == "This log cannot tell dry friction from cracking pressure of the counterbalance valve."
    alone = dict(three_sentences(material(causes=[told])))["How sure"]
    assert alone == "This log cannot tell it from cracking pressure of the counterbalance valve."


def test_what_only_data_left_out_told_apart_is_said_so():
    """ "Fits the log clearly worse" would be wrong of a rival that fits as well and was refused on other data."""
    refused = {"block": "mechanical", "why": "worse", "instead": "mechanical.stribeck_friction"}
    peak = named("mechanical.stribeck_friction", {"tau_s": 50.0})
    peak = peak.model_copy(update={"rivals": [Rival(effect="mechanical.inertia", why_not="50 behind")]})
    level = RefusedCause(effect="mechanical.coulomb_friction", **refused)
    text = dict(three_sentences(material(causes=[peak], refused=[level])))["How sure"]
    assert (
        text == "Explanations that fit the log as well predict data that were left out worse: dry friction."
    )
    gone = level.model_copy(update={"instead": None})
    text = dict(three_sentences(material(causes=[peak], refused=[gone])))["How sure"]
    assert text == "Every other explanation that was tried fits the log clearly worse."


def test_where_nothing_is_wrong_there_is_no_extended_model():
    gain = {"rmse_before": 1.0, "noise_floor": 1.0, "unit": "deg", "ci95_of_ratio": (1.0, 1.0)}
    gain |= {"fit_percent_before": 90.0, "fit_percent_after": 90.0}
    same, better = (SignalGain(**gain, rmse_after=after) for after in (1.004, 0.8))
    clean = material(verdict="adequate", gain={"slew": same}).answer
    assert nothing_to_extend(clean)
    fitted = clean.model_copy(update={"gain": {"slew": better}})
    assert not nothing_to_extend(fitted), "nominal parameters were fitted, and that is worth showing"
    assert not nothing_to_extend(clean.model_copy(update={"causes": [friction()]}))


@pytest.mark.parametrize(("errors", "quiet"), [((1.0, 5.0), {"spool"}), ((1.0, 1.0), {"spool"})])
def test_signals_within_noise_are_folded_but_for_the_motion_where_all_are(errors, quiet):
    signals = {
        name: Signal(rmse=error, fit_percent=0.0, unit="1", noise_floor=1.0)
        for name, error in zip(("spool", "slew"), errors, strict=True)
    }
    assert quiet_signals(material(signals=signals).answer) == quiet
