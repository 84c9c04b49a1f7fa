"""Any chain of our blocks is cut at its measured signals; the crane's own groups come out of the same code."""

from dataclasses import replace
from pathlib import Path

import pytest

from cosim.compare.mapping import load_mapping
from cosim.diagnosis.model.cut import bound, cut, start_values
from cosim.diagnosis.model.groups import MODELS, merged
from cosim.diagnosis.model.machine import machine_for
from cosim.diagnosis.model.options import options_of
from cosim.diagnosis.model.wiring import Wiring, wiring_of_file, wiring_of_system
from cosim.errors import DataError, ModelError, UsageError
from cosim.logs import Log
from cosim.paths import examples_folder, ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.system import Port
from cosim.ssp.write import write_ssp

EXAMPLES = examples_folder()


RIPPLE = "mechanical.gear_ripple"


def test_the_cranes_groups() -> None:
    valve, continuity, mechanics = MODELS["full_order"]
    assert [c for c, _ in valve.stages] == ["compensator", "dead_zone", "dcv"]
    assert (valve.name, valve.drive, valve.observed, valve.held) == ("dcv", "u", ("spool",), True)
    assert valve.absolute
    assert (continuity.drive, continuity.observed) == ("spool", ("p_load", "p_supply"))
    assert dict(continuity.parts)["p_load"] == (("p_a", 1.0), ("p_b", -1.0))
    assert mechanics.upstream_slot == ("continuity", "continuity", "driving_pressure")
    assert mechanics.integrates
    assert not mechanics.absolute
    assert mechanics.trusted == ("mechanical.J", "mechanical.b")
    assert mechanics.starts == (("mechanical.theta_0", "slew"),)
    (simplified,) = MODELS["simplified"]
    assert (simplified.name, simplified.reading, simplified.kind) == ("simplified", "slew", "simplified")


def test_a_package_and_its_wiring_file_are_cut_alike(tmp_path: Path) -> None:
    package = write_ssp(ssp_folder() / "full_order.ssd", tmp_path / "full.ssp", open=True)
    with read_system(package) as system:
        wiring = wiring_of_system(system)
    signals = bound(wiring)
    assert cut(wiring, signals, start_values(wiring, None, signals)) == MODELS["full_order"]


def machine(mapping: str, signals: dict[str, str], more: dict[str, list[str]] | None = None):
    path = EXAMPLES / "mappings" / f"{mapping}.toml"
    plain, table = load_mapping(path)
    log = Log(
        time=[0.0, 1.0],  # type: ignore[arg-type]
        source=path,
        warnings=(),
        synthetic=False,
        sha256="",
        signals={name: [0.0, 0.0] for name in signals},  # type: ignore[misc]
        units=signals,
        display=signals,
    )
    assert plain.model_reference is not None
    return machine_for(
        plain.model_reference, log, plain, table, options_of({**plain.diagnose, **(more or {})}, path)
    )


def test_a_linear_axis_is_one_group_from_force_to_position() -> None:
    found = machine("emps", {"force": "N", "position": "m", "reference": "m"})
    (group,) = found.groups
    assert (group.name, group.drive, group.observed) == ("mechanical", "force", ("position",))
    assert dict(group.parts)["position"] == (("theta", 1.0),)
    assert group.starts == (("mechanical.theta_0", "position"),)
    names = [e.name for e in group.effects()]
    assert "mechanical.constant_load" in names
    assert "mechanical.gravity_load" not in names
    assert found.base["mechanical.A"] == 1.0
    assert found.inputs() == (("p_load",), 1.0)


def test_an_angle_starts_where_its_signal_does_whatever_its_name() -> None:
    # a cylinder that stood at 10.5 cm: from 0 the free run is off by that all the way
    found = machine("mini_excavator_boom", {"u": "1", "travel": "m"})
    (group,) = merged(found.groups, ("u", "travel"))
    assert group.observed == ("travel",)
    assert group.starts == (("mechanical.theta_0", "travel"),)


def test_effects_on_request_are_no_candidates_of_the_crane() -> None:
    names = [e.name for g in MODELS["full_order"] for e in g.effects()]
    assert not {"mechanical.linkage", "continuity.travel_flow"} & set(names)


def test_searches_begin_at_the_machines_own_scale() -> None:
    found = machine("emps", {"force": "N", "position": "m", "reference": "m"})
    friction = next(e for e in found.groups[0].effects() if e.name == "mechanical.coulomb_friction")
    assert friction.free["tau_c"].floor == pytest.approx(0.3)
    limit = replace(found.groups[0], scale=(("N.m", 0.1), ("mechanical.tau_c", 2.0)))
    friction = next(e for e in limit.effects() if e.name == "mechanical.coulomb_friction")
    assert friction.free["tau_c"].floor == pytest.approx(6.0)


def test_an_unmeasured_chain_is_one_group() -> None:
    found = machine("mini_excavator_swing", {"u": "1", "slew": "rad"})
    (group,) = merged(found.groups, {"u", "slew"})
    assert [c for c, _ in group.stages] == ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
    assert group.kind == "mechanical"
    assert group.held


def test_what_cannot_be_cut_is_refused(tmp_path: Path) -> None:
    text = (EXAMPLES / "models" / "emps.ssd").read_text(encoding="utf-8")
    (tmp_path / "emps.ssv").write_text((EXAMPLES / "models" / "emps.ssv").read_text(encoding="utf-8"))
    other = tmp_path / "other.ssd"
    other.write_text(text.replace("resources/mechanical.fmu", "resources/spring.fmu"))
    with pytest.raises(ModelError, match=r"'mechanical' runs 'spring', which is none of our blocks"):
        wiring_of_file(other)
    other.write_text(
        text.replace('name="mechanical"', 'name="axis"').replace('Element="mechanical"', 'Element="axis"')
    )
    with pytest.raises(ModelError, match="name it 'mechanical'"):
        wiring_of_file(other)
    pressure, mass, seen = "continuity", "mechanical", "sensor"
    wires = {
        Port(mass, "p_load"): Port(pressure, "p_load"),
        Port(seen, "theta"): Port(mass, "theta"),
        Port(pressure, "omega"): Port(seen, "slew"),
    }
    blocks = {pressure: "continuity_physical", mass: mass, seen: seen}
    loop = Wiring("loop", blocks, wires, {"spool": (Port(pressure, "spool"),)}, {})
    with pytest.raises(ModelError, match="only a chain can be cut"):
        cut(loop, bound(loop))
    alone = Wiring("alone", {pressure: "continuity_physical"}, {}, {"spool": (Port(pressure, "spool"),)}, {})
    with pytest.raises(ModelError, match=r"'continuity\.omega' is not fed by what 'continuity' drives: wire"):
        cut(alone, bound(alone))
    other.write_text(text.replace("resources/mechanical.fmu", "resources/continuity_physical.fmu"))
    with pytest.raises(ModelError, match="name it 'continuity'"):
        wiring_of_file(other)


def test_two_that_feed_back_are_one_group_whatever_is_measured_between() -> None:
    valve, loop = MODELS["physical"]
    assert (valve.name, valve.loop) == ("dcv", None)
    assert (loop.name, loop.drive, loop.loop) == (
        "continuity+mechanical",
        "spool",
        ("continuity", "mechanical"),
    )
    assert loop.observed == ("slew", "p_load", "p_supply")
    assert loop.trusted == ("continuity.w", "continuity.beta", "mechanical.J", "mechanical.b")
    effects = {e.name: e for e in loop.effects()}
    assert effects["continuity.leakage"].key == "C_L"
    assert effects["continuity.supply_sag"].key == "R_s"
    # the sensor sees another speed behind lost motion; orifices and the travel's flow are in the equations
    assert not {"mechanical.backlash", "continuity.flow_pressure", "continuity.travel_flow"} & effects.keys()
    assert loop.behind_lost_motion() == ("mechanical.backlash",)
    (whole,) = merged(MODELS["physical"], {"u", "slew"})
    assert (whole.name, whole.drive, whole.loop) == ("dcv+continuity+mechanical", "u", loop.loop)
    *_, pressure = merged(MODELS["physical"], {"u", "spool", "p_load"})
    assert pressure.observed == ("p_load",)
    assert pressure.components == ("continuity", "mechanical")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"trust": []}, "'diagnose.trust' is not a key of a mapping; did you mean trusted"),
        ({"consider": ["mechanical.constant_loads"]}, "did you mean mechanical.constant_load"),
        ({"sample": 0.05}, "write a time with its unit"),
        ({"sample": "50 mm"}, "diagnose.sample"),
        ({"causes": 0}, "diagnose.causes"),
    ],
)
def test_a_wrong_table_names_the_key(table: dict[str, object], message: str) -> None:
    with pytest.raises(DataError, match=message):
        options_of(table, "map.toml")


def test_a_signal_that_fits_no_variable_is_named() -> None:
    with pytest.raises(UsageError, match="has the wrong dimension"):
        machine("emps", {"force": "N", "position": "Pa", "reference": "m"})


@pytest.mark.parametrize(
    ("measured", "integrates", "level_counts"),
    [(("slew",), True, False), (("slew", "gyro"), True, False), (("gyro",), False, True)],
)
def test_only_a_place_drifts(measured: tuple[str, ...], integrates: bool, level_counts: bool) -> None:
    """What a speed errs by does not pile up: its level tells of gain, dead zone and limits."""
    mechanics = MODELS["full_order"][-1]
    group = replace(mechanics, observed=measured, parts=(("gyro", (("mechanical.omega", 1.0),)),))
    assert group.moves
    assert (group.integrates, group.drifts, group.level_counts) == (integrates, integrates, level_counts)
    assert not replace(group, drifting=True).level_counts, "the zero of a gyroscope wanders"


@pytest.mark.parametrize(
    ("measured", "asked", "looked_for"),
    [
        (("slew",), (), True),
        (("slew", "gyro"), (), True),
        (("gyro",), (), False),
        (("gyro",), (RIPPLE,), True),
    ],
)
def test_a_ripple_of_the_gear_takes_a_place(
    measured: tuple[str, ...], asked: tuple[str, ...], looked_for: bool
) -> None:
    """Of a speed alone the model's angle drifts by more than a tooth."""
    speed = (("gyro", (("mechanical.omega", 1.0),)),)
    group = replace(MODELS["full_order"][-1], observed=measured, parts=speed, asked=asked)
    assert (RIPPLE in {e.name for e in group.effects()}) == looked_for


@pytest.mark.parametrize("key", ["absolute", "drifting"])
def test_a_signal_that_the_mapping_does_not_have_is_refused_with_its_key(key: str) -> None:
    with pytest.raises(UsageError, match=rf"\[diagnose\] {key}: no signal 'slev'; did you mean slew"):
        machine("mini_excavator_swing", {"u": "1", "slew": "rad"}, {key: ["slev"]})
