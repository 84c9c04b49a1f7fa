"""What a user asks for: plan files, options, parameters from files; every fault is told with its file and key."""

import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cosim.batch.cases import plan_batch
from cosim.batch.plan import Plan, load_plan, with_options
from cosim.cli import make_app
from cosim.errors import CosimError, DataError, ModelError, UsageError
from tests.batch.texts import write


def test_a_plan_file_is_read_and_its_files_are_relative_to_it(tmp_path: Path) -> None:
    text = """
        model = ["full_order", "mine.ssp"]
        logs = "logs/*.csv"
        mapping = "names.toml"
        from = "diagnosis.json"
        design = "sobol"
        samples = 64
        [set]
        "mechanical.b" = "27 kN.m.s/rad"
        [sweep]
        "dcv.K" = ["2.3 mm", 0.0024]
        [vary]
        "mechanical.J" = "764 +- 40 kg.m2"
    """
    plan = load_plan(write(tmp_path / "plan.toml", text))
    assert plan.model == ("full_order", str(tmp_path / "mine.ssp"))
    assert plan.logs == (str(tmp_path / "logs/*.csv"),)
    assert (plan.mapping, plan.from_file) == (str(tmp_path / "names.toml"), str(tmp_path / "diagnosis.json"))
    assert plan.sweep == {"dcv.K": ["2.3 mm", 0.0024]}
    changed = with_options(plan, {"samples": 8, "vary": {"dcv.w0": "20:30 rad/s"}, "seed": None, "logs": ()})
    assert (changed.samples, changed.design, changed.seed, changed.logs) == (8, "sobol", 1, plan.logs)
    assert changed.vary == {"mechanical.J": "764 +- 40 kg.m2", "dcv.w0": "20:30 rad/s"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("modell = 'full_order'", r"'modell': Extra inputs.*closest: 'model'"),
        ("samples = 0", "'samples': Input should be greater than 0"),
        ("design = 'square'", "'design': Input should be 'grid'"),
        ("[vary]\n'mechanical.J' = 5", "'vary.mechanical.J': Input should be a valid string"),
        ("[sweep]\n'mechanical.J' = 5", "'sweep.mechanical.J': Input should be a valid"),
        ("seed = -1\nworkers = 'two'", "'seed': .*; 'workers': "),
        ("samples = ", "is no TOML file"),
    ],
)
def test_faults_of_a_plan_file_name_file_and_key(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(DataError, match=rf"plan\.toml.*{said}"):
        load_plan(write(tmp_path / "plan.toml", text))
    with pytest.raises(DataError, match=r"absent\.toml cannot be read"):
        load_plan(tmp_path / "absent.toml")


def test_faults_of_options_name_the_option() -> None:
    with pytest.raises(UsageError, match="--design: Input should be 'grid'"):
        with_options(Plan(), {"design": "square"})
    with pytest.raises(UsageError, match="--most-failed"):
        with_options(Plan(), {"most_failed": -1})


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, "one run only"),
        ({"sweep": {"r.q": "1,2"}}, "has no 'r.q' to vary"),
        ({"sweep": {"r.y": "1,2"}}, "cannot be set"),
        ({"sweep": {"r.k": "1,2"}, "set": {"r.k": "1"}}, "'r.k' is given twice, by sweep and set"),
        ({"sweep": {"r.k": "1,2"}, "samples": 5}, "--samples is how many to draw"),
        ({"sweep": {"r.k": "1,2,3"}, "design": "sobol"}, "draws from a range"),
        ({"sweep": {"r.k": "1,2"}, "threshold": {"slew": "1 deg"}}, "--threshold is about"),
        ({"sweep": {"r.k": "1,2"}, "record": ["r.x"]}, "no variable 'r.x' to record"),
        ({"sweep": {"r.k": "1,2"}, "mapping": "m.toml"}, "--mapping says how"),
        ({"sweep": {"r.k": "1,2"}, "task": "compare"}, "to compare needs logs"),
        ({"sweep": {"r.k": "1,2"}, "output_step": "-1 ms"}, "--output-step"),
        ({"vary": {"r.n": "1:3"}}, "sweep it instead"),
        ({"logs": ["nowhere/*.csv"]}, "leads to no log"),
    ],
)
def test_requests_without_sense_are_refused_before_any_run(
    rogue: Path, tmp_path: Path, asked: dict[str, Any], said: str
) -> None:
    with pytest.raises(CosimError, match=said):
        plan_batch(Plan.model_validate({"model": str(rogue), **asked}), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_model_without_a_twin_is_refused_before_any_run(
    packages: dict[str, Path], rogue: Path, tmp_path: Path
) -> None:
    for model, sweep, said in (
        (packages["physical"], {"mechanical.J": "700,800"}, "has a loop"),
        (rogue, {"r.k": "1,2"}, "none of our blocks"),
    ):
        asked = Plan.model_validate({"model": str(model), "sweep": sweep, "engine": "compiled"})
        with pytest.raises(ModelError, match=said):
            plan_batch(asked, tmp_path)


def test_values_out_of_the_models_bounds_are_refused(packages: dict[str, Path], tmp_path: Path) -> None:
    asked = {"model": str(packages["full_order"])}
    for bad in ({"sweep": {"mechanical.J": "-5,700 kg.m2"}}, {"vary": {"mechanical.J": "-5:700 kg.m2"}}):
        with pytest.raises(UsageError, match=r"mechanical\.J = -5 kg\.m2 is not within"):
            plan_batch(Plan.model_validate({**asked, **bad}), tmp_path)


def test_runs_are_listed_log_by_log_and_model_by_model(packages: dict[str, Path], tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv", "a_tracker.csv"):
        write(tmp_path / name, name)
    write(tmp_path / "a.csv.truth.json", "{}")
    models = [str(packages["full_order_open"]), str(packages["simplified_open"])]
    asked = {"model": models, "logs": [str(tmp_path)], "external": "_tracker"}
    batch = plan_batch(Plan.model_validate({**asked, "sweep": {"sensor.bias": "0,0.1"}}), tmp_path)
    assert [log.label for log in batch.job.logs] == ["a", "b"]
    assert {label: Path(file.path).name for label, file in batch.job.trackers.items()} == {
        "a": "a_tracker.csv"
    }
    cases = [(run.log, run.model, run.parameters["sensor.bias"]) for run in batch.runs]
    assert cases == [(k, m, b) for k in (0, 1) for m in (0, 1) for b in (0.0, 0.1)]
    with pytest.raises(UsageError, match=r"'simplified' has no 'dcv\.K'"):
        plan_batch(Plan.model_validate({**asked, "sweep": {"dcv.K": "2.3,2.4 mm"}}), tmp_path)


def test_options_reach_the_plan(tmp_path: Path) -> None:
    from cosim.commands.batch import asked

    names = (
        "logs model diagnose sweep vary from_file design samples seed settings parameter_set played mapping"
    )
    options: dict[str, Any] = dict.fromkeys([*names.split(), "external", "record"])
    options |= {
        "threshold": ["slew=0.5deg"],
        "diagnose": True,
        "calibrate": True,
        "settings": ["a.b=1 m"],
        "logs": ["x.csv"],
    }
    plan = asked(None, options)
    assert (plan.task, plan.calibrate, plan.set) == ("diagnose", True, {"a.b": "1 m"})
    assert (plan.threshold, plan.logs) == ({"slew": "0.5deg"}, ("x.csv",))
    with pytest.raises(UsageError, match=r"--sweep 'J' should read name=.*mechanical\.J"):
        asked(None, {**options, "sweep": ["J"]})


def test_without_the_extra_the_exit_code_is_5(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "zarr" else found(name, *rest)
    )
    done = CliRunner().invoke(make_app(), ["batch", "--out", str(tmp_path / "b")])
    assert getattr(done.exception, "exit_code", None) == 5
    assert "pip install 'slew-cosim[batch]'" in str(done.exception)
    assert not (tmp_path / "b").exists()


def test_the_command_needs_no_extra_until_it_runs() -> None:
    import subprocess

    code = "import sys; sys.modules.update(zarr=None, xarray=None, dask=None); "
    code += "from cosim.cli import main; main(['batch', '--help'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--sweep" in done.stdout
