"""When a unit is run and when its outputs are superposed: a unit that is a plain function, whose runs are counted."""

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.errors import SimulationError
from cosim.ssp.system import Port
from cosim.system.superposition import (
    AGAIN,
    BEYOND,
    MOST_ANSWERS,
    MOST_INPUTS,
    PROVED,
    SAME,
    WORTH,
    Superposition,
)

U, V, Y = Port("part", "u"), Port("part", "v"), Port("part", "y")
N = 200
BEFORE = WORTH * 2 + 1  # runs until the answers of one input are measured
PULSES = 2


class Part:
    """A lag that begins settled on the first value of u, and hears v at once; bent where u is far below zero."""

    def __init__(self, bend: float = 0.0) -> None:
        self.bend, self.count = bend, 0

    def __call__(self, inputs):
        self.count += 1
        u = inputs[U]
        y = u[0] + lfilter([0.0, 0.2], [1.0, -0.8], u - u[0]) + 3.0
        if V in inputs:
            y = y + 0.5 * inputs[V]
        return {Y: y + self.bend * np.minimum(u + 1.1, 0.0) ** 2}


def wave(seed: int, size: float = 1.0) -> np.ndarray:
    """Within plus and minus `size`, which it reaches."""
    x = lfilter([1.0], [1.0, -0.9], np.random.default_rng(seed).standard_normal(N))
    return size * (2.0 * (x - x.min()) / np.ptp(x) - 1.0)


def asked(item: Superposition, part: Part, u: np.ndarray, key: bytes = b"", **more: np.ndarray):
    inputs = {U: u, **({V: more["v"]} if more else {})}
    return item.outputs(key, inputs, list(inputs), part)[Y]


def known(part: Part, key: bytes = b"", item: Superposition | None = None) -> Superposition:
    """One that has foretold as many runs as are needed to be believed, with inputs of size 1."""
    item = item or Superposition()
    for seed in range(BEFORE + PROVED):
        asked(item, part, wave(seed), key)
    return item


def test_runs_are_spared_once_enough_of_them_were_foretold() -> None:
    part = Part()
    item = known(part)
    assert (part.count, item.used) == (BEFORE + PULSES + PROVED, 0)
    u = wave(99, 0.9) - 0.05
    found = asked(item, part, u)
    assert (part.count, item.used) == (BEFORE + PULSES + PROVED, 1)
    assert found == pytest.approx(Part()({U: u})[Y], abs=1e-12)
    assert item.linear


def test_now_and_then_one_is_run_all_the_same() -> None:
    part = Part()
    item = known(part)
    before = part.count
    for seed in range(2 * (AGAIN + 1)):
        asked(item, part, wave(1000 + seed, 0.9))
    assert (item.used, part.count - before) == (2 * AGAIN, 2)


@pytest.mark.parametrize(("share", "run"), [(0.9, 0), (1.1, 1)])
def test_what_goes_beyond_the_range_of_real_runs_is_run(share: float, run: int) -> None:
    part = Part()
    item = known(part)
    before = part.count
    u = wave(99, 0.5)
    u[50] = 1.0 + share * BEYOND * 2.0  # of a range from -1 to 1; the lag's output stays far within its own
    asked(item, part, u)
    asked(item, part, -u)
    assert part.count - before == 2 * run
    asked(item, part, u)  # then it has been there
    assert part.count - before == 2 * run


def test_an_output_beyond_what_it_has_reached_is_run_too() -> None:
    part = Part()
    item = known(part)
    before = part.count
    asked(item, part, np.full(N, 0.99))  # the lag follows an input that stays, not the peaks of a wave
    assert part.count - before == 1


def test_a_unit_that_once_differs_is_run_from_then_on() -> None:
    part = Part(bend=0.1)
    item = known(part)  # nothing was there; pulses go upwards
    assert item.linear
    for k, size in enumerate((1.5, 0.5, 0.5)):
        before = part.count
        assert np.array_equal(asked(item, part, wave(7, size)), Part(0.1)({U: wave(7, size)})[Y])
        assert part.count == before + 1
        assert not item.linear, k


@pytest.mark.parametrize(("share", "linear"), [(0.5, True), (2.0, False)])
def test_runs_are_the_same_within_rounding_of_what_they_reach(share: float, linear: bool) -> None:
    class Rough(Part):
        def __call__(self, inputs):
            found = super().__call__(inputs)
            if self.count > BEFORE + PULSES:
                found[Y][3] += share * SAME * np.abs(found[Y]).max() * (-1) ** self.count
            return found

    assert known(Rough()).linear == linear


def test_two_inputs_are_superposed_and_one_of_a_kind_that_takes_no_pulse_may_not_move() -> None:
    part, item = Part(), Superposition()
    for seed in range(2 * WORTH * 2 + 1 + PROVED):
        asked(item, part, wave(seed), v=wave(100 + seed))
    before = part.count
    u, v = wave(98, 0.9), wave(99, 0.9)
    assert asked(item, part, u, v=v) == pytest.approx(Part()({U: u, V: v})[Y], abs=1e-12)
    assert (part.count, item.used) == (before, 1)
    part, item = Part(), Superposition()
    still = wave(5)
    for seed in range(BEFORE + PROVED + 2):
        item.outputs(b"", {U: wave(seed), V: still}, [U], part)
    assert item.used > 0
    before = part.count
    item.outputs(b"", {U: wave(3, 0.9), V: 0.5 * still}, [U], part)
    assert part.count == before + 1


def test_a_unit_without_moving_inputs_or_with_too_many_is_run() -> None:
    part, item = Part(), Superposition()
    many = [Port("part", f"u{k}") for k in range(MOST_INPUTS + 1)]
    for _ in range(30):
        item.outputs(b"", {U: wave(1)}, [], part)
        item.outputs(b"", {U: wave(1)} | {p: wave(2) for p in many}, many, part)
    assert (part.count, item.used) == (60, 0)


def test_a_unit_that_cannot_be_run_with_a_pulse_is_run_from_then_on() -> None:
    class Weak(Part):
        def __call__(self, inputs):
            if np.abs(inputs[U]).max() > 1.5:
                raise SimulationError("it broke")
            return super().__call__(inputs)

    part = Weak()
    item = known(part)
    assert not item.linear
    assert (part.count, item.used) == (BEFORE + PROVED, 0)


def test_an_output_that_is_not_finite_is_never_what_was_foretold() -> None:
    class Broken(Part):
        def __call__(self, inputs):
            found = super().__call__(inputs)
            if self.count > BEFORE + PULSES:
                found[Y] = np.full(N, np.nan)
            return found

    assert not known(Broken()).linear


def test_answers_are_kept_for_a_few_sets_of_parameters() -> None:
    part, item = Part(), known(Part())
    for k in range(MOST_ANSWERS):  # one more than is kept
        known(part, bytes([k]), item)
    before = part.count
    asked(item, part, wave(99, 0.9), bytes([0]))
    assert part.count == before, "the second is still known"
    asked(item, part, wave(99, 0.9))
    assert part.count == before + 1 + PULSES, "the first is measured anew"
