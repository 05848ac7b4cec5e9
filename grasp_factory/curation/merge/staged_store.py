"""The path of a new store: a free path outside of all sources, where only a whole store appears."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import place_at
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.staging import StagingFolder

_SUFFIX = ".merging"
_OTHER = "choose another OUT"


class StagedStore:
    """The path of a new store.

    Attributes:
        path: the path that the user passed.
    """

    def __init__(self, path: Path | str, suffix: str = _SUFFIX) -> None:
        """Check that ``path`` is free, and change nothing.

        Args:
            path: where the store shall be.
            suffix: the end of the name of the folder in which it is built.

        Raises:
            StoreMismatchError: if something is there, unless a killed run has left it.
        """
        self.path = store_path(path)
        with self._naming():
            self._staging = StagingFolder(place_at(locate(self.path)), suffix)
            self._check_free()

    def check_apart(self, stores: Iterable[Path]) -> None:
        """Check that no source contains the new store's path, or is in it or its staging folder.

        Args:
            stores: the source stores' paths after links are followed.

        Raises:
            StoreMismatchError: naming the store.
        """
        target, aside = self._staging.target.path, self._staging.folder.path
        for store in stores:
            if target.is_relative_to(store):
                raise StoreMismatchError(f"{self.path} lies in the store {store}; {_OTHER}")
            if store.is_relative_to(aside) or store.is_relative_to(target):
                raise StoreMismatchError(f"{store} is what a killed run left at {self.path}")

    @contextlib.contextmanager
    def building(self) -> Iterator[Path]:
        """Yield an empty folder for the store, which moves to its place when the block succeeds.

        The store's lock is held meanwhile. After an error nothing is left.

        Raises:
            StoreBusyError: if another process writes there.
            StoreMismatchError: if something has appeared there, or the path cannot be written.
            StoreError: if the disk fails or is full.
        """
        with StoreLock(self.path), self._naming():
            self._check_free()
            with self._staging.building() as folder:
                yield folder.path

    @contextlib.contextmanager
    def resuming(self) -> Iterator[Path]:
        """Yield the folder of a store, which may hold a part of it; else as ``building``.

        After an error it stays, so that the same command goes on.
        """
        with StoreLock(self.path), self._naming():
            self._check_free()
            with self._staging.resuming() as folder:
                yield folder.path

    def _check_free(self) -> None:
        if not self._staging.is_free():
            raise StoreMismatchError(f"{self.path} exists, only new stores are made; {_OTHER}")
        self._staging.check_leftovers()

    @contextlib.contextmanager
    def _naming(self) -> Iterator[None]:
        try:
            yield
        except (FileNotFoundError, NotADirectoryError) as error:
            what = f"{self.path} cannot be written: {error.strerror}"
            raise StoreMismatchError(f"{what}; {_OTHER}") from None
        except OSError as error:
            raise StoreError(f"{self.path} cannot be written: {error.strerror}") from None
