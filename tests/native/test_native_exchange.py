"""Model exchange: the derivatives are those of the numbered equations, and integrating them gives the co-simulation."""

import ctypes
import math
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmu_raw import ERROR, OK, Instance
from lxml import etree
from scipy.integrate import solve_ivp

from cosim.native.exchange import EXCHANGE
from fmus import registry
from fmus.build import composed_block


class Exchanged:
    """A block in continuous-time mode.

    Attributes:
        messages: what it logged.
    """

    def __init__(self, folder: Path, block: str, ready: bool = True, **values: float) -> None:
        description = read_model_description(str(folder))
        self.vr = {v.name: v.valueReference for v in description.modelVariables}
        self.n = description.numberOfContinuousStates
        self.messages: list[str] = []
        self.fmu = FMU2Model(
            guid=description.guid, unzipDirectory=str(folder),
            modelIdentifier=description.modelExchange.modelIdentifier, instanceName=block,
        )  # fmt: skip
        self.callbacks = fmi2CallbackFunctions()
        self.callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda e, n, s, c, text: self.messages.append(text.decode())
        )
        self.fmu.instantiate(callbacks=self.callbacks)
        self.fmu.setupExperiment(startTime=0.0)
        self.set(**values)
        self.fmu.enterInitializationMode()
        if ready:
            self.fmu.exitInitializationMode()
            self.fmu.newDiscreteStates()
            self.fmu.enterContinuousTimeMode()

    def set(self, **values: float) -> None:
        for name, value in values.items():
            self.fmu.setReal([self.vr[name]], [value])

    def get(self, *names: str) -> list[float]:
        return self.fmu.getReal([self.vr[n] for n in names])

    def rates(self, *states: float) -> list[float]:
        """Derivatives at these states."""
        given, found = (ctypes.c_double * self.n)(*states), (ctypes.c_double * self.n)()
        self.fmu.setContinuousStates(given, self.n)
        self.fmu.getDerivatives(found, self.n)
        return list(found)


P = {name: {n: v.start for n, v in composed_block(name).parameters.items()} for name in EXCHANGE}


def continuity(p, x, u):
    """(4.26) with (4.33): leakage, compressibility and both asymmetries as docs/effects.md writes them."""
    opening = u[0] * (1.0 + (p["a_q"] if u[0] > 0.0 else -p["a_q"]))
    gain, T = p["K_c"] / (1.0 + p["c_l"]), p["T"] * (1.0 + p["c_beta"]) / (1.0 + p["c_l"])
    return [(gain * opening - x[0]) / (T if gain * opening > x[0] else T * p["r_T"])]


def mechanical(p, x, u):
    """(4.27), with gravity and ripple."""
    torque = p["A"] * p["r"] * u[0] - p["b"] * x[1] - p["tau_load"]
    torque += p["tau_r"] * math.sin(p["n_r"] * x[0] + p["phi_r"]) - p["tau_g"] * math.sin(x[0] - p["theta_g"])
    return [x[1], torque / p["J"]]


def simplified(p, x, u):
    """(4.15)."""
    return [x[1], p["k"] * u[0] - p["a"] * x[1]]


def dcv(p, x, u):
    """(4.16), with damping that varies as docs/effects.md writes it left out."""
    return [x[1], -(p["w0"] ** 2) * (x[0] - p["K"] * u[0] - p["x_0"]) - 2.0 * p["zeta"] * p["w0"] * x[1]]


def continuity_physical(p, x, u):
    """(4.19), (4.20): the block's own right-hand side."""
    module = composed_block("continuity_physical").module
    return [*module.rates(*x, *u, module.Parameters(**p)), p["r"] * u[1]]


RIGHT_HAND_SIDES = {
    "continuity": (
        continuity,
        [3e5],
        [1e-3],
        {"a_q": 0.2, "c_l": 0.1, "c_beta": 0.3, "p_c": 1e5, "r_T": 1.7},
    ),
    "continuity_physical": (
        continuity_physical,
        [9e6, 8e6, 1.65e7, 0.02],
        [1e-3, 0.01],
        {"R_s": 1e10, "p_t": 1e5, "C_A": 1e-12},
    ),
    "mechanical": (
        mechanical,
        [0.3, 0.02],
        [1e5],
        {"tau_g": 100.0, "theta_g": 0.5, "tau_r": 30.0, "tau_load": 12.0},
    ),
    "simplified": (simplified, [0.3, 0.02], [0.7], {"a": 3.0}),
    "dcv": (dcv, [2e-4, 5e-3], [0.3], {"zeta": 1.2, "x_0": 1e-4}),
}


@pytest.mark.parametrize("block", RIGHT_HAND_SIDES)
def test_derivatives_are_those_of_the_equations(unpacked, block) -> None:
    equations, state, inputs, changed = RIGHT_HAND_SIDES[block]
    rng = np.random.default_rng(2)
    for values in ({}, changed):
        slave = Exchanged(unpacked[block], block, **values)
        names = list(registry.block(block).inputs)
        for _ in range(20):
            x = [
                v
                * rng.uniform(0.2, 2.0)
                * rng.choice([-1.0, 1.0] if block != "continuity_physical" else [1.0])
                for v in state
            ]
            u = [v * rng.normal() for v in inputs]
            slave.set(**dict(zip(names, u, strict=True)))
            expected = equations(P[block] | values, x, u)
            size = np.maximum(np.abs(expected), np.abs(equations(P[block] | values, state, inputs)))
            assert np.all(np.abs(np.array(slave.rates(*x)) - expected) <= 1e-12 * size)
            assert slave.get(*(f"x.{n}" for n in EXCHANGE[block].states)) == x
            assert slave.get(*(f"der(x.{n})" for n in EXCHANGE[block].states)) == slave.rates(*x)
        slave.fmu.freeInstance()


def structure(folder: Path, section: str) -> dict[str, set[str]]:
    """Unknowns of a section of ModelStructure, with the names that each depends on."""
    root = etree.parse(folder / "modelDescription.xml").getroot()
    names = [v.get("name") for v in root.find("ModelVariables")]
    return {
        names[int(u.get("index")) - 1]: {names[int(k) - 1] for k in u.get("dependencies").split()}
        for u in root.findall(f"ModelStructure/{section}/Unknown")
    }


# effects under which everything that can act acts; states and inputs about which it is tried
ACTING = {
    "continuity": {"a_q": 0.2},
    "continuity_physical": {"R_s": 1e10},
    "mechanical": {"e_l": 0.3, "theta_l": 0.2, "tau_g": 100.0},
    "simplified": {},
    "dcv": {},
}


@pytest.mark.parametrize("block", RIGHT_HAND_SIDES)
def test_what_derivatives_and_outputs_depend_on_is_listed(unpacked, block) -> None:
    _, states, inputs, _ = RIGHT_HAND_SIDES[block]
    rng, slave = np.random.default_rng(4), Exchanged(unpacked[block], block, **ACTING[block])
    names = [f"x.{n}" for n in EXCHANGE[block].states] + list(registry.block(block).inputs)
    outputs = list(registry.block(block).outputs)
    seen = {name: set() for name in (*outputs, *(f"der(x.{n})" for n in EXCHANGE[block].states))}

    def found(numbers):
        slave.set(**dict(zip(names[len(states) :], numbers[len(states) :], strict=True)))
        rates = slave.rates(*numbers[: len(states)])
        return dict(zip(seen, [*slave.get(*outputs), *rates], strict=True))

    for _ in range(60):
        numbers = [*(v * rng.uniform(0.2, 2.0) for v in states), *(v * rng.normal() for v in inputs)]
        before = found(numbers)
        for k, name in enumerate(names):
            after = found([v * (1.01 if j == k else 1.0) for j, v in enumerate(numbers)])
            for unknown in seen:
                seen[unknown] |= {name} if after[unknown] != before[unknown] else set()
    assert structure(unpacked[block], "Outputs") | structure(unpacked[block], "Derivatives") == seen
    # at the start the inputs alone are not known yet; states follow from parameters
    initial = structure(unpacked[block], "InitialUnknowns")
    given = set(registry.block(block).inputs)
    assert {n: names & given for n, names in initial.items() if n.startswith("der")} == {
        n: names & given for n, names in seen.items() if n.startswith("der")
    }
    assert not any(names & given for n, names in initial.items() if not n.startswith("der"))
    assert set(initial) == set(seen) | {f"x.{n}" for n in EXCHANGE[block].states}


@pytest.mark.parametrize("block", RIGHT_HAND_SIDES)
def test_integrated_it_is_the_co_simulation(unpacked, block) -> None:
    """A constant input, under which a step of any length is exact (RK4 at 1 ms for the physical block)."""
    _, _, inputs, changed = RIGHT_HAND_SIDES[block]
    # steps with these are of second order, and an asymmetric opening begins as the spool itself
    changed = {n: v for n, v in changed.items() if n not in ("tau_g", "tau_r", "a_q")}
    given = dict(zip(registry.block(block).inputs, inputs, strict=True))
    slave = Exchanged(unpacked[block], block, **given, **changed)
    first = slave.get(*(f"x.{n}" for n in EXCHANGE[block].states))
    solved = solve_ivp(
        lambda t, x: slave.rates(*x), (0.0, 0.4), first, method="DOP853", rtol=1e-12, atol=1e-12
    )
    slave.rates(*solved.y[:, -1])
    outputs = list(registry.block(block).outputs)
    found = slave.get(*outputs)
    other = Instance(unpacked[block], block)
    other.fmu.setupExperiment(startTime=0.0)
    other.set(**given, **changed)
    other.fmu.enterInitializationMode()
    other.fmu.exitInitializationMode()
    for k in range(400):
        assert other.step(k * 1e-3) == OK
    assert found == pytest.approx(other.get(*outputs), rel=1e-8, abs=1e-9)
    assert other.get(*(f"x.{n}" for n in EXCHANGE[block].states)) == pytest.approx(
        solved.y[:, -1], rel=1e-8, abs=1e-9
    )
    other.close()


def test_static_blocks_follow_their_input(unpacked) -> None:
    zone = Exchanged(unpacked["dead_zone"], "dead_zone")
    for command, demand in ((0.7, 0.25), (-0.9, -0.5), (0.2, 0.0), (3.0, 1.0)):
        zone.set(command=command)
        assert zone.get("demand") == [pytest.approx(demand, abs=1e-15)]
    sensor = Exchanged(unpacked["sensor"], "sensor", gain=2.0, bias=0.5)
    sensor.set(theta=1.0)
    assert sensor.get("slew") == [2.5]
    assert sensor.n == zone.n == 0


@pytest.mark.parametrize("block", EXCHANGE)
def test_fmpy_integrates_it(fmu_files, block) -> None:
    result = simulate_fmu(
        str(fmu_files[block]),
        fmi_type="ModelExchange",
        stop_time=0.2,
        output_interval=0.01,
        relative_tolerance=1e-6,
    )
    assert len(result) == 21
    assert np.all(np.isfinite(result.view(float)))


REFUSED = [
    ("mechanical", "gap", 1e-3), ("mechanical", "mu", 0.2), ("mechanical", "z_s", 1e-4), ("dcv", "tau_d", 0.01),
    ("continuity", "k_s", 1e9), ("sensor", "tau_l", 0.1), ("sensor", "quantum", 1e-3), ("dead_zone", "play", 0.1),
]  # fmt: skip


@pytest.mark.parametrize(("block", "name", "value"), REFUSED)
def test_effects_with_a_past_are_refused(unpacked, block, name, value) -> None:
    with pytest.raises(FMICallException):
        Exchanged(unpacked[block], block, **{name: value})
    slave = Exchanged(unpacked[block], block, ready=False)
    slave.set(**{name: value})
    with pytest.raises(FMICallException):
        slave.fmu.exitInitializationMode()
    assert f"{name} = {value!r} is refused in model exchange" in slave.messages[0]
    assert "it must be 0.0" in slave.messages[0]
    together = Instance(unpacked[block]).initialise(**{name: value})
    assert together.step(0.0) == OK, "co-simulation takes it"
    together.close()


def test_the_two_kinds_do_not_mix(unpacked) -> None:
    slave = Exchanged(unpacked["simplified"], "simplified")
    status = slave.fmu.dll.fmi2DoStep(
        ctypes.c_void_p(slave.fmu.component), ctypes.c_double(0), ctypes.c_double(1e-3), 1
    )
    assert status == ERROR
    assert slave.messages == ["simplified: fmi2DoStep in model exchange"]
    other = Instance(unpacked["simplified"], "s").initialise()
    numbers = (ctypes.c_double * 2)()
    assert (
        other.fmu.dll.fmi2GetDerivatives(ctypes.c_void_p(other.fmu.component), numbers, ctypes.c_size_t(2))
        == ERROR
    )
    assert other.messages == ["s: fmi2GetDerivatives is for model exchange, after initialisation"]
    other.close()


def test_bad_states_are_refused(unpacked) -> None:
    slave = Exchanged(unpacked["simplified"], "s")
    with pytest.raises(FMICallException):
        slave.rates(math.nan, 0.0)
    assert slave.messages == ["s: state 0 = nan is refused: it must be a number"]
