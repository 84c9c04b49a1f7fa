"""Reading SSP packages of others: what is understood, and what is refused with which words."""

import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bad_fmus
import fmpy
import pytest
import pythonfmu
import toy_fmus
from lxml import etree
from toy_fmus import binding, ssv

from cosim.anysystem.pipeline import unmeasured
from cosim.errors import ModelError, UsageError
from cosim.master import Runner
from cosim.ssp import Port, check_ssp, read_ssp, read_ssv, read_system

WITH_NAMESPACES = (
    "<ssd:ParameterBindings xmlns:ssd='http://ssp-standard.org/SSP1/SystemStructureDescription'"
    " xmlns:ssc='http://ssp-standard.org/SSP1/SystemStructureCommon'"
    " xmlns:ssv='http://ssp-standard.org/SSP1/SystemStructureParameterValues'"
)
PAIR = {"w": "wave", "g": "gain"}


def test_components_wires_and_connectors_are_found(toys: Any) -> None:
    wires = ["w.y -> g.u", "g.y -> result", "level -> l.u"]
    path = toys.ssp({**PAIR, "l": "lag"}, wires, units={"level": "m", "l.u": "m"})
    with read_ssp(path) as system:
        assert system.name == "toy"
        assert list(system.components) == ["w", "g", "l"]
        assert [str(w) for w in system.wires] == ["w.y -> g.u"]
        assert system.inputs["level"].unit == "m"
        assert [w.target for w in system.inputs["level"].targets] == [Port("l", "u")]
        assert system.outputs == {"result": Port("g", "y")}
        assert (system.start_time, system.stop_time) == (0.0, 1.0)
        assert system.notes == []
        gain = system.components["g"].fmu
        assert gain.dependencies == {"y": frozenset({"u"})}
        assert gain.variables["k"].can_be_set
        assert not gain.variables["y"].can_be_set


def test_a_connection_drawn_backwards_is_the_same_connection(toys: Any) -> None:
    with read_ssp(toys.ssp(PAIR, ["g.u -> w.y"])) as system:
        assert [str(w) for w in system.wires] == ["w.y -> g.u"]


def test_unconnected_inputs_keep_their_start_value_and_are_noted(toys: Any) -> None:
    inside = {"g": binding(ssv({"u": 3.0}))}
    with Runner(toys.ssp({"g": "gain"}, [], inside=inside)) as runner:
        result = runner.run(1.0, 0.5)
    assert list(result["g.y"]) == [6.0, 6.0, 6.0]
    assert result.notes == ["input g.u is not connected and keeps its start value 3.0 m"]


def test_values_come_from_inline_sets_files_and_prefixes_the_system_winning(toys: Any) -> None:
    later = binding(ssv({"n": 'Integer value="4"'}))
    file = later.replace(
        "<ssd:ParameterBinding>", "<ssd:ParameterBinding source='values/g.ssv'/><ssd:ParameterBinding>"
    )
    path = toys.ssp(
        PAIR,
        ["w.y -> g.u"],
        inside={"g": file, "w": binding(ssv({"a": 1.5}))},
        system_bindings=binding(ssv({"a": 2.5}), prefix="w."),
        files={"values/g.ssv": ssv({"k": 7.0, "n": 'Integer value="3"', "label": 'String value="x"'})},
    )
    with read_ssp(path) as system:
        assert system.components["g"].starts == {"k": 7.0, "n": 4, "label": "x"}
        assert system.components["w"].starts == {"a": 2.5}
        assert system.notes == []


def test_one_parameter_set_can_be_chosen_by_name(toys: Any) -> None:
    both = "<ssd:ParameterBindings>" + "".join(
        f"<ssd:ParameterBinding><ssd:ParameterValues>{ssv({'k': k}, name)}</ssd:ParameterValues></ssd:ParameterBinding>"
        for k, name in ((5.0, "cold"), (6.0, "warm"))
    )
    path = toys.ssp({"g": "gain"}, [], inside={"g": both + "</ssd:ParameterBindings>"})
    for name, expected in (("cold", 5.0), ("warm", 6.0), (None, 6.0)):
        with read_ssp(path, name) as system:
            assert system.components["g"].starts["k"] == expected
    with pytest.raises(ModelError, match="no parameter set named 'hot'; the system has 'cold', 'warm'"):
        read_ssp(path, "hot")


def test_values_are_converted_to_the_unit_of_the_variable(toys: Any) -> None:
    inside = {"g": binding(ssv({"u": 25.0}, unit={"u": "mm"}))}
    with read_ssp(toys.ssp({"g": "gain"}, [], inside=inside)) as system:
        assert system.components["g"].starts["u"] == pytest.approx(0.025, rel=1e-15)
    wrong = {"g": binding(ssv({"u": 25.0}, unit={"u": "s"}))}
    with pytest.raises(ModelError, match=r"'u' = 25\.0 s: unit 's' cannot be converted to 'm'"):
        read_ssp(toys.ssp({"g": "gain"}, [], inside=wrong))


def test_a_mapping_gives_values_the_names_of_the_variables(toys: Any) -> None:
    mapping = (
        "<ssm:ParameterMapping xmlns:ssm='http://ssp-standard.org/SSP1/SystemStructureParameterMapping' version='1.0'>"
        "<ssm:MappingEntry source='factor' target='k'><ssc:LinearTransformation factor='10' offset='1'/></ssm:MappingEntry>"
        "<ssm:MappingEntry source='not there' target='n'/></ssm:ParameterMapping>"
    )
    bound = binding(ssv({"factor": 0.4, "unmapped": 3.0})).replace(
        "</ssd:ParameterBinding>",
        f"<ssd:ParameterMapping>{mapping}</ssd:ParameterMapping></ssd:ParameterBinding>",
    )
    with read_ssp(toys.ssp({"g": "gain"}, [], inside={"g": bound})) as system:
        assert system.components["g"].starts == {"k": 5.0}
        assert not any("unmapped" in note for note in system.notes)


def test_a_unit_in_brackets_is_that_unit(toys: Any) -> None:
    inside = {"g": binding(ssv({"u": 25.0}, unit={"u": "[mm]"}))}
    with read_ssp(toys.ssp({"g": "gain"}, [], inside=inside)) as system:
        assert system.components["g"].starts["u"] == pytest.approx(0.025, rel=1e-15)


def test_a_package_of_ssp_2_with_systems_within_systems_is_read_flat(toys: Any, tmp_path: Path) -> None:
    """As easySSP writes it: version 2.0, the model under test a system of its own, FMUs asked for as model exchange."""
    flat = toys.ssp({"w": "wave", "g": "gain", "l": "lag"}, ["w.y -> g.u", "g.y -> l.u", "l.y -> out"])
    with zipfile.ZipFile(flat) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    root = etree.fromstring(entries["SystemStructure.ssd"])
    ssd = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
    root.set("version", "2.0")
    system = root.find(f"{ssd}System")
    elements, wires = system.find(f"{ssd}Elements"), system.find(f"{ssd}Connections")
    inner = etree.SubElement(elements, f"{ssd}System", name="plant")
    ports = etree.SubElement(inner, f"{ssd}Connectors")
    for name, kind in (("in", "input"), ("out", "output")):
        etree.SubElement(ports, f"{ssd}Connector", name=name, kind=kind)
    inner.append(
        etree.fromstring(binding(ssv({"g.k": 7.0})).replace("<ssd:ParameterBindings", WITH_NAMESPACES))
    )
    parts = etree.SubElement(inner, f"{ssd}Elements")
    for component in elements.findall(f"{ssd}Component"):
        if component.get("name") != "w":
            component.set("implementation", "ModelExchange")
            parts.append(component)
    own = etree.SubElement(inner, f"{ssd}Connections")
    for wire in list(wires):
        wires.remove(wire)

    def join(parent: Any, *ends: str) -> None:
        one = etree.SubElement(parent, f"{ssd}Connection")
        for side, end in zip(("start", "end"), ends, strict=True):
            element, _, port = end.rpartition(".")
            if element:
                one.set(f"{side}Element", element)
            one.set(f"{side}Connector", port)

    join(own, "in", "g.u")
    join(own, "in", "l.u")
    join(own, "g.y", "out")
    join(wires, "w.y", "plant.in")
    join(wires, "plant.out", "out")
    entries["SystemStructure.ssd"] = etree.tostring(root)
    nested = tmp_path / "nested.ssp"
    with zipfile.ZipFile(nested, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    with read_ssp(nested) as found:
        assert list(found.components) == ["w", "plant_g", "plant_l"]
        assert sorted(str(w) for w in found.wires) == ["w.y -> plant_g.u", "w.y -> plant_l.u"]
        assert found.outputs == {"out": Port("plant_g", "y")}
        assert found.components["plant_g"].starts["k"] == 7.0
        assert sum("model exchange is asked for" in note for note in found.notes) == 2


def test_a_value_for_nothing_is_noted_with_the_closest_name(toys: Any) -> None:
    inside = {"g": binding(ssv({"lable": 'String value="x"'}))}
    with read_ssp(toys.ssp(PAIR, ["w.y -> g.u"], inside=inside)) as system:
        assert len(system.notes) == 1
        assert "'lable' of the parameter set 'nominal' matches nothing in component 'g'" in system.notes[0]
        assert "closest: 'label'" in system.notes[0]


def test_system_inputs_and_parameters_take_values_by_their_names(toys: Any) -> None:
    path = toys.ssp(
        {"g": "gain", "h": "gain"},
        ["level -> g.u", "level -> h.u", "factor -> g.k"],
        kinds={"factor": "parameter", "g.k": "parameter"},
        system_bindings=binding(ssv({"level": 2.0, "factor": 10.0})),
    )
    with Runner(path) as runner:
        result = runner.run(1.0, 0.5)
        assert (result["g.y"][-1], result["h.y"][-1]) == (20.0, 4.0)
        result = runner.run(1.0, 0.5, parameters={"factor": 3.0, "level": 1.0})
        assert (result["g.y"][-1], result["h.y"][-1]) == (3.0, 2.0)


BAD_SYSTEMS: list[tuple[dict[str, str], list[str], dict[str, Any], str]] = [
    (PAIR, ["w.y -> g.v"], {}, r"connector g\.v: resources/gain\.fmu has no such variable"),
    (PAIR, ["w.y -> h.u"], {}, "there is no component 'h'"),
    ({**PAIR, "v": "wave"}, ["w.y -> g.u", "v.y -> g.u"], {}, r"input g\.u has two sources, w\.y and v\.y"),
    (PAIR, ["w.y -> g.u", "in -> g.u"], {}, r"two sources, w\.y and system input 'in'"),
    (PAIR, ["w.y -> g.y"], {}, "joins kinds output and output"),
    (PAIR, ["w.y -> g.u"], {"kinds": {"g.u": "output"}}, "is of kind output, but the FMU's variable is a input"),
    (PAIR, ["w.y -> g.u"], {"units": {"g.u": "mm"}}, r"connector g\.u is in 'mm', but its variable in 'm'"),
    (PAIR, ["in -> g.u"], {"units": {"in": "mm"}}, "units 'mm' and 'm' differ"),
    (PAIR, ["w.y -> g.u", "g.y -> out", "w.y -> out"], {}, "two sources"),
    ({"a.b": "gain"}, [], {}, "a dot in the name"),
    (
        PAIR, ["w.y -> g.u"],
        {"connection_extra": {"w.y -> g.u": "<ssc:BooleanMappingTransformation><ssc:MapEntry source='true' target='false'/>"
                                            "</ssc:BooleanMappingTransformation>"}},
        "BooleanMappingTransformation is not supported",
    ),
    (
        PAIR, ["w.y -> g.u"],
        {"inside": {"g": "<ssd:ParameterBindings><ssd:ParameterBinding source='g.ssv'>"
                         "<ssd:ParameterMapping source='g.ssm'/></ssd:ParameterBinding></ssd:ParameterBindings>"}},
        "no entry 'g",
    ),
    (
        PAIR, ["w.y -> g.u"],
        {"inside": {"g": "<ssd:ParameterBindings><ssd:ParameterBinding source='https://x.example/g.ssv'/></ssd:ParameterBindings>"}},
        "not inside the archive",
    ),
    (PAIR, [], {"inside": {"g": binding(ssv({"y": 1.0}))}}, "'y' is a continuous output and cannot be given"),
    (PAIR, [], {"inside": {"g": binding(ssv({"n": 1.5}))}}, "'n' is of type Integer, but 1.5 is of type Real"),
]  # fmt: skip


@pytest.mark.parametrize(("components", "wires", "options", "message"), BAD_SYSTEMS)
def test_bad_systems_are_refused_by_name(
    toys: Any, components: Any, wires: Any, options: Any, message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        read_ssp(toys.ssp(components, wires, **options))


def test_all_problems_are_named_at_once(toys: Any) -> None:
    with pytest.raises(ModelError, match=r"(?s)h.*nosuch"):
        read_ssp(toys.ssp(PAIR, ["w.y -> h.u", "w.nosuch -> g.u"]))


def test_units_that_differ_in_name_only_agree_others_do_not(toys: Any) -> None:
    # lag and gain declare m; wave declares no unit, which agrees with all
    with read_ssp(
        toys.ssp({"g": "gain", "l": "lag"}, ["g.y -> l.u"], units={"g.y": "m", "l.u": "m"})
    ) as system:
        assert len(system.wires) == 1


def test_where_an_fmu_states_no_unit_that_of_the_connector_counts(toys: Any) -> None:
    units = {"w.y": "m", "result": "m", "k.y": "1"}
    with read_ssp(toys.ssp({**PAIR, "k": "wave"}, ["w.y -> g.u", "g.y -> result"], units=units)) as system:
        assert system.variable(Port("w", "y")).unit == "m"
        assert system.components["w"].fmu.units["m"].factor == 1.0
        # what exporters write where they know of none
        assert system.variable(Port("k", "y")).unit == ""
    # of the system's own connector
    with read_ssp(toys.ssp({"k": "wave"}, ["k.y -> result"], units={"result": "mm"})) as system:
        assert system.variable(Port("k", "y")).unit == "mm"
    with pytest.raises(ModelError, match="make them equal"):
        read_ssp(toys.ssp(PAIR, ["w.y -> g.u"], units={"w.y": "mm"}))


def edited(toys: Any, old: str, new: str, tmp_path: Path) -> Path:
    text = toy_fmus.ssd(PAIR, ["w.y -> g.u"])
    assert old in text
    fmus = {kind: toys.fmu(kind) for kind in ("wave", "gain")}
    return toy_fmus.pack(tmp_path / "edited.ssp", text.replace(old, new), fmus)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="g" ', 'name="w" ', "two components are named 'w'"),
        ("<ssd:Elements>", "<ssd:Elements><ssd:Other name='inner'/>", "'inner' is a Other; only systems of FMUs"),
        ("resources/gain.fmu'", "resources/gain.fmu' type='application/x-ssp-package'", "only FMUs and systems"),
        ("resources/gain.fmu'", "resources/lost.fmu'", r"no entry 'resources/lost\.fmu'"),
        ("resources/gain.fmu'", "../gain.fmu'", "points outside the archive"),
        ("resources/gain.fmu'", "file:///etc/gain.fmu'", "not inside the archive"),
        ('version="1.0" name', 'version="3.0" name', "version '3.0' is not supported"),
        ("SystemStructureDescription\"", "SomethingElse\"", "no SSP 1.0 system"),
        ("<ssd:Elements>", "<ssd:Elements", "not well-formed"),
    ],
)  # fmt: skip
def test_bad_descriptions_are_refused(toys: Any, tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        read_ssp(edited(toys, old, new, tmp_path))


def test_another_name_of_a_fed_input_is_not_open(toys: Any, tmp_path: Path) -> None:
    """FMI 3.0 lists other names of a variable, FMI 2.0 gives them its reference: what feeds one feeds all."""

    def change(text: str) -> str:
        other = '<ScalarVariable name="other" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>'
        return text.replace("</ModelVariables>", f"{other}</ModelVariables>")

    platform = Path(pythonfmu.__file__).parent / "resources" / "binaries" / fmpy.platform
    plain = bad_fmus.pack(tmp_path / "bad.fmu", next(platform.iterdir()).read_bytes(), change)
    text = toy_fmus.ssd({"w": "wave", "b": "bad"}, ["w.y -> b.u"])
    path = toy_fmus.pack(tmp_path / "names.ssp", text, {"wave": toys.fmu("wave"), "bad": plain})
    with read_ssp(path) as system:
        assert not [note for note in system.notes if "not connected" in note]
        group: Any = SimpleNamespace(
            components=["b"], drives=[SimpleNamespace(port=Port("b", "u"))], inner=[]
        )
        assert unmeasured(system, group) == {}
        group.drives = []
        assert set(unmeasured(system, group)) == {"b.u", "b.other"}


def test_a_prefix_that_nobody_declared_stops_nobody_and_is_invalid(toys: Any, tmp_path: Path) -> None:
    """Packages of the Open Simulation Platform hold annotations of its own so; what it says is not for us."""
    extra = "<ssd:Annotations><ssc:Annotation type='x'><osp:Algorithm osp:a='1'/></ssc:Annotation></ssd:Annotations>"
    path = edited(toys, "</ssd:System>", f"</ssd:System>{extra}", tmp_path)
    with read_ssp(path) as system:
        assert list(system.components) == ["w", "g"]
    texts = [p.text for p in check_ssp(path) if p.severity == "error"]
    assert sum("the prefix 'osp' is not declared: add xmlns:osp" in text for text in texts) == 1


def test_a_value_for_a_connector_that_leads_nowhere_is_said_to_be_so(toys: Any) -> None:
    bound = binding(ssv({"level": 1.0}))
    path = toys.ssp(PAIR, ["w.y -> g.u", "level -> g.u"], system_bindings=bound)
    with zipfile.ZipFile(path) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    text = entries["SystemStructure.ssd"].decode()
    loose = text.replace(
        '<ssd:Connection startConnector="level" endElement="g" endConnector="u"></ssd:Connection>', ""
    )
    assert loose != text
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in {**entries, "SystemStructure.ssd": loose.encode()}.items():
            archive.writestr(name, data)
    with read_ssp(path) as system:
        (note,) = (n for n in system.notes if "'level'" in n)
        assert "leads to no component" in note
        assert "closest" not in note


def test_a_parameter_set_of_another_namespace_is_refused_with_the_right_one(tmp_path: Path) -> None:
    file = tmp_path / "a.ssv"
    other = ssv({"a": 1.0}).replace("/SSP1/SystemStructureParameterValues", "/SSP1/ParameterValues")
    file.write_text(other, encoding="utf-8")
    with pytest.raises(
        ModelError, match=r"and not \{.*/SystemStructureParameterValues\}ParameterSet: correct"
    ):
        read_ssv(file)


def test_two_modules_of_one_name_and_other_content_in_one_system_are_refused(
    toys: Any, build_toy: Any, tmp_path: Path
) -> None:
    other = build_toy("affine", tmp_path, name="toy_gain")
    description = toy_fmus.ssd({"g": "gain", "o": "affine"}, ["g.y -> o.u"])
    path = toy_fmus.pack(tmp_path / "clash.ssp", description, {"gain": toys.fmu("gain"), "affine": other})
    with pytest.raises(ModelError, match="both bring a Python module 'toy_gain'"):
        read_ssp(path)


def test_ssv_files_are_read_with_units(tmp_path: Path) -> None:
    file = tmp_path / "a.ssv"
    file.write_text(ssv({"m.J": 900.0, "n": 'Integer value="3"'}, unit={"m.J": "kg.m2"}), encoding="utf-8")
    values = {v.name: (v.value, v.unit) for v in read_ssv(file)}
    assert values == {"m.J": (900.0, "kg.m2"), "n": (3, "")}
    with pytest.raises(ModelError, match="cannot be read"):
        read_ssv(tmp_path / "lost.ssv")
    file.write_text(ssv({"a": 1.0}) + "<", encoding="utf-8")
    with pytest.raises(ModelError, match="not well-formed"):
        read_ssv(file)


def test_an_fmu_alone_is_a_system_and_other_files_are_not(toys: Any, tmp_path: Path) -> None:
    with read_system(toys.fmu("gain")) as system:
        assert list(system.inputs) == ["u"]
        assert system.outputs == {"y": Port("gain", "y")}
    with pytest.raises(UsageError, match=r"neither an \.ssp nor an \.fmu"):
        read_system(tmp_path / "x.zip")


def test_what_dymola_declares_beside_an_fmu_s_own_connectors_stops_nobody(toys: Any) -> None:
    """Its settings are connectors that no FMU has, and a quantity's type is its Modelica name."""
    flat = toys.ssp(PAIR, ["w.y -> g.u"])
    with zipfile.ZipFile(flat) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    text = entries["SystemStructure.ssd"].decode()
    extra = (
        '<ssd:Connector kind="parameter" name="fmi_StartTime"><ssc:Real/></ssd:Connector>'
        '<ssd:Connector kind="parameter" name="k"><ssc:Binary mime-type="text/x-modelica; path=Modelica.Units.SI.Time"/>'
        "</ssd:Connector></ssd:Connectors>"
    )
    assert text.count("</ssd:Connectors>") == 2
    first, second, rest = text.split("</ssd:Connectors>")
    changed = flat.with_name("dymola.ssp")
    with zipfile.ZipFile(changed, "w") as archive:
        for name, data in entries.items():
            if name == "SystemStructure.ssd":
                data = f"{first}</ssd:Connectors>{second}{extra}{rest}".encode()
            archive.writestr(name, data)
    with read_ssp(changed) as system:
        assert [str(w) for w in system.wires] == ["w.y -> g.u"]
        (note,) = system.notes
    assert "connector g.fmi_StartTime: resources/gain.fmu has no such variable" in note
    assert "nothing is connected to it" in note
