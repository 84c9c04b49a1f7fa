"""What follows an input at once is right when it is asked for after a set: Python and native FMUs and chains alike."""

import math
import shutil
from pathlib import Path

import pytest
from fmpy import extract
from fmu_raw import OK, Instance

from fmus.build import build_fmu, composed_block

STEP = 1e-3
DEAD_ZONE = {0.7: 0.25, -0.9: -0.5, 0.2: 0.0, 3.0: 1.0}  # (2.2) with the nominal break points


@pytest.fixture(scope="module", params=["python", "native"])
def folder(request, unpacked, tmp_path_factory):
    """Folder of a block's unpacked FMU, by name, for both kinds."""
    top = tmp_path_factory.mktemp("python")

    def find(name: str) -> Path:
        if request.param == "native":
            return unpacked[name]
        if not (top / name).exists():
            extract(str(build_fmu(composed_block(name), top / f"{name}.fmu")), str(top / name))
        return top / name

    return find


def test_a_static_block_answers_with_the_input_as_it_is(folder) -> None:
    zone = Instance(folder("dead_zone"), "z").initialise()
    for k, (command, demand) in enumerate(DEAD_ZONE.items()):
        zone.set(command=command)
        assert zone.get("demand") == [pytest.approx(demand, abs=1e-15)]
        assert zone.get("command") == [command]
        assert zone.get("demand", "command", "b_r") == [pytest.approx(demand, abs=1e-15), command, 0.45]
        assert zone.step(k * STEP) == OK
        assert zone.get("demand") == [pytest.approx(demand, abs=1e-15)]
    zone.close()


def test_play_answers_without_moving(folder) -> None:
    zone = Instance(folder("dead_zone"), "z").initialise(play=0.1, b_r=0.0, b_l=0.0)
    zone.set(command=0.5)
    assert zone.get("demand") == [pytest.approx(0.4)]
    zone.set(command=0.05)  # the play has not followed to 0.4 yet: it is asked, not stepped
    assert zone.get("demand") == [0.0]
    zone.set(command=0.5)
    assert zone.step(0.0) == OK
    zone.set(command=0.45)
    assert zone.get("demand") == [pytest.approx(0.4)]
    zone.close()


def test_a_sensor_answers_but_for_what_lags(folder) -> None:
    sensor = Instance(folder("sensor"), "s").initialise(gain=2.0, bias=0.5, drift=0.1, quantum=0.25)
    sensor.set(theta=1.1)
    assert sensor.get("slew") == [2.75]
    sensor.close()
    for lagging in ({"f_c": 10.0}, {"tau_l": 0.1}, {"tau_l": 0.1, "q_l": 0.25}):
        slow = Instance(folder("sensor"), "s").initialise(**lagging)
        slow.set(theta=1.0)
        assert slow.get("slew") == [0.0]
        assert slow.step(0.0) == OK
        assert 0.0 < slow.get("slew")[0] < 0.5
        slow.close()


def driven(slave: Instance, ask: bool) -> list[list[float]]:
    """Outputs of steps under a moving input; asked for before each step too, or not."""
    found = []
    for k in range(300):
        for n, name in enumerate(slave.inputs):
            slave.set(**{name: 0.9 * math.sin(0.05 * k + n)})
        if ask:
            slave.get(*slave.outputs)
        assert slave.step(k * STEP) == OK
        found.append(slave.get(*slave.outputs))
    return found


EFFECTS = {
    "dead_zone": {"play": 0.1},
    "sensor": {"p_drop": 0.3, "drift": 1e-3, "tau_l": 0.02, "quantum": 1e-3},
    "controller": {"r_max": 5.0, "k_i": 1.0},
}


@pytest.mark.parametrize("block", EFFECTS)
def test_asking_changes_nothing(folder, block) -> None:
    for values in ({}, EFFECTS[block]):
        runs = [driven(Instance(folder(block), "b").initialise(**values), ask) for ask in (False, True)]
        assert runs[0] == runs[1]


def test_both_kinds_answer_alike(unpacked, tmp_path) -> None:
    for block, values in EFFECTS.items():
        extract(str(build_fmu(composed_block(block), tmp_path / f"{block}.fmu")), str(tmp_path / block))
        slaves = [Instance(f, "b").initialise(**values) for f in (unpacked[block], tmp_path / block)]
        for k in range(200):
            for n, name in enumerate(slaves[0].inputs):
                for slave in slaves:
                    slave.set(**{name: 0.9 * math.sin(0.05 * k + n)})
            asked = [slave.get(*slave.outputs) for slave in slaves]
            assert asked[0] == asked[1]
            assert [slave.step(k * STEP) for slave in slaves] == [OK, OK]
        for slave in slaves:
            slave.close()


def test_a_saved_state_remembers_that_an_input_was_set(folder) -> None:
    zone = Instance(folder("dead_zone"), "z").initialise()
    zone.set(command=0.7)
    state = zone.fmu.getFMUState()
    zone.set(command=0.2)
    zone.fmu.setFMUState(state)
    assert zone.get("demand") == [pytest.approx(0.25, abs=1e-15)]
    zone.fmu.freeFMUState(state)
    zone.close()


def test_a_chain_answers_as_far_as_its_input_reaches_at_once(chains, tmp_path) -> None:
    chain = Instance(Path(extract(str(chains["physical"]), str(tmp_path / "c"))), "c").initialise()
    before = chain.get(*chain.outputs)
    chain.set(u=0.5)
    after = dict(zip(chain.outputs, chain.get(*chain.outputs), strict=True))
    moved = {n for n, v in zip(chain.outputs, before, strict=True) if after[n] != v}
    assert moved == {"compensator_demand", "dead_zone_demand"}
    assert after["compensator_demand"] == pytest.approx(0.5 + 0.45 * math.tanh(25.0))
    assert after["dead_zone_demand"] == pytest.approx(0.5)
    asked, silent = (
        Instance(Path(extract(str(chains["full_order"]), str(tmp_path / n))), "c").initialise() for n in "as"
    )
    assert driven(asked, True) == driven(silent, False)
    shutil.rmtree(tmp_path / "c")
