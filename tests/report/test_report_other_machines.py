"""Texts of another machine than the crane: none speaks of the crane's parts, ranges or way to move."""

import re
from types import SimpleNamespace

import pytest

from cosim.anysystem.page import TEXTS
from cosim.diagnosis.answer.schema import NamedCause
from cosim.lexicon import Lexicon, speaking
from cosim.report.language import catalogue
from cosim.report.names import kind_of_motion
from cosim.report.plain import ADVICE, OF_OTHERS, advice
from cosim.report.words import CAPTIONS, FORMS, NAMES, PHRASES, PHYSICAL, the
from fmus import registry

PARTS = re.compile(r"\b(boom|slew\w*|rack|crane|outriggers?|column|base)\b", re.I)
TURNS = re.compile(r"\b(torques?|angles?|turns|inertia)\b", re.I)
OTHER = Lexicon(blocks={"mechanical": "axis"})
LINEAR = Lexicon(blocks={"mechanical": "axis"}, units={"rad": "m"})
OIL = re.compile(r"oil column|turns turbulent")


def texts() -> set[str]:
    """Whatever a report or the screen says of an effect."""
    found = {text for pair in [*PHRASES.values(), *PHYSICAL.values()] for text in pair}
    found |= {*NAMES.values(), *FORMS.values(), *CAPTIONS.values()}
    found |= {text for pair in (ADVICE | OF_OTHERS).values() for text in pair}
    for name, effect in registry.effects().items():
        if name.startswith("tracker."):
            continue  # the tracker goes with the crane alone
        found |= {effect.text, effect.residual}
        found |= {p.text for p in effect.parameters.values()}
        found |= {
            registry.parameter(effect.component, n).text for n in effect.free if n not in effect.parameters
        }
    return found


def test_the_crane_s_own_texts_speak_of_its_parts():
    assert sum(bool(PARTS.search(text)) for text in texts()) > 20
    assert kind_of_motion("a flexible boom") == "a flexible boom"


@pytest.mark.parametrize(("lexicon", "words"), [(OTHER, PARTS), (LINEAR, PARTS), (LINEAR, TURNS)])
def test_no_text_of_another_machine_has_words_of_the_crane(lexicon, words):
    with speaking(lexicon):
        said = {text: OIL.sub("oil", kind_of_motion(text)) for text in texts()}
    assert [text for text in said.values() if words.search(re.sub(r"\{[^}]*\}", "", text))] == []


def test_in_german_no_part_of_the_crane_is_left_either():
    german = catalogue("de").messages
    with speaking(OTHER):
        said = {kind_of_motion(text) for text in texts()} & german.keys()
    assert len(said) > 100
    parts = re.compile(r"Ausleger|Schwenk|Säule|Unterbau|Kran\b|Abstütz")
    assert [german[text] for text in said if parts.search(german[text])] == []
    assert {text for pair in (ADVICE | OF_OTHERS).values() for text in pair} <= german.keys()


def cause(effect: str, others=()) -> NamedCause:
    return NamedCause.model_construct(effect=effect, indistinguishable_from=list(others))


def test_each_effect_of_any_system_has_something_to_check():
    for effect in (*TEXTS, "parameter"):
        answer = SimpleNamespace(
            data=[], verdict="explained", causes=[cause(effect, ["port.gain at valve.u (input)"])]
        )
        told = advice(answer)
        assert told[0][1] == ADVICE[effect]
        assert told[-1][1] == ADVICE["port.gain"]


def test_what_to_check_on_an_axis_names_none_of_the_crane_s_parts():
    answer = SimpleNamespace(
        data=[], verdict="explained", causes=[cause("sensor.bias"), cause("mechanical.inertia")]
    )
    with speaking(LINEAR):
        told = advice(answer)
    assert told[0][1][0] == "Drive to a mark whose position is known and set the sensor's zero."
    assert told[1][1][0] == "Ask what load was moved, and how far out it was; set the model's mass to that."


def test_a_signal_without_a_name_of_its_own_has_no_article():
    assert the("slew") == "the slew angle"
    assert the("valve.y") == "valve.y"
