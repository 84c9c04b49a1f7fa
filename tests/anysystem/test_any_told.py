"""What an answer tells of a cause, and what a mapping is proposed: only what the log or the FMU says."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.systems import parts
from cosim.anysystem.actions import Action
from cosim.anysystem.answer import numbers, stale_in
from cosim.anysystem.read import read
from cosim.anysystem.readings import Stale, stale_of
from cosim.anysystem.search.rivals import Rivals
from cosim.anysystem.start import began, beginnings_of, of_file
from cosim.errors import DataError
from cosim.inference.problem import Fit
from cosim.inference.unknowns import Unknown
from cosim.logs.overview import overview
from cosim.ssp.read import read_system
from cosim.ssp.system import Port


@pytest.mark.parametrize(("spread", "told"), [(1e-4, {"low", "high"}), (0.0, {"low"})])
def test_a_limit_that_no_sample_comes_to_is_not_told(spread, told):
    """The end of an arm's travel came with another one of "-30.65 deg, -30.65 to -30.65", which the log never met."""
    action = Action("port.saturation", Port("arm", "angle"), "output")
    unknowns = tuple(Unknown(action.key(n), -200.0, 10.0, 1.0) for n in ("low", "high"))
    values = {action.key("low"): -155.8, action.key("high"): -30.65}
    fit = Fit(values, np.diag([1.5, spread]), unknowns, np.zeros(1), 0.0)
    variable = SimpleNamespace(unit="deg")
    found = SimpleNamespace(logs=[], findings={}, system=SimpleNamespace(variable=lambda port: variable))
    finding = SimpleNamespace(read={}, between={}, chosen=SimpleNamespace(fit=fit))
    assert numbers(found, finding, action).keys() == told


def test_stale_samples_of_one_log_are_told_of_that_log():
    """A quarter of the samples of one log repeated themselves, none of the other: it was said of both."""
    action = Action("port.dropout", Port("boom", "angle"), "sensor")
    even, stale = np.arange(6), np.array([0, 1, 1, 3, 3, 5])
    logs = [SimpleNamespace(source=Path(name)) for name in ("a.csv", "b.csv")]
    segments = [SimpleNamespace(number=k) for k in range(2)]
    group = SimpleNamespace(judged=(("boom.angle", action.port),))
    model = SimpleNamespace(group=group, segments=segments, judging=lambda signal: [0, 1])
    for held, told in (((even, stale), ["b.csv"]), ((stale, stale), [])):
        finding = SimpleNamespace(read={action: Stale(held, 0.3, 6)}, model=model)
        assert stale_in(SimpleNamespace(logs=logs), finding, action) == told


AXIS = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Axis(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.arm_in, self.p = 0.0, 80.0
        self.register_variable(Real("arm_in", causality=Fmi2Causality.input, description="duty of the valve [%]"))
        self.register_variable(Real("p", causality=Fmi2Causality.output, description="pressure [bar]"))

    def do_step(self, t, step):
        return True
"""


def test_a_command_is_no_feedback_and_where_a_model_begins_is_not_made_up(tmp_path):
    """The current's feedback of a valve driver was taken for its duty; "the model at 0" was said of one at 80 bar."""
    parts.by_pythonfmu("Axis", AXIS, tmp_path)
    log = tmp_path / "log.csv"
    rows = "".join(f"{0.01 * k:.2f},{40 * (k > 50)},{300 * (k > 52)},{80 + k / 10}\n" for k in range(200))
    log.write_text("time [s],Arm_in_duty,Arm_in_FB,p [bar]\n" + rows)
    found = overview(log)
    with read_system(tmp_path / "Axis.fmu") as system:
        matched = of_file(system, found)
        assert matched.taken[1] == "arm_in"
        assert "Arm_in_FB" in matched.check(1)
        (begin,) = beginnings_of(system, found, matched)
    assert begin.model is None
    assert began(begin, "bar").startswith("begins at 80")
    assert "where the model begins the FMU does not say" in began(begin, "bar")


@pytest.mark.parametrize("lost", [0.0, 0.05])
def test_the_digits_of_a_file_make_no_stale_samples(lost):
    """Five digits of a pressure with noise of 0.1 bar repeat themselves by chance: "stale samples 1.5 %" was a cause."""
    rng = np.random.default_rng(4)
    true = 140.0 + 20.0 * np.sin(0.002 * np.arange(2000))
    read = np.array([float(f"{v:.5g}") for v in true + 0.1 * rng.standard_normal(2000)])
    held = np.maximum.accumulate(np.where(rng.random(2000) < lost, 0, np.arange(2000)))
    assert np.mean(np.diff(read) == 0.0) > 0.01
    found = stale_of([read[held]], [true])
    assert (found is not None) == (lost > 0.0)


LAG = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Lag(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.tau, self.gain = 0.0, 0.0, 1.0, 1.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        for name in ("tau", "gain"):
            tunable = Fmi2Variability.tunable
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=tunable))

    def do_step(self, t, step):
        return True
"""


def test_beside_a_single_fmu_a_parameters_name_is_enough(tmp_path):
    """Its connectors were known by their names alone, its parameters not; and nothing said what they are called."""
    parts.by_pythonfmu("Lag", LAG, tmp_path)
    mapping = tmp_path / "lag.toml"
    head = 'model = "Lag.fmu"\n[time]\ncolumn = "time [s]"\n[signals.u]\ncolumn = "u [1]"\n[signals.y]\ncolumn = "y [1]"\n'
    log = tmp_path / "log.csv"
    log.write_text("time [s],u [1],y [1]\n" + "".join(f"{0.1 * k:.1f},{k % 7},{k % 5}\n" for k in range(50)))
    with read_system(tmp_path / "Lag.fmu") as system:
        mapping.write_text(head + '[diagnose]\ntrusted = { "tau" = "5 %" }\nfree = ["Lag.gain"]\n')
        _, options, _ = read([log], system, mapping)
        assert options.trusted == {"Lag.tau": 0.05}
        assert options.free == ("Lag.gain",)
        mapping.write_text(head + '[diagnose]\ntrusted = ["taw"]\n')
        with pytest.raises(DataError, match=r"it has Lag\.tau, Lag\.gain"):
            read([log], system, mapping)


NAMED = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Part(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.{u}, self.{y}, self.gain, self.{start} = 0.0, 0.0, 1.0, 20.0
        self.register_variable(Real("{u}", causality=Fmi2Causality.input))
        self.register_variable(Real("{y}", causality=Fmi2Causality.output))
        for name in ("gain", "{start}"):
            tunable = Fmi2Variability.tunable
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=tunable))

    def do_step(self, t, step):
        return True
"""


@pytest.mark.parametrize("start", ["T_0", "start"])
def test_the_letter_of_a_quantity_and_a_plain_start_are_known(tmp_path, start):
    """`temperature [degC]` beside `T_plate`, a voltage beside `u`, and `T_0` as where it begins: nothing was matched."""
    parts.by_pythonfmu("Part", NAMED.format(u="u", y="T_plate", start=start), tmp_path)
    log = tmp_path / "log.csv"
    rows = "".join(f"{2 * k},{9 * (k > 50)},{129 + k / 10}\n" for k in range(200))
    log.write_text("time [s],lamp voltage [V],temperature [degC]\n" + rows)
    found = overview(log)
    with read_system(tmp_path / "Part.fmu") as system:
        matched = of_file(system, found)
        assert matched.taken == {1: "u", 2: "Part.T_plate"}
        (begin,) = beginnings_of(system, found, matched)
    assert begin.parameter == f"Part.{start}"
    assert begin.reading == pytest.approx(129.0), "it moves from the first sample on"


def test_what_all_names_have_in_common_and_columns_almost_empty_tell_nothing(tmp_path):
    """`Current (mA) - Plot 0` and `Flow (GPM) - Plot 0` beside the limits of the plots were no connector's."""
    parts.by_pythonfmu("Part", NAMED.format(u="current", y="flow", start="width"), tmp_path)
    log = tmp_path / "log.csv"
    rows = "".join(
        f"{0.1 * k - 5},{2 + k % 7},{'0' if k < 2 else ''},{k if k < 2 else ''}\n" for k in range(200)
    )
    log.write_text(
        "Current (mA) - Plot 0,Flow (GPM) - Plot 0,Current (mA) - Plot 1,Flow (GPM) - Plot 1\n" + rows
    )
    with read_system(tmp_path / "Part.fmu") as system:
        assert of_file(system, overview(log)).taken == {0: "current", 1: "Part.flow"}


def test_what_a_free_number_takes_up_is_no_want_of_the_log():
    """A gain before an unknown gain "could not be shown by this log", and a run was proposed that shows it no better."""
    u = np.linspace(-1.0, 1.0, 50)
    problem = SimpleNamespace(
        names=("y",),
        model=lambda values: {"y": values["gain"] * u + values["faint"] * 1e-3},
        whitened=lambda series: series["y"][None] / 0.01,
        mask=np.ones(52, bool),  # two rows of priors behind the samples
    )
    best = SimpleNamespace(fit=SimpleNamespace(values={"gain": 1.0, "faint": 0.0}))
    stage = SimpleNamespace(problem=problem)
    assert not Rivals._unseen(stage, best, {"gain": 1.15}, 10.0)
    assert Rivals._unseen(stage, best, {"faint": 1.0}, 10.0)
