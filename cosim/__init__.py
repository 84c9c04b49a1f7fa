"""Co-simulation of hydraulic drives, compared with measured data: the Python interface.

    import cosim

    log = cosim.read_log("run.csv")
    found = cosim.diagnose(log)
    print(found)            # what is wrong, how sure, how much better
    found.causes, found.to_dict(), found.to_frame(), found.plot()

docs/python.md is the tutorial. Nothing heavy is imported before it is used.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim.api import (
        batch,
        calibrate,
        compare,
        diagnose,
        identify,
        make_log,
        read_log,
        read_system,
        simulate,
    )

__all__ = [
    "batch",
    "calibrate",
    "compare",
    "diagnose",
    "identify",
    "make_log",
    "read_log",
    "read_system",
    "simulate",
]
_PACKAGES = ("batch", "calibrate", "compare", "identify")  # that are called: cosim/calls.py


def __getattr__(name: str) -> Any:
    """The functions of `cosim.api`, when they are first asked for, and the version."""
    if name == "__version__":
        return importlib.import_module("cosim.packages").project_version()
    if name in _PACKAGES:
        return importlib.import_module(f"cosim.{name}")
    if name in __all__:
        return getattr(importlib.import_module("cosim.api"), name)
    raise AttributeError(f"module 'cosim' has no attribute '{name}'")


def __dir__() -> list[str]:
    """What is there, the functions not yet imported among it."""
    return sorted({*globals(), *__all__})
