"""Directional control valve (4.16), (5.3): exactness, stops, speed limit, events.

The reference for events is scipy's solve_ivp at tight tolerance, one call per phase (free, at a stop, at the speed
limit) with its own event functions.
"""

import math

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fmus import registry
from fmus.compose import compose

BLOCK = bare("dcv")
K, W0, ZETA, STOP = 2.375e-3, 25.23, 0.545, 2.6e-3


def reference(
    demand: float, t: float, x: float = 0.0, v: float = 0.0, **given_values: float
) -> tuple[float, float]:
    """(spool, speed) after t seconds under a constant demand, phase by phase."""
    p = {
        "K": K,
        "w0": W0,
        "zeta": ZETA,
        "v_max": 1.0,
        "r_v": 1.0,
        "x_min": -STOP,
        "x_max": STOP,
    } | given_values
    low, high = p["x_min"], p["x_max"]
    rest = p["K"] * demand

    def most(v: float) -> float:
        return p["v_max"] * (p["r_v"] if v < 0.0 else 1.0)

    def force(x: float, v: float) -> float:
        return p["w0"] ** 2 * (rest - x) - 2 * p["zeta"] * p["w0"] * v

    now = 0.0
    while t - now > 1e-14:
        if ((x >= high and rest >= high) or (x <= low and rest <= low)) and v * (rest - x) >= 0.0:
            return (high if x >= high else low), 0.0
        saturated = abs(v) >= most(v) * (1 - 1e-12) and force(x, v) * v > 1e-9 * v * v

        def rates(_: float, y: np.ndarray, saturated: bool = saturated) -> list[float]:
            return [y[1], 0.0 if saturated else force(y[0], y[1])]

        events = [lambda _, y: high - y[0], lambda _, y: y[0] - low]
        events.append(
            (lambda _, y: force(y[0], y[1]) * math.copysign(1, y[1]))
            if saturated
            else (lambda _, y: most(y[1]) - abs(y[1]))
        )
        for event in events:
            event.terminal, event.direction = True, -1
        found = solve_ivp(
            rates, (now, t), [x, v], "DOP853", rtol=1e-12, atol=1e-15, events=events, max_step=0.02
        )
        now, (x, v) = found.t[-1], found.y[:, -1]
        if found.status == 1:
            if len(found.t_events[0]):
                x, v = high, 0.0
            elif len(found.t_events[1]):
                x, v = low, 0.0
            elif not saturated:
                v = math.copysign(most(v), v)
    return x, v


@pytest.mark.parametrize("zeta", [0.0, 0.2, ZETA, 1.0, 1.5, 50.0])
@pytest.mark.parametrize("h", [1e-3, 0.05, 2.0])
def test_exact_for_a_held_demand(zeta: float, h: float) -> None:
    """Under-, critically and overdamped, for any step, as long as nothing limits."""
    demand = np.random.default_rng(6).uniform(-1, 1, (60, 1))
    A = np.array([[0.0, 1.0], [-(W0**2), -2 * zeta * W0]])
    expected = ramp_response(A, np.array([[0.0], [K * W0**2]]), [0.0, 0.0], demand, h, [True])
    found = run(BLOCK, h, demand[0], {"zeta": zeta, "x_min": -1.0, "x_max": 1.0, "v_max": 100.0}).play(
        demand[1:]
    )
    size = K * np.array([1.0, W0])
    # without damping nothing is forgotten: rounding of sine and cosine adds up over 60 steps
    assert np.abs((found - expected) / size).max() < 1e-11 * max(1.0, W0 * h)


def test_step_response_of_5_3() -> None:
    """Peak time pi/(w0 sqrt(1 - zeta^2)) and overshoot exp(-pi zeta/sqrt(1 - zeta^2)), from any textbook."""
    damped = math.sqrt(1 - ZETA**2)
    peak = math.pi / (W0 * damped)
    spool, rate = run(BLOCK, peak, [0.0], {"x_max": 1.0}).step(1.0)
    assert spool == pytest.approx(K * (1 + math.exp(-math.pi * ZETA / damped)), rel=1e-14)
    assert abs(rate) < 1e-15 * K * W0 * 10


def test_full_command_meets_the_stop_and_rests_at_its_gain() -> None:
    """The overshoot of 13 % would reach 2.68 mm: the stop at 2.6 mm is hit, and left again, for every full step."""
    outputs = run(BLOCK, 1e-3, [0.0]).play([[1.0]] * 2000)
    # it hits and leaves the stop within one step, so no sample shows the stop itself; 1 ms from it at most
    assert STOP - K * (W0 * 1e-3) ** 2 < outputs[:, 0].max() <= STOP
    # two seconds on, exp(-13.75 * 2) = 1e-12 of it is left
    assert outputs[-1] == pytest.approx((K, 0.0), abs=1e-12 * K * W0)


@settings(max_examples=60)
@given(
    demands=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=25),
    h=st.sampled_from([1e-3, 0.01, 0.1, 1.0]),
    zeta=st.sampled_from([0.0, 0.545, 1.0, 3.0]),
    v_max=st.sampled_from([1.0, 0.05, 0.01]),
    r_v=st.sampled_from([1.0, 0.4, 2.5]),
    x_max=st.floats(0.0, 2.6e-3),
)
def test_stops_and_speed_limit_are_never_exceeded(
    demands: list[float], h: float, zeta: float, v_max: float, r_v: float, x_max: float
) -> None:
    limits = {"zeta": zeta, "v_max": v_max, "r_v": r_v, "x_max": x_max}
    outputs = run(BLOCK, h, [0.0], limits).play([[d] for d in demands])
    assert np.all((outputs[:, 0] >= -STOP) & (outputs[:, 0] <= x_max))
    assert np.all((outputs[:, 1] >= -v_max * r_v) & (outputs[:, 1] <= v_max))
    pressed = outputs[:, 0] == x_max
    assert np.all(outputs[pressed, 1] <= 0.0), "a spool at its stop does not move into it"
    assert np.all(outputs[outputs[:, 0] == -STOP, 1] >= 0.0)


@pytest.mark.parametrize(
    ("demand", "limits"),
    [
        (1.0, {}),
        (-3.0, {}),
        (1.0, {"v_max": 0.02}),
        (-1.0, {"v_max": 0.005}),
        (2.0, {"v_max": 0.01}),
        (-1.0, {"v_max": 0.02, "r_v": 0.3}),
        (1.0, {"v_max": 0.02, "r_v": 0.3}),
        (-1.0, {"v_max": 0.01, "r_v": 2.0}),
        (1.0, {"x_max": 1e-3}),
        (1.05, {"zeta": 0.05}),
        (1.0, {"zeta": 0.05, "v_max": 0.03, "x_max": 4e-3}),
    ],
)
@pytest.mark.parametrize("h", [1e-3, 7e-3, 0.03, 0.4])
def test_events_against_a_fine_integration(demand: float, limits: dict[str, float], h: float) -> None:
    """The instants at which stop or limit are met lie inside steps; the state at each step's end must not show it."""
    n = max(1, min(40, round(0.4 / h)))
    found = run(BLOCK, h, [0.0], limits).play([[demand]] * n)
    for k in sorted({1, n // 3, n // 2, n} - {0}):
        x, v = reference(demand, k * h, **limits)
        # solve_ivp's events are good to about 1e-12 of the travel; a missed one would show as 1e-2
        assert found[k - 1] == pytest.approx((x, v), abs=1e-9 * K), f"after {k} steps"


@settings(max_examples=40)
@given(
    st.floats(-2.0, 2.0), st.floats(-2.5e-3, 2.5e-3), st.floats(-0.04, 0.04), st.floats(0.01, 0.5),
    st.integers(2, 12), st.sampled_from([0.1, 0.545, 1.2]), st.sampled_from([1.0, 0.04]),
    st.sampled_from([1.0, 0.5, 2.0]),
)  # fmt: skip
def test_one_step_equals_many_with_events(
    demand: float, x: float, v: float, h: float, n: int, zeta: float, v_max: float, r_v: float
) -> None:
    """Wherever the instants of the events fall, the way the time is cut does not matter."""
    limits = {"zeta": zeta, "v_max": v_max, "r_v": r_v}
    whole = run(BLOCK, h, [0.0], limits, spool=x, spool_rate=v).step(demand)
    parts = run(BLOCK, h / n, [0.0], limits, spool=x, spool_rate=v).play([[demand]] * n)[-1]
    # near a grazing contact an event of the size of rounding may be seen or not: sqrt(eps) of the travel
    assert whole == pytest.approx(tuple(parts), abs=3e-8 * K * np.array([1.0, W0]).max())


@pytest.mark.parametrize(("limit", "peak"), [("x_max", math.pi), ("v_max", math.acos(ZETA))])
def test_a_limit_met_between_two_samples_that_lie_within_it(limit: str, peak: float) -> None:
    """By half of what the free motion rises there: its position peaks at pi / w, its speed at acos(zeta) / w."""
    at = peak / (W0 * math.sqrt(1 - ZETA**2))
    h = at / (round(at * W0 / 0.85) + 0.5)  # the peak is in the middle of a step shorter than 1 / w0
    before = round(at / h - 0.5)
    k = 0 if limit == "x_max" else 1
    free = run(BLOCK, h / 2, [0.0], {"x_max": 1.0}).play([[1.0]] * (2 * before + 2))[:, k]
    ends = max(free[2 * before - 1], free[2 * before + 1]) if before else free[1]
    most = 0.5 * (ends + free[2 * before])
    assert ends < most < free[2 * before]
    found = run(BLOCK, h, [0.0], {limit: most}).play([[1.0]] * (before + 1))
    assert found[before, k] < most
    assert found[before] == pytest.approx(reference(1.0, (before + 1) * h, **{limit: most}), abs=1e-9 * K)
    # it is seen: without the limit the spool would be elsewhere
    other = run(BLOCK, h, [0.0], {"x_max": 1.0}).play([[1.0]] * (before + 1))
    assert np.abs(found[before] - other[before])[0] > 1e-6 * K


def test_pressed_against_the_stop_it_leaves_when_the_demand_turns() -> None:
    r = run(BLOCK, 0.01, [0.0])
    r.play([[2.0]] * 50)
    assert r.x == (STOP, 0.0)
    assert r.step(0.5)[0] == pytest.approx(reference(0.5, 0.01, x=STOP)[0], rel=1e-10)


def test_the_neutral_may_be_shifted() -> None:
    """dcv.offset: x_0 adds to where the spool rests, the stops stay; it starts at the centre, as the rig does."""
    r = run(BLOCK, 0.5, [0.0], {"x_0": 3e-4})
    assert r.x == (0.0, 0.0)
    assert r.step(0.0)[0] == pytest.approx(3e-4 + reference(0.0, 0.5, x=-3e-4)[0], rel=1e-9)
    r.play([[0.0]] * 4)
    assert r.step(0.0) == pytest.approx((3e-4, 0.0), abs=1e-15)
    assert r.play([[0.5]] * 4)[-1, 0] == pytest.approx(0.5 * K + 3e-4, rel=1e-12)
    assert r.play([[1.0]] * 4)[-1, 0] == STOP


DELAYED = compose(registry.block("dcv"), [registry.effects()["dcv.delay"]])
VARIED = compose(registry.block("dcv"), [registry.effects()["dcv.amplitude_damping"]])


def near(demand: float, t: float, c_a: float, u_a: float, x_max: float = 1.0) -> tuple[float, float]:
    """(spool, speed) after t seconds from rest, damped by zeta (1 + c_a exp(-(e/(u_a K))^2)), up to a stop, by scipy."""
    rest = K * demand

    def rates(_: float, y: np.ndarray) -> list[float]:
        zeta = ZETA * (1.0 + c_a * math.exp(-(((y[0] - rest) / (u_a * K)) ** 2)))
        return [y[1], W0**2 * (rest - y[0]) - 2 * zeta * W0 * y[1]]

    def stop(_: float, y: np.ndarray) -> float:
        return x_max - y[0]

    stop.terminal, stop.direction = True, -1
    now, state = 0.0, np.zeros(2)
    while t - now > 1e-14:
        found = solve_ivp(rates, (now, t), state, "DOP853", rtol=1e-12, atol=1e-15, events=stop)
        now, state = float(found.t[-1]), found.y[:, -1]
        if found.status == 1:
            state = np.array([x_max, 0.0])
    return float(state[0]), float(state[1])


@pytest.mark.parametrize(("c_a", "u_a"), [(1.0, 0.2), (4.0, 0.08), (10.0, 0.8)])
@pytest.mark.parametrize("h", [1e-3, 0.02, 0.3])
def test_damping_that_changes_with_amplitude_against_a_fine_integration(
    c_a: float, u_a: float, h: float
) -> None:
    n = max(1, round(0.3 / h))
    for demand in (0.05, -0.9):
        found = run(VARIED, h, [0.0], {"c_a": c_a, "u_a": u_a}).play([[demand]] * n)
        for k in sorted({1, n // 8, n // 3, n} - {0}):
            exact = near(demand, k * h, c_a, u_a)
            # order 4 in short pieces (5e-6 of the stroke is 1/400 of the sensor's noise), order 2 where a long step would
            # take many of them
            size = (5e-6 if h == 1e-3 else 3e-4) * K * abs(demand) * np.array([1.0, W0])
            assert np.all(np.abs(np.subtract(found[k - 1], exact)) < size), f"after {k} steps"


def test_a_stiff_valve_and_a_long_step_take_few_pieces() -> None:
    """Damping far above 1 and a fast valve: the motion ends at its rest, as it would in short steps."""
    stiff = {"c_a": 10.0, "u_a": 0.5, "w0": 2000.0, "zeta": 3.0}
    short = run(VARIED, 1e-4, [0.0], stiff).play([[0.4]] * 2000)[-1]
    assert run(VARIED, 0.2, [0.0], stiff).step(0.4) == pytest.approx(
        short, abs=1e-6 * K * np.array([1.0, W0]).max()
    )


@pytest.mark.parametrize("h", [1e-3, 0.01])
def test_damping_that_changes_with_amplitude_at_a_stop(h: float) -> None:
    """Near the stop a piece takes the damping of its middle: second order in the piece."""
    for t in (0.08, 0.12, 0.2):
        n = round(t / h)
        found = run(VARIED, h, [0.0], {"c_a": 0.3, "u_a": 0.4, "x_max": 2.4e-3}).play([[1.0]] * n)[-1]
        exact = near(1.0, n * h, 0.3, 0.4, x_max=2.4e-3)
        assert found == pytest.approx(exact, abs=2e-4 * K * W0)
        assert found[0] <= 2.4e-3


def test_without_it_the_valve_is_the_same_to_the_last_bit() -> None:
    demands = np.random.default_rng(8).uniform(-1.2, 1.2, (300, 1))
    assert np.array_equal(run(VARIED, 1e-3, [0.0]).play(demands), run(BLOCK, 1e-3, [0.0]).play(demands))


def test_small_steps_are_damped_more_than_large_ones() -> None:
    """Fig. 5.6 in words: the overshoot of a small step goes, that of a large one hardly changes."""

    def overshoot(demand: float, c_a: float) -> float:
        spool = run(VARIED, 1e-3, [0.0], {"c_a": c_a, "u_a": 0.12, "x_max": 1.0}).play([[demand]] * 400)[:, 0]
        return float(spool.max() / (K * demand) - 1.0)

    assert overshoot(0.05, 1.0) < 1e-3 < overshoot(1.0, 1.0) < overshoot(1.0, 0.0)
    assert overshoot(0.05, 0.0) == pytest.approx(overshoot(1.0, 0.0), rel=1e-9)


@pytest.mark.parametrize("steps", [0.0, 0.25, 1.0, 17.5, 4091.0, 4092.0, 4093.0, 9000.5, 40000.0])
def test_a_delay_of_any_number_of_steps(steps: float) -> None:
    """At 0.1 ms a delay of more than 0.41 s was as long as that and no longer."""
    h, count = 1e-4, int(steps) + 6000
    t = h * np.arange(count)
    demands = 0.5 * np.sin(2.0 * np.pi * 2.0 * t) + 0.3 * (t > 0.1)
    valve = {"w0": 1e5, "zeta": 1.0}  # follows within a step
    spool = run(DELAYED, h, [0.0], {**valve, "tau_d": steps * h}).play(demands[:, None])[:, 0]
    plain = run(BLOCK, h, [0.0], valve).play(demands[:, None])[:, 0]
    expected = np.interp(np.arange(-1, count) - steps, np.arange(-1, count), [0.0, *plain])[1:]
    # where places hold the mean of several steps, an edge is blurred by as many
    sharp = np.abs(h * np.arange(count) - 0.1 - steps * h) > 12.0 * h
    assert spool[sharp] == pytest.approx(expected[sharp], abs=(1e-3 if steps < 20000.0 else 0.01) * K)
    if steps < 4092.0 and steps % 1.0 == 0.0:
        assert spool == pytest.approx(expected, abs=1e-9 * K)
