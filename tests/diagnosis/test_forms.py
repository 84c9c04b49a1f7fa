"""Friction whose law is not the library's simplest: named as what it is, its form found, and nothing invented beside it."""

import pytest
from hidden_logs import off

from cosim.diagnosis.story import diagnose
from cosim.rig import make_log
from cosim.rig.write import as_log
from fmus import registry

COULOMB, STRIBECK = "mechanical.coulomb_friction", "mechanical.stribeck_friction"
SIZES = {COULOMB: {"tau_c": 120.0}, STRIBECK: {"tau_c": 80.0, "tau_s": 100.0, "omega_s": 0.008}}
FORM = {"lugre": ("z_s", 2e-5), "smooth": ("omega_v", 5e-4), "sharp": ("", 0.0)}


def told_of(effect: str, friction: str, seed: int, excitation: str = "mixed"):
    """Diagnosis of a log with friction of that form."""
    hidden = f"{effect}:" + ",".join(f"{n}={v}" for n, v in SIZES[effect].items())
    run = make_log(excitation, 30.0, [hidden], seed=seed, settings=off(seed), friction=friction)
    return diagnose(as_log(run))


@pytest.mark.parametrize("friction", ["lugre", "smooth"])
@pytest.mark.parametrize("effect", [COULOMB, STRIBECK])
def test_the_form_is_found_and_nothing_beside_it(effect, friction) -> None:
    found = told_of(effect, friction, seed=4711)
    assert [c.effect.name for c in found.causes] == [effect]
    assert not found.rests
    (cause,) = found.causes
    form, size = FORM[friction]
    value, deviation = cause.parameters[form]
    assert value == pytest.approx(size, abs=4.0 * deviation, rel=0.1)
    for name, true in SIZES[effect].items():
        value, deviation = cause.parameters[name]
        assert value == pytest.approx(true, abs=4.0 * deviation)


@pytest.mark.parametrize("effect", [COULOMB, STRIBECK])
def test_sharp_friction_keeps_its_simplest_form(effect) -> None:
    (cause,) = told_of(effect, "sharp", seed=815).causes
    assert cause.effect == registry.effects()[effect]
    assert not set(cause.parameters) & set(cause.effect.forms)


def test_effects_are_told_apart_by_name_whatever_is_free_in_them() -> None:
    plain = registry.effects()[COULOMB]
    formed = plain.formed("z_s")
    assert formed == plain
    assert hash(formed) == hash(plain)
    assert formed != registry.effects()[STRIBECK]
    assert formed.is_formed
    assert not plain.is_formed
    assert list(formed.plain.free) == list(plain.free) != list(formed.free)
