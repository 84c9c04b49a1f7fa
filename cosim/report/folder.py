"""A diagnosis folder: what a report needs is kept there, and read back.

`diagnosis.json` holds the answer, `comparison.parquet` the series (float32: seven digits, finer than any sensor here)
and, in its metadata, the noise bands and the free-form curves.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.remarks import shown
from cosim.diagnosis.answer.schema import Answer
from cosim.errors import DataError, UsageError
from cosim.files import whole
from cosim.lexicon import Lexicon, Shown, speaking
from cosim.report.material import KINDS, MEASURED, Curve, Experiment, Material, Noise, Part

Array = NDArray[np.float64]

ANSWER, SERIES, PREDICTED = "diagnosis.json", "comparison.parquet", "next_experiment.parquet"
HELD_OUT = "held_out.parquet"
REMEDY = "give a folder that 'cosim diagnose LOG --out FOLDER' has written"
_KEY = b"cosim.report"


def keep(material: Material, folder: Path) -> None:
    """Write `comparison.parquet`, and `next_experiment.parquet` if one is proposed, in the units people read.

    `diagnosis.json` is written by the command.

    Raises:
        UsageError: the folder cannot be written to.
    """
    import pyarrow as pa

    facts = {
        **_clock(material),
        "tracker": {k: v.tolist() for k, v in material.tracker.items()},
        "parts": [_plain(part) for part in material.parts.values()],
    }
    table = pa.table(_columns(material)).replace_schema_metadata({_KEY: json.dumps(facts).encode()})
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(table, folder / SERIES)
        if material.other is not None:
            series = pa.table(_columns(material.other))
            series = series.replace_schema_metadata({_KEY: json.dumps(_clock(material.other)).encode()})
            _write(series, folder / HELD_OUT)
        else:
            (folder / HELD_OUT).unlink(missing_ok=True)
        if material.experiment is not None:
            _write(_predicted(material.experiment), folder / PREDICTED)
        else:
            (folder / PREDICTED).unlink(missing_ok=True)  # of an earlier diagnosis
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None


def _write(table: Any, path: Path) -> None:
    import pyarrow.parquet as pq

    with whole(path) as part:
        pq.write_table(table, part, compression="zstd", write_page_checksum=True)


def _columns(material: Material) -> dict[str, Any]:
    """Time and one column for each series, in the units people read; series of a part of the log end in blanks."""
    columns: dict[str, Any] = {"time [s]": material.time}
    for kind, signals in material.series.items():
        for signal, values in signals.items():
            unit, scale = shown(signal)
            columns[f"{kind}/{signal} [{unit}]"] = (values * scale).astype(np.float32)
    return columns


def load(folder: Path) -> Material:
    """The material of a diagnosis folder.

    Raises:
        DataError: a file is missing or is not what `cosim diagnose` writes.
    """
    import pyarrow as pa

    for name in (ANSWER, SERIES):
        if not (folder / name).is_file():
            if name == SERIES and (folder / "report.html").is_file():
                raise DataError(
                    f"{folder} has no {name}: a diagnosis beside FMUs keeps no series, and its report.html is made with it; "
                    "diagnose again to make it anew"
                )
            raise DataError(f"{folder} has no {name}: {REMEDY}")
    answer = read_answer(folder)
    with speaking(lexicon_of(answer)):
        try:
            return _read(folder, answer)
        except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
            raise DataError(
                f"{folder / SERIES} does not hold the series of a diagnosis ({type(error).__name__}: {error}): {REMEDY}"
            ) from None


def read_answer(folder: Path) -> Answer:
    """The answer of a diagnosis folder.

    Raises:
        DataError: it is not what `cosim diagnose` writes.
    """
    try:
        return Answer.model_validate(_known(json.loads((folder / ANSWER).read_text(encoding="utf-8"))))
    except ValueError as error:
        first = str(error).splitlines()[0]
        raise DataError(f"{folder / ANSWER} is not a diagnosis of this version ({first}): {REMEDY}") from None


def lexicon_of(answer: Answer) -> Lexicon:
    """The units and words in which an answer was told."""
    words = answer.words
    signals = {n: Shown(s.unit, s.scale, s.text) for n, s in words.signals.items()}
    return Lexicon(signals, dict(words.units), dict(words.blocks))


def _read(folder: Path, answer: Answer) -> Material:
    import pyarrow.parquet as pq

    table = pq.read_table(folder / SERIES)
    facts = json.loads((table.schema.metadata or {})[_KEY])
    parts = {p["name"]: _part(p) for p in facts["parts"]}
    tracker = {k: np.array(v) for k, v in facts["tracker"].items()}
    series = _series(table)
    proposed = answer.next_experiment is not None and (folder / PREDICTED).is_file()
    experiment = _experiment(pq.read_table(folder / PREDICTED)) if proposed else None
    stamps = _stamps(table, facts)
    found = Material(
        answer,
        float(facts["h"]),
        series,
        parts,
        tracker,
        folder,
        experiment,
        stamps,
        cuts=_cuts(facts),
    )
    if (folder / HELD_OUT).is_file():
        table = pq.read_table(folder / HELD_OUT)
        facts = json.loads((table.schema.metadata or {})[_KEY])
        stamps = _stamps(table, facts)
        found.other = Material(
            answer, float(facts["h"]), _series(table), {}, stamps=stamps, cuts=_cuts(facts)
        )
    return found


def _clock(material: Material) -> dict[str, Any]:
    """How the samples of a material lie in time, as facts of its table."""
    return {"h": material.h, "even": material.stamps is None, "cuts": material.cuts}


def _cuts(facts: dict[str, Any]) -> tuple[int, ...]:
    """First samples of the further logs; of a folder that an older version wrote none are known."""
    return tuple(int(k) for k in facts.get("cuts", ()))


def _stamps(table: Any, facts: dict[str, Any]) -> Array | None:
    """Stamps of a log that is not evenly sampled."""
    return None if facts.get("even", True) else np.asarray(table["time [s]"].to_numpy(), dtype=np.float64)


def _predicted(experiment: Experiment) -> Any:
    """The experiment as a table: time, command, and a column ``model/signal [unit]`` for each prediction."""
    import pyarrow as pa

    unit, scale = shown(experiment.drive)
    columns: dict[str, Any] = {
        "time [s]": np.arange(experiment.command.size) * experiment.h,
        f"{experiment.drive} [{unit}]": scale * experiment.command,
        "evidence [1]": experiment.evidence,
    }
    for signal, rows in experiment.predicted.items():
        unit, scale = shown(signal)
        for model, values in zip(experiment.models, rows, strict=True):
            columns[f"{model}/{signal} [{unit}]"] = values * scale
    noise = {s: [n.bins, n.window, n.free, n.rms] for s, n in experiment.noise.items()}
    facts = {"models": experiment.models, "h": experiment.h, "noise": noise}
    return pa.table(columns).replace_schema_metadata({_KEY: json.dumps(facts).encode()})


def _experiment(table: Any) -> Experiment:
    facts = json.loads(table.schema.metadata[_KEY])
    predicted: dict[str, list[Array]] = {}
    for column in table.column_names[3:]:
        signal = column.partition("/")[2].partition(" [")[0]
        values = np.asarray(table[column].to_numpy(), dtype=np.float64) / shown(signal)[1]
        predicted.setdefault(signal, []).append(values)
    command = table.column_names[1]
    drive = command.partition(" [")[0]
    return Experiment(
        tuple(facts["models"]),
        float(facts["h"]),
        np.asarray(table[command].to_numpy(), dtype=np.float64) / shown(drive)[1],
        {s: np.stack(rows) for s, rows in predicted.items()},
        {s: Noise(*values) for s, values in facts["noise"].items()},
        np.asarray(table["evidence [1]"].to_numpy(), dtype=np.float64),
        drive,
    )


def _series(table: Any) -> dict[str, dict[str, Array]]:
    series: dict[str, dict[str, Array]] = {kind: {} for kind in KINDS}
    for column in table.column_names:
        # a unit may hold a slash as well
        kind, _, signal = column.partition(" [")[0].rpartition("/")
        if kind:
            values = np.asarray(table[column].to_numpy(), dtype=np.float64) / shown(signal)[1]
            series.setdefault(kind, {})[signal] = values
    if not series[MEASURED]:
        raise KeyError("no measured series")
    return series


def _plain(part: Part) -> dict[str, Any]:
    curves = [
        {
            s: [[c.label, c.gain, c.knots.tolist(), c.values.tolist()] for c in rows]
            for s, rows in side.items()
        }
        for side in (part.before, part.after)
    ]
    noise = {s: [n.bins, n.window, n.free, n.rms] for s, n in part.noise.items()}
    return {"name": part.name, "drive": part.drive, "noise": noise, "before": curves[0], "after": curves[1]}


def _part(plain: dict[str, Any]) -> Part:
    sides = [
        {
            s: [Curve(label, gain, np.array(knots), np.array(values)) for label, gain, knots, values in rows]
            for s, rows in plain[side].items()
        }
        for side in ("before", "after")
    ]
    noise = {s: Noise(*values) for s, values in plain["noise"].items()}
    return Part(plain["name"], plain["drive"], noise, *sides)


_NUMBERS = ("signals", "gain", "nominal", "linear", "linear_blocks")
_MAY_MISS = ("horizon", "per_log", "next_log_ci95")  # null says that there is none


def _known(data: Any) -> Any:
    """JSON has no NaN: a number that could not be computed was written as null inside these parts."""
    if not isinstance(data, dict):
        return data

    def numbers(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: v if k in _MAY_MISS else numbers(v) for k, v in value.items()}
        if isinstance(value, list):
            return [numbers(v) for v in value]
        return float("nan") if value is None else value

    found = data | {k: numbers(data[k]) for k in _NUMBERS if k in data}
    for cause in found.get("causes") or []:
        for part in ("evidence", "parameters"):
            if isinstance(cause, dict) and part in cause:
                cause[part] = numbers(cause[part])
    return found
