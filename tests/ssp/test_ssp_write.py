"""Packages as written: valid, wired completely, with FMUs whose start values are those of the .ssv."""

import io
import re
import zipfile
from pathlib import PurePosixPath

import pytest
from fmpy import read_model_description
from fmpy.ssp.ssd import read_ssd, read_ssv, validate_tree
from lxml import etree

from cosim.errors import DataError, ModelError, UsageError
from cosim.paths import ssp_folder
from cosim.ssp.build import CLOSED, LOOPS, SYSTEMS
from cosim.ssp.stimulus import default_command, stimulus_csv
from cosim.ssp.write import NAMESPACES, OUTPUTS, fmu_bytes, write_ssp
from fmus import registry
from fmus.build import composed_block

STIMULUS = stimulus_csv(*default_command(0.5))
COMPONENTS = {
    "full_order": [
        "stimulus",
        "compensator",
        "dead_zone",
        "dcv",
        "continuity",
        "mechanical",
        "sensor",
        "observer",
    ],
    "physical": [
        "stimulus",
        "compensator",
        "dead_zone",
        "dcv",
        "continuity",
        "mechanical",
        "sensor",
        "observer",
    ],
    "simplified": ["stimulus", "compensator", "dead_zone", "simplified", "sensor", "observer"],
}
COMPONENTS["full_order_extended"] = COMPONENTS["full_order"]
for loop in LOOPS:
    COMPONENTS[loop] = ["stimulus", "reference", "controller", *COMPONENTS["full_order"][1:]]
# where a component is meant to differ from the declarations of its block
ON_PURPOSE = {
    "nominal/compensator.ssv": {"form": 3.0, "limit": 2.0},
    "physical/mechanical.ssv": {"b": 33102.35190191385},
    "position_loop/controller.ssv": {"k_f": 0.0, "k_d": 0.0},
}
BLOCK_OF = {
    "nominal/compensator.ssv": "dead_zone",
    "physical/continuity.ssv": "continuity_physical",
    "extended/observer.ssv": "observer_extended",
}


EVERY = [(name, is_open) for name in SYSTEMS for is_open in (False, True)] + [
    (name, False) for name in CLOSED
]


@pytest.fixture(scope="module", params=EVERY, ids=[f"{n}-{'open' if o else 'closed'}" for n, o in EVERY])
def package(request, tmp_path_factory):
    name, is_open = request.param
    file = tmp_path_factory.mktemp("ssp") / (f"{name}_open.ssp" if is_open else f"{name}.ssp")
    return write_ssp(ssp_folder() / f"{name}.ssd", file, stimulus=None if is_open else STIMULUS, open=is_open)


def entry(package, name):
    with zipfile.ZipFile(package) as archive:
        return archive.read(name)


def wiring(package):
    return etree.fromstring(entry(package, "SystemStructure.ssd"))


def find(node, path):
    return node.findall(path, NAMESPACES)


def description_of(package, source, folder):
    folder.mkdir(exist_ok=True)
    file = folder / PurePosixPath(source).name
    file.write_bytes(entry(package, source))
    return {v.name: v for v in read_model_description(str(file)).modelVariables}


# The files in ssp/


@pytest.mark.parametrize(
    "file",
    # the source's own sets name a few parameters of several blocks: test_source_sets.py has them
    sorted(f for f in ssp_folder().glob("*/*.ssv") if f.parent.name != "source"),
    ids=lambda f: f"{f.parent.name}/{f.name}",
)
def test_nominal_values_are_the_declared_ones_but_for_those_on_purpose(file):
    name = f"{file.parent.name}/{file.name}"
    parameters = {p.name: p for p in read_ssv(str(file)).parameters}  # checks the schema too
    declared = registry.block(BLOCK_OF.get(name, file.stem)).parameters
    expected = {n: v.start for n, v in declared.items()} | ON_PURPOSE.get(name, {})
    assert {n: float(p.value) for n, p in parameters.items()} == expected
    for n, variable in declared.items():
        assert parameters[n].type == ("Integer" if variable.kind == "integer" else "Real")
        assert parameters[n].type == "Integer" or parameters[n].unit == variable.unit


@pytest.mark.parametrize("name", [*SYSTEMS, *CLOSED])
def test_wiring_as_committed_is_valid_and_complete(name):
    root = etree.parse(ssp_folder() / f"{name}.ssd").getroot()
    validate_tree(root, "SystemStructureDescription.xsd")
    assert root.get("version") == "1.0"
    assert [c.get("name") for c in find(root, ".//ssd:Component")] == COMPONENTS[name]
    for binding in find(root, ".//ssd:ParameterBinding"):
        assert (ssp_folder() / binding.get("source")).is_file()


# The packages


def test_package_is_valid_and_read_by_fmpy(package):
    description = read_ssd(str(package))  # checks the wiring and every .ssv against their schemas
    sets = {
        s.name for c in description.system.elements for b in c.parameterBindings for s in b.parameterValues
    }
    assert sets == {"nominal"}
    assert all(len(c.parameterBindings) == 1 for c in description.system.elements)


def test_every_input_has_one_source_of_the_same_unit(package):
    root = wiring(package)
    system = root.find("ssd:System", NAMESPACES)
    ends = {}
    for owner in [system, *find(root, ".//ssd:Component")]:
        name = owner.get("name") if owner is not system else None
        for connector in find(owner, "ssd:Connectors/ssd:Connector"):
            (kind,) = connector  # exactly one type child
            ends[name, connector.get("name")] = (connector.get("kind"), kind.get("unit"))
    sinks = []
    for wire in find(root, ".//ssd:Connection"):
        start = wire.get("startElement"), wire.get("startConnector")
        end = wire.get("endElement"), wire.get("endConnector")
        assert ends[start][1] == ends[end][1] is not None
        assert ends[start][0] == ("output" if start[0] else "input")
        assert ends[end][0] == ("input" if end[0] else "output")
        sinks.append(end)
    wanted = [end for end, (kind, _) in ends.items() if kind == ("input" if end[0] else "output")]
    assert sorted(sinks, key=str) == sorted(wanted, key=str)
    assert not find(root, ".//ssc:LinearTransformation")


def test_clients_that_look_for_literal_prefixes_find_them(package):
    for name in zipfile.ZipFile(package).namelist():
        if name.endswith((".ssd", ".ssv")):
            tags = re.findall(rb"<(?![?!/])([\w:]+)", entry(package, name))
            assert all(re.match(rb"(ssd|ssc|ssv|oms|osp):", tag) for tag in tags)


def test_fmus_have_the_connectors_units_and_start_values_of_the_package(package, tmp_path):
    for component in find(wiring(package), ".//ssd:Component"):
        variables = description_of(package, component.get("source"), tmp_path / component.get("name"))
        for connector in find(component, "ssd:Connectors/ssd:Connector"):
            variable = variables[connector.get("name")]
            assert (variable.causality, variable.unit) == (connector.get("kind"), connector[0].get("unit"))
        (binding,) = find(component, "ssd:ParameterBindings/ssd:ParameterBinding")
        bound = read_ssv(str(package), resource=binding.get("source")).parameters
        assert bound
        assert all(float(p.value) == float(variables[p.name].start) for p in bound)
        stem = PurePosixPath(component.get("source")).stem
        composed = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem)
        for name in composed.parameters.keys() - {p.name for p in bound}:  # those of effects: off
            assert float(variables[name].start) == composed.parameters[name].start


def test_every_component_says_that_it_is_an_fmu(package):
    # the standard's default, which OMSimulatorPython does not assume
    components = wiring(package).findall(".//ssd:Component", NAMESPACES)
    assert {c.get("type") for c in components} == {"application/x-fmu-sharedlibrary"}


def test_annotations_give_libcosim_and_omsimulator_the_step(package):
    root = wiring(package)
    assert [a.get("baseStepSize") for a in find(root, ".//osp:FixedStepAlgorithm")] == ["0.001"]
    assert [a.get("stepSize") for a in find(root, ".//oms:FixedStepMaster")] == ["0.001"]
    types = [a.get("type") for a in find(root, ".//ssc:Annotation")]
    assert types == ["org.openmodelica", "com.opensimulationplatform"]


def test_open_package_has_the_signals_of_a_log_and_closed_has_none(package):
    root = wiring(package)
    connectors = find(root, "ssd:System/ssd:Connectors/ssd:Connector")
    names = [c.get("name") for c in find(root, ".//ssd:Component")]
    if "_open" not in package.name:
        assert connectors == []
        assert root.find("ssd:DefaultExperiment", NAMESPACES).get("stopTime") == "0.5"
        return
    assert "stimulus" not in names
    assert [c.get("name") for c in connectors if c.get("kind") == "input"] == ["u"]
    outputs = {c.get("name") for c in connectors if c.get("kind") == "output"}
    assert outputs == {n for n, element in OUTPUTS.items() if element in names}
    assert {"slew", "slew_estimate", "slew_rate_estimate"} <= outputs
    driven = {w.get("endElement") for w in find(root, ".//ssd:Connection[@startConnector='u']")}
    assert driven == {"compensator", "observer"}


def test_the_same_package_has_the_same_bytes(tmp_path):
    written = []
    for k in range(2):
        fmu_bytes.cache_clear()
        file = write_ssp(ssp_folder() / "simplified.ssd", tmp_path / f"{k}.ssp", stimulus=STIMULUS)
        written.append(file.read_bytes())
    assert written[0] == written[1]


# Other values


def test_values_reach_binding_and_fmu_and_nothing_else(tmp_path):
    ssd = ssp_folder() / "full_order.ssd"
    nominal = write_ssp(ssd, tmp_path / "nominal.ssp", stimulus=STIMULUS)
    values = {"mechanical": {"J": 900.0, "tau_g": 150.0}, "compensator": {"form": 2}}
    changed = write_ssp(ssd, tmp_path / "changed.ssp", stimulus=STIMULUS, values=values)
    with zipfile.ZipFile(nominal) as old, zipfile.ZipFile(changed) as new:
        assert old.namelist() == new.namelist()
        different = {n for n in old.namelist() if old.read(n) != new.read(n)}
    assert different == {f"resources/{c}.{s}" for c in values for s in ("fmu", "ssv")}
    bound = {p.name: p for p in read_ssv(str(changed), resource="resources/mechanical.ssv").parameters}
    assert (bound["J"].value, bound["tau_g"].value, bound["tau_g"].unit) == ("900.0", "150.0", "N.m")
    assert float(bound["b"].value) == 26661.636066754313
    start = description_of(changed, "resources/mechanical.fmu", tmp_path / "fmu")["tau_g"].start
    assert float(start) == 150.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mechanics": {"J": 900.0}}, "no component 'mechanics'; did you mean mechanical"),
        ({"mechanical": {"j": 900.0}}, "mechanical has no 'j'"),
        ({"mechanical": {"J": -1.0}}, "mechanical.J = -1.0 kg.m2 is not within"),
        ({"mechanical": {"J": float("nan")}}, "mechanical.J = nan"),
    ],
)
def test_bad_values_are_refused_by_name(values, message, tmp_path):
    with pytest.raises(UsageError, match=re.escape(message)):
        write_ssp(ssp_folder() / "full_order.ssd", tmp_path / "x.ssp", stimulus=STIMULUS, values=values)
    assert not list(tmp_path.iterdir())


def test_closed_package_needs_a_stimulus(tmp_path):
    with pytest.raises(ModelError, match="needs a stimulus"):
        write_ssp(ssp_folder() / "simplified.ssd", tmp_path / "x.ssp")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</ssd:System>", "", "not well-formed"),
        (
            "resources/sensor.fmu",
            "resources/sensr.fmu",
            "component 'sensor' runs resources/sensr.fmu: no block 'sensr'",
        ),
        ('source="nominal/sensor.ssv"', "", "component 'sensor' binds no .ssv file"),
        ("nominal/sensor.ssv", "nominal/sensr.ssv", "there is no file"),
        ("resources/compensator.fmu", "resources/dead_zone.fmu", "two components with different values run"),
    ],
)
def test_bad_wiring_is_refused_by_name(old, new, message, tmp_path):
    for file in ssp_folder().glob("*/*.ssv"):
        copy = tmp_path / file.relative_to(ssp_folder())
        copy.parent.mkdir(exist_ok=True)
        copy.write_bytes(file.read_bytes())
    text = (ssp_folder() / "simplified.ssd").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "bad.ssd").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ModelError, match=re.escape(message)):
        write_ssp(tmp_path / "bad.ssd", tmp_path / "x.ssp", stimulus=STIMULUS)


def test_system_without_a_stimulus_cannot_be_opened(tmp_path):
    package = write_ssp(ssp_folder() / "simplified.ssd", tmp_path / "open.ssp", open=True)
    (tmp_path / "open.ssd").write_bytes(entry(package, "SystemStructure.ssd"))
    with pytest.raises(ModelError, match="no component 'stimulus'"):
        write_ssp(tmp_path / "open.ssd", tmp_path / "x.ssp", open=True)


def test_bad_stimulus_is_refused_with_its_row(tmp_path):
    with pytest.raises(DataError, match="row 3"):
        write_ssp(ssp_folder() / "simplified.ssd", tmp_path / "x.ssp", stimulus=b"t,u\n0,0\n0.1,nan\n")


def test_stimulus_fmu_holds_the_given_command():
    with zipfile.ZipFile(io.BytesIO(fmu_bytes("stimulus", (), STIMULUS))) as fmu:
        assert fmu.read("resources/stimulus.csv") == STIMULUS
