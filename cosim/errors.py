"""Errors a user can meet, each with the exit code of the command line.

A message names the thing that is wrong and, where there is one, the remedy. Everything raised on purpose
derives from `CosimError`; anything else that escapes is a defect of ours.
"""

from typing import Any


class CosimError(Exception):
    """Base of all errors raised on purpose."""

    exit_code = 4


class UsageError(CosimError):
    """The request itself makes no sense: an unknown option value, name or unit (exit code 2)."""

    exit_code = 2


class DataError(CosimError):
    """A log or mapping file is bad; the message names file, row and column where they are known (exit code 3)."""

    exit_code = 3


class ColumnsError(DataError):
    """The columns of a log cannot be told apart by their headings alone: a mapping is needed (exit code 3)."""


class HeadlessError(ColumnsError):
    """A text file begins with numbers: its columns have no headings, and go by their place in a mapping (exit code 3)."""


class ModelError(CosimError):
    """An FMU, SSP or parameter file is bad (exit code 3)."""

    exit_code = 3


class SimulationError(CosimError):
    """A simulation failed while it ran (exit code 4).

    Attributes:
        partial: the `Result` up to there, or None if there is none.
    """

    exit_code = 4
    partial: Any = None


class OutOfTimeError(CosimError):
    """The time allowed was over while something ran; what was found before stands (exit code 4)."""

    exit_code = 4


class MissingExtraError(CosimError):
    """An optional dependency is missing; the message names the extra to install (exit code 5)."""

    exit_code = 5

    def __init__(self, what: str, extra: str, otherwise: str = "") -> None:
        super().__init__(
            f"{what} needs the optional dependencies '{extra}': pip install 'slew-cosim[{extra}]'{otherwise}"
        )
