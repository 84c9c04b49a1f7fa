"""What `validate`, `simulate` and `info` say of FMUs and packages by strangers: exit code 3, and the place that is bad."""

import subprocess
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bad_fmus
import fmpy
import pytest
import pythonfmu
import toy_fmus

from cosim.ssp import archive, binary, read_fmu, read_ssp

LIBRARY = next(
    (Path(pythonfmu.__file__).parent / "resources" / "binaries" / fmpy.platform).iterdir()
).read_bytes()
Change = Callable[[str], str]


def swap(old: str, new: str) -> Change:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return change


def test_the_untouched_fmu_is_valid(tmp_path: Path, command: Any) -> None:
    fmu = bad_fmus.pack(tmp_path / "good.fmu", LIBRARY)
    assert command("validate", fmu)[0] == 0
    assert command("info", fmu)[0] == 0


@pytest.mark.parametrize(
    ("library", "message"),
    [
        (None, "no binary at all"),
        (b"", "is empty"),
        (b"#!/bin/sh\necho hello\n" * 50, "is no "),
        (LIBRARY[: len(LIBRARY) // 2], "is cut off"),
        (LIBRARY[:30], "is cut off"),
        (LIBRARY.replace(b"fmi2DoStep\0", b"fmi2DoStop\0"), "exports no fmi2DoStep"),
    ],
)
def test_a_bad_library_is_invalid_and_is_not_loaded(
    tmp_path: Path, command: Any, library: bytes | None, message: str
) -> None:
    fmu = bad_fmus.pack(tmp_path / "bad.fmu", library)
    for words in (("validate", fmu), ("simulate", fmu)):
        code, out, err = command(*words)
        assert code == 3
        assert message in " ".join((out + err).split())


@pytest.mark.skipif(not bad_fmus.COMPILER, reason="needs a C compiler")
def test_a_library_without_what_it_cannot_do_is_run_and_said(tmp_path: Path, command: Any) -> None:
    """Hand-written FMUs leave out the functions of what they do not declare; no run calls these."""
    whole = bad_fmus.build("NONE", tmp_path)
    with zipfile.ZipFile(whole) as packed:
        library = packed.read(f"binaries/{fmpy.platform}/bad{fmpy.sharedLibraryExtension}")
    poor = library.replace(b"fmi2GetFMUstate\0", b"fmi2GotFMUstate\0")
    assert poor != library
    fmu = bad_fmus.pack(
        tmp_path / "poor.fmu",
        poor,
        lambda text: text.replace('"bad"/>', '"bad" canGetAndSetFMUstate="true"/>'),
    )
    code, out, _ = command("validate", fmu)
    assert code == 3
    assert "exports no fmi2GetFMUstate, which FMI 2.0 demands" in " ".join(out.split())
    code, out, err = command("simulate", fmu)
    assert code == 0, err
    assert "exports no fmi2GetFMUstate, which FMI 2.0 demands" in " ".join(err.split())
    with read_fmu(fmu) as system:
        assert not next(iter(system.components.values())).fmu.keeps_state, "its state cannot be read"


@pytest.mark.parametrize(
    ("name", "factor", "used"),
    [
        ("inch", "39.370078740157", True),
        ("inch", "0.0254", False),
        ("mm", "1000", True),
        ("thing", "3", True),
    ],
)
def test_a_display_unit_whose_factor_contradicts_its_name_is_not_used(
    tmp_path: Path, name: str, factor: str, used: bool
) -> None:
    """FMI has shown = factor * value; exporters that write the inverse would have an inch of 0.0254 shown per metre."""

    def change(text: str) -> str:
        base = '<BaseUnit m="1" factor="1"/>'
        text = text.replace(base, f'{base}<DisplayUnit name="{name}" factor="{factor}"/>')
        return text.replace('<Real unit="m"/>', f'<Real unit="m" displayUnit="{name}"/>')

    with read_fmu(bad_fmus.pack(tmp_path / "shown.fmu", LIBRARY, change)) as system:
        y = next(iter(system.components.values())).fmu.variables["y"]
        assert (y.display_unit, y.display_factor) == ((name, float(factor)) if used else ("", 1.0))
        assert any("contradicts" in note and f"'{name}' of 'm'" in note for note in system.notes) != used


@pytest.mark.skipif(not bad_fmus.COMPILER or fmpy.platform != "linux64", reason="needs a C compiler and ELF")
def test_what_a_library_lacks_is_said_with_a_remedy(tmp_path: Path, command: Any) -> None:
    other = tmp_path / "libabsent.so.3"
    source = tmp_path / "absent.c"
    source.write_text("int absent(void) { return 0; }\n")
    compiler = str(bad_fmus.COMPILER)
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-Wl,-soname,libabsent.so.3", "-o", other, source], check=True
    )
    library = tmp_path / "bad.so"
    bad = Path(bad_fmus.__file__).with_name("bad_fmu.c")
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-DMISCHIEF=NONE", "-Wl,--no-as-needed", "-o", library, bad, other],
        check=True,
        capture_output=True,
    )
    other.unlink()
    code, _, err = command("simulate", bad_fmus.pack(tmp_path / "needy.fmu", library.read_bytes()))
    assert code == 3
    assert "it needs 'libabsent.so.3', which is not installed here: install it" in " ".join(err.split())


@pytest.mark.skipif(fmpy.platform != "linux64", reason="changes an ELF library for x86-64")
def test_a_library_for_another_machine_is_invalid(tmp_path: Path, command: Any) -> None:
    arm = LIBRARY[:18] + (40).to_bytes(2, "little") + LIBRARY[20:]
    assert "another machine (ELF machine 40)" in str(binary.problem(arm, "linux64"))
    newer = LIBRARY[:18] + (183).to_bytes(2, "little") + LIBRARY[20:]
    assert binary.problem(newer, "linux64") is None  # elsewhere it may be right
    assert "another machine (ELF machine 183)" in str(binary.problem(newer, "x86_64-linux", "3.0"))
    if fmpy.platform_tuple == "x86_64-linux":
        for word in ("validate", "simulate"):
            code, out, err = command(word, bad_fmus.pack(tmp_path / "arm.fmu", newer))
            assert code == 3
            assert "another machine (ELF machine 183)" in " ".join((out + err).split())
    # the platform it is run on is good, another one's is not
    others = {"binaries/win64/bad.dll": b"MZ" + bytes(100), "binaries/linux32/bad.so": LIBRARY}
    code, out, _ = command("validate", bad_fmus.pack(tmp_path / "two.fmu", LIBRARY, others=others))
    assert code == 3
    assert "binaries/win64/bad.dll' is no Windows library" in out
    assert "binaries/linux32/bad.so' is for another machine" in out


@pytest.mark.parametrize("platform", ["linux64", "win64"])
def test_pythonfmu_s_libraries_pass_and_cut_ones_do_not(platform: str) -> None:
    folder = Path(pythonfmu.__file__).parent / "resources" / "binaries" / platform
    data = next(folder.iterdir()).read_bytes()
    assert binary.problem(data, platform) is None
    for end in (0, 3, 70, 500, len(data) // 2, len(data) - 4096):
        assert binary.problem(data[:end], platform), end


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('stepSize="0.01"', 'stepSize="0"', "DefaultExperiment: stepSize='0' is no step"),
        ('stepSize="0.01"', 'stepSize="-1"', "stepSize='-1' is no step"),
        ('stepSize="0.01"', 'stepSize="NaN"', "stepSize='NaN' is no finite number"),
        ('stopTime="1"', 'stopTime="NaN"', "stopTime='NaN' is no finite number"),
        ('stopTime="1"', 'stopTime="soon"', "stopTime='soon' is no finite number"),
        ('stopTime="1"', 'stopTime="-1"', "stopTime='-1' lies before the start"),
        ('start="0.0"', 'start="NaN"', "the variable 'u' has a bad number: start='NaN' is no finite number"),
        (
            'start="0.0"',
            'start="1e999"',
            "the variable 'u' has a bad number: start='1e999' is no finite number",
        ),
        ('start="0.0"', 'start="-Infinity"', "the variable 'u' has a bad number: start='-Infinity'"),
        ('start="0.0"', 'start="zero"', "the variable 'u' has a bad number: start='zero' is no number"),
        ('start="0.0"', 'start="0.0" max="NaN"', "the variable 'u' has a bad number: max='NaN'"),
        (
            'start="0.0"',
            'start="0.0" min="-INF"',
            "'u' has a bad number: min='-INF' is no finite number: leave it",
        ),
        ('unit="m"', 'unit="m" nominal="INF"', "the variable 'y' has a bad number: nominal='INF'"),
        (
            "<ModelVariables>",
            '<TypeDefinitions><SimpleType name="T"><Real max="nan"/></SimpleType></TypeDefinitions><ModelVariables>',
            "the type 'T' has a bad number: max='nan'",
        ),
        ('factor="1"', 'factor="0"', "the unit 'm': factor='0' makes every number 0"),
        ('factor="1"', 'factor="INF"', "the unit 'm': factor='INF' is no finite number"),
        ('m="1"', 'm="one"', "the unit 'm': m='one' is no whole number"),
        ('valueReference="1"', 'valueReference="-1"', "'u' has a bad number: the value reference -1"),
        ('valueReference="1"', 'valueReference="4294967296"', "the value reference 4294967296"),
        ('valueReference="1"', 'valueReference="first"', "bad"),
        ('modelIdentifier="bad"', 'modelIdentifier="../bad"', "is no C identifier"),
    ],
)
def test_bad_attributes_are_invalid_and_name_their_place(
    tmp_path: Path, command: Any, old: str, new: str, message: str
) -> None:
    fmu = bad_fmus.pack(tmp_path / "bad.fmu", LIBRARY, swap(old, new))
    for words in (("validate", fmu), ("simulate", fmu)):
        code, out, err = command(*words)
        assert code == 3
        text = " ".join((out + err).split())
        assert message in text
        assert "internal error" not in text
        assert "bad.fmu" in text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('stopTime="1.0"', 'stopTime="soon"', "DefaultExperiment: stopTime='soon'"),
        ('stopTime="1.0"', 'stopTime="nan"', "DefaultExperiment: stopTime='nan'"),
        ('startTime="0"', 'startTime="early"', "DefaultExperiment: startTime='early'"),
        ('m="1" factor="0.001"', 'm="1" factor="0"', "the unit 'mm': factor='0'"),
        ('factor="2"', 'factor="two"', "connection a.y -> b.u: factor='two'"),
    ],
)
def test_bad_attributes_of_a_package_name_their_place(
    toys: Any, tmp_path: Path, command: Any, old: str, new: str, message: str
) -> None:
    extra = {"a.y -> b.u": '<ssc:LinearTransformation factor="2"/>'}
    text = toy_fmus.ssd({"a": "gain", "b": "gain"}, ["a.y -> b.u"], connection_extra=extra)
    assert old in text
    path = toy_fmus.pack(tmp_path / "bad.ssp", text.replace(old, new), {"gain": toys.fmu("gain")})
    for words in (("validate", path), ("simulate", path)):
        code, out, err = command(*words)
        assert code == 3
        assert message in " ".join((out + err).split())
        assert "internal error" not in out + err


def test_archives_in_an_archive_count_together(
    toys: Any, tmp_path: Path, command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    fmus = {kind: toys.fmu(kind) for kind in ("gain", "lag", "wave")}
    text = toy_fmus.ssd({kind: kind for kind in fmus}, [])
    path = toy_fmus.pack(tmp_path / "three.ssp", text, fmus)
    sizes = []
    for file in (path, *fmus.values()):
        with zipfile.ZipFile(file) as found:
            sizes.append(sum(entry.file_size for entry in found.infolist()))
    # each alone is within the limit
    monkeypatch.setattr(archive, "LARGEST", sum(sizes) - 1)
    assert max(sizes) < archive.LARGEST
    code, _, err = command("simulate", path)
    assert code == 3
    assert "with all archives within it, which is refused as a zip bomb" in " ".join(err.split())
    monkeypatch.setattr(archive, "LARGEST", sum(sizes))
    read_ssp(path).close()


@pytest.mark.parametrize("suffix", [".fmu", ".ssp"])
def test_info_refuses_what_simulate_refuses_at_once(tmp_path: Path, command: Any, suffix: str) -> None:
    description = {".fmu": "modelDescription.xml", ".ssp": "SystemStructure.ssd"}[suffix]
    bomb = tmp_path / f"bomb{suffix}"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as new:
        new.writestr(description, "<a>" + "<b/>" * (10 << 20) + "</a>")
    begun = time.process_time()
    code, _, err = command("info", bomb)
    assert code == 3
    assert "refused" in err
    assert time.process_time() - begun < 2.0
    with zipfile.ZipFile(bomb, "w") as new:
        new.writestr(description, "<!DOCTYPE a [<!ENTITY x 'ha'>]><a>&x;</a>")
        new.writestr("../evil", "x")
    code, _, err = command("info", bomb)
    assert code == 3
    assert "points outside" in err


def test_info_reads_no_entities(tmp_path: Path, command: Any) -> None:
    evil = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/hostname">]><fmiModelDescription'
    fmu = bad_fmus.pack(tmp_path / "bad.fmu", LIBRARY, swap("<fmiModelDescription", evil))
    code, _, err = command("info", fmu)
    assert code == 3
    assert "DOCTYPE" in err


def test_a_stranger_s_step_size_is_used(tmp_path: Path) -> None:
    from cosim.ssp import read_fmu

    with read_fmu(bad_fmus.pack(tmp_path / "good.fmu", LIBRARY)) as system:
        assert system.step_size == 0.01
        assert not system.components["good"].fmu.ours
