"""A component that integrates makes a wandering of the noise of what drives it: that is no fault, and hides none."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden, read, simulate

KINDS = {"valve": "lag", "tank": "lag", "out": "second"}
# T y' = K u - y with a T far beyond the log: y' = u
VALUES = {
    "valve": {"K": 1.5, "T": 0.08},
    "tank": {"K": 200.0, "T": 200.0},
    "out": {"K": 0.8, "W": 6.0, "ZETA": 0.6},
}
WIRES = [("command", "valve.u"), ("valve.y", "tank.u"), ("tank.y", "out.u")]


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("tank")
    fmus = {name: parts.native(kind, folder) for name, kind in KINDS.items()}
    return parts.write_ssp(folder / "tank.ssp", fmus, WIRES, VALUES)


@pytest.mark.parametrize("gain", [1.0, 1.2], ids=["clean", "gain"])
def test_a_wandering_integral_is_adequate_and_a_gain_before_it_is_named(
    package: Path, command, tmp_path: Path, gain: float
) -> None:
    rng = np.random.default_rng(0)
    hidden = [Hidden("port.gain", "tank.u", "input", {"gain": gain})] if gain != 1.0 else []
    true = simulate(KINDS, VALUES, WIRES, {"command": systems.command(rng, 3000)}, systems.H, hidden)
    signals = read(true, hidden, systems.H, 0.01, rng)
    names = ("command", "valve.y", "tank.y", "out.y")
    table = np.column_stack([systems.H * np.arange(3000), *(signals[n] for n in names)])
    log = tmp_path / "log.csv"
    heading = ",".join(["time [s]", *(f"{n} [1]" for n in names)])
    np.savetxt(log, table, "%.12g", delimiter=",", header=heading, comments="")
    code, out, err = command("diagnose", log, "--model", package, "--out", tmp_path / "o", "--json")
    assert code == 0, err
    found = json.loads(out)
    if not hidden:
        assert found["verdict"] == "adequate"
        return
    (cause,) = found["causes"]
    assert cause["component"] == "tank"
    assert cause["effect"] == "port.gain"
    assert cause["parameters"]["gain"]["value"] == pytest.approx(gain, rel=0.01)
