"""Which causes held-out data keep: those whose absence makes the prediction worse, even where they help together only."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.fit import Fit
from cosim.diagnosis.groups import MODELS
from cosim.diagnosis.heldout import Step, balanced
from fmus import registry
from fmus.contract import Effect

COULOMB, STRIBECK, BACKLASH = (
    registry.effects()[f"mechanical.{name}"] for name in ("coulomb_friction", "stribeck_friction", "backlash")
)
# all that is asked of a finding here is which candidates there are
MECHANICS = SimpleNamespace(
    task=SimpleNamespace(model=SimpleNamespace(group=MODELS["full_order"][2])), rivals={}
)
FIT = Fit({}, {}, 0.0, 0, {}, np.empty((0, 0)))


def kept(
    errors: list[tuple[tuple[Effect, ...], float]], begin: tuple[Effect, ...], *named: Effect
) -> set[str]:
    """Names of what is kept of the named effects; `errors` are those on held-out data, 100 for any other set."""
    listed = {frozenset(e.name for e in effects): error for effects, error in errors}

    def step(effects: tuple[Effect, ...]) -> Step:
        return Step(effects, FIT, 1.0, listed.get(frozenset(e.name for e in effects), 100.0))

    return {e.name for e in balanced(MECHANICS, step(begin), named, step).effects}  # type: ignore[arg-type]


@pytest.mark.parametrize("begin", [(), (COULOMB, BACKLASH)])
def test_a_cause_that_does_not_help_goes(begin: tuple[Effect, ...]) -> None:
    errors = [((), 10.0), ((COULOMB,), 5.0), ((BACKLASH,), 9.0), ((COULOMB, BACKLASH), 4.99)]
    assert kept(errors, begin, COULOMB, BACKLASH) == {COULOMB.name}


def test_two_that_help_together_only_stay_from_the_full_set() -> None:
    errors = [((), 10.0), ((COULOMB,), 11.0), ((BACKLASH,), 11.0), ((COULOMB, BACKLASH), 3.0)]
    assert kept(errors, (COULOMB, BACKLASH), COULOMB, BACKLASH) == {COULOMB.name, BACKLASH.name}
    assert kept(errors, (), COULOMB, BACKLASH) == set()


@pytest.mark.parametrize(("fuller", "expected"), [(4.98, COULOMB), (4.0, STRIBECK)])
@pytest.mark.parametrize("begin", [(), (STRIBECK,)])
def test_the_fuller_of_two_must_be_better_than_the_simpler(
    begin: tuple[Effect, ...], fuller: float, expected: Effect
) -> None:
    errors = [((), 10.0), ((COULOMB,), 5.0), ((STRIBECK,), fuller)]
    assert kept(errors, begin, STRIBECK) == {expected.name}
