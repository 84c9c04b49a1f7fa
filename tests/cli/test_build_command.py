"""``cosim build``: what it builds, from which command, and what it refuses."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cosim.cli import main
from cosim.ssp.build import CLOSED, SYSTEMS
from fmus.registry import BLOCKS


def run(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main(["build", *map(str, words)])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def played(package: Path):
    """The rows that the stimulus inside a closed package plays."""
    with (
        zipfile.ZipFile(package) as archive,
        archive.open("resources/stimulus.fmu") as inner,
        zipfile.ZipFile(inner) as fmu,
    ):
        return np.loadtxt(fmu.open("resources/stimulus.csv"), delimiter=",", skiprows=1)


def test_builds_what_the_contract_names(capsys, tmp_path):
    code, out, err = run(capsys, "--out", tmp_path, "--json")
    result = json.loads(out)
    assert code == 0
    fmus = {f"{name}.fmu" for name in BLOCKS}
    packages = {f"{name}{suffix}.ssp" for name in SYSTEMS for suffix in ("", "_open")} | {
        f"{name}.ssp" for name in CLOSED
    }
    assert {p.name for p in (tmp_path / "fmus").iterdir()} == {Path(f).name for f in result["fmus"]} == fmus
    assert {p.name for p in (tmp_path / "ssp").iterdir()} == {Path(f).name for f in result["ssp"]} == packages
    assert all(name in err for name in fmus | packages)  # a line for each
    assert played(tmp_path / "ssp" / "simplified.ssp").shape == (20001, 2)


def test_plays_the_command_of_a_log(capsys, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time [ms],u [%],slew [deg]\n5,10,0\n6,20,0\n7,-30,0.1\n8,-30,0.1\n")
    code, out, _ = run(capsys, "--out", tmp_path / "out", "--with-stimulus", log)
    assert code == 0
    assert f"{len(BLOCKS) + 2 * len(SYSTEMS) + len(CLOSED)} files" in out
    rows = played(tmp_path / "out" / "ssp" / "full_order.ssp")
    np.testing.assert_allclose(rows[:, 0], [0.0, 1e-3, 2e-3, 3e-3], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(rows[:, 1], [0.1, 0.2, -0.3, -0.3], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [("time [s],slew [deg]\n0,0\n0.001,0\n", 3, "'u'"), (None, 3, "log.csv"), ("u [1]\n0\n0\n", 3, "time")],
)
def test_a_log_without_a_command_is_refused(text, code, message, capsys, tmp_path):
    log = tmp_path / "log.csv"
    if text is not None:
        log.write_text(text)
    found, _, err = run(capsys, "--out", tmp_path / "out", "--with-stimulus", log)
    assert (found, message in err, "Traceback" in err) == (code, True, False)
    assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_made_is_refused(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, err = run(capsys, "--out", tmp_path / "file")
    assert code == 2
    assert "name another folder" in err


def test_mapping_needs_a_log(capsys, tmp_path):
    code, _, err = run(capsys, "--out", tmp_path, "--mapping", "m.toml")
    assert code == 2
    assert "--with-stimulus" in err
