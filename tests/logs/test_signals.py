import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import UsageError
from cosim.signals import LOG_SIGNALS, SIGNALS, angle_power, conversion


def test_signals_are_those_of_the_contract():
    assert LOG_SIGNALS == (
        "u", "spool", "p_supply", "p_a", "p_b", "slew", "slew_estimate", "slew_rate_estimate",
    )  # fmt: skip
    assert {"time", "p_load", "slew_external"} == SIGNALS.keys() - set(LOG_SIGNALS)


@pytest.mark.parametrize("signal", SIGNALS.values(), ids=SIGNALS)
def test_every_signal_has_a_range_that_holds_zero_and_a_text(signal):
    assert signal.low < 0 < signal.high
    assert signal.text
    assert conversion(signal.unit, signal.si) == signal.to_si


@pytest.mark.parametrize(
    ("unit", "target", "factor"),
    [
        ("deg", "rad", math.pi / 180),
        ("°", "rad", math.pi / 180),
        ("°/s", "rad/s", math.pi / 180),
        ("mrad", "rad", 1e-3),
        ("rpm", "rad/s", 2 * math.pi / 60),
        ("bar", "Pa", 1e5),
        ("N/mm²", "Pa", 1e6),
        ("kN.m-2", "Pa", 1e3),
        ("µm", "m", 1e-6),
        ("%", "1", 0.01),
        ("ms", "s", 1e-3),
    ],
)
def test_units_convert(unit, target, factor):
    assert conversion(unit, target) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "target"),
    [
        ("1", "rad"),
        ("deg", "1"),
        ("%", "rad"),
        ("Hz", "rad/s"),
        ("V", "1"),
        ("bar", "rad"),
        ("degC", "K"),
        ("9**9**9", "1"),
        ("((", "1"),
        ("m/", "m"),
        ("furlings", "m"),
        ("", "1"),
        ("m" * 60, "m"),
    ],
)
def test_wrong_units_are_refused_by_name(unit, target):
    with pytest.raises(UsageError, match=r"unit"):
        conversion(unit, target)


def test_angle_power():
    assert [angle_power(unit) for unit in ("deg", "rad/s", "1", "%", "Hz", "N.m.s/rad")] == [
        1,
        1,
        0,
        0,
        0,
        -1,
    ]


@given(
    st.sampled_from(["spool", "p_a", "slew", "slew_rate_estimate", "u"]),
    st.floats(-1e6, 1e6, allow_subnormal=False),
)
def test_to_si_and_back_is_the_same(name, value):
    factor = SIGNALS[name].to_si
    # one rounding in each direction; below 1e-300 a product may lose digits
    assert value * factor / factor == pytest.approx(value, rel=4e-16, abs=1e-300)


@given(st.text(max_size=50) | st.text("mk/s.%1*²(-)9", max_size=12))
def test_any_text_is_a_unit_or_a_usage_error(text):
    try:
        factor = conversion(text, "m")
    except UsageError:
        return
    assert math.isfinite(factor)
    assert factor > 0
