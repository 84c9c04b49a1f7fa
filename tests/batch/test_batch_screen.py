from pathlib import Path
from types import SimpleNamespace

from cosim.batch.screen import FEW, MANY, lines, next_step, strongest, telling


def about(**changes):
    plain = {
        "task": "simulate",
        "engine": "fmu",
        "runs": 40,
        "runs_before": 10,
        "done": 39,
        "failed": 1,
        "runs_per_second": 12.34,
        "thresholds": [],
        "scores": {},
        "sensitivity": {},
        "files": {"runs": Path("batch/runs.parquet")},
        "log_files": [],
    }
    return plain | changes


def score(low, middle, high):
    return {"min": low, "q50": middle, "max": high}


def test_many_scores_in_a_few_lines():
    scores = {f"s{k} final [deg]": score(0.0, 0.5 + k, 1.0 + k) for k in range(6)} | {
        "u max [1]": score(1, 1, 1)
    }
    ranks = {"s5 final [deg]": {"J [kg.m2]": -0.91, "b": 0.2}, "s4 final [deg]": {"J [kg.m2]": 0.5}}
    found = about(scores=scores, sensitivity=ranks)
    assert telling(found)[0] == "s5 final [deg]"
    assert strongest(found, telling(found))[0] == ("s5 final [deg]", "J [kg.m2]", -0.91)
    assert lines(SimpleNamespace(about=found)) == [
        "simulate, engine fmu: 39 of 40 runs done, 10 of them before, 1 failed, 12.3 runs a second",
        "s5 final [deg]: median 5.5, 0 to 6",
        "s4 final [deg]: median 4.5, 0 to 5",
        "s3 final [deg]: median 3.5, 0 to 4",
        "Strongest influence: J [kg.m2] on s5 final [deg], rank correlation -0.91",
        f"{7 - FEW} more scores: --verbose, or {Path('batch/runs.parquet')}",
        f"written: {Path('batch/runs.parquet')}",
        f"Next: {Path('batch/batch.json')} has the reason of each failed run; the same command with --retry-failed runs "
        "them again",
    ]


def test_what_changes_most_comes_first_and_a_rest_of_nothing_last():
    scores = {
        "observer.rate max [deg/s]": score(2.091, 2.092, 2.093),
        "observer.rate final [deg/s]": score(-2.8e-6, -2.7e-6, -2.6e-6),
        "drive.speed max [rpm]": score(50.0, 80.0, 100.0),
        "drive.speed final [rpm]": score(0.0, 1e-6, 2e-6),
        "end.speed final [rpm]": score(0.0, 1e-6, 2e-6),
        "end.speed max [rpm]": score(2.0, 2.1, 2.2),
    }
    assert telling(about(scores=scores))[:2] == ["drive.speed max [rpm]", "end.speed max [rpm]"]


def test_each_batch_says_what_to_type_next():
    runs = {"runs": Path("my b/runs.parquet")}
    done = {"failed": 0, "files": runs}
    one = about(task="simulate", **done)
    assert next_step(one) == "pandas.read_parquet('my b/runs.parquet') has every run in Python"
    two = about(task="compare", log_files=[Path("logs/a 1.csv")], **done)
    assert next_step(two).startswith("cosim diagnose 'logs/a 1.csv' says what is wrong")
    rows = [
        {
            "log": "fine",
            "status": "done",
            "verdict": "adequate",
            "causes": "",
            "diagnosis": "b/x/fine/diagnosis.json",
        },
        {"log": "bad", "status": "done", "verdict": "explained", "diagnosis": "b/x/bad/diagnosis.json"},
    ]
    assert (
        next_step(about(task="diagnose", diagnoses=rows, **done))
        == "cosim report b/x/bad writes the page of bad"
    )


def test_diagnoses_a_line_each_and_no_endless_list():
    rows = [
        {"log": f"log{k}", "status": "done", "verdict": "explained", "causes": "dcv.delay"} for k in range(25)
    ]
    rows[1] = {"log": "bad", "status": "failed"}
    limit = {"signal": "slew", "passed": False, "runs_missed": 2, "rmse": 0.7, "unit": "deg", "limit": 0.5}
    told = lines(SimpleNamespace(about=about(diagnoses=rows, thresholds=[limit])))
    assert told[1] == "threshold MISSED by 2 runs: RMSE of slew up to 0.7 deg, limit 0.5 deg"
    assert told[2:4] == ["log0: explained, a delay of the valve (dcv.delay)", "bad: failed"]
    assert told[2 + MANY] == "and 5 logs more"
