"""Parts of a diagnosis that may fail by themselves: what was found without them stays, and a note says what is missing."""

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from cosim.errors import CosimError


@contextmanager
def part(notes: list[str], what: str) -> Iterator[None]:
    """A part without which the answer stands: its failure becomes a note. Ctrl-C is no failure.

    Args:
        notes: gets the note.
        what: the part, in words.
    """
    try:
        yield
    except Exception as error:
        notes.append(failure(what, error))


def failure(what: str, error: Exception) -> str:
    """A note that a part failed; the traceback goes to stderr if it is asked for."""
    if os.environ.get("COSIM_DEBUG", "0") not in ("", "0"):
        traceback.print_exc(file=sys.stderr)
    if isinstance(error, CosimError):
        return f"{what} failed, the rest stands: {error}"
    if isinstance(error, OSError):  # a full disk is no defect of ours
        where = f"{error.filename}: " if error.filename else ""
        return f"{what} failed, the rest stands: {where}{error.strerror or error}"
    kind = f"{type(error).__name__}: {error}"
    return f"{what} failed, the rest stands ({kind}; please report it, COSIM_DEBUG=1 shows where)"
