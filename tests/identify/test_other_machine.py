"""What an identification takes as known beside the log of a machine that is not the crane."""

from pathlib import Path

import numpy as np
import pytest

from cosim.api.other import other_of
from cosim.errors import UsageError
from cosim.identify.answer import Answer
from cosim.identify.estimate import Quantity
from cosim.identify.nominal import compensated, nominal, valve_demand
from cosim.identify.other_machine import Other, known_beside
from cosim.identify.run import channel_of
from cosim.identify.run_design import observer_answer
from cosim.lexicon import Lexicon
from cosim.logs import load_log

TRAVEL = Lexicon(units={"kg.m2": "kg", "rad": "m"}, blocks={"dcv": "driver"})


def test_a_compensator_that_a_machine_does_not_have_adds_nothing():
    u = np.linspace(-1.0, 1.0, 9)
    other = Other("press", Path("press.toml"), ("dcv", "mechanical"), {"dcv.w0": 200.0})
    known = known_beside(["dcv.zeta=0.7"], other)
    assert compensated(u, known) == pytest.approx(u)
    assert valve_demand(7.0 * u, known) == pytest.approx(7.0 * u)
    assert (known["dcv.w0"], known["dcv.zeta"]) == (200.0, 0.7)
    # of the crane all is as it was
    assert known_beside([], None) == nominal()


def test_a_dead_zone_that_a_machine_states_stays():
    other = Other("press", Path("press.toml"), ("dead_zone",), {"dead_zone.b_r": 0.1, "dead_zone.b_l": -0.2})
    known = known_beside([], other)
    assert valve_demand(np.array([0.05, 0.3, -0.3]), known) == pytest.approx([0.0, 0.2, -0.1])


def test_a_mass_is_told_as_one():
    """EMPS: "95 kg.m2, inertia at the slew axis" was said of a table on a spindle."""
    found = Answer("mechanics", {}, {"mechanical.J": Quantity(95.0, 1.0, 50.0, "kg.m2")}, lexicon=TRAVEL)
    (told,) = found.summary()
    assert told.startswith("mechanical.J = 95 kg, 92.99 to 97.01 (95 %)")
    assert told.endswith(": mass at the axis")
    assert found.as_data({})["parameters"]["mechanical.J"]["unit"] == "kg"


def test_a_channel_goes_from_the_command_of_a_machine_to_its_motion(tmp_path):
    (tmp_path / "log.csv").write_text(
        "time [s],u [1],slew [deg]\n" + "".join(f"{k / 10},{k % 2},{k}\n" for k in range(50))
    )
    log = load_log(tmp_path / "log.csv")
    moving = Other("boom", Path("m.toml"), ("dcv", "mechanical"))
    assert (channel_of(moving, log).source, channel_of(moving, log).integrators) == ("u", 1)
    assert channel_of(Other("valve", Path("m.toml"), ("dcv",)), log).integrators == 0
    assert (
        channel_of(Other("axis.fmu", Path("m.toml")), log).integrators == 1
    )  # an angle, as far as anybody knows


def test_an_fmu_is_no_crane(tmp_path):
    """Its input called u went through the crane's compensator; its one output is what moves, whatever its name."""
    (tmp_path / "log.csv").write_text("t,vir,qm\n" + "".join(f"{k / 10},{k % 2},{k}\n" for k in range(50)))
    (tmp_path / "m.toml").write_text(
        'model = "axis.fmu"\ntime = { column = "t", unit = "s" }\n[signals]\nu = { column = "vir", unit = "V" }\n'
        'x = { column = "qm", unit = "mm" }\n'
    )
    other = other_of(tmp_path / "m.toml", [load_log(tmp_path / "log.csv", tmp_path / "m.toml")])
    assert other is not None
    assert (other.command, other.motion) == ("u", "x")
    assert known_beside([], other)["compensator.d_plus"] == 0.0


def test_an_observer_of_an_angle_is_not_made_for_a_cylinder(tmp_path, known):
    """Its gains were told in degrees of a travel in centimetres."""
    (tmp_path / "log.csv").write_text("t,duty,way\n" + "".join(f"{k / 10},{k % 2},{k}\n" for k in range(50)))
    (tmp_path / "m.toml").write_text(
        'time = { column = "t", unit = "s" }\n[signals]\nu = { column = "duty", unit = "1" }\n'
        'travel = { column = "way", unit = "cm" }\n'
    )
    log = load_log(tmp_path / "log.csv", tmp_path / "m.toml")
    other = Other("boom", tmp_path / "m.toml", ("mechanical",), motion="travel")
    with pytest.raises(UsageError, match="'travel' is in cm"):
        observer_answer(log, known, [], None, other)
