"""Where a new store goes: built aside under a known name, then renamed, all of it or nothing."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.files import fsync, locate
from grasp_factory.writers.zarr.lock import StoreLock

_ASIDE = ".merging"
_OTHER = "choose another OUT"
_OF_A_STORE = re.compile(r"(zarr|\d+)([.-][0-9a-z]+)*|log\.jsonl(\.partial)?")
"""Names of files in a store, and of those that are being written."""


class StagedStore:
    """The place of a new store.

    Attributes:
        path: as the user gave it.
        target: where it leads, links followed.
        aside: the directory that the store is built in: beside the target, or inside of it where
            that is an empty directory, which may be a mount point and stays what it is.
    """

    def __init__(self, path: Path | str) -> None:
        """Look at ``path`` and change nothing.

        Raises:
            StoreMismatchError: if something is there that is no leftover of ours.
        """
        self.path, self.target = Path(path), locate(Path(path))
        with self._naming():
            self._is_inside = self.target.exists()
            beside = self.target.with_name(f".{self.target.name}{_ASIDE}")
            self.aside = self.target / _ASIDE if self._is_inside else beside
            self._check_free()

    def check_apart(self, stores: Iterable[Path]) -> None:
        """Check that no store lies where the new one is built, and none holds that place.

        Args:
            stores: their places, links followed.

        Raises:
            StoreMismatchError: naming the store.
        """
        for store in stores:
            if self.target.is_relative_to(store):
                raise StoreMismatchError(f"{self.path} lies in the store {store}; {_OTHER}")
            if store.is_relative_to(self.aside) or store.is_relative_to(self.target):
                raise StoreMismatchError(f"{store} is what a killed run left at {self.path}")

    @contextlib.contextmanager
    def building(self) -> Iterator[Path]:
        """Give an empty directory for the store, which goes to its place when the block ends well.

        The store's lock is held meanwhile. When the block raises, nothing is left.

        Raises:
            StoreBusyError: if another process writes there.
            StoreMismatchError: if something has appeared there, or it cannot be written.
            StoreError: if the disk fails or is full.
        """
        with StoreLock(self.path), self._naming():
            self._check_free()
            self._remove_leftovers()
            self.aside.mkdir()
            try:
                yield self.aside
                self._publish()
            except BaseException:
                with contextlib.suppress(OSError):  # else the next run does it
                    self._remove_leftovers()
                raise

    @contextlib.contextmanager
    def _naming(self) -> Iterator[None]:
        try:
            yield
        except (FileNotFoundError, NotADirectoryError) as error:
            what = f"{self.path} cannot be written: {error.strerror}"
            raise StoreMismatchError(f"{what}; {_OTHER}") from None
        except OSError as error:
            raise StoreError(f"{self.path} cannot be written: {error.strerror}") from None

    def _check_free(self) -> None:
        if self._is_inside:
            self._check_inside()
        elif self.target.exists():
            raise StoreMismatchError(f"{self.path} has just appeared; {_OTHER}")
        if self.aside.is_symlink() or (self.aside.exists() and not self.aside.is_dir()):
            raise StoreMismatchError(f"{self.aside} is in the way: move it or {_OTHER}")
        for file in _files(self.target if self._is_inside else self.aside):
            if file.is_symlink() or not _OF_A_STORE.fullmatch(file.name):
                raise StoreMismatchError(
                    f"{self.aside} is in the way: it holds {file.name}, which is of no store;"
                    f" move it or {_OTHER}"
                )

    def _check_inside(self) -> None:
        is_leftover = self.aside.is_dir() and not (self.target / "zarr.json").exists()
        if not self.target.is_dir() or not (is_leftover or not any(self.target.iterdir())):
            raise StoreMismatchError(f"{self.path} exists, only new stores are made; {_OTHER}")

    def _remove_leftovers(self) -> None:
        """Remove what a run has left that was killed, or that fails now."""
        if self._is_inside and self.aside.exists() and not (self.target / "zarr.json").exists():
            for piece in self.target.iterdir():
                if piece != self.aside:
                    shutil.rmtree(piece)  # the directory that marks our work goes last
        if self.aside.exists():
            shutil.rmtree(self.aside)

    def _publish(self) -> None:
        if not self._is_inside:
            os.replace(self.aside, self.target)
            fsync([self.target.parent])
            return
        for piece in sorted(self.aside.iterdir(), key=lambda piece: piece.name == "zarr.json"):
            fsync([self.target])  # what makes it a store comes last on the disk, too
            os.replace(piece, self.target / piece.name)
        self.aside.rmdir()
        fsync([self.target])


def _files(folder: Path) -> Iterator[Path]:
    return (p for p in folder.rglob("*") if p.is_symlink() or not p.is_dir())
