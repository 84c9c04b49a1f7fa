"""All figures and tables as one page, offline: text, tables, and plotly's pictures inside."""

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from cosim.errors import MissingExtraError, UsageError
from cosim.files import write_text
from cosim.packages import project_version
from cosim.report.picture import figure
from cosim.reproduce import chapter4, chapter5
from cosim.reproduce.campaign import Campaign
from cosim.reproduce.item import Item

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


def makers(of: Campaign) -> list[Callable[[], Item]]:
    """What makes each item, in the source's order."""
    return [*chapter4.makers(of), *chapter5.makers(of)]


def made(of: Campaign, said: Callable[[int, int], None] = lambda done, of_: None) -> Iterator[Item]:
    """The items one after the other; `said` is told how many of how many are done."""
    listed = makers(of)
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
