"""A free oscillation: whoever starts with another parameter is out of step after some turns, where no slope leads back."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import read, simulate

VALUES = {"K": 1.0, "W": 9.0, "ZETA": 0.002}
COUNT = 2000


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("ring")
    fmus = {"bell": parts.native("second", folder)}
    return parts.write_ssp(folder / "ring.ssp", fmus, [("command", "bell.u")], {"bell": VALUES})


@pytest.mark.parametrize(("factor", "named"), [(1.06, True), (1.012, False)], ids=["off", "trusted"])
def test_a_parameter_that_is_out_of_step_is_found_from_the_start_of_the_log(
    package: Path, command, tmp_path: Path, factor: float, named: bool
) -> None:
    """Some turns out of step at the end; within what is trusted it is no cause, and nothing stays unexplained."""
    rng = np.random.default_rng(5)
    struck = {"command": np.where(np.arange(COUNT) < 20, 1.0, 0.0)}
    values = {"bell": {**VALUES, "W": factor * VALUES["W"]}}
    true = simulate({"bell": "second"}, values, [("command", "bell.u")], struck, systems.H, [])
    readings = read(true, [], systems.H, 0.01, rng)
    log = tmp_path / "log.csv"
    table = np.column_stack([systems.H * np.arange(COUNT), readings["command"], readings["bell.y"]])
    np.savetxt(log, table, "%.12g", delimiter=",", header="time,command,bell.y", comments="")
    mapping = tmp_path / "map.toml"
    signals = "".join(f'[signals."{n}"]\ncolumn = "{n}"\nunit = "1"\n' for n in ("command", "bell.y"))
    trusted = '[diagnose]\ntrusted = ["bell.W", "bell.K"]\n'
    mapping.write_text(f'[time]\ncolumn = "time"\nunit = "s"\n{signals}{trusted}')
    words = ("diagnose", log, "--model", package, "--mapping", mapping, "--out", tmp_path / "o", "--json")
    code, out, err = command(*words)
    assert code == 0, err
    found = json.loads(out)
    if not named:
        assert (found["verdict"], found["causes"]) == ("adequate", [])
        return
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"], cause["parameter"]) == ("parameter", "bell", "W")
    assert cause["parameters"]["W"]["value"] == pytest.approx(factor * VALUES["W"], rel=0.002)
