"""Where the project's own files lie, in a checkout and in an installed package alike."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from platformdirs import user_cache_path

from cosim.errors import ModelError

_CALLED: ContextVar[Mapping[Path, str] | None] = ContextVar("called", default=None)
_PACKAGE = Path(__file__).resolve().parent


def checkout() -> Path | None:
    """Top folder of the git checkout or source tree this package runs from, or None when it is installed."""
    top = _PACKAGE.parent
    return top if (top / "pyproject.toml").is_file() and (top / "ssp").is_dir() else None


def _data_folder(name: str) -> Path:
    top = checkout()
    folder = _PACKAGE / f"_{name}" if top is None else top / name
    if not folder.is_dir():
        raise ModelError(
            f"the folder '{folder}' is missing: install the package again (pip install --force-reinstall .)"
        )
    return folder


def ssp_folder() -> Path:
    """Folder with the wiring (``*.ssd``) and the nominal values (``*.ssv``).

    Raises:
        ModelError: the package was installed without it.
    """
    return _data_folder("ssp")


def examples_folder() -> Path:
    """Folder with the example mappings and the synthetic logs.

    Raises:
        ModelError: the package was installed without it.
    """
    return _data_folder("examples")


def build_folder() -> Path:
    """Folder that receives the FMUs and systems: COSIM_BUILD, or ``build`` in the checkout or else here.

    It need not exist yet.
    """
    named = os.environ.get("COSIM_BUILD")
    if named:
        return Path(named)
    return (checkout() or Path.cwd()) / "build"


def cache_folder() -> Path:
    """Folder of what can be made again: COSIM_CACHE, or the user's cache folder. It need not exist yet."""
    return Path(os.environ.get("COSIM_CACHE") or user_cache_path("slew-cosim"))


def called(path: Path) -> str:
    """How people call a file: by its path, unless `calling` says otherwise."""
    return (_CALLED.get() or {}).get(path, str(path))


@contextmanager
def calling(names: Mapping[Path, str]) -> Iterator[None]:
    """Within this context answers call these files by these names: copies that lie where nobody put them."""
    token = _CALLED.set(names)
    try:
        yield
    finally:
        _CALLED.reset(token)


def unsafe_characters(path: Path) -> str:
    """The characters of an absolute path under which an unpacked FMU of pythonfmu crashes: ``# % + (`` and non-ASCII ones.

    Empty when the path is safe; each character once, in order of appearance.
    """
    return "".join(dict.fromkeys(c for c in str(path.absolute()) if c in "#%+(" or not c.isascii()))
