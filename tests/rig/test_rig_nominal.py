"""The nominal crane against exact linear theory, and effects at their off values against the nominal crane."""

import ast
from pathlib import Path

import numpy as np
import pytest
from rig_helpers import LEVER, B, J, clean, held, lively, zero_order

import cosim.rig
from cosim.rig import EFFECTS, Hidden
from cosim.rig.integrate import _march, simulate
from cosim.rig.parameters import DEG, NOMINAL

W0, ZETA, K, K_C, T = 25.23, 0.545, 2.375e-3, 5.28e8, 0.11
VALVE = [1.0, 2 * ZETA * W0, W0**2]
# away from zero tanh(50 u) is 1 to rounding, so compensator and dead zone cancel
AWAY = held((0.5, 1.3), (0.9, 0.7), (-0.6, 2.0), (0.45, 0.333), (-0.5, 1.1))


def chain(*numbers):
    """Numerator gain and denominator of the linear chain, SI."""
    denominator = np.polymul(VALVE, np.polymul([T, 1.0], [J, B, 0.0]))
    return K * W0**2 * K_C * LEVER, denominator


def test_nominal_log_is_the_exact_held_response_of_the_linear_chain():
    run = clean(AWAY, start=0.3)
    gain, denominator = chain()
    theta = 0.3 + zero_order([gain], denominator, AWAY)
    spool = zero_order([K * W0**2], VALVE, AWAY)
    load = zero_order([K * W0**2 * K_C], np.polymul(VALVE, [T, 1.0]), AWAY)
    # rounding of the reference itself: a 5-state recursion over 5400 steps
    assert np.max(np.abs(run.slew - theta)) < 1e-11
    assert np.max(np.abs(run.spool - spool)) < 1e-13
    assert np.max(np.abs((run.p_a - run.p_b) - load)) < 1e-4
    assert np.max(np.abs(theta - 0.3)) > 1 * DEG


def test_the_march_is_compiled_once_for_commands_and_logs():
    """The signals of a log are read only."""
    logged = np.zeros(10)
    logged.setflags(write=False)
    for command in (np.zeros(10), logged, np.zeros(20)[::2]):
        simulate(command, NOMINAL)
    assert len(_march.signatures) == 1


def test_chain_is_the_published_full_order_model():
    gain, denominator = chain()
    published = [1.0, 71.5, 2164.0, 3.673e4, 2.02e5, 0.0]  # (5.12), printed to three or four digits
    assert np.allclose(denominator / denominator[0], published, rtol=1e-3)
    assert gain / denominator[0] / DEG == pytest.approx(4.582e5, rel=1e-3)


def test_pressures_share_the_supply():
    run = clean(AWAY)
    assert np.all(run.p_supply == 170e5)
    assert np.allclose(run.p_a + run.p_b, 170e5, rtol=1e-14)


def test_at_rest_nothing_moves():
    run = clean(np.zeros(2000), start=1.0)
    assert np.all(run.slew == 1.0)
    assert np.all(run.spool == 0.0)


def test_command_is_held_from_its_own_sample_on():
    run = clean(held((0.0, 0.1), (0.8, 0.1)))
    assert np.all(run.spool[:101] == 0.0)
    # after one held millisecond: K u (w0 h)^2 / 2
    assert run.spool[101] == pytest.approx(K * 0.8 * (W0 * 1e-3) ** 2 / 2, rel=0.02)


@pytest.mark.parametrize("effect", EFFECTS)
def test_off_value_is_the_nominal_crane_bit_for_bit(effect):
    off = {name.split(".")[1]: value for name, value in EFFECTS[effect].off().items()}
    u = lively(3.0)
    nominal = clean(u, tracker=True)
    run = clean(u, Hidden(effect, off), tracker=True)
    for name in nominal.signals:
        assert np.array_equal(nominal.signals[name], run.signals[name]), name
    assert np.array_equal(nominal.tracker[1], run.tracker[1])


def test_nominal_numbers_are_those_of_the_contract():
    assert NOMINAL.dcv[:3] == (K, W0, ZETA)
    assert NOMINAL.continuity[:3] == (K_C, T, 170e5)
    assert NOMINAL.mechanical[:4] == (J, B, 8419.3e-6, 0.1)


def test_rig_shares_no_code_with_the_models():
    for path in Path(cosim.rig.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [n for n in names if n.split(".")[0] == "fmus"], path.name
