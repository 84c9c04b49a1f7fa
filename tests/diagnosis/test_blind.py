"""What was hidden is named; a clean log stays clean; a cause nobody knows is not invented."""

from pathlib import Path

import pytest
from hidden_logs import diagnosed, off

from cosim.diagnosis.answer.schema import Answer
from cosim.diagnosis.model.groups import left_out
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import EFFECTS, Noise, make_log
from cosim.rig.write import as_log
from fmus import registry

# seen only with the tracker, or hidden in the start angle without one
NEEDS_TRACKER = ("tracker.clock", "tracker.seam", "sensor.bias")
FRICTION = registry.effects()["mechanical.coulomb_friction"]
SINGLE = [n for n in EFFECTS if not n.startswith("unknown.") and n not in NEEDS_TRACKER]
# one of each block before the sensor in every run, friction below; the others with the slow tests
QUICK_IN_BLOCK = ("dcv.delay", "continuity.leakage")
# a scale of the slew and a change of the mechanics look alike without a tracker
TWINS = {"sensor.gain", "mechanical.viscous_friction"}
# the rig's moderate 2 % may hide in what J and b are trusted to, and a log that begins below the sensor's range shows
# nothing of the motion; one that leaves it on both sides does
SIZES = {"sensor.gain": {"gain": 1.06}, "sensor.saturation": {"high": 0.2356, "low": 0.1745}}


@pytest.mark.parametrize(
    ("effect", "blocks"),
    [
        *(pytest.param(n, (), marks=pytest.mark.slow, id=n) for n in SINGLE),
        *(pytest.param(n, (n.partition(".")[0],), id=f"{n} in its block") for n in QUICK_IN_BLOCK),
    ],
)
def test_a_single_effect_is_named(effect: str, blocks: tuple[str, ...]) -> None:
    sized = {n.partition(".")[2]: v for n, v in EFFECTS[effect].moderate.items()} | SIZES.get(effect, {})
    hidden = effect if effect not in SIZES else f"{effect}:{','.join(f'{n}={v}' for n, v in sized.items())}"
    seconds = 21.0 if blocks else 40.0  # what acts on one signal shows in the shortest mixed log
    found = diagnosed(hidden, seed=100 + SINGLE.index(effect), seconds=seconds, blocks=blocks)
    assert found.causes, (found.verdict, [r.what for r in found.rests])
    first = found.causes[0]
    assert effect in (first.effect.name, *first.indistinguishable)
    assert len(found.causes) == 1
    if first.effect.name == effect and effect not in TWINS:
        size = next(iter(sized))
        estimate, deviation = first.parameters[size]
        # four standard deviations, and a part of the size for what a phase of 180 degrees exchanges
        assert abs(abs(estimate) - abs(sized[size])) < 4.0 * deviation + 0.1 * abs(sized[size])


def test_friction_is_named_alone_and_in_the_simplest_form_of_its_law(rubbing: Path) -> None:
    """By the diagnosis of the whole drive that the report's tests look at too."""
    found = Answer.model_validate_json((rubbing / "diagnosis.json").read_text(encoding="utf-8"))
    (cause,) = found.causes
    assert (found.verdict, cause.effect) == ("explained", FRICTION.name)
    assert set(cause.parameters) == set(FRICTION.free)
    low, high = cause.parameters["tau_c"].ci95
    # four standard deviations, where the interval has two to either side
    assert abs(cause.parameters["tau_c"].value - 150.0) < high - low
    assert high - low < 0.1 * 150.0


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("white", 1),
        *(
            pytest.param(k, s, marks=pytest.mark.slow)
            for s in (2, 3, 4, 5, 6)
            for k in ("white", "ar1", "pink")
        ),
    ],
)
def test_nothing_is_named_in_a_clean_log(kind: str, seed: int) -> None:
    found = diagnosed(seed=seed, kind=kind, seconds=21.0 if seed == 1 else 30.0)
    assert [c.effect.name for c in found.causes] == []
    assert found.verdict == "adequate", [r.what for r in found.rests]


@pytest.mark.parametrize("blocks", [("continuity",), pytest.param((), marks=pytest.mark.slow)])
def test_an_effect_that_the_library_lacks_stays_unnamed(blocks: tuple[str, ...]) -> None:
    with left_out("continuity.flow_asymmetry"):
        found = diagnosed("continuity.flow_asymmetry", seed=21, blocks=blocks)
    assert not [c for c in found.causes if c.group == "continuity"]
    assert "continuity" in [r.block for r in found.rests]


@pytest.mark.slow
def test_a_drift_is_not_named_for_the_gravity_that_the_library_lacks() -> None:
    """It explains all but a twentieth, which a law of several forms might leave; a drift has one form only."""
    with left_out("mechanical.gravity_load"):
        hidden = ["mechanical.gravity_load:tau_g=80.8,theta_g=0.327"]
        seed, noise = 865911349, Noise(scale=2.0)
        run = make_log(
            "small_steps", 60.0, hidden, amplitude=0.98, noise=noise, seed=seed, settings=off(seed)
        )
        found = diagnose(as_log(run))
    assert found.causes == []
    assert "mechanical" in [r.block for r in found.rests]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "block"),
    [
        ("unknown.warming_valve", "dcv"),
        ("unknown.quadratic_drag", "mechanical"),
        ("unknown.torque_burst", "mechanical"),
    ],
)
def test_an_unknown_cause_stays_unnamed(effect: str, block: str) -> None:
    found = diagnosed(effect, seed=31, seconds=60.0)
    assert block in [r.block for r in found.rests]
    assert not [c for c in found.causes if c.group == block]


@pytest.mark.slow
def test_two_effects_in_different_blocks_are_both_named() -> None:
    found = diagnosed("dcv.delay", "mechanical.coulomb_friction", seed=41)
    assert {c.effect.name for c in found.causes} == {"dcv.delay", "mechanical.coulomb_friction"}


@pytest.mark.slow
def test_two_effects_in_one_block_are_both_named() -> None:
    found = diagnosed("dcv.delay", "dcv.offset", seed=42)
    assert {c.effect.name for c in found.causes} == {"dcv.delay", "dcv.offset"}
