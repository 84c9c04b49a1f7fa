"""What a check finds: each limit beside the error, the block that became worse, and the cause."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cosim.console import typed
from cosim.errors import CosimError


@dataclass(frozen=True)
class Held:
    """An error beside its limit, in the unit people read.

    Attributes:
        block: the block, driven by what was measured; None for the model driven by the command alone.
        signal: its name.
        unit: of the numbers.
        rmse: the error now; None where the signal is not compared any more.
        limit: the largest allowed.
        was: the error when the limit was set, or None.
    """

    block: str | None
    signal: str
    unit: str
    rmse: float | None
    limit: float
    was: float | None

    @property
    def kept(self) -> bool:
        """Whether the limit holds."""
        return self.rmse is not None and self.rmse <= self.limit

    @property
    def name(self) -> str:
        """``slew of mechanical + sensor``, or the signal alone."""
        return self.signal if self.block is None else f"{self.signal} of {self.block}"

    def line(self) -> str:
        """The numbers in words."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.rmse is None:
            return f"{self.name} is not compared any more (limit {self.limit:.4g}{unit})"
        before = "" if self.was is None else f", was {self.was:.4g}{unit}"
        return f"RMSE of {self.name} {self.rmse:.4g}{unit}, limit {self.limit:.4g}{unit}{before}"


@dataclass(frozen=True)
class Checked:
    """One reference log.

    Attributes:
        log: the file as named.
        model: name of the model; empty where it was not read.
        seconds: that it took.
        limits: signals first, then blocks.
        causes: what the diagnosis says, a line each; None where none was run.
        new: effects it names that it did not name when the limits were set; None where none was run.
        gone: effects it does not name any more.
        error: why there is no result, or None.
        notes: what the user should know.
    """

    log: str
    model: str = ""
    seconds: float = 0.0
    limits: list[Held] = field(default_factory=list)
    causes: list[str] | None = None
    new: list[str] | None = None
    gone: list[str] = field(default_factory=list)
    error: CosimError | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether all limits hold."""
        return self.error is None and all(item.kept for item in self.limits)

    @property
    def worse(self) -> Held | None:
        """The block whose error is furthest above its limit; None where none is."""
        broken = [item for item in self.limits if item.block is not None and not item.kept]
        return max(broken, key=_excess, default=None)

    def lines(self) -> Iterator[str]:
        """The answer for this log."""
        if self.error is not None:
            yield f"ERROR  {self.log}: {self.error}"
            return
        broken = [item for item in self.limits if not item.kept]
        number = f"{len(self.limits)} limit{'s' if len(self.limits) != 1 else ''}"
        yield f"{'MISSED' if broken else 'kept  '} {self.log}, model {self.model}: " + (
            f"{len(broken)} of {number} missed" if broken else f"{number} kept"
        )
        for item in broken:
            yield f"  {item.line()}"
        if self.worse is not None:
            yield f"  Worse: {self.worse.block}, driven by what was measured"
        elif broken:
            yield "  No block by itself is worse than allowed: small errors of several add up"
        for text in self.causes or []:
            yield f"  {text}"
        if self.new:
            yield f"  New since the limits were set: {', '.join(self.new)}"
        if self.gone:
            yield f"  Not named any more: {', '.join(self.gone)}"
        for text in self.notes:
            yield f"  note: {text}"


def _excess(item: Held) -> float:
    if item.rmse is None or item.limit == 0.0:
        return float("inf")
    return item.rmse / item.limit


@dataclass(frozen=True)
class GateResult:
    """All reference logs.

    Attributes:
        file: the file of limits.
        checked: a result for each log.
        written: name -> file.
        updated: the limits were measured anew and written.
    """

    file: Path
    checked: list[Checked]
    written: dict[str, Path] = field(default_factory=dict)
    updated: bool = False

    @property
    def passed(self) -> bool:
        """Whether every limit on every log holds."""
        return all(item.passed for item in self.checked)

    @property
    def exit_code(self) -> int:
        """0 all kept; 1 a limit missed; else that of the first log that could not be compared."""
        codes = [item.error.exit_code for item in self.checked if item.error is not None]
        return codes[0] if codes else 0 if self.passed else 1

    def lines(self) -> list[str]:
        """The answer in a few lines."""
        found = [text for item in self.checked for text in item.lines()]
        if self.updated:
            return [
                *found,
                f"Limits measured anew and written: {self.file}",
                f"Next: commit it with its logs; cosim check {typed(self.file)} then holds the model against them",
            ]
        bad = sum(not item.passed for item in self.checked)
        count = f"{len(self.checked)} reference log{'s' if len(self.checked) != 1 else ''}"
        last = f"Failed: {bad} of {count}" if bad else f"Passed: {count}"
        if bad and not any(item.error for item in self.checked):
            last += f". If the change is meant: cosim check {typed(self.file)} --update"
        return [*found, last]

    def to_dict(self) -> dict[str, Any]:
        """As plain data: what the command prints with ``--json``."""
        return {
            "file": self.file,
            "passed": self.passed,
            "updated": self.updated,
            "references": [
                {
                    "log": item.log,
                    "model": item.model,
                    "passed": item.passed,
                    "seconds": item.seconds,
                    "limits": [{**vars(held), "passed": held.kept} for held in item.limits],
                    "worse": None if item.worse is None else item.worse.block,
                    "causes": item.causes,
                    "new_causes": item.new,
                    "gone_causes": item.gone,
                    "error": None if item.error is None else str(item.error),
                    "notes": item.notes,
                }
                for item in self.checked
            ],
            "files": self.written,
        }
