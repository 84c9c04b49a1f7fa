"""All figures and tables as one page, offline: text, tables, and plotly's pictures inside."""

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cosim.errors import MissingExtraError, UsageError
from cosim.files import write_text
from cosim.packages import project_version
from cosim.report.picture import figure
from cosim.reproduce import chapter4, chapter5
from cosim.reproduce.campaign import Campaign
from cosim.reproduce.item import Item

ASKED = re.compile(r"(fig|table)?[a-z]*\.?\s*\(?(\d)\.(\d+)([a-z]?)\)?")
NUMBER = re.compile(r"(\d)\.(\d+)([a-z]?)")
NUMBERS = re.compile(r"(\d\.\d+[a-z]?)\)?(?:-\(?(\d\.\d+[a-z]?))?")  # the ends of a range, or one
PAGE, DATA = "reproduce.html", "reproduce.json"
# of chapters 4 and 5, and why they are not here
NOT_HERE = (
    "photographs, drawings and screens of chapters 3 and 4: they show the laboratory",
    "Table 4.2's transfer functions TF2 and TF3, whose numbers the source does not print",
    "every measured curve itself: the source's logs are not published, so ours come from the virtual rig",
)


def need_extra() -> None:
    """Check that plotly and jinja2 are there.

    Raises:
        MissingExtraError: one is not.
    """
    try:
        import jinja2  # noqa: F401
        import plotly  # noqa: F401
    except ImportError:
        raise MissingExtraError("the page of figures", "report") from None


def makers(of: Campaign, only: Sequence[str] = ()) -> list[Callable[[], Item]]:
    """What makes each item, in the source's order.

    Args:
        of: the logs.
        only: such as "fig. 4.4", "table 4.3" or "5.14": those of these numbers alone.

    Raises:
        UsageError: one of them is none that can be made.
    """
    every = chapter4.makers(of) | chapter5.makers(of)
    wanted = {source for text in only for source in chosen(text, list(every))}
    return [make for source, make in every.items() if source in wanted or not only]


def chosen(text: str, sources: Sequence[str]) -> list[str]:
    """The sources that a number such as "fig. 4.4" or "5.14" names.

    Raises:
        UsageError: none of them.
    """
    asked = ASKED.fullmatch(text.strip().lower())
    found = []
    if asked is not None:
        kind, chapter, number, part = asked.groups()
        for source in sources:
            if kind and not source.lower().startswith(kind[:3]):
                continue
            found += [source] if _holds(source, int(chapter), int(number), part) else []
    if not found:
        raise UsageError(f"--only '{text}': there are {'; '.join(sources)}")
    return found


def _holds(source: str, chapter: int, number: int, part: str) -> bool:
    """Whether "Figs 5.7-5.10, 5.12" holds 5.9; without its letter "4.12b" is 4.12."""
    for first, last in NUMBERS.findall(source):
        ends = [NUMBER.match(end) for end in (first, last or first)]
        (c, low, letter), (_, high, _) = (end.groups() for end in ends if end is not None)
        if int(c) == chapter and int(low) <= number <= int(high) and part in ("", letter):
            return True
    return False


def made(
    of: Campaign, only: Sequence[str] = (), said: Callable[[int, int], None] = lambda done, of_: None
) -> Iterator[Item]:
    """The items one after the other, `only` as `makers` has it; `said` is told how many of how many are done."""
    listed = makers(of, only)
    for done, make in enumerate(listed, 1):
        yield make()
        said(done, len(listed))


def as_data(of: Campaign, items: list[Item]) -> dict[str, Any]:
    """The page as plain data, without curves."""
    return {
        "synthetic": True,
        "hidden": list(of.hidden),
        "seed": of.seed,
        "full_grids": of.full,
        "version": project_version(),
        "items": [item.plain() for item in items],
        "not_reproduced": list(NOT_HERE),
    }


def write(of: Campaign, items: list[Item], folder: Path) -> dict[str, Path]:
    """Write page and JSON into a folder; returns name -> file.

    Raises:
        MissingExtraError: plotly or jinja2 is missing.
        UsageError: the folder cannot be written to.
    """
    need_extra()
    data = as_data(of, items)
    files = {"html": folder / PAGE, "json": folder / DATA}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(files["json"], json.dumps(data, indent=1) + "\n")
        write_text(files["html"], page(data, items))
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return files


def page(data: dict[str, Any], items: list[Item]) -> str:
    """The page as text."""
    import jinja2
    from plotly.offline import get_plotlyjs

    figures = json.dumps({p.key: figure(p) for item in items for p in item.pictures}, separators=(",", ":"))
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cosim.reproduce", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    environment.filters["percent"] = percent
    digest = hashlib.sha256(figures.encode()).hexdigest()
    # inside a script element only "<" can do harm
    return environment.get_template("page.html.j2").render(
        data=data, items=items, plotly=get_plotlyjs(), figures=figures.replace("<", "\\u003c"), digest=digest
    )


def number(value: float | None) -> str:
    """Four digits; a dash for none."""
    if value is None:
        return "–"
    return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.3e}"


def percent(value: float | None) -> str:
    """With its sign to a tenth, without one where that is nothing; empty for none."""
    if value is None:
        return ""
    return f"{value:+.1f} %" if round(value, 1) else "0.0 %"
