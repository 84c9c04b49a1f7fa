"""Unknowns of a model that is a plain function values -> signals."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Unknown:
    """One number to be estimated.

    Attributes:
        name: key of the model's values.
        low, high: bounds.
        scale: typical change: searches move in its terms.
        prior: standard deviation of its prior around `centre`; infinite where nothing is known beforehand.
        centre: of the prior.
    """

    name: str
    low: float
    high: float
    scale: float
    prior: float = float("inf")
    centre: float = 0.0

    def within(self, value: float) -> float:
        """The nearest value that is allowed."""
        return min(max(value, self.low), self.high)
