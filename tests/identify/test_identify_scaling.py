"""Volts to engineering units: the tables of the source, measured points, and a log in volts read by the mapping."""

import numpy as np
import pandas as pd
import pytest

from cosim.errors import DataError, UsageError
from cosim.identify.run_design import scaling_answer
from cosim.identify.scaling import STANDARD, TABLES, calibrate, read_points, wire_over_disc
from cosim.logs import load_log, write_log


def test_tables_3_5_and_3_6():
    """3.5 mm/V about 2.5 V gives Table 3.5 to its last digit; Table 3.6 is its linearised form, 0.05 mm off."""
    spool = STANDARD["spool"]
    assert [spool.value(v) for v, _ in TABLES["Table 3.5"]] == pytest.approx([3.0275, -2.688], abs=1e-9)
    assert [spool.value(v) for v, _ in TABLES["Table 3.6"]] == pytest.approx([2.6, -2.6], abs=0.05)
    assert STANDARD["u"].value(3.0) == pytest.approx(1.0)
    assert STANDARD["p_a"].value(10.0) == 400.0


def test_two_points_make_a_line_and_more_an_interval():
    exact = calibrate("spool", [(3.248, 2.6), (1.769, -2.6)])
    assert exact.value(3.248) == pytest.approx(2.6)
    assert exact.errors is None
    rng = np.random.default_rng(1)
    volts = np.linspace(0.5, 4.5, 9)
    found = calibrate("spool", [(v, 3.5 * (v - 2.5) + 0.02 * rng.standard_normal()) for v in volts])
    gain, zero = found.errors
    assert gain.interval[0] < 3.5 < gain.interval[1]
    assert zero.interval[0] < 2.5 < zero.interval[1]


def test_wire_over_a_disc():
    """15 m for 10 V: on a disc of 0.5 m, 3 rad for a volt."""
    assert wire_over_disc(0.5).gain == pytest.approx(np.rad2deg(3.0))
    with pytest.raises(UsageError, match="disc of radius 0 m"):
        wire_over_disc(0.0)


def test_units_of_points():
    found = read_points(["spool=3248 mV:0.26 cm", "p_a=1 V:4 MPa"])
    assert found["spool"][0] == pytest.approx((3.248, 2.6))
    assert found["p_a"][0] == pytest.approx((1.0, 40.0))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (["spool 3 V"], "should read signal=voltage:value"),
        (["spool=3 V:2 bar"], "wrong dimension"),
        (["spol=3 V:2 mm"], "no signal of a log"),
        (["spool=3 V:2 mm"], "two points at different voltages"),
        (["spool=3 V:2 mm", "spool=4 V:2 mm"], "one value at all voltages"),
    ],
)
def test_points_that_make_no_scaling(points, message):
    with pytest.raises(UsageError, match=message):
        scaling_answer(None, points, [], None, "time")


def volts_of(log):
    """A log as the cards see it."""
    table = {"time [s]": log.time}
    for name, channel in STANDARD.items():
        table[f"{name} [V]"] = log.in_display_units(name) / channel.gain + channel.zero
    table["slew [V]"] = np.rad2deg(log["slew"]) / wire_over_disc(0.4).gain
    return pd.DataFrame(table)


def test_a_log_in_volts_comes_back(noisy, tmp_path):
    log = noisy.slice(0.0, 3.0)
    volts_of(log).to_csv(tmp_path / "volts.csv", index=False)
    answer = scaling_answer(tmp_path / "volts.csv", [], [], 0.4, "time")
    (tmp_path / "mapping.toml").write_text(answer.texts["mapping.toml"])
    found = load_log(tmp_path / "volts.csv", tmp_path / "mapping.toml")
    assert set(found.signals) == set(log.signals)
    for name, values in log.signals.items():
        assert np.allclose(found[name], values, rtol=1e-9, atol=1e-9 * np.abs(values).max()), name
    write_log(found, tmp_path / "si.csv")
    assert "u" in load_log(tmp_path / "si.csv").held


def test_columns_of_other_names(noisy, tmp_path):
    volts_of(noisy.slice(0.0, 3.0)).rename(columns={"spool [V]": "Ch 3"}).to_csv(
        tmp_path / "v.csv", index=False
    )
    answer = scaling_answer(tmp_path / "v.csv", [], ["spool=Ch 3"], None, "time")
    (tmp_path / "m.toml").write_text(answer.texts["mapping.toml"])
    assert list(load_log(tmp_path / "v.csv", tmp_path / "m.toml").signals) == ["spool"]


def test_what_lacks_is_said(noisy, tmp_path):
    volts_of(noisy.slice(0.0, 3.0)).to_csv(tmp_path / "volts.csv", index=False)
    with pytest.raises(UsageError, match=r"no scaling is known for slew.*--point.*--disc-radius"):
        scaling_answer(tmp_path / "volts.csv", [], [], None, "time")
    write_log(noisy.slice(0.0, 3.0), tmp_path / "si.csv")
    with pytest.raises(DataError, match="no column is a signal in volts"):
        scaling_answer(tmp_path / "si.csv", [], [], None, "time")
    with pytest.raises(UsageError, match="should read signal=column"):
        scaling_answer(tmp_path / "volts.csv", [], ["spool"], None, "time")
