"""The engine "compiled" agrees with the FMUs to 1e-9 of each signal's range, and refuses what it cannot run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.batch.twin import Twin
from cosim.errors import ModelError, SimulationError, UsageError
from cosim.master import Runner
from cosim.ssp.read import read_system

H = 1e-3
VALUES: list[dict[str, Any]] = [
    {},
    {"mechanical.J": 900.0, "mechanical.tau_c": 80.0, "dcv.tau_d": 0.0123, "sensor.drift": 1e-3},
    {
        "dcv.K": 3.2e-3,
        "continuity.k_s": 4e9,
        "mechanical.gap": 0.002,
        "sensor.quantum": 1e-3,
        "dead_zone.play": 0.02,
    },
    {"stimulus.gain": -0.7, "stimulus.hold": 0, "mechanical.tau_r": 150.0, "observer.l_1": 5.0},
]


def agree(one: Any, other: Any) -> None:
    assert list(one.signals) == list(other.signals)
    assert (one.units, one.display, one.aliases) == (other.units, other.display, other.aliases)
    for name, values in one.signals.items():
        allowed = 1e-9 * max(float(np.ptp(values)), 1e-9 * float(np.max(np.abs(values))))
        assert np.max(np.abs(values - other[name])) <= allowed, name


@pytest.mark.parametrize("values", VALUES)
def test_full_order_agrees(packages: dict[str, Path], values: dict[str, Any]) -> None:
    with read_system(packages["full_order"]) as system, Runner(system) as runner:
        known = {
            n: v
            for n, v in values.items()
            if n.partition(".")[2] in system.components[n.partition(".")[0]].fmu.variables
        }
        agree(runner.run(3.0, H, parameters=known), Twin(system).run(3.0, H, parameters=known))


def test_simplified_and_other_steps_agree(packages: dict[str, Path]) -> None:
    with read_system(packages["simplified"]) as system, Runner(system) as runner:
        twin = Twin(system)
        for step in (1e-3, 2e-3, 7e-4 * 3000 / 2100):
            agree(runner.run(2.1, step), twin.run(2.1, step))


def test_driven_open_package_agrees(packages: dict[str, Path]) -> None:
    time = np.arange(1501) * H
    inputs = {"u": (time, 0.6 * np.cos(5.0 * time))}
    with read_system(packages["full_order_open"]) as system, Runner(system) as runner:
        one, other = (
            e.run(1.5, H, inputs=inputs, record=["slew", "u", "dcv.demand"]) for e in (runner, Twin(system))
        )
        agree(one, other)
        start = {"inputs": {"u": (time + 4.0, inputs["u"][1])}, "start_time": 4.0}
        agree(runner.run(5.5, H, **start), Twin(system).run(5.5, H, **start))


def test_a_cut_chain_driven_in_the_middle_agrees(packages: dict[str, Path]) -> None:
    time = np.arange(1001) * H
    inputs = {"u": 0.3, "mechanical.p_load": (time, 1e6 * np.sin(9.0 * time)), "sensor.theta": 0.2}
    with read_system(packages["full_order_open"]) as system, Runner(system) as runner:
        agree(
            *(
                e.run(1.0, H, inputs=inputs, record=["mechanical.theta", "slew"])
                for e in (runner, Twin(system))
            )
        )


def test_what_is_kept_between_runs_changes_nothing(packages: dict[str, Path]) -> None:
    with read_system(packages["full_order"]) as system:
        reused = Twin(system)
        for values in [
            {"mechanical.J": 800.0},
            {"dcv.K": 2e-3},
            {},
            {"mechanical.J": 800.0},
            {"stimulus.gain": 0.5},
        ]:
            fresh, again = Twin(system).run(3.0, H, parameters=values), reused.run(3.0, H, parameters=values)
            for name in fresh.signals:
                assert np.array_equal(fresh[name], again[name]), (values, name)
        short = reused.run(1.0, H)
        assert np.array_equal(short["sensor.slew"], Twin(system).run(1.0, H)["sensor.slew"])


def test_a_loop_is_refused(packages: dict[str, Path]) -> None:
    with read_system(packages["physical"]) as system, pytest.raises(ModelError, match=r"loop.*--engine fmu"):
        Twin(system).run(1.0, H)


def test_fmus_of_others_are_refused(rogue: Path) -> None:
    with (
        read_system(rogue) as system,
        pytest.raises(ModelError, match=r"'r' is none of our blocks.*--engine fmu"),
    ):
        Twin(system)


def test_an_fmu_with_other_equations_is_refused(packages: dict[str, Path]) -> None:
    with read_system(packages["simplified"]) as system:
        fmu = system.components["sensor"].fmu
        assert fmu.module is not None
        script = fmu.folder / "resources" / f"{fmu.module[0]}.py"
        script.write_text(script.read_text().replace("p.gain * theta", "p.gain * 1.0 * theta"))
        with pytest.raises(ModelError, match="'sensor': its FMU holds other equations"):
            Twin(system)


def test_values_out_of_bounds_are_refused_as_the_fmu_would(packages: dict[str, Path]) -> None:
    with read_system(packages["full_order_open"]) as system, Runner(system) as runner:
        for engine in (runner, Twin(system)):
            with pytest.raises(SimulationError, match="'mechanical' refuses J"):
                engine.run(0.1, H, parameters={"mechanical.J": -1.0}, inputs={"u": 0.0})
            with pytest.raises(SimulationError, match="compensator"):
                engine.run(0.1, H, inputs={"u": 1e9})
        with pytest.raises(UsageError, match="closest"):
            Twin(system).run(0.1, H, parameters={"mechanical.Jx": 1.0})
        with pytest.raises(UsageError, match="shorter last step"):
            Twin(system).run(0.1005, H, partial_step=True)


def test_a_run_after_one_that_was_refused_at_once_is_a_first_one(packages: dict[str, Path]) -> None:
    """Components behind the one that refuses had not begun: they were ended all the same, and refused the next run."""
    with read_system(packages["full_order_open"]) as system, Runner(system) as runner:
        with pytest.raises(SimulationError, match="'mechanical' refuses J"):
            runner.run(0.1, H, parameters={"mechanical.J": -1.0}, inputs={"u": 0.5})
        found = runner.run(0.1, H, inputs={"u": 0.5})
        with Runner(system) as other:
            expected = other.run(0.1, H, inputs={"u": 0.5})
    for name, values in expected.signals.items():
        np.testing.assert_array_equal(found.signals[name], values)
