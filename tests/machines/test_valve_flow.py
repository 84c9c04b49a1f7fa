"""A valve on a test stand: the flow that it lets through in the place of a motion (synthetic)."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.answer.remarks import moved, no_sign
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.lexicon import Lexicon, speaking
from cosim.logs import Log, load_log
from cosim.logs.guess import guesses, mapping_text
from cosim.logs.overview import overview
from cosim.machines import made_for
from cosim.report.names import kind_of_motion
from cosim.report.words import with_signals

OVERLAP, FULL = 0.2, 60.0  # of the command; l/min at full command
HEADS = (
    "Time (s)",
    "Valve current (mA)",
    "Flow (l/min) - Plot 0",
    "Oil temperature (degC)",
    "Flow limit (l/min)",
)


def stand(folder: Path) -> tuple[Path, Log]:
    """A valve with overlap, swept slowly to and fro and in steps; as `cosim init --machine` maps it."""
    t = 0.02 * np.arange(3000)
    rng = np.random.default_rng(4)
    command = np.where(
        t < 30.0, 0.9 * np.sin(2.0 * np.pi * t / 10.0), np.repeat(rng.uniform(-0.9, 0.9, 60), 50)
    )
    open_ = np.sign(command) * np.maximum(np.abs(command) - OVERLAP, 0.0)
    flow, kept = np.zeros_like(t), np.exp(-0.02 / 0.06)
    for k in range(1, t.size):
        flow[k] = kept * flow[k - 1] + (1.0 - kept) * FULL * open_[k - 1]
    flow += rng.normal(0.0, 0.05, t.size)
    limit = np.full(t.size, np.nan)
    limit[:2] = (-80.0, 80.0)  # the axes of the picture that the columns come from
    file = folder / "stand.csv"
    np.savetxt(
        file, np.column_stack([t, 100.0 * command, flow, np.full(t.size, 45.0), limit]), delimiter=",",
        header=",".join(HEADS), comments="", fmt="%.6g",
    )  # fmt: skip
    found = overview(file)
    mapping = folder / "stand.toml"
    mapping.write_text(mapping_text(found, guesses(found, machine=True), None), encoding="utf-8")
    return mapping, load_log(file, mapping)


def test_the_flow_is_taken_for_what_follows_the_command(tmp_path):
    mapping, log = stand(tmp_path)
    assert log.display["flow"] == "l/min"
    text = mapping.read_text(encoding="utf-8")
    assert 'motion = "flow"' in text
    assert 'drive = "electric"' not in text, "a current drives the valve, and oil flows"
    made = made_for(mapping, log, folder=tmp_path / "made")
    assert made.table.signals["flow"].variable == "mechanical.omega"
    assert 0.4 * FULL / 6e4 < made.numbers.speed < FULL / 6e4, "a start for a fit: the overlap biases it"
    assert made.diagnose["units"]["rad/s"] == "m3/s"
    assert "mechanical.coulomb_friction" in made.diagnose["exclude"]
    assert "dead_zone.mismatch" not in made.diagnose["exclude"]


def test_its_overlap_is_found(tmp_path):
    mapping, log = stand(tmp_path)
    machine = machine_of(None, log, mapping)
    with speaking(machine.lexicon):
        found = diagnose([log], model=machine, calibrate=True)
    assert [c.effect.name for c in found.causes] == ["dead_zone.mismatch"]
    cause = found.causes[0]
    assert cause.parameters["b_r"][0] == pytest.approx(OVERLAP / 0.9, rel=0.1)
    assert cause.parameters["b_l"][0] == pytest.approx(-OVERLAP / 0.9, rel=0.1)


def test_its_words_are_those_of_a_flow():
    with speaking(Lexicon(units={"rad": "m3"}, blocks={"mechanical": "flow"})):
        told = with_signals(
            "a missing torque that depends on omega explains 45% of what is systematic in flow"
        )
        assert told == "a missing pressure that depends on flow explains 45% of what is systematic in flow"
        assert kind_of_motion("spool speed") == "spool speed"


def test_a_meter_without_direction_is_remarked_upon(tmp_path):
    mapping, log = stand(tmp_path)
    machine = machine_of(None, log, mapping)
    record = prepare(log, machine)
    assert moved(record, machine) == ("flow", True)
    assert not no_sign(record, machine)
    flow = record.signals["flow"]
    record.signals["flow"] = np.abs(flow)
    (text,) = no_sign(record, machine)
    assert "flow is as large for a negative as for a positive u" in text
    record.signals["flow"] = -np.abs(flow)
    assert no_sign(record, machine), "nor one that counts downwards"
    record.signals["flow"] = np.where(flow > 0.0, flow, 0.1 * flow)
    assert not no_sign(record, machine), "a valve that opens one way only"
    record.signals["u"] = np.abs(record.signals["u"])
    assert not no_sign(record, machine), "driven one way"
