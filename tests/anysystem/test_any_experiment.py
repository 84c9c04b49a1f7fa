"""What a log could not have shown is said, and the run that would show it, or tell two explanations apart, is proposed."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems.truth import Hidden, read, simulate

DELAY = Hidden("port.delay", "plant.u", "input", {"delay": 0.06})


def log(path: Path, command: np.ndarray, hidden: list[Hidden]) -> Path:
    """A log of the system on a command."""
    rng = np.random.default_rng(1)
    true = simulate(systems.KINDS, systems.VALUES, systems.WIRES, {"command": command}, systems.H, hidden)
    signals = read(true, hidden, systems.H, 0.01, rng)
    names = ("command", "valve.y", "plant.y")
    table = np.column_stack([systems.H * np.arange(command.size), *(signals[n] for n in names)])
    heading = ",".join(["time [s]", *(f"{n} [1]" for n in names)])
    np.savetxt(path, table, "%.12g", delimiter=",", header=heading, comments="")
    return path


def diagnosed(command, path: Path, model: Path, out: Path) -> dict:
    code, told, err = command("diagnose", path, "--model", model, "--out", out, "--json")
    assert code == 0, err
    return json.loads(told)


def alike(found: dict) -> set[str]:
    """Effects that the only cause may be."""
    (cause,) = found["causes"]
    return {cause["effect"], *(text.partition(" ")[0] for text in cause["indistinguishable_from"])}


def test_the_proposed_run_tells_apart_what_a_slow_log_could_not(
    native: Path, command, tmp_path: Path
) -> None:
    t = systems.H * np.arange(systems.COUNT)
    slow = log(tmp_path / "slow.csv", 0.5 * np.sin(2 * np.pi * 0.1 * t), [DELAY])
    found = diagnosed(command, slow, native, tmp_path / "one")
    assert alike(found) == {"port.delay", "port.lag"}
    proposed = found["next_experiment"]
    assert proposed["excitation"]["input"] == "command"
    assert "port.lag" in proposed["why"]
    assert proposed["predicted_gain"] > 6.0
    page = (tmp_path / "one" / "report.html").read_text()
    assert proposed["excitation"]["shape"] in page
    file = Path(proposed["file"])
    assert file.read_text().splitlines()[0] == "time [s],command [1]"
    played = np.loadtxt(file, delimiter=",", skiprows=1)
    assert np.abs(played[:, 1]).max() <= 0.5 + 1e-6  # no more than the log itself reached
    better = log(tmp_path / "better.csv", played[:, 1], [DELAY])
    found = diagnosed(command, better, native, tmp_path / "two")
    assert alike(found) == {"port.delay"}


@pytest.mark.parametrize("moves", [False, True], ids=["constant", "moving"])
def test_what_a_constant_command_could_not_show_is_said(
    native: Path, command, tmp_path: Path, moves: bool
) -> None:
    still = np.full(systems.COUNT, 0.4)
    path = log(tmp_path / "log.csv", systems.command(np.random.default_rng(3)) if moves else still, [])
    found = diagnosed(command, path, native, tmp_path / "out")
    assert found["verdict"] == "adequate"
    never = found["not_exercised"]
    assert ("port.rate_limit at valve.u (input)" in never) == (not moves)
    assert ("port.delay at valve.u (input)" in never) == (not moves)
    assert "port.gain at valve.u (input)" not in never
