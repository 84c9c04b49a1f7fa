"""A disk that fails: every n-th sync, rename or new folder refused, or no file longer than so many bytes."""

import contextlib
import errno
import os
from collections.abc import Callable, Iterator
from unittest import mock

CALLS = ("fsync", "replace", "mkdir")


class Faults:
    """Counts calls of the operating system and lets one of them fail.

    Attributes:
        seen: how many calls there were.
    """

    def __init__(self, at: int) -> None:
        self.at = at
        self.seen = 0

    def around(self, call: Callable) -> Callable:
        def failing(*arguments, **options):
            self.seen += 1
            if self.seen == self.at:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(arguments[0]))
            return call(*arguments, **options)

        return failing


@contextlib.contextmanager
def failing_call(at: int) -> Iterator[Faults]:
    """The call number `at`, counted from 1, of those in CALLS fails as on a full disk."""
    faults = Faults(at)
    with contextlib.ExitStack() as stack:
        for name in CALLS:
            stack.enter_context(mock.patch.object(os, name, faults.around(getattr(os, name))))
        yield faults


@contextlib.contextmanager
def full_after(size: int) -> Iterator[None]:
    """No file of this process can grow beyond `size` bytes, whoever writes it: Python, pyarrow or a picture's library."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
