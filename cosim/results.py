"""The result of a simulation: signals in SI (or the FMU's own unit), notes, error estimates; and files of it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.console import to_jsonable
from cosim.errors import MissingExtraError, UsageError
from cosim.files import keep_inputs, whole
from cosim.ssp.hints import did_you_mean

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from cosim.plots import Backend

Array = NDArray[np.float64]
SUFFIXES = (".csv", ".parquet", ".mat")


@dataclass(frozen=True)
class ErrorEstimate:
    """How far a signal is from the limit of small steps, by Richardson's extrapolation.

    Attributes:
        largest: largest estimated error over time, in the signal's unit.
        rms: its root mean square.
        order: observed order of convergence; NaN where the differences are at rounding level or do not fall.
    """

    largest: float
    rms: float
    order: float


@dataclass(frozen=True)
class DisplayUnit:
    """How a signal is shown: factor * value + offset, in `name`."""

    name: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Result:
    """A simulation's result; ``result["mechanical.theta"]`` is a signal, also by the name of a system output.

    Attributes:
        model: name of the system.
        time: communication points [s], shape (n + 1,).
        signals: ``component.variable`` or system input -> values at `time`, in the unit of `units`; shape (n + 1,).
        units: unit of each signal, empty if its FMU declares none.
        display: unit in which people read it, where one is declared.
        aliases: name of a system output -> signal.
        notes: what the user should know: delayed connections, inputs left alone.
        messages: what the FMUs logged at status Warning or worse.
        step_size: [s].
        parameters: values set for this run.
        errors: estimates by `cosim.master.Runner.coupling_error`, if made.
        label: where the numbers come from: always "simulated", never to be taken for a measurement.
        wall_time: duration of the loop [s].
        complete: False for what a simulation left that failed on its way.
    """

    model: str
    time: Array
    signals: dict[str, Array]
    units: dict[str, str]
    display: dict[str, DisplayUnit] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    step_size: float = 0.0
    parameters: Mapping[str, object] = field(default_factory=dict)
    errors: dict[str, ErrorEstimate] | None = None
    label: str = "simulated"
    wall_time: float = 0.0
    complete: bool = True

    def __getitem__(self, name: str) -> Array:
        """A signal by its name or that of a system output.

        Raises:
            UsageError: it was not recorded.
        """
        key = name if name in self.signals else self.aliases.get(name, name)
        if key not in self.signals:
            raise UsageError(f"'{name}' was not recorded{did_you_mean(name, [*self.signals, *self.aliases])}")
        return self.signals[key]

    def __contains__(self, name: object) -> bool:
        return name in self.signals or (name in self.aliases and self.aliases[str(name)] in self.signals)

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def columns(self, display: bool = False) -> dict[str, Array]:
        """Columns ``name [unit]``, time first.

        Args:
            display: in the units people read (deg, bar) instead of SI.
        """
        table = {"time [s]": self.time}
        for name, values in self.signals.items():
            shown = self.display.get(name) if display else None
            unit = shown.name if shown else self.units.get(name, "") or "1"
            table[f"{name} [{unit}]"] = values * shown.factor + shown.offset if shown else values
        return table

    def to_frame(self, display: bool = False) -> "pd.DataFrame":
        """The columns as a pandas table; its ``attrs`` carry model, label and notes."""
        import pandas as pd

        frame = pd.DataFrame(self.columns(display))
        frame.attrs.update(
            model=self.model,
            label=self.label,
            step_size=self.step_size,
            notes=list(self.notes),
            complete=self.complete,
        )
        return frame

    def to_dict(self) -> dict[str, Any]:
        """Model, times and the range of each signal as plain data: what ``--json`` of the command prints, less the files."""
        return dict(to_jsonable(self.about()))

    def about(self, si: bool = False) -> dict[str, Any]:
        """The same, not yet as JSON types.

        Args:
            si: ranges in SI instead of the units people read.
        """
        return {
            "model": self.model,
            "label": self.label,
            "start_time": self.time[0],
            "stop_time": self.time[-1],
            "step_size": self.step_size,
            "steps": len(self.time) - 1,
            "wall_time": self.wall_time,
            "parameters": self.parameters,
            "signals": {name: self._range(name, si) for name in self.signals},
            "notes": self.notes,
            "messages": self.messages,
        }

    def _range(self, name: str, si: bool) -> dict[str, Any]:
        """Unit, smallest, largest and final value of a signal, and the error of the step size where it was estimated."""
        shown = None if si else self.display.get(name)
        factor, offset = (shown.factor, shown.offset) if shown else (1.0, 0.0)
        unit = shown.name if shown else self.units.get(name, "") or "1"
        values = self.signals[name]
        low, high, last = (float(v) * factor + offset for v in (values.min(), values.max(), values[-1]))
        found: dict[str, Any] = {"unit": unit, "min": low, "max": high, "final": last}
        if self.errors is not None:
            error = self.errors[name]
            found |= {"error": error.largest * abs(factor), "order": error.order}
        return found

    def to_xarray(self) -> "xr.Dataset":
        """The signals over ``time``, in the units of `units`; needs the extra ``batch``.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        try:
            import xarray as xr
        except ImportError:
            raise MissingExtraError("an xarray dataset", "batch") from None
        found = {n: ("time", v, {"units": self.units.get(n, "")}) for n, v in self.signals.items()}
        about = {"model": self.model, "label": self.label, "step_size": self.step_size}
        return xr.Dataset(found, coords={"time": ("time", self.time, {"units": "s"})}, attrs=about)

    def plot(self, signals: Sequence[str] | None = None, backend: "Backend" = "auto") -> Any:
        """Signals over time in the units people read; a plotly or matplotlib figure.

        Args:
            signals: names; by default those that move.
            backend: "plotly", "matplotlib", or "auto" for plotly where it is installed.
        """
        from cosim.plots import draw

        names = list(signals) if signals is not None else [n for n, v in self.signals.items() if np.ptp(v)]
        panels = {}
        for name in names:
            shown = self.display.get(name)
            unit = shown.name if shown else self.units.get(name, "") or "1"
            values = self[name] * shown.factor + shown.offset if shown else self[name]
            panels[f"{name} [{unit}]"] = {self.label: values}
        return draw(self.time, panels, backend, f"{self.model}, simulated")

    def lines(self) -> list[str]:
        """The result in a few lines."""
        span = float(self.time[-1] - self.time[0])
        speed = f", {span / self.wall_time:.3g} times real time" if self.wall_time > 0.0 else ""
        return [f"{self.model}, simulated: {span:g} s in {len(self.time) - 1} steps{speed}", *self.notes]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        import html

        import pandas as pd

        said = "".join(f"<div>{html.escape(line)}</div>" for line in self.lines())
        table = pd.DataFrame.from_dict(self.about()["signals"], orient="index").rename_axis("signal")
        return said + str(table.to_html(border=0))

    def write(self, path: Path, display: bool = False) -> Path:
        """Write CSV, Parquet or MAT by the suffix; column headers are ``name [unit]``.

        Raises:
            UsageError: another suffix, or the file cannot be written.
        """
        check_suffix(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole(path) as part:
                {".csv": _write_csv, ".parquet": _write_parquet, ".mat": _write_mat}[path.suffix.lower()](
                    self, part, display
                )
        except OSError as error:
            raise UsageError(f"{path} cannot be written: {error.strerror or error}") from None
        return path


def check_suffix(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Refuse a file that cannot be written, before any work is done.

    Args:
        path: of the result.
        inputs: what is read, which no result may replace.

    Raises:
        UsageError: the suffix is not one of SUFFIXES, or the file is one of the inputs.
    """
    keep_inputs([path], inputs)
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{path}: results are written as {', '.join(SUFFIXES)}; '{path.suffix}' is none of them"
        )


def _write_csv(result: Result, path: Path, display: bool) -> None:
    """By pyarrow: shortest digits that read back exactly, ten times faster than pandas."""
    import csv

    import pyarrow as pa
    import pyarrow.csv

    columns = result.columns(display)
    with path.open("wb") as stream:
        import io

        head = io.StringIO()
        csv.writer(head, lineterminator="\n").writerow(columns)
        stream.write(head.getvalue().encode("utf-8"))
        options = pyarrow.csv.WriteOptions(include_header=False)
        pyarrow.csv.write_csv(pa.table(columns), stream, options)


def _write_parquet(result: Result, path: Path, display: bool) -> None:
    import json

    import pyarrow as pa
    import pyarrow.parquet

    about = {
        "model": result.model,
        "label": result.label,
        "step_size": result.step_size,
        "notes": result.notes,
        "complete": result.complete,
    }
    table = pa.table(result.columns(display)).replace_schema_metadata({"cosim": json.dumps(about)})
    pyarrow.parquet.write_table(table, path, write_page_checksum=True)


def _write_mat(result: Result, path: Path, display: bool) -> None:
    """A plain matrix ``data`` with ``names`` and ``units``, the form that logs of the rig have too."""
    from scipy.io import savemat

    columns = result.columns(display)
    heads = [head.removesuffix("]").rsplit(" [", 1) for head in columns]
    names, units = ([head[k] for head in heads] for k in (0, 1))
    content = {
        "data": np.column_stack(list(columns.values())),
        "names": np.array(names, dtype=object),
        "units": np.array(units, dtype=object),
        "label": result.label,
        "model": result.model,
        "complete": result.complete,
    }
    savemat(path, content)
