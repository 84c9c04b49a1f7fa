"""Every benchmark finds what it takes from the package: nothing else runs them between releases."""

import contextlib
import importlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from benchmarks import ablation, each_alone, real_logs, rounding, third_log
from benchmarks.rules import RULES, STAYS, Rule, empty, first, yes
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline import diagnose
from cosim.diagnosis.residuals.local import NO_EVENT
from cosim.logs import load_log

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
            "causes": [
                {"effect": c, "parameters": size, "top_speed": {}, "indistinguishable_from": []}
                for c in causes
            ],
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
    together = {
        Path(c.held[0]).stem[8:10]: [Path(f).stem[8:10] for f in c.fit] for c in excavator.cases(True)
    }
    assert together == {
        "50": ["70", "90"],
        "70": ["50", "90"],
        "90": ["50", "70"],
    }  # the arm has one log only
    one = {Path(c.held[0]).stem[8:10]: [Path(f).stem[8:10] for f in c.fit] for c in excavator.cases(False)}
    assert one == {"50": ["70"], "70": ["50"], "90": ["70"]}


def test_all_duties_of_one_pose_are_held_against_those_of_the_other(excavator, tmp_path):
    for name in ("boom-up-50-H-single", "boom-up-50-H-coupled", "arm-in-50-L-coupled"):
        (tmp_path / "excavator" / f"{name}.csv").touch()
    found = {
        tuple(Path(f).stem for f in c.fit): [Path(f).stem for f in c.held] for c in excavator.other_poses()
    }
    low = tuple(f"boom-up-{duty}-L-single" for duty in (50, 70, 90))
    assert found == {low: ["boom-up-50-H-single"], ("boom-up-50-H-single",): list(low)}


def test_a_third_log_had_no_share_in_a_case(excavator, tmp_path):
    for name in ("boom-dn-50-L-single", "boom-up-50-H-coupled"):
        (tmp_path / "excavator" / f"{name}.csv").touch()
    case = excavator.Case("excavator", "boom up", "", ("excavator/boom-up-50-L-single.csv",), ())
    found = third_log.further_logs(replace(case, held=("excavator/boom-up-90-L-single.csv",)))
    assert [Path(f).stem for f in found] == [
        "boom-up-50-H-coupled",
        "boom-up-70-L-single",
    ]  # none of the way down


def test_what_logs_of_one_axis_say_alike():
    stop = {"dcv.stroke_limit": {"x_max": (1.0, (0.9, 1.1))}}
    wide, far = ({"dead_zone.mismatch": {"b_r": (b, (b - 3.0, b + 3.0))}} for b in (50.0, 56.0))
    rows = [
        each_alone.Alone("boom", "1", wide | stop, [1.0, 4.0]),
        each_alone.Alone("boom", "2", far, [2.0]),
        each_alone.Alone("swing", "1", wide),
        each_alone.Alone("swing", "2"),
        each_alone.Alone("swing", "3"),
    ]
    assert len(each_alone.pairs(rows)) == 3  # none of two that name nothing
    assert each_alone.agreeing(rows[0], rows[1]) == (0, 1)  # 6 apart, and 4.2 within both
    told = each_alone.summary(rows)
    assert told[0] == "the same causes in 0 of 3 pairs of logs"
    assert told[1] == "causes in common: 0.17"
    assert "geometric mean: 2" in told[3]


def test_shares_that_a_third_log_bears_out():
    named = [third_log.Asked("", "", "", True, True, 0.5, 0.1, third) for third in (0.4, 0.3, -0.1)]
    refused = [third_log.Asked("", "", "", False, True, 0.1, -0.3, third) for third in (0.2, -0.2)]
    assert third_log.share(named).startswith("2 of 3")
    assert third_log.share([]) == "none"
    by_causes, by_certainty = third_log.tables([*named, *refused])
    cells = [[*column.cells] for column in by_causes.columns]
    assert [c.split(" (")[0] for c in cells[1]] == ["2 of 3", "1 of 2", "3 of 5"]
    cells = [[*column.cells] for column in by_certainty.columns]
    assert [c.split(" (")[0] for c in cells[1]] == ["none", "1 of 2", "none", "2 of 3"]


def test_an_interrupted_run_goes_on(excavator, tmp_path, monkeypatch):
    printed = [
        answer(21.4, 10.5, 28.8, ("continuity.cracking_pressure",)),
        answer(55.0, 56.0, 53.0),
        answer(10.0, 10.0, 5.0, (), "linear dynamics are missing: a linear model"),
    ]
    ran = []

    def run(case, budget, limit, mappings):
        assert (mappings / case.mapping).is_file()
        if len(ran) == 1 and not file.with_suffix(".again").exists():
            raise KeyboardInterrupt
        ran.append(case.name)
        row = excavator.Row(case.machine, case.axis, list(case.fit), list(case.held), cpu=10.0 * len(ran))
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
        "the same names from log to log of one axis: 0 of 2 pairs; 0 with those declared indistinguishable",
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


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_a_rule_is_switched_off_and_on_again(rule):
    for target, stand_in in rule.off.items():
        module, _, name = target.rpartition(".")
        home = importlib.import_module(module)
        before = getattr(home, name)  # a rule that has moved is an error here
        with ablation.without(rule.name):
            assert getattr(home, name) is stand_in
        assert getattr(home, name) is before


def test_each_rule_has_a_reason_to_stay_where_the_table_shows_no_worth():
    assert set(STAYS) == {rule.name for rule in RULES}


def test_what_a_rule_is_worth_is_counted_log_by_log():
    rows = {}
    for case in range(20):
        for rule, right in ((ablation.ALL, case < 18), ("event", case < 12 or case == 19)):
            rows["rig", str(case), rule] = {"right": right, "cpu": 3.0 if rule == ablation.ALL else 0.5}
        for rule in (
            "line",
            "origin",
        ):  # nothing is watched in these: the time without any one rule is theirs
            rows["rig", str(case), rule] = {"right": case < 18, "cpu": 1.0}
    found = ablation.worth(rows, "rig", "event")
    assert (found.count, found.changed) == (20, 7)  # six lost without the rule, one won
    assert found.value == pytest.approx(0.25)
    assert found.low < 0.25 < found.high
    times = {line[0]: line[-1] for line in ablation.table(rows)}
    assert times == {"event": "0.50", "line": "1.00", "origin": "1.00"}
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


def test_what_else_an_answer_says_counts_by_itself():
    both = {"named": ["sensor.lag"], "right": True, "cpu": 1.0}
    rows = {
        ("rig", "1", ablation.ALL): both | {"told": ["sensor.lag"]},
        ("rig", "1", "event"): both | {"told": ["dcv.delay", "sensor.lag"]},
        ("rig", "2", ablation.ALL): both | {"told": ["sensor.lag"]},
        ("rig", "2", "event"): both | {"told": ["sensor.lag"]},
    }
    found = ablation.worth(rows, "rig", "event")
    assert (found.changed, found.named, found.told, found.fired) == (0, 0, 1, 2)


@pytest.fixture
def small(monkeypatch):
    """A module that decides in two steps, and three rules in it: the third shows only in what the module answers."""
    home = ModuleType("small")
    home.sure = lambda x: x > 0.8
    home.doubled = lambda x: 2.0 * x
    home.answer = lambda x: "yes" if home.sure(x) and home.doubled(x) > 1.0 else "no"
    monkeypatch.setitem(sys.modules, "small", home)
    rules = (
        Rule("doubled", "", {"small.doubled": first}),
        Rule("sure", "", {"small.sure": yes}),
        Rule("sure at last", "", {"small.sure": yes}, ("small.answer",)),
    )
    monkeypatch.setattr(ablation, "RULES", rules)
    return home


def fired_on(home, *values):
    """Names of the rules that fire while a module answers, and the answers."""
    fired = set()
    with ablation.watched(fired):
        return [home.answer(v) for v in values], fired


def test_a_rule_fires_where_what_stands_in_its_place_would_decide_otherwise(small):
    plain = small.answer, small.doubled, small.sure
    assert fired_on(small, 0.9) == (["yes"], {"doubled"})
    assert fired_on(small, 0.3) == (["no"], {"sure"})  # the answer is the same all the same
    assert fired_on(small, 0.6) == (["no"], {"sure", "sure at last"})
    assert fired_on(small, 0.9, 0.6) == (["yes", "no"], {"doubled", "sure", "sure at last"})
    assert fired_on(small) == ([], set())
    assert (small.answer, small.doubled, small.sure) == plain


def test_thresholds_properties_and_what_is_yielded_are_watched(monkeypatch):
    class Step:
        size = 2.0
        large = property(lambda self: self.size > home.LIMIT)

    def parts(count):
        yield from range(count)

    home = ModuleType("small")
    home.Step, home.LIMIT, home.parts = Step, 1.0, parts
    monkeypatch.setitem(sys.modules, "small", home)
    rules = (
        Rule("limit", "", {"small.LIMIT": 3.0}, ("small.Step.large",)),
        Rule("parts", "", {"small.parts": empty}),
    )
    monkeypatch.setattr(ablation, "RULES", rules)
    fired: set[str] = set()
    with ablation.watched(fired):
        assert list(home.parts(0)) == []
        assert not fired
        assert list(home.parts(2)) == [0, 1]
        assert fired == {"parts"}
        assert home.Step().large
        assert fired == {"parts", "limit"}
    with ablation.without("limit"):
        assert not home.Step().large


def test_results_are_the_same_only_if_nothing_can_follow_from_a_difference():
    one = SimpleNamespace(a=1)  # nothing is known of it
    assert ablation.same(one, one)
    assert not ablation.same(one, SimpleNamespace(a=1))
    values = np.array([1.0, np.nan])
    assert ablation.same([{"a": (values, np.nan)}], [{"a": (values.copy(), np.nan)}])
    assert not ablation.same(values, values[:1])
    assert not ablation.same(values, np.array([1.0, 2.0]))
    assert not ablation.same([1.0], [1.0, 2.0])
    assert not ablation.same({"a": 1.0}, {"b": 1.0})
    assert not ablation.same([], ())
    assert not ablation.same(None, [])
    assert not ablation.same(True, False)
    chance = replace(NO_EVENT, p_value=0.3, gain=2.0)
    clear = replace(NO_EVENT, p_value=1e-12, gain=50.0)
    assert ablation.same(NO_EVENT, chance)
    assert not ablation.same(NO_EVENT, clear)
    assert ablation.same(clear, replace(clear))
    assert not ablation.same(clear, replace(clear, gain=51.0))


def test_a_child_process_says_which_rules_fired(small, tmp_path, monkeypatch):
    said = tmp_path / "fired.json"
    monkeypatch.setenv(ablation.FIRED, str(said))
    monkeypatch.setattr("cosim.cli.main", lambda arguments: small.answer(*arguments) == "yes")
    assert ablation.as_command(ablation.ALL, [0.9]) == 1
    assert json.loads(said.read_text(encoding="utf-8")) == ["doubled"]
    said.unlink()
    assert ablation.as_command("doubled", [0.9]) == 0
    assert not said.exists()
    monkeypatch.setattr("cosim.cli.main", lambda arguments: 1 / (small.answer(*arguments) == "no"))
    with pytest.raises(ZeroDivisionError):  # what fired before an error is not lost
        ablation.as_command(ablation.ALL, [0.9])
    assert json.loads(said.read_text(encoding="utf-8")) == ["doubled"]


def test_only_logs_on_which_a_rule_fired_are_diagnosed_again_without_it():
    logs, rules = [("rig", "1:0"), ("rig", "1:1"), ("real", "boom")], ["event", "line"]
    rows = {}

    def asked(most=1):
        return [job.key for job in ablation.jobs(logs, rules, rows, most)]

    assert asked() == [("rig", "1:0", ablation.ALL)]
    rows["rig", "1:0", ablation.ALL] = {"right": True, "cpu": 1.0, "named": [], "fired": ["line"]}
    assert asked() == [("rig", "1:0", "line")]  # a log is done before the next begins
    assert asked(2) == [("rig", "1:0", "line"), ("rig", "1:1", ablation.ALL)]
    rows["rig", "1:1", ablation.ALL] = {"right": True, "cpu": 1.0, "named": [], "fired": []}
    rows["real", "boom", ablation.ALL] = {"after": 1.0, "cpu": 1.0, "named": []}  # nobody knows what fired
    assert asked(2) == [("rig", "1:0", "line"), ("real", "boom", "event"), ("real", "boom", "line")]
    assert ablation.worth(rows, "rig", "line").count == 1  # that on which it fired is still to come
    rows["rig", "1:0", "line"] = {"right": False, "cpu": 1.0, "named": ["sensor.lag"]}
    line, event = (ablation.worth(rows, "rig", name) for name in ("line", "event"))
    assert (line.count, line.changed, line.named, line.fired) == (2, 1, 1, 1)
    assert (event.count, event.value, event.changed, event.fired) == (2, 0.0, 0, 0)
    assert ablation.worth(rows, "real", "line") is None
    assert str(event) == "0 of 2"
    rows["rig", "1:1", ablation.ALL]["fired"] = ["event", "line"]
    line, event = (ablation.worth(rows, "rig", name) for name in ("line", "event"))
    assert (line.fired, line.waiting) == (1, 1)
    assert str(line).endswith("1/1/1/1 of 1, 1 not run")
    assert str(event) == "1 of 2, not run"
    assert ablation.in_short([event]) == "fired on 1 of 2 logs, none of which was run without it"
    assert ablation.in_short([line, event]).startswith("fired on 3 of 4 logs (2 not run without it)")


def test_the_sample_takes_each_kind_of_log_in_turn():
    listed = ablation.logs({"rig": 9, "second": 2, "strangers": 0, "real": 0}, 5)
    assert [source for source, _ in listed] == ["rig", "second"] * 2 + ["rig"] * 7
    drawn = {c.number: c for c in ablation.cases(ablation.DRAWN, 5)}
    kinds = {c.kind for c in drawn.values()}
    assert len(kinds) == 9
    assert {drawn[int(case.partition(":")[2])].kind for source, case in listed if source == "rig"} == kinds
    valve = "continuity.cracking_pressure"
    hiding = ablation.logs({"rig": 3, "second": 2, "strangers": 0, "real": 0}, 5, [valve])
    assert len(hiding) == 5
    for source, case in hiding:
        number = int(case.partition(":")[2])
        hidden = ablation.draw(number).hidden if source == "second" else drawn[number].hidden
        assert valve in hidden


def test_names_and_errors_of_shaken_logs_stand_beside_one_another():
    def row(fit, after, *names):
        return real_logs.Row(
            "m", "boom", [fit], ["b.csv"], unit="deg", after=after, causes={n: {} for n in names}
        )

    rows = [
        (1, row("a.csv", 2.2, "mechanical.end_stop", "dead_zone.mismatch")),
        (0, row("a.csv", 2.0, "dead_zone.mismatch", "mechanical.end_stop")),
        (0, row("c.csv", 3.0)),
        (1, row("c.csv", 6.0, "dcv.delay")),
    ]
    first, second, all_of_them = rounding.summary(rows)
    assert first.startswith("boom: a -> b")
    assert first.endswith("2 2.2 deg  end_stop mismatch")
    assert second.endswith("3 6 deg  none | delay")
    assert all_of_them == (
        "1 of 2 with the same names each time; largest error over smallest: 1.550 in the median, 2.000 at most"
    )


def test_a_shaken_log_differs_below_any_sensors_digit(monkeypatch, tmp_path):
    file = Path(real_logs.TOP, "examples", "synthetic_demo.csv")
    machine, log, prepare = our_machine("full_order"), load_log(file), diagnose.prepare
    plain = prepare(log, machine).signals["slew"]
    found = []
    monkeypatch.setattr(
        "cosim.cli.main", lambda: found.append(diagnose.prepare(log, machine).signals["slew"])
    )
    for seed in (0, 3):
        monkeypatch.setattr(diagnose, "prepare", prepare)
        monkeypatch.setattr(sys, "argv", [])
        rounding.shaken_cosim(seed, ["diagnose"])
    assert np.array_equal(found[0], plain)
    assert 0.0 < np.max(np.abs(found[1] / plain - 1.0)) < 6e-12
