"""How a system is cut at its measured signals, and what they can tell apart: systems of a few boxes, no FMU behind them."""

from pathlib import Path

import pytest

from cosim.errors import DataError
from cosim.ssp.system import Component, Fmu, Port, System, SystemInput, Variable, Wire
from cosim.system.graph import Drive, cut, measured_ports, port_of
from cosim.system.structure import MOST, signatures, structure


def box(name: str, inputs: str = "u", outputs: str = "y", **kinds: str) -> Component:
    """A component with Real inputs and outputs, of another kind where said, and what goes on inside it."""
    variables = {}
    for causality, names in (("input", inputs), ("output", outputs), ("local", "x"), ("parameter", "k")):
        for one in names.split():
            variables[one] = Variable(
                one,
                len(variables),
                kinds.get(one, "Real"),
                causality,
                "continuous",
                "",
                None,
                "",
                "",
                1.0,
                0.0,
                0.0,
                1.0,
            )
    fmu = Fmu(name, Path(), "", name, variables, {}, {}, None, True, None)
    return Component(name, fmu, {})


def system(boxes: list[Component], wires: list[Wire | str], **inputs: str) -> System:
    """Wires as ``one.y -> other.u``; inputs of the system by name, with the connectors that they feed."""

    def port(text: str) -> Port:
        return Port(*text.strip().split("."))

    joined = [Wire(*map(port, w.split("->"))) if isinstance(w, str) else w for w in wires]
    outside = {
        name: SystemInput(name, "1", tuple(Wire(Port("", name), port(t)) for t in targets.split()))
        for name, targets in inputs.items()
    }
    return System("made", Path("made.ssp"), {b.name: b for b in boxes}, tuple(joined), outside)


def chain() -> System:
    """A command through three boxes; the last two form a loop, which a sensor reads."""
    boxes = [box("sensor"), box("plant", "u back"), box("valve"), box("spring")]
    wires = ["valve.y -> plant.u", "plant.y -> spring.u", "spring.y -> plant.back", "plant.y -> sensor.u"]
    return system(boxes, wires, command="valve.u")


def test_nothing_measured_but_the_ends_leaves_one_group_whose_loop_is_stepped_together() -> None:
    (group,) = cut(chain(), ["command", "sensor.y"])
    assert [u.components for u in group.units] == [("valve",), ("plant", "spring"), ("sensor",)]
    assert group.name == "valve+plant+spring+sensor"
    assert group.drives == (Drive("command", Port("valve", "u")),)
    assert group.judged == (("sensor.y", Port("sensor", "y")),)
    assert {str(w) for w in group.inner} == {str(w) for w in chain().wires}
    assert (group.missing, group.source) == ((), False)


def test_measured_signals_cut_groups_and_drive_what_is_behind_them_upstream_first() -> None:
    groups = cut(chain(), ["sensor.y", "spring.y", "plant.y", "valve.y", "command"])
    assert [g.name for g in groups] == ["valve", "sensor", "plant", "spring"]
    of = {g.name: g for g in groups}
    assert {(d.signal, str(d.port)) for d in of["plant"].drives} == {
        ("valve.y", "plant.u"),
        ("spring.y", "plant.back"),
    }
    assert not any(g.inner for g in groups)
    assert of["plant"].judged == (("plant.y", Port("plant", "y")),)


def test_a_measured_wire_within_a_loop_opens_it() -> None:
    first, *others = cut(chain(), ["command", "valve.y", "spring.y"])
    assert first.name == "valve"
    (rest,) = others
    order = [u.components for u in rest.units]
    assert order[0] == ("plant",)
    assert sorted(order[1:]) == [("sensor",), ("spring",)]
    assert {d.signal for d in rest.drives} == {"valve.y", "spring.y"}


def test_loops_one_behind_the_other_are_units_of_their_own() -> None:
    boxes = [box(n, "u v") for n in "abcde"]
    wires = ["a.y -> b.u", "b.y -> a.u", "b.y -> c.u", "c.y -> d.u", "d.y -> e.u", "e.y -> c.v"]
    (group,) = cut(system(boxes, wires, command="a.v"), ["command"])
    assert [u.components for u in group.units] == [("a", "b"), ("c", "d", "e")]


def test_what_was_not_measured_outside_is_missing_once_and_a_source_has_neither() -> None:
    made = system([box("one", "u v"), box("two", ""), box("three")], ["two.y -> three.u"], load="one.u one.v")
    groups = {g.name: g for g in cut(made, ["one.y", "two.y"])}
    assert groups["one"].missing == ("load",)
    assert not groups["one"].source
    assert groups["two"].source
    assert not groups["three"].source
    # an input that nothing feeds can be measured too
    free = system([box("one")], [])
    assert cut(free, ["one.u"])[0].drives == (Drive("one.u", Port("one", "u")),)
    assert cut(free, ["one.u"])[0].judged == ()


def test_whole_numbers_drive_and_are_not_judged() -> None:
    made = system([box("one", y="Integer"), box("two")], ["one.y -> two.u"], command="one.u")
    one, two = cut(made, ["command", "one.y", "two.y"])
    assert one.judged == ()
    assert [d.signal for d in two.drives] == ["one.y"]


def test_a_reading_at_an_input_stands_for_its_source_but_behind_a_factor_or_another_reading() -> None:
    scaled = Wire(Port("one", "y"), Port("two", "u"), 2.0, 1.0)
    made = system([box("one"), box("two"), box("three")], [scaled, "one.y -> three.u"], command="one.u")
    assert measured_ports(made, ["three.u"]) == ({"three.u": Port("one", "y")}, {})
    assert measured_ports(made, ["two.u"]) == ({}, {"two.u": (Port("two", "u"), 2.0, 1.0)})
    assert measured_ports(made, ["three.u", "one.y"]) == (
        {"one.y": Port("one", "y")},
        {"three.u": (Port("three", "u"), 1.0, 0.0)},
    )
    assert measured_ports(made, ["one.u"]) == ({"one.u": Port("", "command")}, {})
    # what was read behind a factor drives what it feeds, as it was read; the source drives the others
    of = {g.name: g for g in cut(made, ["command", "one.y", "two.u"])}
    assert of["two"].drives == (Drive("two.u", Port("two", "u")),)
    assert of["three"].drives == (Drive("one.y", Port("three", "u")),)
    assert cut(made, ["command", "one.y"])[1].drives == (Drive("one.y", Port("two", "u"), 2.0, 1.0),)


def test_names_of_columns_stand_for_connectors() -> None:
    made = chain()
    made.outputs["angle"] = Port("sensor", "y")
    assert port_of(made, "command") == Port("", "command")
    assert port_of(made, "angle") == Port("sensor", "y")
    assert port_of(made, "plant.x") == Port("plant", "x")
    for name, words in (
        ("plant.z", "no connector 'plant.z'"),
        ("pump.y", "no connector 'pump.y'"),
        ("plant.k", "a Real parameter"),
        ("y", "no connector 'y'"),
    ):
        with pytest.raises(DataError, match=words):
            port_of(made, name)
    with pytest.raises(DataError, match="a String output"):
        port_of(system([box("one", y="String")], []), "one.y")
    with pytest.raises(DataError, match=r"closest: 'valve\.y'"):
        port_of(made, "valve.yy")


def test_of_the_only_component_the_connector_is_enough() -> None:
    only = system([box("one", "u", "y spool.x")], [])
    for name, variable in (("y", "y"), ("one.y", "y"), ("spool.x", "spool.x"), ("other.y", "y")):
        assert port_of(only, name) == Port("one", variable)


def test_places_show_in_the_groups_that_feel_them() -> None:
    made = chain()
    felt = signatures(made, ["command", "valve.y", "sensor.y"], ["valve.k"])
    (whole,) = felt["at plant.u (input)"]
    assert whole == "plant+spring+sensor"
    assert felt["at valve.u (input)"] == ("valve",)
    assert felt["at valve.y (sensor)"] == ("valve", whole)
    assert felt["at command (sensor)"] == ("valve",)
    assert felt["at spring.y (output)"] == felt["at sensor.y (sensor)"] == (whole,)
    assert felt["parameter valve.k"] == ("valve",)
    # a group without a reading of its own shows nothing, and a reading at an input is none of the group before
    dark = signatures(made, ["command", "valve.y"])
    assert dark["at plant.u (input)"] == ()
    assert signatures(system([box("one")], []), ["one.u"])["at one.u (sensor)"] == ()


def test_places_of_one_signature_are_a_class_the_largest_first() -> None:
    found = structure(chain(), ["command", "valve.y", "sensor.y"], ["valve.k"])
    assert [len(places) for _, places in found.classes] == sorted(
        (len(places) for _, places in found.classes), reverse=True
    )
    of = {felt: set(places) for felt, places in found.classes}
    assert of[("valve",)] == {
        "at valve.u (input)",
        "at valve.y (output)",
        "at command (sensor)",
        "parameter valve.k",
    }


def test_a_connector_is_proposed_for_what_it_would_separate_or_show() -> None:
    line = system([box(n) for n in "abc"], ["a.y -> b.u", "b.y -> c.u"], command="a.u")
    assert structure(line, ["command", "c.y"]).advice == (
        "measuring a.y would raise the classes of places that can be told apart from 1 to 3",
        "measuring b.y would raise the classes of places that can be told apart from 1 to 3",
    )
    # nothing behind b is seen: its end first, which shows more of it
    advice = structure(line, ["command", "b.y"]).advice
    assert advice == (
        "measuring c.y would raise the classes of places that can be told apart from 1 to 3 and make 2 more of the "
        "places visible",
        "measuring a.y would raise the classes of places that can be told apart from 1 to 3",
    )
    assert structure(line, ["command", "a.y", "b.y", "c.y"]).advice == ()
    long = system(
        [box(f"n{k}") for k in range(9)], [f"n{k}.y -> n{k + 1}.u" for k in range(8)], command="n0.u"
    )
    assert len(structure(long, ["command", "n8.y"]).advice) == MOST
