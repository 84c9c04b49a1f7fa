"""``cosim info``: stdout and exit codes are what a caller sees."""

import functools
import json
import subprocess
import sys
import zipfile

import pytest
from log_files import TOP, csv_text, full_log_columns


@pytest.fixture
def run(finished, monkeypatch):
    """Runs ``cosim info`` in this process."""
    monkeypatch.chdir(TOP)
    return functools.partial(finished, "info")


def run_as_a_program(*words):
    command = [sys.executable, "-m", "cosim", "info", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=600, cwd=TOP)


def test_a_log_as_json(run, write):
    columns = {**full_log_columns(), ("synthetic", "1"): [1.0] * 400, ("torque", "N.m"): [0.0] * 400}
    path = write(csv_text(columns))
    result = run(path, "--json")
    assert result.returncode == 0, result.stderr
    facts = json.loads(result.stdout)
    assert facts["kind"] == "log"
    assert facts["origin"] == "synthetic"
    assert facts["samples"] == 400
    assert facts["uniform"] is True
    assert facts["step"] == pytest.approx(0.001)
    assert facts["warnings"] == ["ignored columns: 'torque [N.m]'"]
    rows = {row["signal"]: row for row in facts["signals"]}
    assert list(rows) == [name for name, _ in full_log_columns() if name != "time"]
    assert rows["p_a"]["unit"] == "bar"
    assert rows["p_a"]["max"] == pytest.approx(full_log_columns()["p_a", "bar"].max())


def test_a_whole_csv_is_read_without_pandas(write):
    path = write(csv_text(full_log_columns()))
    script = f"import sys; from cosim.logs import load_log; load_log({str(path)!r}); print('pandas' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=600, cwd=TOP
    )
    assert done.stdout.strip() == "False", "its import is a quarter of the time of a short command"


def test_a_log_for_people(run, write):
    result = run(write(csv_text({**full_log_columns(), ("torque", "N.m"): [0.0] * 400})))
    assert result.returncode == 0, result.stderr
    first, *rest = result.stdout.splitlines()
    assert first.endswith(": measured log, 400 samples, 0.399 s at 1000 a second, no gap, 8 signals")
    assert rest[-1].startswith("Next: cosim diagnose ")
    assert "sha256" not in result.stdout
    assert "slew_rate_estimate" in result.stdout
    assert "warning: ignored columns: 'torque [N.m]'" in result.stderr


def test_a_tracker_and_a_mapping(run, write):
    text = "t;phi\n" + "".join(f"{k / 80};{k / 100}\n" for k in range(20))
    mapping = '[time]\ncolumn = "t"\nunit = "s"\n[signals.slew_external]\ncolumn = "phi"\nunit = "rad"\n'
    result = run(write(text), "--mapping", write(mapping, "map.toml"), "--json")
    assert result.returncode == 0, result.stderr
    facts = json.loads(result.stdout)
    assert facts["kind"] == "tracker"
    assert facts["signals"][0]["max"] == pytest.approx(0.19 * 57.29577951)


def test_a_bad_log_gives_exit_code_3_and_one_json_object(write):
    result = run_as_a_program(write("time [s],slew [deg]\n0,1\n1,x\n2,3\n"), "--json")
    assert result.returncode == 3
    assert "row 3, column 'slew [deg]': 'x' is not a number" in json.loads(result.stdout)["error"]
    assert "Traceback" not in result.stderr


DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="valve" guid="{1}" generationTool="by hand">
  <CoSimulation modelIdentifier="valve"/>
  <ModelVariables>
    <ScalarVariable name="K" valueReference="0" causality="parameter" variability="fixed" description="gain">
      <Real start="2.5"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""


def test_a_component(run, tmp_path):
    path = tmp_path / "valve.fmu"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("modelDescription.xml", DESCRIPTION)
        package.writestr("binaries/linux64/valve.so", "")
    result = run(path, "--json")
    assert result.returncode == 0, result.stderr
    facts = json.loads(result.stdout)
    assert (facts["name"], facts["type"], facts["platforms"]) == ("valve", "co-simulation", "linux64")
    (variable,) = facts["variables"]
    assert variable == {
        "variable": "K",
        "causality": "parameter",
        "variability": "fixed",
        "unit": "",
        "start": "2.5",
        "description": "gain",
    }


SCHEDULED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="clocked" instantiationToken="{1}">
  %s
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
  </ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""


@pytest.mark.parametrize(
    ("interfaces", "told"),
    [
        ("<ScheduledExecution modelIdentifier='c'/>", "scheduled execution"),
        (
            "<ModelExchange modelIdentifier='c'/><ScheduledExecution modelIdentifier='c'/>",
            "model exchange, scheduled execution",
        ),
        (
            "<ModelExchange modelIdentifier='c'/><CoSimulation modelIdentifier='c'/>",
            "co-simulation, model exchange",
        ),
    ],
)
def test_every_interface_type_of_a_component_is_said(run, tmp_path, interfaces, told):
    path = tmp_path / "clocked.fmu"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("modelDescription.xml", SCHEDULED % interfaces)
    facts = json.loads(run(path, "--json").stdout)
    assert facts["type"] == told
    assert ("cosim simulate" in facts["next"]) == ("co-simulation" in told)
    assert ("export it for co-simulation" in facts["next"]) == ("co-simulation" not in told)


def test_a_system_of_ours_is_found_by_its_name(run, tmp_path, monkeypatch):
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path))
    assert "(SSP)" in run("simplified").stdout  # is built when it is missing
    result = run("nowhere/full_order_open.ssp")
    assert result.returncode == 3
    assert "cosim build makes it, and cosim info full_order finds it" in result.stderr
    with zipfile.ZipFile(tmp_path / "ssp" / "full_order.ssp", "w") as package:
        package.writestr("SystemStructure.ssd", "<x/>")
    assert json.loads(run("full_order", "--json").stdout)["kind"] == "ssp"


def test_ignored_columns_that_look_like_signals_are_said(run, write):
    """Of a log in which one column happens to be called as ours, nobody is sent to a diagnosis without its command."""
    columns = full_log_columns()
    renamed = {
        ("valve command" if name == "u" else "slew angle" if name == "slew" else name, unit): values
        for (name, unit), values in columns.items()
    }
    path = write(csv_text(renamed), "one of ours.csv")
    facts = json.loads(run(path, "--json").stdout)
    assert facts["kind"] == "log"
    assert {name: g["column"] for name, g in facts["guesses"].items()} == {
        "u": "valve command [1]",
        "slew": "slew angle [deg]",
    }
    said = run(path).stdout
    assert "u is probably 'valve command [1]' [1]: its name" in said
    assert said.splitlines()[-1].startswith("Next: cosim init ")
    assert "one of ours.csv' writes these guesses" in said or 'one of ours.csv" writes these guesses' in said


def test_a_system_package(run, tmp_path):
    path = tmp_path / "crane.ssp"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("SystemStructure.ssd", "<x/>")
    facts = json.loads(run(path, "--json").stdout)
    assert facts["files"] == [{"file": "SystemStructure.ssd", "bytes": 4}]


@pytest.mark.parametrize(
    ("suffix", "message"), [("ssp", "not a readable zip"), ("fmu", "not a readable zip")]
)
def test_files_that_are_not_what_they_say(run, write, suffix, message):
    result = run(write("1,2\n3,4\n", f"bad.{suffix}"))
    assert result.returncode == 3
    assert message in result.stderr
    assert "Traceback" not in result.stderr
