"""numba's compiler with the type of the plain function kept."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """`function`, plain to Python and compiled by numba into its compiled callers: no entry from Python is made for it."""
    return register_jitable(no_cfunc_wrapper=True)(function)


def cached(function: F) -> F:
    """`function` compiled by numba and kept on disk; all it calls must be told to the cache by the caller."""
    return cast("F", numba.njit(function, cache=True))
