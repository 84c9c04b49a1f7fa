"""Many logs, many models: the scores are those of `cosim compare`, on either engine; folders of logs are diagnosed."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

for needed in ("distributed", "xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import xarray as xr  # noqa: E402

from cosim.batch.conduct import conduct  # noqa: E402
from cosim.batch.files import find_logs  # noqa: E402
from cosim.batch.plan import Plan  # noqa: E402
from cosim.batch.screen import lines  # noqa: E402
from cosim.compare import Comparator  # noqa: E402
from cosim.errors import UsageError  # noqa: E402
from cosim.logs import load_log  # noqa: E402


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two logs of different length and step, and a file that is none."""
    from cosim.rig import make_log
    from cosim.rig.write import write

    folder = tmp_path_factory.mktemp("logs")
    command = np.repeat((0.0, 0.8, 0.0, -0.6, 0.0), 800)
    write(make_log(command, seed=4), folder / "clean.csv")
    write(make_log(command[:3000], hidden=["mechanical.inertia:J=1200 kg.m2"], seed=5), folder / "heavy.csv")
    (folder / "broken.csv").write_text("time [s],u [1]\n0,0\nx,1\n", encoding="utf-8")
    return folder


def plan(packages: dict[str, Path], logs: Path, **more: Any) -> Plan:
    models = [str(packages["full_order_open"]), str(packages["simplified_open"])]
    return Plan.model_validate({"model": models, "logs": [str(logs)], "workers": 1, **more})


@pytest.fixture(scope="module")
def compared(
    packages: dict[str, Path], logs: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Any, Path]:
    folder = tmp_path_factory.mktemp("compared") / "b"
    return conduct(plan(packages, logs, threshold={"slew": "0.02 deg"}, output_step="5 ms"), folder), folder


def test_scores_are_those_of_compare(packages: dict[str, Path], logs: Path, compared: Any) -> None:
    report, folder = compared
    frame = pd.read_parquet(folder / "runs.parquet")
    assert list(zip(frame["log"], frame["model"], strict=True)) == [
        (log, model)
        for log in ("broken", "clean", "heavy")
        for model in ("full_order_open", "simplified_open")
    ]
    row = frame[(frame["log"] == "heavy") & (frame["model"] == "full_order_open")].iloc[0]
    with Comparator(load_log(logs / "heavy.csv"), packages["full_order_open"]) as comparator:
        expected = comparator.run()
    slew = expected.signals["slew"].score
    assert row["slew rmse [deg]"] == pytest.approx(np.degrees(slew.rmse), rel=1e-12)
    assert row["slew fit [%]"] == slew.fit_percent
    block = next(b for b in expected.blocks if "mechanical" in b.components)
    assert row[f"{block.name}: slew rmse [deg]"] == pytest.approx(
        np.degrees(block.signals["slew"].score.rmse)
    )
    with xr.open_zarr(folder / "signals.zarr", chunks=None) as data:
        run = data.sel(run=int(row["run"]))
        assert run["slew"].attrs["units"] == "rad"
        assert str(run["log"].values) == "heavy"
        simulated = expected.signals["slew"].simulated[::5]
        assert np.array_equal(run["slew"].values[: simulated.size], simulated)
        assert np.isnan(run["slew"].values[simulated.size :]).all(), "the shorter log ends earlier"
    assert report.about["models"] == ["full_order_open", "simplified_open"]


def test_a_bad_log_takes_its_own_runs_only(compared: Any) -> None:
    report, _ = compared
    assert [f["run"] for f in report.about["failures"]] == [0, 1]
    assert "broken.csv" in report.about["failures"][0]["reason"]
    assert report.about["done"] == 4


def test_a_missed_threshold_is_told(compared: Any) -> None:
    report, _ = compared
    (limit,) = report.about["thresholds"]
    assert (limit["signal"], limit["unit"], limit["limit"]) == ("slew", "deg", 0.02)
    assert not limit["passed"]
    assert report.missed
    # the clean log with the model that made it stays within
    assert 1 <= limit["runs_missed"] <= 3


def test_unknown_signal_of_a_threshold_is_refused_before_any_run(
    packages: dict[str, Path], logs: Path, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=r"no signal 'slow'.*closest: 'slew'"):
        conduct(plan(packages, logs, threshold={"slow": "1 deg"}), tmp_path / "b")
    with pytest.raises(UsageError, match=r"--threshold slew: .*wrong dimension"):
        conduct(plan(packages, logs, threshold={"slew": "1 bar"}), tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_both_engines_agree_against_a_log(packages: dict[str, Path], logs: Path, tmp_path: Path) -> None:
    tables = []
    for engine in ("fmu", "compiled"):
        asked = {
            "model": str(packages["full_order_open"]),
            "logs": [str(logs / "heavy.csv")],
            "vary": {"mechanical.J": "1100 +- 200 kg.m2", "dcv.K": "2.3:2.45 mm"},
            "samples": 3,
            "engine": engine,
            "workers": 1,
        }
        conduct(Plan.model_validate(asked), tmp_path / engine)
        tables.append(pd.read_parquet(tmp_path / engine / "runs.parquet").drop(columns=["seconds", "worker"]))
    pd.testing.assert_frame_equal(*tables, rtol=1e-9)
    cubes = [xr.open_zarr(tmp_path / e / "signals.zarr", chunks=None).load() for e in ("fmu", "compiled")]
    for name, values in cubes[0].data_vars.items():
        span = float(values.max() - values.min())
        assert float(np.abs(values - cubes[1][name]).max()) <= 1e-9 * max(span, 1e-12), name


@pytest.mark.slow
def test_a_folder_of_logs_is_diagnosed(logs: Path, tmp_path: Path) -> None:
    from cosim.rig import make_log
    from cosim.rig.write import write

    folder = tmp_path / "logs"
    folder.mkdir()
    command = np.repeat((0.0, 0.9, 0.0, -0.7, 0.0, 0.3, -0.3, 0.0), 3000)
    write(make_log(command, seed=4), folder / "clean.csv")
    write(make_log(command, hidden=["mechanical.inertia:J=1200 kg.m2"], seed=5), folder / "heavy.csv")
    (folder / "broken.csv").write_text("time [s],u [1]\n0,0\nx,1\n", encoding="utf-8")
    asked = {"logs": [str(folder)], "task": "diagnose", "workers": 2}
    report = conduct(Plan.model_validate(asked), tmp_path / "b")
    found = {
        row["log"]: (row["status"], row.get("verdict"), row.get("causes"))
        for row in report.about["diagnoses"]
    }
    assert found["broken"][0] == "failed"
    assert found["clean"] == ("done", "adequate", "")
    assert found["heavy"] == ("done", "explained", "mechanical.inertia")
    assert (tmp_path / "b" / "diagnoses" / "heavy" / "diagnosis.json").is_file()
    assert (tmp_path / "b" / "summary.png").is_file()
    # its intervals feed a Monte Carlo of the extended model
    source = tmp_path / "b" / "diagnoses" / "heavy" / "diagnosis.json"
    drawn = {"from": str(source), "samples": 20, "engine": "compiled", "record": ["sensor.slew"]}
    report = conduct(Plan.model_validate(drawn), tmp_path / "mc")
    assert report.about["done"] == 20
    assert 1100.0 < report.frame["mechanical.J [kg.m2]"].mean() < 1300.0


@pytest.mark.parametrize("task", ["compare", "diagnose"])
def test_a_mapping_of_a_machine_is_that_of_all_logs(tmp_path: Path, task: str) -> None:
    """Not the crane: a motor with a dead zone of a tenth, of which two logs tell speed and lag."""
    for number in (1, 2):
        t = 0.02 * np.arange(600)
        u = np.repeat(np.random.default_rng(number).uniform(-1.0, 1.0, 24), 25)
        speed, kept = np.zeros(t.size), np.exp(-0.02 / 0.1)
        for k in range(1, t.size):
            moved = np.sign(u[k - 1]) * max(abs(u[k - 1]) - 0.1, 0.0)
            speed[k] = kept * speed[k - 1] + (1.0 - kept) * 100.0 * moved
        speed += np.random.default_rng(9 + number).normal(0.0, 0.2, t.size)
        table = np.column_stack([t, u, speed])
        np.savetxt(tmp_path / f"run{number}.csv", table, delimiter=",", header="t,u,w", comments="")
    mapping = tmp_path / "motor.toml"
    mapping.write_text(
        'time = { column = "t", unit = "s" }\n[signals]\nu = { column = "u", unit = "1" }\n'
        'speed = { column = "w", unit = "rad/s" }\n[machine]\ndrive = "electric"\noutput = "speed"\n'
        'chain = ["dead_zone", "dcv", "continuity", "mechanical"]\n',
        encoding="utf-8",
    )
    runs = [str(tmp_path / f"run{n}.csv") for n in (1, 2)]
    asked = {"logs": runs, "task": task, "mapping": str(mapping), "workers": 1}
    report = conduct(Plan.model_validate(asked), tmp_path / "b")
    assert report.about["failed"] == 0
    if task == "compare":
        # the dead zone takes a tenth of the largest speed
        assert report.frame["speed rmse [rad/s]"].max() < 10.0
        assert lines(report)[-1].endswith(f"--mapping {mapping} says what is wrong in that log and why")
        return
    assert [row["causes"] for row in report.about["diagnoses"]] == ["dead_zone.mismatch"] * 2
    assert (tmp_path / "b" / "diagnoses" / "run1" / "diagnosis.json").read_text().count(
        '"model": "motor"'
    ) == 1


def test_what_a_program_says_of_itself_is_no_log_of_a_folder(tmp_path: Path) -> None:
    for name in ("one.csv", "program.log", "notes.md"):
        (tmp_path / name).write_text("time [s],u [1]\n0,0\n", encoding="utf-8")

    def found(name: Path) -> list[str]:
        return [
            path.name
            for path in find_logs(Plan.model_validate({"model": ["full_order"], "logs": [str(name)]}))
        ]

    assert found(tmp_path) == ["one.csv"]
    assert found(tmp_path / "program.log") == ["program.log"]
