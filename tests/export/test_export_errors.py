"""What both exports refuse, and what they say."""

import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.cli import main
from cosim.errors import ModelError
from cosim.export import prepare, write_modelica, write_simulink
from cosim.export.names import MATLAB_KEYWORDS, MATLAB_LENGTH, Names, identifier, is_identifier
from cosim.ssp.read import read_system

COMMANDS = ["export-simulink", "export-modelica"]


def run(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main(list(map(str, words)))
    return stop.value.code, capsys.readouterr().err


def repacked(package, target, change):
    """A package whose entries `change` replaces (None drops one)."""
    with zipfile.ZipFile(package) as source, zipfile.ZipFile(target, "w") as out:
        for name in source.namelist():
            data = change(name, source.read(name))
            if data is not None:
                out.writestr(name, data)
    return target


@pytest.mark.parametrize("command", COMMANDS)
def test_unknown_model(command, tmp_path, capsys):
    code, err = run(capsys, command, "full_odor", "--out", tmp_path / "o")
    assert (code, "'full_odor' is no model" in err) == (2, True)
    code, err = run(capsys, command, tmp_path / "none.ssp", "--out", tmp_path / "o")
    assert (code, "does not exist" in err) == (3, True)
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_package_without_one_of_its_fmus(command, built, tmp_path, capsys):
    broken = repacked(
        built["full_order"],
        tmp_path / "b.ssp",
        lambda name, data: None if name.endswith("/dcv.fmu") else data,
    )
    code, err = run(capsys, command, broken, "--out", tmp_path / "o")
    assert (code, "component 'dcv' has no entry 'resources/dcv.fmu'" in err) == (3, True)
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_folder_that_holds_other_files(command, built, tmp_path, capsys):
    out = tmp_path / "o"
    out.mkdir()
    (out / "mine.txt").write_text("keep")
    code, err = run(capsys, command, built["simplified"], "--out", out)
    assert (code, "already holds files (mine.txt)" in err) == (2, True)
    assert [p.name for p in out.iterdir()] == ["mine.txt"]
    code, _ = run(capsys, command, built["simplified"], "--out", out, "--overwrite")
    assert code == 0
    assert (out / "mine.txt").read_text() == "keep"


@pytest.mark.parametrize("command", COMMANDS)
def test_folder_that_cannot_be_made(command, built, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    code, err = run(capsys, command, built["simplified"], "--out", tmp_path / "file" / "o")
    assert (code, "name another folder" in err) == (2, True)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--step-size", "-1 ms"], "makes no simulation"),
        (["--step-size", "0 s"], "makes no simulation"),
        (["--stop-time", "0 s"], "makes no simulation"),
        (["--step-size", "1 m"], "--step-size"),
        (["--set", "mechanical.JJ=1"], "mechanical.J"),
    ],
)
def test_bad_options(command, options, message, built, tmp_path, capsys):
    code, err = run(capsys, command, built["full_order"], "--out", tmp_path / "o", *options)
    assert (code, message in err) == (2, True), err
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("write", [write_simulink, write_modelica])
def test_names_that_become_the_same(write, built, tmp_path):
    def rename(name, data):
        if name != "SystemStructure.ssd":
            return data
        return data.replace(b'"dcv"', b'"valve-1"').replace(b'"sensor"', b'"valve 1"')

    package = repacked(built["full_order"], tmp_path / "clash.ssp", rename)
    with read_system(package) as system, pytest.raises(ModelError) as caught:
        write(prepare(system), tmp_path / "o")
    assert "component 'valve-1' and component 'valve 1' would both be named 'valve_1'" in str(caught.value)
    assert not (tmp_path / "o").exists()


def test_files_of_the_same_name(built, tmp_path):
    def move(name, data):
        if name == "SystemStructure.ssd":
            return data.replace(b"resources/sensor.fmu", b"other/DCV.fmu")
        return data

    package = repacked(built["full_order"], tmp_path / "same.ssp", move)
    with zipfile.ZipFile(package, "a") as archive, zipfile.ZipFile(built["full_order"]) as source:
        archive.writestr("other/DCV.fmu", source.read("resources/sensor.fmu"))
    with read_system(package) as system, pytest.raises(ModelError, match=r"same file 'DCV\.fmu'"):
        prepare(system)


def test_workspace_names_that_become_the_same(built, tmp_path):
    """An output of the component a_b and one of the component a may have the same name in the workspace."""

    def rename(name, data):
        if name != "SystemStructure.ssd":
            return data
        return data.replace(b'"sensor"', b'"observer_slew"').replace(b'name="observer_slew_x"', b"")

    package = repacked(built["full_order"], tmp_path / "w.ssp", rename)
    names = Names("MATLAB", MATLAB_KEYWORDS, MATLAB_LENGTH)
    assert names.give("a_b_c", "output 'a_b.c'") == "a_b_c"
    with pytest.raises(ModelError, match=r"output 'a_b\.c' and output 'a\.b_c'"):
        names.give("a_b_c", "output 'a.b_c'")
    with read_system(package) as system:
        write_simulink(prepare(system), tmp_path / "o")  # these two do not collide


@given(st.text(max_size=80))
def test_every_name_becomes_an_identifier(name):
    text = identifier(name, MATLAB_KEYWORDS, MATLAB_LENGTH)
    assert is_identifier(text)
    assert len(text) <= MATLAB_LENGTH
    assert text not in MATLAB_KEYWORDS
    if is_identifier(name) and name not in MATLAB_KEYWORDS and len(name) <= MATLAB_LENGTH:
        assert text == name
