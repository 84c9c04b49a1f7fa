"""``cosim compare`` and ``cosim demo``: tables, JSON, pictures, thresholds, exit codes."""

import contextlib
import io
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from cosim.cli import main
from cosim.logs import write_log
from cosim.paths import examples_folder
from cosim.report.earlier import COMPARED

DEMO = examples_folder() / "synthetic_demo.csv"
NUMBERS = {"unit", "rmse", "fit_percent", "max_error", "max_error_time", "rmse_windows", "offset", "noise_floor",
           "error_to_noise", "constant", "samples"}  # fmt: skip


@pytest.fixture
def run(command, built):
    return command


@pytest.fixture(scope="module")
def log_file(rig_log, tmp_path_factory):
    """Dry friction hidden, 4 s."""
    path = tmp_path_factory.mktemp("logs") / "friction.parquet"
    write_log(rig_log("mechanical.coulomb_friction:tau_c=150 N.m", seconds=4.0), path)
    return path


@pytest.fixture(scope="module")
def compared(log_file, place, tmp_path_factory):
    """What one comparison with its files prints."""
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out):
        patch.setenv("COSIM_BUILD", str(place))
        with pytest.raises(SystemExit) as stop:
            main(["compare", str(log_file), "--json", "--out", str(tmp_path_factory.mktemp("compared"))])
    assert stop.value.code == 0
    return out.getvalue()


def test_json_has_all_and_no_arrays(compared):
    result = json.loads(compared)
    assert set(result) == {"log", "model", "command", "signals", "blocks", "not_judged", "window", "notes",
                           "thresholds", "files"}  # fmt: skip
    assert result["log"]["synthetic"] is True
    assert result["model"]["name"] == "full_order"
    assert set(result["signals"]) == {"spool", "p_load", "p_a", "p_b", "p_supply", "slew"}
    for block in result["blocks"]:
        assert set(block) == {"block", "components", "driven_by", "signals"}
        for numbers in block["signals"].values():
            assert set(numbers) == NUMBERS
    slew = result["signals"]["slew"]
    assert slew["unit"] == "deg"
    assert 0.01 < slew["rmse"] < slew["max_error"] < 5.0
    assert result["signals"]["p_supply"]["constant"]
    assert len(compared) < 20_000  # arrays are in the files


def test_series_hold_what_the_table_is_made_of(run, log_file, compared, undrawn, tmp_path):
    result = json.loads(compared)
    series = pd.read_parquet(result["files"]["series"])
    error = series["slew_measured [deg]"] - series["slew_simulated [deg]"]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(result["signals"]["slew"]["rmse"], rel=1e-9)
    block = series["slew_measured [deg]"] - series["slew_by_block [deg]"]
    assert np.sqrt(np.mean(block**2)) == pytest.approx(
        result["blocks"][-1]["signals"]["slew"]["rmse"], rel=1e-9
    )
    _, out, _ = run("compare", log_file, "--json", "--out", tmp_path, "--csv")
    table = pd.read_csv(json.loads(out)["files"]["series"])
    np.testing.assert_allclose(table.to_numpy(), series.to_numpy(), rtol=1e-12)


def test_an_earlier_comparison_is_said_and_leaves_nothing_behind(run, log_file, undrawn, tmp_path):
    _, out, _ = run("compare", log_file, "--json", "--out", tmp_path, "--csv")
    assert {Path(file).name for file in json.loads(out)["files"].values()} <= set(COMPARED)
    _, _, err = run("compare", log_file, "--json", "--out", tmp_path)
    assert "holds an earlier comparison (3 files): its files are replaced" in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["blocks.png", "series.parquet", "signals.png"]


def test_pictures_show_something(compared):
    for name in ("signals", "blocks"):
        picture = imread(json.loads(compared)["files"][name])[..., :3]
        assert min(picture.shape[:2]) > 500
        assert 0.02 < np.mean(picture.min(axis=2) < 0.9) < 0.8  # ink, and background left


def test_figures_have_an_axis_pair_for_each_signal(clean, packages):
    from cosim.compare import Comparator
    from cosim.compare.picture import blocks_figure, signals_figure

    with Comparator(clean, packages["full_order"]) as comparator:
        comparison = comparator.run()
    figure = signals_figure(comparison)
    assert len(figure.axes) == 2 * len(comparison.signals)
    assert "synthetic log" in figure.get_suptitle()
    labels = {axes.get_ylabel() for axes in figure.axes}
    assert {"slew [deg]", "spool [mm]", "error [deg]"} <= labels
    lines = next(axes for axes in figure.axes if axes.get_ylabel() == "slew [deg]").lines
    np.testing.assert_allclose(lines[0].get_ydata(), np.degrees(clean["slew"]))
    blocks = blocks_figure(comparison)
    assert len(blocks.axes) == sum(len(block.signals) for block in comparison.blocks)


def test_tables_fit_a_narrow_terminal(run, log_file):
    code, out, _ = run("compare", log_file, "--verbose")
    assert code == 0
    assert "Signals (model driven by the command alone)" in out
    assert "Blocks (each driven by what was measured)" in out
    tables = out.split("Signals (")[1].split("* root")[0]
    assert max(map(len, tables.splitlines())) <= 80
    assert "…" not in tables
    assert re.search(r"Largest block error against noise: mechanical \+ sensor, in slew", out)
    assert "Not judged: observer" in out
    assert "synthetic log" in out


def test_the_answer_is_a_few_lines(run, log_file):
    code, out, _ = run("compare", log_file, "--set", "mechanical.b=10000")
    said = out.splitlines()
    assert code == 0
    assert len(said) <= 7
    assert "synthetic log" in said[0]
    assert re.match(
        r"Most wrong: slew angle \(slew\): [\d.]+ deg RMSE, fit .* %, [\d.]+ times its noise", said[1]
    )
    assert said[2].startswith(
        "It arises in: mechanical + sensor, driven by load pressure (p_load), in the slew angle (slew): "
    )
    assert any(line.startswith("Within noise: ") and "spool position (spool)" in line for line in said)
    assert any(line.startswith("Not judged: observer") for line in said)
    assert said[-1].startswith(f"Next: cosim diagnose {log_file}")


@pytest.mark.parametrize(("limit", "code"), [("10 deg", 0), ("0.001 deg", 1), ("0.5", 0), ("1e-6", 1)])
def test_threshold_sets_the_exit_code(run, log_file, limit, code):
    found, out, _ = run(
        "compare", log_file, "--threshold", f"slew={limit}", "--threshold=spool=1mm", "--json"
    )
    assert found == code
    results = {item["signal"]: item for item in json.loads(out)["thresholds"]}
    assert results["slew"]["passed"] is (code == 0)
    assert results["slew"]["unit"] == "deg"
    assert results["spool"]["passed"] is True


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--threshold", "slew"], 2, "should read signal=value"),
        (["--threshold", "slow=1deg"], 2, "'slow' is not compared (closest: 'slew')"),
        (["--threshold", "slew=1bar"], 2, "--threshold slew"),
        (["--threshold", "slew=-1deg"], 2, "negative"),
        (["--model", "full"], 2, "'full' is no model"),
        (["--model", "x.ssv"], 2, "--parameter-set"),
        (["--model", "missing.ssp"], 3, "there is no model 'missing.ssp'"),
        (["--set", "mechanical.K=1"], 2, "mechanical.K"),
        (["--step-size", "1 m"], 2, "s"),
        (["--step-size", "0"], 2, "positive"),
        (["--mapping", "missing.toml"], 3, "missing.toml"),
    ],
)
def test_wrong_requests_are_refused(run, log_file, words, code, message):
    found, out, err = run("compare", log_file, *words, "--json")
    assert found == code
    assert message in json.loads(out)["error"]
    assert "Traceback" not in err


def test_missing_log_is_bad_data(run, tmp_path):
    code, _, err = run("compare", tmp_path / "no.csv")
    assert code == 3
    assert "no.csv" in err


def test_parameters_come_from_set_and_file(run, log_file, tmp_path):
    file = tmp_path / "p.ssv"
    file.write_text(
        '<ssv:ParameterSet version="1.0" name="p" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">'
        '<ssv:Parameters><ssv:Parameter name="mechanical.tau_c"><ssv:Real value="100"/></ssv:Parameter></ssv:Parameters>'
        "</ssv:ParameterSet>"
    )
    errors = []
    for words in (
        [],
        ["--parameter-set", file],
        ["--parameter-set", file, "--set", "mechanical.tau_c=150 N.m"],
    ):
        _, out, _ = run("compare", log_file, *words, "--json")
        errors.append(json.loads(out)["signals"]["slew"]["rmse"])
    assert errors[0] > 1.5 * errors[1] > 1.5 * errors[2]
    assert errors[2] < 0.02


def test_a_model_of_ours_is_built_on_demand(run, log_file, tmp_path, monkeypatch):
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path))
    code, out, _ = run("compare", log_file, "--model", "simplified", "--json")
    assert code == 0
    assert (tmp_path / "ssp" / "simplified_open.ssp").is_file()
    assert json.loads(out)["signals"].keys() == {"slew"}


def test_folder_that_cannot_be_written_is_named(run, log_file, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, err = run("compare", log_file, "--out", tmp_path / "file" / "x")
    assert code == 2
    assert "cannot write into" in err


@pytest.mark.usefixtures("undrawn")  # what a picture shows: test_pictures_show_something
def test_demo_builds_and_finds_the_hidden_friction(run, tmp_path, monkeypatch):
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path))
    code, out, err = run("demo", "--json")
    result = json.loads(out)
    assert code == 0
    assert "synthetic" in err
    assert result["log"]["synthetic"] is True
    ratios = {b["block"]: max(s["error_to_noise"] for s in b["signals"].values()) for b in result["blocks"]}
    assert ratios.pop("mechanical + sensor") > 5.0
    assert all(ratio < 1.2 for ratio in ratios.values())
    assert [cause["effect"] for cause in result["diagnosis"]["causes"]] == ["mechanical.coulomb_friction"]
    low, high = result["diagnosis"]["causes"][0]["parameters"]["tau_c"]["ci95"]
    assert low < 100.0 < high  # N.m, what the rig has hidden
    assert (tmp_path / "demo" / "report.html").is_file()
    assert (tmp_path / "demo" / "signals.png").is_file()
    assert (tmp_path / "fmus" / "dcv.fmu").is_file()
    assert (tmp_path / "ssp" / "physical.ssp").is_file()
