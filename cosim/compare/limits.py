"""Thresholds: the largest root mean square error that the user allows a signal."""

from typing import Any

from cosim.compare.comparator import Comparator
from cosim.compare.outcome import Comparison
from cosim.errors import UsageError
from cosim.ssp.hints import did_you_mean
from cosim.units import parse_quantity


def read_limits(texts: list[str], comparator: Comparator) -> dict[str, float]:
    """Texts such as ``slew=0.5deg`` as signal -> limit (SI).

    Raises:
        UsageError: a text cannot be read, or its signal is not compared.
    """
    limits = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not value:
            raise UsageError(f"--threshold '{text}' should read signal=value, such as slew=0.5deg")
        if name not in comparator.outputs:
            known = ", ".join(comparator.outputs)
            raise UsageError(
                f"--threshold: '{name}' is not compared{did_you_mean(name, comparator.outputs)}: compared are {known}"
            )
        try:
            limits[name] = parse_quantity(value, comparator.bindings[name].unit)
        except UsageError as error:
            raise UsageError(f"--threshold {name}: {error}") from None
        if not limits[name] >= 0.0:
            raise UsageError(f"--threshold {name}: {value} is negative")
    return limits


def check_limits(comparison: Comparison, limits: dict[str, float]) -> list[dict[str, Any]]:
    """Each limit, the error found (model driven by the command alone) and whether it is kept, in the unit people read.

    Raises:
        UsageError: the signal cannot be simulated from the command.
    """
    results = []
    for name, limit in limits.items():
        if name not in comparison.signals:
            raise UsageError(
                f"--threshold {name}: it cannot be simulated from the command: {'; '.join(comparison.notes)}"
            )
        unit, scale = comparison.shown(name)
        rmse = comparison.signals[name].score.rmse
        numbers = {"limit": limit * scale, "rmse": rmse * scale}
        results.append({"signal": name, "unit": unit, **numbers, "passed": rmse <= limit})
    return results
