"""Build a store, or a part of one, in a staging folder, then move it to its place as a whole."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator

from grasp_factory.core.place import Place, fsync_places
from grasp_factory.core.place_tree import files_below
from grasp_factory.errors import StoreMismatchError
from grasp_factory.writers.zarr.block_attempt import ATTEMPT_FILE

CREATING = ".creating"
"""Suffix of the folders in which stores and labels are created."""
ROOT_METADATA = "zarr.json"
"""The file that makes a folder a store."""
_STORE_FILE = re.compile(
    r"(zarr\.json|log\.jsonl|[0-9]+-[0-9]+\.npz)(\.partial)?"
    rf"|[0-9]+(\.[0-9]+)*({ATTEMPT_FILE})?"
)


def is_store_file(path: str) -> bool:
    """Return whether a file has the name of one in a store, or of one that is being written."""
    return _STORE_FILE.fullmatch(path.rpartition("/")[2]) is not None


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
        self, target: Place, suffix: str, is_ours: Callable[[str], bool] = is_store_file
    ) -> None:
        """Look at the place and change nothing.

        Args:
            target: the store's place.
            suffix: the end of the folder's name.
            is_ours: called with the path below the folder of a file that a killed process may have
                left.
        """
        self.target = target
        self._is_inside = target.exists()
        beside = target.parent / f".{target.name}{suffix}"
        self.folder = target / suffix if self._is_inside else beside
        self._is_ours = is_ours

    def is_free(self) -> bool:
        """Return whether the place has nothing, an empty directory, or leftovers to remove."""
        if not self.target.exists():
            return True
        if not self._is_inside or not self.target.is_dir() or self._is_published():
            return False
        return self.folder.is_dir() or not self.target.names()

    def check_leftovers(self) -> None:
        """Check that a killed process has left nothing, or only what it made.

        Raises:
            StoreMismatchError: naming a file that is not ours.
            IrregularFileError: naming a link.
        """
        if self.folder.is_file():
            raise StoreMismatchError(f"{self.folder} is in the way: move it")
        place = self._place_of_work()
        for file in files_below(place) if place.is_dir() else ():
            if not (self._is_ours(file.below(place)) and self._is_in_piece(file)):
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
        if self._is_unpublished_inside():
            for piece in self.target.glob("*"):
                if piece.name != self.folder.name:
                    piece.rmtree()
        self.folder.rmtree()  # last: it marks the other pieces as ours

    @contextlib.contextmanager
    def building(self) -> Iterator[Place]:
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

    @contextlib.contextmanager
    def resuming(self) -> Iterator[Place]:
        """Yield the folder, which may hold what a killed process has made in it.

        It is moved to its place when the block succeeds, and stays as it is after an error. Its
        content must be on the disk by then (fsync).

        Raises:
            StoreMismatchError: if a file that is not ours is in the way.
            OSError: if the disk fails.
        """
        self.check_leftovers()
        if self._is_unpublished_inside() and set(self.target.names()) - {self.folder.name}:
            self.remove_leftovers()  # it was killed while pieces were moved
        self.folder.mkdir(exist_ok=True)
        yield self.folder
        self._publish()

    def _is_in_piece(self, file: Place) -> bool:
        """Return whether a file is in the staging folder, or in a piece: they have metadata."""
        first = file.below(self.target).partition("/")[0]
        piece = self.target / first
        is_staged = not self._is_inside or piece.name == self.folder.name
        return is_staged or first == ROOT_METADATA or (piece / ROOT_METADATA).exists()

    def _place_of_work(self) -> Place:
        """Return where pieces of an unfinished store may be."""
        return self.target if self._is_unpublished_inside() else self.folder

    def _is_unpublished_inside(self) -> bool:
        return self._is_inside and not self._is_published()

    def _is_published(self) -> bool:
        return (self.target / ROOT_METADATA).exists()

    def _publish(self) -> None:
        if not self._is_inside:
            self.folder.replace(self.target)
            fsync_places([self.target.parent])
            return
        for piece in sorted(self.folder.glob("*"), key=lambda piece: piece.name == ROOT_METADATA):
            fsync_places([self.target])  # ROOT_METADATA is also the last on the disk
            piece.replace(self.target / piece.name)
        self.folder.rmdir()
        fsync_places([self.target])
