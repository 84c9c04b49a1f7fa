"""Several logs of one system: other rates, columns that one of them lacks, a fault that came between two of them."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden
from cosim.anysystem.actions import Action
from cosim.anysystem.cuts import cut_by_logs
from cosim.anysystem.read import Recording, read
from cosim.anysystem.readings import stale_of
from cosim.anysystem.search.decisions import SCATTERS, Decisions
from cosim.errors import DataError
from cosim.ssp.read import read_system
from cosim.system.graph import CutGroup

GAIN = [Hidden("port.gain", "valve.y", "output", {"gain": 1.15})]
DEAD_ZONE = [Hidden("port.dead_zone", "plant.u", "input", {"low": -0.2, "high": 0.3})]
ALL = ("command", "valve.y", "plant.y")


def told(command, out: Path, *words) -> dict:
    """The answer of `cosim diagnose`."""
    code, said, err = command("diagnose", *words, "--out", out, "--json")
    assert code == 0, err
    return json.loads(said)


@pytest.mark.parametrize(
    ("columns", "held", "expected"),
    [
        ([ALL, ALL], 0, {"valve": ["valve", "valve"], "plant": ["plant", "plant"]}),
        # the valve by the first, the plant by both
        ([ALL, ("valve.y", "plant.y")], 0, {"valve": ["valve", ""], "plant": ["plant", "plant"]}),
        ([ALL, ("valve.y", "plant.y")], 1, {"valve": ["valve", ""], "plant": ["plant", "plant"]}),
        # each by its own
        (
            [("command", "valve.y"), ("valve.y", "plant.y")],
            0,
            {"valve": ["valve", ""], "plant": ["", "plant"]},
        ),
        # the second has no signal between the two, and judges them as one beside the first, which has
        ([ALL, ("command", "plant.y")], 0, {"valve+plant": ["valve, plant", "valve+plant"]}),
        ([ALL, ("command", "plant.y")], 1, {"valve+plant": ["valve, plant", "valve+plant"]}),
        # none has all that the valve takes: the plant by both, the valve by the first, as one with the plant
        ([("command", "plant.y"), ("valve.y", "plant.y")], 0, {"valve+plant": ["valve+plant", "plant"]}),
        # what only a log held out has cuts nothing
        ([("command", "plant.y"), ALL], 1, {"valve+plant": ["valve+plant", "valve+plant"]}),
        # without what comes in, and what lies between, a log tells nothing that another does not tell better
        ([ALL, ("plant.y",)], 0, {"valve": ["valve", ""], "plant": ["plant", ""]}),
    ],
)
def test_each_log_cuts_the_system_by_what_it_has(native: Path, columns, held: int, expected) -> None:
    logs = [
        Recording(Path(f"{k}.csv"), np.arange(100.0), {n: np.zeros(100) for n in own}, {})
        for k, own in enumerate(columns)
    ]
    with read_system(native) as system:
        found = cut_by_logs(system, logs, held)
    assert {g.name for g in found.groups} == set(expected)
    for name, pieces in expected.items():
        own = found.own[name]
        assert [", ".join(cut_up(own[k])) if k in own else "" for k in range(len(logs))] == pieces


def cut_up(group: CutGroup) -> list[str]:
    """Names of the components of a group; those that a wire joins in one."""
    joined = {w.source.component: w.target.component for w in group.inner}
    return [f"{c}+{joined[c]}" if c in joined else c for c in group.components if c not in joined.values()]


@pytest.mark.parametrize("held", [False, True])
def test_a_log_without_the_signal_in_the_middle_judges_what_lies_around_it(
    native: Path, command, tmp_path: Path, held: bool
) -> None:
    """It says what the gain is, as the other does: without it the valve had one log alone."""
    whole = systems.log(tmp_path / "whole.csv", GAIN, 3)
    lacking = systems.log(tmp_path / "lacking.csv", GAIN, 4, columns=("command", "plant.y"))
    words = (whole, "--held-out", lacking) if held else (whole, lacking)
    found = told(command, tmp_path / "out", *words, "--model", native)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"]) == ("port.gain", "valve")
    assert cause["parameters"]["gain"]["value"] == pytest.approx(1.15, abs=0.01)
    assert set(found["gain"]) == ({"plant.y"} if held else {"valve.y", "plant.y"})  # what held-out data have
    assert len(cause["parameters"]["gain"]["per_log"]) == 2  # both say what it is
    assert found["verdict"] == "explained"
    (said,) = [w for w in found["warnings"] if "lacks" in w]
    assert said == "lacking.csv lacks valve.y: it judges valve and plant as one"
    assert {x["signal"]: x["block"] for x in found["localisation"]} == {
        "valve.y": "valve",
        "plant.y": "plant",
    }


def test_a_log_without_a_column_takes_part_where_it_can(native: Path, command, tmp_path: Path) -> None:
    """The valve is judged by the log that has its command; the plant by both. The fault was "adequate" before."""
    whole = systems.log(tmp_path / "whole.csv", GAIN, 3)
    lacking = systems.log(tmp_path / "lacking.csv", GAIN, 4, columns=("valve.y", "plant.y"))
    found = told(command, tmp_path / "out", whole, "--held-out", lacking, "--model", native)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"]) == ("port.gain", "valve")
    assert cause["parameters"]["gain"]["value"] == pytest.approx(1.15, abs=0.01)
    assert found["verdict"] == "explained"
    assert found["held_out"] == "the logs given to --held-out; of valve every third window"
    (said,) = [w for w in found["warnings"] if "lacks" in w]
    assert said.startswith("lacking.csv lacks command: it takes no part where valve is judged")


def test_a_column_of_the_mapping_that_one_of_several_logs_lacks_is_said(
    native: Path, command, tmp_path: Path
) -> None:
    whole = systems.log(tmp_path / "whole.csv", DEAD_ZONE, 3)
    lacking = systems.log(tmp_path / "lacking.csv", DEAD_ZONE, 4, columns=("command", "valve.y"))
    lines = [f'model = "{native.as_posix()}"', "[time]", 'column = "time"', 'unit = "s"']
    for name in ALL:
        lines += [f'[signals."{name}"]', f'column = "{name}"', 'unit = "1"']
    mapping = tmp_path / "map.toml"
    mapping.write_text("\n".join(lines) + "\n")
    found = told(command, tmp_path / "out", whole, lacking, "--mapping", mapping)
    assert [(c["effect"], c["connector"]) for c in found["causes"]] == [("port.dead_zone", "u")]
    (said,) = [w for w in found["warnings"] if "there is no column" in w]
    assert said.startswith("lacking.csv: ")
    # what no log has is an error of the mapping, as with one log
    code, _, err = command("diagnose", lacking, "--mapping", mapping, "--out", tmp_path / "no")
    assert code == 3
    assert "the mapping takes 'plant.y' from column 'plant.y', which is not there" in " ".join(err.split())


@pytest.mark.parametrize("held", [False, True])
def test_a_fault_that_came_between_two_logs_is_named_with_its_log(
    native: Path, command, tmp_path: Path, held: bool
) -> None:
    before = systems.log(tmp_path / "before.csv", [], 5)
    after = systems.log(tmp_path / "after.csv", DEAD_ZONE, 6)
    words = (before, "--held-out", after) if held else (before, after)
    found = told(command, tmp_path / "out", *words, "--model", native)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["connector"], cause["logs"]) == ("port.dead_zone", "u", ["after.csv"])
    for name, true in DEAD_ZONE[0].values.items():
        assert cause["parameters"][name]["value"] == pytest.approx(true, abs=0.02)
    assert found["verdict"] == "explained"
    assert any(
        w.endswith("in after.csv alone; before.csv shows nothing wrong and contradicts it")
        for w in found["warnings"]
    )


def test_a_fault_of_all_logs_is_not_one_of_some(native: Path, command, tmp_path: Path) -> None:
    """One of them is slower: when it was read within its samples differs, and that is no second fault."""
    logs = [systems.log(tmp_path / f"{k}.csv", GAIN, 7 + k, every=every) for k, every in enumerate((1, 1, 3))]
    found = told(command, tmp_path / "out", *logs[:2], "--held-out", logs[2], "--model", native)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"], cause["logs"]) == ("port.gain", "valve", [])
    assert (found["verdict"], found["unexplained"]) == ("explained", [])
    assert len(cause["parameters"]["gain"]["per_log"]) == 2


def test_a_log_that_does_not_cut_a_loop_leaves_it_to_one_that_does(tmp_path: Path) -> None:
    """Within a loop that is stepped as one no effect is looked for: with that log more could be named without it."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    kinds = {"sum": "sum", "valve": "lag", "tail": "lag"}
    wires = [("command", "sum.u"), ("valve.y", "sum.v2"), ("sum.y", "valve.u"), ("valve.y", "tail.u")]
    fmus = {n: parts.native(k, tmp_path) for n, k in kinds.items()}
    lag = {"K": 1.0, "T": 0.2}
    values = {"sum": {"K": 1.0, "C": -0.4, "T": 0.1}, "valve": lag, "tail": lag}
    package = parts.write_ssp(tmp_path / "loop.ssp", fmus, wires, values)
    columns = [
        ("command", "sum.y", "valve.y", "tail.y"),
        ("command", "tail.y"),
        ("command", "sum.y", "tail.y"),
    ]
    whole, closed, cut = (
        Recording(tmp_path / f"{k}.csv", np.arange(100.0), {n: np.zeros(100) for n in own}, {})
        for k, own in enumerate(columns)
    )
    with read_system(package) as system:
        left = cut_by_logs(system, [whole, closed])
        assert {g.name: set(left.own[g.name]) for g in left.groups} == {"sum": {0}, "valve": {0}, "tail": {0}}
        # where no log cuts it, it is judged as it is
        assert [g.name for g in cut_by_logs(system, [closed]).groups] == ["sum+valve+tail"]
        # one that cuts it elsewhere takes part
        assert set(cut_by_logs(system, [whole, cut]).own["sum+valve+tail"]) == {0, 1}


@pytest.mark.parametrize("held", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_limit_that_is_another_in_each_log_is_named_with_its_interval(
    native: Path, command, tmp_path: Path, held: bool
) -> None:
    """Of one size in all logs nothing explained them, and the plant stayed "unexplained"."""
    sizes = (0.9, 1.15, 1.0)
    logs = [
        systems.log(
            tmp_path / f"{k}.csv",
            [Hidden("port.saturation", "plant.u", "input", {"low": -0.45 * size, "high": 0.5 * size})],
            7 + k,
            every=2,
        )
        for k, size in enumerate(sizes)
    ]
    if held:
        last = [Hidden("port.saturation", "plant.u", "input", {"low": -0.5, "high": 0.55})]
        logs += ["--held-out", systems.log(tmp_path / "held.csv", last, 17, every=2)]
    found = told(command, tmp_path / "out", *logs, "--model", native)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["connector"]) == ("port.saturation", "u")
    assert (found["verdict"], found["unexplained"]) == ("explained", [])
    for name, true in (("low", -0.45), ("high", 0.5)):
        number = cause["parameters"][name]
        # 1 % noise: each log tells its own limit to about a hundredth of it
        assert [x["value"] for x in number["per_log"]][:3] == pytest.approx(
            [true * s for s in sizes], rel=0.03
        )
        low, high = number["ci95"]
        assert low < true * np.mean(sizes) < high
        assert high - low > 0.1 * abs(true)  # three logs that differ by a quarter tell no mean to a per cent


@pytest.mark.slow
def test_a_limit_that_one_of_three_logs_lacks_is_one_of_the_others(
    native: Path, command, tmp_path: Path
) -> None:
    """Sizes that may differ from log to log would else take "none" for a size."""
    logs = [
        systems.log(
            tmp_path / f"{k}.csv",
            [Hidden("port.saturation", "plant.u", "input", {"low": -size, "high": size})] if size else [],
            7 + k,
            every=2,
        )
        for k, size in enumerate((0.45, 0.0, 0.5))
    ]
    found = told(command, tmp_path / "out", *logs, "--model", native)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["logs"]) == ("port.saturation", ["0.csv", "2.csv"])
    assert found["verdict"] == "explained"


def test_a_machine_at_rest_in_one_log_has_no_stale_samples_in_another() -> None:
    rng = np.random.default_rng(11)
    moves, rests = np.cumsum(rng.standard_normal(1000)), np.full(500, 2.0)
    read_there = moves + 0.1 * rng.standard_normal(1000)
    assert stale_of([read_there, rests], [moves, rests]) is None
    stale = read_there[np.maximum.accumulate(np.where(rng.random(1000) < 0.2, 0, np.arange(1000)))]
    found = stale_of([stale, rests], [moves, rests])
    assert found is not None
    assert (found.samples, found.share) == (1000, pytest.approx(0.2, abs=0.04))
    assert list(found.held[1]) == list(range(500))


def test_a_machine_that_stands_as_the_log_begins_has_no_stale_samples() -> None:
    """A crane's pressure stands at one of two readings for fourteen samples: 1.3 % of the log were named stale, surely."""
    rng = np.random.default_rng(3)
    moves = np.cumsum(rng.standard_normal(600))
    begins = np.repeat([0.0, 0.001, 0.0, 0.001], [6, 3, 4, 3])
    assert (
        stale_of([np.concatenate([begins, moves])], [np.concatenate([0.0 * begins + moves[0], moves])])
        is None
    )
    lost = np.maximum.accumulate(np.where(rng.random(600) < 0.03, 0, np.arange(600)))
    assert stale_of([moves[lost]], [moves]) is not None


def test_a_machine_that_shakes_its_sensor_under_way_is_not_stale_where_it_stands() -> None:
    """A car's gyroscope: 0.3 rad/s of noise on the way, none before it starts and after it stops ("5.9 %" was named)."""
    rng = np.random.default_rng(5)
    way = 2.0 * np.sin(np.arange(400) / 15.0)
    under_way = way + 0.3 * rng.standard_normal(400)
    rate = np.concatenate([np.zeros(8), under_way[:188], np.zeros(25), under_way[188:], np.zeros(20)])
    model = np.concatenate([way[:8], way[:188], way[188:213], way[188:], way[-20:]])
    assert stale_of([rate], [model]) is None
    lost = np.maximum.accumulate(np.where(rng.random(rate.size) < 0.1, 0, np.arange(rate.size)))
    found = stale_of([rate[lost]], [model])
    assert found is not None
    assert found.share == pytest.approx(0.1 * 400 / rate.size, rel=0.3)


def test_an_encoder_that_stands_still_between_motions_is_not_stale() -> None:
    """Its model moves all along, as a dead zone that the model lacks lets it."""
    rng = np.random.default_rng(12)
    speed = np.concatenate(
        [np.concatenate([np.zeros(60), 9.0 * s * np.hanning(40)]) for s in rng.choice([-1.0, 1.0], 20)]
    )
    encoder = np.round(np.cumsum(speed + 0.3 * rng.standard_normal(speed.size) * (speed != 0.0)))
    model = np.cumsum(speed + 2.0)
    assert stale_of([encoder], [model]) is None
    lost = np.maximum.accumulate(np.where(rng.random(speed.size) < 0.2, 0, np.arange(speed.size)))
    assert stale_of([np.cumsum(speed + 5.0)[lost]], [model]) is not None


def test_logs_in_different_units_of_a_connector_without_unit_are_brought_to_the_first(
    native: Path, tmp_path: Path
) -> None:
    first = systems.log(tmp_path / "first.csv", GAIN, 3)
    head, *rows = first.read_text().splitlines()
    other = tmp_path / "percent.csv"
    cells = [row.split(",") for row in rows]
    percent = [",".join([t, repr(100.0 * float(u)), *rest]) for t, u, *rest in cells]
    other.write_text("\n".join([head.replace("command [1]", "command [%]"), *percent]) + "\n")
    with read_system(native) as system:
        (one, two), _, _ = read([first, other], system, None)
        assert two.signals["command"] == pytest.approx(one.signals["command"], rel=1e-12)
        alone = read([other], system, None)[0][0]
        assert alone.signals["command"] == pytest.approx(100.0 * one.signals["command"], rel=1e-12)
        other.write_text("\n".join([head.replace("command [1]", "command [mm]"), *rows]) + "\n")
        with pytest.raises(DataError, match=r"'command \[mm\]' is in 'mm', but in the first log in '1'"):
            read([first, other], system, None)


def test_a_cause_that_nothing_but_the_others_told_from_none_goes_with_them(
    native: Path, command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside five others, which held-out data refused, an end of the travel was sure; alone it was -20 to 20 deg."""
    hidden = [*DEAD_ZONE, Hidden("port.offset", "plant.y", "sensor", {"offset": 0.3})]
    logs = [systems.log(tmp_path / f"{k}.csv", hidden, k) for k in (1, 2)]

    def named(out: str) -> dict[str, str]:
        found = told(command, tmp_path / out, *logs, "--model", native)
        refused = {r["effect"].split()[0]: r["why"] for r in found["refused"]}
        return {c["effect"]: "" for c in found["causes"]} | refused

    effects: list[set[str]] = []

    def none_told(self: Decisions, action: Action, between: Mapping[str, object]) -> bool:
        effects.append({n.split("|")[0] for n in between})
        return action.effect == "port.dead_zone" or effects[-1] == {action.effect}

    monkeypatch.setattr(Decisions, "_none_between", none_told)
    assert named("none") == {"port.dead_zone": SCATTERS, "port.offset": SCATTERS}
    assert {"port.offset"} in effects, "asked again once it is alone"
