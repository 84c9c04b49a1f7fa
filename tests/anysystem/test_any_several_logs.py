"""Several logs of one system: other rates, columns that one of them lacks, a fault that came between two of them."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems.truth import Hidden
from cosim.anysystem.pipeline import measured
from cosim.anysystem.read import Recording, read
from cosim.anysystem.readings import stale_of
from cosim.errors import DataError
from cosim.ssp.read import read_system

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
        ([ALL, ALL], 0, ALL),
        ([ALL, ("valve.y", "plant.y")], 0, ALL),  # the valve by the first, the plant by both
        ([ALL, ("valve.y", "plant.y")], 1, ALL),
        ([("command", "valve.y"), ("valve.y", "plant.y")], 0, ALL),  # each by its own
        # none has all that the valve takes: valve and plant are one, by the first
        ([("command", "plant.y"), ("valve.y", "plant.y")], 0, ("command", "plant.y")),
        # what only a log held out has cuts nothing
        ([("command", "plant.y"), ALL], 1, ("command", "plant.y")),
    ],
)
def test_the_system_is_cut_where_each_group_has_a_log_with_all_its_signals(
    native: Path, columns, held: int, expected
) -> None:
    logs = [
        Recording(Path(f"{k}.csv"), np.arange(100.0), {n: np.zeros(100) for n in own}, {})
        for k, own in enumerate(columns)
    ]
    with read_system(native) as system:
        assert measured(system, logs, held) == sorted(expected)


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
