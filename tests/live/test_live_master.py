"""The controller's side: what it sends, holds over, counts and records."""

import math
import struct

import numpy as np
import pytest
from live_bench import bench

from cosim.live.link import LATE, STALE
from cosim.live.master import Controller
from cosim.live.operator import Operator
from cosim.logs import load_log
from cosim.rig.sensing import observe


def after(operator, *lines):
    for line in lines:
        operator.obey(line)
    return operator


def test_nothing_is_enabled_before_the_first_sample() -> None:
    with bench(operator=after(Operator(), "u 0.5")) as (master, crane):
        for _ in range(5):
            master.tick()
        assert crane.listen() == [(0.0,) * 6] * 5
        assert master.slot == -1
        crane.sample()
        master.tick()
        assert crane.listen()[0][3] == 1.0


def test_a_manual_command_fades_in_and_stays() -> None:
    with bench(operator=after(Operator(), "u 0.5")) as (master, crane):
        for _ in range(4000):
            crane.sample()
            master.tick()
            crane.listen()
        u = np.array([got[0] for got in crane.got])
        assert u[0] == 0.0
        assert u[500] == pytest.approx(0.5 * (1.0 - math.exp(-1.0)), abs=1e-3)
        assert u[-1] == pytest.approx(0.5, abs=1e-3)
        assert np.abs(np.diff(u)).max() < 0.5 * 1e-3 / 0.5 * 1.01
        assert all(got[1:] == (0.0, 0.0, 1.0, 0.0, 0.0) for got in crane.got)


def test_a_disabled_command_is_0_on_the_wire_and_on_the_log(tmp_path) -> None:
    operator = after(Operator(), "u 0.5", "u2 0.25", "u3 -0.5", "enable 3")
    with bench(tmp_path / "log.csv", operator) as (master, crane):
        for k in range(3000):
            if k == 2000:
                operator.obey("disable 1")
            if k == 2500:
                operator.obey("enable 2")
            crane.sample(12.0 + 1e-4 * k)
            master.tick()
            crane.listen()
    assert crane.got[1999][1:] == (0.0, -0.5, 1.0, 0.0, 1.0)
    assert crane.got[2000] == (0.0, 0.0, -0.5, 0.0, 0.0, 1.0)
    assert crane.got[2500] == (0.0, 0.25, -0.5, 0.0, 1.0, 1.0)
    u = load_log(tmp_path / "log.csv")["u"]
    assert u == pytest.approx(np.array([got[0] for got in crane.got]), abs=1e-9)
    assert (u[2000:] == 0.0).all()


def test_an_emergency_stop_acts_in_the_same_slot_and_holds() -> None:
    operator = after(Operator(), "u 1", "u2 1", "enable 2")
    with bench(operator=operator, played=[0.5] * 10_000) as (master, crane):
        for k in range(300):
            if k == 100:
                operator.obey("stop")
            if k == 200:
                operator.obey("reset")
            crane.sample(12.0 + 1e-4 * k)
            master.tick()
            crane.listen()
        assert crane.got[99][0] > 0.0
        assert all(got == (0.0,) * 6 for got in crane.got[100:200])
        assert all(got[:3] == (0.0, 0.0, 0.0) for got in crane.got[200:]), (
            "a reset does not go on with the old command"
        )


def test_bad_values_are_held_over_and_counted(tmp_path) -> None:
    with bench(tmp_path / "log.csv", after(Operator(), "u 0.2")) as (master, crane):
        for k in range(200):
            slew = 12.0 + 0.01 * k
            if k == 50:
                crane.send(struct.pack("<7f", math.nan, 170.0, 85.0, math.inf, 0.1, 0.0, 0.0))
            elif k == 60:
                crane.send(struct.pack("<7f", 1e30, -400.0, 85.0, 85.0, 0.1, 0.0, 0.0))
            elif k == 70:
                crane.send(b"short")
            elif k == 80:
                crane.send(bytes(29))
                crane.sample(slew)
            else:
                crane.sample(slew, spool=0.1)
            before = master._values[:]
            master.tick()
            if k == 50:
                held = dict(zip(["spool", "p_supply", "p_a", "p_b", "slew"], master._values, strict=True))
                assert held["slew"] == before[4] == pytest.approx(12.49)
                assert held["p_b"] == 85.0
        counts = master.facts()["datagrams"]
    assert (counts["nan"], counts["beyond"], counts["short"], counts["long"]) == (1, 1, 1, 1)
    assert (counts["received"], counts["used"], counts["lost"], counts["held_over"]) == (201, 199, 1, 1)
    log = load_log(tmp_path / "log.csv")
    assert np.flatnonzero(~log.valid_mask("slew")).tolist() == [50, 60, 70]
    assert np.flatnonzero(~log.valid_mask("p_b")).tolist() == [50, 70]
    assert not log.synthetic


def test_nonsense_between_the_samples_moves_none_of_them(tmp_path) -> None:
    with bench(tmp_path / "log.csv") as (master, crane):
        for k in range(300):
            for first in (True, False):
                if (k % 20 == 10 and first) or (k % 20 == 15 and not first):
                    crane.send(struct.pack("<7f", *[math.nan] * 7))
                    crane.send(struct.pack("<7f", *[1e20] * 7))
                if first:
                    crane.sample(10.0 + 0.01 * k)
            master.tick()
        counts = master.facts()["datagrams"]
    assert (counts["received"], counts["used"], counts["nan"], counts["beyond"]) == (360, 300, 30, 30)
    assert (counts["surplus"], counts["late"], counts["lost"]) == (0, 0, 0)
    log = load_log(tmp_path / "log.csv")
    assert log.valid_mask("slew").all()
    assert np.degrees(log["slew"]) == pytest.approx(10.0 + 0.01 * np.arange(300), abs=1e-5)


def test_late_samples_stand_in_their_own_rows(tmp_path) -> None:
    with bench(tmp_path / "log.csv") as (master, crane):
        for k in range(300):
            if not 100 <= k < 130:
                for j in range(100, 130) if k == 130 else ():
                    crane.sample(10.0 + 0.01 * j)
                crane.sample(10.0 + 0.01 * k)
            master.tick()
        assert master.facts()["datagrams"]["late"] == 30
    log = load_log(tmp_path / "log.csv")
    assert log.valid_mask("slew").all()
    assert np.degrees(log["slew"]) == pytest.approx(10.0 + 0.01 * np.arange(300), abs=1e-5)


def test_one_too_many_shifts_no_sample_for_long(tmp_path) -> None:
    """Each sample stands in the row of the command that was decided on it, but for a few after the extra one."""
    with bench(tmp_path / "log.csv") as (master, crane):
        for k in range(300):
            crane.sample(10.0 + 0.01 * k)
            if k == 100:
                crane.sample(11.005)
            master.tick()
        assert master.facts()["datagrams"]["surplus"] == 1
    angle = np.degrees(load_log(tmp_path / "log.csv")["slew"])
    off = np.flatnonzero(np.abs(angle - (10.0 + 0.01 * np.arange(300))) > 1e-5)
    assert off.min() > 100
    assert off.max() <= 101 + LATE


def test_overdue_slots_take_one_sample_each_and_send_nothing(tmp_path) -> None:
    """A pause of ours: the samples wait in the system, and the log has each in its row with the command that was held."""
    with bench(tmp_path / "log.csv", after(Operator(), "u 0.9")) as (master, crane):
        for k in range(100):
            crane.sample(10.0 + 0.01 * k)
            master.tick()
        crane.listen()
        for k in range(100, 150):
            crane.sample(10.0 + 0.01 * k)
        for k in range(100, 150):
            master.tick(overdue=k < 149, due=50)
        assert len(crane.listen()) == 1
        assert master.overrun == 49
        counts = master.facts()["datagrams"]
        assert (counts["used"], counts["late"], counts["lost"], counts["flooded"]) == (150, 0, 0, 0)
    log = load_log(tmp_path / "log.csv")
    assert np.degrees(log["slew"]) == pytest.approx(10.0 + 0.01 * np.arange(150), abs=1e-5)
    assert (log["u"][99:149] == log["u"][99]).all()
    assert log["u"][149] > log["u"][99]


class Turned:
    """A pace on a clock that the test turns; a sample a millisecond comes meanwhile."""

    period = 1e-3

    def __init__(self, crane):
        self.crane, self.now, self.due, self.sent, self.aligned = crane, 0.0, 1e-3, 0, True

    def wait(self, incoming):
        self.turn(max(0.0, self.due - self.now))
        return self.now - self.due

    def turn(self, seconds):
        self.now += seconds
        while self.sent < round(self.now / self.period):
            self.crane.sample(10.0 + 0.01 * self.sent)
            self.sent += 1

    def behind(self):
        return (self.now - self.due) / self.period - 1.0

    def next(self, slots=1):
        self.due += slots * self.period


@pytest.mark.parametrize("where", ["lines", "stop"])
def test_samples_of_a_pause_within_a_slot_are_no_flood(tmp_path, where) -> None:
    """Of those that had come between a look at the clock and one at the socket all but two were dropped."""
    with bench(tmp_path / "log.csv") as (master, crane):
        pace = Turned(crane)

        def held_up(name):
            if name == where and pace.sent == 100:
                pace.turn(0.05)

        master.run(
            pace,
            None,
            lambda: held_up("stop") or ("enough" if pace.sent > 300 else None),
            lambda: held_up("lines"),
        )
        counts = master.facts()["datagrams"]
        assert (counts["received"], counts["used"], counts["flooded"]) == (301, 301, 0)
    log = load_log(tmp_path / "log.csv")
    assert np.degrees(log["slew"]) == pytest.approx(10.0 + 0.01 * np.arange(301), abs=1e-5)


@pytest.mark.parametrize("blind", ["silent", "nan"])
def test_without_a_usable_angle_the_enables_go_off_until_one_comes(blind) -> None:
    with bench(operator=after(Operator(), "u 0.5")) as (master, crane):
        for k in range(100 + 3 * STALE):
            if k < 100 or k >= 100 + 2 * STALE:
                crane.sample(12.0 + 1e-4 * k)
            elif blind == "nan":
                crane.send(struct.pack("<7f", math.nan, 170.0 + 1e-3 * k, 85.0, 85.0, 0.0, 0.0, 0.0))
            master.tick()
            crane.listen()
        enables = [got[3] for got in crane.got]
        assert enables[: 100 + STALE - 1] == [1.0] * (100 + STALE - 1)
        assert enables[100 + STALE - 1 : 100 + 2 * STALE] == [0.0] * (STALE + 1)
        assert enables[100 + 2 * STALE :] == [1.0] * STALE
        assert crane.got[100 + 2 * STALE][0] == 0.0, "it fades in again"
        texts = [event["what"] for event in master.facts()["events"]]
        assert texts == ["the slew angle comes", "no usable slew angle comes", "the slew angle comes"]


def test_the_estimates_are_those_of_the_rigs_own_observer(tmp_path) -> None:
    """The rig holds the angle over a step, the block joins it by straight lines: half a sample apart."""
    rng = np.random.default_rng(3)
    slew = np.radians(12.0) + np.cumsum(rng.normal(0.0, 2e-5, 3000))
    played = 0.6 * np.sign(np.sin(np.arange(3000) / 300.0))
    with bench(tmp_path / "log.csv", played=played.tolist()) as (master, crane):
        for angle in np.degrees(slew):
            crane.sample(angle)
            master.tick()
    log = load_log(tmp_path / "log.csv")
    angle, rate = observe(np.ascontiguousarray(log["u"]), np.ascontiguousarray(log["slew"]))
    travel = float(np.abs(np.diff(slew)).max())
    assert np.abs(log["slew_estimate"] - angle).max() < travel
    assert np.abs(log["slew_rate_estimate"] - rate).max() < 50.0 * travel


def test_a_flood_costs_a_bounded_time_and_no_memory(tmp_path) -> None:
    with bench(tmp_path / "log.csv") as (master, crane):
        for k in range(100):
            for j in range(1000 if k == 50 else 1):
                crane.sample(12.0 + 1e-3 * k + 1e-6 * j)
            master.tick()
        counts = master.facts()["datagrams"]
        assert counts["flooded"] >= 1
        assert counts["received"] == counts["used"] + counts["surplus"] + counts["repeated"]
        assert len(master._ahead) <= 2
        assert not master._link.take()


def test_a_switch_between_manual_and_automatic_is_without_a_bump() -> None:
    control = Controller()
    slew, rate, u = 12.0, 0.0, []
    modes = []
    for k in range(20_000):
        automatic = (k // 2500) % 2 == 1
        modes.append(automatic)
        u.append(control.step(0.3, automatic, 12.0 + 5.0 * (k > 6000), slew, rate))
        # the simplified drive (4.15)
        rate += 1e-3 * (10.0 * u[-1] - 4.4 * rate)
        slew += 1e-3 * rate
    switches = np.flatnonzero(np.diff(modes))
    jumps = np.abs(np.diff(u))
    assert len(switches) == 7
    assert jumps[switches].max() < 5e-3
    assert abs(u[2499] - 0.3) < 0.01, "manual is what was asked for"


def test_automatic_goes_to_its_target_and_stays() -> None:
    control = Controller()
    slew, rate = 12.0, 0.0
    seen = []
    for _ in range(15_000):
        u = control.step(0.0, True, 20.0, slew, rate)
        rate += 1e-3 * (10.0 * u - 4.4 * rate)
        slew += 1e-3 * rate
        seen.append(slew)
    assert seen[-1] == pytest.approx(20.0, abs=0.01)
    assert max(seen) < 20.0 + 0.02 * 8.0, "an overshoot of less than 2 %"


def test_the_end_takes_the_enables_back() -> None:
    with bench(operator=after(Operator(), "u 0.5")) as (master, crane):
        for _ in range(50):
            crane.sample()
            master.tick()
        crane.listen()
        master.end()
        assert crane.listen() == [(0.0,) * 6] * 3


def test_a_script_is_obeyed_in_the_logs_time_and_a_bad_line_is_told() -> None:
    with bench(script=[(0.01, "u 0.5"), (0.02, "stop")]) as (master, crane):
        for _ in range(30):
            crane.sample()
            master.listen(None)
            master.tick()
        master.listen("fly")
        events = [(round(e["time"], 3), e["what"]) for e in master.facts()["events"]]
    assert (0.01, "u 0.5") in events
    assert (0.02, "stop") in events
    assert "'fly' cannot be read" in events[-1][1]
