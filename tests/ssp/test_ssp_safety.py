"""Files that mean harm, or are broken: every one ends in a ModelError, and nothing is written outside the scratch folder."""

import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import toy_fmus

from cosim.api.looking import facts_of
from cosim.errors import ModelError
from cosim.ssp import archive, check_ssp, read_fmu, read_ssp
from cosim.ssp.xml import parse

Edit = Callable[[zipfile.ZipFile], None]


def repacked(
    source: Path, target: Path, change: Callable[[str, bytes], bytes | None], extra: Edit | None = None
) -> Path:
    """A copy of an archive, each entry passed through `change` (None drops it)."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = change(name, old.read(name))
            if content is not None:
                new.writestr(name, content)
        if extra is not None:
            extra(new)
    return target


def described(toys: Any, tmp_path: Path, old: str, new: str) -> Path:
    """The gain FMU with its model description edited."""

    def change(name: str, content: bytes) -> bytes:
        if name != "modelDescription.xml":
            return content
        assert old.encode() in content
        return content.replace(old.encode(), new.encode())

    return repacked(toys.fmu("gain"), tmp_path / "edited.fmu", change)


@pytest.mark.parametrize(
    "name",
    [
        "../evil.txt",
        "/evil.txt",
        "C:/evil.txt",
        "a/../../evil.txt",
        "..\\evil.txt",
        "\\evil.txt",
        "a\\..\\..\\evil.txt",
        "c:evil",
    ],
)
@pytest.mark.parametrize("kind", ["ssp", "fmu"])
def test_entries_that_point_outside_are_refused(toys: Any, tmp_path: Path, name: str, kind: str) -> None:
    def add(new: zipfile.ZipFile) -> None:
        new.writestr(name, "x")

    if kind == "fmu":
        bad = repacked(toys.fmu("gain"), tmp_path / "bad.fmu", lambda n, c: c, add)
        with pytest.raises(ModelError, match="points outside the archive or is no portable path"):
            read_fmu(bad)
    else:
        bad = repacked(toys.ssp({"g": "gain"}, []), tmp_path / "bad.ssp", lambda n, c: c, add)
        with pytest.raises(ModelError, match="points outside the archive or is no portable path"):
            read_ssp(bad)
        assert [p.severity for p in check_ssp(bad)] == ["error"]
    assert not (tmp_path.parent / "evil.txt").exists()


def test_backslashes_between_folders_are_slashes(toys: Any, tmp_path: Path) -> None:
    """FMI Toolbox packed so on Windows (house of the Open Simulation Platform's demonstrations)."""
    packed = tmp_path / "windows.fmu"
    with zipfile.ZipFile(toys.fmu("gain")) as old, zipfile.ZipFile(packed, "w") as new:
        for entry in old.infolist():
            new.writestr(entry.filename.replace("/", "\\"), old.read(entry))
    with read_fmu(packed) as system:
        assert system.components["windows"].fmu.variables.keys() >= {"u", "y"}
    assert facts_of(packed)["here"], "info sees the library as well"
    again = tmp_path / "twice.fmu"
    with zipfile.ZipFile(again, "w") as new:
        new.writestr("extra/file", "x")
        new.writestr("extra\\file", "y")
    with pytest.raises(ModelError, match="two entries named 'extra/file'"):
        archive.open_archive(again, "packed")


def test_symbolic_links_are_refused(toys: Any, tmp_path: Path) -> None:
    def add(new: zipfile.ZipFile) -> None:
        link = zipfile.ZipInfo("resources/link")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        new.writestr(link, "/etc")

    with pytest.raises(ModelError, match="symbolic link"):
        read_fmu(repacked(toys.fmu("gain"), tmp_path / "bad.fmu", lambda n, c: c, add))


def test_zip_bombs_are_refused_without_unpacking(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.ssp"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as new, new.open("zeros", "w") as entry:
        for _ in range(80):
            entry.write(bytes(1 << 20))
    with pytest.raises(ModelError, match="zip bomb"):
        read_ssp(bomb)


def test_large_but_honest_archives_pass(tmp_path: Path) -> None:
    import random

    honest = tmp_path / "honest.zip"
    with zipfile.ZipFile(honest, "w", zipfile.ZIP_DEFLATED) as new:
        new.writestr("noise", random.Random(1).randbytes(1 << 20))
        new.writestr("zeros", bytes(8 << 20))
    archive.open_archive(honest, "honest").close()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_folder_that_is_listed_twice_does_no_harm_but_a_file_does(tmp_path: Path) -> None:
    """CMake's packer lists one twice where an FMU has two entries below it (Reference FMUs, Roberts)."""
    for name, fails in (("extra/", False), ("extra/file", True)):
        path = tmp_path / f"{fails}.zip"
        with zipfile.ZipFile(path, "w") as new:
            for _ in range(2):
                new.writestr(name, b"")
        if fails:
            with pytest.raises(ModelError, match="two entries named 'extra/file'"):
                archive.open_archive(path, "packed")
            continue
        with archive.open_archive(path, "packed") as opened:
            archive.unpack(opened, tmp_path, "packed")
        assert (tmp_path / "extra").is_dir()


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>',
        '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;">]><a>&y;</a>',
        '<!DOCTYPE a SYSTEM "http://x.example/a.dtd"><a/>',
    ],
)
def test_documents_with_a_doctype_are_refused(text: str) -> None:
    with pytest.raises(ModelError, match="DOCTYPE"):
        parse(text.encode(), "it")
    with pytest.raises(ModelError, match="DOCTYPE"):
        parse(('<?xml version="1.0" encoding="UTF-16"?>' + text).encode("utf-16"), "it")


def test_a_doctype_in_any_part_of_a_package_is_refused(toys: Any, tmp_path: Path) -> None:
    head = '<?xml version="1.0" encoding="UTF-8"?>'
    evil = head + '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    description = toy_fmus.ssd({"g": "gain"}, [])
    fmus = {"gain": toys.fmu("gain")}
    path = toy_fmus.pack(tmp_path / "a.ssp", description.replace(head, evil), fmus)
    with pytest.raises(ModelError, match=r"SystemStructure\.ssd has a DOCTYPE"):
        read_ssp(path)
    inside = {"g": "<ssd:ParameterBindings><ssd:ParameterBinding source='g.ssv'/></ssd:ParameterBindings>"}
    files = {"g.ssv": evil + toy_fmus.ssv({"k": 1.0})}
    with pytest.raises(ModelError, match=r"g\.ssv has a DOCTYPE"):
        read_ssp(toys.ssp({"g": "gain"}, [], inside=inside, files=files))
    with pytest.raises(ModelError, match=r"modelDescription\.xml has a DOCTYPE"):
        read_fmu(described(toys, tmp_path, "<fmiModelDescription", "<!DOCTYPE x><fmiModelDescription"))


def of_version(version: int) -> bytes:
    """An archive whose only entry says that this version of the format is needed to read it."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("a.txt", "a")
    content = bytearray(out.getvalue())
    content[content.index(b"PK\x01\x02") + 6] = version
    return bytes(content)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no zip", b"<xml/>", of_version(86)])
def test_files_that_are_no_archives_are_refused(tmp_path: Path, content: bytes) -> None:
    bad = tmp_path / "bad.ssp"
    bad.write_bytes(content)
    with pytest.raises(ModelError, match="not a readable zip archive"):
        read_ssp(bad)
    with pytest.raises(ModelError, match="does not exist"):
        read_ssp(tmp_path / "lost.ssp")


def test_damaged_entries_are_refused(toys: Any, tmp_path: Path) -> None:
    content = bytearray(toys.fmu("gain").read_bytes())
    k = content.find(b"<CoSimulation")
    assert k > 0, "pythonfmu stores its description uncompressed"
    content[k + 1] ^= 1
    bad = tmp_path / "bad.fmu"
    bad.write_bytes(content)
    with pytest.raises(ModelError, match="damaged"):
        read_fmu(bad)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('fmiVersion="2.0"', 'fmiVersion="3.1"', r"is an FMI 3\.1 FMU; only FMI 2\.0 and 3\.0"),
        ('fmiVersion="2.0"', 'fmiVersion="3.0"', r"has no binary for this platform \(\w+-\w+\)"),
        ('fmiVersion="2.0"', 'fmiVersion="1.0"', r"is an FMI 1\.0 FMU"),
        ("<CoSimulation", "<ModelExchange", "for model exchange only"),
        (
            'modelIdentifier="toy_gain"',
            'modelIdentifier="other"',
            r"binaries/\w+/other\.\w+' is missing.*folder has toy_gain",
        ),
        ('name="u"', 'name="k"', "declares the variable 'k' twice"),
        ('start="2', 'start="two', "bad number"),
    ],
)
def test_unfit_fmus_are_refused(toys: Any, tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        read_fmu(described(toys, tmp_path, old, new))


def test_an_fmu_for_other_platforms_names_those_it_has(toys: Any, tmp_path: Path) -> None:
    def add(new: zipfile.ZipFile) -> None:
        new.writestr("binaries/darwin64/toy_gain.dylib", "x")

    without = repacked(toys.fmu("gain"), tmp_path / "a.fmu", lambda n, c: None if "binaries" in n else c, add)
    with pytest.raises(ModelError, match=r"no binary for this platform .*, only for darwin64"):
        read_fmu(without)
    bare = repacked(
        toys.fmu("gain"),
        tmp_path / "b.fmu",
        lambda n, c: None if "binaries" in n else c,
        lambda new: new.writestr("binaries/linux64/readme.txt", "x"),  # a folder without a library is none
    )
    with pytest.raises(ModelError, match="no binary at all"):
        read_fmu(bare)


def test_an_unsafe_temporary_folder_is_avoided_and_said(
    toys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unsafe = tmp_path / "50% (a+b)#ü"
    unsafe.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(unsafe))
    with read_fmu(toys.fmu("gain")) as system:
        assert unsafe not in system.components["gain"].fmu.folder.parents
        assert "unpacked to" in system.notes[0]
        assert "% (" in system.notes[0]
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(ModelError, match="set TMPDIR"):
        read_fmu(toys.fmu("gain"))


def test_nothing_is_left_behind(toys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    (tmp_path / "scratch").mkdir()
    with read_ssp(toys.ssp({"g": "gain"}, [])):
        assert len(list((tmp_path / "scratch").iterdir())) == 1
    with pytest.raises(ModelError):
        read_ssp(toys.ssp({"g": "gain"}, ["g.y -> h.u"]))
    assert list((tmp_path / "scratch").iterdir()) == []
