"""The Python modules that FMUs of pythonfmu bring into this process, and what they leave on its search path.

Python shares modules by name, so two of one name and different code cannot run in one process. pythonfmu keeps a reference
to every class that it ever found: a module whose FMU is gone stays, about a quarter of a MiB, and each diagnosis brings
modules of its own. Some that are not in use wait to be used again; the code of those before them is given up.
"""

import ctypes
import gc
import hashlib
import importlib.util
import sys
from collections import Counter
from pathlib import Path
from types import ModuleType

from cosim.errors import ModelError
from cosim.ssp.system import Fmu

MOST_IDLE = 32

# which content each pythonfmu module of this process has
_modules: dict[str, str] = {}

# how many open instances each FMU's folder has, and each module of ours
_folders: Counter[Path] = Counter()
_instances: Counter[str] = Counter()

# modules of ours without an instance, the longest unused first
_idle: dict[str, None] = {}


def claim(fmu: Fmu) -> None:
    """Refuse a pythonfmu FMU whose module name another module of this process already has.

    Raises:
        ModelError: so it is.
    """
    if fmu.module is None:
        return
    name, digest = fmu.module
    if _modules.get(name, digest) != digest:
        raise ModelError(
            f"{fmu.source}: another FMU of this process brought a Python module '{name}' with other code, which would run "
            "in its place: give the scripts different names, or simulate in a process of its own"
        )
    if name not in _modules:
        origin = _origin(name)
        if origin is not None and hashlib.sha256(origin.read_bytes()).hexdigest() != digest:
            raise ModelError(
                f"{fmu.source}: the module {origin} of this Python would run in place of the FMU's own '{name}': "
                "start from another folder, or clear PYTHONPATH"
            )
    _modules[name] = digest


def keep(fmu: Fmu) -> None:
    """Make up for pythonfmu 0.7.0, which drops one reference too many to a module's globals at each instantiation.

    Without this the process crashes at its end, or when old classes are collected (seen with valid FMUs of others).
    """
    module = sys.modules.get(fmu.module[0]) if fmu.module is not None else None
    if module is not None:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(module.__dict__))


def entered(fmu: Fmu) -> None:
    """An instance of the FMU is made."""
    _folders[fmu.folder] += 1
    if fmu.module is not None and fmu.ours:
        _instances[fmu.module[0]] += 1
        _idle.pop(fmu.module[0], None)


def left(fmu: Fmu) -> None:
    """An instance is gone. With the last one its folder leaves the search path; pythonfmu 0.7.0 adds it for each."""
    _folders[fmu.folder] -= 1
    if _folders[fmu.folder] <= 0:
        del _folders[fmu.folder]
        added = str(fmu.folder / "resources")
        sys.path[:] = [entry for entry in sys.path if entry != added]
        sys.path_importer_cache.pop(added, None)
    if fmu.module is None or not fmu.ours:
        return
    name = fmu.module[0]
    _instances[name] -= 1
    if _instances[name] <= 0:
        del _instances[name]
        _idle[name] = None


def give_up() -> None:
    """Where too many modules of ours wait, give up the code of those that wait longest, down to half as many.

    One of which an instance is left waits anew: another client of this process may hold it, or nobody has collected it yet.
    To look for instances takes a look at all objects of the process: once for all these modules.
    """
    if len(_idle) <= MOST_IDLE:
        return
    loaded = {name: sys.modules.get(name) for name in list(_idle)[: len(_idle) - MOST_IDLE // 2]}
    made = {name: _classes(module) for name, module in loaded.items() if module is not None}
    every = tuple(cls for classes in made.values() for cls in classes)
    instances = [o for o in gc.get_referrers(*every) if isinstance(o, every)]
    for name, module in loaded.items():
        del _idle[name]
        if module is not None:
            if any(isinstance(o, made[name]) for o in instances):
                _idle[name] = None
                continue
            _empty(module, made[name])
        sys.modules.pop(name, None)
        _modules.pop(name, None)


def _own(module: ModuleType) -> dict[str, object]:
    """What a module made or took by name; the modules that it imports stay, for what it does at exit."""
    return {n: v for n, v in vars(module).items() if not (n.startswith("__") or isinstance(v, ModuleType))}


def _classes(module: ModuleType) -> tuple[type, ...]:
    """The classes that a module made."""
    return tuple(v for v in _own(module).values() if isinstance(v, type) and v.__module__ == module.__name__)


def _empty(module: ModuleType, classes: tuple[type, ...]) -> None:
    """Give up all that a module made."""
    for made in classes:
        for name in vars(made).keys() - {"__dict__", "__weakref__", "__module__", "__doc__"}:
            delattr(made, name)
    for name in _own(module):
        delattr(module, name)


def search_path() -> list[str]:
    """Python's search path without what FMUs of this process added to it."""
    added = {str(folder / "resources") for folder in _folders}
    return [entry for entry in sys.path if entry not in added]


def _origin(name: str) -> Path | None:
    """File that ``import name`` would load or has loaded in this process, or None."""
    try:
        loaded = sys.modules.get(name)
        spec = loaded.__spec__ if loaded is not None else importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None
    origin = Path(spec.origin) if spec is not None and spec.origin else None
    return origin if origin is not None and origin.is_file() else None
