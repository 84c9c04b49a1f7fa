"""Dead zone (2.2), its inverse (2.3), the inverse used on the rig (4.9)."""

import math

import numpy as np
import pytest
from fmu_bench import bare, run
from hypothesis import given
from hypothesis import strategies as st

BLOCK = bare("dead_zone")
DEAD_ZONE, INVERSE, SMOOTH = 1.0, 2.0, 3.0

slopes = st.floats(0.1, 10.0)
breaks = st.floats(0.0, 2.0)
commands = st.floats(-5.0, 5.0)


def curve(command: float, **parameters: float) -> float:
    """Output for one command, through the composed block's step."""
    return run(BLOCK, 1e-3, [0.0], {"limit": 100.0} | parameters).step(command)[0]


@given(commands, slopes, slopes, breaks, breaks)
def test_dead_zone_undoes_its_inverse(x: float, m_r: float, m_l: float, b_r: float, b_l: float) -> None:
    """(2.2) after (2.3) is the identity."""
    shape = {"m_r": m_r, "m_l": m_l, "b_r": b_r, "b_l": -b_l}
    through = curve(curve(x, form=INVERSE, **shape), form=DEAD_ZONE, **shape)
    # b is added and taken away again: its rounding, times the slope, remains
    assert through == pytest.approx(x, rel=1e-14, abs=1e-15 * (1.0 + b_r + b_l) * max(m_r, m_l))


@given(commands, slopes, slopes, breaks, breaks)
def test_dead_zone_is_2_2(x: float, m_r: float, m_l: float, b_r: float, b_l: float) -> None:
    expected = m_r * max(0.0, x - b_r) + m_l * min(0.0, x + b_l)
    found = curve(x, form=DEAD_ZONE, m_r=m_r, m_l=m_l, b_r=b_r, b_l=-b_l)
    assert found == pytest.approx(expected, rel=1e-14, abs=1e-15)


@pytest.mark.parametrize("x", [-0.4, -0.39, 0.0, 0.2, 0.45])
def test_nothing_passes_within_the_break_points_of_table_4_1(x: float) -> None:
    assert curve(x) == 0.0


def test_inverse_is_zero_at_zero_and_jumps_beside_it() -> None:
    assert curve(0.0, form=INVERSE) == 0.0
    assert curve(1e-9, form=INVERSE) == pytest.approx(0.45, abs=1e-8)
    assert curve(-1e-9, form=INVERSE) == pytest.approx(-0.40, abs=1e-8)


@given(commands, commands)
def test_smooth_inverse_is_monotone(x: float, y: float) -> None:
    low, high = min(x, y), max(x, y)
    assert curve(low, form=SMOOTH) <= curve(high, form=SMOOTH)


@given(st.floats(0.0, 5.0))
def test_smooth_inverse_is_odd_but_for_its_two_amounts(x: float) -> None:
    """(4.9): each side has its own d; with the two exchanged the curve turns over."""
    forward = curve(x, form=SMOOTH, d_plus=0.45, d_minus=0.40)
    assert forward == -curve(-x, form=SMOOTH, d_plus=0.40, d_minus=0.45)
    assert forward == pytest.approx(x + 0.45 * math.tanh(50.0 * x), rel=1e-14)
    # numbers of Table 4.1 as they are: the sides differ by (0.45 - 0.40) tanh(S x)
    difference = forward + curve(-x, form=SMOOTH, d_plus=0.45, d_minus=0.40)
    assert difference == pytest.approx(0.05 * math.tanh(50.0 * x), abs=1e-14)


@given(st.floats(0.2, 0.5))
def test_smooth_inverse_tends_to_the_sharp_one(x: float) -> None:
    """tanh(50 x) is 1 to 4e-9 for x above 0.2, so there (4.9) and (2.3) agree and the pair on the rig cancels."""
    assert curve(x, form=SMOOTH) == pytest.approx(curve(x, form=INVERSE), abs=5e-9)
    assert curve(curve(x, form=SMOOTH)) == pytest.approx(x, abs=5e-9)
    assert curve(curve(-x, form=SMOOTH)) == pytest.approx(-x, abs=5e-9)


@pytest.mark.parametrize(("side", "end"), [(1.0, 0.0328), (-1.0, 0.0318)])
def test_the_rigs_inverse_leaves_a_dead_band_and_the_exact_one_none(side: float, end: float) -> None:
    """Table 4.1 and S = 50: u + d tanh(50 u) = d at 3.28 % and -3.18 %, the figures of docs/closed_loop.md."""
    below, above = side * (end - 5e-5), side * (end + 5e-5)  # the printed digits
    assert curve(curve(below, form=SMOOTH)) == 0.0
    assert abs(curve(curve(above, form=SMOOTH))) > 0.0
    lost = 0.07 - abs(curve(curve(0.07 * side, form=SMOOTH)))
    assert lost == pytest.approx(0.0008, abs=1e-4)
    for command in (1e-6 * side, below, above, 0.07 * side):
        assert curve(curve(command, form=INVERSE)) == pytest.approx(command, rel=1e-9)


@given(commands, st.sampled_from([DEAD_ZONE, INVERSE, SMOOTH]), st.floats(0.1, 2.0))
def test_limit_is_never_exceeded(x: float, form: float, limit: float) -> None:
    found = curve(x, form=form, limit=limit)
    free = curve(x, form=form, limit=100.0)
    assert found == math.copysign(min(abs(free), limit), free)


def test_full_command_gives_the_nominal_limit() -> None:
    """The valve's dead zone is limited to +-1."""
    demands = run(BLOCK, 1e-3, [0.0]).play([[1.45], [5.0], [-1.4], [-5.0]])[:, 0]
    assert demands == pytest.approx([1.0, 1.0, -1.0, -1.0], abs=1e-15)


def test_step_length_and_past_do_not_matter() -> None:
    rng = np.random.default_rng(1)
    rows = rng.uniform(-2, 2, (50, 1))
    short, long = run(BLOCK, 1e-4, [0.0], {"form": 3.0}), run(BLOCK, 0.5, [1.0], {"form": 3.0})
    assert np.array_equal(short.play(rows), long.play(rows))


def test_start_value_passes_through() -> None:
    module, r = BLOCK.module, run(BLOCK, 1e-3, [1.0])
    assert module.output(r.x, module.Input(1.0), r.m, r.p).demand == pytest.approx(0.55)
