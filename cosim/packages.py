"""The Python packages the project asks for, and what of them this interpreter has."""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from cosim.errors import ModelError
from cosim.paths import checkout

PROJECT = "slew-cosim"


@dataclass(frozen=True)
class PackageState:
    """One requirement and what is installed for it.

    Attributes:
        requirement: as written in pyproject.toml, e.g. ``numpy>=2.1.3``.
        installed: version found, or None.
        satisfied: whether that version is in the range.
    """

    requirement: str
    installed: str | None
    satisfied: bool


@cache
def requirements() -> dict[str, tuple[Requirement, ...]]:
    """The requirements by extra; the key ``""`` holds the core ones. Extras with nothing for this platform are kept, empty.

    Raises:
        ModelError: neither a checkout's pyproject.toml nor an installed package's metadata can be read.
    """
    top = checkout()
    if top is not None:
        project = tomllib.loads((top / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        groups: dict[str, Iterable[str]] = {"": project["dependencies"], **project["optional-dependencies"]}
        return {extra: _applicable(lines, "") for extra, lines in groups.items()}
    try:
        information = metadata.metadata(PROJECT)
    except metadata.PackageNotFoundError:
        raise ModelError(f"'{PROJECT}' is neither installed nor a checkout: pip install it again") from None
    lines = metadata.requires(PROJECT) or []
    extras = information.get_all("Provides-Extra") or []
    core = _applicable(lines, "")
    return {"": core} | {
        extra: tuple(r for r in _applicable(lines, extra) if r not in core) for extra in extras
    }


def _applicable(lines: Iterable[str], extra: str) -> tuple[Requirement, ...]:
    parsed = [Requirement(line) for line in lines]
    return tuple(r for r in parsed if r.marker is None or r.marker.evaluate({"extra": extra}))


def package_states(extra: str = "") -> list[PackageState]:
    """What is installed for each requirement of an extra, or of the core.

    Raises:
        ModelError: the project does not know the extra, or its requirements cannot be read.
    """
    known = requirements()
    if extra not in known:
        raise ModelError(f"there is no extra '{extra}'; known: {', '.join(name for name in known if name)}")
    return [_state(requirement) for requirement in known[extra]]


def _state(requirement: Requirement) -> PackageState:
    text = f"{canonicalize_name(requirement.name)}{requirement.specifier}"
    try:
        installed = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return PackageState(text, None, False)
    return PackageState(text, installed, requirement.specifier.contains(installed, prereleases=True))


def project_version() -> str:
    """The project's version, from the source tree or from the installed package.

    Raises:
        ModelError: it is neither installed nor a checkout.
    """
    top = checkout()
    if top is not None:
        return str(tomllib.loads((top / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"])
    try:
        return metadata.version(PROJECT)
    except metadata.PackageNotFoundError:
        raise ModelError(f"'{PROJECT}' is neither installed nor a checkout: pip install it again") from None
