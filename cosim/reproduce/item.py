"""One figure or table of the source, as we make it, and how the two compare."""

from dataclasses import dataclass, field
from typing import Any

from cosim.report.picture import Picture


@dataclass(frozen=True)
class Row:
    """One quantity of both.

    Attributes:
        name: what it is.
        source: what the source prints, in `unit`; None where it prints no number.
        ours: what we find, in `unit`.
        unit: of both.
        spread: half of the 95 % interval of ours, or None where it is exact or has none.
    """

    name: str
    source: float | None
    ours: float
    unit: str = ""
    spread: float | None = None

    @property
    def difference(self) -> float | None:
        """Ours less the source's, in per cent of the source's; None where there is nothing to compare."""
        return None if not self.source else 100.0 * (self.ours / self.source - 1.0)


@dataclass(frozen=True)
class Item:
    """A figure or table.

    Attributes:
        key: of its place on the page.
        source: number in the source, such as "Table 4.3" or "Fig. 5.6".
        title: what it shows.
        how: what ours is made from.
        verdict: how ours compares with the source's, one or two sentences.
        rows: the numbers side by side.
        pictures: of ours.
        synthetic: it is made from logs of the virtual rig; otherwise from the models alone.
    """

    key: str
    source: str
    title: str
    how: str
    verdict: str
    rows: list[Row] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    synthetic: bool = True

    def plain(self) -> dict[str, Any]:
        """As plain data, without the pictures' points."""
        return {
            "source": self.source,
            "title": self.title,
            "how": self.how,
            "verdict": self.verdict,
            "synthetic": self.synthetic,
            "numbers": [
                {
                    "name": r.name,
                    "source": r.source,
                    "ours": r.ours,
                    "unit": r.unit,
                    "half_ci95": r.spread,
                    "difference_percent": r.difference,
                }
                for r in self.rows
            ],
        }
