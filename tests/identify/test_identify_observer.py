"""State space, ranks, observer and root locus against the numbers of the source."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.errors import UsageError
from cosim.identify.nominal import nominal
from cosim.identify.run_design import FULL_ORDER, observer_answer
from cosim.identify.state_space import StateSpace, design_observer, drive, observer_values, root_locus


def test_source_numbers():
    """(4.35)-(4.38): ranks 2 and 2; (2.15): poles -13.2 and -6.6 give L = [7.744, 6.16]."""
    plant = drive()
    assert plant.A.tolist() == [[-4.4, 0.0], [1.0, 0.0]]
    assert plant.B.ravel().tolist() == [4.0, 0.0]
    assert plant.C.ravel().tolist() == [0.0, 2.5]
    assert (plant.controllability, plant.observability) == (2, 2)
    found = design_observer(plant)
    assert found.poles == pytest.approx((-13.2, -6.6))
    assert found.gain == pytest.approx([7.744, 6.16])


@given(st.floats(0.5, 50.0), st.floats(0.1, 20.0), st.floats(-100.0, -0.5), st.floats(-100.0, -0.5))
@settings(max_examples=40, deadline=None)
def test_poles_come_out_where_they_were_asked_for(gain, pole, p1, p2):
    found = design_observer(drive(gain, pole), [p1, p2])
    poles = np.linalg.eigvals(found.plant.A - np.outer(found.gain, found.plant.C))
    # a double pole is only as good as the root of rounding
    assert np.sort(poles.real) == pytest.approx(sorted([p1, p2]), rel=1e-5, abs=1e-5)
    assert np.poly(poles) == pytest.approx(np.poly([p1, p2]), rel=1e-9)


def test_values_give_the_observer_block_the_same_gain():
    """The block places its poles itself: its gain is ours, in radians."""
    from fmus.observer import Parameters, gains

    found = design_observer(drive(12.0, 5.0), [-20.0, -9.0])
    values = {name.partition(".")[2]: value for name, value in observer_values(found).items()}
    values |= {"at_reading": 1.0, "slew_0": 0.0, "rate_0": 0.0}
    assert np.deg2rad(gains(Parameters(**values))) == pytest.approx(found.gain)


def test_double_pole_is_placed():
    assert design_observer(drive(), [-8.0, -8.0]).gain == pytest.approx([5.184, 4.64])


@pytest.mark.parametrize(
    ("poles", "message"),
    [([-1.0], "two negative poles"), ([-1.0, 2.0], "two negative poles"), ([-900.0, -3.0], "too fast")],
)
def test_poles_that_make_no_observer(poles, message):
    with pytest.raises(UsageError, match=message):
        design_observer(drive(), poles)


def test_unobservable_plant_is_refused():
    blind = StateSpace(drive().A, drive().B, np.array([[1.0, 0.0]]))
    assert blind.observability == 1
    with pytest.raises(UsageError, match="not observable"):
        design_observer(blind, [-3.0, -4.0])


def test_root_locus():
    """Two poles never leave the left half plane; five do, at the gain where Routh's array says."""
    simple = root_locus([10.0], [1.0, 4.4, 0.0])
    assert simple.limit == np.inf
    breakaway = simple.poles[np.argmin(np.abs(simple.gains - 0.484))]  # 4.4^2 / 40: a double pole at -2.2
    assert np.abs(breakaway - -2.2).max() < 0.35
    full = root_locus(*FULL_ORDER)
    at = np.roots(np.polyadd(FULL_ORDER[1], [full.limit * 4.582e5]))
    assert np.max(at.real) == pytest.approx(0.0, abs=1e-6)
    assert full.limit == pytest.approx(6.345, abs=1e-3)
    assert np.all(full.poles[full.gains < full.limit].real < 1e-9)
    assert np.any(full.poles[-1].real > 0.0)


def test_answer_from_nominal_numbers_and_from_a_log(noisy):
    known = nominal()
    plain = observer_answer(None, known, [], None)
    assert plain.data["L"] == pytest.approx([7.744, 6.16])
    assert set(plain.parameters) == {"observer.a", "observer.k", "observer.c", "observer.p1", "observer.p2"}
    found = observer_answer(noisy, known, [], None)
    # (4.15) is a fit to the same crane: 10 and 4.4 to a quarter, and 2.27 deg/s at low frequency to a hundredth
    k, a = found.parameters["simplified.k"].value, found.parameters["simplified.a"].value
    assert a == pytest.approx(4.4, rel=0.5)
    assert np.rad2deg(k / a) == pytest.approx(2.27, rel=0.02)
    assert found.data["observer_poles"] == pytest.approx([-3.0 * a, -1.5 * a])
