"""The files of a diagnosis are written once, complete: a call that fails, or a kill, leaves the old or the new ones."""

import copy
import dataclasses
import hashlib
import os
import re
from pathlib import Path

import pytest
from fault_injection import failing_call

from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.logs import Log
from cosim.report import deliver
from cosim.rig import as_log, make_log
from cosim.ssp.traceability import embedded

PACKAGES = ("extended.ssp", "extended_open.ssp")
OLD = b"what was there before"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, Log]:
    """A diagnosis that is not handed over yet, and its log."""
    log = as_log(make_log("steps", 8.0, ["mechanical.coulomb_friction:tau_c=300 N.m"], seed=2))
    log = dataclasses.replace(log, source=Path("log.csv"), sha256="ab" * 32)
    return diagnose(log, folder=tmp_path_factory.mktemp("made")), log


@pytest.fixture
def unproposed(monkeypatch: pytest.MonkeyPatch) -> None:
    """No next experiment: nothing here looks at it."""
    monkeypatch.setattr(deliver, "proposed", lambda found: None)


@pytest.mark.usefixtures("unproposed")
def test_no_package_takes_its_name_twice(
    found: tuple[Diagnosis, Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named, rename = [], os.replace

    def noted(part: Path, target: Path) -> None:
        named.append(Path(target).name)
        rename(part, target)

    monkeypatch.setattr(os, "replace", noted)
    given, log = found
    answer = deliver.delivered(copy.copy(given), log, tmp_path)
    assert named.count("diagnosis.json") == 2  # the first says of itself that it is not the last
    rest = [name for name in named if name != "diagnosis.json"]
    assert sorted(rest) == sorted({*rest})
    assert {*PACKAGES, "extended.ssv"} <= {*rest}
    assert Path(answer.extended.ssp) == tmp_path / "extended.ssp"
    for name in PACKAGES:
        told = embedded(tmp_path / name)
        assert told["diagnosis"]["verdict"] == answer.verdict
        assert "interrupted" not in told["diagnosis"]
        assert "slew.rmse_after" in told["held-out-gain"]


@pytest.mark.usefixtures("unproposed")
def test_the_report_gives_the_checksums_of_the_files_beside_it(
    found: tuple[Diagnosis, Log], tmp_path: Path
) -> None:
    pytest.importorskip("plotly")
    pytest.importorskip("jinja2")
    given, log = found
    deliver.delivered(copy.copy(given), log, tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    listed = set(re.findall(r"\b[0-9a-f]{64}\b", text))
    for name in (*PACKAGES, "diagnosis.json", "comparison.parquet"):
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() in listed, name


@pytest.mark.usefixtures("unproposed")
def test_a_folder_that_was_deleted_meanwhile_is_made_again(
    found: tuple[Diagnosis, Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(deliver, "save_and_report", lambda *given: None)
    given, log = found
    deliver.delivered(copy.copy(given), log, tmp_path / "gone")
    assert (tmp_path / "gone" / "extended.ssp").is_file()
    assert (tmp_path / "gone" / "diagnosis.json").is_file()


@pytest.mark.usefixtures("unproposed")
def test_whatever_call_fails_packages_are_old_or_new(
    found: tuple[Diagnosis, Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(deliver, "save_and_report", lambda *given: None)
    given, log = found
    whole = tmp_path / "whole"
    whole.mkdir()
    deliver.delivered(copy.copy(given), log, whole)
    new = {name: (whole / name).read_bytes() for name in (*PACKAGES, "extended.ssv")}
    at, failed = 0, 1
    while failed:
        at += 1
        folder = tmp_path / f"{at}"
        folder.mkdir()
        for name in new:
            (folder / name).write_bytes(OLD)
        with failing_call(at) as faults:
            try:
                answer = deliver.delivered(copy.copy(given), log, folder)
            except OSError:
                answer = None
        failed = faults.seen >= at
        for name, content in new.items():
            assert (folder / name).read_bytes() in (OLD, content), (at, name)
        if answer is not None and answer.extended is None:
            assert any("the extended package failed" in text for text in answer.warnings)
        elif answer is not None:
            assert (folder / "extended.ssp").read_bytes() == new["extended.ssp"], at
    assert at > 6
