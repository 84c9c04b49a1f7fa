"""What this host lacks to build, run and compare the components: facts, each with its remedy.

The facts about pythonfmu's binaries (platforms, glibc, libpython, unsafe paths) were measured with pythonfmu 0.7.0.
"""

import ctypes.util
import os
import platform
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from packaging.version import InvalidVersion, Version

from cosim.errors import UsageError
from cosim.packages import PROJECT, package_states, requirements
from cosim.paths import build_folder, unsafe_characters

State = Literal["ok", "warning", "missing"]

GLIBC = "2.32"
"""The oldest glibc that loads pythonfmu 0.7.0's linux64 binary."""

_GIB = 1024**3
_LOW_DISK, _LOW_MEMORY = 1.0, 1.0  # GiB; a build with its systems and a 3-hour log need about this much
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
PURPOSES = {
    "mat": "logs in .mat files of version 7.3, timeseries and tables",
    "mf4": "logs in .mf4 files",
    "tdms": "logs in .tdms files",
    "xlsx": "logs in .xlsx files",
    "batch": "cosim batch",
    "report": "report.html of a diagnosis",
    "clients": "the tests that run the systems in ecos and libcosim",
    "cross": "native FMUs for other platforms, or without a C compiler of the host",
    "dev": "the tests",
    "docs": "the documents as a site",
}
"""What an extra is for, as a person reads it."""


@dataclass(frozen=True)
class Finding:
    """One fact about the host.

    Attributes:
        topic: group it belongs to: host, python, paths, packages, tools, resources.
        name: what was looked at.
        state: "ok"; "warning", something optional is absent or at risk; "missing", nothing runs or a demand is not met.
        detail: what was found.
        remedy: what to do about it; empty when all is well.
        extra: the optional-dependency group it concerns, or empty.
    """

    topic: str
    name: str
    state: State
    detail: str
    remedy: str = ""
    extra: str = ""


def examine(paths: Sequence[Path] = (), require: Sequence[str] = ()) -> list[Finding]:
    """Looks at everything.

    Args:
        paths: further folders or files the user means to work with.
        require: extras whose absence counts as missing instead of as a warning.

    Raises:
        UsageError: `require` names an extra the project does not have.
    """
    extras = [name for name in requirements() if name]
    for name in require:
        if name not in extras:
            raise UsageError(f"there is no extra '{name}'; known: {', '.join(extras)}")
    return [
        check_platform(sys.platform, platform.machine(), sys.maxsize > 2**32),
        check_glibc(sys.platform, *platform.libc_ver()),
        check_libpython(),
        *check_paths([Path(tempfile.gettempdir()), Path.cwd(), build_folder(), *paths]),
        *check_packages(require),
        check_tbb(),
        check_compiler(),
        _check_tool(
            "Chromium",
            _BROWSERS,
            "the tests that open a report",
            "apt-get install chromium",
            "Edge or Chrome, on PATH",
        ),
        check_numba_cache(),
        *check_resources(),
    ]


def check_platform(system: str, machine: str, wide: bool) -> Finding:
    """Whether pythonfmu has a binary for this platform: linux64 and win64 only.

    Args:
        system: as in sys.platform.
        machine: as from platform.machine().
        wide: whether the Python is a 64-bit one.
    """
    detail = f"{system} {machine}, {'64' if wide else '32'}-bit Python {platform.python_version()}"
    if system in ("linux", "win32") and machine.lower() in ("x86_64", "amd64") and wide:
        return Finding("host", "platform", "ok", detail)
    remedy = (
        "use a 64-bit Python on Linux or Windows with an x86-64 processor; pythonfmu has no binary for others"
    )
    return Finding("host", "platform", "missing", detail, remedy)


def check_glibc(system: str, library: str, version: str) -> Finding:
    """Whether the C library loads pythonfmu's linux64 binary; other systems need none.

    Args:
        system: as in sys.platform.
        library: name of the C library, as from platform.libc_ver().
        version: its version.
    """
    if system != "linux":
        return Finding("host", "C library", "ok", "not needed on this system")
    remedy = f"pythonfmu's linux64 binary needs glibc >= {GLIBC}: Debian 12, Ubuntu 22.04 or newer"
    try:
        fits = library == "glibc" and Version(version) >= Version(GLIBC)
    except InvalidVersion:
        fits = False
    detail = f"{library} {version}".strip() or "unknown, no glibc"
    return Finding("host", "C library", "ok" if fits else "missing", detail, "" if fits else remedy)


def check_libpython() -> Finding:
    """Whether the Python shared library is there, which hosts that are not Python need to run the FMUs."""
    name = "Python shared library"
    if sys.platform == "win32":
        library = Path(sys.base_prefix) / f"python{sys.version_info.major}{sys.version_info.minor}.dll"
        if library.is_file():
            return Finding("python", name, "ok", f"hosts that are not Python need '{library.parent}' on PATH")
        return Finding(
            "python", name, "warning", f"no {library}", "install Python from python.org for such hosts"
        )
    library = _libpython()
    if library is not None:
        return Finding("python", name, "ok", f"hosts that are not Python need LD_PRELOAD={library}")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    return Finding(
        "python",
        name,
        "warning",
        "hosts that are not Python fail with 'undefined symbol: _Py_NoneStruct'",
        f"apt-get install libpython{version}, or a Python built with --enable-shared; then LD_PRELOAD the library",
    )


def _libpython() -> Path | None:
    soname = sysconfig.get_config_var("INSTSONAME") or sysconfig.get_config_var("LDLIBRARY") or ""
    if ".so" not in soname:
        return None  # a static build
    folders = (
        sysconfig.get_config_var("LIBDIR") or "",
        f"{sys.base_prefix}/lib",
        "/usr/lib/x86_64-linux-gnu",
    )
    candidates = (Path(folder) / soname for folder in folders if folder)
    return next((path for path in candidates if path.is_file()), None)


def check_paths(paths: Sequence[Path]) -> Iterator[Finding]:
    """Whether FMUs unpacked under these folders would crash; the first is taken to be the temporary folder."""
    for index, path in enumerate(dict.fromkeys(path.absolute() for path in paths)):
        name = "temporary folder" if index == 0 else "folder"
        unsafe = unsafe_characters(path)
        if not unsafe:
            yield Finding("paths", name, "ok", str(path))
            continue
        remedy = "set TMPDIR (Windows: TEMP) to a plain path" if index == 0 else "work under a plain path"
        # only the temporary folder is certain to hold unpacked FMUs; the others do when another client opens them there
        state: State = "missing" if index == 0 else "warning"
        detail = f"an FMU unpacked under '{path}' crashes its host, for the characters: {' '.join(unsafe)}"
        yield Finding("paths", name, state, detail, remedy)


def check_packages(require: Sequence[str]) -> Iterator[Finding]:
    """A finding for each core package out of range, or one for all of them; then one for each extra."""
    core = package_states()
    for package in core:
        if not package.satisfied:
            detail = f"found {package.installed or 'nothing'}, needs {package.requirement}"
            remedy = f"pip install '{package.requirement}'"
            yield Finding("packages", package.requirement, "missing", detail, remedy)
    if all(package.satisfied for package in core):
        yield Finding("packages", "core packages", "ok", f"all {len(core)} in range")
    for extra in filter(None, requirements()):
        name = f"extra {extra}"
        packages = package_states(extra)
        absent = sum(not package.satisfied for package in packages)
        if not absent:
            yield Finding("packages", name, "ok", "complete", extra=extra)
            continue
        state: State = "missing" if extra in require else "warning"
        detail = (
            "not installed"
            if absent == len(packages)
            else f"{absent} of {len(packages)} packages absent or too old"
        )
        if extra in PURPOSES:
            detail += f", needed for {PURPOSES[extra]} only"
        # names no single package: pip takes them from the project that is installed
        yield Finding("packages", name, state, detail, f"pip install '{PROJECT}[{extra}]'", extra)


def check_tbb() -> Finding:
    """Whether ecos finds the TBB library: its wheel needs libtbb.so.12 and does not bring it."""
    name = "TBB for ecos"
    if sys.platform != "linux":
        return Finding("tools", name, "ok", "not needed on this system")
    folders = [Path(p) for p in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if p]
    if any((folder / "libtbb.so.12").is_file() for folder in folders) or ctypes.util.find_library("tbb"):
        return Finding("tools", name, "ok", "found by the loader", extra="clients")
    own = Path(sys.prefix) / "lib"
    if (own / "libtbb.so.12").is_file():
        remedy = (
            f"export LD_LIBRARY_PATH={own}, or load {own / 'libtbb.so.12'} with ctypes before `import ecospy`"
        )
        return Finding(
            "tools", name, "warning", f"installed in {own}, where the loader does not look", remedy, "clients"
        )
    return Finding("tools", name, "warning", "not installed", "pip install tbb (extra clients)", "clients")


def _check_tool(name: str, programs: Sequence[str], purpose: str, linux: str, windows: str) -> Finding:
    found = next(filter(None, map(shutil.which, programs)), None)
    if found:
        return Finding("tools", name, "ok", found)
    remedy = windows if sys.platform == "win32" else linux
    return Finding("tools", name, "warning", f"not on PATH; needed for {purpose} only", remedy)


def check_compiler() -> Finding:
    """Whether native FMUs can be built here."""
    from cosim.native.build import MissingCompilerError, compiler

    try:
        found = " ".join(compiler())
    except MissingCompilerError as error:
        return Finding(
            "tools", "C compiler", "warning", "none; needed for native FMUs (export to C) only", str(error)
        )
    return Finding("tools", "C compiler", "ok", shutil.which(found) or found)


def check_numba_cache() -> Finding:
    """Whether compiled loops can be kept between runs; without it each start compiles again, for seconds."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    # numba's own order: the named folder, beside the source, the user's cache
    folders = [Path(named)] if named else [Path(__file__).parent / "__pycache__", Path.home() / ".cache"]
    for folder in folders:
        if _writable(folder):
            return Finding("resources", "numba cache", "ok", str(folder))
    detail = f"cannot write to {' or '.join(map(str, folders))}: each start compiles for seconds"
    return Finding(
        "resources", "numba cache", "warning", detail, "set NUMBA_CACHE_DIR to a folder you can write to"
    )


def _existing(folder: Path) -> Path:
    return next((path for path in (folder, *folder.parents) if path.exists()), folder)


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=_existing(folder)):
            return True
    except OSError:
        return False


def check_resources() -> Iterator[Finding]:
    """Free disk space of the temporary and the build folder, and free memory."""
    import psutil

    for name, folder in (("temporary folder", Path(tempfile.gettempdir())), ("build folder", build_folder())):
        free = shutil.disk_usage(_existing(folder.absolute())).free / _GIB
        yield _enough(f"disk of the {name}", free, _LOW_DISK, "free some space, or choose another folder")
    yield _enough("memory", psutil.virtual_memory().available / _GIB, _LOW_MEMORY, "close other programs")


def _enough(name: str, free: float, least: float, remedy: str) -> Finding:
    enough = free >= least
    detail = f"{free:.1f} GiB free" + ("" if enough else f", less than {least:.1f} GiB")
    return Finding("resources", name, "ok" if enough else "warning", detail, "" if enough else remedy)
