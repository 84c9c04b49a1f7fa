"""The master against closed solutions: what is handed over when, in which order, and how exactly."""

import math
from typing import Any

import numpy as np
import pytest

from cosim.errors import SimulationError
from cosim.master import Runner, step_order
from cosim.ssp import read_ssp

H = 0.01
CHAIN = {"w": "wave", "g": "gain", "l": "lag", "i": "integrator"}
CHAIN_WIRES = ["w.y -> g.u", "g.y -> l.u", "l.y -> i.u"]
LOOP_WIRES = ["g.y -> l.u", "l.y -> g.u"]


def lag_of_sine(t: np.ndarray, T: float, a: float) -> np.ndarray:
    """y of T y' = a sin t - y from y(0) = 0."""
    return a * (np.sin(t) - T * np.cos(t) + T * np.exp(-t / T)) / (1.0 + T * T)


def test_both_engines_give_the_same_bits(toys: Any) -> None:
    components = {"s": "stairs", "d": "gain", **CHAIN, "b": "gain", "f": "lag"}
    wires = [*CHAIN_WIRES, "s.y -> d.u", "d.y -> b.u", "i.y -> f.u"]
    with Runner(toys.ssp(components, wires)) as runner:
        compiled = runner.run(3.0, 1e-3, engine="compiled")
        interpreted = runner.run(3.0, 1e-3, engine="python")
    assert len(compiled.signals) == 8
    for name in compiled:
        assert np.array_equal(compiled[name], interpreted[name]), name


def test_a_chain_follows_its_exact_solution_to_second_order(toys: Any) -> None:
    with Runner(toys.ssp(CHAIN, CHAIN_WIRES)) as runner:
        errors = []
        for h in (0.04, 0.02, 0.01):
            result = runner.run(4.0, h)
            assert np.array_equal(result["g.y"], 2.0 * result["w.y"])  # no delay along the chain
            errors.append(np.max(np.abs(result["l.y"] - lag_of_sine(result.time, 0.5, 2.0))))
    assert errors[2] < 3e-5
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.02)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.02)


def test_the_step_size_error_is_estimated_within_two_percent(toys: Any) -> None:
    with Runner(toys.ssp(CHAIN, CHAIN_WIRES)) as runner:
        seen: list[float] = []
        result = runner.coupling_error(4.0, 0.04, progress=seen.append)
    assert result.errors is not None
    estimate = result.errors["l.y"]
    true = result["l.y"] - lag_of_sine(result.time, 0.5, 2.0)
    assert estimate.order == pytest.approx(2.0, abs=0.01)
    assert estimate.largest == pytest.approx(np.max(np.abs(true)), rel=0.02)
    assert estimate.rms == pytest.approx(np.sqrt(np.mean(true * true)), rel=0.02)
    assert math.isnan(result.errors["g.y"].order)  # exact at any step: no order can be observed
    assert result.errors["g.y"].largest < 1e-14
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(4.0)


def test_a_discrete_output_hands_over_its_value_at_the_start_of_the_step(toys: Any) -> None:
    with Runner(toys.ssp({"s": "stairs", "g": "gain"}, ["s.y -> g.u"])) as runner:
        result = runner.run(0.5, 0.1)
    assert list(result["s.y"]) == [0, 1, 2, 3, 4, 5]
    assert list(result["g.y"]) == [0, 0, 2, 4, 6, 8]


@pytest.mark.parametrize(("hold", "expected"), [(("u",), [0, 0, 2, 4]), ((), [0, 2, 4, 6])])
def test_held_inputs_are_sampled_at_the_start_others_at_the_end(
    toys: Any, hold: Any, expected: list[float]
) -> None:
    with Runner(toys.fmu("gain")) as runner:
        result = runner.run(3.0, 1.0, inputs={"u": ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0])}, hold=hold)
    assert list(result["u"]) == [0, 1, 2, 3]
    assert list(result["gain.y"]) == expected


def test_a_transformation_scales_and_shifts(toys: Any) -> None:
    wire = "w.y -> g.u"
    extra = {wire: "<ssc:LinearTransformation factor='3' offset='0.5'/>"}
    with Runner(toys.ssp({"w": "wave", "g": "gain"}, [wire], connection_extra=extra)) as runner:
        result = runner.run(1.0, 0.1, record=["w.y", "g.y", "g.u"])
    assert np.allclose(result["g.y"], 2.0 * (3.0 * result["w.y"] + 0.5), rtol=1e-15)
    assert np.array_equal(result["g.u"], 3.0 * result["w.y"] + 0.5)


@pytest.mark.parametrize("names", [("l", "g"), ("g", "l")])
def test_a_loop_is_broken_where_no_output_depends_directly(toys: Any, names: tuple[str, str]) -> None:
    kinds = {"l": "lag", "g": "gain"}
    with Runner(toys.ssp({n: kinds[n] for n in names}, LOOP_WIRES)) as runner:
        result = runner.run(1.0, H, parameters={"g.k": -1.0, "l.start": 1.0})
        fine = runner.run(1.0, H / 2, parameters={"g.k": -1.0, "l.start": 1.0})
    assert [n for n in result.notes if "loop" in n] == [
        "connection g.y -> l.u closes a loop and carries last step's value"
    ]
    exact = np.exp(-2.0 * result.time / 0.5)  # T y' = -y - y
    errors = [np.max(np.abs(r["l.y"][::k] - exact)) for r, k in ((result, 1), (fine, 2))]
    assert errors[0] < 0.03
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)  # one delayed wire: first order


def test_order_is_that_of_the_wiring_whatever_the_file_says(toys: Any) -> None:
    backwards = dict(reversed(CHAIN.items()))
    with read_ssp(toys.ssp(backwards, CHAIN_WIRES)) as system:
        order = step_order({c.name: c.fmu for c in system.components.values()}, system.wires)
    assert order.names == ("w", "g", "l", "i")
    assert order.delayed == ()


def test_two_loops_one_behind_the_other(toys: Any) -> None:
    kinds = {"q": "gain", "p": "lag", "b": "gain", "a": "lag"}
    wires = ["a.y -> b.u", "b.y -> a.u", "p.y -> q.u"]
    with read_ssp(toys.ssp(kinds, wires)) as system:
        order = step_order({c.name: c.fmu for c in system.components.values()}, system.wires)
    assert order.names == ("p", "q", "a", "b")
    assert [str(w) for w in order.delayed] == ["b.y -> a.u"]


def test_an_algebraic_loop_starts_at_its_fixed_point(toys: Any) -> None:
    path = toys.ssp({"a": "affine", "b": "affine"}, ["a.y -> b.u", "b.y -> a.u"])
    with Runner(path) as runner:
        result = runner.run(0.2, 0.1, parameters={"a.c": 3.0})
        # a = b/2 + 3, b = a/2 + 1
        assert result["a.y"][0] == pytest.approx(14.0 / 3.0, rel=1e-12)
        assert result["b.y"][0] == pytest.approx(10.0 / 3.0, rel=1e-12)
        with pytest.raises(SimulationError, match=r"b\.y -> a\.u.*no common start values"):
            runner.run(0.2, 0.1, parameters={"a.k": 3.0, "b.k": 3.0})
        assert runner.run(0.2, 0.1)["a.y"][0] == pytest.approx(2.0, rel=1e-12)  # and the Runner lives on


def test_an_input_series_takes_the_place_of_a_connection(toys: Any) -> None:
    with Runner(toys.ssp(CHAIN, CHAIN_WIRES)) as runner:
        result = runner.run(1.0, 0.1, inputs={"l.u": 2.0})
    assert "input l.u follows the given series instead of g.y" in result.notes
    assert np.allclose(result["l.y"], 2.0 * (1.0 - np.exp(-result.time / 0.5)), rtol=1e-12)


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_an_input_is_set_only_when_it_changes(toys: Any, engine: Any) -> None:
    """It keeps its value until then (FMI 2.0, section 2.1.7)."""
    held = [1.0, 1.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 1.0, 1.0]
    with Runner(toys.fmu("counter")) as runner:
        result = runner.run(
            1.0, 0.1, inputs={"u": (0.1 * np.arange(10), np.array(held))}, hold=["u"], engine=engine
        )
        again = runner.run(1.0, 0.1, inputs={"u": 3.0}, engine=engine)
    sets = result[next(iter(result))]
    np.testing.assert_array_equal(np.diff(sets), [0, 0, 1, 0, 0, 1, 0, 0, 1, 0])
    assert sets[0] > 0  # in initialisation mode the first value is set
    assert np.ptp(again[next(iter(again))]) == 0.0
