"""Files of a batch: found, named and remembered by their content."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from cosim.batch.job import File
from cosim.batch.plan import Plan
from cosim.errors import DataError, UsageError


def find_logs(plan: Plan) -> list[Path]:
    """The logs that the plan names, each once: files, folders (what has a log's suffix), patterns.

    Raises:
        UsageError: a name leads to nothing.
    """
    if not plan.logs:
        return []
    from cosim.logs.load import ENDINGS, SUFFIXES, ending, stem

    # in a folder of logs a .log is as a rule what a program says of itself; named, it is read
    in_folders = tuple(known for known in ENDINGS if not known.startswith(".log"))
    found: dict[Path, None] = {}
    for name in plan.logs:
        path = Path(name)
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if p.is_file() and ending(p.name) in in_folders)
        elif path.is_file():
            inside = [path]
        else:
            top = Path(path.anchor)
            inside = sorted(p for p in top.glob(str(path.relative_to(top))) if p.is_file())
        inside = [p for p in inside if not (plan.external and stem(p).endswith(plan.external))]
        if not inside:
            raise UsageError(
                f"'{name}' leads to no log: give files, folders or patterns ({', '.join(SUFFIXES)})"
            )
        found |= dict.fromkeys(p.absolute() for p in inside)
    return list(found)


def find_trackers(plan: Plan, files: Sequence[File]) -> dict[str, File]:
    """Log's label -> the tracker's file that lies beside the log, where there is one."""
    if not plan.external:
        return {}
    from cosim.logs.load import ENDINGS, stem

    found = {}
    for file in files:
        path = Path(file.path)
        beside = [p for s in ENDINGS if (p := path.with_name(f"{stem(path)}{plan.external}{s}")).is_file()]
        if beside:
            found[file.label] = named_file(stem(beside[0]), beside[0])
    return found


def named_file(label: str, path: Path) -> File:
    """A file as it is now.

    Raises:
        DataError: it cannot be read.
    """
    try:
        return File(label, str(path.absolute()), hashlib.sha256(path.read_bytes()).hexdigest())
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None


def labelled(paths: Sequence[Path]) -> dict[str, Path]:
    """Paths by name without suffix; where two have the same, by as much of the path as tells them apart."""
    if not paths:
        return {}
    from cosim.logs.load import stem

    found: dict[str, Path] = {}
    for path in dict.fromkeys(paths):
        parts = [*path.absolute().parts[1:-1], stem(path)]
        same = [p for p in paths if p != path and stem(p) == stem(path)]
        size = 1
        while same and size < len(parts):
            size += 1
            same = [p for p in same if [*p.absolute().parts[1:-1], stem(p)][-size:] == parts[-size:]]
        found["_".join(parts[-size:]) if not same else path.name] = path
    return found
