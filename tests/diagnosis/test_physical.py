"""The physical hydraulics as the model that a log is held against: pressure and mechanics feed back, one group."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.trials import tried
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.bases import around, free_bases
from cosim.diagnosis.residuals.finding import learn_noise
from cosim.diagnosis.residuals.freeform import response
from cosim.diagnosis.thresholds import NOMINAL_TRUST
from cosim.rig import as_log, make_log
from cosim.ssp.traceability import embedded
from fmus import registry

C_L, LEAK = 2.1215307141765915e-12, 3.0  # m3/(s Pa), and the leakage hidden, of it
MACHINE = our_machine("physical")
LOOP = MACHINE.groups[1]


@pytest.fixture(scope="module")
def record() -> Record:
    hidden = f"continuity.leakage:c_l={LEAK}"
    return prepare(as_log(make_log("steps", 15.0, [hidden], model="physical", seed=5)), MACHINE)


@pytest.fixture(scope="module")
def task(record: Record) -> Task:
    found = task_for(LOOP, record, [])
    found.model.fixed |= {n: v for n, v in MACHINE.base.items() if n.partition(".")[0] in LOOP.components}
    learn_noise(found, record, tried(found, (), NOMINAL_TRUST).fit)
    return found


def test_a_leak_is_sized_in_the_loop_and_friction_is_no_match_for_it(task: Task) -> None:
    effects = {e.name: e for e in LOOP.effects()}
    leak, friction = (
        tried(task, (effects[n],), NOMINAL_TRUST)
        for n in ("continuity.leakage", "mechanical.coulomb_friction")
    )
    name = "continuity.C_L"
    assert abs(leak.fit.values[name] - (1.0 + LEAK) * C_L) < 3.0 * leak.fit.deviations[name]
    assert leak.fit.deviations[name] < 0.1 * LEAK * C_L
    assert leak.score > friction.score + 20.0
    rest = task.white(task.residuals(leak.fit.values))
    assert np.sqrt(np.mean(rest**2)) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("effect", "parameter", "hidden"),
    [
        ("continuity.tank_leak_a", "continuity.C_A", 4e-13),
        # the other port's mirror image
        pytest.param("continuity.tank_leak_b", "continuity.C_B", 4e-13, marks=pytest.mark.slow),
        ("continuity.supply_pressure", "continuity.p_s", 165e5),
    ],
)
def test_leaks_to_the_tank_and_the_supply_are_causes_of_their_own(
    effect: str, parameter: str, hidden: float
) -> None:
    """(4.19), (4.20): L_A and L_B; Ps. Nothing else of the hydraulics comes near, and only this model has them."""
    log = as_log(make_log("steps", 15.0, settings={parameter: hidden}, model="physical", seed=6))
    record = prepare(log, MACHINE)
    task = task_for(LOOP, record, [])
    task.model.fixed |= {n: v for n, v in MACHINE.base.items() if n.partition(".")[0] in LOOP.components}
    learn_noise(task, record, tried(task, (), NOMINAL_TRUST).fit)
    effects = {e.name: e for e in LOOP.effects()}
    found = tried(task, (effects[effect],), NOMINAL_TRUST)
    assert abs(found.fit.values[parameter] - hidden) < 3.0 * found.fit.deviations[parameter]
    others = ("leakage", "flow_gain", "flow_asymmetry", "compressibility", "tank_leak_a", "tank_leak_b")
    for other in (f"continuity.{name}" for name in others):
        if other != effect:
            assert found.score > tried(task, (effects[other],), NOMINAL_TRUST).score + 20.0, other
    assert effect not in {e.name for g in our_machine("full_order").groups for e in g.effects()}


def test_free_functions_act_around_the_loop(task: Task, record: Record) -> None:
    """A small torque, and a small opening, show in pressure and angle as the linear loop says."""
    values = {n: task.model.nominal(n) for n in LOOP.linear}
    still = np.zeros_like(task.model.drive)
    quiet = type(task.model)(LOOP, still, task.model.h, task.model.fixed)
    opened = type(task.model)(LOOP, still + 1e-6, task.model.h, task.model.fixed)
    base = quiet.simulate({})
    pushed = quiet.simulate({"mechanical.tau_load": -1.0})
    loop = around(LOOP, values, 0.0)
    for cause, found, size in (("torque", pushed, 1.0), ("opening", opened.simulate({}), 1e-6)):
        for effect, signal in (("angle", "slew"), ("pressure", "p_load")):
            expected = response(*loop[cause, effect], task.model.h, still + size)[:2000]
            shown = (found[signal] - base[signal])[:2000]
            assert np.abs(shown - expected).max() < 0.01 * np.abs(expected).max(), (cause, effect)
    poles = np.sort(-np.roots(loop["torque", "speed"][1]).real)
    assert poles == pytest.approx([1 / 0.11, 34.9], rel=1e-4)
    assert set(free_bases(record, LOOP, values, task.model.simulate({}))) == set(LOOP.observed)


def test_effects_have_the_form_of_the_block_they_act_on() -> None:
    for effect in registry.effects().values():
        for block in effect.on:
            here = registry.effect_on(effect.name, block)
            assert here == effect
            known = registry.block(block).parameters | here.parameters
            assert {here.key, *here.free, *here.ranges} <= set(known)
    assert registry.effect_on("continuity.flow_pressure", "continuity_physical") is None
    assert registry.effect_on("continuity.leakage", "continuity") is registry.effects()["continuity.leakage"]


def test_ports_that_are_exchanged_are_seen_in_the_loop() -> None:
    log = as_log(make_log("steps", 8.0, model="physical", seed=8))
    signals = log.signals | {"p_a": log["p_b"], "p_b": log["p_a"]}
    found = diagnose(replace(log, signals=signals), model="physical")
    assert found.verdict == "implausible_data"
    assert [told.finding for told in found.data] == ["p_a and p_b look exchanged"]


@pytest.mark.slow
def test_a_clean_log_is_adequate() -> None:
    log = as_log(make_log("mixed", 30.0, model="physical", seed=31))
    assert diagnose(log, model="physical").verdict == "adequate"


@pytest.mark.slow
def test_causes_of_valve_loop_and_hydraulics_are_named_and_the_extension_runs(tmp_path: Path) -> None:
    runner, log, out = CliRunner(), tmp_path / "log.csv", tmp_path / "out"
    hidden = ("dead_zone.mismatch", "mechanical.coulomb_friction:tau_c=100 N.m")
    made = ["rig", "--out", str(log), "--model", "physical", "--duration", "30 s", "--seed", "12"]
    made += [word for text in hidden for word in ("--hide", text)]
    assert runner.invoke(make_app(), made).exit_code == 0
    done = runner.invoke(
        make_app(), ["diagnose", str(log), "--model", "physical", "--json", "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["verdict"] == "explained"
    causes = {c["effect"]: c["parameters"] for c in answer["causes"]}
    assert set(causes) == {"dead_zone.mismatch", "mechanical.coulomb_friction"}
    low, high = causes["mechanical.coulomb_friction"]["tau_c"]["ci95"]
    assert low <= 100.0 <= high
    gain = answer["gain"]["slew"]
    assert gain["rmse_after"] < 1.05 * gain["noise_floor"]
    for name in ("extended.ssp", "extended_open.ssp"):
        told = embedded(out / name)
        assert told is not None
        assert told["data"]["log_sha256"] == answer["made"]["log_sha256"]
    run = runner.invoke(make_app(), ["simulate", str(out / "extended.ssp"), "--stop-time", "2 s", "--json"])
    assert run.exit_code == 0, run.output
