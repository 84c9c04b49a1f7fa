"""Findings of the doctor: each check with a host that lacks the thing."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from cosim import doctor, packages
from cosim.cli import main
from cosim.errors import ModelError, UsageError
from cosim.paths import build_folder, unsafe_characters


def _cosim(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    captured = capsys.readouterr()
    assert isinstance(stop.value.code, int)
    return stop.value.code, captured.out, captured.err


@pytest.mark.parametrize(
    ("system", "machine", "wide", "state"),
    [
        ("linux", "x86_64", True, "ok"),
        ("win32", "AMD64", True, "ok"),
        ("win32", "AMD64", False, "missing"),
        ("linux", "aarch64", True, "missing"),
        ("darwin", "arm64", True, "missing"),
    ],
)
def test_platform(system: str, machine: str, wide: bool, state: str) -> None:
    finding = doctor.check_platform(system, machine, wide)
    assert finding.state == state
    assert bool(finding.remedy) == (state != "ok")


@pytest.mark.parametrize(
    ("library", "version", "state"),
    [
        ("glibc", "2.32", "ok"),
        ("glibc", "2.36", "ok"),
        ("glibc", "2.4", "missing"),
        ("", "", "missing"),
        ("musl", "", "missing"),
    ],
)
def test_glibc(library: str, version: str, state: str) -> None:
    assert doctor.check_glibc("linux", library, version).state == state
    assert doctor.check_glibc("win32", library, version).state == "ok"


@pytest.mark.parametrize(
    ("name", "found"), [("plain folder", ""), ("a#b%c", "#%"), ("(x+y)", "(+"), ("Kräne", "ä")]
)
def test_unsafe_characters(name: str, found: str) -> None:
    root = Path(Path.cwd().anchor)
    assert unsafe_characters(root / name) == found


def test_unsafe_temporary_folder_is_a_must_others_a_warning(tmp_path: Path) -> None:
    root = Path(Path.cwd().anchor)
    first, second = doctor.check_paths([root / "t#mp", root / "w+rk"])
    assert (first.state, second.state) == ("missing", "warning")
    assert "#" in first.detail
    assert "TMPDIR" in first.remedy


def test_core_package_out_of_range_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = {
        "": (Requirement("numpy>=999"), Requirement("scipy")),
        "odd": (Requirement("surely-not-there>=1"),),
    }
    monkeypatch.setattr(packages, "requirements", lambda: wanted)
    monkeypatch.setattr(doctor, "requirements", lambda: wanted)
    numpy, odd = doctor.check_packages([])
    assert (numpy.name, numpy.state, numpy.remedy) == ("numpy>=999", "missing", "pip install 'numpy>=999'")
    assert (odd.state, odd.extra) == ("warning", "odd")
    assert [finding.state for finding in doctor.check_packages(["odd"])] == ["missing", "missing"]


def test_installed_metadata_and_pyproject_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    if packages.checkout() is None:
        pytest.skip("not a checkout")
    try:
        packages.metadata.metadata(packages.PROJECT)
    except packages.metadata.PackageNotFoundError:
        pytest.skip("the project is not installed in this environment")
    packages.requirements.cache_clear()
    from_source = packages.requirements()
    monkeypatch.setattr(packages, "checkout", lambda: None)
    packages.requirements.cache_clear()
    installed = packages.requirements()
    packages.requirements.cache_clear()
    assert {extra: {r.name.lower() for r in group} for extra, group in installed.items()} == {
        extra: {r.name.lower() for r in group} for extra, group in from_source.items()
    }


def test_unknown_extra() -> None:
    with pytest.raises(ModelError, match=r"no extra 'nonsense'; known: .*report"):
        packages.package_states("nonsense")
    with pytest.raises(UsageError, match="no extra 'nonsense'"):
        doctor.examine(require=["nonsense"])


def test_tbb_outside_the_loaders_folders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor.sys, "platform", "linux")
    monkeypatch.setattr(doctor.ctypes.util, "find_library", lambda name: None)
    monkeypatch.setattr(doctor.sys, "prefix", str(tmp_path))
    monkeypatch.setenv("LD_LIBRARY_PATH", "")
    assert doctor.check_tbb().remedy == "pip install tbb (extra clients)"
    library = tmp_path / "lib" / "libtbb.so.12"
    library.parent.mkdir()
    library.touch()
    assert f"LD_LIBRARY_PATH={library.parent}" in doctor.check_tbb().remedy
    monkeypatch.setenv("LD_LIBRARY_PATH", str(library.parent))
    assert doctor.check_tbb().state == "ok"


def test_libpython_of_a_static_build(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor.sys, "platform", "linux")
    monkeypatch.setattr(
        doctor.sysconfig, "get_config_var", lambda name: {"LDLIBRARY": "libpython3.11.a"}.get(name)
    )
    finding = doctor.check_libpython()
    assert finding.state == "warning"
    assert "apt-get install libpython3" in finding.remedy


def test_libpython_of_a_shared_build(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor.sys, "platform", "linux")
    (tmp_path / "libpython3.x.so.1.0").touch()
    variables = {"INSTSONAME": "libpython3.x.so.1.0", "LIBDIR": str(tmp_path)}
    monkeypatch.setattr(doctor.sysconfig, "get_config_var", variables.get)
    assert doctor.check_libpython().detail.endswith(f"LD_PRELOAD={tmp_path / 'libpython3.x.so.1.0'}")


def test_numba_cache_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "made" / "later"))
    assert doctor.check_numba_cache().state == "ok"
    blocked = tmp_path / "a file"
    blocked.touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(blocked))
    assert doctor.check_numba_cache().state == "warning"


def test_scarce_resources_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_LOW_DISK", 1e9)
    states = {finding.name: finding.state for finding in doctor.check_resources()}
    assert states["disk of the build folder"] == "warning"
    assert states["memory"] in ("ok", "warning")


def test_missing_tool_names_its_purpose(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CC", "no-such-compiler")  # else that of the extra `cross` is found
    findings = {finding.name: finding for finding in doctor.examine()}
    for tool in ("C compiler", "Chromium"):
        assert findings[tool].state == "warning"
        assert findings[tool].remedy


def test_command_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = _cosim(capsys, "doctor", "--json")
    result = json.loads(out)
    assert result["exit_code"] == code == 0, result
    assert result["counts"]["missing"] == 0
    assert sum(result["counts"].values()) == len(result["findings"])
    assert {"topic", "name", "state", "detail", "remedy", "extra"} == set(result["findings"][0])


def test_exit_codes_of_the_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    host = doctor.Finding("host", "x", "missing", "x", "y")
    extra = doctor.Finding("packages", "x", "missing", "x", "y", "report")
    for findings, expected in (([host, extra], 4), ([extra], 5), ([], 0)):
        monkeypatch.setattr(doctor, "examine", lambda *_, found=findings: found)
        assert _cosim(capsys, "doctor")[0] == expected


def test_command_for_a_person_shows_remedies(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    finding = doctor.Finding("host", "name[1]", "missing", "what is [wrong]", "do [this]")
    monkeypatch.setattr(doctor, "examine", lambda *_: [finding])
    _, out, _ = _cosim(capsys, "doctor")
    assert "missing  name[1]: what is [wrong]; remedy: do [this]" in out
    assert out.splitlines()[-1].startswith("This host cannot build or run the models")


def test_an_absent_extra_is_one_line_with_what_to_type(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = {
        "": (Requirement("numpy"),),
        "docs": tuple(Requirement(f"surely-not-there-{n}>=1") for n in range(9)),
        "tdms": (Requirement("numpy"), Requirement("surely-not-there>=1")),
    }
    monkeypatch.setattr(packages, "requirements", lambda: wanted)
    monkeypatch.setattr(doctor, "requirements", lambda: wanted)
    findings = list(doctor.check_packages([]))
    monkeypatch.setattr(doctor, "examine", lambda *_: findings)
    lines = _cosim(capsys, "doctor")[1].splitlines()
    assert lines == [
        "      ok  core packages: all 1 in range",
        " warning  extra docs: not installed, needed for the documents as a site only; remedy: "
        "pip install 'slew-cosim[docs]'",
        " warning  extra tdms: 1 of 2 packages absent or too old, needed for logs in .tdms files only; remedy: "
        "pip install 'slew-cosim[tdms]'",
        "This host builds, runs and compares the models; 2 optional things absent or at risk.",
    ]


def test_every_extra_says_what_it_is_for() -> None:
    assert set(doctor.PURPOSES) == {extra for extra in packages.requirements() if extra}


def test_build_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path))
    assert build_folder() == tmp_path
    monkeypatch.delenv("COSIM_BUILD")
    assert build_folder().name == "build"


@pytest.mark.clients
def test_remedy_for_tbb_works() -> None:
    library = Path(sys.prefix) / "lib" / "libtbb.so.12"
    if sys.platform != "linux" or not library.is_file() or importlib.util.find_spec("ecospy") is None:
        pytest.skip("ecos and TBB (extra clients) are not installed here")
    script = f"import ctypes; ctypes.CDLL({str(library)!r}); import ecospy"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
