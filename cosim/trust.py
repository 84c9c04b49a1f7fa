"""Which FMUs are ours: those that this installation built, byte for byte, by the digests it wrote down when it did.

An FMU is native code or Python: it can do to a process whatever the process can. Ours run in the tool's own process;
all others in a child that is watched (`cosim.master.apart`).
"""

import contextlib
import hashlib
from pathlib import Path

from cosim.paths import cache_folder

MOST_DIGESTS = 20_000  # digests kept; each is an empty file
_built: set[str] = set()


def digest_of(fmu: Path | bytes) -> str:
    """SHA-256 of an FMU's archive."""
    if isinstance(fmu, bytes):
        return hashlib.sha256(fmu).hexdigest()
    with fmu.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def remember(fmu: Path) -> None:
    """Write down that we built this FMU; where nothing can be written, this process alone remembers."""
    digest = digest_of(fmu)
    _built.add(digest)
    folder = _folder()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        Path(folder, digest).touch()
        known = list(folder.iterdir())
        if len(known) > MOST_DIGESTS:
            known.sort(key=lambda file: file.stat().st_mtime)
            for file in known[: MOST_DIGESTS // 2]:
                file.unlink(missing_ok=True)


def is_ours(fmu: Path | bytes) -> bool:
    """Whether this installation built it."""
    digest = digest_of(fmu)
    return digest in _built or Path(_folder(), digest).is_file()


def _folder() -> Path:
    return cache_folder() / "built"
