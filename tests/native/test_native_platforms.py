"""Binaries for other platforms in one FMU, linux64's numbers from each.

The DLL runs under wine, the library for aarch64 under qemu, those of Macs by a loader of ours in a host of Linux.
"""

import importlib.util
import json
import shutil
import struct
import subprocess
import sys
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from benchmarks.plain_host import LAUNCHERS, compiled_host, run_host
from cosim.cli import main
from cosim.errors import UsageError
from cosim.export import prepare
from cosim.native.build import (
    PLATFORMS,
    MissingCompilerError,
    build_native,
    compiler,
    cross_compiler,
    further,
)
from cosim.native.package import write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.stimulus import stimulus_csv
from fmus.build import composed_block

STEPS = 1500
# of each signal's range. Windows' libm rounds exp, tanh and the like otherwise in the last bit; glibc on aarch64 does not
CLOSE = {"win64": 1e-11, "aarch64-linux": 1e-13, "x86_64-darwin": 1e-13, "aarch64-darwin": 1e-13}
# effects with libm in them (tanh, exp, sin, pow), memory, a list, whole numbers
VALUES = {
    "dead_zone": {"play": 0.01},
    "dcv": {"tau_d": 0.0123, "c_a": 1.0},
    "continuity": {"k_s": 1e9, "p_c": 4e5, "s_c": 0.3},
    "mechanical": {"tau_c": 200.0, "omega_v": 1e-3, "tau_s": 100.0, "tau_r": 50.0, "gap": 1e-4},
    "sensor": {"p_drop": 0.01, "tau_l": 0.01, "quantum": 1e-5},
}


@pytest.fixture(params=LAUNCHERS)
def platform(request) -> str:
    """A platform for which this machine has a compiler."""
    try:
        command = cross_compiler(request.param)
    except MissingCompilerError as error:
        pytest.skip(str(error))
    if request.param == "win64" and "-target" in command:
        pytest.skip("Zig compiles all of Windows' import libraries first, which takes minutes")
    return request.param


@pytest.fixture(scope="session")
def wine(tmp_path_factory):
    """Settings of wine of our own, without its messages."""
    return {"WINEPREFIX": str(tmp_path_factory.mktemp("wine")), "WINEDEBUG": "-all"}


def needs_launcher(platform: str) -> None:
    for program in LAUNCHERS[platform][0][:1]:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def test_one_fmu_holds_the_binaries_of_several_platforms(platform, tmp_path) -> None:
    file = build_native(
        composed_block("mechanical"), tmp_path / "mechanical.fmu", platforms=[platform, "linux64"]
    )
    with zipfile.ZipFile(file) as archive:
        names = [n for n in archive.namelist() if n.startswith("binaries/")]
        known = PLATFORMS[platform]
        library = archive.read(f"binaries/{known.folders['2.0']}/mechanical{known.suffix}")
    assert sorted(names) == sorted(
        ["binaries/linux64/mechanical.so", f"binaries/{known.folders['2.0']}/mechanical{known.suffix}"]
    )
    assert library.startswith({".dll": b"MZ", ".so": b"\x7fE", ".dylib": b"\xcf\xfa\xed\xfe"}[known.suffix])
    assert validate_fmu(str(file)) == []
    again = build_native(composed_block("mechanical"), tmp_path / "again.fmu", platforms=[platform])
    with zipfile.ZipFile(again) as archive:
        assert library in [archive.read(n) for n in archive.namelist()]


def test_library_of_windows_needs_windows_alone(tmp_path) -> None:
    """No library of the compiler's: those would have to be shipped."""
    tool = shutil.which("x86_64-w64-mingw32-objdump")
    if tool is None:
        pytest.skip("x86_64-w64-mingw32-objdump is not installed")
    file = build_native(composed_block("sensor"), tmp_path / "sensor.fmu", platforms=["win64"])
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path)
    command = [tool, "-p", tmp_path / "binaries/win64/sensor.dll"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert {line.split()[-1].lower() for line in said.splitlines() if "DLL Name" in line} == {
        "kernel32.dll",
        "msvcrt.dll",
    }
    assert "fmi2DoStep" in said


@pytest.mark.slow
@pytest.mark.parametrize(("fmi", "name"), [("2.0", "full_order"), ("3.0", "physical")])
def test_other_platforms_give_the_same_numbers(fmi, name, platform, tmp_path, wine, monkeypatch) -> None:
    """A whole closed package in a host in C of that platform, effects on."""
    needs_launcher(platform)
    for key, value in wine.items():
        monkeypatch.setenv(key, value)
    times = np.arange(2001) * 1e-3
    stimulus = stimulus_csv(times, 0.8 * np.sin(7.0 * times) + 0.1)
    values = (
        VALUES
        if name == "full_order"
        else {k: VALUES[k] for k in ("dead_zone", "dcv", "mechanical", "sensor")}
    )
    package = write_native_ssp(
        ssp_folder() / f"{name}.ssd", tmp_path / "p.ssp", stimulus=stimulus, values=values, fmi=fmi, platforms=(platform,)
    )  # fmt: skip
    found = {}
    with read_system(package) as system:
        model = prepare(system)
        signals = [
            f"{c.name}.{v.name}" for c in system.components.values() for v in model.fmus[c.fmu.source].outputs
        ]
        for where in (None, platform):
            (tmp_path / str(where)).mkdir()
            host = compiled_host(tmp_path / str(where), int(fmi[0]), where)
            assert host is not None
            found[where] = run_host(host, model, STEPS, 1e-3, signals, None, where)
    assert len(signals) > 10
    for signal in signals:
        wanted = found[None][signal]
        np.testing.assert_allclose(
            found[platform][signal], wanted, rtol=0.0, atol=CLOSE[platform] * max(np.ptp(wanted), 1e-300), err_msg=signal
        )  # fmt: skip
    assert np.ptp(found[platform]["sensor.slew"]) > 1e-3  # it moves


def test_one_file_holds_the_code_of_both_kinds_of_mac(tmp_path) -> None:
    """FMI 2.0 has one folder for both, FMI 3.0 one for each."""
    try:
        further(["darwin64"])
    except MissingCompilerError as error:
        pytest.skip(str(error))
    held = {}
    for fmi in ("2.0", "3.0"):
        file = build_native(
            composed_block("mechanical"), tmp_path / f"{fmi}.fmu", fmi=fmi, platforms=["darwin64"]
        )
        with zipfile.ZipFile(file) as archive:
            held[fmi] = {n.split("/")[1]: archive.read(n) for n in archive.namelist() if n.endswith(".dylib")}
    assert set(held["2.0"]) == {"darwin64"}
    assert set(held["3.0"]) == {"x86_64-darwin", "aarch64-darwin"}
    both = held["2.0"]["darwin64"]
    magic, number = struct.unpack_from(">II", both)
    assert (magic, number) == (0xCAFEBABE, 2)
    ends = []
    for k, processor in enumerate((0x01000007, 0x0100000C)):  # x86_64 and arm64 in mach/machine.h
        kind, _, place, size, power = struct.unpack_from(">IIIII", both, 8 + 20 * k)
        assert kind == processor
        assert place % 2**power == 0
        head, own_kind, own_variant = struct.unpack_from("<III", both, place)
        assert (head, own_kind) == (0xFEEDFACF, processor)
        assert own_variant == struct.unpack_from(">I", both, 12 + 20 * k)[0]
        ends.append(place + size)
    assert ends[0] <= struct.unpack_from(">I", both, 36)[0]
    assert ends[1] <= len(both)


def test_zig_serves_where_there_is_no_other_compiler(monkeypatch) -> None:
    """It is told the platform: by itself it would take this very processor."""
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("ziglang is not installed")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    found = compiler()
    assert found[:4] == [sys.executable, "-m", "ziglang", "cc"]
    assert found[4] == "-target"
    assert found[5] in [p.target for p in PLATFORMS.values() if p.folders["3.0"] == fmpy.platform_tuple]
    assert cross_compiler("win64")[4:6] == ["-target", "x86_64-windows-gnu"]


def test_missing_compiler_is_named_with_its_remedy(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setenv("CC_WIN64", "no-such-compiler")
    with pytest.raises(SystemExit) as stop:
        main(["build", "--native", "--platform", "win64", "--out", str(tmp_path), "--json"])
    assert stop.value.code == 5
    said = json.loads(capsys.readouterr().out)["error"]
    assert "binaries for win64 need a C compiler" in said
    assert "gcc-mingw-w64-x86-64" in said
    assert not list(tmp_path.iterdir())


def test_named_compiler_is_taken(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("CC_AARCH64_LINUX", "sh -c true")
    assert cross_compiler("aarch64-linux") == ["sh", "-c", "true"]
    assert further(["aarch64-linux", "aarch64-linux", "linux64", "x86_64-linux"]) == ("aarch64-linux",)


def test_unknown_platform_is_refused() -> None:
    with pytest.raises(UsageError, match=r"'beos' is no platform.*win64"):
        further(["beos"])


def test_platforms_are_for_native_fmus(tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["build", "--platform", "win64", "--out", str(tmp_path)])
    assert stop.value.code == 2
    assert "--platform needs --native" in capsys.readouterr().err
