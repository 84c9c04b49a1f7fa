"""The dead zone from ramps: break points and slopes, seen in spool, pressure or slew angle."""

import dataclasses

import numpy as np
import pytest
from identify_truth import TRUTH, UNCOMPENSATED, inside, least, score

from cosim.errors import DataError
from cosim.identify.dead_zone import identify_dead_zone, predicted_dead_zone
from cosim.identify.run import dead_zone_parameters
from cosim.rig import Hidden, as_log, make_log


@pytest.mark.parametrize("response", ["spool", "p_load", "slew"])
def test_a_ramp_gives_table_4_1(response, ramp_log, off):
    """45 % and 40 % of full command, in whatever was measured."""
    found = identify_dead_zone(ramp_log(), off, response=response)
    assert found.response == response
    for name, quantity in dead_zone_parameters(found).items():
        assert abs(score(quantity, TRUTH[name])) < 4.0, name
        assert quantity.interval[1] - quantity.interval[0] < 0.02, name
    assert found.lag.value == pytest.approx(found.nominal_lag, rel=0.02)


def test_parts_of_the_log_are_predicted_with_the_dead_zone_only(ramp_log, off):
    found = identify_dead_zone(ramp_log(), off)
    with_it, without = predicted_dead_zone(found, off)
    assert with_it > 98.0
    assert without < 75.0


def test_nearest_signal_is_taken(ramp_log, off):
    log = ramp_log()
    fewer = dataclasses.replace(log, signals={n: v for n, v in log.signals.items() if n != "spool"})
    assert identify_dead_zone(fewer, off).response == "p_load"


def test_a_wider_zone_and_each_side_its_own(ramp_log, off):
    log = ramp_log(hidden=[Hidden("dead_zone.mismatch", {"b_r": 0.5, "b_l": -0.33})])
    found = dead_zone_parameters(identify_dead_zone(log, off))
    assert abs(score(found["dead_zone.b_r"], 0.5)) < 4.0
    assert abs(score(found["dead_zone.b_l"], -0.33)) < 4.0


def test_behind_the_compensator_too(noisy, known):
    """With the compensator on, the command behind it is what the valve gets."""
    found = dead_zone_parameters(identify_dead_zone(noisy, known))
    assert all(abs(score(q, TRUTH[name])) < 4.0 for name, q in found.items())


def test_coloured_noise_widens_the_intervals(ramp_log, off):
    """The same size of noise in slow colours tells less, and says so."""
    white, pink = (identify_dead_zone(ramp_log(kind=kind), off) for kind in ("white", "pink"))
    for side in ("right", "left"):
        edge = pink.sides[side]["break_point"]
        assert edge.deviation > 3.0 * white.sides[side]["break_point"].deviation
        assert abs(score(edge, TRUTH[f"dead_zone.b_{side[0]}"])) < 4.0


def test_filtered_alike_it_stays_what_it_is(ramp_log, off):
    found = dead_zone_parameters(identify_dead_zone(ramp_log(), off, cutoff=20.0))
    assert found["dead_zone.b_r"].value == pytest.approx(0.45, abs=1e-3)


def test_play_shows_as_lag_and_is_said(ramp_log, off):
    found = identify_dead_zone(ramp_log(hidden=[Hidden("dcv.hysteresis", {"play": 0.02})]), off)
    assert any("play" in note for note in found.notes)
    # up and down, the play shifts the edges by as much either way
    assert found.sides["right"]["break_point"].value == pytest.approx(0.45, abs=0.01)


def test_one_sided_log_judges_one_side(off):
    command = np.concatenate([np.zeros(1000), np.linspace(0.0, 1.0, 6000), np.linspace(1.0, 0.0, 6000)])
    log = as_log(make_log(command, settings=UNCOMPENSATED))
    found = identify_dead_zone(log, off)
    assert list(found.sides) == ["right"]
    assert any("never went to the left" in note for note in found.notes)
    assert abs(score(found.sides["right"]["break_point"], 0.45)) < 4.0


def test_a_command_that_never_leaves_the_zone_is_refused(ramp_log, off):
    with pytest.raises(DataError, match=r"'spool' hardly moves .* experiment"):
        identify_dead_zone(ramp_log(amplitude=0.3), off)
    with pytest.raises(DataError, match=r"does not open the valve to the right.*experiment ramp"):
        identify_dead_zone(ramp_log(amplitude=0.44), off)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["white", "ar1", "pink"])
@pytest.mark.parametrize("response", ["spool", "p_load", "slew"])
def test_coverage_over_many_ramps(kind, response, ramp_log, off):
    trials, hits = 40, {name: 0 for name in TRUTH if name.startswith("dead_zone")}
    for seed in range(2000, 2000 + trials):
        found = dead_zone_parameters(identify_dead_zone(ramp_log(seed, kind), off, response=response))
        for name in hits:
            hits[name] += inside(found[name], TRUTH[name])
    print(kind, response, hits)
    assert min(hits.values()) >= least(trials, 0.90), hits
