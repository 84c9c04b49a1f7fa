"""``cosim identify``: its subcommands, files and refusals; and the .ssv runs in the model."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.errors import CosimError, DataError, UsageError
from cosim.identify.answer import write_ssv
from cosim.identify.estimate import Quantity
from cosim.identify.nominal import nominal
from cosim.logs import write_log
from cosim.paths import ssp_folder
from cosim.rig import as_log, make_log
from cosim.ssp import read_ssv
from cosim.ssp.write import write_ssp


def call(*arguments):
    result = CliRunner().invoke(make_app(), ["identify", *map(str, arguments)])
    if isinstance(result.exception, CosimError):
        raise result.exception
    assert result.exit_code == 0, (result.output, result.exception)
    return result


@pytest.fixture(scope="module")
def log(noisy, tmp_path_factory):
    return write_log(noisy, tmp_path_factory.mktemp("identify") / "log.parquet")


@pytest.fixture(scope="module")
def ramp_file(ramp_log, tmp_path_factory):
    return write_log(ramp_log(), tmp_path_factory.mktemp("ramp") / "ramp.parquet")


def test_values_run_in_the_model(log, undrawn, tmp_path):
    """The .ssv of a log goes into the SSP as it is, and its values are those the simulation reports."""
    out = tmp_path / "all"
    found = json.loads(call("all", log, "--out", out, "--json").stdout)
    assert found["synthetic"]
    values = {v.name: v.value for v in read_ssv(out / "all.ssv")}
    assert values == {name: item["value"] for name, item in found["parameters"].items()}
    package = write_ssp(ssp_folder() / "full_order.ssd", tmp_path / "full_order_open.ssp", open=True)
    command = pd.DataFrame({"time [s]": [0.0, 0.5, 1.0], "u [1]": [0.0, 0.5, 0.5]})
    command.to_csv(tmp_path / "u.csv", index=False)
    arguments = [
        "simulate",
        package,
        "--parameter-set",
        out / "all.ssv",
        "--input",
        tmp_path / "u.csv",
        "--json",
    ]
    result = CliRunner().invoke(make_app(), [*map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    simulated = json.loads(result.stdout)
    for name, value in values.items():
        assert simulated["parameters"][name] == pytest.approx(value, rel=1e-12), name
    assert simulated["signals"]["dcv.spool"]["final"] == pytest.approx(0.5 * 2.375, rel=0.05)


def test_dead_zone_writes_everything(ramp_file, tmp_path):
    off = ["--set", "compensator.d_plus=0", "--set", "compensator.d_minus=0"]
    result = call("dead-zone", ramp_file, *off, "--out", tmp_path)
    assert "dead_zone.b_r" in result.stdout
    assert {p.name for p in tmp_path.iterdir()} == {"dead_zone.ssv", "dead_zone.png", "dead_zone.json"}
    found = json.loads((tmp_path / "dead_zone.json").read_text())
    assert found["compensator"]["d_plus"] == pytest.approx(0.45, abs=2e-3)
    assert found["compensator"]["d_minus"] == pytest.approx(0.40, abs=2e-3)
    low, high = found["sides"]["right"]["break_point"]["ci95"]
    assert low < 0.451
    assert high > 0.449


def test_transfer_functions_of_two_logs(log, mixed, tmp_path):
    """The rows of Table 4.4: each log alone, and all data; BIC and held-out fit beside the fit."""
    second = write_log(mixed(2), tmp_path / "second.parquet")
    arguments = [
        "transfer-function",
        log,
        second,
        "--block",
        "continuity",
        "--order",
        "1/0",
        "--order",
        "2/1",
    ]
    found = json.loads(call(*arguments, "--json", "--out", tmp_path / "out").stdout)
    assert [row["log"] for row in found["by_log"]] == ["log", "second", "all data"]
    assert found["chosen"] == "TF1"
    assert found["parameters"]["continuity.T"]["value"] == pytest.approx(0.11, rel=0.02)
    assert {"best_fit_percent", "held_out_percent", "bic"} <= set(found["candidates"][0])
    assert (tmp_path / "out" / "transfer_function.png").stat().st_size > 10_000


def test_any_two_signals(log):
    found = json.loads(
        call(
            "transfer-function", log, "--input", "spool", "--output", "slew", "--order", "3/0", "--json"
        ).stdout
    )
    assert found["candidates"][0]["integrators"] == 1
    rates = sorted(pole["rate"]["value"] for pole in found["model"]["poles"])
    assert rates == pytest.approx([9.09, 34.9], rel=0.2)
    assert found["parameters"] == {}


def test_experiment_then_frequency_response(undrawn, tmp_path):
    """What a user does: write the experiment, play it, read it back."""
    command = tmp_path / "sine.csv"
    band = ["--low", "2 rad/s", "--high", "9 Hz", "--count", "14"]
    made = json.loads(call("experiment", "sine", *band, "--out", command, "--json").stdout)
    table = pd.read_csv(command)
    assert len(table) == pytest.approx(made["duration"]["value"] * 1000)
    log = write_log(as_log(make_log(table["u [1]"].to_numpy())), tmp_path / "played.parquet")
    found = json.loads(call("frf", log, "--block", "dcv", "--out", tmp_path / "out", "--json").stdout)
    w = np.array(found["points"]["frequency"]["value"])
    assert w[0] == pytest.approx(2.0, rel=1e-4)
    assert w[-1] == pytest.approx(2 * np.pi * 9.0, rel=1e-4)
    assert found["parameters"]["dcv.w0"]["value"] == pytest.approx(25.23, rel=0.01)
    points = pd.read_csv(tmp_path / "out" / "frf.csv")
    assert points.columns[0] == "frequency [rad/s]"
    assert len(points) == 14
    assert (tmp_path / "out" / "frf.ssv").is_file()


def test_observer_without_a_log(tmp_path):
    result = call("observer", "--out", tmp_path)
    assert "L = [7.744, 6.16]" in result.stdout
    names = {v.name for v in read_ssv(tmp_path / "observer.ssv")}
    assert names == {f"observer.{n}" for n in ("a", "k", "c", "p1", "p2")}
    placed = json.loads(call("observer", "--pole", "-20", "--pole", "-9", "--json").stdout)
    assert placed["observer_poles"] == [-20.0, -9.0]


def test_scaling_prints_the_channels(tmp_path):
    result = call("scaling", "--disc-radius", "400 mm", "--out", tmp_path)
    assert "3.5 mm a volt, zero at 2.5 V" in result.stdout
    assert (tmp_path / "scaling.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        (["transfer-function", "LOG", "--order", "2-0"], UsageError, "should read poles/zeros"),
        (["transfer-function", "LOG", "--set", "dcv.k=1"], UsageError, "did you mean K"),
        (["transfer-function", "LOG", "--set", "dvc.K=1 mm"], UsageError, "did you mean dcv"),
        (["dead-zone", "LOG", "--response", "p_a"], UsageError, "choose spool, p_load, slew"),
        (["dead-zone", "LOG", "--filter", "700 Hz"], UsageError, "half the sampling rate, 500 Hz"),
        (["dead-zone", "LOG", "--from", "soon"], UsageError, "--from"),
        (["frf", "LOG", "--method", "fft"], UsageError, "stepped or welch"),
        (["frf", "LOG", "--low", "3 m"], UsageError, "--low"),
        (["experiment", "ramp", "--out", "ramp.txt"], UsageError, "written as .csv"),
        (["all", "nowhere.csv"], DataError, "no such file"),
    ],
)
def test_bad_requests_are_refused_in_words(arguments, kind, message, log):
    with pytest.raises(kind, match=message):
        call(*[log if word == "LOG" else word for word in arguments])


def test_values_the_model_cannot_take_are_not_written(tmp_path):
    with pytest.raises(UsageError, match=r"dcv.zeta came out as -0.2 1, outside 0 .. 100"):
        write_ssv({"dcv.zeta": Quantity(-0.2, 0.01, 50.0)}, tmp_path / "x.ssv")


def test_settings_replace_nominal_numbers():
    known = nominal(["dcv.K=2.4 mm", "compensator.d_plus=0"])
    assert known["dcv.K"] == pytest.approx(2.4e-3)
    assert known["compensator.d_plus"] == 0.0
    assert known["dcv.w0"] == 25.23


@pytest.mark.parametrize(
    "words", [("--block", "dcv"), ("--input", "u", "--output", "spool", "--order", "2/0")]
)
def test_a_transfer_function_is_told_in_sentences_before_any_table(words, log):
    told = call("transfer-function", log, *words).stdout
    assert told.splitlines()[1].startswith(
        "Transfer function from the command (u) to the spool position (spool): 2 poles, 0 zeros"
    )
    assert told.splitlines()[2].startswith(
        "How sure: on the last 30 % of the log, which its fit has not seen, "
    )
    assert told.splitlines()[-1].startswith("Next: ")
    assert "candidates (* chosen)" not in told
    if "--input" in words:
        pair = told.splitlines()[-2]
        assert pair.startswith("pair of poles: natural frequency 25.")
        assert re.search(r"damping ratio 0\.5\d+ ± 0\.0\d+$", pair), "a ratio has no unit"
        assert "candidates (* chosen)" in call("transfer-function", log, *words, "--verbose").stdout


def test_a_frequency_response_is_told_in_sentences_and_its_points_on_demand(log):
    words = ("frf", log, "--input", "p_load", "--output", "slew", "--order", "2/0", "--method", "welch")
    told = call(*words).stdout
    first, sure, *_, pole, following = told.splitlines()[1:]
    assert first.startswith("Frequency response from the load pressure (p_load) to the slew angle (slew): ")
    assert "by Welch's method in log; a fit with 2 poles (1 at 0), 0 zeros follows" in first
    assert sure.startswith("How sure: half of the points are good to ")
    assert pole.startswith("pole: ")
    assert following.startswith("Next: --out DIR writes the points")
    assert "phase deg" not in told
    assert "phase deg" in call(*words, "--verbose").stdout


def test_a_scaling_is_told_in_sentences_and_hands_its_mapping_on(undrawn, tmp_path):
    told = call("scaling", "--point", "spool=3.248 V:2.6 mm", "--point", "spool=1.769 V:-2.6 mm").stdout
    assert re.search(
        r"spool position \(spool\): 3.5159 mm a volt, zero at 2.50\d+ V: 2 measured points", told
    )
    assert "How sure: spool from 2 points" in told
    assert "source  " not in told
    assert told.splitlines()[-1].startswith("Next: name a log recorded in volts")
    assert "source  " in call("scaling", "--verbose").stdout
    volts = tmp_path / "volts.csv"
    volts.write_text("time [s],u [V],spool [V]\n0,0,2.5\n0.001,3,3.2\n0.002,3,3.3\n")
    told = call("scaling", volts, "--out", tmp_path / "out").stdout
    mapping = tmp_path / "out" / "mapping.toml"
    assert (
        told.splitlines()[-1] == f"Next: cosim info {volts} --mapping {mapping} shows the log in these units"
    )
