"""The static curve of the drive beside a diagnosis, in its JSON and in its report."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.answer.curve import curve_of
from cosim.diagnosis.answer.schema import Answer
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.held_out.causes import Held
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.groups import merged
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.identify.drive_fit import static
from cosim.lexicon import Lexicon, Shown, speaking
from cosim.logs import load_log
from cosim.report import drive
from cosim.report.material import Material
from cosim.report.picture import figure
from fmus.registry import effects

MACHINE = """
name = "small drive"
time = { column = "t", unit = "s" }
[signals]
u = { column = "duty", unit = "1", zero = 7.5, gain = 0.4 }
slew = { column = "angle", unit = "rad" }
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
"""
TRUTH = np.array([-0.2, 0.25, 1.4, 1.8, -0.75, 0.8])


def diagnosed(folder: Path) -> tuple[Diagnosis, object]:
    """A diagnosis of which nothing is searched yet, and its log."""
    rng = np.random.default_rng(3)
    command = np.repeat(rng.uniform(-1.0, 1.0, 60), 30)
    angle = np.concatenate([[0.0], np.cumsum(static(command, TRUTH) * 0.05)[:-1]])
    table = np.column_stack([0.05 * np.arange(command.size), 7.5 + command / 0.4, angle])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,duty,angle", comments="", fmt="%.9g")
    (folder / "machine.toml").write_text(MACHINE)
    log = load_log(folder / "log.csv", folder / "machine.toml")
    machine = machine_of(None, log, folder / "machine.toml")
    record = prepare(log, machine)
    return Diagnosis("interrupted", record, machine, merged(machine.groups, record.signals)), log


def test_dead_zone_and_top_speed_stand_in_the_answer(tmp_path):
    found, log = diagnosed(tmp_path)
    curve = curve_of(found, log)
    assert curve is not None
    assert curve.dead_zone["high"].reading is not None
    assert curve.dead_zone["high"].reading.value == pytest.approx(7.5 + 0.25 / 0.4, abs=0.03)
    unit = {"deg/s": np.degrees(1.0), "rad/s": 1.0}[curve.top_speed["high"].unit]
    assert curve.top_speed["high"].value == pytest.approx(0.8 * unit, rel=0.02)
    assert curve.logs == ["log"]
    # what is written is read back
    assert type(curve).model_validate_json(curve.model_dump_json()) == curve


def test_the_held_out_log_is_one_more_of_the_machine(tmp_path):
    found, log = diagnosed(tmp_path)
    found.held = Held(found.record, 0, ("second",))
    both = curve_of(found, log)
    assert both is not None
    assert both.logs == ["log", "second"]


def test_the_page_shows_it(tmp_path):
    found, log = diagnosed(tmp_path)
    answer = Answer.model_construct(drive_curve=curve_of(found, log))
    material = Material(answer, 0.05, {}, {})
    with speaking(found.machine.lexicon):
        shown, rows = drive.picture(material), drive.rows(material)
        assert shown is not None
        assert [r[0] for r in rows] == [
            f"{k}, {s} side" for k in ("dead zone", "slope", "top speed") for s in ("lower", "upper")
        ]
        assert rows[0][4].startswith("duty: 7.")
        corners = shown.layer("measured", kind="line")
        assert np.all(np.diff(corners.x) > 0.0)
        assert np.all(np.diff(corners.y) >= 0.0)
        assert len(figure(shown)["data"]) == 4  # a band is two lines


def test_the_models_are_drawn_beside_it(tmp_path):
    found, log = diagnosed(tmp_path)
    (group,) = found.groups
    found.findings = {group.name: SimpleNamespace(task=task_for(group, found.record, []))}
    curve = curve_of(found, log)
    assert curve is not None
    at, nominal, extended = zip(*curve.simulated, strict=True)
    assert [at[0], at[-1]] == pytest.approx([curve.points[0][0], curve.points[-1][0]])
    # nominal: a dead zone of its own and the same slope at either end; without a cause nothing is beside it
    rises = np.diff(nominal)
    assert np.all(rises >= 0.0)
    assert rises[0] == pytest.approx(rises[-1], rel=1e-3)
    assert rises[30] == 0.0
    assert set(extended) == {None}
    cause = effects()["dead_zone.mismatch"]
    found.causes = [SimpleNamespace(effect=cause, group=group.name)]
    found.values = {"dead_zone.b_r": 0.5, "dead_zone.b_l": -0.1}
    curve = curve_of(found, log)
    assert curve is not None
    for u, _, speed in curve.simulated:
        assert (speed == 0.0) == (-0.1 <= u <= 0.5)
    material = Material(Answer.model_construct(drive_curve=curve), 0.05, {}, {})
    with speaking(found.machine.lexicon):
        shown = drive.picture(material)
        assert shown is not None
        assert shown.layer("extended").y == pytest.approx([s for *_, s in curve.simulated])
        assert shown.layer("nominal").y == pytest.approx(nominal)
        assert "from rest" in shown.caption


def test_what_is_known_too_well_is_rounded_and_a_speed_is_no_speed_of_itself(tmp_path):
    found, log = diagnosed(tmp_path)
    curve = curve_of(found, log)
    assert curve is not None
    exact = curve.dead_zone["high"].model_copy(
        update={"value": 1.923e-14, "ci95": (0.0, 5e-10), "reading": None}
    )
    curve = curve.model_copy(
        update={"dead_zone": {"high": exact}, "motion": {"signal": "speed", "unit": "rpm"}, "logs": ["log"]}
    )
    material = Material(Answer.model_construct(drive_curve=curve), 0.05, {}, {})
    with speaking(Lexicon(signals={"speed": Shown("rpm", 9.55, "speed")})):
        assert drive.rows(material)[0][1:4] == ("0.00", "0.00 to 0.00", "%")
        shown = drive.picture(material)
        assert shown is not None
        assert shown.panels[0].y == "speed [rpm]"


def test_a_band_that_is_wide_where_one_log_went_once_leaves_the_curve_to_be_seen(tmp_path):
    """Of a small excavator's swing, 45 deg/s at most, the picture went from -700 to 800."""
    found, log = diagnosed(tmp_path)
    curve = curve_of(found, log)
    assert curve is not None
    u, speed, _, _ = curve.points[-1]
    wide = curve.model_copy(update={"points": [*curve.points[:-1], (u, speed, speed - 1e3, speed + 1e3)]})
    material = Material(Answer.model_construct(drive_curve=wide), 0.05, {}, {})
    with speaking(found.machine.lexicon):
        shown = drive.picture(material)
    assert shown is not None
    band, line = shown.layer("measured", kind="band"), shown.layer("plain")
    assert np.ptp(np.concatenate([band.y, band.error])) <= 4.0 * np.ptp(line.y)


def test_a_force_is_no_command(tmp_path):
    found, log = diagnosed(tmp_path)
    bare = replace(found.groups[-1], stages=(("mechanical", "mechanical"),), held=False)
    found.groups = (bare,)
    assert curve_of(found, log) is None
    assert drive.picture(Material(Answer.model_construct(drive_curve=None), 0.05, {}, {})) is None
