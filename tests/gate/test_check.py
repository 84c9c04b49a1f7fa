"""``cosim check``: limits in a file, exit codes, JUnit XML, the block that became worse and the cause."""

import json
import re
import shutil
import tomllib

import pytest
from lxml import etree

from cosim.gate.limits import Check, Limit, Reference, read_check, write_check
from cosim.logs import write_log
from cosim.paths import ssp_folder
from cosim.rig import as_log, make_log
from cosim.ssp.write import write_ssp

MECHANICS = "mechanical + sensor"


@pytest.fixture
def run(command, built):
    return command


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The nominal crane; long enough for a diagnosis."""
    path = tmp_path_factory.mktemp("logs") / "reference.csv"
    write_log(as_log(make_log("steps", 12.0, seed=5)), path)
    return path


@pytest.fixture(scope="module")
def heavier(tmp_path_factory):
    """The nominal model with 1.4 times its inertia."""
    folder = tmp_path_factory.mktemp("worse") / "ssp"
    shutil.copytree(ssp_folder(), folder)
    path = folder / "nominal" / "mechanical.ssv"
    text, count = re.subn(
        r'(name="J".*?value=")[^"]+', r"\g<1>1069.5", path.read_text(encoding="utf-8"), flags=re.S
    )
    assert count == 1
    path.write_text(text, encoding="utf-8")
    return write_ssp(folder / "full_order.ssd", folder.parent / "heavier.ssp", open=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Where the limits of the nominal model are written once; as deep as a test's own folder, for the paths in it."""
    return tmp_path_factory.mktemp("made") / "checks"


@pytest.fixture
def file(run, log, made, tmp_path):
    """Limits of the nominal model."""
    path = made / "cosim-check.toml"
    if not path.exists():
        made.mkdir()
        code, out, err = run("check", path, "--add", log, "--no-cause")
        assert code == 0, err
        assert f"written: {path}" in out
    return shutil.copytree(made, tmp_path / "checks") / path.name


def test_limits_are_written_with_a_margin_and_kept(run, file, log):
    item = tomllib.loads(file.read_text(encoding="utf-8"))["reference"][0]
    assert (file.parent / item["log"]).resolve() == log.resolve()
    slew = item["signals"]["slew"]
    limit, was = (float(slew[name].split()[0]) for name in ("limit", "was"))
    assert slew["limit"].endswith(" deg")
    assert limit == pytest.approx(1.1 * was, rel=2e-3)
    assert set(item["blocks"]) == {"compensator + dead_zone + dcv", "continuity", MECHANICS}
    code, out, _ = run("check", file)
    assert code == 0
    assert out.splitlines()[-1] == "Passed: 1 reference log"


def test_a_worse_model_is_named_by_its_block_in_words_json_and_junit(run, file, heavier, tmp_path):
    junit = tmp_path / "out" / "junit.xml"
    before = file.read_bytes()
    code, out, _ = run("check", file, "--model", heavier, "--no-cause", "--junit", junit, "--json")
    found = json.loads(out)
    assert code == 1
    assert file.read_bytes() == before
    (item,) = found["references"]
    assert item["worse"] == MECHANICS
    broken = {(one["block"], one["signal"]) for one in item["limits"] if not one["passed"]}
    assert {(None, "slew"), (MECHANICS, "slew")} <= broken
    assert not any(block in ("continuity", "compensator + dead_zone + dcv") for block, _ in broken)
    root = etree.parse(junit).getroot()
    (suite,) = root.findall("testsuite")
    assert suite.get("tests") == str(len(item["limits"])) == str(len(suite.findall("testcase")))
    failed = [case.get("name") for case in suite.findall("testcase") if case.find("failure") is not None]
    assert len(failed) == len(broken) == int(suite.get("failures"))
    assert f"slew of {MECHANICS}" in failed
    assert f"Worse: {MECHANICS}" in suite.find("testcase/failure").text


def test_an_update_takes_the_worse_model_as_it_is(run, file, heavier):
    assert run("check", file, "--model", heavier, "--update", "--margin", "25 %", "--no-cause")[0] == 0
    kept = read_check(file)
    assert kept.margin == "25 %"
    assert run("check", file, "--model", heavier, "--no-cause")[0] == 0
    # the model that the file names stays what it was
    assert kept.reference[0].model is None


def test_a_log_that_is_gone_is_an_error_in_its_place_and_the_others_are_checked(run, file, log, tmp_path):
    second = tmp_path / "second.csv"
    shutil.copy(log, second)
    assert run("check", file, "--add", second, "--no-cause")[0] == 0
    second.unlink()
    junit = tmp_path / "junit.xml"
    code, out, _ = run("check", file, "--junit", junit)
    assert code == 3
    assert re.search(r"^kept .*reference\.csv", out, re.M)
    assert re.search(r"^ERROR .*second\.csv", out, re.M)
    assert etree.parse(junit).getroot().get("errors") == "1"


def test_a_signal_that_is_not_compared_any_more_misses_its_limit(run, file):
    text = file.read_text(encoding="utf-8").replace(
        "[reference.signals]", '[reference.signals]\nbeam = "1 deg"'
    )
    file.write_text(text, encoding="utf-8")
    code, out, _ = run("check", file, "--no-cause")
    assert code == 1
    assert "beam is not compared any more (limit 1 deg)" in out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("reference = 3", "reference"),
        ("[[reference]]\nlog = 'a.csv'\nsignal = {}", "reference.0.signal"),
        ("margin = 'much'", "margin"),
        ("= 3", "no TOML file"),
    ],
)
def test_a_bad_file_is_refused_by_name(run, tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text, encoding="utf-8")
    code, _, err = run("check", path)
    assert code == 3
    assert str(path) in err
    assert message in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--update"], "--add LOG"),
        (["--margin", "5 %"], "--margin belongs to --add or --update"),
        (["--mapping", "m.toml"], "--mapping belongs to --add"),
    ],
)
def test_requests_that_make_no_sense(run, tmp_path, words, message):
    code, _, err = run("check", tmp_path / "none.toml", *words)
    assert code == 2
    assert message in err


def test_a_limit_of_another_dimension_is_refused(run, file):
    text = re.sub(r'"slew" = .*', '"slew" = "3 bar"', file.read_text(encoding="utf-8"), count=1)
    file.write_text(text, encoding="utf-8")
    code, out, _ = run("check", file)
    assert code == 2
    assert "limit of slew" in out


def test_names_of_any_kind_survive_the_file(tmp_path):
    odd = Limit(limit="0.5 deg")
    check = Check(
        margin="7.5 %",
        reference=[
            Reference(
                log='a "b"\\ü\x7f.csv',
                model="m.ssp",
                mapping="m.toml",
                causes=["x"],
                signals={"a.b [1]": odd},
                blocks={"a + b.c": {"y": Limit(limit="1", was="0.9")}},
            )
        ],
    )
    assert read_check(write_check(tmp_path / "c.toml", check)) == check


@pytest.mark.slow
def test_the_cause_of_a_worse_model_is_named(run, file, heavier):
    code, out, _ = run("check", file, "--model", heavier)
    assert code == 1
    assert "Worse: mechanical + sensor" in out
    assert "New since the limits were set: mechanical.inertia" in out
