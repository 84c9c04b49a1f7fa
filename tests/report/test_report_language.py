"""The report in German: nothing that a reader sees stays English, and what a place holds is kept."""

import ast
import re
import tomllib
from pathlib import Path
from string import Formatter

import pytest
from report_helpers import friction_with_rest, hidden_material

from cosim.errors import UsageError
from cosim.report import names
from cosim.report.folder import load
from cosim.report.language import PLACE, Catalogue, catalogue, reported_in, said
from cosim.report.page import page
from cosim.report.plain import ADVICE, MOTOR
from cosim.report.words import CAPTIONS, FORMS, NAMES, PHRASES, PHYSICAL, effect_name
from cosim.rig import EFFECTS
from fmus import registry

REPORT = Path(__file__).resolve().parents[2] / "cosim" / "report"


@pytest.fixture
def german():
    """The catalogue, with nothing missing yet."""
    found = catalogue("de")
    found.missing.clear()
    with reported_in("de"):
        yield found


def sample(text):
    """A phrase with numbers in its places."""
    made = ""
    for literal, place, _, _ in Formatter().parse(text):
        made += literal
        if place is not None:
            made += "1.5 to 2.5" if place.endswith(".interval") else "2.1 bar"
    return made


def test_every_place_is_kept():
    content = tomllib.loads((REPORT / "de.toml").read_text(encoding="utf-8"))
    for english, translated in content["messages"].items():
        places = [sorted(PLACE.findall(text)) for text in (english, translated)]
        assert set(places[0]) == set(places[1]), english


def test_every_literal_of_the_page_is_known(german):
    text = (REPORT / "page.html.j2").read_text(encoding="utf-8").partition("<script>")[0]
    literals = [
        found
        for expression in re.findall(r"\{\{(.*?)\}\}", text, re.DOTALL)
        for found in re.findall(r'"([^"]*[a-z]{3}[^"]*)"', expression.partition("|replace(")[0])
        if "~" not in expression and "%" not in found
    ]
    assert len(literals) > 60
    for literal in literals:
        said(literal)
    assert german.missing - {"hot"} == set()
    inner = re.sub(r"\{\{.*?\}\}|\{%.*?%\}", " ", text, flags=re.DOTALL)
    inner = re.sub(r"<style>.*?</style>|<code>.*?</code>|<[^>]*>", " ", inner, flags=re.DOTALL)
    assert re.findall(r"[A-Za-z]{4,}", inner) == [], "words in the page that are no expression"


def sentences_about_effects():
    """What a report says of causes, on the crane."""
    sentences = [s for steps in (*ADVICE.values(), *MOTOR.values()) for s in steps]
    for effect in registry.effects().values():
        sentences += [effect.text, effect.residual, effect_name(effect.name)]
        sentences += [variable.text for variable in effect.parameters.values()]
    sentences += [*NAMES.values(), *(noun for noun, _ in PHRASES.values())]
    sentences += [*names.SIGNAL_NAMES.values(), *names.BLOCK_NAMES.values()]
    sentences += [text for text, _, _ in names.QUANTITIES.values()]
    hows = [sample(how) for _, how in (*PHRASES.values(), *PHYSICAL.values())]
    captions = [re.sub(r"\{\w+(:[^}]*)?\}", "5", text) for text in CAPTIONS.values()]
    return [*sentences, *hows, *(hows[0] + sample(form) for form in FORMS.values()), *captions]


def test_every_word_about_effects_is_known(german):
    for text in sentences_about_effects():
        said(text)
    assert german.missing == set()


def test_every_word_about_effects_of_a_linear_axis_is_known(german):
    """A torque is a force there, and an inertia a mass, of other gender in German."""
    for text in sentences_about_effects():
        linear = names.replaced(names.replaced(text, names.OTHER_AXIS), names.TURNING)
        found = said(linear)
        assert not re.search("Moment|Trägheit|Winkel", found), (text, found)
    assert german.missing == set()
    assert said("another mass") == "eine andere Masse"
    assert names.replaced("triangle, slew angle", names.TURNING) == "triangle, slew position"


@pytest.mark.parametrize(
    ("english", "said_in_german"),
    [
        (
            "on data held out a linear model (order 2: a lag of 1.5 s, a lag of 0.2 s, a mode at 3 rad/s with damping 0.1, "
            "a delay of 0.08 s) predicts slew better than the extended model: 3.7 against 16.6 deg",
            "auf zurückgehaltenen Daten sagt ein lineares Modell (Ordnung 2: eine Verzögerung von 1,5 s, eine Verzögerung "
            "von 0,2 s, eine Eigenschwingung bei 3 rad/s mit Dämpfung 0,1, eine Totzeit von 0,08 s) slew besser "
            "vorher als das erweiterte Modell: 3,7 gegen 16,6 Grad",
        ),
        (
            "dcv: the time allowed (60 s) was over; not tried: a set of causes (16 of them), a further cause (3 of them)",
            "dcv: die erlaubte Zeit (60 s) war um; nicht versucht: ein Satz von Ursachen (16-mal), "
            "eine weitere Ursache (3-mal)",
        ),
        (
            "u: jumps away at 3 places, by up to 0.3714 (first: row 2): the file or the signal may be damaged there",
            "u: springt an 3 Stellen weg, um bis zu 0,3714 (zuerst: Zeile 2): dort kann die Datei oder das "
            "Signal beschädigt sein",
        ),
        ("0.92 full command", "0,92 voller Stellbefehl"),
        (
            "Held out from fitting: other logs, arm-in-50-H, arm-in-70-H, arm-in-90-H, which took no part in the fits.",
            "Bei der Anpassung zurückgehalten: andere Messungen, arm-in-50-H, arm-in-70-H, arm-in-90-H.",
        ),
    ],
)
def test_what_logs_of_machines_bring_about_is_german(german, english, said_in_german):
    assert said(english) == said_in_german


def test_a_german_report_of_a_diagnosis_has_no_english_left(german, diagnosed):
    text = page(load(diagnosed))
    assert german.missing == set()
    assert '<html lang="de">' in text
    assert "In der Simulation stimmt die Reibung nicht" in text
    assert re.search(r"<td class=\"n\">1\d\d,\d</td>", text), "a decimal comma"
    assert '"separators":",."' in text
    assert "&lt;b&gt;rig &amp; co" in text, "names of files are nobody's to translate"


def test_what_is_left_unexplained_is_said_in_german(german):
    text = page(friction_with_rest())
    assert "Etwas anderes bleibt unerklärt (Mechanik)." in text
    what = "a missing torque that depends on theta is left in slew angle"
    assert german.missing <= {what, f"Unexplained in the mechanics: {what}."}, "which no diagnosis writes"


@pytest.mark.slow
@pytest.mark.parametrize("effect", [e for e in EFFECTS if e in registry.effects()])
def test_the_pictures_of_every_effect_are_german(german, effect):
    page(hidden_material(effect, tracker=effect.startswith(("tracker.", "sensor.bias"))))
    assert german.missing == set()


def test_english_is_what_it_was(diagnosed):
    assert said("The simulation gets x wrong") == "The simulation gets x wrong"
    assert page(load(diagnosed)) == page(load(diagnosed))
    assert '<html lang="en">' in page(load(diagnosed))


MADE = {
    "the valve": "das Ventil",
    "it is {size}.": "es ist {size}.",
    "{a} and {b}": "{a} und {b}",
    "from {a} to {b} the log": "die Messung von {a} bis {b}",
    "twice {x}, {x}": "doppelt {x}, {x}",
}


@pytest.mark.parametrize(
    ("english", "translated", "missing"),
    [
        ("The valve", "Das Ventil", []),
        ("It is 2.5 bar.", "Es ist 2,5 bar.", []),
        ("it is 1.5 to 2.5.", "es ist 1,5 bis 2,5.", []),
        ("It is 1e-5. It is the valve.", "Es ist 1e-5. Es ist das Ventil.", []),
        ("the valve and the valve", "das Ventil und das Ventil", []),
        ("the valve and the pump", "das Ventil und the pump", ["the pump"]),
        (
            "the pump that broke and the valve",
            "the pump that broke and the valve",
            ["the pump that broke and the valve"],
        ),
        ("from 1 to 2 the log", "die Messung von 1 bis 2", []),
        ("twice the valve, the valve", "doppelt das Ventil, das Ventil", []),
        ("slew-cosim 0.1.0", "slew-cosim 0.1.0", ["slew-cosim 0.1.0"]),
        ("", "", []),
        (" – ", " – ", []),
    ],
)
def test_a_text_is_found_whole_by_sentences_or_by_its_places(english, translated, missing):
    found = Catalogue(MADE, "bis", ",")
    assert found.said(english) == translated
    assert sorted(found.missing) == missing


def test_a_language_that_is_not_there_is_refused(command, diagnosed, tmp_path):
    with pytest.raises(UsageError, match="not there in 'fr': one of en, de"), reported_in("fr"):
        pass
    code, _, err = command("report", diagnosed, "--language", "fr")
    assert code == 2
    assert "one of en, de" in err
    log = tmp_path / "log.csv"
    log.write_text("time [s],u [1]\n0,0\n")
    code, _, err = command("diagnose", log, "--language", "fr", "--out", tmp_path / "out")
    assert code == 2
    assert not (tmp_path / "out").exists()


def test_how_an_uneven_log_was_taken_is_said_in_german():
    german = catalogue("de")
    for way in (
        "u held from stamp to stamp (if it changes in between, the machine seems early: `held = false` in a mapping file "
        "draws straight lines)",
        "u on straight lines from stamp to stamp",
    ):
        text = f"sampled every 17.59 to 126.2 ms: simulated in steps of 6.63 ms, {way}, "
        text += "and compared at the stamps themselves"
        assert german.said(text).startswith(
            "Abtastung alle 17,59 bis 126,2 ms: simuliert in Schritten von 6,63 ms, u "
        )


@pytest.mark.parametrize(
    ("english", "german"),
    [
        ("left out above the numbers: rows 1 to 3", "über den Zahlen weggelassen: Zeilen 1 bis 3"),
        (
            "remarks among the numbers were left out (first: row 24; in all 3)",
            "Bemerkungen zwischen den Zahlen weggelassen (die erste: Zeile 24; insgesamt 3)",
        ),
        (
            "a missing torque that depends on slew speed explains 64% of what is systematic in slew angle",
            "64 % des Systematischen (Schwenkwinkel) erklärt, was fehlen kann: Moment, abhängig von: Schwenkgeschwindigkeit",
        ),
        (
            "error of speed on data not used for fitting falls from 250 to 15 rpm; the sensor's noise is 0.29 rpm; a linear "
            "model leaves 140 rpm.",
            "der Fehler (Geschwindigkeit) auf nicht angepassten Daten fällt von 250 auf 15 rpm; das Rauschen des Sensors "
            "ist 0,29 rpm; ein lineares Modell lässt 140 rpm.",
        ),
    ],
)
def test_what_the_log_of_another_machine_brings_is_said_in_german(english, german):
    with reported_in("de"):
        assert said(english) == german


@pytest.mark.parametrize("drive", ["u", "torque", "demand", "valve.opening"])
def test_what_a_command_of_any_name_does_not_show_is_said_in_german(drive):
    """The remarks of `cosim.diagnosis.answer.remarks` on commands of one direction and of one level on a side."""
    german = catalogue("de")
    german.missing.clear()
    end = "fit logs of the other direction beside this one (cosim diagnose LOG LOG ...)"
    texts = [
        *(
            f"{drive} is never {sign}: in one direction dead zone, friction and load look alike; if the machine goes both "
            f"ways, {end}"
            for sign in ("negative", "positive")
        ),
        f"{drive} holds one level on a side only (0.5 and -0.5 Nm): dead zone, friction and limits cannot be told from the "
        "gain; fit logs with other levels beside this one (cosim diagnose LOG LOG ...)",
        f"slew goes back by 3.2 deg while {drive} is 0, and {drive} never changes its sign: if the other direction has a "
        "column of its own, name it as `minus` in the mapping",
        f"speed goes back 98 % of the way while {drive} is 0, and {drive} never changes its sign: if the other direction "
        "has a column of its own, name it as `minus` in the mapping",
        "jitter: intervals from 0.099 to 0.102 s, median 0.101 s",
    ]
    for text in texts:
        told = german.said(text)
        assert not set(told.split()) & {"is", "the", "and", "holds", "intervals"}, told
    assert not german.missing


ANY_SYSTEM = [
    "slow.csv: uneven intervals: brought to 0.01 s by straight lines",
    "wheel.y is left aside: log_2.csv and log_3.csv lack it",
    "log_2.csv lacks p_1.command: it takes no part where part_1 is judged, and windows of the others are held out there",
    "log_2.csv lacks part_1.y: it judges part_1 and part_2 as one",
    "log_2.csv: no part where part_2 is judged: part_1.y is read wrongly, and what it should be is known of the other logs "
    "only",
    "part_1 is not deterministic: two runs differ by 0.02 in part_1.y (RMS), which counts as noise",
    "part_1: its own solver is off in part_1.y by 0.4 % of its spread (RMS), so less is not looked for; export it with a "
    "finer step or tolerance",
    "part_2: log_1.csv shows nothing wrong: what is wrong shows in log_2.csv alone",
    "part_2: log_1.csv shows nothing wrong: what is wrong shows in log_2.csv and log_3.csv alone; diagnose each of these by "
    "itself",
    "port.gain at part_1.y (output): in log_2.csv alone; log_1.csv and log_3.csv show nothing wrong and contradict it",
    "part_1 explains the log only with part_1.K and part_1.T three deviations from what is trusted; if they are surer than "
    "that, the nearest cause is port.gain at part_1.u (input)",
    "part_1: steps of 0.01 s of its own, which cannot be made finer here: what its solver errs by them is among what is "
    "unexplained; if the FMU can be exported with a finer step, try that",
    "assumed: inputs of part_1 that were not measured stay at their start values: part_1.v2 (no start value), part_1.v3 "
    "(2); [diagnose] constant in the mapping gives others",
    "no connector of the system, left alone: extra_1, extra_2",
    "slow.csv: sampled far faster than anything in it moves: 0.02 s are enough",
    "slow.csv: one run of it takes long, and a diagnosis makes thousands: it uses one sample each 0.02 s, by which a "
    "reading loses 0.4 % of its spread (less with --budget 1h)",
    "slow.csv: one run of it takes long, and a diagnosis makes thousands: it uses 0 to 32 s, where the inputs visit most "
    "(more of it with --budget 1h)",
    "slow.csv: in the rest of it the error of part_1.y is 0.2 times that of the model as it is",
    "slow.csv: in the rest of it the error of part_1.y is 3 times that of the part used",
    "beside FMUs a diagnosis may take 600 s: more with --budget 1h",
    "log_2.csv: there is no column 'Cmd_1': part_1.u is taken from the other logs",
    "what is trusted of part_1 and part_2 may be further off than that, several numbers at once: --calibrate fits it freely "
    "and says what that alone gains",
    "no parameter of part_1 and part_2 is trusted or free, so none could be named: list those that you know to a tolerance "
    "in the mapping, [diagnose] trusted (cosim init writes them as a comment), and diagnose again",
    "part_1.fmu: no InitialUnknowns, which FMI demands for its outputs; it is run all the same",
    "part_1.fmu: parameters of a variability that FMI 2.0 does not allow are taken as tunable",
    "part_1: the time allowed (60 s) was over; not tried: port.gain by a fit (3 of them), what the log never exercised, the "
    "last estimate, by the whole log",
    "part_1.y: the residual depends on part_1.u and part_1.y: 91 % of its variance on windows held out; a function of "
    "part_1.u added at part_1.u (input) would tell 98 % of it",
    "part_1.y: the residual is far above the reading's noise, and what was measured does not tell it directly; a function "
    "of several signals added at part_1.u (input) or part_1.y (output) would tell 60 % of it",
    "part_1.y: the residual is far above the reading's noise, and what was measured does not tell it directly; a function "
    "of the speed of part_1.y (as friction is) added at part_1.u (input) would tell 97 % of it",
    "gains 47.7 in log-likelihood on the windows held out, 95 % interval -112.1 to 207.5",
    "differs from log to log so much that another may have none of it",
    "part_1.q: the unit 'L/min' is defined as 0.06 of the SI unit, but by its name it is 1.66667e-05: the FMU's definition "
    "is taken; have the FMU corrected",
    "port.dropout at part_1.y (sensor): in log_2.csv alone",
    "the time allowed (60 s) was over before it could be judged; one run of it takes 16 s, and a diagnosis makes hundreds "
    "of runs: allow more time (--budget), or take a shorter log or one with fewer samples",
    "no component can be judged: part_1: the time allowed (60 s) was over before it could be judged; one run of it takes "
    "1.6 s, and a diagnosis makes hundreds of runs: allow more time (--budget), or take a shorter log or one with fewer "
    "samples",
    "of its outputs only part_1.n was measured, and what is whole or true or false is not judged",
]


@pytest.mark.parametrize("text", ANY_SYSTEM)
def test_what_a_diagnosis_of_any_system_says_is_german(german, text):
    """The notes, refusals and remains of `cosim.anysystem`."""
    told = said(text)
    assert german.missing == set()
    assert not set(re.findall(r"[a-z]+", told)) & {"is", "the", "and", "of", "it", "are", "what"}, told


def test_these_are_what_a_diagnosis_of_any_system_says():
    """A part of each stands in the sources: a text that was changed there is no longer tried here."""
    folder = REPORT.parent / "anysystem"
    sources = [
        *folder.rglob("*.py"),
        REPORT.parent / "diagnosis" / "budget.py",
        REPORT.parent / "ssp" / "fmu.py",
    ]
    written = [
        node.value
        for file in sources
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) > 8
    ]
    for text in ANY_SYSTEM:
        assert any(part in text for part in written), text
