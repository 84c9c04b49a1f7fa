"""The numbers of an answer: what a parameter cannot be is in no interval of it."""

from hypothesis import given
from hypothesis import strategies as st

from cosim.diagnosis.answer.answer import clipped
from cosim.diagnosis.answer.schema import Parameter


@given(middle=st.floats(0.0, 1e3), reach=st.floats(0.0, 1e4), wider=st.floats(0.0, 1e4))
def test_an_interval_ends_where_the_parameter_can_be_no_further(middle, reach, wider):
    """A top speed of 56 deg/s was told as -7 to 119."""
    around = (middle - reach, middle + reach)
    beyond = (around[0] - wider, around[1] + wider)
    told = clipped(Parameter(value=middle, unit="1", ci95=around, next_log_ci95=beyond), 0.0, 2e3)
    for (low, high), (first, last) in ((told.ci95, around), (told.next_log_ci95, beyond)):
        assert 0.0 <= low <= middle <= high <= 2e3
        assert (low, high) == (max(first, 0.0), min(last, 2e3))
    assert told.value == middle


def test_what_is_within_its_range_stays_as_it_is():
    told = Parameter(value=1.0, unit="1", ci95=(0.5, 1.5))
    assert clipped(told, 0.0, 2.0) == told
