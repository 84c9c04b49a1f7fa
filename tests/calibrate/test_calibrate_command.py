"""``cosim compare --calibrate`` as a user runs it: the .ssv serves, the JSON says all, errors help."""

import json
import re
from pathlib import Path

import pytest
from matplotlib.image import imread

from cosim.logs import write_log
from cosim.ssp.parameters import read_ssv


@pytest.fixture
def run(command, built):
    return command


@pytest.fixture(scope="module")
def log_file(rig_log, tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "heavy.parquet"
    write_log(rig_log(settings={"mechanical.J": 900.0}, observer=True), path)
    return path


def test_the_parameter_set_gives_the_calibrated_model(run, log_file, tmp_path):
    words = ["--calibrate", "--free", "mechanical.J", "--free", "dcv.K=2:3 mm", "--starts", "1"]
    code, out, _ = run(
        "compare", log_file, *words, "--set", "mechanical.b=26700", "--json", "--out", tmp_path
    )
    result = json.loads(out)
    found = result["calibration"]
    assert code == 0
    J = found["parameters"][0]
    assert J["name"] == "mechanical.J"
    assert J["unit"] == "kg.m2"
    assert J["ci95"][0] < 900.0 < J["ci95"][1]
    assert found["engine"] == "compiled"
    assert found["held_out"]["from"] == pytest.approx(4.2, abs=0.01)
    files = result["files"]
    assert {v.name: v.value for v in read_ssv(Path(files["calibrated"]))}["mechanical.b"] == 26700.0
    assert (
        json.loads(Path(files["calibration"]).read_text(encoding="utf-8"))["parameters"]
        == found["parameters"]
    )
    picture = imread(files["calibration_picture"])[..., :3]
    assert min(picture.shape[:2]) > 500
    _, again, _ = run("compare", log_file, "--parameter-set", files["calibrated"], "--json")
    for name, numbers in json.loads(again)["signals"].items():
        assert numbers["rmse"] == pytest.approx(result["signals"][name]["rmse"], rel=1e-9), name


def test_tables_say_what_was_found(run, log_file, undrawn, tmp_path):
    words = [
        "--calibrate",
        "--free",
        "mechanical.A",
        "--free",
        "mechanical.r",
        "--starts",
        "2",
        "--out",
        tmp_path,
        "--verbose",
    ]
    code, out, _ = run("compare", log_file, *words)
    assert code == 0
    assert "Calibrated parameters" in out
    assert "not determined" in out
    assert "mechanical.A, mechanical.r only together" in out
    assert "2 of 2 starts" in out
    tables = out.split("Calibrated parameters")[1].split("Not determined:")[0]
    assert max(map(len, tables.splitlines())) <= 80


def test_a_calibration_in_a_line_for_each_parameter(run, log_file, undrawn, tmp_path):
    words = ("--calibrate", "--free", "mechanical.b", "--starts", "1", "--out", tmp_path)
    code, out, _ = run("compare", log_file, *words, "--set", "mechanical.b=20000")
    assert code == 0
    assert re.search(
        r"^Calibrated: mechanical.b = [\d.]+ N m s/rad, [\d.]+ to [\d.]+ \(95 %\); it was 20000 N m s/rad$",
        out,
        re.M,
    ), out
    said = r"^Better: error of the slew angle \(slew\) on held-out data falls from [\d.]+ to [\d.]+ deg$"
    assert re.search(said, out, re.M), out
    assert re.search(r"^Unchanged on held-out data: spool position \(spool\)", out, re.M), (
        out
    )  # b acts behind it
    assert "Calibrated parameters" not in out


def test_a_mapping_can_say_what_is_free(run, log_file, undrawn, tmp_path):
    mapping = tmp_path / "m.toml"
    mapping.write_text(
        'model = "full_order"\n[time]\ncolumn = "time"\nunit = "s"\n'
        '[signals.u]\ncolumn = "u"\nunit = "1"\n[signals.slew]\ncolumn = "slew"\nunit = "deg"\n'
        '[compare.calibrate]\nfree = ["mechanical.J=500:1500 kg.m2"]\nfit_to = ["slew"]\n'
    )
    code, out, err = run("compare", log_file, "--mapping", mapping, "--calibrate", "--starts", "1", "--json",
                         "--out", tmp_path)  # fmt: skip
    assert code == 0, err + out
    found = json.loads(out)["calibration"]
    assert [p["name"] for p in found["parameters"]] == ["mechanical.J"]
    assert found["parameters"][0]["bounds"] == [500.0, 1500.0]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--free", "mechanical.J"], 2, "add --calibrate"),
        (["--calibrate", "--free", "mechanical.Jay"], 2, "closest: 'mechanical.J'"),
        (["--calibrate", "--free", "mechanical.theta"], 2, "not a parameter"),
        (["--calibrate", "--free", "dcv.K=3:2 mm"], 2, "empty"),
        (["--calibrate", "--starts", "0"], 2, "at least 1"),
        (["--calibrate", "--held-out", "2"], 2, "between 0 and 0.9"),
        (["--calibrate", "--held-out", "no.csv"], 3, "no.csv"),
        (["--calibrate", "--fit-to", "slow"], 2, "closest: 'slew'"),
    ],
)
def test_wrong_requests_are_refused(run, log_file, words, code, message):
    found, out, err = run("compare", log_file, *words, "--json")
    assert found == code
    assert message in json.loads(out)["error"]
    assert "Traceback" not in err


def test_observer_on_the_log(run, log_file, tmp_path):
    code, out, _ = run("compare", log_file, "--observer", "--json", "--out", tmp_path)
    found = json.loads(out)
    assert code == 0
    traces = {(t["estimate"], t["against"]): t for t in found["observer"]["traces"]}
    logged = traces["slew_estimate", "logged"]
    assert logged["unit"] == "deg"
    assert logged["rmse"] < 0.002  # a fifth of the sensor's noise
    assert traces["slew_rate_estimate", "logged"]["fit_percent"] > 99.5
    assert traces["slew_rate_estimate", "derivative of the measured slew"]["error_of_reference"] < 0.05
    assert found["observer"]["real_time_factor"] > 1.0
    assert imread(found["files"]["observer"]).shape[0] > 400
    _, text, _ = run("compare", log_file, "--observer")
    assert "Observer: its slew angle is " in text
