"""The layout file: its defaults are those of docs/live.md, and what is wrong in it is named."""

import pytest

from cosim.errors import DataError
from cosim.live.codec import Codec
from cosim.live.layout import Layout, load_layout


def written(tmp_path, text):
    path = tmp_path / "layout.toml"
    path.write_text(text)
    return path


def test_the_default_is_that_of_the_contract() -> None:
    layout = load_layout(None)
    assert layout.byte_order == "little"
    assert layout.from_crane == (
        "slew [deg]", "p_supply [bar]", "p_a [bar]", "p_b [bar]", "spool [mm]", "aux_1", "aux_2",
    )  # fmt: skip
    codec = Codec(layout)
    assert (codec.from_size, codec.to_size) == (28, 24)


def test_order_byte_order_and_units_are_read(tmp_path) -> None:
    path = written(
        tmp_path,
        'byte_order = "big"\n'
        'from_crane = ["boom [deg]", "p_a [Pa]", "spare", "p_b [psi]", "spool [m]", "slew [rad]", "p_supply [MPa]"]\n'
        'to_crane = ["enable1", "u1", "enable2", "u2", "enable3", "u3"]\n',
    )
    codec = Codec(load_layout(path))
    assert [c.name for c in codec.channels] == ["spool", "p_supply", "p_a", "p_b", "slew", "boom"]
    import struct

    raw = struct.pack(">7f", 30.0, 8.5e6, 0.0, 1000.0, 0.0015, 0.2, 17.0)
    values = codec.read_sample(raw).values
    assert values == pytest.approx((1.5, 170.0, 85.0, 68.94757, 11.459156, 30.0), rel=1e-6)
    assert struct.unpack(">6f", codec.write_command((0.25, 0.5, 0.75, 1.0, 0.0, 1.0))) == (
        1.0, 0.25, 0.0, 0.5, 1.0, 0.75,
    )  # fmt: skip


REST = '"p_supply [bar]", "p_a [bar]", "p_b [bar]", "spool [mm]", "aux_1", "aux_2"'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("byte_order = 'middle'", "'byte_order': Input should be 'little' or 'big'"),
        ("byteorder = 'big'", r"'byteorder' is not a key of a layout \(closest: 'byte_order'"),
        ("from_crane = ['slew [deg]']", "'from_crane' has 1 values, a datagram has 7"),
        (f"from_crane = ['slew', {REST}]", "'slew' has no unit: write 'slew .deg.'"),
        (f"from_crane = ['slew [bar]', {REST}]", "'slew'.*bar"),
        (f"from_crane = ['aux_3', {REST}]", "'slew' is not among them"),
        (f"from_crane = ['p_a [bar]', {REST}]", "'p_a' stands there twice"),
        (f"from_crane = ['u [1]', {REST}]", "'u' cannot come from the crane"),
        ("to_crane = ['u1', 'u2', 'u3', 'u1', 'enable1', 'enable2']", "each of u1, u2, .* must stand there once"),
        ("byte_order = ", "not valid TOML"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, text, message) -> None:
    with pytest.raises(DataError, match=message):
        load_layout(written(tmp_path, text))


def test_a_missing_file_is_named(tmp_path) -> None:
    with pytest.raises(DataError, match=r"nowhere\.toml: the layout cannot be read"):
        load_layout(tmp_path / "nowhere.toml")


def test_a_layout_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Layout().byte_order = "big"  # type: ignore[misc]
