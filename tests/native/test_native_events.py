"""Events of model exchange: integrated from one to the next, friction, ends of travel and stops give the co-simulation."""

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmu_raw import OK, Instance
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from test_native_exchange import Exchanged
from test_native_fmi3 import Exchanged3

from cosim.native.build import build_native
from cosim.native.exchange import EXCHANGE
from fmus import registry
from fmus.build import composed_block

H = 1e-3  # s, of the co-simulation's steps: the inputs below move on straight lines from one to the next, or stand

Slave = Exchanged | Exchanged3


@dataclass(frozen=True)
class Case:
    """A block under an input of straight pieces.

    Attributes:
        block: its name.
        values: parameters.
        corners: (time, input before, input after) of each corner, s and SI.
        events: how many it meets.
        outputs: that are the states.
    """

    block: str
    values: dict[str, float]
    corners: tuple[tuple[float, float, float], ...]
    events: int
    outputs: tuple[str, ...]

    @property
    def input(self) -> str:
        return next(iter(registry.block(self.block).inputs))

    def at(self, k: int, t: float) -> float:
        """The input within piece `k`."""
        (t0, _, u0), (t1, u1, _) = self.corners[k : k + 2]
        return u0 + (u1 - u0) * (t - t0) / (t1 - t0)


TRIANGLE = tuple((t, u, u) for t, u in ((0.0, 0.0), (0.5, 3e5), (1.5, -3e5), (2.5, 3e5), (3.0, 1e5)))
SQUARE = tuple((0.5 * k, float((-1) ** (k - 1)), float((-1) ** k)) for k in range(7))
COUNTS = {"mechanical": 3, "dcv": 3, "simplified": 2}  # event indicators
MOVING, SPOOL = ("theta", "omega"), ("spool", "spool_rate")
CASES = [
    # breaks away, stops; breaks away, stops; breaks away, stops
    Case("mechanical", {"tau_c": 150.0}, TRIANGLE, 6, MOVING),
    Case("mechanical", {"tau_c": 100.0, "tau_d": 30.0}, TRIANGLE, 6, MOVING),
    # the ends of the travel, each met and left
    Case("mechanical", {"theta_max": 0.002, "theta_min": -0.001}, TRIANGLE, 5, MOVING),
    Case("mechanical", {"theta_max": 0.002, "theta_min": -0.001, "tau_c": 50.0}, TRIANGLE, 6, MOVING),
    Case("simplified", {"theta_max": 0.01, "theta_min": 0.0}, SQUARE, 6, MOVING),
    Case("dcv", {"K": 4e-3}, SQUARE, 6, SPOOL),
    Case("dcv", {"K": 4e-3, "v_max": 0.02}, SQUARE, 12, SPOOL),
]  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Path]:
    """Unpacked FMUs of both versions, by block and version."""
    folder = tmp_path_factory.mktemp("events")
    found = {}
    for block in {c.block for c in CASES}:
        for fmi in ("2.0", "3.0"):
            file = build_native(composed_block(block), folder / f"{block}{fmi[0]}.fmu", fmi=fmi)
            found[block, fmi] = Path(extract(str(file), str(folder / f"{block}{fmi[0]}")))
    return found


def opened(made: dict[tuple[str, str], Path], case: Case, fmi: str) -> Slave:
    """An instance in continuous-time mode."""
    kind = Exchanged if fmi == "2.0" else Exchanged3
    return kind(made[case.block, fmi], case.block, **case.values)


def indicators(slave: Slave) -> list[float]:
    """Event indicators where it stands."""
    count = COUNTS[slave.fmu.modelIdentifier]
    found = (ctypes.c_double * count)()
    slave.fmu.getEventIndicators(found, count)
    return list(found)


def states(slave: Slave) -> list[float]:
    """Continuous states where it stands."""
    found = (ctypes.c_double * slave.n)()
    slave.fmu.getContinuousStates(found, slave.n)
    return list(found)


def event(slave: Slave) -> bool:
    """What a host does at an event; True if states have jumped."""
    slave.fmu.enterEventMode()
    update = slave.fmu.newDiscreteStates if isinstance(slave, Exchanged) else slave.fmu.updateDiscreteStates
    again, ended, _, jumped, timed, _ = update()
    assert (again, ended, timed) == (False, False, False)
    slave.fmu.enterContinuousTimeMode()
    return bool(jumped)


def integrated(slave: Slave, case: Case) -> tuple[NDArray[np.float64], int]:
    """States every H seconds, and how many events came."""
    rows, count = [states(slave)], 0
    n = COUNTS[case.block]

    def put(k: int, t: float, x: NDArray[np.float64]) -> list[float]:
        slave.set(**{case.input: case.at(k, t)})
        return slave.rates(*x)

    for k in range(len(case.corners) - 1):
        t, end = case.corners[k][0], case.corners[k + 1][0]
        put(k, t, np.array(states(slave)))
        event(slave)  # an input that jumps is one for the host
        while t < end:

            def crossing(j: int, k: int = k):
                def of(now: float, x: NDArray[np.float64]) -> float:
                    put(k, now, x)
                    return indicators(slave)[j]

                of.terminal, of.direction = True, -1
                return of

            found = solve_ivp(
                lambda t, x, k=k: put(k, t, x), (t, end), states(slave), method="DOP853",
                events=[crossing(j) for j in range(n)], rtol=1e-11, atol=1e-14, max_step=0.01, dense_output=True,
            )  # fmt: skip
            while len(rows) * H <= found.t[-1] + 1e-9:
                rows.append(list(found.sol(min(len(rows) * H, found.t[-1]))))
            t = found.t[-1]
            put(k, t, found.y[:, -1])
            if found.status == 1:
                event(slave)
                count += 1
                assert count < 100, "events without end"
    return np.array(rows), count


def stepped(folder: Path, case: Case) -> NDArray[np.float64]:
    """The co-simulation: a step takes the input of its end where that moves on a line, and of its start where it stands."""
    slave = Instance(folder).initialise(**case.values, **{case.input: case.corners[0][2]})
    rows = [slave.get(*case.outputs)]
    held = registry.block(case.block).reads[case.input] == "held"
    for k in range(len(case.corners) - 1):
        first, last = (round(case.corners[i][0] / H) for i in (k, k + 1))
        for i in range(first, last):
            slave.set(**{case.input: case.at(k, (i if held else i + 1) * H)})
            assert slave.step(i * H) == OK
            rows.append(slave.get(*case.outputs))
    slave.close()
    return np.array(rows)


@pytest.mark.parametrize(
    ("case", "fmi"), [*((c, "2.0") for c in CASES), (CASES[3], "3.0"), (CASES[-1], "3.0")]
)
def test_from_event_to_event_it_is_the_co_simulation(made, case, fmi) -> None:
    found, count = integrated(opened(made, case, fmi), case)
    expected = stepped(made[case.block, "2.0"], case)
    assert found.shape == expected.shape
    assert count == case.events
    # a sample at an event is taken before it or after: there a speed may have jumped
    calm = np.ones(len(expected), dtype=bool)
    calm[1:] = np.all(np.abs(np.diff(expected, axis=0)) < 0.2 * np.ptp(expected, axis=0), axis=1)
    assert calm.mean() > 0.98
    assert np.max(np.abs(found - expected)[calm] / np.ptp(expected, axis=0)) < 1e-7


def test_friction_holds_without_creeping_until_it_breaks_away(made) -> None:
    case = CASES[0]
    slave = opened(made, case, "2.0")
    slave.set(p_load=0.99 * 150.0 / (8.4193e-3 * 0.1))
    assert not event(slave)
    assert slave.rates(0.1, 0.0) == [0.0, 0.0]
    left = indicators(slave)
    assert left == pytest.approx([1.5, 298.5, 1.0])
    slave.set(p_load=1.01 * 150.0 / (8.4193e-3 * 0.1))
    assert indicators(slave)[0] == pytest.approx(-1.5)
    assert event(slave), "the derivatives jump: a host has to begin anew"
    assert slave.rates(0.1, 0.0) == [0.0, pytest.approx(1.5 / 763.9437268410978)]
    # beyond the event the same motion goes on, so that a host can look for it
    assert slave.rates(0.1, -1e-6)[1] == pytest.approx((1.5 + 26661.636066754313e-6) / 763.9437268410978)
    assert indicators(slave)[0] < 0.0
    assert event(slave), "the state jumps to rest"
    assert states(slave) == [0.1, 0.0]


def test_an_end_takes_the_speed_and_lets_go_again(made) -> None:
    case = CASES[2]
    slave = opened(made, case, "3.0")
    slave.set(p_load=1e5)
    slave.rates(0.0021, 0.01)
    assert indicators(slave)[1] < 0.0
    assert event(slave)
    assert states(slave) == [0.002, 0.0]
    assert slave.rates(0.002, 0.0) == [0.0, 0.0]
    slave.set(p_load=-1e5)
    assert min(indicators(slave)) < 0.0
    event(slave)
    assert slave.rates(0.002, 0.0)[1] < 0.0


def test_a_saved_state_knows_the_motion(made) -> None:
    slave = opened(made, CASES[0], "2.0")
    slave.set(p_load=4e5)
    event(slave)
    slave.rates(0.0, 0.01)
    moving = slave.fmu.getFMUstate()
    rates = slave.rates(0.0, 0.01)
    slave.set(p_load=0.0)
    slave.rates(0.0, -1e-3)
    event(slave)
    assert slave.rates(0.0, 0.0) == [0.0, 0.0]
    slave.fmu.setFMUstate(moving)
    assert slave.rates(0.0, 0.01) == rates
    assert indicators(slave)[0] == pytest.approx(0.01)
    slave.fmu.freeFMUstate(moving)


@pytest.mark.parametrize("block", EXCHANGE)
def test_indicators_are_counted_and_in_fmi_3_are_variables(tmp_path, block) -> None:
    files = [build_native(composed_block(block), tmp_path / f"{block}{v}.fmu", fmi=v) for v in ("2.0", "3.0")]
    two, three = (read_model_description(str(f)) for f in files)
    wanted = COUNTS.get(block, 0)
    assert two.numberOfEventIndicators == three.numberOfEventIndicators == wanted
    names = [f"event.indicator_{k}" for k in range(1, wanted + 1)]
    assert [u.variable.name for u in three.eventIndicators] == names
    slave = Exchanged3(Path(extract(str(files[1]), str(tmp_path / "unpacked"))), block)
    assert slave.fmu.getNumberOfEventIndicators() == wanted
    if wanted:
        assert slave.get(*names) == indicators(slave)
