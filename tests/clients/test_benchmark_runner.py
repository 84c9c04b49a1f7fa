"""The benchmark: its exact solution against the source's transfer function, and a short run of the whole."""

import json
import math
import sys

import numpy as np
import pytest
from scipy.signal import TransferFunction, cont2discrete, dlsim

from benchmarks import runner
from cosim.ssp.stimulus import default_command


def test_exact_solution_is_the_source_s_transfer_function():
    """(5.12) has four digits; the command is large enough for the compensator's tanh to be 1."""
    times = np.arange(6001) * 1e-3
    command = np.where(times < 3.0, 0.5, -0.25)
    denominator = [1.0, 71.5, 2164.0, 3.673e4, 2.02e5, 0.0]
    system = TransferFunction([4.582e5], denominator)
    a, b, c, d, h = cont2discrete(
        (system.to_ss().A, system.to_ss().B, system.to_ss().C, system.to_ss().D), 1e-3, "zoh"
    )
    _, expected, _ = dlsim((a, b, c, d, h), command)
    found = np.degrees(runner.exact_theta(times, command))
    assert np.max(np.abs(found - expected[:, 0])) < 2e-3 * np.ptp(expected)


def test_exact_solution_refuses_a_command_that_reaches_the_stop():
    times = np.arange(2001) * 1e-3
    with pytest.raises(AssertionError, match="stop"):
        runner.exact_theta(times, np.where(times < 1.0, 1.0, -1.0))


def test_small_commands_are_compensated_up_to_tanh():
    times, command = default_command(6.0)
    theta = runner.exact_theta(times, command)
    assert math.degrees(np.ptp(theta)) == pytest.approx(
        2.0 * 0.5 * 2.27, rel=0.05
    )  # gain 2.27 deg/s, 1 rad/s


@pytest.mark.slow
def test_short_run_writes_figures_and_our_runner_is_the_most_exact(tmp_path, monkeypatch, capsys):
    file = tmp_path / "figures.json"
    words = [
        "runner.py",
        "--duration",
        "1",
        "--repeat",
        "1",
        "--only",
        "cosim",
        runner.SIX,
        "fmpy simulate_ssp",
        "--json",
        str(file),
    ]
    monkeypatch.setattr(sys, "argv", words)
    assert runner.main() == 0
    figures = json.loads(file.read_text())
    rows = {row["label"]: row for row in figures["rows"]}
    assert set(rows) == {"cosim", runner.SIX, "fmpy simulate_ssp"}
    assert rows["cosim"]["error_deg"] < 1e-5  # second order in the step
    assert rows[runner.SIX]["error_deg"] == pytest.approx(rows["cosim"]["error_deg"], rel=1e-6)
    assert rows["fmpy simulate_ssp"]["error_deg"] > 1e-4  # one step of delay for each wire
    assert rows["cosim"]["ratio"] == 1.0
    assert figures["machine"]["pythonfmu"] == "0.7.0"
    assert "max error" in capsys.readouterr().out
