"""numba's compiler with the type of the plain function kept."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """`function` compiled by numba in each process anew, or into its compiled callers."""
    return cast("F", numba.njit(function))


def cached(function: F) -> F:
    """`function` compiled by numba and kept on disk; all it calls must be told to the cache by the caller."""
    return cast("F", numba.njit(function, cache=True))
