"""What lies behind the page: guesses, the mapping that is made of the form, refusals by name, the diagnosis itself."""

import csv
import json
import shutil
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cosim
from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden, read, simulate
from cosim import rig
from cosim.browser.form import find, named
from cosim.browser.mapping import FormError, toml_text
from cosim.browser.session import Session, Work
from cosim.errors import CosimError, DataError, UsageError
from cosim.logs import load_mapping
from cosim.logs.overview import overview
from cosim.paths import examples_folder

TOP = Path(__file__).resolve().parents[2]
HEAD = b"[time]\nstep = 1\n[signals.u]\ncolumn = 1\n"
LAGE = 6  # column of the angle in the German log


@pytest.fixture
def session(tmp_path):
    folder = tmp_path / "dropped"
    folder.mkdir()
    return Session(folder, tmp_path / "out")


def drop(session, file, name=None, suffix=None):
    """As the server does it: a copy under a name of its own."""
    suffix = suffix or file.suffix
    copy = session.folder / f"{time.monotonic_ns():016x}{suffix}"
    shutil.copy(file, copy)
    session.take(copy, suffix, name or file.name)
    return copy


def column_of(session):
    return {row["signal"]: row["column"] for row in session.state()["form"]["rows"]}


def mapping_made(session, given):
    """The text of the mapping that would be diagnosed with."""
    session.ask("diagnose", given)
    return session._asked.get_nowait().mapping


def finished(session):
    """Let the main thread work until the diagnosis has ended; returns its state."""

    def wait():
        while session.state()["work"]["state"] in ("running", "stopping"):
            time.sleep(0.05)
        session.close()

    watch = threading.Thread(target=wait)
    watch.start()
    session.work()
    watch.join()
    return session.state()["work"]


def test_the_second_record_that_a_mapping_holds_out_judges(session, tmp_path, monkeypatch):
    log, table = tmp_path / "two.csv", tmp_path / "two.toml"
    rows = [f"{k / 100},{k % 2},{k},{1 - k % 2},{-k}" for k in range(200)]
    log.write_text("\n".join(["t [s],uEst,yEst,uVal,yVal", *rows]) + "\n")
    table.write_text(
        'time.column = "t [s]"\n[signals.u]\ncolumn = "uEst"\nunit = "1"\n[signals.slew]\ncolumn = "yEst"\nunit = "deg"\n'
        '[held_out]\nu = "uVal"\nslew = "yVal"\n'
    )
    asked = {}

    class TakenError(CosimError):
        pass

    def diagnose(logs, model, **options):
        asked.update(logs=logs, **options)
        raise TakenError("it is enough to know what is asked for")

    monkeypatch.setattr("cosim.browser.session.api.diagnose", diagnose)
    drop(session, log)
    drop(session, table)
    rows = {"u": {"column": 1, "unit": "1"}, "slew": {"column": 2, "unit": "deg"}}
    session.ask("diagnose", {"time": {"column": 0, "unit": "s"}, "rows": rows})
    assert "enough" in finished(session)["error"]
    (second,) = asked["held_out"]
    assert second.source == Path("two.csv")
    np.testing.assert_allclose(np.degrees(second["slew"]), -np.arange(200.0))
    np.testing.assert_allclose(np.degrees(asked["logs"][0]["slew"]), np.arange(200.0))


def test_a_signal_that_has_no_column_is_not_held_out_either(session, tmp_path):
    log, table = tmp_path / "two.csv", tmp_path / "two.toml"
    log.write_text("t [s],u,a,b\n" + "".join(f"{k / 100},{k % 2},{k},{k}\n" for k in range(90)))
    table.write_text(
        'time.column = "t [s]"\n[signals.u]\ncolumn = "u"\nunit = "1"\n[signals.slew]\ncolumn = "a"\nunit = "deg"\n'
        '[signals.p_a]\ncolumn = "b"\nunit = "bar"\n[held_out]\nslew = "b"\np_a = "a"\n'
    )
    drop(session, log)
    drop(session, table)
    rows = {"u": {"column": 1, "unit": "1"}, "slew": {"column": 2, "unit": "deg"}, "p_a": {"column": None}}
    made = mapping_made(session, {"time": {"column": 0, "unit": "s"}, "rows": rows})
    assert tomllib.loads(made)["held_out"] == {"slew": "b"}


def test_what_cosim_init_guesses_is_filled_in(session, german):
    drop(session, german)
    state = session.state()
    assert state["log"]["name"] == "Messung März.csv"
    assert (state["log"]["samples"], state["log"]["gaps"]) == (8001, 0)
    assert [state["form"]["time"][key] for key in ("column", "unit")] == [0, "ms"]
    found = column_of(session)
    assert [found[n] for n in ("u", "spool", "p_supply", "p_a", "p_b")] == [1, 2, 3, 4, 5]
    assert found["slew"] is None, "nobody can know that 'Lage' is an angle"
    picture = state["log"]["columns"][1]["picture"]
    assert 10 < len(picture) <= 400
    assert all(0.0 <= x <= 1.0 and 0.0 <= y <= 1.0 for x, y in picture)
    json.dumps(state, allow_nan=False)
    again = session.state(str(state["revision"]))
    assert again.keys() == state.keys() - {"log", "form", "beside", "words"}, (
        "a page that knows them is not sent them again"
    )
    assert session.state(str(state["revision"] - 1)).keys() == state.keys()


def test_the_mapping_reads_the_log_as_it_was_meant(session, german, filled, tmp_path):
    drop(session, german)
    text = mapping_made(session, filled(session.state(), slew=LAGE))
    file = tmp_path / "m.toml"
    file.write_text(text, encoding="utf-8")
    log = cosim.read_log(german, file)
    true = cosim.make_log("steps", 8.0, ["mechanical.coulomb_friction:tau_c=300 N.m"], seed=2)
    assert log.model == "full_order"
    assert set(log.signals) == set(true.signals)
    for name in true.signals:
        np.testing.assert_allclose(log[name], true[name], rtol=1e-6, atol=1e-9 * np.max(np.abs(true[name])))


def test_scaling_of_the_form_goes_into_the_mapping(session, german, filled):
    drop(session, german)
    given = filled(session.state(), slew=LAGE)
    given["rows"]["slew"] |= {"gain": "-2,5", "zero": "10.5", "reversed": True, "unit": " rad "}
    given["time"] = {"column": None, "step": "0,001", "unit": "s"}
    made = tomllib.loads(mapping_made(session, given))
    assert made["signals"]["slew"] == {
        "column": "Lage",
        "unit": "rad",
        "gain": -2.5,
        "zero": 10.5,
        "sign": -1,
    }
    assert made["signals"]["u"] == {"column": "Ventilbefehl (%)", "unit": "%"}
    assert made["time"] == {"step": 0.001, "unit": "s"}
    form = session.state()["form"]
    (row,) = [row for row in form["rows"] if row["signal"] == "slew"]
    kept = {key: row[key] for key in ("column", "unit", "gain", "zero", "reversed")}
    assert kept == {"column": LAGE, "unit": "rad", "gain": -2.5, "zero": 10.5, "reversed": True}, (
        "after a reload"
    )
    assert (form["time"]["column"], form["time"]["step"]) == (None, 0.001)


def change(**values):
    return lambda given: given["rows"]["slew"].update(values)


@pytest.mark.parametrize(
    ("spoil", "row", "said"),
    [
        (lambda g: g["rows"]["u"].update(column=None), "u", r"u \(slew valve command .* has no column"),
        (change(column=1), "slew", r"u and slew are the same column 'Ventilbefehl \(%\)'"),
        (change(column=99), "", "there is no column 100: the log has 7"),
        (change(column=-1), "", "there is no column 0"),
        (change(column=True), "slew", "True is no column"),
        (change(column="../x"), "slew", "'../x' is no column"),
        (change(unit="bar"), "slew", "slew.*'bar'.*dimension"),
        (change(unit="a b c"), "slew", "'a b c' is not a unit"),
        (change(unit=""), "slew", "slew has no unit"),
        (change(unit=None), "slew", "slew has no unit"),
        (change(gain="two"), "slew", "gain 'two' is no number"),
        (change(gain=float("inf")), "slew", "gain must be a finite number"),
        (change(gain=0), "slew", "a gain of 0 leaves nothing"),
        (change(zero=[1]), "slew", "zero .* is no number"),
        (lambda g: g.update(rows=[]), "", "rows is no table"),
        (lambda g: g["rows"].update(slew=5), "", "slew is no table"),
        (lambda g: [g["rows"][n].update(column=None) for n in g["rows"]], "u", "has no column"),
        (lambda g: g.update(rows={"u": g["rows"]["u"]}), "", "nothing to compare .* for the slew angle"),
        (lambda g: g["time"].update(column=None), "time", "time has no column"),
        (lambda g: g["time"].update(column=1), "time", "cannot be time and a signal at once"),
        (lambda g: g["time"].update(unit="bar"), "time", "'bar'"),
        (lambda g: g["time"].update(column=None, step=-1), "time", "must be positive"),
        (lambda g: g.update(budget="soon"), "budget", "'soon' is not a number with a unit"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_the_form_is_named(session, german, filled, spoil, row, said):
    drop(session, german)
    given = filled(session.state(), slew=LAGE)
    spoil(given)
    with pytest.raises(CosimError, match=said) as error:
        session.ask("diagnose", given)
    assert getattr(error.value, "row", "") == row
    assert session.state()["work"]["state"] == "idle"
    assert not session.out.exists()


def test_without_a_log_there_is_nothing_to_diagnose(session):
    with pytest.raises(FormError, match="drop one first"):
        session.ask("diagnose", {})


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", b"hello\nworld\n", "a.csv holds no column of numbers"),
        ("a.csv", b"", r"a\.csv"),
        ("a.csv", b"\x00\x01\x02" * 300, r"a\.csv"),
        ("a.mat", b"MATLAB 5.0", r"a\.mat.* cannot be read"),
        ("a.parquet", b"PAR1", r"a\.parquet.* cannot be read"),
        ("a.ssp", b"PK\x03\x04", r"a\.ssp"),
        ("a.fmu", b"no archive", r"a\.fmu"),
        ("a.toml", b"[signals", r"a\.toml: the mapping is not valid TOML"),
        ("a.toml", b"\xff", r"a\.toml: the mapping cannot be read"),
        ("a.toml", b"[signals.u]\ncolumn = 1\n", r"a\.toml: 'time' is missing"),
        ("a.toml", HEAD + b"[machine]\nchain = ['x']\n", r"a\.toml.*'x'"),
        ("a.toml", HEAD + b"[compare]\nparameters = ['/etc/x.ssv']\n", "names other files"),
    ],
)  # fmt: skip
def test_a_file_that_is_not_what_its_name_says(session, tmp_path, name, content, said):
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(CosimError, match=said) as error:
        drop(session, file)
    assert str(session.folder) not in str(error.value)
    assert list(session.folder.iterdir()) == []
    assert session.state()["log"] is None


def test_a_log_that_replaces_another_takes_its_place(session, german, tmp_path):
    first = drop(session, german)
    with pytest.raises(DataError):
        drop(session, TOP / "README.md", "b.csv", ".csv")
    assert first.exists()
    assert session.state()["log"]["name"] == german.name, "a bad file takes nothing away"
    second = drop(session, examples_folder() / "synthetic_demo.csv", "c.csv")
    assert list(session.folder.iterdir()) == [second]
    assert column_of(session)["slew"] is not None


def beside(session):
    return [(b["name"], b["role"]) for b in session.state()["beside"]]


def part(german, path, *rows):
    """Some rows of the German log as a log of its own."""
    lines = german.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([lines[0], *(line for first, last in rows for line in lines[first:last])]))
    return path


@pytest.fixture
def tracker(tmp_path):
    file = tmp_path / "tracker.csv"
    rows = (f"{0.0125 * k:.4f},{10 + 0.01 * k:.3f}" for k in range(600))
    file.write_text("\n".join(["time [s],slew_external [deg]", *rows]) + "\n")
    return file


def add(session, file, role):
    copy = session.folder / f"{time.monotonic_ns():016x}{file.suffix}"
    shutil.copy(file, copy)
    session.take(copy, file.suffix, file.name, role)
    return copy


def test_more_files_of_one_machine(session, german, tracker, filled, tmp_path):
    one, two = part(german, tmp_path / "one.csv", (1, 4000)), part(german, tmp_path / "two.csv", (4000, 8000))
    add(session, tracker, "log")  # whatever the page calls it, and before the log
    add(session, german, "log")
    add(session, one, "more")
    kept = add(session, two, "held_out")
    assert beside(session) == [("tracker.csv", "external"), ("one.csv", "more"), ("two.csv", "held_out")]
    other = tmp_path / "other.csv"
    other.write_text("time [s],level [m]\n0,1\n1,2\n2,3\n")
    for file, role, why in (
        (other, "more", r"other\.csv has other columns than Messung März\.csv"),
        (german, "held_out", r"Messung März\.csv is the same record as Messung März\.csv"),
        (two, "../x", "there is no log"),
    ):
        with pytest.raises(CosimError, match=why):
            add(session, file, role)
    again = tmp_path / "again.csv"
    again.write_text(tracker.read_text() + "7.5,16\n")
    add(session, again, "external")
    assert ("tracker.csv", "external") not in beside(session), "there is one tracker"
    for place in (3, -1, "0", None):
        with pytest.raises(UsageError, match="no such file"):
            session.ask("remove", {"place": place})
    with pytest.raises(FormError, match="the tracker goes with one log"):
        session.ask("diagnose", filled(session.state(), slew=LAGE))
    session.ask("remove", {"place": beside(session).index(("again.csv", "external"))})
    session.ask("diagnose", filled(session.state(), slew=LAGE))
    asked = session._asked.get_nowait()
    assert [f.name for f in asked.logs] == [german.name, "one.csv"]
    assert [f.name for f in asked.held_out] == ["two.csv"]
    assert asked.external is None
    session._work.state = "idle"
    session.ask("remove", {"place": [name for name, _ in beside(session)].index("two.csv")})
    assert not kept.exists()
    drop(session, one)
    assert beside(session) == [], "another log is another case"
    assert len(list(session.folder.glob("*.csv"))) == 1


def test_the_next_log_of_a_logger_keeps_what_was_chosen(session, german, filled, tmp_path):
    drop(session, german)
    session.ask("diagnose", filled(session.state(), slew=LAGE))
    session._work.state = "done"
    drop(session, part(german, tmp_path / "next.csv", (1, 4000)))
    assert column_of(session)["slew"] == LAGE
    drop(session, examples_folder() / "synthetic_demo.csv")
    assert column_of(session)["slew"] not in (None, LAGE - 1), "guessed anew"


@pytest.mark.slow
@pytest.mark.parametrize("roles", [("log", "more", "held_out"), ("log", "held_out")])
def test_more_files_are_diagnosed_together(session, filled, tmp_path, roles):
    hidden = ["mechanical.coulomb_friction:tau_c=300 N.m"]
    for k, role in enumerate(roles, 2):
        file = tmp_path / f"run{k}.csv"
        run = rig.make_log("steps", 10.0, hidden, seed=k, tracker=role == "log" and "more" not in roles)
        rig.write(run, file)
        add(session, file, role)
        if run.tracker is not None:
            rig.write_tracker(run, tmp_path / "tracker.csv")
            add(session, tmp_path / "tracker.csv", "log")
    session.ask("diagnose", filled(session.state()))
    work = finished(session)
    assert (work["state"], work["error"], work["verdict"]) == ("done", "", "explained")
    answer = json.loads((Path(work["folder"]) / "diagnosis.json").read_text())
    made = answer["made"]
    names = [f"run{k}" for k in range(2, 2 + len(roles))]
    assert [made.get(key) for key in ("log", "log_2", "log_held_out")] == [
        names[0],
        names[1] if "more" in roles else None,
        names[-1],
    ]
    assert ("tracker.clock" in answer["not_exercised"]) == ("more" in roles), "the tracker was heard"
    assert str(session.folder) not in json.dumps(made)


def test_a_file_of_the_command_line_is_read_where_it_lies(session, german):
    session.take_own(german)
    drop(session, examples_folder() / "synthetic_demo.csv")
    assert german.is_file()


def test_a_machine_file_keeps_what_it_says_and_its_columns_may_be_changed(session, german, filled):
    file = examples_folder() / "machines" / "mini_excavator_swing.toml"
    drop(session, file)
    drop(session, german)
    state = session.state()
    assert state["model"] == "own"
    assert [m["label"] for m in state["models"]][-1] == file.name
    rows = {row["signal"]: row for row in state["form"]["rows"]}
    assert set(rows) == {"u", "slew"}
    assert all(row["needed"] for row in rows.values())
    assert [rows[name]["column"] for name in ("u", "slew")] == [1, None], "guessed as `cosim init` does"
    assert "'Swing Cmd', which this log does not have" in rows["u"]["check"]
    with pytest.raises(FormError, match=r"slew .* has no column"):
        session.ask("diagnose", filled(state))
    made = tomllib.loads(mapping_made(session, filled(state, slew=LAGE)))
    before = tomllib.loads(file.read_text(encoding="utf-8"))
    assert made["machine"] == before["machine"]
    assert made["diagnose"] == before["diagnose"]
    assert made["signals"]["u"]["column"] == "Ventilbefehl (%)"
    assert made["signals"]["u"]["unit"] == "%", "of the column that was guessed"
    assert "zero" not in made["signals"]["u"]


def motor(file, dead=0.0):
    """10 s of a motor whose speed, in revolutions a minute, follows its voltage beyond a dead zone."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 10.0, 0.01)
    volts = np.repeat(rng.uniform(-12.0, 12.0, 20), 50)
    speed = np.zeros(t.size)
    for k in range(1, t.size):
        drive = np.sign(volts[k - 1]) * max(abs(volts[k - 1]) - dead, 0.0)
        speed[k] = speed[k - 1] + 0.1 * (20.0 * drive - speed[k - 1])
    speed += rng.normal(0.0, 0.3, t.size)
    lines = ["t [s],motor voltage [V],speed [rpm]", *map("{:.2f},{:.3f},{:.3f}".format, t, volts, speed)]
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


def test_a_log_of_a_motor_begins_with_a_machine_of_its_own(session, german, filled, tmp_path):
    drop(session, motor(tmp_path / "motor.csv"))
    state = session.state()
    assert state["model"] == "machine"
    found = column_of(session)
    assert (found["u"], found["speed"]) == (1, 2)
    with pytest.raises(UsageError, match="nothing drives the machine"):
        session.ask("diagnose", filled(state, u=None))
    # a log of the crane is the crane's again, but what a person has chosen stays
    drop(session, german)
    assert session.state()["model"] == "full_order"
    session.ask("model", {"model": "machine"})
    drop(session, german)
    state = session.state()
    assert state["model"] == "machine"
    assert column_of(session)["travel"] == LAGE
    made = tomllib.loads(mapping_made(session, filled(state)))
    assert (made["machine"]["motion"], made["machine"]["output"]) == ("travel", "travel")
    assert "model" not in made


def test_a_motor_is_diagnosed_without_a_file_of_its_own(session, filled, tmp_path):
    drop(session, motor(tmp_path / "motor.csv", dead=3.0))
    session.ask("diagnose", filled(session.state()))
    work = finished(session)
    assert work["state"] == "done", work["error"]
    made = tomllib.loads((Path(work["folder"]) / "mapping.toml").read_text(encoding="utf-8"))
    assert (made["machine"]["output"], made["machine"]["drive"]) == ("speed", "electric")
    said = " ".join(text for _, text in work["lines"])
    assert "dead_zone" in said, said


def test_a_mapping_that_names_a_model_asks_for_it(session, german, filled, tmp_path):
    file = tmp_path / "m.toml"
    file.write_text(
        'model = "../secret/drive.ssp"\ntime = { step = 0.001 }\n[signals.u]\ncolumn = 2\nunit = "%"\n'
    )
    drop(session, file)
    drop(session, german)
    with pytest.raises(FormError, match=r"names the model '\.\./secret/drive\.ssp': drop that file too"):
        session.ask("diagnose", filled(session.state()))


def test_our_models_by_name(session, german, filled):
    session.ask("model", {"model": "simplified"})
    drop(session, german)
    assert 'model = "simplified"' in mapping_made(session, filled(session.state(), slew=LAGE))
    with pytest.raises(UsageError, match="no model 'own'"):
        session.choose("own")


def test_nothing_is_taken_while_a_diagnosis_runs(session, german, filled):
    drop(session, german)
    session.ask("diagnose", filled(session.state(), slew=LAGE))
    for press in (lambda: drop(session, german), lambda: session.ask("model", {"model": "simplified"})):
        with pytest.raises(UsageError, match="a diagnosis runs: stop it first"):
            press()
    assert len(list(session.folder.glob("*.csv"))) == 1


TEXT = st.text(st.characters(codec="utf-8"), max_size=20)
VALUE = st.recursive(
    TEXT | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


KEY = TEXT.filter(lambda key: key != "signals")


@settings(max_examples=40)
@given(
    st.dictionaries(KEY, VALUE, max_size=4),
    st.dictionaries(TEXT, st.dictionaries(TEXT, VALUE, max_size=3), max_size=3),
)
def test_what_is_written_as_toml_is_read_as_it_was(content, signals):
    defaults = {"gain": 1.0, "zero": 0.0, "sign": 1, "offset": 0.0}
    kept = {name: {k: v for k, v in entry.items() if v != defaults.get(k)} for name, entry in signals.items()}
    whole = {k: v for k, v in content.items() if v != {}} | ({"signals": kept} if kept else {})
    assert tomllib.loads(toml_text({**content, "signals": signals}, "made")) == whole


def test_columns_of_one_name_are_told_apart_by_their_place(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t [s],p [bar],p [bar],\n0,1,2,3\n1,2,3,4\n2,1,2,3\n")
    found = overview(file)
    assert [named(found, k) for k in range(3)] == ["t [s]", 2, 3]
    assert [find(found, named(found, k)) for k in range(3)] == [0, 1, 2]
    assert find(found, "p") is None
    assert find(found, 9) is None


def test_a_diagnosis_that_fails_says_why_and_leaves_no_folder(session, tmp_path, filled):
    file = tmp_path / "short.csv"
    rows = [f"{k / 100},{k % 3 / 10},{k / 10}" for k in range(12)]
    file.write_text("\n".join(["time [s],u [1],slew [deg]", *rows]) + "\n")
    drop(session, file)
    session.ask("diagnose", filled(session.state()))
    work = finished(session)
    assert work["state"] == "failed"
    assert "short.csv: the log has 12 samples" in work["error"]
    assert work["folder"] == ""
    assert list(session.out.iterdir()) == []


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A stranger's package of two native FMUs, and a log of it with a gain of 1.15 hidden at the valve's output."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("drive")
    kinds = {"valve": "lag", "plant": "second"}
    values = {"valve": {"K": 2.0, "T": 0.1}, "plant": {"K": 0.7, "W": 5.0, "ZETA": 0.4}}
    wires = [("command", "valve.u"), ("valve.y", "plant.u")]
    package = parts.write_ssp(
        folder / "drive.ssp",
        {name: parts.native(kind, folder) for name, kind in kinds.items()},
        wires,
        values,
    )
    rng = np.random.default_rng(2)
    t = 0.01 * np.arange(1000)
    command = np.repeat(rng.uniform(-1.0, 1.0, 11), 100)[:1000] + 0.2 * np.sin(2 * np.pi * 0.7 * t)
    hidden = [Hidden("port.gain", "valve.y", "output", {"gain": 1.15})]
    signals = read(
        simulate(kinds, values, wires, {"command": command}, 0.01, hidden), hidden, 0.01, 0.01, rng
    )
    log = folder / "run.csv"
    with log.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["Time (s)", "Command", "valve_y", "Weg (1)"])
        writer.writerows(zip(t, *(signals[n] for n in ("command", "valve.y", "plant.y")), strict=True))
    return package, log


def test_a_stranger_s_package_is_mapped_and_diagnosed(session, drive, filled):
    package, log = drive
    drop(session, log, "Fahrt 1.csv")
    drop(session, package)
    state = session.state()
    rows = {row["signal"]: row["column"] for row in state["form"]["rows"]}
    assert rows["command"] == 1
    assert rows["valve.y"] == 2
    assert rows["plant.y"] is None
    session.ask("diagnose", filled(state, **{"plant.y": 3}))
    work = finished(session)
    assert work["error"] == ""
    assert work["state"] == "done"
    assert work["verdict"] == "explained"
    assert any("port.gain" in answer and "valve.y" in answer for _, answer in work["lines"])
    folder = Path(work["folder"])
    assert "model drive.ssp)" in work["lines"][0][1], "by the name under which it was dropped"
    assert str(session.folder) not in (folder / "diagnosis.json").read_text()
    assert tomllib.loads((folder / "mapping.toml").read_text())["signals"]["plant.y"]["column"] == "Weg (1)"
    if work["report"]:
        assert b"Fahrt 1" in session.report()
    assert session.done == [{"folder": str(folder), "verdict": "explained"}]


def test_parameters_of_a_model_are_trusted_or_fitted_as_the_page_says(session, drive, filled, tmp_path):
    """Only a mapping could say how well a parameter is known, so the page could name none."""
    package, log = drive
    drop(session, log)
    drop(session, package)
    state = session.state()
    rows = {row["name"]: row for row in state["form"]["numbers"]}
    assert {"valve.K", "valve.T", "plant.ZETA"} <= rows.keys()
    assert (rows["valve.K"]["value"], rows["valve.K"]["trusted"], rows["valve.K"]["free"]) == (2.0, "", False)
    given = filled(state)
    assert "diagnose" not in tomllib.loads(mapping_made(session, given)), (
        "each is exact until somebody says more"
    )
    session._work = Work()
    given["numbers"] = {
        "valve.K": {"trusted": " 2,5% "},
        "plant.W": {"trusted": "10"},
        "plant.K": {"trusted": "1 %", "free": True},
    }
    made = tomllib.loads(mapping_made(session, given))
    assert made["diagnose"] == {"trusted": {"valve.K": "2.5 %", "plant.W": "10 %"}, "free": ["plant.K"]}
    rows = {row["name"]: row for row in session.state()["form"]["numbers"]}
    session._work = Work()
    assert (rows["valve.K"]["trusted"], rows["plant.K"]["free"]) == ("2.5 %", True), (
        "a page that is opened again shows it"
    )
    for text, said in (
        ("well", "'well' does not say how well it is known"),
        ("-1 %", "it cannot be known to '-1 %'"),
    ):
        with pytest.raises(FormError, match=said) as error:
            session.ask("diagnose", {**given, "numbers": {"valve.K": {"trusted": text}}})
        assert error.value.row == "valve.K"
    (tmp_path / "known.toml").write_text(
        'time = { column = "Time (s)", unit = "s" }\n[signals]\ncommand = { column = "Command", unit = "1" }\n'
        '[signals."valve.y"]\ncolumn = "valve_y"\nunit = "1"\n'
        '[diagnose]\ntrusted = { "valve.T" = 0.03 }\nfree = ["plant.ZETA"]\n'
    )
    drop(session, tmp_path / "known.toml")
    rows = {row["name"]: row for row in session.state()["form"]["numbers"]}
    assert (rows["valve.T"]["trusted"], rows["plant.ZETA"]["free"], rows["valve.K"]["trusted"]) == (
        "3 %",
        True,
        "",
    )


VOLTS = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Volts(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.slew = 0.0, 0.0
        self.register_variable(Real("u", causality=Fmi2Causality.input, description="motor voltage [V]"))
        self.register_variable(Real("slew", causality=Fmi2Causality.output, description="position [mm]"))

    def do_step(self, t, step):
        return True
"""


def test_a_connector_that_is_called_like_a_signal_of_ours_is_not_it(session, tmp_path):
    """A voltage called u was refused: "expected one like '1'"."""
    parts.by_pythonfmu("Volts", VOLTS, tmp_path)
    log = tmp_path / "log.csv"
    log.write_text(
        "t,u [V],slew [mm]\n" + "".join(f"{0.02 * k:.2f},{k % 7},{k * k / 100}\n" for k in range(100))
    )
    drop(session, tmp_path / "Volts.fmu")
    drop(session, log)
    form = session.state()["form"]
    made = mapping_made(session, {"time": form["time"], "rows": {row["signal"]: row for row in form["rows"]}})
    (tmp_path / "made.toml").write_text(made)
    signals = load_mapping(tmp_path / "made.toml").signals
    assert {name: column.unit for name, column in signals.items()} == {"u": "V", "Volts.slew": "mm"}


@pytest.mark.parametrize("chosen", [True, False])
def test_an_input_that_moves_in_steps_stays_until_the_next_sample(session, drive, filled, tmp_path, chosen):
    package, _ = drive
    t = 0.01 * np.arange(400)
    steps = np.where(t < 1.0, 0.0, np.where(t < 2.0, 0.7, -0.4))
    log = tmp_path / "steps.csv"
    rows = [f"{a:.2f},{b:.1f},{c:.6f}" for a, b, c in zip(t, steps, np.sin(t), strict=True)]
    log.write_text("\n".join(["Time (s),Command,valve_y", *rows]))
    drop(session, log)
    drop(session, package)
    state = session.state()
    shown = {row["signal"]: row["held"] for row in state["form"]["rows"]}
    assert shown == {"command": True, "valve.y": None, "plant.u": None, "plant.y": None}, (
        "of what a log may drive alone"
    )
    given = filled(state)
    given["rows"]["command"]["held"] = chosen
    signals = tomllib.loads(mapping_made(session, given))["signals"]
    assert (signals["command"]["held"], "held" in signals["valve.y"]) == (chosen, False)
    rows = {row["signal"]: row["held"] for row in session.state()["form"]["rows"]}
    assert rows["command"] is chosen, "a page that is opened again shows it"


BOOM = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Boom(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.cmd, self.ang, self.ang_0 = 0.0, 0.0, 0.0
        self.register_variable(Real("cmd", causality=Fmi2Causality.input, description="duty of the boom valve [%]"))
        self.register_variable(Real("ang", causality=Fmi2Causality.output, description="boom angle [deg]"))
        self.register_variable(Real("ang_0", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, t, step):
        return True
"""


def test_a_model_that_states_nothing_is_taken_at_its_descriptions_and_begins_where_the_log_does(
    session, tmp_path
):
    """Its component was called like the copy, its inputs counted in 1 for %, and it began at 0."""
    parts.by_pythonfmu("Boom", BOOM, tmp_path)
    t = 0.02 * np.arange(200)
    down = 50.0 * ((t > 1.0) & (t < 3.0))
    log = tmp_path / "log.csv"
    table = np.column_stack([t, 0.0 * t, down, 12.0 - 0.004 * np.cumsum(down)])
    np.savetxt(
        log, table, "%.6g", delimiter=",", header="time,Boom_up_duty,Boom_dn_duty,Boom_ang", comments=""
    )
    drop(session, tmp_path / "Boom.fmu")
    drop(session, log)
    form = session.state()["form"]
    given = {"time": form["time"], "rows": {row["signal"]: row for row in form["rows"]}}
    made = tomllib.loads(mapping_made(session, given))
    assert made["signals"]["cmd"] == {
        "column": "Boom_up_duty", "unit": "%", "held": True, "minus": "Boom_dn_duty",
    }  # fmt: skip
    assert made["signals"]["Boom.ang"] == {"column": "Boom_ang", "unit": "deg"}
    assert made["compare"] == {
        "units": {"cmd": "%", "Boom.ang": "deg"},
        "start": {"Boom.ang_0": "Boom.ang"},
    }
    assert "begins at 12: the model begins there by Boom.ang_0" in [row["text"] for row in form["rows"]]
