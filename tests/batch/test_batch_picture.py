"""What the pictures show: looked at through the artists that matplotlib draws."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

for needed in ("distributed", "xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import xarray as xr  # noqa: E402

from cosim.batch.overview import diagnoses_figure, scores_figure  # noqa: E402
from cosim.batch.parameters import Varied  # noqa: E402
from cosim.batch.picture import effects_figure, fan_figure, write_picture  # noqa: E402
from cosim.batch.summary import quantiles, sensitivity, thresholds  # noqa: E402

J = Varied("m.J", "kg.m2", ("kg.m2", 1.0, 0.0), True)
K = Varied("v.K", "m", ("mm", 1e3, 0.0), True)


@pytest.fixture
def frame() -> pd.DataFrame:
    rng = np.random.default_rng(1)
    j, k = rng.uniform(700.0, 900.0, 50), rng.uniform(2.2, 2.5, 50)
    table = {
        "run": range(50),
        "model": "full_order",
        "log": None,
        "status": "done",
        "reason": "",
        "seconds": 0.1,
    }
    found = pd.DataFrame({**table, "worker": "w", "m.J [kg.m2]": j, "v.K [mm]": k})
    found["y final [deg]"] = -(j**3)
    found["z final [deg]"] = k + 1e-5 * j
    found["same final [deg]"] = 7.0
    found.loc[3, ["status", "reason", "y final [deg]", "z final [deg]"]] = ["failed", "died", np.nan, np.nan]
    return found


def cube(runs: int = 50) -> xr.Dataset:
    time = np.arange(101) * 0.1
    rows = np.arange(runs)[:, None] / (runs - 1)
    attributes = {
        "units": "rad",
        "display_unit": "deg",
        "display_factor": 180.0 / np.pi,
        "display_offset": 0.0,
    }
    signals = {
        "y": rows * np.sin(time),
        "copy": 3.0 * rows * np.sin(time) + 1.0,
        "still": np.cos(time) + 0.0 * rows,
    }
    return xr.Dataset(
        {name: (("run", "time"), values, attributes) for name, values in signals.items()},
        coords={"run": np.arange(runs), "time": time},
        attrs={"signals": list(signals)},
    )


def test_rank_correlation_sees_monotone_dependence(frame: pd.DataFrame) -> None:
    found = sensitivity(frame, [J, K], ["y final [deg]", "z final [deg]", "same final [deg]"])
    assert found["y final [deg]"]["m.J"] == pytest.approx(-1.0)
    assert abs(found["y final [deg]"]["v.K"]) < 0.4
    assert found["z final [deg]"]["v.K"] > 0.99
    assert "same final [deg]" not in found, "a constant depends on nothing"


def test_rank_correlation_is_taken_within_each_model(frame: pd.DataFrame) -> None:
    other = frame.assign(model="simplified")
    other["y final [deg]"] = 1e12 - frame["y final [deg]"]
    both = pd.concat([frame, other], ignore_index=True)
    assert sensitivity(both, [J], ["y final [deg]"])["y final [deg]"]["m.J"] == pytest.approx(0.0, abs=1e-12)


def test_quantiles_leave_out_what_failed(frame: pd.DataFrame) -> None:
    found = quantiles(frame, ["z final [deg]"])["z final [deg]"]
    values = frame["z final [deg]"].dropna()
    assert len(values) == 49
    assert found["q50"] == pytest.approx(float(np.median(values)))
    assert (found["min"], found["max"]) == (pytest.approx(values.min()), pytest.approx(values.max()))


def test_thresholds_count_the_runs_that_miss(frame: pd.DataFrame) -> None:
    frame["slew rmse [deg]"] = np.linspace(0.0, 0.49, 50)
    (found,) = thresholds(frame, {"slew": "0.005 rad"})
    limit = np.degrees(0.005)
    assert found["limit"] == pytest.approx(limit)
    assert found["runs_missed"] == int(np.sum(np.linspace(0.0, 0.49, 50) > limit))
    assert not found["passed"]


def test_the_fan_holds_the_quantiles_of_the_runs_that_were_done(frame: pd.DataFrame) -> None:
    time = np.arange(101) * 0.1
    figure = fan_figure(cube(), frame, {"copy": (time, np.full(101, 60.0))})
    assert figure is not None
    (axis,) = (a for a in figure.axes if a.get_visible())
    assert axis.get_title(loc="left") == "copy", (
        "of two signals of the same shape one is enough; the still one is none"
    )
    assert axis.get_ylabel() == "deg"
    done = np.delete(cube()["copy"].values, 3, axis=0)
    median, measured = axis.get_lines()
    assert median.get_ydata() == pytest.approx(np.degrees(np.median(done, axis=0)))
    assert set(measured.get_ydata()) == {60.0}
    top = max(p[1] for p in axis.collections[0].get_paths()[0].vertices)
    assert top == pytest.approx(np.degrees(np.quantile(done, 0.95, axis=0)).max())
    assert "1 failed" in figure.get_suptitle()


def test_main_effects_have_a_panel_for_each_score_and_parameter(frame: pd.DataFrame) -> None:
    figure = effects_figure(frame, [J, K])
    assert figure is not None
    assert len(figure.axes) == 4
    assert {a.get_xlabel() for a in figure.axes[2:]} == {"m.J [kg.m2]", "v.K [mm]"}
    titles = [a.get_title() for a in figure.axes]
    assert "rank correlation -1.00" in titles
    assert all(len(a.get_lines()[0].get_ydata()) == 49 for a in figure.axes)


def test_the_map_tells_failed_from_absent() -> None:
    rows = [
        ("a", "m", "done", 0.1),
        ("a", "n", "done", np.nan),
        ("b", "m", "failed", np.nan),
        ("b", "n", "done", 0.2),
    ]
    table = pd.DataFrame(rows, columns=["log", "model", "status", "slew rmse [deg]"])
    figure = scores_figure(table)
    assert figure is not None
    assert [t.get_text() for t in figure.axes[0].texts] == ["0.1", "-", "failed", "0.2"]


def test_the_table_of_diagnoses_has_a_line_for_each_log(tmp_path: Path) -> None:
    rows = [
        {
            "log": "a",
            "status": "done",
            "verdict": "explained",
            "causes": "mechanical.inertia",
            "unexplained": "",
        },
        {"log": "b", "status": "done", "verdict": "adequate", "causes": "", "unexplained": ""},
        {
            "log": "c",
            "status": "failed",
            "reason": "c.csv has no data",
            "causes": np.nan,
            "unexplained": np.nan,
        },
    ]
    figure = diagnoses_figure(pd.DataFrame(rows))
    assert figure is not None
    cells = {
        place: cell.get_text().get_text() for place, cell in figure.axes[0].tables[0].get_celld().items()
    }
    assert [cells[line, 1] for line in (1, 2, 3)] == ["explained", "adequate", "failed"]
    assert [cells[line, 2] for line in (1, 2, 3)] == ["mechanical.inertia", "none", "c.csv has no data"]
    assert write_picture(tmp_path / "x.png", "diagnose", pd.DataFrame(rows), [], None) == tmp_path / "x.png"


def test_nothing_to_show_gives_no_picture(frame: pd.DataFrame, tmp_path: Path) -> None:
    assert (
        write_picture(tmp_path / "x.png", "simulate", frame[frame["status"] == "failed"], [J], cube()) is None
    )
    assert write_picture(tmp_path / "x.png", "compare", frame, [], None) is None
    assert not (tmp_path / "x.png").exists()
