"""Packages that can be called: ``cosim.compare(...)`` is the function of `cosim.api`, ``cosim.compare.Comparator`` a class.

Four functions of the Python interface have the name of the package that does the work.
"""

import inspect
import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    def __call__(self, *args: Any, **options: Any) -> Any:
        return _function(self)(*args, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(_function(self))


def _function(package: ModuleType) -> Any:
    from cosim import api

    return getattr(api, package.__name__.rpartition(".")[2])


def make_callable(name: str) -> None:
    """Let a package that is being imported be called as the function of `cosim.api` with its name."""
    sys.modules[name].__class__ = _Callable
