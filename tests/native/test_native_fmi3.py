"""FMUs of FMI 3.0: the numbers, dependencies and refusals of their twins of FMI 2.0, and what only 3.0 has."""

import ctypes
import json
import math
import shutil
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmi3_raw import FUNCTIONS, Instance3
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from fmu_raw import ERROR, OK, STIMULUS, Instance
from lxml import etree
from test_native_compilers import COMPILERS, compiled
from test_native_exchange import ACTING, RIGHT_HAND_SIDES, Exchanged
from typer.testing import CliRunner

from benchmarks.interoperability import Trials
from cosim.anysystem.command import unlisted
from cosim.cli import make_app
from cosim.errors import ModelError, SimulationError, UsageError
from cosim.export import prepare, write_modelica, write_simulink
from cosim.master import Runner
from cosim.native.build import build_native, write_fmu
from cosim.native.container import container
from cosim.native.exchange import EXCHANGE
from cosim.native.package import swapped, write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.stimulus import default_command, stimulus_csv
from fmus import registry
from fmus.build import composed_block

SCHEMAS = Path(fmpy.__file__).parent / "schema" / "fmi3"


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """Every block, and the chain of the full-order model, as .fmu of FMI 3.0 by name."""
    folder = tmp_path_factory.mktemp("fmi3")
    played = {"stimulus": {"stimulus.csv": STIMULUS}}
    blocks = {
        name: build_native(
            composed_block(name), folder / f"{name}.fmu", resources=played.get(name), fmi="3.0"
        )
        for name in registry.BLOCKS
    }
    chain = container(ssp_folder() / "full_order.ssd")
    return blocks | {"full_order": write_fmu(chain, folder / "full_order.fmu", fmi="3.0")}


@pytest.fixture(scope="module")
def folders(files, tmp_path_factory) -> dict[str, Path]:
    """The same, unpacked into folders with signs that a URI would encode."""
    top = tmp_path_factory.mktemp("a %20 b")
    return {name: Path(extract(str(file), str(top / name))) for name, file in files.items()}


@pytest.fixture
def mechanical(folders) -> Instance3:
    """An instance of the mechanics."""
    return Instance3(folders["mechanical"], "m")


@pytest.mark.parametrize("which", [*registry.BLOCKS, "full_order"])
def test_the_numbers_are_those_of_fmi_2_bit_for_bit(folders, unpacked, chains, tmp_path, which) -> None:
    """With an effect of each component on, and steps of two sizes."""
    old = unpacked.get(which) or Path(extract(str(chains[which]), str(tmp_path / "old")))
    one, other = Instance(old), Instance3(folders[which])
    assert one.inputs == other.inputs
    assert one.outputs == other.outputs
    known = {
        f"{e.component}.{n}": f.starts[0] for e in registry.effects().values() for n, f in e.free.items()
    }
    known |= {n: v for k, v in known.items() if (n := k.removeprefix(f"{which}.")) != k}
    values = {n: v for n, v in known.items() if n in one.vr}
    assert bool(values) == any(
        e.component in (which, *(c.partition(".")[0] for c in one.vr)) for e in registry.effects().values()
    )
    one.initialise(0.25, **values)
    other.initialise(0.25, **values)
    assert one.get(*one.outputs) == other.get(*one.outputs)
    size = 50.0 if which == "mechanical" else 2.0  # against dry friction
    sizes = [size * v.nominal for v in composed_block(which).inputs.values()] if which in unpacked else [0.9]
    rows = np.random.default_rng(5).normal(size=(300, len(sizes))) * sizes
    rows = np.clip(rows, -1.0, 1.0) if which == "full_order" else rows
    found = [one.play(rows[:200].tolist()), other.play(rows[:200].tolist())]
    assert found[0] == found[1]
    assert np.ptp(np.array(found[0]), axis=0).max() > 0.0
    assert one.play(rows[200:].tolist(), 2.5e-3, 80) == other.play(rows[200:].tolist(), 2.5e-3, 80)
    assert other.get("time") == [pytest.approx(0.45, rel=1e-12)]
    one.close()
    other.fmu.freeInstance()


def named(folder: Path, section: str) -> dict[str, set[str]]:
    """Unknowns of a section of ModelStructure and what they depend on, by name."""
    description = read_model_description(str(folder))
    return {u.variable.name: {v.name for v in u.dependencies} for u in getattr(description, section)}


@pytest.mark.parametrize("which", registry.BLOCKS)
def test_the_description_says_what_that_of_fmi_2_says(folders, unpacked, which) -> None:
    old, new = (read_model_description(str(f[which])) for f in (unpacked, folders))
    same = ("name", "valueReference", "causality", "variability", "initial", "unit", "displayUnit", "min", "max",
            "nominal", "start", "description")  # fmt: skip
    clock, *variables = new.modelVariables
    # FMI 2.0 counts event indicators without names
    variables = [v for v in variables if not v.name.startswith("event.")]
    assert [[getattr(v, n) for n in same] for v in variables] == [
        [getattr(v, n) for n in same] for v in old.modelVariables
    ]
    assert {v.type for v in old.modelVariables if v.name == "form"} <= {"Integer"}
    assert {v.type for v in variables} <= {"Float64", "Int32"}
    assert (clock.name, clock.causality, clock.unit) == ("time", "independent", "s")
    assert [v.derivative and v.derivative.name for v in variables] == [
        v.derivative and v.derivative.name for v in old.modelVariables
    ]
    for section in ("outputs", "derivatives", "initialUnknowns"):
        expected = named(unpacked[which], section)
        if which in ("stimulus", "reference") and section != "derivatives":
            expected = {n: k | {"time"} if n in ("u", "automatic") else k for n, k in expected.items()}
        assert named(folders[which], section) == expected
    assert old.modelExchange.providesDirectionalDerivative == (which in EXCHANGE)
    assert new.modelExchange.modelIdentifier == which


@pytest.mark.parametrize("which", [*registry.BLOCKS, "full_order"])
def test_validators_are_silent(files, folders, which) -> None:
    assert validate_fmu(str(files[which])) == []
    for file, schema in (
        ("modelDescription.xml", "fmi3ModelDescription.xsd"),
        ("sources/buildDescription.xml", "fmi3BuildDescription.xsd"),
        ("terminalsAndIcons/terminalsAndIcons.xml", "fmi3TerminalsAndIcons.xsd"),
    ):
        etree.XMLSchema(file=SCHEMAS / schema).assertValid(etree.parse(folders[which] / file))
    drawn = etree.parse(folders[which] / "terminalsAndIcons/terminalsAndIcons.xml").find("*/Icon") is not None
    assert drawn == (folders[which] / "terminalsAndIcons/icon.png").is_file() == (which != "full_order")


def test_every_function_of_the_standard_is_exported(folders) -> None:
    assert len(FUNCTIONS) == 75
    for which in ("mechanical", "observer"):
        library = Instance3(folders[which]).fmu.dll
        for name in FUNCTIONS:
            assert getattr(library, name)


def test_sources_have_nothing_of_the_other_version(files, fmu_files) -> None:
    for archive, other in ((files["dcv"], "fmi2"), (fmu_files["dcv"], "fmi3")):
        with zipfile.ZipFile(archive) as opened:
            assert not [n for n in opened.namelist() if n.startswith(f"sources/{other}")]


@pytest.mark.parametrize("compiler", COMPILERS)
def test_every_source_compiles(folders, compiler, tmp_path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    for which in ("mechanical", "stimulus", "full_order"):
        quick = (
            ("-c", "fmu.c", "-o", str(tmp_path / "o")) if compiler == "tcc" else ("-fsyntax-only", "fmu.c")
        )
        compiled(COMPILERS[compiler], folders[which], *quick)


# States


def test_a_state_is_got_set_and_serialised(folders) -> None:
    rows = [[math.sin(0.1 * k)] for k in range(60)]
    one, other = (Instance3(folders["dcv"], n).initialise(tau_d=0.0153) for n in "ab")
    one.play(rows[:30])
    data, state = one.state_bytes(), one.fmu.getFMUState()
    expected = one.play(rows[30:], first=30)
    one.fmu.setFMUState(state)
    assert one.get("time") == [pytest.approx(0.03)]
    assert one.play(rows[30:], first=30) == expected
    other.restore_bytes(data)
    assert other.play(rows[30:], first=30) == expected
    one.fmu.freeFMUState(state)


def test_a_state_of_fmi_2_is_refused(folders, unpacked) -> None:
    slave = Instance3(folders["dcv"], "s").initialise()
    assert slave.status(slave.restore_bytes, Instance(unpacked["dcv"]).initialise().state_bytes()) == ERROR
    assert "it was not saved by dcv {" in slave.messages[0]


# Refusals


def test_a_refused_value_stops_steps_until_a_reset(mechanical) -> None:
    mechanical.initialise()
    assert mechanical.status(mechanical.fmu.setFloat64, [mechanical.vr["p_load"]], [math.nan]) == ERROR
    assert mechanical.messages[0].startswith("m: p_load = nan is refused: it must be a number from")
    assert mechanical.status(mechanical.fmu.doStep, 0.0, 1e-3) == ERROR
    mechanical.fmu.reset()
    mechanical.initialise()
    assert mechanical.status(mechanical.fmu.doStep, 0.0, 1e-3) == OK


@pytest.mark.parametrize(
    ("call", "arguments", "text"),
    [
        ("getFloat64", ([999],), "there is no variable with value reference 999"),
        ("setFloat64", ([999], [0.0]), "there is no variable with value reference 999"),
        ("getInt32", ([0],), "p_load is a Float64, not an Int32"),
        ("getFloat64", ([0], 2), "1 variables and 2 values: every variable has one"),
        ("setFloat64", ([1], [0.0]), "theta is an output and cannot be set"),
        ("setFloat64", ([36], [0.0]), "the variable with value reference 36 is calculated and cannot be set"),
        ("getFloat32", ([0],), "there is no Float32 variable"),
        ("setUInt64", ([0], [1]), "there is no UInt64 variable"),
        ("getBinary", ([0],), "there is no Binary variable"),
        ("getClock", ([0],), "there is no Clock variable"),
        ("enterConfigurationMode", (), "there is no structural parameter"),
        ("enterEventMode", (), "fmi3EnterEventMode is for model exchange, after initialisation"),
        ("enterStepMode", (), "there is no event mode in co-simulation"),
        ("getOutputDerivatives", ([1], [1]), "derivatives of outputs are not provided"),
        ("updateDiscreteStates", (), "fmi3UpdateDiscreteStates is for model exchange, after initialisation"),
        ("getDirectionalDerivative", ([1], [0], [1.0]), "fmi3GetDirectionalDerivative is for model exchange"),
        ("doStep", (0.0, -1e-3), "step size -0.001 s is refused"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_refused_in_words(mechanical, call, arguments, text) -> None:
    mechanical.initialise()
    assert mechanical.vr["time"] == 36
    assert mechanical.status(getattr(mechanical.fmu, call), *arguments) == ERROR
    assert len(mechanical.messages) == 1
    assert text in mechanical.messages[0]


def test_dependencies_of_elements_are_refused(mechanical) -> None:
    count = ctypes.c_size_t(7)
    call = (
        mechanical.fmu.fmi3GetNumberOfVariableDependencies
    )  # fmpy's own wrapper passes a type in place of a number
    assert mechanical.status(call, mechanical.fmu.component, 1, ctypes.byref(count)) == ERROR
    assert mechanical.messages == [
        "m: dependencies of elements are not provided: ModelStructure lists all there are"
    ]
    assert count.value == 0


def test_an_integer_has_calls_of_its_own(folders) -> None:
    slave = Instance3(folders["dead_zone"], "z")
    form = [slave.vr["form"]]
    slave.fmu.setInt32(form, [3])
    assert slave.fmu.getInt32(form) == [3]
    for call, arguments, text in (
        (slave.fmu.getFloat64, (form,), "form is an Int32 and cannot be got with fmi3GetFloat64"),
        (slave.fmu.setFloat64, (form, [2.0]), "form is an Int32 and cannot be set with fmi3SetFloat64"),
        (slave.fmu.setInt32, (form, [7]), "form = 7.0 is refused"),
    ):
        assert slave.status(call, *arguments) == ERROR
        assert text in slave.messages[-1]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"token": "{wrong}"}, "x: the instantiation token {wrong} is refused: this is observer {"),
        ({"events": True}, "x: observer has no event mode"),
        ({"required": [0]}, "x: observer has no intermediate update"),
    ],
)
def test_what_it_cannot_be_is_refused_at_once(folders, change, text) -> None:
    slave = Instance3(folders["observer"], "x")
    kind = fmpy.fmi3.FMU3Model if change.get("exchange") else fmpy.fmi3.FMU3Slave
    other = kind(
        guid=change.get("token", slave.description.guid), unzipDirectory=str(folders["observer"]),
        modelIdentifier="observer", instanceName="x",
    )  # fmt: skip
    options = {} if change.get("exchange") else {
        "eventModeUsed": "events" in change, "requiredIntermediateVariables": change.get("required"),
    }  # fmt: skip
    with pytest.raises(Exception, match="instantiate"):
        other.instantiate(logMessage=slave.log, **options)
    assert slave.messages[0].startswith(text)


# Model exchange


class Exchanged3(Instance3):
    """A block in continuous-time mode."""

    def __init__(self, folder: Path, block: str, **values: float) -> None:
        super().__init__(folder, block, exchange=True)
        self.n = self.fmu.getNumberOfContinuousStates()
        self.initialise(**values)
        assert self.fmu.updateDiscreteStates()[:4] == (False,) * 4
        self.fmu.enterContinuousTimeMode()

    def rates(self, *states: float) -> list[float]:
        """Derivatives at these states."""
        given, found = (ctypes.c_double * self.n)(*states), (ctypes.c_double * self.n)()
        self.fmu.setContinuousStates(given, self.n)
        self.fmu.getContinuousStateDerivatives(found, self.n)
        return list(found)


@pytest.mark.parametrize("block", RIGHT_HAND_SIDES)
def test_derivatives_of_all_kinds_are_those_of_fmi_2(folders, unpacked, block) -> None:
    """The adjoint is the transposed matrix of the directional ones, whose columns FMI 2.0 gives too."""
    _, states, inputs, _ = RIGHT_HAND_SIDES[block]
    one, other = (
        Exchanged(unpacked[block], block, **ACTING[block]),
        Exchanged3(folders[block], block, **ACTING[block]),
    )
    for slave in (one, other):
        slave.set(**dict(zip(registry.block(block).inputs, inputs, strict=True)))
    assert other.rates(*states) == one.rates(*states)
    knowns = [one.vr[n] for n in (*(f"x.{n}" for n in EXCHANGE[block].states), *registry.block(block).inputs)]
    unknowns = [
        one.vr[n] for n in (*registry.block(block).outputs, *(f"der(x.{n})" for n in EXCHANGE[block].states))
    ]
    matrix = np.array([one.fmu.getDirectionalDerivative(unknowns, [k], [1.0]) for k in knowns]).T
    assert np.count_nonzero(matrix) > 0
    columns = np.array([other.fmu.getDirectionalDerivative(unknowns, [k], [1.0]) for k in knowns]).T
    np.testing.assert_array_equal(columns, matrix)
    seed = np.random.default_rng(3).normal(size=len(unknowns))
    found = other.fmu.getAdjointDerivative(unknowns, knowns, list(seed), len(knowns))
    np.testing.assert_allclose(found, seed @ matrix, rtol=1e-13)


def test_what_has_no_derivative_is_refused(folders) -> None:
    slave = Exchanged3(folders["mechanical"], "m")
    theta, J = slave.vr["theta"], slave.vr["J"]
    with pytest.raises(FMICallException):
        slave.fmu.getAdjointDerivative([theta], [J], [1.0])
    assert slave.messages == [
        f"m: directional derivatives are by inputs and states, and number {J} is neither"
    ]


@pytest.mark.parametrize("block", EXCHANGE)
def test_fmpy_integrates_both_versions_alike(files, fmu_files, block) -> None:
    found = [
        simulate_fmu(str(f[block]), fmi_type="ModelExchange", stop_time=0.2, output_interval=0.01, relative_tolerance=1e-6)
        for f in (fmu_files, files)
    ]  # fmt: skip
    assert len(found[0]) == 21
    for name in found[0].dtype.names:
        np.testing.assert_array_equal(found[1][name], found[0][name])


def test_states_and_derivatives_are_there_during_initialisation(folders) -> None:
    slave = Instance3(folders["mechanical"], "m", exchange=True)
    slave.set(theta_0=0.3, omega_0=0.02, p_load=1e5)
    slave.fmu.enterInitializationMode()
    found = (ctypes.c_double * 2)()
    slave.fmu.getContinuousStates(found, 2)
    assert list(found) == [0.3, 0.02]
    slave.fmu.getContinuousStateDerivatives(found, 2)
    assert found[0] == 0.02
    assert found[1] == slave.get("der(x.omega)")[0] != 0.0


# In this project


def test_a_package_of_them_runs_as_one_of_fmi_2(tmp_path) -> None:
    """The position loop has all blocks but two, and a wire that closes it."""
    wiring, played = ssp_folder() / "position_loop.ssd", stimulus_csv(*default_command(3.0))
    values = {"mechanical.tau_c": 30.0, "sensor.p_drop": 0.2, "sensor.tau_l": 0.02}
    found = []
    for version in ("2.0", "3.0"):
        package = write_native_ssp(wiring, tmp_path / f"{version}.ssp", stimulus=played, fmi=version)
        with Runner(package) as runner:
            assert {c.fmu.version for c in runner.system.components.values()} == {version}
            assert not runner.system.notes
            assert not unlisted(runner.system)
            found += [
                runner.run(1.0, 1e-3, parameters=values, engine=engine) for engine in ("compiled", "python")
            ]
    for other in found[1:]:
        assert list(other.signals) == list(found[0].signals)
        for name, numbers in other.signals.items():
            np.testing.assert_array_equal(numbers, found[0].signals[name])
    assert all(
        np.ptp(numbers) > 0.0 for name, numbers in found[0].signals.items() if name.endswith((".theta", ".u"))
    )


def test_a_refusal_within_a_package_names_the_call_of_its_version(files) -> None:
    with Runner(files["dcv"]) as runner, pytest.raises(SimulationError) as caught:
        runner.run(
            0.1,
            1e-3,
            inputs={"demand": (np.array([0.0, 0.05, 1.0]), np.array([0.0, 5e9, 0.0]))},
            hold=["demand"],
        )
    assert (
        "failed in fmi3SetFloat64 at t = 0.05 s (status Error): dcv: demand = 5000000000.0 is refused"
        in str(caught.value)
    )


def test_commands_take_them(files, chains, tmp_path) -> None:
    app, run = make_app(), CliRunner()
    log = tmp_path / "log.csv"
    assert (
        run.invoke(app, ["rig", "--excitation", "sweep", "--duration", "5 s", "--out", str(log)]).exit_code
        == 0
    )
    tables, reports = [], []
    for fmu in (files["full_order"], chains["full_order"]):
        model = tmp_path / fmu.parent.name / "crane.fmu"
        model.parent.mkdir()
        shutil.copy(fmu, model)
        out = model.parent / "out.csv"
        command = [
            "simulate",
            str(model),
            "--input",
            str(log),
            "--set",
            "crane.mechanical.J=900 kg.m2",
            "--out",
            str(out),
        ]
        done = run.invoke(app, command)
        assert done.exit_code == 0, done.output
        tables.append(out.read_text())
        done = run.invoke(app, ["compare", str(log), "--model", str(model), "--json"])
        assert done.exit_code == 0, done.output
        reports.append(json.loads(done.stdout)["signals"])
        assert run.invoke(app, ["validate", str(model)]).exit_code == 0
    assert tables[0] == tables[1]
    assert reports[0] == reports[1] != {}


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--fmi", "3.0"], "--fmi 3.0 needs --native: the FMUs that run in Python are of FMI 2.0"),
        (["--native", "--fmi", "1.0"], "--fmi 1.0: FMUs of FMI 2.0 and 3.0 can be built"),
    ],
)
def test_versions_that_cannot_be_built(tmp_path, options, text) -> None:
    with pytest.raises(UsageError, match=text):
        CliRunner().invoke(
            make_app(),
            ["build", "--out", str(tmp_path), *options],
            catch_exceptions=False,
            standalone_mode=False,
        )


def test_what_takes_fmi_2_alone_says_so(files, tmp_path) -> None:
    with read_system(files["full_order"]) as system:
        for write in (write_modelica, write_simulink):
            with pytest.raises(
                ModelError, match=r"full_order\.fmu is of FMI 3\.0, and what is exported calls FMI 2\.0"
            ):
                write(prepare(system), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    package = write_native_ssp(ssp_folder() / "simplified.ssd", tmp_path / "s.ssp", open=True, fmi="3.0")
    with pytest.raises(
        ModelError, match=r"simplified\.fmu is of FMI 3\.0: values are put into FMUs of FMI 2\.0 alone"
    ):
        swapped(package, tmp_path / "t.ssp", {"simplified": {"a": 4.0}})


# In other hosts


@pytest.mark.clients
@pytest.mark.parametrize("client", ["ecos", "host"])
def test_other_hosts_run_a_package_of_them(client, tmp_path) -> None:
    """Ecos, which reads FMI 3.0 by fmi4c, and a host in C that knows nothing of us: each agrees with the equations."""
    wiring, played = ssp_folder() / "full_order.ssd", stimulus_csv(*default_command(3.0))
    package = write_native_ssp(wiring, tmp_path / "full_order.ssp", stimulus=played, fmi="3.0")
    trials = Trials({"native, FMI 3.0": {"full_order": package}}, tmp_path, 300)
    why = trials.unavailable(client)
    if why:
        pytest.skip(why)
    row = trials.row("native, FMI 3.0", client)
    assert (row.loads, row.runs, row.agrees, row.ends) == (True, True, True, True), row.reasons
