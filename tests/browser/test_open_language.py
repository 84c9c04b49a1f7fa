"""The page in German: every word of it is in the catalogue, and what the server says on it as well."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cosim.browser.language import page_words, said, words
from cosim.browser.session import ROLES, WORDS, Session, Work
from cosim.errors import UsageError
from cosim.report.language import PLACE

FOLDER = Path(__file__).resolve().parents[2] / "cosim" / "browser"
CONTENT = tomllib.loads((FOLDER / "de.toml").read_text(encoding="utf-8"))
HTML, SCRIPT = ((FOLDER / f"page.{kind}").read_text(encoding="utf-8") for kind in ("html", "js"))
ANSWER = (Path(__file__).parent / "answer.txt").read_text(encoding="utf-8")


def literals() -> set[str]:
    """What page.html shows and page.js says."""
    html = re.sub(r"<(script|style|link|meta)[^>]*>", "", HTML)
    shown = {text.strip() for text in re.findall(r">([^<>]+)<", html)}
    shown |= set(re.findall(r'(?:title|aria-label|placeholder)="([^"]*)"', html))
    return {t for t in shown if re.search(r"[a-z]{2}", t)} | set(re.findall(r'said\("([^"]*)"', SCRIPT))


def test_every_word_of_the_page_is_known_and_none_is_left_over():
    shapes = {"text", "empty", "constant", "steps", "moves"}  # of a column: `cosim.logs.overview.Column.kind`
    roles = set(re.search(r"ROLES = \{(.*?)\}", SCRIPT)[1].split('"')[1::2])
    assert len(literals()) > 60
    assert literals() | shapes | roles == CONTENT["page"].keys()
    assert len(roles) == len(ROLES) - 1


@pytest.mark.parametrize("part", ["page", "messages"])
def test_places_are_kept(part):
    for english, german in CONTENT[part].items():
        assert set(PLACE.findall(english)) == set(PLACE.findall(german)), english


def test_nothing_in_the_script_takes_the_translator_s_name():
    assert len(re.findall(r"\b(?:const|let|var) \{?said\b|\bsaid =>", SCRIPT)) == 1


def test_no_text_of_the_script_goes_past_the_catalogue():
    """Anything in quotes with two words in it is said, or is code."""
    bare = re.sub(r'said\("[^"]*"|//.*', "", SCRIPT)
    left = {t for t in re.findall(r'"([^"{}]*)"', bare) if re.search(r"[a-z]{2,} [a-z]{2,}", t)}
    code = {"use strict", "quiet small", "a, b", "th, td"}
    assert {t for t in left if not re.search(r"[#\[:<>(]", t)} - code - set(CONTENT["page"]) == set()


def test_the_answer_is_said_in_german():
    found = words("de")
    assert found is not None
    found.missing.clear()
    for line in ANSWER.splitlines():
        question, _, answer = line.partition(": ")
        found.said(question)
        found.said(answer)
    names = {"full_order", r"C:\Messungen vom März\out/extended.ssp", "out/next_experiment.csv"}
    assert found.missing - names == set()
    cause = said("dry friction (mechanical.coulomb_friction): 99.8 N m, 98.9 to 100.7 (95 %)", "de")
    assert cause == "trockene Reibung (mechanical.coulomb_friction): 99,8 N m, 98,9 bis 100,7 (95 %)"


def test_the_form_of_another_machine_is_german(tmp_path):
    """Excavator's boom: two columns of a command, two chambers; a servo drive: its torque alone."""
    t = np.arange(0.0, 4.0, 0.01)
    up = np.where(np.sin(2.0 * t) > 0.0, 0.5, 0.0)
    angle, speed = np.cumsum(up - (up == 0.0) * 0.3), np.sin(2.0 * t)
    logs = {
        "boom.csv": {"time [s]": t, "boom up duty": up, "boom down duty": 0.3 * (up == 0.0), "boom angle [deg]": angle,
                     "boom head pressure [bar]": 90.0 + up, "boom rod pressure [bar]": 60.0 - up},
        "joint.csv": {"time [s]": t, "tau [N.m]": np.cos(2.0 * t), "speed [rad/s]": speed},
    }  # fmt: skip
    names = {name for columns in logs.values() for name in columns}
    for name, columns in logs.items():
        pd.DataFrame(columns).to_csv(tmp_path / name, index=False)
        session = Session(tmp_path, tmp_path / "out", "de")
        session.choose("machine")
        session.take_own(tmp_path / name)
        words("de").missing.clear()
        rows = {row["signal"]: row for row in session.state()["form"]["rows"]}
        assert {t for t in words("de").missing if not any(t.strip("'") in name for name in names)} == set()
        assert rows["speed"]["text"] == "Geschwindigkeit der Achse"


def test_what_the_page_shows_of_a_log_and_a_diagnosis_is_german(tmp_path, german):
    session = Session(tmp_path, tmp_path / "out", "de")
    session.take_own(german)
    words("de").missing.clear()
    state = session.state()
    assert state["words"] == page_words("de")
    *ours, other = [m["label"] for m in state["models"]]
    assert ours == [f"{said(WORDS[n], 'de')} ({n})" for n in WORDS]
    assert other.startswith("andere Maschine")
    assert state["log"]["warnings"] == ["Zahlen wurden mit Dezimalkomma gelesen"]
    rows = {row["signal"]: row for row in state["form"]["rows"]}
    assert rows["p_a"]["text"] == "Druck an A"
    assert rows["p_a"]["why"] == "nach dem Namen „Druck A“"
    for text in ("mechanical: 18 candidates, 5/18", "dcv: 10 candidates, pass 2: 3/10", "extended model"):
        session._work = Work(state="running", text=text)
        assert session.state()["work"]["text"] != text
    # headings of the log itself are nobody's to translate
    assert {t for t in words("de").missing if t not in {c["name"] for c in state["log"]["columns"]}} <= {
        "Druck A", "Druck B", "Ventilbefehl", "Schieberweg", "Systemdruck",
    }  # fmt: skip


def test_the_language_may_be_chosen_and_is_the_report_s(tmp_path):
    session = Session(tmp_path, tmp_path / "out")
    assert session.state()["language"] is None, "the browser is asked"
    assert session.said("there is no such file") == "there is no such file"
    before = session.state()["revision"]
    session.ask("language", {"language": "de"})
    assert session.state()["revision"] > before, "a page that knows it asks again"
    assert session.said("there is no such file") == "diese Datei gibt es nicht"
    with pytest.raises(UsageError, match="one of en, de"):
        session.ask("language", {"language": "fr"})
    assert session.state()["language"] == "de"


def test_english_stays_what_it_is():
    assert words("en") is None
    assert page_words("en") == {"comma": ".", "said": {}}
    assert said("its name", "en") == "its name"
