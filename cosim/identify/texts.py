"""What a user writes on the command line, as numbers, structures and logs."""

import math
from pathlib import Path

from cosim.errors import UsageError
from cosim.identify.transfer_function import Structure
from cosim.logs import Log, load_log
from cosim.request import seconds
from cosim.units import parse_quantity


def load(file: Path, mapping: Path | None, start: str | None = None, stop: str | None = None) -> Log:
    """A log, or the part of it between two times such as ``10 s``.

    Raises:
        DataError: it cannot be used.
        UsageError: a time cannot be read, or the part holds nothing.
    """
    log = load_log(file, mapping)
    if start is None and stop is None:
        return log
    return log.slice(
        None if start is None else seconds(start, "--from"), None if stop is None else seconds(stop, "--to")
    )


def quantity(text: str | None, unit: str, option: str) -> float | None:
    """A number with a unit, in `unit`; None for None.

    Raises:
        UsageError: it is none; the message names the option.
    """
    if text is None:
        return None
    try:
        return parse_quantity(text, unit)
    except UsageError as error:
        raise UsageError(f"{option}: {error}") from None


def angular(text: str, option: str) -> float:
    """A frequency [rad/s] from a text in rad/s or Hz; a bare number is in rad/s.

    Raises:
        UsageError: it is neither; the message names the option.
    """
    in_hertz = text.strip().lower().endswith("hz")
    found = quantity(text, "Hz" if in_hertz else "rad/s", option)
    assert found is not None
    return 2.0 * math.pi * found if in_hertz else found


def structure(order: str, integrators: int, delay: bool) -> Structure:
    """Poles and zeros from ``3/1``.

    Raises:
        UsageError: it cannot be read, or makes no transfer function.
    """
    poles, _, zeros = order.partition("/")
    if not poles.strip().isdigit() or not (zeros.strip() or "0").isdigit():
        raise UsageError(f"--order '{order}' should read poles/zeros, such as 3/1")
    return Structure(int(poles), int(zeros or 0), integrators, delay)
