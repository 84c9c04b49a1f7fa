"""`cosim validate` and `check_ssp`: silent on good packages, and a named finding for each defect."""

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import pytest
import toy_fmus
from toy_fmus import binding, ssv
from typer.testing import CliRunner

from cosim.api.building import validate
from cosim.cli import make_app
from cosim.master import Runner
from cosim.ssp import check_fmu, check_ssp, check_ssv
from cosim.ssp.check import Problem

PAIR = {"w": "wave", "g": "gain"}


def test_a_good_package_and_a_good_fmu_have_no_findings(toys: Any) -> None:
    assert check_ssp(toys.ssp(PAIR, ["w.y -> g.u"], inside={"g": binding(ssv({"k": 2.0}))})) == []
    assert check_fmu(toys.fmu("lag")) == []


@pytest.mark.parametrize(
    ("options", "severity", "message"),
    [
        ({"extra": "<ssd:Nonsense/>"}, "error", "Nonsense"),
        (
            {"inside": {"g": binding(ssv({"k": 2.0}).replace("version='1.0'", "version='one'"))}},
            "error",
            "version",
        ),
        ({"inside": {"g": binding(ssv({"k": "Real value='2,5'"}))}}, "error", "2,5"),
        ({"inside": {"g": binding(ssv({"kk": 2.0}))}}, "warning", "matches nothing"),
    ],
)
def test_defects_are_found(toys: Any, options: Any, severity: str, message: str) -> None:
    found = [p for p in check_ssp(toys.ssp(PAIR, ["w.y -> g.u"], **options)) if message in p.text]
    assert found
    assert {p.severity for p in found} == {severity}


def test_names_that_trip_clients_are_warned_of(toys: Any) -> None:
    texts = [p.text for p in check_ssp(toys.ssp({"drive": "wave", "drive_2": "gain", "3rd": "lag"}, []))]
    assert any("'drive' is the start of 'drive_2'" in t for t in texts)
    assert any("'3rd' is no plain identifier" in t for t in texts)


def test_a_connector_without_type_is_warned_of(toys: Any, tmp_path: Path) -> None:
    text = toy_fmus.ssd(PAIR, ["w.y -> g.u"]).replace("<ssc:Real/>", "", 1)
    fmus = {kind: toys.fmu(kind) for kind in ("wave", "gain")}
    found = check_ssp(toy_fmus.pack(tmp_path / "a.ssp", text, fmus))
    assert [(p.severity, "no type child" in p.text) for p in found] == [("warning", True)]


def test_a_path_that_crashes_clients_is_warned_of(toys: Any, tmp_path: Path) -> None:
    folder = tmp_path / "50% (a)"
    folder.mkdir()
    file = folder / "gain.fmu"
    file.write_bytes(toys.fmu("gain").read_bytes())
    found = check_fmu(file)
    assert [p.severity for p in found] == ["warning"]
    assert "'%('" in found[0].text


def test_parameter_sets_are_checked_alone(tmp_path: Path) -> None:
    file = tmp_path / "a.ssv"
    file.write_text(ssv({"k": 2.0}), encoding="utf-8")
    assert check_ssv(file) == []
    file.write_text(ssv({"k": 2.0}, unit={"k": "furlong"}), encoding="utf-8")
    assert [p.severity for p in check_ssv(file)] == ["warning"]
    file.write_text(ssv({"k": 2.0}).replace("name='nominal'", ""), encoding="utf-8")
    assert [p.severity for p in check_ssv(file)] == ["error"]


def test_the_command_reports_and_exits_with_3_on_errors(toys: Any) -> None:
    runner = CliRunner()
    good, bad = toys.ssp(PAIR, ["w.y -> g.u"]), toys.ssp(PAIR, ["w.y -> h.u"])
    done = runner.invoke(make_app(), ["validate", str(good), "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout) == {"valid": True, "files": {str(good): []}, "invalid_but_taken": []}
    done = runner.invoke(make_app(), ["validate", str(good), str(bad)])
    assert done.exit_code == 3
    assert "invalid" in done.stdout
    assert "no component 'h'" in done.stdout
    assert "all the same" not in done.stdout


def test_of_an_invalid_fmu_that_runs_the_command_says_so(toys: Any, tmp_path: Path) -> None:
    """As plain pythonfmu makes them: without the unknowns of initialisation."""
    loose = tmp_path / "loose.fmu"
    with zipfile.ZipFile(toys.fmu("gain")) as source, zipfile.ZipFile(loose, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml":
                data = re.sub(rb"<InitialUnknowns>.*</InitialUnknowns>", b"", data, flags=re.DOTALL)
            target.writestr(name, data)
    done = CliRunner().invoke(make_app(), ["validate", str(loose)])
    assert done.exit_code == 3
    assert "take it all the same; strict clients may not" in done.stdout
    found = json.loads(CliRunner().invoke(make_app(), ["validate", str(loose), "--json"]).stdout)
    assert found["invalid_but_taken"] == [str(loose)]
    with Runner(loose) as runner:
        assert runner.run(0.1, 0.1, inputs={"u": 1.0}).signals


def test_a_system_of_ours_is_checked_by_its_name() -> None:
    (file,) = validate([Path("full_order")])
    assert Path(file).name == "full_order.ssp"
    assert validate([Path(file)]) == validate([Path("full_order")])


def test_a_line_names_its_file_once() -> None:
    assert str(Problem("error", "a.fmu", "a.fmu has no binary")) == "error: a.fmu has no binary"
    assert str(Problem("error", "a.fmu", "a.fmu: cut off")) == "error: a.fmu: cut off"
    assert str(Problem("error", "a.fmu", "a unit is missing")) == "error: a.fmu: a unit is missing"
