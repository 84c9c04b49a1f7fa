"""The valve's linearisation (3.5.5) from Tables 3.5 and 3.6, and from points of one's own."""

import pytest

from cosim.errors import UsageError
from cosim.identify.answer import write_ssv
from cosim.identify.linearisation import linearisation_answer
from cosim.ssp import read_ssv
from fmus import registry
from fmus.compose import compose

STARTS = ("0.15 V", "-0.24 V")


def test_the_source_s_valve_needs_more_on_side_b():
    """By hand: 3.0275/(6 - 0.15) and 2.688/(6 - 0.24) mm/V; 2.6 mm then needs 5.174 V and -5.811 V."""
    sides = linearisation_answer(STARTS, [], "3 V:2.6 mm").data["sides"]
    assert sides["A"]["slope"]["value"] == pytest.approx(3.0275 / 5.85, rel=1e-12)
    assert sides["B"]["slope"]["value"] == pytest.approx(2.688 / 5.76, rel=1e-12)
    assert sides["A"]["full"]["value"] == pytest.approx(0.15 + 2.6 * 5.85 / 3.0275, rel=1e-12)
    assert sides["B"]["full"]["value"] == pytest.approx(-0.24 - 2.6 * 5.76 / 2.688, rel=1e-12)


def test_valve_and_inverse_in_the_model_give_travel_in_proportion(tmp_path):
    """Every command's travel is 2.6 mm times the command, through the .ssv, whichever side."""
    found = linearisation_answer(STARTS, [], "3 V:2.6 mm")
    values = {v.name: float(v.value) for v in read_ssv(write_ssv(found.parameters, tmp_path / "valve.ssv"))}
    module = compose(registry.block("dead_zone")).module

    def block(component, command):
        own = {n.partition(".")[2]: v for n, v in values.items() if n.startswith(component)}
        starts = {n: v.start for n, v in registry.block("dead_zone").parameters.items()}
        return module.limited(command, module.Parameters(**starts | own))

    for row in found.data["table"]:
        volts = 3.0 * block("compensator", row["command"])
        assert volts == pytest.approx(row["valve_V"], abs=1e-12)
        assert values["dcv.K"] * block("dead_zone", volts / 3.0) == pytest.approx(
            1e-3 * row["travel_mm"], abs=1e-15
        )


def test_several_points_of_a_side_are_fitted_through_its_start():
    points = ["2.15 V:1.02 mm", "4.15 V:1.98 mm", "-1.24 V:-0.5 mm"]
    slope = linearisation_answer(STARTS, points, "3 V:2.6 mm").data["sides"]["A"]["slope"]["value"]
    assert slope == pytest.approx((2.0 * 1.02 + 4.0 * 1.98) / 20.0, rel=1e-12)


def test_a_travel_that_the_actuator_cannot_give_is_said():
    answer = linearisation_answer(STARTS, [], "3 V:2.9 mm")
    (note,) = answer.notes
    assert note.startswith("side B: 2.9 mm need -6.454 V")
    assert "ends at -2.688 mm" in note


@pytest.mark.parametrize(
    ("starts", "points", "full", "message"),
    [
        (("-0.24 V", "0.15 V"), [], "3 V:2.6 mm", "either side of 0"),
        (STARTS, ["6 V 3 mm"], "3 V:2.6 mm", "should read voltage:travel"),
        (STARTS, ["6 V:3 mm"], "3 V:2.6 mm", "side B has no measured point"),
        (STARTS, ["0.1 V:3 mm", "-6 V:-2 mm"], "3 V:2.6 mm", "before the start voltage 0.15 V"),
        (STARTS, ["6 V:0 mm"], "3 V:2.6 mm", "says nothing of a slope"),
        (STARTS, [], "3 V:-2.6 mm", "should be positive"),
        (STARTS, ["6 V:3 bar"], "3 V:2.6 mm", "--point '6 V:3 bar'"),
    ],
)
def test_what_makes_no_linearisation(starts, points, full, message):
    with pytest.raises(UsageError, match=message):
        linearisation_answer(starts, points, full)
