"""What the functions of the Python interface return: frozen objects that print their answer and give it as plain data.

Each has ``lines()`` (the answer in a few lines, also by ``print``), ``to_dict()`` (what ``--json`` of the command prints),
``to_frame()`` (pandas), ``plot()`` (plotly or matplotlib) and shows itself in a notebook.
"""

import html
import shutil
import tempfile
import weakref
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.console import to_jsonable

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from cosim.batch.conduct import Report
    from cosim.beside.run import Beside
    from cosim.calibrate.outcome import Calibration
    from cosim.compare.outcome import Comparison
    from cosim.diagnosis.answer.schema import Answer, NamedCause
    from cosim.identify.answer import Answer as Identification
    from cosim.identify.estimate import Quantity
    from cosim.plots import Backend


class Scratch:
    """A temporary folder that lives as long as this object.

    Attributes:
        path: the folder.
    """

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="cosim-"))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


class Outcome(ABC):
    """What all results share."""

    @abstractmethod
    def lines(self) -> list[str]:
        """The answer in a few lines."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The answer as plain data: what the command prints with ``--json``."""

    @abstractmethod
    def to_frame(self) -> "pd.DataFrame":
        """The numbers or series as a pandas table."""

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        said = "".join(f"<div>{html.escape(line)}</div>" for line in self.lines())
        return f"<div style='margin-bottom:0.5em'>{said}</div>{self.to_frame().head(20).to_html(border=0)}"


@dataclass(frozen=True)
class DiagnosisResult(Outcome):
    """A diagnosis.

    Attributes:
        answer: everything, in the form of docs/diagnosis.schema.json.
        folder: where `diagnosis.json`, `report.html` and the extended model lie.
        warnings: what the user should know.
        keep: a temporary folder that lives as long as this object, or None.
    """

    answer: "Answer"
    folder: Path
    warnings: tuple[str, ...] = ()
    keep: Scratch | None = field(default=None, repr=False, compare=False)

    @property
    def verdict(self) -> str:
        """adequate, explained, partly_explained, unexplained, implausible_data or interrupted."""
        return self.answer.verdict

    @property
    def causes(self) -> "list[NamedCause]":
        """The named causes, the largest gain first."""
        return self.answer.causes

    @property
    def report(self) -> Path | None:
        """The HTML report; None where the extra `report` is not installed, or for a system of any FMUs."""
        path = self.folder / "report.html"
        return path if path.is_file() else None

    @property
    def extended(self) -> Path | None:
        """The extended model, for `cosim.simulate`; None where no cause was named."""
        return Path(self.answer.extended.ssp) if self.answer.extended is not None else None

    def lines(self) -> list[str]:
        """See `Outcome.lines`."""
        from cosim.report.screen import lines

        return lines(self.answer, self.folder)

    def to_dict(self) -> dict[str, Any]:
        """See `Outcome.to_dict`; docs/diagnosis.schema.json describes it."""
        return dict(to_jsonable(self.answer.model_dump()))

    def to_frame(self) -> "pd.DataFrame":
        """Error of each signal on data not used for fitting, before and after, and its noise."""
        import pandas as pd

        rows = {s: g.model_dump() for s, g in self.answer.gain.items()}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("signal")

    def series(self) -> "pd.DataFrame":
        """Measured, nominal and extended series: columns ``kind/signal [unit]`` over ``time [s]``.

        Raises:
            DataError: the diagnosis has left none (a system of any FMUs).
        """
        import pandas as pd

        from cosim.errors import DataError

        path = self.folder / "comparison.parquet"
        if not path.is_file():
            raise DataError(f"{self.folder} has no comparison.parquet: this diagnosis keeps no series")
        return pd.read_parquet(path)

    def plot(self, backend: "Backend" = "auto") -> Any:
        """Every signal: measured, nominal and extended model; a plotly or matplotlib figure."""
        from cosim.plots import draw

        table = self.series()
        panels: dict[str, dict[str, Any]] = {}
        for column in table.columns:
            kind, _, signal = column.partition("/")
            if kind in ("measured", "nominal", "extended"):
                panels.setdefault(signal, {})[kind] = table[column].to_numpy()
        return draw(table["time [s]"].to_numpy(), panels, backend, self.lines()[0])


@dataclass(frozen=True)
class ComparisonResult(Outcome):
    """A model beside a log; after a calibration, with the parameters that were found.

    Attributes:
        beside: what was compared, found and written.
        warnings: what the user should know.
    """

    beside: "Beside" = field(repr=False)
    warnings: tuple[str, ...] = ()

    @property
    def comparison(self) -> "Comparison":
        """Signals, blocks and their errors, as arrays (SI) and scores."""
        return self.beside.comparison

    @property
    def calibration(self) -> "Calibration | None":
        """The fitted parameters with their intervals, after `cosim.calibrate`."""
        return self.beside.extras.calibration

    @property
    def passed(self) -> bool:
        """Whether every threshold was kept."""
        return all(limit["passed"] for limit in self.beside.limits)

    def lines(self) -> list[str]:
        """See `Outcome.lines`."""
        return self.beside.lines()

    def to_dict(self) -> dict[str, Any]:
        """See `Outcome.to_dict`."""
        return dict(to_jsonable(self.beside.as_data()))

    def to_frame(self) -> "pd.DataFrame":
        """A row for each signal: RMSE, fit, largest error, noise, in the unit people read."""
        import pandas as pd

        rows = self.beside.as_data()["signals"]
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("signal")

    def series(self) -> "pd.DataFrame":
        """Measured and simulated series over ``time [s]``."""
        import pandas as pd

        from cosim.compare.present import series

        return pd.DataFrame(series(self.comparison))

    def plot(self, backend: "Backend" = "auto") -> Any:
        """Every signal, measured and simulated; a plotly or matplotlib figure."""
        from cosim.plots import draw

        found = self.comparison
        panels = {}
        for name, item in found.signals.items():
            unit, scale = found.shown(name)
            panels[f"{name} [{unit}]"] = {
                "measured": item.measured * scale,
                "simulated": item.simulated * scale,
            }
        return draw(found.time, panels, backend, f"{found.model}, simulated")


@dataclass(frozen=True)
class IdentificationResult(Outcome):
    """Numbers taken from a log.

    Attributes:
        answer: tables, sentences and parameters.
        warnings: what the user should know.
    """

    answer: "Identification" = field(repr=False)
    warnings: tuple[str, ...] = ()

    @property
    def parameters(self) -> "dict[str, Quantity]":
        """``component.parameter`` -> value, unit and 95 % interval (SI)."""
        return self.answer.parameters

    def lines(self) -> list[str]:
        """See `Outcome.lines`."""
        return self.answer.summary()

    def to_dict(self) -> dict[str, Any]:
        """See `Outcome.to_dict`."""
        return dict(to_jsonable(self.answer.as_data({})))

    def to_frame(self) -> "pd.DataFrame":
        """A row for each parameter: value, 95 % interval, unit."""
        import pandas as pd

        rows = {name: quantity.as_data() for name, quantity in self.parameters.items()}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")

    def plot(self) -> Any:
        """The picture of the command (matplotlib); None where it has none."""
        return self.answer.draw() if self.answer.draw is not None else None


@dataclass(frozen=True)
class BatchResult(Outcome):
    """Many runs.

    Attributes:
        report: table of runs, summary.
        warnings: what the user should know.
    """

    report: "Report" = field(repr=False)
    warnings: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """See `Outcome.lines`."""
        from cosim.batch.screen import lines

        return lines(self.report)

    def to_dict(self) -> dict[str, Any]:
        """See `Outcome.to_dict`."""
        return dict(to_jsonable(self.report.about))

    def to_frame(self) -> "pd.DataFrame":
        """A row for each run: parameters, scores, status."""
        return self.report.frame

    def to_xarray(self) -> "xr.Dataset":
        """The kept signals of all runs, over run and time.

        Raises:
            DataError: the batch keeps no signals (diagnoses, or engines that keep scores alone).
        """
        import xarray as xr

        from cosim.errors import DataError

        path = self.report.about["files"].get("signals")
        if path is None:
            raise DataError("this batch keeps no signals")
        return xr.open_zarr(path)
