"""A folder of zarr's whose files outlast a power cut."""

import contextlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from zarr.core.buffer import Buffer
from zarr.storage import LocalStore

from cosim.files import sync, sync_folder

AT_ONCE = 8  # files that are synced: a file system writes what waits for it together


class LastingStore(LocalStore):
    """Zarr writes each file beside and renames it, but syncs none: `last` does."""

    def __init__(self, root: Path | str, *, read_only: bool = False) -> None:
        super().__init__(root, read_only=read_only)
        self._written: set[str] = set()

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file."""
        self._written.add(key)
        await super().set(key, value)

    async def set_if_not_exists(self, key: str, value: Buffer) -> None:
        """Write a file that is not there."""
        self._written.add(key)
        await super().set_if_not_exists(key, value)

    def set_sync(self, key: str, value: Buffer) -> None:
        """Write a file, from within no loop of events."""
        self._written.add(key)
        super().set_sync(key, value)

    def last(self) -> None:
        """Sync what has been written since the last time, then the folders that name it."""
        files = [self.root / key for key in self._written]
        folders = {
            folder for file in files for folder in file.parents if folder.is_relative_to(self.root.parent)
        }
        with ThreadPoolExecutor(AT_ONCE) as pool:
            list(pool.map(_synced, files))
            list(pool.map(sync_folder, folders))
        self._written.clear()


def _synced(file: Path) -> None:
    with contextlib.suppress(FileNotFoundError):  # taken away again, as it holds nothing but NaN
        sync(file)
