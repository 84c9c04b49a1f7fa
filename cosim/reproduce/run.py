"""A reproduction of the source's figures and tables as it is asked for."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim import console
from cosim.api.building import build_missing
from cosim.errors import UsageError
from cosim.paths import build_folder
from cosim.reproduce.campaign import HIDDEN, Campaign
from cosim.reproduce.item import Item
from cosim.reproduce.page import as_data, made, makers, need_extra, write
from cosim.rig import Hidden


@dataclass(frozen=True)
class Reproduced:
    """What was made.

    Attributes:
        items: figures and tables.
        data: the page as plain data, without curves.
        files: page and JSON.
    """

    items: list[Item]
    data: dict[str, Any]
    files: dict[str, Path]


def reproduced(
    out: Path | None = None,
    hide: Sequence[str] | None = None,
    only: Sequence[str] = (),
    seed: int = 1,
    full: bool = False,
) -> Reproduced:
    """Make figures and tables from synthetic logs.

    Args:
        out: folder; by default reproduce/ in the build folder.
        hide: effects that the rig carries; by default the source's own findings; ``["none"]``: the nominal crane.
        only: figures or tables by their numbers in the source; by default all.
        seed: of the rig's noise.
        full: the source's whole grids of frequencies.

    Raises:
        MissingExtraError: plotly or jinja2 is missing.
        UsageError: there is no such effect or item, or the folder cannot be written to.
    """
    need_extra()
    if hide and "none" in hide and len(hide) > 1:
        raise UsageError("--hide none stands alone: with it the rig carries nothing")
    hidden = HIDDEN if not hide else () if list(hide) == ["none"] else tuple(hide)
    for text in hidden:
        Hidden.parse(text)  # a misspelt name is said before the work begins
    campaign = Campaign(hidden, seed, full)
    count = len(makers(campaign, only))
    build_missing(build_folder())
    with console.progress("figures and tables", count) as advance:
        items = list(made(campaign, only, lambda done, _: advance(done)))
    files = write(campaign, items, out or build_folder() / "reproduce")
    return Reproduced(items, as_data(campaign, items), files)
