"""A short synthetic log as a file in each format that can be loaded, made at run time for the trials of damage."""

import gzip
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.logs import load_log, write_log

ROWS = 900
STEP = 0.001  # s
NOISE = {"u": 0.0, "spool": 0.005, "p_a": 0.1, "p_b": 0.1, "slew": 0.01}
SMALL = {**{name: 3 * noise for name, noise in NOISE.items()}, "u": 0.003, "time": 0.1 * STEP}
UNITS = {"time": "s", "u": "1", "spool": "mm", "p_a": "bar", "p_b": "bar", "slew": "deg"}

Array = NDArray[np.float64]


def columns() -> dict[str, Array]:
    """A short log in log units: a command in steps, and smooth motion with the rig's noise."""
    random = np.random.default_rng(11)
    time = np.arange(ROWS) * STEP
    u = 0.6 * np.sign(np.sin(9 * time))
    values = {
        "time": time,
        "u": u,
        "spool": 1.8 * np.sin(9 * time - 0.5),
        "p_a": 85 + 20 * np.sin(9 * time - 0.9),
        "p_b": 85 - 20 * np.sin(9 * time - 0.9),
        "slew": 12 + 8 * np.cos(9 * time - 1.2),
    }
    return {
        name: np.round(x + NOISE.get(name, 0.0) * random.standard_normal(ROWS), 6)
        for name, x in values.items()
    }


# One file in each format

Writer = Callable[[Path], Path]


def _headed() -> dict[str, Array]:
    return {f"{name} [{UNITS[name]}]": values for name, values in columns().items()}


def _text(path: Path, separator: str = ",", decimal: str = ".") -> Path:
    """With a remark that no reader looks at."""
    found = _headed()
    lines = [separator.join([*found, "remark"])]
    for k in range(ROWS):
        cells = [f"{values[k]:.9g}".replace(".", decimal) for values in found.values()]
        lines.append(separator.join([*cells, '"by hand"' if k % 90 == 7 else ""]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _packed(path: Path) -> Path:
    text = _text(path.with_name("packed.csv")).read_bytes()
    path.write_bytes(gzip.compress(text, mtime=0))
    return path


def _book(path: Path) -> Path:
    from openpyxl import Workbook

    book, found = Workbook(), _headed()
    book.active.append(list(found))
    for row in zip(*(values.tolist() for values in found.values()), strict=True):
        book.active.append(row)
    book.save(path)
    return path


def _controldesk(path: Path) -> Path:
    found = columns()
    names = list(found)[1:]
    head = [
        "descriptions,General,User,x",
        f"trace_size,{ROWS}",
        ",".join(["trace_names", "", *("In1" for _ in names)]),
        ",".join(["trace_units", "", *("" for _ in names)]),
        ",".join(["path", "", *(f"Root/{name}" for name in names)]),
    ]
    rows = [",".join(f"{values[k]:.9g}" for values in found.values()) for k in range(ROWS)]
    path.write_text("\n".join(head) + "\ntrace_values," + "\n,".join(rows) + "\n\n", encoding="utf-8")
    signals = "".join(f"[signals.{n}]\ncolumn = '{n}'\nunit = '{UNITS[n]}'\n" for n in names)
    path.with_suffix(".toml").write_text(f"[time]\ncolumn = 'time'\n{signals}")
    return path


def _ours(path: Path) -> Path:
    return write_log(load_log(_text(path.with_name("plain.csv"))), path)


def _parquet(path: Path) -> Path:
    """As another program writes it: without checksums."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(_headed()), path)
    return path


def _mat(version: str) -> Writer:
    def write(path: Path) -> Path:
        from scipy.io import savemat

        found = columns()
        data = np.column_stack(list(found.values()))
        if version == "4":
            savemat(path, {"data": data, "names": np.array(list(_headed()))}, format="4")
            return path
        content: dict[str, Any] = {**found, "units": UNITS}
        if version == "5":
            savemat(path, content, oned_as="column")
            return path
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # mat-io sets a pandas option that pandas 3 deprecates
            import matio

            matio.save_to_mat(str(path), content, version=version)
        return path

    return write


def _mdf(path: Path, compression: int = 0) -> Path:
    from asammdf import MDF, Signal

    found = columns()
    with MDF(version="4.10") as file:
        file.append(
            [
                Signal(samples=values, timestamps=found["time"], name=name, unit=UNITS[name])
                for name, values in found.items()
                if name != "time"
            ]
        )
        file.save(path, overwrite=True, compression=compression)  # type: ignore[arg-type]
    return path


def _tdms(path: Path) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("rig", name, values, properties={"unit_string": UNITS[name]})
                for name, values in columns().items()
            ]
        )
    return path


READERS: dict[str, tuple[str, Writer]] = {
    "csv": (".csv", _text),
    "csv_comma": (".csv", lambda path: _text(path, ";", ",")),
    "controldesk": (".csv", _controldesk),
    "parquet_ours": (".parquet", _ours),
    "parquet": (".parquet", _parquet),
    "mat_ours": (".mat", _ours),
    "mat_v4": (".mat", _mat("4")),
    "mat_v5": (".mat", _mat("5")),
    "mat_v7.3": (".mat", _mat("v7.3")),
    "mf4": (".mf4", _mdf),
    "mf4_zip": (".mf4", lambda path: _mdf(path, 2)),
    "tdms": (".tdms", _tdms),
    "xlsx": (".xlsx", _book),
    "zipped_csv": (".csv.gz", _packed),
}
