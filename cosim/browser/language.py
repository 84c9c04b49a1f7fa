"""The page in another language: its own catalogue on top of the report's, so that a name is translated once."""

import tomllib
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from cosim.report.language import Catalogue, catalogue


@cache
def words(language: str) -> Catalogue | None:
    """The messages of report and page; None for English.

    Raises:
        UsageError: there is no such language.
    """
    report = catalogue(language)
    if report is None:
        return None
    return Catalogue({**report.messages, **_own(language)["messages"]}, report.to, report.comma)


@lru_cache(maxsize=1000)  # the same few texts are asked for several times a second
def said(text: str, language: str) -> str:
    """A text of the server in a language; what the catalogues do not know stays English."""
    found = words(language)
    return text if found is None else found.said(text)


def page_words(language: str) -> dict[str, Any]:
    """What the page itself needs: its own words, the sign before decimals."""
    report = catalogue(language)
    if report is None:
        return {"comma": ".", "said": {}}
    return {"comma": report.comma, "said": _own(language)["page"]}


@cache
def _own(language: str) -> dict[str, dict[str, str]]:
    return tomllib.loads((Path(__file__).parent / f"{language}.toml").read_text(encoding="utf-8"))
