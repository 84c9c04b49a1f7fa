"""What the law of a cause lacks is lost in its own signal's noise; the block behind must not take it for a cause."""

import pytest
from hidden_logs import diagnosed as diagnosed_of

from benchmarks.second.cases import draw
from benchmarks.second.trial import make
from cosim.diagnosis.fitting.chain import Known
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.verdict.discrepancy import discrepancy_of_law
from cosim.logs import load_log

# seeds of the second simulator: five plays for one hysteresis, a supply that answers in second order
FIVE_PLAYS, SLOW_SUPPLY = 2146, 2035


def diagnosed(folder, seed: int):
    """The diagnosis of one of the second simulator's logs."""
    make(draw(seed), folder)
    return diagnose(load_log(folder / "log.csv"))


@pytest.fixture(scope="module")
def five_plays(tmp_path_factory):
    return diagnosed(tmp_path_factory.mktemp("plays"), FIVE_PLAYS)


@pytest.mark.slow
def test_five_plays_for_one_make_no_load_on_the_column(five_plays) -> None:
    """Gravity of 8 N m, or any of a dozen others, was named beside the hysteresis."""
    assert {c.group for c in five_plays.causes} == {"dcv+continuity"}
    assert five_plays.causes[0].effect.name == "dcv.hysteresis"
    assert not five_plays.rests


@pytest.mark.slow
def test_what_the_law_lacks_is_small_and_known_to_a_part(five_plays) -> None:
    finding = five_plays.findings["dcv+continuity"]
    lacking, discrepancies = discrepancy_of_law(finding, five_plays.record)
    noise, explained = finding.task.rules["p_load"].rms, finding.before["p_load"].rms
    assert 0.0 < lacking.std() < 0.2 * explained
    assert discrepancies
    assert max(d.std() for d in discrepancies) < 0.3 * noise


@pytest.mark.parametrize(
    ("hidden", "blocks"),
    [
        pytest.param((), ("dcv",), marks=pytest.mark.slow),
        (("dcv.gain",), ("dcv",)),
        pytest.param(("continuity.flow_gain",), ("continuity",), marks=pytest.mark.slow),
    ],
)
def test_a_law_of_one_form_leaves_no_discrepancy(hidden, blocks) -> None:
    found = diagnosed_of(*hidden, seed=9, seconds=22.0, blocks=blocks)
    (finding,) = found.findings.values()
    assert tuple(e.name for e in finding.chosen.effects) == hidden
    assert discrepancy_of_law(finding, found.record) == (None, [])
    assert Known(finding.task.model, finding.chosen.fit).discrepancies == []


@pytest.mark.slow
def test_the_block_behind_without_a_cause_leaves_no_doubt(five_plays) -> None:
    finding = five_plays.findings["mechanical"]
    assert finding.chosen.effects == ()
    assert discrepancy_of_law(finding, five_plays.record) == (None, [])
    assert Known(finding.task.model, finding.chosen.fit).discrepancies == []


@pytest.mark.slow
def test_a_supply_that_only_the_slew_shows_is_named_in_its_block(tmp_path) -> None:
    """A smaller flow gain was named, and the mechanics called unexplained."""
    found = diagnosed(tmp_path, SLOW_SUPPLY)
    named = {c.group: {c.effect.name, *c.indistinguishable} for c in found.causes}
    assert len(found.causes) == len(named) == 2
    assert named["dcv"] == {"dcv.bandwidth"}
    assert named["continuity"] <= {"continuity.supply_sag", "continuity.flow_pressure"}, (
        "both fall with the load"
    )
    assert "continuity.supply_sag" in named["continuity"]
    assert not found.rests
