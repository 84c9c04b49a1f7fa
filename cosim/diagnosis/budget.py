"""The time a diagnosis may take: searches end in time with the best so far; what was not tried is kept for the answer."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from cosim.errors import UsageError
from cosim.units import parse_quantity


class Budget:
    """A span of time, and what was left out because it was over. Not limited unless a span is given.

    Args:
        seconds: the span, s.
        clock: tells the time, s.

    Attributes:
        ended: somebody has ended it before its time.
    """

    def __init__(self, seconds: float = math.inf, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds = seconds
        self._clock, self._begin = clock, clock()
        self._until = self._stage = self._first = math.inf
        self._searching = False
        self.ended = False
        self._left_out: dict[str, dict[str, int]] = {}

    def allow(self, share: float) -> None:
        """What follows may take until this share of the whole span is gone."""
        self._until = self._stage = self._begin + share * self.seconds
        self._first = min(self._first, self._clock())

    @property
    def over(self) -> bool:
        """True if the stage that runs must end."""
        return self.ended or self._clock() >= self._until

    def left(self, grace: float, least: float) -> float:
        """How long what runs may take until it is cut off, s: without bound once somebody has ended the time.

        Args:
            grace: share of the span that it may take beyond its stage.
            least: time that all stages together have at least from the first one on, s.
        """
        if self.ended or self.seconds == math.inf:
            return math.inf
        return max(self._stage + grace * self.seconds, self._first + least) - self._clock()

    @property
    def gone(self) -> bool:
        """True if nothing of the span is left: what runs is cut, and what could follow is left out."""
        return self.ended or self._clock() >= self._begin + self.seconds

    @contextmanager
    def part(self, share: float) -> Iterator[None]:
        """What runs within this context may take this share of what is left to its stage."""
        until, now = self._until, self._clock()
        self._until = min(until, now + share * max(until - now, 0.0))
        try:
            yield
        finally:
            self._until = until

    @contextmanager
    def searching(self) -> Iterator[None]:
        """Within this context all that runs ends soon once the time is over, with the best so far."""
        self._searching = True
        try:
            yield
        finally:
            self._searching = False

    def end(self) -> bool:
        """End the time now; False if it has been ended before, or nothing runs that would take notice."""
        if self.ended or not self._searching:
            return False
        self.ended = True
        return True

    def leave_out(self, group: str, what: str) -> None:
        """Something is not tried in a group."""
        kept = self._left_out.setdefault(group, {})
        kept[what] = kept.get(what, 0) + 1

    @property
    def why(self) -> str:
        """Why something was left out."""
        return "it was interrupted" if self.ended else f"the time allowed ({self.seconds:g} s) was over"

    def omitted(self, what: str) -> str:
        """A note that a part was left out."""
        return f"{what} was left out: {self.why}"

    @property
    def warnings(self) -> list[str]:
        """What was not tried, a sentence a group."""
        return [
            f"{group}: {self.why}; not tried: "
            + ", ".join(what if count == 1 else f"{what} ({count} of them)" for what, count in kept.items())
            for group, kept in self._left_out.items()
        ]


def parse_budget(text: str) -> float:
    """Seconds of a span of time with its unit, such as "60 s".

    Raises:
        UsageError: no time, or none that is positive.
    """
    seconds = parse_quantity(text, "s")
    if not seconds > 0.0:
        raise UsageError(f"--budget {text}: a budget must be a positive time, such as 60s")
    return seconds


T = TypeVar("T")
R = TypeVar("R")

_BUDGET: ContextVar[Budget | None] = ContextVar("budget", default=None)


def current() -> Budget:
    """The budget of the diagnosis that runs. Threads of a pool see it through `seen_by_threads`."""
    return _BUDGET.get() or Budget()


def seen_by_threads(function: Callable[[T], R]) -> Callable[[T], R]:
    """The function, for the threads of a pool: what it calls finds the budget of the thread that asks now."""
    budget = current()

    def called(argument: T) -> R:
        with within(budget):
            return function(argument)

    return called


@contextmanager
def within(budget: Budget) -> Iterator[None]:
    """Within this context `current` is this budget."""
    token = _BUDGET.set(budget)
    try:
        yield
    finally:
        _BUDGET.reset(token)
