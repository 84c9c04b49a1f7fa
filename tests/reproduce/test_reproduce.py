"""The source's figures made anew: numbers that are known beforehand, and a page that says what it is made from."""

import json
import re

import numpy as np
import pytest

from cosim.reproduce import chapter4, chapter5
from cosim.reproduce.campaign import STEP, STEPS, Campaign, step_of
from cosim.reproduce.campaign import families as family_command
from cosim.reproduce.item import Item, Row
from cosim.reproduce.page import as_data, chosen, makers, page, percent


def ours(item: Item) -> dict[str, float]:
    return {row.name: row.ours for row in item.rows}


def test_the_models_alone_give_the_printed_numbers() -> None:
    for item in (chapter4.observer(), chapter5.locus(), chapter5.alone()):
        assert not item.synthetic
        for row in item.rows:
            if row.source is not None:
                # the source prints three or four digits
                assert row.ours == pytest.approx(row.source, rel=5e-4), row.name
    load = ours(chapter4.flow_curve())
    # 12.54 bar of 170: 1 - sqrt(1 - 12.54/170)
    assert load["flow lost there by (4.22)"] == pytest.approx(3.759, abs=1e-3)


def test_steps_of_the_family_are_where_they_are_looked_for() -> None:
    u = family_command()
    for level in STEPS:
        part = step_of(level)
        assert np.all(u[part] == level)
        assert u[part.start - 1] == 0.0
        assert (part.stop - part.start) * STEP == pytest.approx(0.6)


@pytest.mark.parametrize("zeta", [0.545, 0.9999, 1.4])
def test_a_second_order_fitted_to_its_own_step_is_itself(zeta: float) -> None:
    import control

    time = np.arange(600) * STEP
    step = control.step_response(control.tf([25.0**2], [1.0, 50.0 * zeta, 25.0**2]), time).outputs
    final, w0, found, _ = chapter5.second_order(time, 2e-3 * step)
    assert (final, w0, found) == pytest.approx((2e-3, 25.0, zeta), rel=1e-3)


def test_steps_show_the_source_s_finding_only_where_the_rig_has_it(built) -> None:
    """Fig. 5.6: the words follow from the numbers."""
    nominal = chapter5.families(Campaign((), seed=3))
    damped = chapter5.families(Campaign(("dcv.amplitude_damping",), seed=3))
    for row in nominal.rows[1:5]:  # at 100 % it meets the stop
        assert row.ours == pytest.approx(0.545, abs=2.0 * (row.spread or 0.0)), row.name
    assert "does not show that" in " ".join(nominal.verdict.split())
    ratios = [row.ours for row in damped.rows[:5]]
    assert ratios == sorted(ratios)
    assert ratios[0] > 0.6
    assert "dcv.amplitude_damping" in damped.verdict


def test_the_words_of_a_trend_need_more_than_the_intervals() -> None:
    first = Row("first", None, 1.0, spread=0.1)
    assert chapter4.trend(first, Row("last", None, 1.15, spread=0.1)) == "stays"
    assert chapter4.trend(first, Row("last", None, 1.25, spread=0.1)) == "rises"
    assert chapter4.trend(first, Row("last", None, 0.75, spread=0.1)) == "falls"


def test_the_page_is_whole_offline_and_says_what_is_synthetic() -> None:
    pytest.importorskip("plotly")
    of = Campaign((), seed=2)
    items = [chapter4.dead_zone(of), chapter4.compensation(of), chapter5.locus()]
    data = as_data(of, items)
    text = page(data, items)
    places = set(re.findall(r'class="plot" id="(\w+)"', text))
    assert places == {p.key for item in items for p in item.pictures}
    figures = json.loads(text.partition("const figures = ")[2].partition(";\nconst config")[0])
    assert figures.keys() == places
    head = text[: text.index("<script>")]
    assert "://" not in head
    assert head.count('class="badge synthetic"') == 3, "on top, and at both items from logs"
    assert head.count('class="badge model"') == 1
    found = {n["name"]: n for n in data["items"][0]["numbers"]}
    for side, printed in (("right end", 45.0), ("left end", -40.0)):
        assert found[side]["source"] == printed
        assert found[side]["ours"] == pytest.approx(printed, abs=3.0 * found[side]["half_ci95"])


def test_each_item_has_a_place_of_its_own() -> None:
    assert len(makers(Campaign())) == 16


SOURCES = ["Table 4.4", "Fig. 4.4", "Figs 4.5, 4.12b", "(4.35)-(4.38), (2.15)", "Figs 5.7-5.10, 5.12"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("fig. 4.4", ["Fig. 4.4"]),
        ("Figure 4.4", ["Fig. 4.4"]),
        ("table 4.4", ["Table 4.4"]),
        ("4.4", ["Table 4.4", "Fig. 4.4"]),
        ("4.12", ["Figs 4.5, 4.12b"]),
        ("4.12b", ["Figs 4.5, 4.12b"]),
        ("(4.36)", ["(4.35)-(4.38), (2.15)"]),
        ("fig 5.9", ["Figs 5.7-5.10, 5.12"]),
        ("5.12", ["Figs 5.7-5.10, 5.12"]),
    ],
)
def test_a_figure_is_found_by_its_number(text: str, found: list[str]) -> None:
    assert chosen(text, SOURCES) == found


@pytest.mark.parametrize("text", ["5.11", "4.12a", "fig. 4.35", "the ramp", "4"])
def test_a_number_that_is_not_made_is_refused_with_those_that_are(command, text: str) -> None:
    code, _, err = command("reproduce", "--only", text)
    assert code == 2
    assert "Figs 5.7-5.10, 5.12" in " ".join(err.split())


def test_one_figure_is_one_command(built, command, tmp_path) -> None:
    """Fig. 4.4: the ramp, compensated against uncompensated."""
    code, out, err = command("reproduce", "--only", "fig. 4.4", "--out", tmp_path, "--json")
    assert code == 0, err
    (item,) = json.loads(out)["items"]
    assert item["source"] == "Fig. 4.4"
    still = {n["name"]: n["ours"] for n in item["numbers"]}
    assert still["stands still up to, without"] > 45.0
    assert 0.0 < still["stands still up to, with"] < 10.0
    assert (tmp_path / "reproduce.html").is_file()


def test_what_cannot_be_hidden_is_said_before_the_work(command) -> None:
    code, _, err = command("reproduce", "--hide", "dcv.amplitude_dampin")
    assert code == 2
    assert "did you mean dcv.amplitude_damping" in err
    code, _, err = command("reproduce", "--hide", "none", "--hide", "dcv.delay")
    assert code == 2
    assert "stands alone" in err


def test_a_difference_of_nothing_has_no_sign() -> None:
    assert [percent(v) for v in (-0.03, 0.04, -0.06, 12.34, None)] == [
        "0.0 %",
        "0.0 %",
        "-0.1 %",
        "+12.3 %",
        "",
    ]


@pytest.mark.slow
def test_the_command_makes_everything(built, command, tmp_path) -> None:
    code, out, err = command("reproduce", "--out", tmp_path, "--json")
    assert code == 0, err
    found = json.loads(out)
    keys = [item["source"] for item in found["items"]]
    assert len(keys) == len(set(keys)) == 16
    table = {
        n["name"]: n for item in found["items"] if item["source"] == "Table 4.3" for n in item["numbers"]
    }
    assert table["TF3 zeta"]["ours"] > table["TF1 zeta"]["ours"] + 0.1, "more damped in small motion"
    assert (tmp_path / "reproduce.html").stat().st_size > 4_000_000
    assert found == json.loads((tmp_path / "reproduce.json").read_text()) | {"files": found["files"]}
