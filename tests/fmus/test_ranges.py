"""Physical ranges of what causes can be, each with its reason."""

import math

import pytest

from benchmarks.blind.sizes import RANGES
from cosim.diagnosis.fitting.trials import declared
from fmus import registry
from fmus.contract import Range

EFFECTS = registry.effects()
LISTED = [(e, p) for e in EFFECTS.values() for p in e.ranges]


@pytest.mark.parametrize(("effect", "parameter"), LISTED, ids=lambda item: getattr(item, "name", item))
def test_a_range_holds_the_off_value_and_says_why_it_ends(effect, parameter):
    allowed, variable = effect.ranges[parameter], declared(effect, parameter)
    assert len(allowed.reason) > 20
    low, high = allowed.edges(variable.start, torque=500.0, travel=2.4e-3)
    assert low <= variable.start <= high
    assert low < high
    assert (low, high) != (variable.low, variable.high)


@pytest.mark.parametrize("name", sorted(n for n in RANGES if EFFECTS[n].ranges))
def test_a_range_holds_what_is_met_in_practice(name):
    """The sizes of the blind suite are those of the crane's practice, up to strong ones."""
    effect = EFFECTS[name]
    for parameter, drawn in RANGES[name].sized.items():
        if parameter not in effect.ranges:
            continue
        off = declared(effect, parameter).start
        unit = abs(off) if drawn.relative else 1.0
        low, high = effect.ranges[parameter].edges(off, torque=470.0, travel=2.4e-3)
        for sign in drawn.signs:
            assert low < off + sign * unit * drawn.strong[1] < high


def test_every_factor_of_a_nominal_value_and_every_torque_of_the_drive_has_one():
    for effect in EFFECTS.values():
        for parameter in effect.free:
            variable = declared(effect, parameter)
            torque = variable.unit == "N.m" and parameter.startswith("tau_")
            factor = parameter in ("K", "K_c", "w0", "zeta", "J", "b", "gain")
            assert not (torque or factor) or parameter in effect.ranges, f"{effect.name}: {parameter}"


def test_edges_are_in_parts_of_what_they_say():
    assert Range(0.5, 2.0, "why", of="nominal").edges(-3.0) == (-6.0, -1.5)
    assert Range(-5.0, 5.0, "why", of="torque").edges(0.0, 100.0) == (-500.0, 500.0)
    assert Range(-1.0, 1.0, "why", of="travel").edges(0.0, travel=2e-3) == (-2e-3, 2e-3)
    assert all(math.isnan(e) for e in Range(-5.0, 5.0, "why", of="torque").edges(0.0))
    assert Range(0.0, 10.0, "why").edges(7.0) == (0.0, 10.0)
