"""Free functions of the path since the last reversal hold lost motion of any kind."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cosim.diagnosis.model.groups import left_out
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.residuals.hysteresis import reversals, stop
from cosim.rig import make_log
from cosim.rig.write import as_log

TIME = np.arange(20_000) * 1e-3
ANGLE = np.sin(1.3 * TIME) + 0.6 * np.sin(0.47 * TIME)
signals = arrays(np.float64, st.integers(2, 60), elements=st.floats(-10.0, 10.0))


@given(signals, st.floats(0.0, 5.0))
def test_a_play_holds_back_its_half_width_at_most_and_what_it_lets_on_turns_no_more_than_its_input(
    signal, half
):
    held = stop(signal, half)
    assert np.all(np.abs(held) <= half + 1e-12)
    let_on = signal - held
    assert np.sum(np.abs(np.diff(let_on))) <= np.sum(np.abs(np.diff(signal))) + 1e-9


@given(signals, st.floats(0.0, 5.0))
def test_a_play_does_not_know_the_time(signal, half):
    slowly = np.repeat(signal, 3)
    assert stop(slowly, half)[::3] == pytest.approx(stop(signal, half))


def test_coefficients_are_the_missing_reading_at_the_knots() -> None:
    """A gap of exactly one knot: behind a reversal the reading lags by the path, up to the gap."""
    (basis,) = reversals("theta", ANGLE, "reading", "rad", 1e-3)
    columns = np.stack(list(basis.columns()))
    for k, knot in enumerate(basis.knots):
        lag = np.minimum(basis.knots, knot)
        assert lag @ columns == pytest.approx(stop(ANGLE, 0.5 * knot)), k


def test_any_lost_motion_is_held() -> None:
    (basis,) = reversals("theta", ANGLE, "reading", "rad", 1e-3)
    columns = np.stack(list(basis.columns()))
    lost = sum(stop(ANGLE, half) for half in (0.002, 0.013, 0.05))
    found, *_ = np.linalg.lstsq(columns.T, lost, rcond=None)
    assert np.std(lost - found @ columns) < 0.15 * np.std(lost)
    assert reversals("theta", np.ones(50), "reading", "rad", 1e-3) == []


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.003, 0.008])
def test_a_gap_that_the_library_lacks_is_no_inertia(gap: float) -> None:
    log = as_log(make_log("mixed", 40.0, [f"mechanical.backlash:gap={gap} rad"], seed=61))
    with left_out("mechanical.backlash"):
        found = diagnose(log)
    assert not found.causes
    assert any(rest.block == "mechanical" for rest in found.rests)
