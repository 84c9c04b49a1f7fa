"""Texts that name free parameters: what they mean, and what is refused in words that help."""

import numpy as np
import pytest

from cosim.calibrate import read_free
from cosim.calibrate.determined import described
from cosim.errors import UsageError
from cosim.ssp.read import read_system


@pytest.fixture(scope="module")
def system(packages):
    with read_system(packages["full_order"]) as found:
        yield found


def test_names_bounds_and_priors(system):
    J, K, b = read_free(
        system,
        ["mechanical.J", "dcv.K=2:3 mm", "mechanical.b=26e3+-500 N.m.s/rad"],
        ["dcv.K = 2.4 +- 0.1 mm"],
    )
    assert (J.start, J.given, J.prior) == (763.9437268410978, False, None)
    assert (K.low, K.high, K.start) == pytest.approx((2e-3, 3e-3, 2.375e-3))
    assert K.prior == pytest.approx((2.4e-3, 1e-4))
    assert K.size == pytest.approx(0.5e-3)  # half the range: less than the value
    assert b.prior == (26e3, 500.0)
    assert J.reach == pytest.approx((J.start / 3.0, J.start * 3.0))


def test_one_end_of_the_bounds_may_be_left_to_the_fmu(system):
    (T,) = read_free(system, ["continuity.T=:0.2 s"])
    assert T.high == 0.2
    assert 0.0 <= T.low < 0.11


def test_without_names_the_usual_ones_are_free(system):
    assert [f.name for f in read_free(system, [])] == [
        "dcv.K", "dcv.w0", "dcv.zeta", "continuity.K_c", "continuity.T", "mechanical.J", "mechanical.b",
    ]  # fmt: skip


def test_a_start_outside_new_bounds_moves_inside(system):
    (J,) = read_free(system, ["mechanical.J=900:1000 kg.m2"])
    assert J.start == 900.0


def test_a_value_that_was_set_is_the_start(system):
    (J,) = read_free(system, ["mechanical.J"], values={"mechanical.J": 800.0})
    assert J.start == 800.0


@pytest.mark.parametrize(
    ("texts", "priors", "message"),
    [
        (["mechanical.I"], [], "there is no 'mechanical.I'"),
        (["mechanicl.J"], [], "closest: 'mechanical.J'"),
        (["dead_zone.form"], [], "type Integer: only Real"),
        (["mechanical.theta"], [], "output, not a parameter"),
        (["mechanical.J=3:2"], [], "empty"),
        (["mechanical.J=-5:2000 kg.m2"], [], "beyond what its FMU allows"),
        (["mechanical.J=2:3 mm"], [], "wrong dimension"),
        (["mechanical.J=abc"], [], "should read low:high unit"),
        (["mechanical.J="], [], "should read name or name=low:high"),
        (["mechanical.J", "mechanical.J"], [], "twice"),
        (["mechanical.tau_c"], [], "starts at 0"),
        (["mechanical.J=700+-0"], [], "above 0"),
        (["mechanical.J=900:1000"], ["mechanical.b=1+-1"], "'mechanical.b' is not free"),
        (["mechanical.J"], ["mechanical.J=700"], "mean+-deviation"),
    ],
)
def test_what_makes_no_sense_is_refused(system, texts, priors, message):
    with pytest.raises(UsageError) as error:
        read_free(system, texts, priors)
    assert message in str(error.value)


def test_a_start_that_was_set_outside_the_bounds_is_refused(system):
    with pytest.raises(UsageError, match="outside"):
        read_free(system, ["mechanical.J=700:900 kg.m2"], values={"mechanical.J": 1000.0})


def test_what_is_kept_is_among_what_is_said_not_to_be_seen():
    """A lag that ends at a hundredth of its start is no hundred times less sure than a preload that stays where it was."""
    blind = described(np.array([0.45, 0.89]), 0.8, ["preload", "lag"], np.array([1.0, 0.01]))
    assert set(blind.changes) == {"preload", "lag"}
    assert blind.most == "lag"
    far = described(np.array([0.45, 0.89]), 0.8, ["preload", "lag"], np.array([1.0, 50.0]))
    assert (set(far.changes), far.most) == ({"preload"}, "preload")
    assert "preload uncertain by 36 %" in far.why
