"""The public measured data sets through their mappings; skipped where the files are missing."""

import numpy as np
import pytest
from log_files import MEASURED, TOP
from scipy.signal import savgol_filter

from cosim.logs import load_log, load_mapping

MAPPINGS = TOP / "examples" / "mappings"
pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured data: set COSIM_DATA to their folder"),
]


def load(file, mapping):
    path = MAPPINGS / f"{mapping}.toml"
    log = load_log(MEASURED / file, path)
    assert log.sha256 in path.read_text(encoding="utf-8"), "not the file that the mapping was made for"
    assert not log.synthetic
    return log


@pytest.mark.parametrize(
    ("file", "samples", "damage"),
    [
        ("manual_1101_2326", 2056, ["irregular sampling"]),
        ("manual_mitch_1101_2319", 2013, ["pauses of more than ten", "irregular sampling"]),
        ("manual_mitch_1101_2333", 1896, ["irregular sampling"]),
        (
            "manual_shyam_1101_2002",
            4855,
            ["the last line (row 4857) was cut short (6 of 9 cells)", "irregular sampling"],
        ),
        ("manual_shyam_1101_2012", 4073, ["irregular sampling"]),
    ],
)
def test_mini_excavator(file, samples, damage):
    log = load(f"mini_excavator/{file}.csv", "mini_excavator_swing")
    assert len(log) == samples
    assert [warning.startswith(text) for warning, text in zip(log.warnings, damage, strict=True)] == [
        True
    ] * len(damage)
    assert str(log.model).endswith("swing.ssd")
    assert log.step == pytest.approx(0.053, abs=5e-4)
    assert abs(np.median(log["u"])) < 1e-12  # neutral most of the time
    assert 0.8 < np.abs(log["u"]).max() <= 1.0001
    # a positive command turns to positive angles, about 2 samples later
    rate = np.gradient(log["slew"], log.time)
    assert np.corrcoef(log["u"][:-2], rate[2:])[0, 1] > 0.9


@pytest.mark.parametrize(("file", "peak"), [("DATA_EMPS", 152.05), ("DATA_EMPS_PULSES", 317.56)])
def test_emps(file, peak):
    log = load(f"emps/{file}.mat", "emps")
    assert log.warnings == ()
    assert log.uniform
    assert len(log) == 24841
    assert log.duration == pytest.approx(24.84, abs=1e-3)
    assert log.units == {"force": "N", "position": "m", "reference": "m"}
    assert np.abs(log["force"]).max() == pytest.approx(peak, abs=0.01)
    # the published parameters explain the force: M q" + Fv q' + Fc sign q' + offset (Janot et al., 2019)
    speed, acceleration = (savgol_filter(log["position"], 21, 3, deriv=n, delta=log.step) for n in (1, 2))
    force = 95.109 * acceleration + 203.503 * speed + 20.394 * np.sign(speed) - 3.165
    assert np.corrcoef(force, log["force"])[0, 1] > 0.95


def test_forest_crane_actuator():
    log = load("actuator_forest_crane/actuator.mat", "actuator_forest_crane")
    (warning,) = log.warnings  # 1.60, 1.74, 1.61 where all else moves by 0.005
    assert warning.startswith("position: jumps away once, by up to 0.1367 (first: sample 987)")
    assert log.time_unit == "sample"
    assert log.time.tolist() == list(range(1024))
    assert log["pressure"][512:].std() == pytest.approx(
        1.58, abs=0.01
    )  # the figure of the data's description


@pytest.mark.parametrize(("axis", "column"), [("boom", "Boom"), ("stick", "Stick"), ("bucket", "Bucket")])
def test_mini_excavator_cylinders(axis, column):
    log = load("mini_excavator/manual_1101_2326.csv", f"mini_excavator_{axis}")
    assert len(log) == 2056
    assert [warning[:18] for warning in log.warnings] == ["irregular sampling"]
    assert abs(np.median(log["u"])) < 1e-12
    assert np.abs(log["u"]).max() == pytest.approx(1.0, abs=1e-4)
    table = np.genfromtxt(
        MEASURED / "mini_excavator" / "manual_1101_2326.csv", delimiter=",", names=True, deletechars=""
    )
    np.testing.assert_allclose(log["travel"], table[f"{column}_Ms"] / 100, rtol=1e-12)


@pytest.mark.parametrize("direction", ["boom-up", "boom-dn", "arm-in", "arm-out", "bucket-in", "bucket-out"])
@pytest.mark.parametrize("duty", [50, 70, 90])
def test_excavator(direction, duty):
    axis, way = direction.split("-")
    log = load(f"excavator/{direction}-{duty}-L-single.csv", f"excavator_{axis}")
    assert log.warnings == ()  # as many rows as announced, all angles plausible
    assert log.step == pytest.approx(0.01, rel=1e-3)
    assert log.held == {"u"}
    sign = 1 if way in ("up", "out") else -1
    assert sorted(set(np.round(sign * log["u"], 9))) == [0.0, duty / 100]
    assert sign * np.degrees(log["slew"][-1] - log["slew"][0]) > 55


def test_every_mapping_has_its_data():
    assert {path.stem for path in MAPPINGS.glob("*.toml")} >= {
        "mini_excavator_swing", "mini_excavator_boom", "mini_excavator_stick", "mini_excavator_bucket",
        "excavator_boom", "excavator_arm", "excavator_bucket", "emps", "actuator_forest_crane",
    }  # fmt: skip
    assert load_mapping(MAPPINGS / "emps.toml").signals["force"].gain == "gtau"
