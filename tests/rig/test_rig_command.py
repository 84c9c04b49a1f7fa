"""The command ``cosim rig`` and the files it writes."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.errors import CosimError, UsageError
from cosim.logs import load_log, load_tracker
from cosim.rig import EFFECTS, as_log, make_log, write, write_tracker
from cosim.rig.parameters import DEG

HEADERS = ["time [s]", "u [1]", "spool [mm]", "p_supply [bar]", "p_a [bar]", "p_b [bar]", "slew [deg]"]
# half of the last digit a file keeps, SI; angles have six decimals of a degree
ROUNDING = {"u": 1e-9, "spool": 0.51e-9, "p_supply": 0.51, "p_a": 0.51, "p_b": 0.51}
SHORT = ["--excitation", "steps", "--duration", "5 s"]


def call(*arguments):
    result = CliRunner().invoke(make_app(), ["rig", *map(str, arguments)])
    if isinstance(result.exception, CosimError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result


def test_csv_has_the_columns_of_the_contract_and_the_mark(tmp_path):
    log = tmp_path / "sub" / "log.csv"
    result = call("--out", log, *SHORT)
    assert "synthetic" in result.stdout
    table = pd.read_csv(log)
    assert list(table.columns) == [*HEADERS, "synthetic [1]"]
    assert (table["synthetic [1]"] == 1).all()
    assert table["time [s]"].tolist() == [round(k * 1e-3, 3) for k in range(5001)]
    run = make_log("steps", 5.0)
    # rounded to 1e-6 mm, 1e-5 bar, 1e-6 deg: a thousandth of the noise or less
    assert np.allclose(table["spool [mm]"], run.spool * 1e3, atol=0.51e-6)
    assert np.allclose(table["p_a [bar]"], run.p_a / 1e5, atol=0.51e-5)
    assert np.allclose(table["slew [deg]"], run.slew / DEG, atol=0.51e-6)


def test_same_seed_same_bytes(tmp_path):
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        call("--out", tmp_path / f"{name}.csv", "--seed", seed, "--hide", "sensor.dropout", *SHORT)
    a, b, c = ((tmp_path / f"{name}.csv").read_bytes() for name in "abc")
    assert a == b != c
    truths = [json.loads((tmp_path / f"{name}.csv.truth.json").read_text()) for name in "ab"]
    assert truths[0] == truths[1]


def test_the_physical_system_by_option(tmp_path):
    result = call("--out", tmp_path / "log.csv", "--model", "physical", "--json", *SHORT)
    assert json.loads(result.stdout)["truth"]["model"] == "physical"
    table = pd.read_csv(tmp_path / "log.csv")
    load = table["p_a [bar]"] - table["p_b [bar]"]
    physical, identified = (
        (run.p_a - run.p_b) / 1e5
        for run in (make_log("steps", 5.0, model=m) for m in ("physical", "full_order"))
    )
    assert np.allclose(load, physical, atol=2e-5)
    assert np.abs(load - identified).max() > 1.0


def test_json_is_one_object_with_paths_and_truth(tmp_path):
    log, tracker = tmp_path / "log.parquet", tmp_path / "tracker.csv"
    hide = ["--hide", "mechanical.coulomb_friction:tau_c=300 N.m", "--hide", "dcv.delay"]
    result = call("--out", log, *hide, "--observer", "--tracker", tracker, "--json", *SHORT)
    found = json.loads(result.stdout)
    assert found["synthetic"] is True
    assert [e["effect"] for e in found["truth"]["hidden"]] == ["mechanical.coulomb_friction", "dcv.delay"]
    assert found["truth"]["hidden"][0]["parameters"]["tau_c"] == {"value": 300.0, "unit": "N.m"}
    assert json.loads((tmp_path / "log.parquet.truth.json").read_text()) == found["truth"]
    table = pd.read_parquet(found["path"])
    assert list(table.columns) == [
        *HEADERS,
        "slew_estimate [deg]",
        "slew_rate_estimate [deg/s]",
        "synthetic [1]",
    ]
    record = pd.read_csv(found["tracker_path"])
    assert list(record.columns) == ["time [s]", "slew_external [deg]", "synthetic [1]"]
    assert len(record) == 401


def test_options_reach_the_log(tmp_path):
    log = tmp_path / "log.csv"
    options = ["--noise", "0", "--start", "30 deg", "--amplitude", "0.5", "--set", "dcv.K=2 mm"]
    call("--out", log, *options, *SHORT)
    table = pd.read_csv(log)
    run = make_log("steps", 5.0, settings={"dcv.K": 2e-3}, noise=0, start=30 * DEG, amplitude=0.5)
    assert table["slew [deg]"][0] == pytest.approx(30.0, abs=1e-9)
    assert np.allclose(table["spool [mm]"], run.spool * 1e3, atol=1e-6)


def test_noise_options_reach_the_log(tmp_path):
    log = tmp_path / "log.csv"
    options = ["--noise-kind", "ar1", "--noise-time", "20 ms", "--noise-size", "slew=0.5 deg"]
    truth = json.loads(call("--out", log, *options, "--json", *SHORT).stdout)["truth"]["noise"]
    assert truth["kind"] == "ar1"
    assert truth["correlation_time"]["value"] == pytest.approx(0.02)
    assert truth["standard_deviation"]["slew"]["value"] == pytest.approx(0.5 * DEG)
    assert truth["standard_deviation"]["p_a"]["value"] == pytest.approx(1e4)


def test_played_log_sets_its_own_length(tmp_path):
    first, second = tmp_path / "first.csv", tmp_path / "second.csv"
    call("--out", first, *SHORT)
    call("--out", second, "--excitation", "file", "--input", first)
    tables = [pd.read_csv(p) for p in (first, second)]
    assert tables[0]["u [1]"].tolist() == tables[1]["u [1]"].tolist()


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mat"])
def test_our_own_reader_takes_every_format(tmp_path, suffix):
    path, record = tmp_path / f"log.{suffix}", tmp_path / f"tracker.{suffix}"
    run = make_log("steps", 3.0, observer=True, tracker=True)
    write(run, path)
    write_tracker(run, record)
    log, tracker = load_log(path), load_tracker(record)
    assert log.synthetic
    assert tracker.synthetic
    assert log.warnings == ()
    assert list(log.signals) == list(run.signals)
    for name, values in run.signals.items():
        assert np.allclose(log[name], values, rtol=0, atol=ROUNDING.get(name, 0.51e-6 * DEG)), name
    assert np.allclose(log.time, run.time, atol=1e-9)
    assert np.allclose(tracker.slew_external, run.tracker[1], rtol=0, atol=0.51e-6 * DEG)


def test_log_in_memory_is_the_run():
    run = make_log("steps", 3.0)
    log = as_log(run)
    assert log.synthetic
    assert np.array_equal(log.p_load, run.p_a - run.p_b)
    assert log.held == {"u"}


def test_effects_are_listed():
    listed = json.loads(call("--effects", "--json").stdout)["effects"]
    assert {row["effect"] for row in listed} == set(EFFECTS)
    delay = next(row for row in listed if row["effect"] == "dcv.delay")
    assert (delay["parameter"], delay["unit"], delay["off"], delay["moderate"]) == ("tau_d", "s", 0.0, 0.02)
    assert "mechanical.backlash\n  gap      0 -> 0.00349066 rad" in call("--effects").stdout


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--hide", "dcv.dellay"], "dcv.delay"),
        (["--set", "mechanical.Q=3"], "unknown parameter"),
        (["--out", "log.txt"], ".csv"),
        (["--noise-size", "slew"], "signal=size"),
        (["--start", "3 s"], "dimension"),
        (["--out", "log.csv", "--tracker", "log.csv"], "two names"),
    ],
)
def test_mistakes_are_usage_errors(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=word):
        call(*arguments, *SHORT)
    assert list(tmp_path.iterdir()) == []


def test_unwritable_place_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        call("--out", tmp_path / "file" / "log.csv", *SHORT)


def test_tracker_must_have_been_asked_for(tmp_path):
    with pytest.raises(UsageError, match="tracker=True"):
        write_tracker(make_log("steps", 3.0), tmp_path / "t.csv")


def test_the_screen_names_what_is_hidden_and_says_what_to_type_next(tmp_path):
    log, tracker = tmp_path / "log.csv", tmp_path / "my tracker.csv"
    words = ("--out", log, "--tracker", tracker, "--model", "physical", "--hide", "sensor.bias", *SHORT)
    told = call(*words).stdout
    assert "hidden in it: a zero error of the slew sensor (sensor.bias)" in told
    last = told.splitlines()[-1]
    assert last == f"Next: cosim diagnose {log} --external '{tracker}' --model physical looks for it"
