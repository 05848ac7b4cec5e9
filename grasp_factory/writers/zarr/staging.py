"""Build a store, or a part of one, in a staging folder, then move it to its place as a whole."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from grasp_factory.core.atomic_file import fsync
from grasp_factory.errors import StoreMismatchError

CREATING = ".creating"
"""Suffix of the folders in which stores and labels are created."""
ROOT_METADATA = "zarr.json"
"""The file that makes a folder a store."""
_STORE_FILE = re.compile(r"(zarr|\d+)([.-][0-9a-z]+)*|log\.jsonl(\.partial)?")


def is_store_file(file: Path) -> bool:
    """Return whether a file has the name of one in a store, or of one that is being written."""
    return _STORE_FILE.fullmatch(file.name) is not None


class StagingFolder:
    """The folder in which a store is built before it is moved to its place. Its user holds a lock.

    If nothing is at the place, the folder is next to it and is renamed. If an empty directory is
    there, perhaps a mount point, it is kept: the folder is inside it, and the folder's content is
    moved piece by piece, with the root's metadata last.

    The next process removes what a killed one has left, unless a file in it is not ours.

    Attributes:
        target: the store's place.
        folder: the staging folder.
    """

    def __init__(
        self, target: Path, suffix: str, is_ours: Callable[[Path], bool] = is_store_file
    ) -> None:
        """Look at the place and change nothing.

        Args:
            target: the store's place, links followed.
            suffix: the end of the folder's name.
            is_ours: called with the relative path of a file that a killed process may have left.
        """
        self.target = target
        self._is_inside = target.exists()
        beside = target.with_name(f".{target.name}{suffix}")
        self.folder = target / suffix if self._is_inside else beside
        self._is_ours = is_ours

    def is_free(self) -> bool:
        """Return whether the place has nothing, an empty directory, or leftovers to remove."""
        if not self.target.exists():
            return True
        if not self._is_inside or not self.target.is_dir() or self._is_published():
            return False
        return self.folder.is_dir() or not any(self.target.iterdir())

    def check_leftovers(self) -> None:
        """Check that a killed process has left nothing, or only what it made.

        Raises:
            StoreMismatchError: naming a file that is not ours.
        """
        if self.folder.is_symlink() or (self.folder.exists() and not self.folder.is_dir()):
            raise StoreMismatchError(f"{self.folder} is in the way: move it")
        place = self._place_of_work()
        for file in place.rglob("*"):
            is_file = file.is_symlink() or not file.is_dir()
            if is_file and (file.is_symlink() or not self._is_ours(file.relative_to(place))):
                raise StoreMismatchError(f"{place} is in the way: it holds {file.name}; move it")

    def remove_leftovers(self) -> None:
        """Remove what a killed process has left, or this process when it fails.

        Raises:
            StoreMismatchError: if a file is not ours; nothing is removed then.
            OSError: if the disk fails.
        """
        if not self.folder.exists():
            return
        self.check_leftovers()
        if self._place_of_work() == self.target:
            for piece in self.target.iterdir():
                if piece != self.folder:
                    shutil.rmtree(piece)
        shutil.rmtree(self.folder)  # last: it marks the other pieces as ours

    @contextlib.contextmanager
    def building(self) -> Iterator[Path]:
        """Yield the folder, empty; it is moved to its place when the block succeeds.

        Its content must be on the disk by then (fsync). After an error nothing is left.

        Raises:
            StoreMismatchError: if a file that is not ours is in the way.
            OSError: if the disk fails.
        """
        self.remove_leftovers()
        self.folder.mkdir()
        try:
            yield self.folder
            self._publish()
        except BaseException:
            with contextlib.suppress(OSError, StoreMismatchError):  # else the next process does it
                self.remove_leftovers()
            raise

    def _place_of_work(self) -> Path:
        """Return where pieces of an unfinished store may be."""
        return self.target if self._is_inside and not self._is_published() else self.folder

    def _is_published(self) -> bool:
        return (self.target / ROOT_METADATA).exists()

    def _publish(self) -> None:
        if not self._is_inside:
            os.replace(self.folder, self.target)
            fsync([self.target.parent])
            return
        for piece in sorted(self.folder.iterdir(), key=lambda piece: piece.name == ROOT_METADATA):
            fsync([self.target])  # ROOT_METADATA is also the last on the disk
            os.replace(piece, self.target / piece.name)
        self.folder.rmdir()
        fsync([self.target])
