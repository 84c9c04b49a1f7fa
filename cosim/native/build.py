"""Build native FMUs: C sources from the composed equations, compiled for this platform, packed the same way each time."""

import contextlib
import hashlib
import importlib.util
import os
import shlex
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import fmpy
from lxml import etree
from lxml.builder import E

from cosim import trust
from cosim.errors import CosimError, ModelError, UsageError
from cosim.files import Scratch, whole, write_bytes
from cosim.native import fmi3
from cosim.native.exchange import extended
from cosim.native.header import guid_line, header, read_as
from cosim.native.model import Model, single
from cosim.native.page import ICON, page
from cosim.paths import cache_folder
from fmus.build import ARCHIVE_DATE, PICTURES, checked_starts
from fmus.compose import Composed
from fmus.describe import described

TOOL = "slew-cosim, native"
OWN = (
    "fmu.c", "exchange.h", "instance.h", "life.h", "rates.h", "saved.h", "semantics.h", "stepping.h", "tables.h", "values.h",
)  # fmt: skip
# what each version of FMI has: our text of its functions, and the headers of the FMI project (2-clause BSD)
VERSIONS = {
    "2.0": ("fmi2.h", ("fmi2FunctionTypes.h", "fmi2Functions.h", "fmi2TypesPlatform.h")),
    "3.0": ("fmi3.h", ("fmi3FunctionTypes.h", "fmi3Functions.h", "fmi3PlatformTypes.h")),
}
FLAGS = ("-std=c99", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-fPIC")
OPTIMISED = "-O2"


@dataclass(frozen=True)
class Platform:
    """Another platform than this one, for which a cross compiler makes a binary.

    Attributes:
        folders: its folder of binaries by version of FMI; 2.0 takes the name of 3.0 for what it has none for (2.0.4, 2.3).
        suffix: of a shared library.
        target: what Zig calls it, with the oldest system that the binary is for.
        compilers: commands that are tried before Zig.
        variable: environment variable that names another one.
        package: Debian package that has it; empty where Debian has none.
        flags: what it needs beside `FLAGS`.
    """

    folders: Mapping[str, str]
    suffix: str
    target: str
    compilers: tuple[str, ...]
    variable: str
    package: str
    flags: tuple[str, ...] = ()


PLATFORMS = {
    "linux64": Platform(
        {"2.0": "linux64", "3.0": "x86_64-linux"}, ".so", "x86_64-linux-gnu.2.17", ("x86_64-linux-gnu-gcc",), "CC_LINUX64",
        "gcc-x86-64-linux-gnu",
    ),
    # no time of the build in the file, and no library beside those that every Windows has
    "win64": Platform(
        {"2.0": "win64", "3.0": "x86_64-windows"}, ".dll", "x86_64-windows-gnu", ("x86_64-w64-mingw32-gcc",), "CC_WIN64",
        "gcc-mingw-w64-x86-64", ("-s", "-static-libgcc", "-Wl,--no-insert-timestamp"),
    ),
    "aarch64-linux": Platform(
        {"2.0": "aarch64-linux", "3.0": "aarch64-linux"}, ".so", "aarch64-linux-gnu.2.17", ("aarch64-linux-gnu-gcc",),
        "CC_AARCH64_LINUX", "gcc-aarch64-linux-gnu",
    ),
    # FMI 2.0 has one folder for both kinds of Mac, and one file there holds the code of both (`universal`)
    "x86_64-darwin": Platform(
        {"2.0": "darwin64", "3.0": "x86_64-darwin"}, ".dylib", "x86_64-macos.11.0", (), "CC_X86_64_DARWIN", ""
    ),
    "aarch64-darwin": Platform(
        {"2.0": "darwin64", "3.0": "aarch64-darwin"}, ".dylib", "aarch64-macos.11.0", (), "CC_AARCH64_DARWIN", ""
    ),
}  # fmt: skip
ALIASES: dict[str, tuple[str, ...]] = {
    "x86_64-linux": ("linux64",),
    "x86_64-windows": ("win64",),
    "darwin64": ("x86_64-darwin", "aarch64-darwin"),
    "all": tuple(PLATFORMS),
}
ZIG = "the extra `cross` (pip install 'slew-cosim[cross]')"


class MissingCompilerError(CosimError):
    """There is no C compiler (exit code 5, as for any optional part that is missing)."""

    exit_code = 5


def compiler() -> list[str]:
    """The C compiler's command: CC, or the first of cc, gcc, clang and Zig.

    Raises:
        MissingCompilerError: there is none.
    """
    named = os.environ.get("CC")
    if named:
        command = shlex.split(named)
        if shutil.which(command[0]) is None:
            raise MissingCompilerError(f"CC names '{named}', which is no program: set CC to a C compiler")
        return command
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name) is not None:
            return [name]
    for known in PLATFORMS.values():
        if known.folders["3.0"] == fmpy.platform_tuple and shutil.which((command := zig(known.target))[0]):
            return command
    raise MissingCompilerError(
        "native FMUs need a C compiler, and there is none (tried cc, gcc, clang, zig): install one, such as gcc or "
        f"{ZIG}, or set CC"
    )


def cross_compiler(platform: str) -> list[str]:
    """The command of a C compiler for another platform, a key of `PLATFORMS`.

    Raises:
        MissingCompilerError: there is none.
    """
    known = PLATFORMS[platform]
    named = os.environ.get(known.variable)
    tried = [shlex.split(named)] if named else [[name] for name in known.compilers]
    if not named:
        tried.append(zig(known.target))
    for command in tried:
        if shutil.which(command[0]) is not None:
            return command
    ways = [f"Debian's {known.package}"] if known.package else []
    raise MissingCompilerError(
        f"binaries for {platform} need a C compiler for it, and there is none (tried {', '.join(c[0] for c in tried)}): "
        f"install {' or '.join([*ways, ZIG])}, or name one in {known.variable}"
    )


def zig(target: str) -> list[str]:
    """The command of Zig's C compiler for a platform: of the package `ziglang`, or of a `zig` on the path."""
    program = [sys.executable, "-m", "ziglang"] if importlib.util.find_spec("ziglang") else ["zig"]
    return [*program, "cc", "-target", target, "-s"]


def further(platforms: Sequence[str]) -> tuple[str, ...]:
    """Platforms as keys of `PLATFORMS`, without this machine's own, each once.

    Raises:
        UsageError: one is not known.
        MissingCompilerError: there is no compiler for one.
    """
    found: list[str] = []
    for name in platforms:
        for key in ALIASES.get(name, (name,)):
            if key not in PLATFORMS:
                raise UsageError(
                    f"'{name}' is no platform that can be built for; known are {', '.join([*PLATFORMS, *ALIASES])}"
                )
            if PLATFORMS[key].folders["3.0"] != fmpy.platform_tuple and key not in found:
                cross_compiler(key)
                found.append(key)
    return tuple(found)


def universal(libraries: Sequence[bytes]) -> bytes:
    """One library for Macs of several kinds from one for each; a single one is itself.

    The form is Apple's (mach-o/fat.h): for each part its kind of processor, where it lies and how long it is.
    """
    if len(libraries) == 1:
        return libraries[0]
    page = 14  # of the largest pages of any, as a power of two
    place, entries, parts = 1 << page, [], b""
    for library in libraries:
        kind, variant = struct.unpack_from("<II", library, 4)
        entries.append(struct.pack(">IIIII", kind, variant, place + len(parts), len(library), page))
        parts += library + bytes(-len(library) % (1 << page))
    head = struct.pack(">II", 0xCAFEBABE, len(libraries)) + b"".join(entries)
    return head.ljust(place, b"\0") + parts


@cache
def release(command: tuple[str, ...]) -> str:
    """What a compiler calls itself."""
    done = subprocess.run(
        [*command, "--version"], capture_output=True, text=True, env=_variables(), check=False
    )
    return done.stdout


def _variables() -> dict[str, str]:
    """What a compiler is started with: Zig keeps what it made of a platform's C library where we keep ours."""
    return {"ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / "zig"), **os.environ}


def sources(model: Model, guid: str, fmi: str = "2.0") -> dict[str, bytes]:
    """C files of an FMU by name; `guid` is what an instance is asked for in the version `fmi`."""
    own = {name: (files("cosim.native") / "c" / name).read_bytes() for name in (*OWN, VERSIONS[fmi][0])}
    return own | standard_headers(fmi) | {"model.h": header(model, guid, fmi).encode()}


def identified(text: bytes, guid: str) -> bytes:
    """The text of a model.h that has no GUID yet with one; its equations are translated once for both."""
    return text.replace(guid_line("").encode(), guid_line(guid).encode(), 1)


def standard_headers(fmi: str) -> dict[str, bytes]:
    """The C headers of a version of the standard by name."""
    folder = Path(fmpy.__file__).parent / "c-code"
    return {name: (folder / name).read_bytes().replace(b"\r\n", b"\n") for name in VERSIONS[fmi][1]}


def compiled(
    content: Mapping[str, bytes], name: str, optimise: str | None = None, platform: str | None = None
) -> bytes:
    """The library of these sources; kept in the cache folder, since only they and the compiler count.

    Args:
        content: files by name.
        name: of the library, which those of a Mac hold.
        optimise: the compiler's options for speed; by default `OPTIMISED`.
        platform: a key of `PLATFORMS`; by default this machine's own.

    Raises:
        MissingCompilerError: there is no compiler.
        ModelError: it could not compile them; the message holds its words.
    """
    given = compiler() if platform is None else cross_compiler(platform)
    suffix = fmpy.sharedLibraryExtension if platform is None else PLATFORMS[platform].suffix
    flags = FLAGS if platform is None else (*FLAGS, *PLATFORMS[platform].flags)
    command = [*given, *flags, *shlex.split(optimise or OPTIMISED)]
    known = hashlib.sha256("\0".join([*command, release(tuple(given)), name]).encode())
    for file, data in sorted(content.items()):
        known.update(file.encode() + b"\0" + data)
    kept = cache_folder() / "native" / f"{known.hexdigest()[:32]}{suffix}"
    if kept.exists():
        return kept.read_bytes()
    with Scratch("native_") as scratch:
        for file, data in content.items():
            Path(scratch, file).write_bytes(data)
        library = Path(scratch, name + suffix)
        last = ["-lm"] if suffix != ".dll" else []
        done = subprocess.run(
            [*command, "fmu.c", "-o", library.name, *last], cwd=scratch, env=_variables(), capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        if done.returncode != 0:
            raise ModelError(
                f"{command[0]} could not compile the FMU: {done.stderr[:2000] or done.stdout[:2000]}"
            )
        data = library.read_bytes()
    with contextlib.suppress(OSError):  # the next build compiles again
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(kept, data)
    return data


def build_description(model: Model) -> bytes:
    """How to compile the sources, in the form that FMI 3.0 defines and tools read for FMI 2.0 too."""
    flags = " ".join(f for f in FLAGS if f not in ("-shared", "-fPIC"))
    files = E.SourceFileSet(
        E.SourceFile(name="fmu.c"), language="C99", compiler="gcc", compilerOptions=f"{flags} {OPTIMISED}"
    )
    setting = E.BuildConfiguration(files, E.Library(name="m", external="true"), modelIdentifier=model.name)
    root = E.fmiBuildDescription(setting, fmiVersion="3.0")
    text: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True)
    return text


def entries(
    model: Model,
    resources: Mapping[str, bytes],
    optimise: str | None = None,
    fmi: str = "2.0",
    platforms: Sequence[str] = (),
) -> dict[str, bytes]:
    """Everything in the FMU's archive by name; arguments as `write_fmu`."""
    plain = sources(model, "", fmi)
    played = b"".join(name.encode() + data for name, data in sorted(resources.items()))
    digested = b"".join(name.encode() + plain[name] for name in sorted(plain)) + played
    description = described(
        model.name, model.title, model.rows, model.feedthrough, model.initial, model.starts, digested, model.step_size,
        TOOL, ["fmu.c"], [n for n, _ in model.of("input") if read_as(model, n) == "AT_START"],
    )  # fmt: skip
    description = extended(description, model, digested)
    if fmi == "3.0":
        description = fmi3.description(description, model, digested)
    guid = description.get("guid") or description.get("instantiationToken")
    content = plain | {"model.h": identified(plain["model.h"], guid)}
    folder = fmpy.platform if fmi == "2.0" else fmpy.platform_tuple
    library = f"binaries/{folder}/{model.name}{fmpy.sharedLibraryExtension}"
    found = {
        "modelDescription.xml": etree.tostring(
            description, encoding="UTF-8", xml_declaration=True, pretty_print=True
        ),
        "documentation/index.html": page(model, fmi),
        "sources/buildDescription.xml": build_description(model),
    }
    libraries = {library: [compiled(content, model.name, optimise)]}
    for name in further(platforms):
        other = PLATFORMS[name]
        path = f"binaries/{other.folders[fmi]}/{model.name}{other.suffix}"
        libraries.setdefault(path, []).append(compiled(content, model.name, optimise, name))
    found |= {path: universal(parts) for path, parts in libraries.items()}
    found |= {f"sources/{name}": data for name, data in content.items()}
    found |= {f"resources/{name}": data for name, data in resources.items()}
    picture = PICTURES / f"{model.name}.png"
    if fmi == "3.0":
        found["terminalsAndIcons/terminalsAndIcons.xml"] = fmi3.terminals(model, picture.exists())
    return found | ({ICON[fmi]: picture.read_bytes()} if picture.exists() else {})


def write_fmu(
    model: Model,
    destination: Path,
    resources: Mapping[str, bytes] | None = None,
    optimise: str | None = None,
    fmi: str = "2.0",
    platforms: Sequence[str] = (),
) -> Path:
    """Write a native FMU.

    Args:
        model: what it holds.
        destination: the .fmu file.
        resources: files to put among the FMU's resources, by name.
        optimise: the compiler's options for speed; by default `OPTIMISED`.
        fmi: version of the standard, 2.0 or 3.0.
        platforms: other platforms whose binaries it gets beside that of this machine, keys of `PLATFORMS`.

    Returns:
        `destination`.

    Raises:
        MissingCompilerError: there is no C compiler, for this machine or another platform.
        ModelError: an equation has no translation, or the compiler failed.
        UsageError: a platform is not known.
    """
    found = entries(model, resources or {}, optimise, fmi, platforms)
    destination.parent.mkdir(parents=True, exist_ok=True)
    with whole(destination) as part, zipfile.ZipFile(part, "w") as archive:
        for name in sorted(found):
            info = zipfile.ZipInfo(name, ARCHIVE_DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            info.create_system = 3  # the same on every platform
            archive.writestr(info, found[name], compresslevel=6)
    trust.remember(destination)
    return destination


def build_native(
    composed: Composed,
    destination: Path,
    starts: Mapping[str, float] | None = None,
    resources: Mapping[str, bytes] | None = None,
    optimise: str | None = None,
    fmi: str = "2.0",
    platforms: Sequence[str] = (),
) -> Path:
    """Build the native twin of `fmus.build.build_fmu`, with the same arguments, variables and refusals.

    `optimise`, `fmi` and `platforms` are those of `write_fmu`.

    Raises:
        UsageError: a start value is unknown or out of range.
        MissingCompilerError, ModelError: as `write_fmu`.
    """
    model = single(composed, checked_starts(composed, starts or {}))
    return write_fmu(model, destination, resources, optimise, fmi, platforms)
