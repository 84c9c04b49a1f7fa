"""Model exchange of what is sampled: a step of co-simulation at each event of the time, the same numbers bit for bit."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fmi3_raw import Instance3
from fmpy import extract, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmu_raw import STIMULUS, Instance
from test_native_exchange import Exchanged
from test_native_fmi3 import Exchanged3

from cosim.native.build import build_native, write_fmu
from cosim.native.container import container
from cosim.native.exchange import EXCHANGE
from cosim.native.header import read_as
from cosim.native.model import Model, single
from cosim.paths import ssp_folder
from fmus import registry
from fmus.build import composed_block

H = 1e-3  # s, between two samples
STEPS = 60
CHAINS = ("full_order", "physical", "simplified")
SAMPLED = [*(b for b in registry.BLOCKS if b not in EXCHANGE), *CHAINS]
BOTH = ("stimulus", "observer", "full_order")  # in FMI 3.0, too: the C of what is sampled is the same for all

Slave = Exchanged | Exchanged3


def model_of(name: str) -> Model:
    return container(ssp_folder() / f"{name}.ssd") if name in CHAINS else single(composed_block(name), {})


@pytest.fixture(scope="module")
def folders(unpacked, chains, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Path]:
    """Unpacked FMUs by name and version."""
    made = tmp_path_factory.mktemp("sampled")
    found = {(name, "2.0"): folder for name, folder in unpacked.items()}
    found |= {(n, "2.0"): Path(extract(str(file), str(made / n))) for n, file in chains.items()}
    for name in BOTH:
        file = made / f"{name}3.fmu"
        if name in CHAINS:
            write_fmu(model_of(name), file, fmi="3.0")
        else:
            build_native(
                composed_block(name), file, fmi="3.0",
                resources={"stimulus.csv": STIMULUS} if name == "stimulus" else None,
            )  # fmt: skip
        found[name, "3.0"] = Path(extract(str(file), str(made / f"{name}3")))
    return found


def waves(names: list[str], k: int) -> dict[str, float]:
    """An input at sample k for each name, a wave of its own."""
    return {name: 0.3 * float(np.sin(0.2 * k + j)) for j, name in enumerate(names)}


def co_simulated(
    folder: Path,
    name: str,
    fmi: str,
    given: Callable[[list[str], int], dict[str, float]] = waves,
    steps: int = STEPS,
) -> list[list[float]]:
    """All outputs, step by step; an input that holds over a step is that of its begin, the others those of its end."""
    slave = (Instance if fmi == "2.0" else Instance3)(folder)
    early = {n for n in slave.inputs if read_as(model_of(name), n) in ("AS_HELD", "AT_START")}
    slave.initialise(**given(slave.inputs, 0))
    rows = [slave.get(*slave.outputs)]
    for k in range(1, steps + 1):
        before, now = given(slave.inputs, k - 1), given(slave.inputs, k)
        slave.set(**{n: before[n] if n in early else now[n] for n in slave.inputs})
        slave.fmu.doStep((k - 1) * H, H)
        rows.append(slave.get(*slave.outputs))
    return rows


def opened(folder: Path, name: str, fmi: str) -> tuple[Slave, list[str], list[str]]:
    """An instance for model exchange at its start, with the names of its inputs and outputs."""
    model = model_of(name)
    inputs, outputs = ([n for n, _ in model.of(c)] for c in ("input", "output"))
    return (Exchanged if fmi == "2.0" else Exchanged3)(folder, name, **waves(inputs, 0)), inputs, outputs


def event(slave: Slave, time: float, **inputs: float) -> float:
    """What a host does at a time; when the next event is."""
    slave.fmu.setTime(time)
    slave.fmu.enterEventMode()
    slave.set(**inputs)
    again, ended, nominals, jumped, timed, at = (
        slave.fmu.newDiscreteStates() if isinstance(slave, Exchanged) else slave.fmu.updateDiscreteStates()
    )
    assert (again, ended, nominals, jumped, timed) == (False, False, False, False, True)
    slave.fmu.enterContinuousTimeMode()
    return float(at)


@pytest.mark.parametrize(("name", "fmi"), [*((n, "2.0") for n in SAMPLED), *((n, "3.0") for n in BOTH)])
def test_at_each_event_it_is_the_co_simulation(folders, name, fmi) -> None:
    slave, inputs, outputs = opened(folders[name, fmi], name, fmi)
    rows, at = [slave.get(*outputs)], event(slave, 0.0)
    for k in range(1, STEPS + 1):
        assert at == pytest.approx(k * H, rel=1e-12)
        at = event(slave, at, **waves(inputs, k))
        rows.append(slave.get(*outputs))
    assert rows == co_simulated(folders[name, fmi], name, fmi)


def test_between_two_samples_nothing_moves_and_of_those_passed_by_none_is_lost(folders) -> None:
    """A host has events of its own, and some step farther than they were told to."""
    slave, inputs, outputs = opened(folders["full_order", "2.0"], "full_order", "2.0")
    steady = waves(inputs, 0)
    event(slave, 0.0)
    before = slave.get(*outputs)
    assert event(slave, 0.4 * H, **steady) == pytest.approx(H)
    slave.set(**waves(inputs, 7))
    assert slave.get(*outputs) == before
    slave.set(**steady)
    assert event(slave, 40.0 * H, **steady) == pytest.approx(41.0 * H)
    other, _, _ = opened(folders["full_order", "2.0"], "full_order", "2.0")
    at = event(other, 0.0)
    for _ in range(40):
        at = event(other, at * (1.0 - 1e-15), **steady)
    assert slave.get(*outputs) == other.get(*outputs)


def test_a_saved_state_goes_on(folders) -> None:
    slave, inputs, outputs = opened(folders["observer", "2.0"], "observer", "2.0")
    at = event(slave, 0.0)
    for k in range(1, 20):
        at = event(slave, at, **waves(inputs, k))
    state = slave.fmu.getFMUstate()
    rows = []
    for _ in range(2):
        slave.fmu.setFMUstate(state)
        now = at
        for k in range(20, 40):
            now = event(slave, now, **waves(inputs, k))
        rows.append(slave.get(*outputs))
    slave.fmu.freeFMUstate(state)
    assert rows[0] == rows[1] == co_simulated(folders["observer", "2.0"], "observer", "2.0")[39]


def test_it_has_no_directional_derivatives_and_says_so(folders) -> None:
    slave, _, _ = opened(folders["observer", "2.0"], "observer", "2.0")
    with pytest.raises(FMICallException):
        slave.fmu.getDirectionalDerivative([slave.vr["slew_estimate"]], [slave.vr["u"]], [1.0])
    assert "there are no directional derivatives: observer is sampled" in slave.messages[-1]


def square(names: list[str], k: int) -> dict[str, float]:
    """Inputs that step at 0.2 s."""
    return dict.fromkeys(names, 0.5 if k < 200 else -0.3)


@pytest.mark.parametrize(("name", "fmi"), [("stimulus", "2.0"), ("full_order", "2.0"), ("full_order", "3.0")])
def test_fmpy_runs_it_by_its_solver_as_the_co_simulation(folders, name, fmi) -> None:
    times = H * np.arange(401)
    command = [(t, *square(["u"], k).values()) for k, t in enumerate(times)]
    found = simulate_fmu(
        str(folders[name, fmi]), fmi_type="ModelExchange", solver="CVode", stop_time=0.4, step_size=H,
        input=None if name == "stimulus" else np.array(command, dtype=[("time", float), ("u", float)]),
    )  # fmt: skip
    # at an event it records a row before it and one behind it
    last = np.searchsorted(found["time"], times + H / 4, side="right") - 1
    rows = np.array(co_simulated(folders[name, fmi], name, fmi, square, 400))
    for k, output in enumerate(found.dtype.names[1:]):
        assert np.max(np.abs(found[output][last] - rows[:, k])) <= 1e-9 * np.ptp(rows[:, k])


def test_a_host_that_has_lost_its_way_is_told(folders) -> None:
    slave, _, _ = opened(folders["stimulus", "2.0"], "stimulus", "2.0")
    event(slave, 0.0)
    slave.fmu.setTime(1e6)
    with pytest.raises(FMICallException):
        slave.fmu.newDiscreteStates()
    assert (
        "fmi2NewDiscreteStates at t = 1000000.0 s: the next sample was due at 0.001 s" in slave.messages[-1]
    )
