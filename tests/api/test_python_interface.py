"""The Python interface: nine functions, typed frozen results, and commands that are its clients."""

import ast
import dataclasses
import inspect
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import cosim
from cosim.api import numbers
from cosim.api.results import BatchResult, ComparisonResult, DiagnosisResult, IdentificationResult
from cosim.errors import DataError, UsageError
from cosim.logs.write import write_log
from cosim.packages import project_version
from cosim.results import Result

TOP = Path(__file__).resolve().parents[2]
FUNCTIONS = ["batch", "calibrate", "compare", "diagnose", "identify", "make_log", "read_log", "read_system",
             "simulate"]  # fmt: skip


@pytest.fixture(scope="module")
def log():
    return cosim.make_log("steps", 4.0, seed=3)


def python(script):
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=TOP, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_brings_nothing_heavy():
    script = (
        "import sys, cosim\n"
        "heavy = 'numpy scipy pandas numba fmpy matplotlib pint pyarrow lxml pydantic typer rich'.split()\n"
        "print(sorted(set(heavy) & set(sys.modules)))"
    )
    assert python(script).strip() == "[]"


def test_import_takes_less_than_a_third_of_a_second():
    script = "import time; t = time.process_time(); import cosim; print(time.process_time() - t)"
    assert min(float(python(script)) for _ in range(3)) < 0.3


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_is_there_typed_and_documented(name):
    from cosim import api

    assert sorted(cosim.__all__) == FUNCTIONS
    assert name in dir(cosim)
    signature = inspect.signature(getattr(cosim, name))
    assert signature == inspect.signature(getattr(api, name))
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Signature.empty, parameter
        documented = f"{parameter.name}:" in inspect.getdoc(getattr(api, name))
        assert documented, f"{name}: {parameter.name}"


def test_the_version_is_that_of_the_project():
    assert cosim.__version__ == project_version()


def test_a_package_can_be_called_and_imported_in_any_order():
    script = (
        "from cosim.compare import Comparator\n"
        "import cosim, cosim.batch.workers\n"
        "assert callable(cosim.compare) and callable(cosim.batch) and cosim.compare.Comparator is Comparator\n"
        "from cosim import calibrate\n"
        "try:\n    calibrate('no.csv')\n"
        "except Exception as error:\n    print(error)\n"
    )
    assert "no.csv" in python(script)


@pytest.mark.parametrize(
    "kind", [DiagnosisResult, ComparisonResult, IdentificationResult, BatchResult, Result]
)
def test_results_are_frozen_and_every_field_is_documented(kind):
    assert kind.__dataclass_params__.frozen
    text = kind.__doc__
    for item in dataclasses.fields(kind):
        assert item.name in text, item.name


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="no attribute 'diagnoze'"):
        cosim.diagnoze  # noqa: B018


def test_a_log_as_a_table_and_a_picture(log, tmp_path):
    again = cosim.read_log(write_log(log, tmp_path / "log.parquet"))
    np.testing.assert_allclose(again["slew"], log["slew"])
    table = log.to_frame()
    assert list(table.columns)[:2] == ["time [s]", "u [1]"]
    np.testing.assert_allclose(table["slew [deg]"], np.degrees(log["slew"]))
    np.testing.assert_allclose(log.to_frame(si=True)["slew [rad]"], log["slew"])
    figure = log.plot("matplotlib")
    assert isinstance(figure, Figure)
    assert len(figure.axes) == len(log.signals)
    assert "4001 samples" in log._repr_html_()
    with pytest.raises(DataError, match="no such file"):
        cosim.read_log(tmp_path / "none.csv")


def test_a_simulation(log):
    told = []
    result = cosim.simulate(
        "full_order",
        "2 s",
        inputs=log,
        parameters={"mechanical.J": "900 kg.m2"},
        progress=lambda text, share: told.append((text, share)),
    )
    assert result.time[-1] == pytest.approx(2.0)
    heavier = cosim.simulate("full_order", 2.0, inputs=log, parameters={"mechanical.J": 900.0})
    np.testing.assert_array_equal(result["mechanical.theta"], heavier["mechanical.theta"])
    assert told[0][1] == 0.0
    assert told[-1][1] == pytest.approx(1.0)
    assert [share for _, share in told] == sorted(share for _, share in told)
    found = result.to_dict()
    assert json.loads(json.dumps(found, allow_nan=False))["steps"] == 2000
    assert found["signals"]["mechanical.theta"]["unit"] == "deg"
    assert "simulated: 2 s in 2000 steps" in str(result)
    assert "mechanical.theta" in result._repr_html_()
    assert len(result.plot(["mechanical.theta", "dcv.spool"], "matplotlib").axes) == 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.model = "other"


def test_series_as_xarray(log):
    pytest.importorskip("xarray", reason="the extra 'batch' is not installed")
    data = cosim.simulate("full_order", 1.0, inputs=log, record=["mechanical.theta"]).to_xarray()
    assert data["mechanical.theta"].attrs["units"] == "rad"
    assert data.sizes == {"time": 1001}


def test_a_comparison(log):
    found = cosim.compare(log, parameters={"mechanical.b": 20000.0}, thresholds={"slew": "0.001 deg"})
    assert not found.passed
    assert found.to_dict()["signals"]["slew"]["rmse"] == pytest.approx(found.to_frame().loc["slew", "rmse"])
    assert any(line.startswith("Most wrong: slew angle (slew)") for line in found.lines())
    assert {"slew_measured [deg]", "slew_simulated [deg]"} <= set(found.series().columns)
    assert isinstance(found.plot("matplotlib"), Figure)
    assert "Most wrong" in found._repr_html_()
    with pytest.raises(UsageError, match="closest: 'slew'"):
        cosim.compare(log, thresholds={"slow": 1.0})


def test_what_a_command_prints_is_what_the_function_gives(log, tmp_path):
    path = write_log(log, tmp_path / "log.parquet")
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "compare", str(path), "--json"],
        cwd=TOP, capture_output=True, text=True, encoding="utf-8", timeout=900,
    )  # fmt: skip
    assert json.loads(done.stdout) == cosim.compare(path).to_dict()


def test_a_calibration(log):
    found = cosim.calibrate(log, ["mechanical.b"], starts=1, parameters={"mechanical.b": 24000.0})
    parameter = found.calibration.parameters[0]
    assert parameter.name == "mechanical.b"
    assert parameter.ci95[0] < 26661.85 < parameter.ci95[1]
    assert any(line.startswith("Calibrated: mechanical.b = ") for line in found.lines())


def test_an_identification(log):
    found = cosim.identify(cosim.make_log("mixed", 25.0, seed=5), "mechanics")
    assert (
        found.parameters["mechanical.J"].interval[0] < 763.94 < found.parameters["mechanical.J"].interval[1]
    )
    assert found.lines()[0].startswith("mechanical.J = ")
    assert set(found.to_frame().index) == set(found.parameters)
    assert found.to_dict()["identify"] == "mechanics"
    with pytest.raises(UsageError, match="'mechanic' is identified"):
        cosim.identify(log, "mechanic")


def test_a_system_can_be_read():
    with cosim.read_system("full_order") as system:
        assert "mechanical" in system.components


@pytest.fixture(scope="module")
def rubbing():
    return cosim.make_log("steps", 8.0, ["mechanical.coulomb_friction:tau_c=300 N.m"], seed=2)


def test_a_diagnosis(rubbing, capsys):
    told = []
    found = cosim.diagnose(rubbing, progress=lambda text, share: told.append(share))
    assert found.causes[0].effect == "mechanical.coulomb_friction"
    assert (found.verdict, found.to_dict()["verdict"]) == ("explained", "explained")
    assert "Cause: dry friction (mechanical.coulomb_friction): " in str(found)
    assert "Cause: dry friction" in found._repr_html_()
    assert found.extended.is_file()
    assert found.to_frame().loc["slew", "rmse_after"] < found.to_frame().loc["slew", "rmse_before"]
    legends = [axes.get_legend() for axes in found.plot("matplotlib").axes]
    shown = [{text.get_text() for text in legend.get_texts()} for legend in legends if legend is not None]
    assert {"measured", "nominal", "extended"} in shown
    assert told == sorted(told)
    assert told[-1] > 0.8
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", ""), "a library prints nothing"


def test_ctrl_c_keeps_what_was_done(rubbing, tmp_path):
    def stop(text, share):
        if text.startswith("mechanical"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        cosim.diagnose(rubbing, out=tmp_path, progress=stop)
    left = stopped.value.result
    assert left.verdict == "interrupted"
    assert {where.block for where in left.answer.localisation} >= {"dcv"}
    assert (tmp_path / "diagnosis.json").is_file()


# what a command may import of cosim: how things are said ...
SAYING = {
    "cosim.batch.screen", "cosim.calibrate.present", "cosim.commands.compare", "cosim.compare.present", "cosim.console",
    "cosim.errors", "cosim.identify.answer", "cosim.options", "cosim.paths", "cosim.report.names", "cosim.report.screen",
}  # fmt: skip
# ... how options become arguments ...
READING = {
    "cosim.batch.conduct", "cosim.batch.plan", "cosim.batch.values", "cosim.master",
    "cosim.request", "cosim.results",
}  # fmt: skip
# ... and the function that does it, where it is none of cosim.api
ENTRIES = {
    "doctor": ("cosim.doctor", "examine"),
    "live": ("cosim.live.run", "run"),
    "open": ("cosim.browser.run", "run"),
    "report": ("cosim.report.page", "write_report"),
    "reproduce": ("cosim.reproduce.run", "reproduced"),
}
COMMANDS = {
    ".".join(file.relative_to(TOP / "cosim" / "commands").with_suffix("").parts): file
    for file in sorted((TOP / "cosim" / "commands").rglob("*.py"))
    if file.name != "__init__.py"
}


def imported(tree):
    """Pairs of module and name; what is imported for annotations only computes nothing."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", name.name) for name in node.names)
        elif isinstance(node, ast.Import):
            yield from ((name.name, "") for name in node.names)
        yield from imported(node)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_computes_nothing_itself(command):
    used = {
        (module, name)
        for module, name in imported(ast.parse(COMMANDS[command].read_text(encoding="utf-8")))
        if module.split(".")[0] in ("cosim", "fmus")
    }
    entry = ENTRIES.get(command, ("", ""))
    does = {(m, n) for m, n in used if m.startswith("cosim.api") or (m, n) in (("cosim", "api"), entry)}
    assert does, "a command calls what does it"
    said = {(m, n) for m, n in used if {m, f"{m}.{n}"} & (SAYING | READING)}
    left = used - does - said - {(entry[0], "Asked")}
    assert not left, f"{left}: let cosim.api do it"


def test_no_command_has_numbers_of_its_own():
    """Arrays and tables are made where Python can ask for them as well."""
    for file in sorted((TOP / "cosim" / "commands").rglob("*.py")):
        tree = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        used = {
            name.split(".")[0]
            for node in tree
            for name in (
                [a.name for a in node.names] if isinstance(node, ast.Import)
                else [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            )
        }  # fmt: skip
        assert not used & {"numpy", "scipy", "pandas", "pyarrow", "numba", "control", "pint"}, file.name


def test_dynamics_are_identified_of_a_block_or_between_two_signals():
    log = cosim.read_log(TOP / "examples" / "synthetic_demo.csv")
    fitted = cosim.identify(log, "transfer_function", block="dcv")
    assert 25.0 < fitted.parameters["dcv.w0"].value < 25.5
    other = cosim.identify(log, "transfer_function", between=("spool", "p_load"))
    assert "from the spool position (spool) to the load pressure (p_load)" in str(other)
    response = cosim.identify(log, "frf", block="dcv")
    assert "Frequency response from the command (u) to the spool position (spool)" in str(response)
    assert response.to_dict()["identify"] == "frf"
    assert response.plot() is not None
    with pytest.raises(UsageError, match="block and between go with frf and transfer_function"):
        cosim.identify(log, "mechanics", block="dcv")
    with pytest.raises(UsageError, match="nothing called 'frff' is identified"):
        cosim.identify(log, "frff")


def test_what_several_identifications_ask_for_is_in_the_signature_of_each_and_goes_by_name():
    for function in (numbers.frf, numbers.transfer_function):
        own = inspect.signature(function).parameters
        assert [n for n, p in own.items() if p.kind is not inspect.Parameter.KEYWORD_ONLY] == ["logs"]
        assert (own["block"].default, own["mapping"].default, own["linear"].default) == (None, None, False)
    with pytest.raises(TypeError, match="mappin"):
        numbers.everything(TOP / "examples" / "synthetic_demo.csv", mappin=None)
