"""From the command line: FMUs by strangers are calibrated at their own speed; the tracker's record beside a log."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from cosim.logs import write_log
from cosim.rig import as_log, make_log, write_tracker
from cosim.ssp.parameters import read_ssv

GAIN, LAG, NOISE = 2.6, 0.45, 2e-3
MAPPING = """
model = "toy.ssp"
[time]
column = "t"
unit = "s"
[signals.push]
column = "push"
unit = "m"
[signals.place]
column = "place"
unit = "m"
[compare.signals.push]
variable = "push"
[compare.signals.place]
variable = "lag.y"
"""


@pytest.fixture(scope="module")
def toys():
    """The small FMUs by strangers that the master is tested with."""
    path = Path(__file__).parents[1] / "master" / "toy_fmus.py"
    spec = importlib.util.spec_from_file_location("toys_for_calibration", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def machine(toys, tmp_path_factory):
    """A gain and a lag as an SSP, a log of 8 s of the same with other values and noise, and its mapping."""
    folder = tmp_path_factory.mktemp("toy")
    fmus = {kind: toys.build(kind, folder) for kind in ("gain", "lag")}
    wires = ["push -> g.u", "g.y -> lag.u", "lag.y -> place"]
    units = dict.fromkeys(("push", "place", "g.u", "g.y", "lag.u", "lag.y"), "m")
    toys.pack(folder / "toy.ssp", toys.ssd({"g": "gain", "lag": "lag"}, wires, units=units), fmus)
    t = np.arange(1601) * 5e-3
    push = np.interp(t, [0, 1, 2, 4, 5, 6, 8], [0, 0, 0.1, 0.1, -0.05, 0.08, 0])
    place = lsim(([GAIN], [LAG, 1.0]), push, t)[1] + NOISE * np.random.default_rng(2).standard_normal(t.size)
    rows = "\n".join(f"{a:.3f},{b!r},{c!r}" for a, b, c in zip(t, push.tolist(), place.tolist(), strict=True))
    (folder / "log.csv").write_text(f"t,push,place\n{rows}\n")
    (folder / "toy.toml").write_text(MAPPING)
    return folder


@pytest.fixture
def run(command):
    return command


def test_parameters_of_foreign_fmus_are_found(run, machine, tmp_path):
    words = ["compare", machine / "log.csv", "--mapping", machine / "toy.toml", "--json"]
    free = ["--free", "g.k=0.5:10", "--free", "lag.T=0.05:5"]
    code, out, err = run(*words, "--calibrate", *free, "--starts", "2", "--out", tmp_path)
    assert code == 0, err + out
    result = json.loads(out)
    found = result["calibration"]
    assert found["engine"] == "fmu"
    for one, truth in zip(found["parameters"], (GAIN, LAG), strict=True):
        low, high = one["ci95"]
        assert low < truth < high, one
        assert high - low < 0.02 * truth
    assert found["signals"]["place"]["held_out_after"]["rmse"] == pytest.approx(NOISE, rel=0.1)
    kept = {v.name: v.value for v in read_ssv(Path(result["files"]["calibrated"]))}
    assert kept["g.k"] == found["parameters"][0]["value"]
    _, again, _ = run(*words, "--parameter-set", result["files"]["calibrated"])
    assert json.loads(again)["signals"]["place"]["rmse"] == pytest.approx(NOISE, rel=0.1)


def test_a_foreign_parameter_that_does_not_exist_is_named(run, machine):
    words = ["compare", machine / "log.csv", "--mapping", machine / "toy.toml", "--json"]
    code, out, _ = run(*words, "--calibrate", "--free", "lag.tau=0.05:5")
    assert code == 2
    assert "lag.T" in json.loads(out)["error"]


@pytest.mark.slow
def test_the_tracker_beside_a_log(run, tmp_path, built):
    hidden = ["tracker.clock:offset=3.2 s,rate=1.0003", "sensor.gain:gain=0.98"]
    made = make_log("mixed", 30.0, hidden, seed=5, tracker=True, start=np.radians(9.0))
    log, record = tmp_path / "log.parquet", tmp_path / "tracker.csv"
    write_log(as_log(made), log)
    write_tracker(made, record)
    code, out, err = run("compare", log, "--external", record, "--json", "--out", tmp_path / "out")
    assert code == 0, err + out
    found = json.loads(out)
    estimates = {p["name"]: p for p in found["tracker"]["parameters"]}
    for name, truth in (("tracker.offset", 3.2), ("tracker.rate", 1.0003), ("sensor.gain", 0.98)):
        one = estimates[name]
        assert abs(one["value"] - truth) < 4.0 * one["deviation"], one  # four standard deviations
        assert one["accepted"], one
    assert (tmp_path / "out" / "tracker.png").stat().st_size > 10_000
