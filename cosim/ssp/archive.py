"""Archives from strangers: an .ssp or .fmu is unpacked only when no entry can leave its folder or fill the disk."""

import errno
import io
import os
import re
import stat
import tempfile
import zipfile
from pathlib import Path

from cosim.errors import ModelError, UsageError
from cosim.files import Scratch
from cosim.paths import unsafe_characters

FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))

LARGEST = 4 << 30  # bytes, unpacked: far above any FMU met in practice
SUSPICIOUS_SIZE = 64 << 20  # below this size any ratio is harmless
LARGEST_RATIO = 200  # deflate reaches about 10 on code and tables, 1000 on a bomb
MOST_ENTRIES = 100_000
DOCUMENTS = (".xml", ".ssd", ".ssv", ".ssm", ".ssb")
LARGEST_DOCUMENT = (
    64 << 20
)  # a description of 100 000 variables has half of it; reading takes some 200 ns a byte
SUSPICIOUS_DOCUMENT = 4 << 20  # from here on the ratio counts: no real description packs a hundredfold


class Budget:
    """What an archive and all archives within it may unpack to, together."""

    def __init__(self) -> None:
        self.entries = 0
        self.full = 0
        self.packed: int | None = None

    def take(self, entries: int, full: int, packed: int, what: str) -> None:
        """Count an archive's entries and their bytes, unpacked and packed.

        Raises:
            ModelError: together they are too many.
        """
        self.entries += entries
        self.full += full
        self.packed = packed if self.packed is None else self.packed  # the outermost holds all others
        if self.entries > MOST_ENTRIES:
            raise ModelError(f"{what} has {self.entries} entries; more than {MOST_ENTRIES} are refused")
        if self.full > LARGEST or (
            self.full > SUSPICIOUS_SIZE and self.full > LARGEST_RATIO * max(self.packed, 1)
        ):
            raise ModelError(
                f"{what} would unpack from {self.packed / 1e6:.3g} MB to {self.full / 1e6:.3g} MB with all archives "
                "within it, which is refused as a zip bomb"
            )


def open_archive(source: Path | bytes, what: str, budget: Budget | None = None) -> zipfile.ZipFile:
    """An archive whose entries are all safe to unpack.

    Args:
        source: the file, or its bytes.
        what: its name, for messages.
        budget: of the archive that holds it, if there is one.

    Raises:
        ModelError: it is missing, no archive, damaged, or an entry is unsafe.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
    except FileNotFoundError:
        raise ModelError(f"{what} does not exist") from None
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, ValueError) as error:
        raise ModelError(f"{what} is not a readable zip archive ({error}): build or copy it again") from None
    try:
        _translate_backslashes(archive)
        _check_entries(archive, what)
        size = len(source) if isinstance(source, bytes) else source.stat().st_size
        entries = archive.infolist()
        # entries that overlap claim more packed bytes than the file has
        packed = min(size, sum(e.compress_size for e in entries))
        (budget or Budget()).take(len(entries), sum(e.file_size for e in entries), packed, what)
    except ModelError:
        archive.close()
        raise
    return archive


def _translate_backslashes(archive: zipfile.ZipFile) -> None:
    """Some Windows programs write a backslash between folders; every system shall see the same entries."""
    for entry in archive.infolist():
        entry.filename = entry.orig_filename.partition("\0")[0].replace("\\", "/")
    archive.NameToInfo = {entry.filename: entry for entry in archive.infolist()}


def _check_entries(archive: zipfile.ZipFile, what: str) -> None:
    entries = archive.infolist()
    seen: set[str] = set()
    for entry in entries:
        check_name(entry.orig_filename.replace("\\", "/"), what)
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise ModelError(f"{what}: the entry '{entry.filename}' is a symbolic link, which is refused")
        if entry.flag_bits & 0x1:
            raise ModelError(
                f"{what}: the entry '{entry.filename}' is encrypted: pack it again without a password"
            )
        if entry.filename in seen and not entry.is_dir():  # a folder named twice holds nothing twice
            raise ModelError(f"{what} has two entries named '{entry.filename}': pack it again")
        seen.add(entry.filename)
        if entry.filename.lower().endswith(DOCUMENTS):
            bomb = entry.file_size > max(SUSPICIOUS_DOCUMENT, LARGEST_RATIO * entry.compress_size)
            if bomb or entry.file_size > LARGEST_DOCUMENT:
                raise ModelError(
                    f"{what}: '{entry.filename}' has {entry.file_size / 1e6:.3g} MB, packed "
                    f"{entry.compress_size / 1e6:.3g} MB, which is refused: no description needs that"
                )


def check_name(name: str, what: str) -> None:
    """Refuse an entry's name or a reference that points outside its archive.

    Raises:
        ModelError: it is absolute, has a drive letter, ``..``, a backslash or a NUL.
    """
    bad = name.startswith("/") or re.match(r"[A-Za-z]:", name) or "\\" in name or "\0" in name
    if bad or ".." in name.split("/") or not name.strip("/"):
        raise ModelError(
            f"{what}: '{name}' points outside the archive or is no portable path, which is refused"
        )


def read_entry(archive: zipfile.ZipFile, name: str, what: str) -> bytes:
    """Bytes of one entry.

    Raises:
        ModelError: there is no such entry, or it is damaged.
    """
    check_name(name, what)
    try:
        return archive.read(name)
    except KeyError:
        raise ModelError(f"{what} has no entry '{name}'") from None
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, ValueError) as error:
        raise ModelError(f"{what}: the entry '{name}' is damaged ({error}): build or copy it again") from None
    except Exception as error:  # zlib.error has no common base with the others
        raise ModelError(f"{what}: the entry '{name}' cannot be unpacked: {error}") from None


def unpack(archive: zipfile.ZipFile, folder: Path, what: str) -> None:
    """Unpack a checked archive into `folder`.

    Raises:
        ModelError: an entry is damaged, or collides with another one on this file system.
        UsageError: the disk is full.
    """
    for entry in archive.infolist():
        target = folder / entry.filename
        try:
            if entry.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("xb") as stream:
                stream.write(read_entry(archive, entry.filename, what))
        except OSError as error:
            if error.errno in FULL:  # no fault of the archive's
                raise UsageError(
                    f"no room to unpack {what} in {folder} ({error.strerror}): "
                    "free some, or set TMPDIR to a folder on another disk"
                ) from None
            raise ModelError(f"{what}: '{entry.filename}' cannot be unpacked to {folder}: {error}") from None
        mode = entry.external_attr >> 16
        if os.name == "posix" and mode & 0o100:  # an executable that the FMU starts itself
            target.chmod(0o755)


def scratch_folder() -> "tuple[tempfile.TemporaryDirectory[str], str]":
    """A temporary folder under whose path an FMU can run, and a note (empty if the usual place will do).

    A pythonfmu FMU unpacked under a path with ``#``, ``%``, ``+``, ``(`` or a non-ASCII letter crashes the process.

    Raises:
        ModelError: no safe folder can be written to.
    """
    usual = Path(tempfile.gettempdir())
    others = (
        [os.environ.get(name, "") for name in ("PUBLIC", "PROGRAMDATA")]
        if os.name == "nt"
        else ["/tmp", "/var/tmp"]
    )
    for parent in (usual, *(Path(other) for other in others if other)):
        if unsafe_characters(parent) or not os.access(parent, os.W_OK):
            continue
        folder = Scratch("cosim_", parent)
        if parent == usual:
            return folder, ""
        return folder, (
            f"the temporary folder {usual} has characters that crash FMUs ({unsafe_characters(usual)}); "
            f"unpacked to {parent} instead"
        )
    raise ModelError(
        f"FMUs crash under the temporary folder {usual} because of '{unsafe_characters(usual)}' in its path: "
        "set TMPDIR (Windows: TEMP) to a plain ASCII path without # % + ("
    )
