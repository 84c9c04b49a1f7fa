"""The report in another language, from a catalogue of messages: English message -> the same in that language.

A message may hold ``{places}``; what stands there is translated by itself. Nothing else of the report knows of languages:
texts are translated where they go into the page, those that a diagnosis has written into its folder as well. What the
catalogue does not know stays English.
"""

import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from pathlib import Path

from cosim.errors import UsageError
from cosim.report.names import DRIVEN, OTHER_AXIS, TURNING, replaced
from cosim.report.picture import Picture

ENGLISH = "en"
LANGUAGES = (ENGLISH, "de")
DEPTH = 6  # of messages within messages
LONG = 3  # items from which on a list is translated item by item, whatever its depth
HALF = 0.5  # of a text that may stay English before it stays so as a whole
SENTENCE = re.compile(r"(?<=[.!?]) (?=[A-Z“\d])")
PLACE = re.compile(r"\{([a-zA-Z_][\w.]*)(?::[^}]*)?\}")
NUMBER = r"[-+−±]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
UNIT = r"[^\W\d_]{1,4}[²³]?"
NUMBERS = re.compile(rf"{NUMBER}(?: to {NUMBER})?(?: ?[%°]| {UNIT}(?:[ /·]{UNIT}){{0,3}})?")


# names of files (with their folders), connectors, effects, parameters and logs
IDENTIFIER = re.compile(
    r"[\w-]*[A-Za-z][\w-]*[_\d][\w-]*|"
    r"[A-Za-z_]\w*(?:[.\[]\w+\]?)+(?: \[[^\]]*\])?|(?:(?:[A-Za-z]:)?[/\\][^\n:]*|[^\s:]+[/\\]\S*)\.[A-Za-z]{2,8}"
)


@dataclass(frozen=True)
class Catalogue:
    """The messages of one language.

    Attributes:
        messages: English -> translated, places kept by name.
        to: word between the ends of a range.
        comma: sign before decimals.
        missing: texts that were asked for and not found.
    """

    messages: dict[str, str]
    to: str
    comma: str
    missing: set[str] = field(default_factory=set, compare=False)

    @cached_property
    def patterns(self) -> list[tuple[re.Pattern[str], str]]:
        """Messages with places, those that say most first."""
        found = [(len(PLACE.sub("", text)), text) for text in self.messages if PLACE.search(text)]
        return [(_pattern(text), self.messages[text]) for _, text in sorted(found, reverse=True)]

    def said(self, text: str) -> str:
        """A text in this language; what is not known stays as it is and is noted in `missing`."""
        lost: list[str] = []
        found = self._said(text, lost, 0)
        self.missing.update(lost)
        return found

    def _said(self, text: str, lost: list[str], depth: int) -> str:
        """The same, with what was not found in `lost`: whole sentences are tried before parts of them."""
        bare = text.strip()
        if not re.search(r"[^\W\d_]", bare) or NUMBERS.fullmatch(bare):
            return self._numbers(text)
        if IDENTIFIER.fullmatch(bare):
            return text
        best: tuple[list[str], str] | None = None
        for made in self._ways(bare, depth):
            own: list[str] = []
            found = made(own)
            if not own:
                return text.replace(bare, found)
            if best is None or sum(map(len, own)) < sum(map(len, best[0])):
                best = own, found
        whole = [bare] if re.search(r"[a-z]{3}", bare) else []
        if best is None or sum(map(len, best[0])) > HALF * len(bare):
            lost += whole
            return text
        lost += best[0]
        return text.replace(bare, best[1])

    def _ways(self, bare: str, depth: int) -> Iterator[Callable[[list[str]], str]]:
        """How a text may be translated: as it is, small at its beginning, by sentences, by a message with places."""
        known = self.messages.get(bare)
        small = bare[0].lower() + bare[1:]
        if known is not None:
            yield lambda lost: known
        elif bare[0].isupper() and small in self.messages:
            yield lambda lost: _large(self.messages[small])
        if depth >= DEPTH:
            return
        sentences = SENTENCE.split(bare)
        if len(sentences) > 1:
            yield lambda lost: " ".join(self._said(sentence, lost, depth + 1) for sentence in sentences)
        parts = bare.split(", ")
        if len(parts) > LONG:
            yield lambda lost: ", ".join(self._said(part, lost, depth + 1) for part in parts)
        for pattern, translated in self.patterns:
            match = pattern.fullmatch(bare)
            if match is not None:
                yield partial(self._placed, translated, match, depth)
            elif bare[0].isupper() and (match := pattern.fullmatch(small)) is not None:
                yield partial(self._placed_large, translated, match, depth)

    def _placed_large(self, translated: str, match: re.Match[str], depth: int, lost: list[str]) -> str:
        return _large(self._placed(translated, match, depth, lost))

    def _placed(self, translated: str, match: re.Match[str], depth: int, lost: list[str]) -> str:
        parts = match.groupdict()
        return PLACE.sub(lambda place: self._said(parts[_name(place[1])], lost, depth + 1), translated)

    def _numbers(self, text: str) -> str:
        text = re.sub(rf"({NUMBER}) to (?={NUMBER})", rf"\1 {self.to} ", text)
        text = re.sub(r"\bdeg\b", self.messages.get("deg", "deg"), text)
        return re.sub(r"(?<=\d)\.(?=\d)", self.comma, text)


def _large(text: str) -> str:
    return text[:1].upper() + text[1:]


def _name(place: str) -> str:
    return place.replace(".", "__")


def _pattern(text: str) -> re.Pattern[str]:
    """The expression that a message with places becomes; a place that comes again must read the same."""
    parts, seen, at = "", set[str](), 0
    for place in PLACE.finditer(text):
        name = _name(place[1])
        parts += re.escape(text[at : place.start()])
        parts += f"(?P={name})" if name in seen else f"(?P<{name}>.+?)"
        seen.add(name)
        at = place.end()
    return re.compile(parts + re.escape(text[at:]), re.DOTALL)


@cache
def catalogue(language: str) -> Catalogue | None:
    """The messages of a language; None for English, in which they are written.

    Raises:
        UsageError: there is no such language.
    """
    if language == ENGLISH:
        return None
    if language not in LANGUAGES:
        raise UsageError(f"the report is not there in '{language}': one of {', '.join(LANGUAGES)}")
    content = tomllib.loads((Path(__file__).parent / f"{language}.toml").read_text(encoding="utf-8"))
    messages = content["messages"]
    return Catalogue(
        of_other_axes(messages, content["other_axis"])
        | of_other_axes(messages, content["other_axis"] | content["driven"], (*OTHER_AXIS, *DRIVEN))
        | of_other_axes(messages, content["other_axis"] | content["turning"], (*OTHER_AXIS, *TURNING))
        | of_other_axes(
            messages,
            content["other_axis"] | content["driven"] | content["turning"],
            (*OTHER_AXIS, *DRIVEN, *TURNING),
        )
        | messages,
        content["to"],
        content["comma"],
    )


def of_other_axes(
    messages: dict[str, str], words: dict[str, str], pairs: tuple[tuple[str, str], ...] = OTHER_AXIS
) -> dict[str, str]:
    """The messages about the crane's slew and valve, as `names` changes them for another machine.

    Args:
        messages: English -> translated.
        words: translated word of the crane -> that of another machine.
        pairs: the same in English.
    """
    found = {}
    for english, translated in messages.items():
        other = replaced(english, pairs)
        if other != english:
            found[other] = replaced(translated, words.items())
    return found


_LANGUAGE: ContextVar[str] = ContextVar("language", default=ENGLISH)


def current() -> str:
    """The language in use."""
    return _LANGUAGE.get()


@contextmanager
def reported_in(language: str) -> Iterator[None]:
    """Within this context reports are written in this language.

    Raises:
        UsageError: there is no such language.
    """
    catalogue(language)
    token = _LANGUAGE.set(language)
    try:
        yield
    finally:
        _LANGUAGE.reset(token)


def said(text: str) -> str:
    """A text in the language in use."""
    found = catalogue(current())
    return text if found is None else found.said(text)


def separators() -> str:
    """Signs before decimals and between thousands, as plotly takes them."""
    found = catalogue(current())
    return ".," if found is None else f"{found.comma}."


def picture_said(picture: Picture) -> Picture:
    """A picture with its words in the language in use."""
    if current() == ENGLISH:
        return picture
    return picture_with(picture, said)


def picture_with(picture: Picture, say: Callable[[str], str]) -> Picture:
    """A picture with its words as `say` says them."""
    panels = [
        replace(panel, y=say(panel.y), layers=[replace(x, name=say(x.name)) for x in panel.layers])
        for panel in picture.panels
    ]
    return replace(
        picture,
        title=say(picture.title),
        x=say(picture.x),
        panels=panels,
        caption=say(picture.caption),
        labels=tuple(say(label) for label in picture.labels),
    )
