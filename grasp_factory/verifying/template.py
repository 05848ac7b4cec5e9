"""An empty store like another one, aside, to take metadata and whole blocks from."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from grasp_factory.config import FactoryConfig
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.verifying.documents import FILE, read_document
from grasp_factory.writers.files import fsync, locate, write_aside
from grasp_factory.writers.header import read_attributes
from grasp_factory.writers.seals import SEAL
from grasp_factory.writers.store import create_store


class Template:
    """Made in ``.<name>.repairing`` beside the store, whose lock is held; removed at the end.

    Attributes:
        path: where it is.
    """

    def __init__(
        self,
        store: Path,
        config: FactoryConfig,
        attributes: Mapping[str, Any],
        *,
        joints: int,
        rows: int,
        objects: Mapping[str, bytes],
    ) -> None:
        """Make nothing yet; see ``create_store`` for what it will be made of."""
        self._store = locate(store)
        self.path = self._store.with_name(f".{self._store.name}.repairing")
        self._config, self._joints, self._rows, self._objects = config, joints, rows, objects
        self._attributes = {key: value for key, value in attributes.items() if key != SEAL}

    def __enter__(self) -> Self:
        """Make it.

        Raises:
            StoreMismatchError: if something else has its place.
            StoreError: if the disk fails.
        """
        try:
            self._remove()
            create_store(
                self.path, self._config, self._attributes,
                joints=self._joints, n=self._rows, objects=self._objects,
            )  # fmt: skip
        except OSError as error:
            raise StoreError(f"{self.path} cannot be written: {error.strerror}") from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove it."""
        shutil.rmtree(self.path, ignore_errors=True)

    def differs(self, names: Iterable[str]) -> str:
        """Return the first of these arrays whose metadata, whole in the store, is another here.

        Where there is none, this version writes what the store's version wrote.
        """
        for name in names:
            ours, theirs = (
                read_document(place / name / FILE) for place in (self.path, self._store)
            )
            if not theirs[1] and ours[0] != theirs[0]:
                return name
        return ""

    def give_document(self, name: str) -> None:
        """Put the ``zarr.json`` of an array or group into the store, in place of its own."""
        data = (self.path / name / FILE).read_bytes()
        folder = self._store / name
        folder.mkdir(parents=True, exist_ok=True)
        write_aside(folder / FILE, data)
        fsync([folder / FILE, folder, folder.parent])

    def give_empty_group(self, name: str) -> None:
        """Put the ``zarr.json`` of a group without attributes into the store."""
        document = json.loads((self.path / "episodes" / FILE).read_bytes())
        folder = self._store / name
        write_aside(folder / FILE, json.dumps(document | {"attributes": {}}, indent=2).encode())
        fsync([folder / FILE, folder])

    def give_files(self, files: Iterable[Path]) -> None:
        """Move files, in this order, to their places in the store; what is not here goes there."""
        places = []
        for file in files:
            place = self._store / file.relative_to(self.path)
            if file.exists():
                os.replace(file, place)
                places.append(place)
            else:
                place.unlink(missing_ok=True)
        fsync([*places, *{place.parent for place in places}])

    def _remove(self) -> None:
        """Remove what a killed repair has left."""
        if not self.path.exists():
            return
        try:
            read_attributes(self.path)
        except (StoreMismatchError, StoreError):
            what = "it is no store that a repair has left; move it"
            raise StoreMismatchError(f"{self.path} is in the way: {what}") from None
        shutil.rmtree(self.path)
