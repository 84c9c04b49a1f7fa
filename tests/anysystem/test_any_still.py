"""An input that keeps one value, a supply or a tank: what limits or delays it does nothing, another value of it does."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import read, simulate
from cosim.anysystem.actions import Reach, acts
from cosim.system.effects import EFFECTS


@pytest.mark.parametrize(
    ("value", "effects"),
    [(5e6, {"port.gain", "port.offset"}), (-0.3, {"port.gain", "port.offset"}), (0.0, set())],
)
def test_of_a_series_with_one_value_only_that_value_can_be_wrong(value: float, effects: set[str]) -> None:
    reach = Reach.of(np.full(500, value), 0.01)
    assert {e for e in EFFECTS if acts(e, reach)} == effects


def test_of_a_series_that_moves_everything_can_be_wrong() -> None:
    reach = Reach.of(5e6 + np.sin(np.arange(500.0)), 0.01)
    assert {e for e in EFFECTS if acts(e, reach)} == set(EFFECTS)


def test_another_value_of_a_constant_input_is_found_and_declared_alike(command, tmp_path: Path) -> None:
    """The sum hears 2.6 where the log says 2: a gain of 1.3 and an offset of 0.6 are one thing."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    values = {"sum": {"K": 1.0, "C": 0.8, "T": 0.2}}
    wires = [("command", "sum.u"), ("supply", "sum.v2")]
    package = parts.write_ssp(
        tmp_path / "s.ssp", {"sum": parts.native("sum", tmp_path)}, wires, values, ["command", "supply"]
    )
    rng = np.random.default_rng(4)
    count = 1500
    driven = {"command": systems.command(rng, count), "supply": np.full(count, 2.6)}
    true = simulate({"sum": "sum"}, values, wires, driven, systems.H, [])
    readings = read({"sum.y": true["sum.y"]}, [], systems.H, 0.01, rng)
    table = np.column_stack(
        [systems.H * np.arange(count), driven["command"], np.full(count, 2.0), readings["sum.y"]]
    )
    log = tmp_path / "log.csv"
    header = "time [s],command [1],supply [1],sum.y [1]"
    np.savetxt(log, table, "%.12g", delimiter=",", header=header, comments="")
    code, out, err = command("diagnose", log, "--model", package, "--out", tmp_path / "o", "--json")
    assert code == 0, err
    (cause,) = json.loads(out)["causes"]
    told = {
        f"{cause['effect']} at sum.{cause['connector']} ({cause['where']})",
        *cause["indistinguishable_from"],
    }
    assert {"port.gain at sum.v2 (input)", "port.offset at sum.v2 (input)"} <= told
