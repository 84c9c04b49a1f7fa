"""A cylinder's axis as engineers model it: what another log bears out, what its numbers cannot be told from, dense logs."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.systems import parts
from cosim.anysystem.answer import calibrated, gains, nominal
from cosim.anysystem.model import Segment
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import AnyDiagnosis, diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.anysystem.search import extended
from cosim.anysystem.thin import thinned
from cosim.ssp.read import read_system
from cosim.system.effects import EFFECTS
from cosim.system.runs import Runs

VALUES = {
    "neutral": 0.0,
    "dz_up": 0.1,
    "dz_down": 0.1,
    "k_up": 1.0,
    "k_down": 1.0,
    "lag": 0.1,
    "start": 0.0,
    "end": 8.0,
}
STATED = {k: v for k, v in VALUES.items() if k not in ("start", "neutral")}


def build(folder: Path) -> None:
    """``axis.fmu``."""
    parameters = {name: (k + 2, value) for k, (name, value) in enumerate(VALUES.items())}
    starts = "STARTS=" + ",".join(map(repr, VALUES.values()))
    binary = parts.library(Path(__file__).with_name("axis.c"), folder, starts)
    parts.packed(folder, "axis", parts.described("axis", {"u": 1}, parameters), binary)


@pytest.fixture(scope="module")
def axis(made_once) -> Path:
    """The FMU."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    return made_once("cylinder_axis", build) / "axis.fmu"


def moved(u, h: float, changed: Mapping[str, float], bent: float = 0.0):
    """The axis solved exactly over each step; `bent` is how much faster it is per unit of travel, as a linkage makes it."""
    p = {**VALUES, **changed}
    x, v, found = 0.0, 0.0, np.zeros(u.size)
    fade = np.exp(-h / p["lag"])
    for k in range(u.size - 1):
        found[k] = x
        over = u[k] - p["neutral"]
        goal = p["k_up"] * max(over - p["dz_up"], 0.0) + p["k_down"] * min(over + p["dz_down"], 0.0)
        goal *= 1.0 + bent * x
        x = min(x + goal * h + (v - goal) * p["lag"] * (1.0 - fade), p["end"])
        v = goal + (v - goal) * fade
    found[-1] = x
    return found


def steps(seed: int, count: int, h: float, size: float = 1.0):
    """Commands held for a second or so each, up more than down."""
    rng = np.random.default_rng(seed)
    hold = max(round(1.2 / h), 1)
    return np.repeat(rng.uniform(-0.7 * size, size, count // hold + 1), hold)[:count]


def recording(t, u, y) -> Recording:
    signals = {"axis.u": u, "axis.y": y}
    columns = {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
    return Recording(Path("log.csv"), t, signals, columns, held=frozenset({"axis.u"}))


def diagnosed(axis: Path, logs: list[Recording], trusted, held: int = 0) -> AnyDiagnosis:
    options = AnyOptions(trusted=dict.fromkeys((f"axis.{n}" for n in trusted), 0.01))
    with read_system(axis) as system, Runs(system, apart=False) as runs:
        return diagnose_system(system, logs, runs, options, held=held)


def log(seed: int, changed: Mapping[str, float], h: float = 0.02, count: int = 1600, bent: float = 0.0):
    """The axis with 0.3 % noise, for half a minute where `h` is large."""
    u = steps(seed, count, h)
    y = moved(u, h, changed, bent)
    noise = 0.003 * np.std(y) * np.random.default_rng(seed + 100).standard_normal(count)
    return recording(h * np.arange(count), u, y + noise)


@pytest.mark.slow
def test_a_neutral_is_not_told_from_the_dead_zone_on_one_side(axis: Path) -> None:
    """Two break points are three numbers; what they leave is refitted with the exchange."""
    found = diagnosed(axis, [log(3, {"neutral": 0.25, "dz_down": 0.3})], [*STATED, "neutral"])
    ((_, finding),) = found.findings.items()
    names = {str(a.port): {str(b.port) for b in finding.alike[a]} | {str(a.port)} for a in finding.named}
    points = {"axis.neutral", "axis.dz_up", "axis.dz_down"}
    assert len(names) == 2
    assert set(names) < points | {"axis.u"}  # where an offset is a neutral of its own
    assert set().union(*names.values()) >= points
    at = finding.chosen.fit.values
    number = {n: at.get(f"parameter|axis.{n}", VALUES[n]) for n in ("neutral", "dz_up", "dz_down")}
    assert number["neutral"] + number["dz_up"] == pytest.approx(0.35, abs=0.01)
    assert number["neutral"] - number["dz_down"] == pytest.approx(-0.05, abs=0.01)


@pytest.mark.slow
def test_logs_of_one_duty_each_show_nothing_wrong_by_themselves_only(axis: Path) -> None:
    """Two free numbers tell any speed: that each log agrees with some of them says nothing of which log is at fault."""
    logs = []
    for k, duty in enumerate((0.3, 0.5, 0.7, 0.9)):
        u = np.where(np.arange(500) < 25, 0.0, duty)
        y = moved(
            np.minimum(u, 0.6), 0.02, {}, bent=0.5 * (duty == 0.9)
        )  # the spool goes no further; a linkage in one
        noise = 0.003 * np.random.default_rng(k).standard_normal(u.size)
        logs.append(recording(0.02 * np.arange(u.size), u, y + noise))
    options = AnyOptions(free=("axis.dz_up", "axis.k_up", "axis.lag"), exclude=tuple(EFFECTS))
    with read_system(axis) as system, Runs(system, apart=False) as runs:
        found = diagnose_system(system, logs, runs, options)
    (finding,) = found.findings.values()
    assert finding.unexplained
    assert not any("nothing wrong" in note for note in found.notes)


def test_readings_between_uneven_stamps_are_not_stale(axis: Path) -> None:
    """Straight lines between them hide the steps of an encoder that stands still half of the time."""
    fine = log(5, {"k_up": 1.3}, h=0.01, count=3000)
    rng = np.random.default_rng(6)
    stamps = np.cumsum(rng.uniform(0.03, 0.07, 700))
    stamps = stamps[stamps < fine.time[-1]]
    near = np.rint(stamps / 0.01).astype(int)
    u, y = (fine.signals[n][near] for n in ("axis.u", "axis.y"))
    y = np.interp(np.round(y / 0.04), [0.0, 60.0, 200.0], [0.0, 2.3, 8.1])  # its steps are not all the same
    found = diagnosed(axis, [recording(near * 0.01, u, y)], STATED)
    effects = {action.effect for _, action in found.causes()}
    assert "port.dropout" not in effects


def test_a_log_that_is_sampled_too_fast_is_taken_at_fewer_samples(axis: Path) -> None:
    count, h = 30000, 0.001
    changed = {"dz_up": 0.3}
    found = diagnosed(axis, [log(7, changed, h, count)], STATED)
    (segment,) = found.segments
    assert 0.004 <= segment.h <= 0.01
    assert segment.count * segment.h == pytest.approx(count * h, rel=1e-3)
    assert any("sampled far faster" in note for note in found.notes)
    ((_, action),) = found.causes()
    assert str(action.port) == "axis.dz_up"
    (finding,) = found.findings.values()
    assert finding.chosen.fit.values["parameter|axis.dz_up"] == pytest.approx(0.3, rel=0.03)


def test_what_is_held_stays_held_at_fewer_samples() -> None:
    """A mean of the samples around would act half of the longer interval too late."""
    u = np.arange(6000.0) // 700
    segment = Segment(
        0.0,
        0.001,
        {"u": u, "gear": u, "y": u},
        np.ones(6000, dtype=bool),
        np.zeros(6000, dtype=np.int64),
        steps=frozenset({"u"}),
    )
    fewer = thinned(segment, 2, {"gear": False})
    assert fewer.h == 0.002
    assert fewer.signals["u"] == pytest.approx(u.reshape(-1, 2).mean(axis=1))
    assert fewer.signals["gear"] == pytest.approx(u[::2])
    assert fewer.signals["y"][350] == pytest.approx(0.75)  # a quarter of what was just before the step
    assert fewer.reading("u") is u


def test_a_short_log_beside_a_dense_one_keeps_its_samples(axis: Path) -> None:
    changed = {"dz_up": 0.3}
    found = diagnosed(axis, [log(7, changed, 0.001, 12000), log(8, changed, 0.02, 1000)], STATED)
    dense, short = found.segments
    assert dense.h > 0.002
    assert short.h == 0.02
    assert sum("sampled far faster" in note for note in found.notes) == 1
    assert [str(action.port) for _, action in found.causes()] == ["axis.dz_up"]


def test_a_log_with_lost_samples_is_taken_as_it_is(axis: Path) -> None:
    """A sample that repeats the last one is seen in the log's own samples alone."""
    count, h = 8000, 0.005
    whole = log(8, {}, h, count)
    rng = np.random.default_rng(9)
    y = whole.signals["axis.y"].copy()
    for k in np.flatnonzero(rng.uniform(size=count) < 0.1)[1:]:
        y[k] = y[k - 1]
    found = diagnosed(axis, [replace(whole, signals={**whole.signals, "axis.y": y})], STATED)
    (segment,) = found.segments
    assert segment.h == h
    assert "port.dropout" in {action.effect for _, action in found.causes()}


def test_init_says_what_may_be_held(axis: Path, command, tmp_path: Path) -> None:
    for name, u in (("steps", steps(4, 600, 0.02)), ("moves", np.sin(0.02 * np.arange(600)))):
        file = tmp_path / f"{name}.csv"
        rows = np.column_stack([0.02 * np.arange(600), u, moved(u, 0.02, {})])
        np.savetxt(file, rows, delimiter=",", header="time [s],axis.u,axis.y", comments="", fmt="%.5f")
        assert command("init", axis, file)[0] == 0
    assert "\nheld = true" in (tmp_path / "steps.toml").read_text()
    assert "\n# held = true" in (tmp_path / "moves.toml").read_text()


def test_calibrating_says_what_it_gains(axis: Path) -> None:
    logs = [log(s, {"k_up": 1.4, "dz_down": 0.2}) for s in (11, 12)]
    options = AnyOptions(trusted=dict.fromkeys((f"axis.{n}" for n in STATED), 0.01))
    with read_system(axis) as system, Runs(system, apart=False) as runs:
        found = diagnose_system(system, logs, runs, options, held=1, calibrate=True)
        (gain,) = calibrated(found).values()
    assert found.verdict == "adequate"
    assert gain.rmse_fitted < 0.05 * gain.rmse_stated
    assert gain.ci95_of_ratio[1] < 0.1


def test_errors_told_are_those_of_the_extended_model(axis: Path) -> None:
    """A dead zone that is off by no more than its tolerance is no cause, but a drive that integrates drifts by it."""
    logs = [log(s, {"k_up": 1.4, "dz_up": 0.103}) for s in (21, 22)]
    options = AnyOptions(trusted=dict.fromkeys((f"axis.{n}" for n in STATED), 0.01))
    with read_system(axis) as system, Runs(system, apart=False) as runs:
        found = diagnose_system(system, logs, runs, options, held=1)
        (finding,) = found.findings.values()
        assert [str(a.port) for a in finding.named] == ["axis.k_up"]
        value, _ = finding.settled["axis.dz_up"]
        assert 0.101 < value <= 0.103
        (gain,) = gains(found).values()
        plain = finding.chosen.fit.values
        held = finding.model.segments[1]
        raw = [
            float(np.sqrt(np.mean((held.signals["axis.y"] - finding.model(v)["axis.y#1"]) ** 2)))
            for v in (plain, extended(finding, finding.fitted))
        ]
        told = nominal(found)["axis.dz_up"]
    assert (told.value, told.instead_of) == (value, 0.1)
    # the moment at which the log was read is taken out of what is told, and of nothing else
    assert gain.rmse_after == pytest.approx(raw[1], rel=0.05)
    assert gain.rmse_after < 0.7 * raw[0]


def test_fitted_numbers_are_in_the_extended_model(axis: Path, command, tmp_path: Path) -> None:
    for seed in (11, 12):
        one = log(seed, {"k_up": 1.4})
        rows = np.column_stack([one.time, one.signals["axis.u"], one.signals["axis.y"]])
        np.savetxt(
            tmp_path / f"{seed}.csv", rows, delimiter=",", header="time [s],u,axis.y", comments="", fmt="%.6f"
        )
    (tmp_path / "map.toml").write_text(
        "[time]\ncolumn = 'time [s]'\nunit = 's'\n[signals.u]\ncolumn = 'u'\nunit = '1'\nheld = true\n"
        "[signals.'axis.y']\ncolumn = 'axis.y'\nunit = '1'\n[diagnose]\ntrusted = { 'axis.k_up' = '1 %' }\n"
    )
    words = (tmp_path / "11.csv", "--held-out", tmp_path / "12.csv", "--mapping", tmp_path / "map.toml")
    code, said, err = command(
        "diagnose", *words, "--model", axis, "--calibrate", "--out", tmp_path / "out", "--json"
    )
    assert code == 0, err
    found = json.loads(said)
    assert (found["verdict"], found["causes"]) == ("adequate", [])
    (number,) = re.findall(
        r'name="axis\.k_up".*?value="([^"]+)"', (tmp_path / "out" / "extended.ssv").read_text(), re.S
    )
    assert float(number) == found["nominal"]["axis.k_up"]["value"] == pytest.approx(1.4, rel=0.01)
    assert found["extended"]["ssp"].endswith("extended.ssp")
