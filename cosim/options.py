"""Options that several commands share, and functions that share a run of them."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, ParamSpec, TypeVar, get_args, get_type_hints

import typer

P = ParamSpec("P")
R = TypeVar("R")

Language = Annotated[str, typer.Option("--language", help="Of the report: en, de.", metavar="LANGUAGE")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show the tables behind the answer as well.")]


def spelled_out(function: Callable[P, R]) -> Callable[P, R]:
    """A function whose ``**of: Unpack[Keys]`` are arguments by name for whoever looks at its signature, or misspells one.

    What is not given is None, or False where it is a switch.
    """
    own = inspect.signature(function)
    *listed, rest = own.parameters.values()
    (keys,) = get_args(rest.annotation)
    more = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=False if get_args(kind)[0] is bool else None,
            annotation=kind,
        )
        for name, kind in get_type_hints(keys, include_extras=True).items()
    ]
    whole = own.replace(parameters=[*listed, *more])

    @functools.wraps(function)
    def checked(*args: P.args, **given: P.kwargs) -> R:
        whole.bind(*args, **given)
        return function(*args, **given)

    checked.__signature__ = whole  # type: ignore[attr-defined]
    return checked
