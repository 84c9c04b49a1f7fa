"""Toy FMUs, built once a session."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import toy_fmus


class Toys:
    """Builds the toy FMUs on demand and packs systems of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.built: dict[str, Path] = {}
        self.count = 0

    def fmu(self, kind: str) -> Path:
        if kind not in self.built:
            self.built[kind] = toy_fmus.build(kind, self.folder)
        return self.built[kind]

    def ssp(
        self, components: dict[str, str], connections: list[str], files: Any = None, **options: Any
    ) -> Path:
        self.count += 1
        fmus = {kind: self.fmu(kind) for kind in set(components.values())}
        description = toy_fmus.ssd(components, connections, **options)
        return toy_fmus.pack(self.folder / f"system_{self.count}.ssp", description, fmus, files)


@pytest.fixture(scope="session")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Toys:
    return Toys(tmp_path_factory.mktemp("toys"))


@pytest.fixture(scope="session")
def build_toy() -> Callable[..., Path]:
    return toy_fmus.build
