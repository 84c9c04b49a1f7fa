"""Dry friction is in no FMU of a stranger's: it is told as what is missing at the input against the speed of the output."""

import json
from pathlib import Path

import numpy as np
import systems
from scipy.integrate import solve_ivp

from benchmarks.systems import parts

LEVEL, NOISE = 0.25, 0.003  # of the input; of the reading


def test_dry_friction_is_told_as_a_function_of_the_speed(
    fmus: dict[str, Path], command, tmp_path: Path
) -> None:
    values = systems.VALUES["plant"]
    model = parts.write_ssp(
        tmp_path / "axis.ssp", {"plant": fmus["second"]}, [("command", "plant.u")], {"plant": values}
    )
    rng = np.random.default_rng(6)
    drive = systems.command(rng)
    time = systems.H * np.arange(drive.size)
    k, w, zeta = (values[n] for n in ("K", "W", "ZETA"))

    def rate(t: float, x: np.ndarray) -> list[float]:
        pushed = np.interp(t, time, drive) - LEVEL * np.tanh(x[1] / 0.01)
        return [x[1], w**2 * (k * pushed - x[0]) - 2.0 * zeta * w * x[1]]

    moved = solve_ivp(rate, (0.0, time[-1]), [0.0, 0.0], "LSODA", time, max_step=systems.H).y[0]
    log = tmp_path / "log.csv"
    table = np.column_stack([time, drive, moved + rng.normal(0.0, NOISE, time.size)])
    np.savetxt(log, table, delimiter=",", header="time [s],command [1],plant.y [1]", comments="")
    code, out, err = command("diagnose", log, "--model", model, "--out", tmp_path / "out", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["causes"] == [], "play at the input leaves less than none, and more than friction would"
    (left,) = found["unexplained"]
    missing = left["missing"]
    assert missing["enters_at"] == ["plant.u (input)"]
    assert missing["depends_on"] == "speed of plant.y"
    assert missing["share"] > 0.7
    assert "the speed of plant.y (as friction is)" in left["what"]
    speed, force = np.array(missing["points"]).T
    fast = np.abs(speed) > 0.3 * np.abs(speed).max()
    np.testing.assert_allclose(force[fast], -LEVEL * np.sign(speed[fast]), atol=0.6 * LEVEL)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "What is missing at plant.u against speed of plant.y" in page
