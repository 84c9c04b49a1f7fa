"""Which column a variable's description means: by words they share, and by the kinds of quantity that they name.

A match of this kind is a proposal for a person to check. It is made only where column and variable mean each other best:
what two columns, or two variables, fit about as well is left open.
"""

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence

from cosim.logs.clocks import plain
from cosim.logs.guess import KINDS, OPPOSITE, SIDES
from cosim.ssp.stated import without_unit

FITS = 0.5  # share of a column's words, rare ones counting more, from which on a description may mean it
APART = 0.12  # by which it must mean it better than any other
OF_COMPONENT = 0.6  # what a word of the component's name counts: all its variables share it
OF_KIND = 0.9  # what a word counts that names the same kind of quantity in another way
# a name that has one of these beside a quantity is the demanded, commanded or estimated one
BEHIND = ("reference", "command", "estimate", "error")
Akin = Callable[[str, str], float]


def named_kinds(text: str) -> set[str]:
    """All kinds of quantity that a name or a description names."""
    words = plain(text)
    return {kind for kind, pattern in KINDS.items() if re.search(pattern, words)}


def kinds_of(text: str) -> set[str]:
    """The kinds of quantity that a text stands for: a slew rate is a speed, a demanded angle a reference."""
    found = named_kinds(text)
    first = next((kind for kind in BEHIND if kind in found), None)
    if first is not None:
        return {first}
    # the pressure of a cylinder is no place, the rate of an angle no angle
    return found - {"angle", "place"} or found


def conflicts(one: str, other: str) -> bool:
    """Whether two texts stand for different kinds of quantity; what names none may be any.

    A setpoint may be the command, unless it is one of something else, as of a stroke.
    """
    first, second = kinds_of(one), kinds_of(other)
    if first | second == {"reference", "command"}:
        asked, given = (one, other) if "reference" in first else (other, one)
        return bool(named_kinds(asked) - named_kinds(given) - {"reference", "command"})
    return bool(first and second and not first & second)


def behind(column: str, other: str) -> str:
    """What a column is called that the other is not: a demanded or an estimated position is no measured one. Or empty."""
    return next((kind for kind in BEHIND if kind in kinds_of(column) - kinds_of(other)), "")


def contrary(one: Collection[str], other: Collection[str]) -> bool:
    """Whether two texts' words name opposite sides or directions: head and rod, up and down."""
    own, wanted = set(one), set(other)
    for pair in (*SIDES, *OPPOSITE):
        for here, there in (pair, pair[::-1]):
            if own & here and wanted & there and not (own & there or wanted & here):
                return True
    return False


class Meaning:
    """How well columns fit descriptions.

    Args:
        columns: names of all columns.
        words: takes a name apart.
        akin: how well two words fit, from 0 to 1.
    """

    def __init__(self, columns: Sequence[str], words: Callable[[str], list[str]], akin: Akin) -> None:
        self._words, self._akin = words, akin
        self._own = {name: words(name) for name in columns}
        self._count = len(columns)

    def fit(self, column: str, variable: str, description: str, component: str) -> float:
        """From 0 to 1: the share of a column's words that the description has, rare ones counting more."""
        told = f"{variable} {without_unit(description)}"
        own, wanted, beside = self._own[column], self._words(told), self._words(component)
        if not own or conflicts(column, told) or contrary(own, wanted):
            return 0.0
        kinds = kinds_of(column) & kinds_of(told)
        weights = [self._weight(word) for word in own]
        found = [
            max(
                max((self._one(word, other) for other in wanted), default=0.0),
                OF_COMPONENT * max((self._one(word, other) for other in beside), default=0.0),
                OF_KIND * bool(kinds & kinds_of(word)),
            )
            for word in own
        ]
        return sum(w * f for w, f in zip(weights, found, strict=True)) / sum(weights)

    def _weight(self, word: str) -> float:
        """A word of all columns tells little of one."""
        return math.log(1.0 + self._count / sum(word in own for own in self._own.values()))

    def _one(self, word: str, other: str) -> float:
        same = any(word in side and other in side for pair in (*SIDES, *OPPOSITE) for side in pair)
        return max(OF_KIND if same else 0.0, self._akin(word, other))


def clearly(
    fits: Mapping[tuple[int, str], float], other_way: Mapping[int, int] | None = None
) -> dict[int, str]:
    """Of (column, variable) -> fit those that mean each other clearly best, and then of what is left.

    Args:
        fits: how well each column fits each variable.
        other_way: column -> that of the other direction of the same command; the first of two stands for both.
    """
    second = {k for k, other in (other_way or {}).items() if k > other}
    fits = {pair: fit for pair, fit in fits.items() if pair[0] not in second}
    found: dict[int, str] = {}
    while True:
        left = {pair: f for pair, f in fits.items() if pair[0] not in found and pair[1] not in found.values()}
        best = {
            column: variable
            for (column, variable), fit in left.items()
            if fit >= FITS
            and fit
            >= APART + max((f for (k, v), f in left.items() if (k == column) != (v == variable)), default=0.0)
        }
        if not best:
            return found
        found |= best
