"""Files that are whole or absent: written beside, synced, renamed.

A full disk, a kill or a power cut leaves what was there before, or the new file, never a part of it; two writers of one
file leave one of the two whole.
"""

import contextlib
import errno
import os
import platform
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from cosim.errors import UsageError
from cosim.interrupts import uninterrupted

MARK = ".part"
TAKEN = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)  # what a lock that another process has answers
_BEYOND = 1 << 30  # the byte that Windows locks: one of the content could not be read by others
_LONGEST, _LONGEST_SUFFIX = 150, 50  # bytes of the old name in the hidden one, of 255 that a name may have


class Scratch(tempfile.TemporaryDirectory[str]):
    """A temporary folder that no signal leaves half made or half removed, for nobody to remove."""

    def __init__(self, prefix: str, parent: Path | str | None = None) -> None:
        """Make it, in `parent` or where temporary files go."""
        with uninterrupted():
            super().__init__(prefix=prefix, dir=parent, ignore_cleanup_errors=True)

    def cleanup(self) -> None:
        """Remove it."""
        with uninterrupted():
            super().cleanup()


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A path to write to, of the same suffix in the same folder; at the end of the block it takes the place of `path`.

    Where the block fails nothing is left, and `path` is what it was. A device or pipe is written to directly.

    Raises:
        OSError: it cannot be written, synced or renamed, or `path` is write-protected.
    """
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    if target.exists() and not target.is_file():
        yield target  # a folder is refused by whoever opens it
        return
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(13, "it is write-protected", str(path))
    stem = os.fsencode(target.stem)[:_LONGEST].decode(errors="ignore")
    suffix = target.suffix if len(os.fsencode(target.suffix)) <= _LONGEST_SUFFIX else ""
    part = target.with_name(f".{stem}.{os.getpid()}.{secrets.token_hex(4)}{MARK}{suffix}")
    try:
        yield part
        if target.exists():
            shutil.copymode(target, part)
        sync(part)
        part.replace(target)
    except BaseException as error:  # Ctrl-C, too
        with contextlib.suppress(OSError):
            part.unlink()
        if isinstance(error, OSError) and str(error.filename) == str(part):
            error.filename = str(path)  # what the user named
        raise
    sync_folder(target.parent)


def write_bytes(path: Path, content: bytes) -> Path:
    """Writes a file whole.

    Raises:
        OSError: it cannot be written.
    """
    with whole(path) as part:
        part.write_bytes(content)
    return path


def write_text(path: Path, text: str, newline: str | None = None) -> Path:
    """Writes a text file whole, in UTF-8.

    Raises:
        OSError: it cannot be written.
    """
    with whole(path) as part:
        part.write_text(text, encoding="utf-8", newline=newline)
    return path


def why_no_file(path: Path) -> str:
    """What a path is that is no file."""
    if path.is_dir():
        return "this is a folder"
    if path.exists():
        return "this is a pipe or a device: write what it gives to a file first"
    return "there is no such file"


def keep_inputs(targets: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Refuse to write over, or to clear away as an earlier result, what a command reads.

    Raises:
        UsageError: a target is one of the inputs.
    """
    read = {os.path.realpath(path) for path in inputs}
    for target in targets:
        if os.path.realpath(target) in read:
            raise UsageError(
                f"{target} is read, and a result of that name would take its place: name another --out"
            )


def is_left_over(path: Path) -> bool:
    """Whether a file is what a killed writer left beside the file that it meant."""
    return path.name.startswith(".") and MARK in path.name


class HeldError(Exception):
    """Another process holds a lock; the text is which."""


@contextlib.contextmanager
def held(lock: Path) -> Iterator[None]:
    """A file that one process at a time holds: its end or a kill lets go of it.

    Where the file system knows no locks the block runs all the same. Of our own, because the library filelock does not
    say who holds a lock, and leaves its file behind.

    Raises:
        HeldError: another process holds it.
        OSError: it cannot be written.
    """
    handle = _opened(lock)
    try:
        os.truncate(handle, 0)
        os.write(handle, f"process {os.getpid()} on {platform.node()}".encode())
        yield
    finally:
        try:
            with contextlib.suppress(FileNotFoundError):
                lock.unlink()  # while it is held: later it may be another's
            os.close(handle)
        except PermissionError:  # Windows takes away no open file, nor one that another has opened since
            os.close(handle)
            with contextlib.suppress(OSError):
                lock.unlink()


def _opened(lock: Path) -> int:
    """The file, open and locked."""
    while True:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(handle)
        except OSError as error:
            if error.errno not in TAKEN:
                return handle
            holder = os.read(handle, 200).decode(errors="replace")
            os.close(handle)
            raise HeldError(holder or "a process that has just begun") from None
        with contextlib.suppress(OSError):
            if os.path.samestat(os.fstat(handle), lock.stat()):
                return handle
        os.close(handle)  # who held it took it away meanwhile


def _lock(handle: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        os.lseek(handle, _BEYOND, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def sync(path: Path) -> None:
    """Makes what a file holds last.

    Raises:
        OSError: it cannot be written.
    """
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())


def sync_folder(folder: Path) -> None:
    """Makes new names in it last; where a system cannot sync folders, the file itself is safe all the same."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
