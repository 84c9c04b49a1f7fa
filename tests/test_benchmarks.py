"""Every benchmark finds what it takes from the package: nothing else runs them between releases."""

import contextlib
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import ablation, real_logs

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.mark.parametrize("name", sorted(p.stem for p in FOLDER.glob("*.py") if p.stem != "__init__"))
def test_a_benchmark_imports(name: str) -> None:
    importlib.import_module(f"benchmarks.{name}")


@pytest.mark.slow
def test_one_command_prints_all_peers(tmp_path: Path) -> None:
    figures, page = tmp_path / "figures.json", tmp_path / "speed.md"
    command = [sys.executable, FOLDER / "peers.py", "--quick", "--json", figures, "--page", page]
    done = subprocess.run(command, cwd=FOLDER.parent, capture_output=True, text=True, check=True)
    peers = ("fmpy simulate_ssp", "ecos", "libcosim", "simulate_fmu, Dask", "scipy around fmpy", "C loop")
    for peer in peers:
        assert peer in page.read_text(encoding="utf-8")
    assert "Ours and the peers" in done.stdout
    assert set(json.loads(figures.read_text(encoding="utf-8"))) == {"runner", "batch", "fit", "native"}


def answer(before: float, after: float, linear: float, causes: tuple[str, ...] = (), rest: str = "") -> str:
    """What ``cosim diagnose --json`` prints, as far as the table of real logs reads it."""
    gain = {"rmse_before": before, "rmse_after": after, "unit": "deg"}
    size = {"tau_c": {"value": 0.38, "unit": "N.m"}}
    return json.dumps(
        {
            "verdict": "partly_explained",
            "gain": {"slew": gain},
            "linear": {"slew": {"rmse": linear, "rmse_extended": after}},
            "causes": [{"effect": c, "parameters": size, "indistinguishable_from": []} for c in causes],
            "refused": [],
            "unexplained": [{"what": rest}] if rest else [],
            "warnings": [],
        }
    )


@pytest.fixture
def excavator(tmp_path, monkeypatch):
    """The benchmark on a folder that holds the names of two groups of logs."""
    names = [f"boom-up-{duty}-L-single" for duty in (50, 70, 90)] + ["arm-in-50-H-single"]
    (tmp_path / "excavator").mkdir()
    for name in names:
        (tmp_path / "excavator" / f"{name}.csv").touch()
    monkeypatch.setattr(real_logs, "DATA", tmp_path)
    return real_logs


def test_each_duty_is_held_out_once(excavator):
    together = {Path(c.held).stem[8:10]: [Path(f).stem[8:10] for f in c.fit] for c in excavator.cases(True)}
    assert together == {
        "50": ["70", "90"],
        "70": ["50", "90"],
        "90": ["50", "70"],
    }  # the arm has one log only
    one = {Path(c.held).stem[8:10]: [Path(f).stem[8:10] for f in c.fit] for c in excavator.cases(False)}
    assert one == {"50": ["70"], "70": ["50"], "90": ["70"]}


def test_an_interrupted_run_goes_on(excavator, tmp_path, monkeypatch):
    printed = [
        answer(21.4, 10.5, 28.8, ("continuity.cracking_pressure",)),
        answer(55.0, 56.0, 53.0),
        answer(10.0, 10.0, 5.0, (), "linear dynamics are missing: a linear model"),
    ]
    ran = []

    def run(case, budget, limit):
        if len(ran) == 1 and not file.with_suffix(".again").exists():
            raise KeyboardInterrupt
        ran.append(case.name)
        row = excavator.Row(case.machine, case.axis, list(case.fit), case.held, cpu=10.0 * len(ran))
        excavator.read(row, json.loads(printed[len(ran) - 1]))
        return row

    file, page, found = tmp_path / "rows.jsonl", tmp_path / "page.md", tmp_path / "out.json"
    monkeypatch.setattr(excavator, "run", run)
    monkeypatch.setattr(sys, "argv", ["real_logs.py", "--rows", str(file), "--page", str(page), "--json"])
    with pytest.raises(KeyboardInterrupt):
        excavator.main()
    file.write_text(file.read_text(encoding="utf-8") + '\n{"machine": "exc', encoding="utf-8")
    file.with_suffix(".again").touch()
    with found.open("w", encoding="utf-8") as stream, contextlib.redirect_stdout(stream):
        excavator.main()
    assert len(set(ran)) == len(ran) == 3  # none twice
    assert [row.name for row in excavator.stored(file)] == ran
    said = json.loads(found.read_text(encoding="utf-8"))
    assert said["summary"] == [
        "ended without an error: 3 of 3",
        "as good as the linear reference, or says that it is not: 2 of 3",
        "worse after than before: 1 of 3",
        "the same names from log to log of one axis: 0 of 2 pairs",
        "error after over before: 1.00 in the median",
        "processor time: 20 s in the median, 30 s at most",
    ]
    text = page.read_text(encoding="utf-8")
    assert "cracking_pressure 0.38 N.m" in text
    assert "linear dynamics |" in text


def test_a_case_that_fails_is_a_row_with_its_reason(excavator):
    (case, *_) = excavator.cases(True)
    row = excavator.run(case, "", 120.0)
    assert row.code not in (0, None)
    assert row.error  # the logs are empty files
    assert row.before is None
    assert row.cpu > 0.0


@pytest.mark.parametrize("rule", ablation.RULES, ids=lambda rule: rule.name)
def test_a_rule_is_switched_off_and_on_again(rule):
    for target, stand_in in rule.off.items():
        module, _, name = target.rpartition(".")
        home = importlib.import_module(module)
        before = getattr(home, name)  # a rule that has moved is an error here
        with ablation.without(rule.name):
            assert getattr(home, name) is stand_in
        assert getattr(home, name) is before


def test_what_a_rule_is_worth_is_counted_log_by_log():
    rows = {}
    for case in range(20):
        for rule, right in ((ablation.ALL, case < 18), ("event", case < 12 or case == 19)):
            rows["rig", str(case), rule] = {"right": right, "cpu": 1.0 if rule == ablation.ALL else 0.5}
    found = ablation.worth(rows, "rig", "event")
    assert (found.count, found.changed) == (20, 7)  # six lost without the rule, one won
    assert found.value == pytest.approx(0.25)
    assert found.low < 0.25 < found.high
    (line,) = ablation.table(rows)
    assert line[0] == "event"
    assert line[-1] == "0.50"
    for case, (with_it, without) in enumerate([(1.0, 2.0), (2.0, 4.0), (3.0, 6.0)]):
        rows["real", str(case), ablation.ALL] = {"after": with_it, "cpu": 1.0}
        rows["real", str(case), "event"] = {"after": without, "cpu": 1.0}
    assert ablation.worth(rows, "real", "event").value == pytest.approx(np.log(2.0))
    assert "| event |" in ablation.page(rows)


def test_a_rules_worth_of_no_change_holds_none():
    value, low, high = ablation.paired(0, 0, 40)
    assert value == 0.0
    assert low < 0.0 < high
    assert ablation.paired(20, 0, 40)[1] > 0.0
