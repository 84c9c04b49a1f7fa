"""The frame of the command line: outcomes to exit codes, one JSON object on stdout, quick start.

The frame is tested with commands of its own, registered through the same door as the real ones.
"""

import json
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import cosim.cli
from cosim.errors import DataError, MissingExtraError, ModelError, SimulationError, UsageError

TOP = Path(__file__).resolve().parents[2]

TRIAL = """
    import ctypes, os, sys
    import typer
    from cosim import console, errors

    def register(app):
        @app.command()
        def trial(what: str, as_json: bool = typer.Option(False, "--json")):
            "A command for the tests."
            if what == "noise":
                print("a library's chatter")
                os.write(1, b"native chatter, unbuffered\\n")
                (ctypes.CDLL("ucrtbase") if os.name == "nt" else ctypes.CDLL(None)).printf(b"native chatter, buffered\\n")
                console.emit_json({"degree": "\\N{DEGREE SIGN}", "value": float("nan")})
            elif what == "threshold":
                console.emit_json({"value": 1})
                raise typer.Exit(1)
            elif what == "late":
                console.emit_json({"value": 1})
                raise errors.SimulationError("after the result")
            elif what == "interrupt":
                raise KeyboardInterrupt
            elif what == "defect":
                {}["a missing key"]
            elif what == "flood":
                for number in range(200_000):
                    print(number)
            elif what == "rich-flood":
                for number in range(20_000):
                    console.stdout_console().print(number)
            elif what == "error":
                raise errors.DataError("log.csv, row 3, column 'slew': [not] a number")
"""


@pytest.fixture
def run(tmp_path: Path):
    """Runs the command line in a process of its own with the trial command added; returns the finished process."""
    commands = tmp_path / "commands"
    commands.mkdir()
    (commands / "trial.py").write_text(textwrap.dedent(TRIAL), encoding="utf-8")
    start = tmp_path / "start.py"
    start.write_text(
        "import sys, cosim.commands\n"
        f"cosim.commands.__path__[:] = [{str(commands)!r}]\n"
        "import cosim.cli\n"
        "cosim.cli.main()\n",
        encoding="utf-8",
    )

    def call(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        inherited = {name: value for name, value in os.environ.items() if name != "COSIM_DEBUG"}
        variables = {**inherited, "PYTHONPATH": str(TOP), **environment}
        command = [sys.executable, str(start), *words]
        return subprocess.run(
            command, capture_output=True, encoding="utf-8", env=variables, check=False, timeout=600
        )

    return call


def test_json_is_alone_on_stdout_whatever_else_prints(run) -> None:
    done = run("trial", "noise", "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout) == {"degree": "\N{DEGREE SIGN}", "value": None}
    for chatter in ("a library's chatter", "native chatter, unbuffered", "native chatter, buffered"):
        assert chatter in done.stderr


def test_without_json_what_is_printed_stays_on_stdout(run) -> None:
    assert "a library's chatter" in run("trial", "noise").stdout


def test_utf8_whatever_the_locale(run) -> None:
    for words in (["trial", "noise", "--json"], ["trial", "noise"]):
        done = run(*words, PYTHONIOENCODING="cp1252", LC_ALL="C")
        assert "\N{DEGREE SIGN}" in done.stdout


def test_missed_threshold_is_1_and_keeps_the_result(run) -> None:
    done = run("trial", "threshold", "--json")
    assert done.returncode == 1
    assert json.loads(done.stdout) == {"value": 1}


def test_an_error_after_the_result_does_not_print_a_second_object(run) -> None:
    done = run("trial", "late", "--json")
    assert done.returncode == SimulationError.exit_code
    assert json.loads(done.stdout) == {"value": 1}
    assert "error: after the result" in done.stderr


def test_error_is_one_line_on_stderr_with_its_brackets(run) -> None:
    done = run("trial", "error")
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr == "error: log.csv, row 3, column 'slew': [not] a number\n"


def test_error_as_json(run) -> None:
    done = run("trial", "error", "--json")
    assert done.returncode == 3
    assert json.loads(done.stdout) == {
        "error": "log.csv, row 3, column 'slew': [not] a number",
        "exit_code": 3,
    }


def test_traceback_of_an_error_only_on_demand(run) -> None:
    assert "Traceback" not in run("trial", "error").stderr
    assert "Traceback" in run("--debug", "trial", "error").stderr
    assert "Traceback" in run("trial", "error", COSIM_DEBUG="1").stderr
    assert "Traceback" not in run("trial", "error", COSIM_DEBUG="0").stderr


def test_defect_asks_for_a_report(run) -> None:
    done = run("trial", "defect")
    assert done.returncode == 4
    assert "internal error, please report: KeyError: 'a missing key'" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Traceback" in run("trial", "defect", COSIM_DEBUG="1").stderr


def test_interrupt_is_130(run) -> None:
    done = run("trial", "interrupt", "--json")
    assert done.returncode == 130
    assert json.loads(done.stdout)["exit_code"] == 130


@pytest.mark.parametrize("words", [["nonsense"], ["trial"], ["trial", "noise", "--nonsense"]])
def test_usage_errors_are_2_and_say_where_help_is(run, words: list[str]) -> None:
    done = run(*words)
    assert (done.returncode, done.stdout) == (2, "")
    assert "--help'" in done.stderr
    as_json = run(*words, "--json")
    assert json.loads(as_json.stdout)["exit_code"] == as_json.returncode == 2


@pytest.mark.skipif(os.name == "nt", reason="a POSIX pipe is closed under the writer")
@pytest.mark.parametrize("what", ["flood", "rich-flood"])
def test_closed_pipe_is_quiet_and_not_taken_for_a_missed_threshold(run, tmp_path: Path, what: str) -> None:
    assert run("trial", "noise").returncode == 0
    environment = {**os.environ, "PYTHONPATH": str(TOP)}
    command = [sys.executable, str(tmp_path / "start.py"), "trial", what]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        messages = process.stderr.read()
        assert process.wait(timeout=600) == 141
    assert messages == b""


def test_exit_codes_of_the_contract() -> None:
    codes = {UsageError: 2, DataError: 3, ModelError: 3, SimulationError: 4, MissingExtraError: 5}
    assert {kind: kind.exit_code for kind in codes} == codes
    assert "pip install 'slew-cosim[mf4]'" in str(MissingExtraError("this", "mf4"))


def test_every_command_module_registers_and_help_stays_light() -> None:
    script = (
        "import sys, cosim.cli\n"
        "cosim.cli.make_app()\n"
        "heavy = 'numpy scipy pandas numba fmpy matplotlib pint pyarrow lxml pydantic control'.split()\n"
        "print(sorted(set(heavy) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=TOP, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]", "import heavy packages inside the command's function"


def test_module_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "--version"], cwd=TOP, capture_output=True, text=True, check=True
    )
    with pytest.raises(SystemExit) as stop:
        cosim.cli.main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == done.stdout
    assert done.stdout.startswith("cosim ")
    assert done.stdout.split()[1][0].isdigit()


def test_bare_cosim_shows_the_help_and_no_error(run) -> None:
    done = run()
    assert done.returncode == 2
    assert "Usage" in done.stdout + done.stderr
    assert "error:" not in done.stderr


def test_a_value_without_its_option_names_the_option(command) -> None:
    code, _, error = command("rig", "small_steps")
    assert code == 2
    assert "its option is meant: --excitation small_steps" in error
    assert "its option" not in command("rig", "small")[2]


def test_a_missing_argument_shows_a_line_to_type_and_a_word_that_people_try_its_command(command) -> None:
    code, _, error = command("diagnose")
    assert code == 2
    assert "For example: cosim diagnose examples/synthetic_demo.csv --out found" in error
    code, _, error = command("calibrate", "log.csv")
    assert code == 2
    assert "No such command 'calibrate': cosim compare LOG --calibrate" in error


def test_help_shows_defaults_in_brackets() -> None:
    """Markup would leave them out."""
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "identify", "transfer-function", "--help"],
        capture_output=True, text=True, encoding="utf-8", check=True,
    )  # fmt: skip
    shown = " ".join(re.sub("[^ -~]", " ", done.stdout).split())
    assert "mechanical or simplified [default: simplified]" in shown
    assert "repeatable [default: those of the block's table]" in shown
