"""What a diagnosis tells those who wait: how its time is divided, the stage it is in, and how many candidates are tried."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")


class Watch:
    """Told about the progress of a diagnosis; this one keeps it to itself."""

    def plan(self, stages: Sequence[tuple[str, float]]) -> None:
        """The stages to come and their shares of the time, in any unit."""

    def stage(self, name: str, text: str) -> None:
        """A stage begins; `text` says it in a few words."""

    def tried(self, done: int, total: int) -> None:
        """So many of the candidates of this pass are fitted; a stage has several passes."""


_WATCH: ContextVar[Watch | None] = ContextVar("watch", default=None)


@contextmanager
def watched_by(watch: Watch) -> Iterator[None]:
    """Within this context `counted` tells `watch`."""
    token = _WATCH.set(watch)
    try:
        yield
    finally:
        _WATCH.reset(token)


def counted(items: Iterable[T], total: int) -> Iterator[T]:
    """The items one by one, each counted as a candidate that has been tried."""
    watch = _WATCH.get()
    for k, item in enumerate(items, 1):
        if watch is not None:
            watch.tried(k, total)
        yield item
