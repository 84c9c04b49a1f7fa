"""Datagrams: what is packed is read, and no bytes whatever raise."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.live.codec import SYNTHETIC_MARK, Codec, single
from cosim.live.layout import COMMANDS, FROM_CRANE, Layout

layouts = st.builds(
    Layout,
    byte_order=st.sampled_from(["little", "big"]),
    from_crane=st.permutations(FROM_CRANE).map(tuple),
    to_crane=st.permutations(COMMANDS).map(tuple),
)
single_float = st.floats(-4.0, 160.0, width=32)


@given(layouts, st.tuples(*[single_float] * 5))
def test_a_sample_comes_back(layout, values) -> None:
    codec = Codec(layout)
    bounds = [(c.low, c.high) for c in codec.channels]
    inside = tuple(min(max(v, low), high) for v, (low, high) in zip(values, bounds, strict=True))
    sample = codec.read_sample(codec.write_sample(inside))
    assert sample.values == pytest.approx(inside, rel=1e-6)
    assert (sample.nan, sample.beyond, sample.synthetic) == (0, 0, True)


@given(layouts, st.tuples(*[st.floats(-1.0, 1.0, width=32)] * 6))
def test_a_command_comes_back(layout, values) -> None:
    codec = Codec(layout)
    assert codec.read_command(codec.write_command(values)) == values


@given(st.binary(min_size=28, max_size=28))
def test_no_bytes_raise_and_what_is_taken_is_what_an_instrument_can_show(payload) -> None:
    codec = Codec(Layout())
    sample = codec.read_sample(payload)
    raw = struct.unpack("<7f", payload)
    for channel, value in zip(codec.channels, sample.values, strict=True):
        inside = channel.low <= raw[channel.place] <= channel.high
        assert (value is not None) == inside
        assert value is None or value == raw[channel.place]
    assert sample.nan + sample.beyond == sum(v is None for v in sample.values)
    assert sample.nan == sum(not math.isfinite(raw[c.place]) for c in codec.channels)


def test_another_crane_is_not_taken_for_ours() -> None:
    codec = Codec(Layout())
    raw = [12.0, 170.0, 85.0, 85.0, 0.0]
    assert not codec.read_sample(struct.pack("<7f", *raw, 0.0, 0.0)).synthetic
    assert not codec.read_sample(struct.pack("<7f", *raw, SYNTHETIC_MARK, 0.0)).synthetic
    assert codec.read_sample(struct.pack("<7f", *raw, SYNTHETIC_MARK, SYNTHETIC_MARK)).synthetic


@given(st.floats(-1.0, 1.0))
def test_the_logged_command_is_the_one_that_went_out(u) -> None:
    assert single(u) == float(np.float32(u))
