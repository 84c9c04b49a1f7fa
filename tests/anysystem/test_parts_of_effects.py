"""A part of an effect is between nothing and the effect itself."""

import numpy as np
import pytest

from cosim.anysystem.actions import Action, Reach, acted, off, part_of, placed, starts
from cosim.ssp.system import Port
from cosim.system.effects import EFFECTS

H = 0.01
T = H * np.arange(4000)
U = np.sin(1.3 * T) + 0.4 * np.sin(5.1 * T)
PORT = Port("valve", "u")


def changed(values: dict[str, float]) -> float:
    """RMS by which values of effects change the series."""
    return float(np.sqrt(np.mean((acted(U, H, PORT, "input", placed(values)) - U) ** 2)))


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e not in ("port.dropout", "port.quantisation")])
def test_less_of_an_effect_changes_less_and_all_of_it_as_much(effect: str) -> None:
    action, reach = Action(effect, PORT, "input"), Reach.of(U, H)
    assert changed(off(action, reach)) == pytest.approx(0.0, abs=1e-9)
    for start in starts(action, reach):
        whole = changed(start)
        assert part_of(action, reach, start, 1.0) == pytest.approx(start)
        sizes = [changed(part_of(action, reach, start, part)) for part in (0.02, 0.2, 0.5)]
        assert sizes == sorted(sizes)
        assert sizes[-1] < max(whole, 1e-12)
        assert sizes[0] <= 0.3 * whole
