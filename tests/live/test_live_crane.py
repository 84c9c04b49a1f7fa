"""The crane's side of the link, and a recorded log diagnosed."""

import json
import struct

import numpy as np
import pytest
from live_bench import pair, run

from cosim.errors import UsageError
from cosim.live.crane import SystemPlant
from cosim.live.operator import Operator
from cosim.logs import load_log
from cosim.paths import ssp_folder
from cosim.rig import Recipe
from cosim.rig.excitation import command
from cosim.rig.hidden import Hidden, assemble
from cosim.rig.integrate import simulate
from cosim.rig.noise import Noise
from cosim.rig.parameters import DEG, NOMINAL
from cosim.rig.stepping import SteppedCrane
from cosim.ssp.stimulus import default_command, stimulus_csv
from cosim.ssp.write import write_ssp


def rig(*effects, noise=1.0, seed=1):
    plant = assemble([Hidden.parse(text) for text in effects], {"mechanical.theta_0": 12.0 * DEG})
    return SteppedCrane(plant, Noise(noise), seed)


def steps(seconds):
    return command("steps", np.arange(round(1000 * seconds)) * 1e-3, 1.0, 1).tolist()


def test_the_log_of_the_link_is_that_of_the_rig_for_its_command(tmp_path) -> None:
    """Sample k and the command that was held from it on stand in one row, as in a log of the rig."""
    with pair(rig(noise=0.0), tmp_path / "m.csv", crane_path=tmp_path / "c.csv", played=steps(4.0)) as (
        master,
        crane,
    ):
        run(master, crane, 4000)
        facts = master.facts()
    assert facts["datagrams"] | {"identical": 0} == dict.fromkeys(facts["datagrams"], 0) | {
        "received": 4000,
        "used": 4000,
    }
    log, own = load_log(tmp_path / "m.csv"), load_log(tmp_path / "c.csv")
    assert log.synthetic
    assert own.synthetic
    assert len(log) == 4000
    assert np.array_equal(log["u"][:3999], own["u"])
    assert np.ptp(log["u"]) > 0.5
    plant = NOMINAL._replace(mechanical=NOMINAL.mechanical._replace(theta_0=12.0 * DEG))
    true = simulate(np.ascontiguousarray(log["u"]), plant)
    # float32 and nine digits
    assert log["spool"] == pytest.approx(true["spool"], abs=3e-10)
    assert log["slew"] == pytest.approx(true["seen"], abs=2e-8)
    assert log["p_load"] == pytest.approx(true["p_load"], abs=3.0)


def test_a_disabled_or_bad_command_does_not_move_it(tmp_path) -> None:
    with pair(rig(), tmp_path / "m.csv") as (master, crane):
        for values, applied in (
            ((0.5, 0, 0, 1, 0, 0), 0.5),
            ((float("nan"), 0, 0, 1, 0, 0), 0.5),
            ((7.0, 0, 0, 1, 0, 0), 0.5),
            ((0.7, 0, 0, float("nan"), 0, 0), 0.5),
            ((0.7, 0, 0, 0, 1, 1), 0.0),
            ((-0.7, 0, 0, 1, 0, 0), float(np.float32(-0.7))),
        ):
            master._link.send(struct.pack("<6f", *values))
            crane.tick()
            assert crane.applied == applied
        counts = crane.facts()["datagrams"]
        assert (counts["nan"], counts["beyond"]) == (2, 1)
        for values in ((0.25, 0, 0, 1, 0, 0), (float("nan"), 0, 0, 1, 0, 0)):
            master._link.send(struct.pack("<6f", *values))
        crane.tick()
        assert crane.applied == 0.25, "what is bad does not hide what came before it"
        for _ in range(200):
            crane.tick()
        assert crane.applied == 0.0, "a controller that is silent has let go"


def test_a_system_of_fmus_is_a_crane_too(built, tmp_path) -> None:
    with (
        SystemPlant(built / "full_order_open.ssp", ["mechanical.theta_0=12 deg"]) as plant,
        pair(plant, tmp_path / "m.csv", played=steps(4.0)) as (master, crane),
    ):
        run(master, crane, 4000)
    log = load_log(tmp_path / "m.csv")
    assert np.ptp(log["u"]) > 0.5
    nominal = NOMINAL._replace(mechanical=NOMINAL.mechanical._replace(theta_0=12.0 * DEG))
    true = simulate(np.ascontiguousarray(log["u"]), nominal)
    # the blocks at 1 ms against the rig's fine steps: a tenth of the sensors' noise
    assert np.abs(log["spool"] - true["spool"]).max() < 0.5e-6
    assert np.abs(log["slew"] - true["seen"]).max() < 1e-3 * DEG


def test_a_closed_system_is_refused(tmp_path) -> None:
    stimulus = stimulus_csv(*default_command(0.1))
    path = write_ssp(ssp_folder() / "simplified.ssd", tmp_path / "closed.ssp", stimulus=stimulus)
    with pytest.raises(UsageError, match="an input 'u'"):
        SystemPlant(path)


def test_what_no_link_can_show_is_refused() -> None:
    with pytest.raises(UsageError, match="no tracker"):
        rig("tracker.seam")
    with pytest.raises(UsageError, match="pink"):
        SteppedCrane(NOMINAL, Noise(kind="pink"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect", ["mechanical.coulomb_friction", "dcv.delay", "continuity.leakage", "sensor.lag", None]
)
def test_the_log_of_the_link_is_diagnosed_to_the_effect_that_was_switched_on(
    command, built, tmp_path, effect
) -> None:
    log = tmp_path / "m.csv"
    plant = rig(*([] if effect is None else [effect]))
    with pair(plant, log, Operator(), played=Recipe("steps", 20.0).command()[1].tolist()) as (master, crane):
        run(master, crane, 20_000)
    code, out, _ = command("diagnose", log, "--json")
    answer = json.loads(out)
    assert code == 0
    if effect is None:
        assert answer["verdict"] == "adequate"
        return
    assert answer["verdict"] == "explained"
    named = answer["causes"][0]
    assert effect in (named["effect"], *named["indistinguishable_from"])
    assert len(answer["causes"]) == 1
