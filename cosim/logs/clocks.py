"""What tells time: the names of a clock, the unit in which one without a unit counts, columns with clocks of their own."""

import re
import unicodedata
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.logs.source import Label
from cosim.signals import conversion

Array = NDArray[np.float64]

TIME_WORDS = re.compile(
    r"\b(time|timestamps?|t|tout|zeit\w*|uhrzeit|temps|tiempo|tempo|tijd|tid|aika|czas|vremya|время|时间|時間|sec|seconds|sekunden)\b"
)
RATES = (5.0, 2e4)  # 1/s, of a machine's log: decides in which unit an unlabelled clock counts
ROUNDED = 1e-4  # of a step: so far from a whole number rounding may leave one that was scaled
# a unit at the end of a name is one word: the A of mA and the Pa of kPa are no port's
_UNIT = re.compile(r"(?<![^\W_])([kmhM])(Pa|N|Nm|V|A|W|Hz|g)(?![^\W_])")
SLOW = 300.0  # times as long as the longest of these intervals may be one of a clock that counts parts of seconds


def plain(name: str) -> str:
    """A name as words: small letters without accents, a blank where case, digits or signs part it."""
    whole = _UNIT.sub(lambda found: found[0].lower(), name)
    text = re.sub(r"(?<=[a-zäöüß])(?=[A-Z])|(?<=\D)(?=\d)|(?<=\d)(?=\D)", " ", whole)
    text = unicodedata.normalize("NFKD", text.lower().replace("ß", "ss"))
    text = "".join(sign for sign in text if not unicodedata.combining(sign))
    return " ".join(re.findall(r"\w+", text.replace("_", " ")))


def is_time(unit: str) -> bool:
    """Whether a unit is one of time."""
    try:
        conversion(unit, "s")
    except UsageError:
        return False
    return True


def seconds_per(unit: str) -> float:
    """How many seconds a unit of time is; 1 for no unit and for one that is none of time."""
    return conversion(unit, "s") if unit and is_time(unit) else 1.0


def counted(stamps: Array) -> str:
    """The unit in which a clock without a unit counts: the one that gives as many samples a second as machines log."""
    step = float(np.median(np.diff(stamps)))
    # counters of ms and less hold whole numbers: a step of 0.65 is that of a slow log, not of 1500 samples a second
    whole = np.abs(stamps - np.round(stamps)) < ROUNDED * step  # 1000 * 0.003 is not quite 3
    broken = step < 1.0 / RATES[0] * SLOW and not bool(np.all(whole))
    for unit in ("s", "ms", "us", "ns"):
        rate = 1.0 / (step * conversion(unit, "s"))
        if RATES[0] <= rate <= RATES[1] or (broken and unit == "s" and step * RATES[0] > 1.0):
            return unit
    return "s"


def own_clocks(columns: Sequence[tuple[Label, Any] | None]) -> dict[int, Array]:
    """Index -> time stamps [s], where columns of different lengths each have a time of their own length beside them.

    Two loggers whose vectors lie in one file (``t_a``, ``force``; ``t_b``, ``speed``): a time goes with what has as many
    values. Nothing where one time is all there is, or where a length has two.

    Args:
        columns: label and values of each; None for one that has a clock already.
    """
    lengths = {len(column[1]) for column in columns if column is not None}
    if len(lengths) < 2:
        return {}
    times: dict[int, list[Array]] = {}
    for column in columns:
        if column is None:
            continue
        label, values = column[0], np.asarray(column[1], dtype=np.float64)
        rising = values.size > 1 and bool(np.all(np.diff(values) > 0.0))
        if rising and TIME_WORDS.search(plain(label.short)):
            unit = label.unit if label.unit and is_time(label.unit) else counted(values)
            times.setdefault(values.size, []).append(values * conversion(unit, "s"))
    if len(times) < 2 or any(len(found) > 1 for found in times.values()):
        return {}
    return {
        k: times[len(column[1])][0]
        for k, column in enumerate(columns)
        if column is not None and len(column[1]) in times
    }
