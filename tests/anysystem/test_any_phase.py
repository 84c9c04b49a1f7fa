"""A free oscillation: whoever starts with another parameter is out of step after some turns, where no slope leads back."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import read, simulate
from cosim.master import Runner

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


BALL = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Ball(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.h, self.v, self.e, self.rests = 1.0, 0.0, 0.7, False
        self.register_variable(Real("h", causality=Fmi2Causality.output))
        self.register_variable(Real("v", causality=Fmi2Causality.output))
        self.register_variable(Real("e", causality=Fmi2Causality.parameter))

    def do_step(self, t, step):
        while step > 0.0 and not self.rests:
            root = (self.v * self.v + 19.62 * max(self.h, 0.0)) ** 0.5
            falls = (self.v + root) / 9.81
            part = min(step, falls)
            self.h += self.v * part - 4.905 * part * part
            self.v -= 9.81 * part
            step -= part
            if part == falls:
                self.h, self.v = 0.0, -self.e * self.v
                if self.v < 0.3:
                    self.v, self.rests = 0.0, True
        return True
"""


def test_a_ball_that_rests_at_the_end_of_the_log_is_followed_from_bounce_to_bounce(
    command, tmp_path: Path
) -> None:
    """Out of step in the middle of the log, where it is off by 7 %, not at its end."""
    parts.by_pythonfmu("Ball", BALL, tmp_path)
    with Runner(tmp_path / "Ball.fmu") as runner:
        true = runner.run(2.99, 0.01, parameters={"Ball.e": 0.75}, record=["Ball.h", "Ball.v"])
    rng = np.random.default_rng(1)
    table = [
        true.time,
        *(true[f"Ball.{n}"] + s * rng.standard_normal(300) for n, s in (("h", 0.003), ("v", 0.015))),
    ]
    log, mapping = tmp_path / "log.csv", tmp_path / "map.toml"
    np.savetxt(log, np.column_stack(table), "%.12g", delimiter=",", header="time,h,v", comments="")
    signals = "".join(f'[signals."Ball.{n}"]\ncolumn = "{n}"\nunit = "1"\n' for n in "hv")
    mapping.write_text(f'[time]\ncolumn = "time"\nunit = "s"\n{signals}[diagnose]\ntrusted = ["Ball.e"]\n')
    code, out, err = command(
        "diagnose",
        log,
        "--model",
        tmp_path / "Ball.fmu",
        "--mapping",
        mapping,
        "--out",
        tmp_path / "o",
        "--json",
    )
    assert code == 0, err
    (cause,) = json.loads(out)["causes"]
    assert (cause["effect"], cause["parameter"]) == ("parameter", "e")
    assert cause["parameters"]["e"]["value"] == pytest.approx(0.75, rel=0.002)
