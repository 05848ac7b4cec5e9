"""An empty store like the damaged one, next to it: the source of metadata and rebuilt blocks."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Self

from grasp_factory.core.atomic_file import PARTIAL, fsync, partial_path, write_atomic
from grasp_factory.curation.verify.documents import FILE, read_document
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.header import read_attributes
from grasp_factory.writers.zarr.store import remove_creation

_OURS = re.compile(r"(zarr\.json|c|[0-9]+(\.[0-9]+)*)(" + re.escape(PARTIAL) + ")?")
"""Names of the files and folders of a store's arrays."""


class Template:
    """Created as ``.NAME.repairing`` next to the store, whose lock is held; removed at the end.

    Attributes:
        path: its path.
    """

    def __init__(self, store: Path, create: Callable[[Path], None]) -> None:
        """Create nothing yet.

        Args:
            store: the store that is repaired.
            create: creates an empty store like it at the path that it is called with.
        """
        self._store, self.path, self._create = locate(store), template_place(store), create

    def __enter__(self) -> Self:
        """Create the template.

        Raises:
            StoreMismatchError: if something else is at its path.
            StoreError: if the disk fails.
        """
        try:
            remove_template(self.path)
            self._create(self.path)
        except OSError as error:
            raise StoreError(f"{self.path} cannot be written: {error.strerror}") from None
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the template."""
        shutil.rmtree(self.path, ignore_errors=True)

    def differs(self, names: Iterable[str]) -> str:
        """Return the first of these arrays whose metadata is intact in the store, but differs here.

        If there is none, this version writes the metadata that the store's version wrote.
        """
        for name in names:
            ours, theirs = (
                read_document(place / name / FILE) for place in (self.path, self._store)
            )
            if not theirs[1] and ours[0] != theirs[0]:
                return name
        return ""

    def give_document(self, name: str) -> None:
        """Replace the ``zarr.json`` of an array or group in the store by the template's.

        Raises:
            StoreError: if a folder with other files has its path.
        """
        self._write_document(name, (self.path / name / FILE).read_bytes())

    def give_empty_group(self, name: str) -> None:
        """Write the ``zarr.json`` of a group without attributes into the store."""
        document = json.loads((self.path / "episodes" / FILE).read_bytes())
        self._write_document(name, json.dumps(document | {"attributes": {}}, indent=2).encode())

    def _write_document(self, name: str, data: bytes) -> None:
        folder = self._store / name
        for parent in reversed([folder, *folder.relative_to(self._store).parents]):
            if not (self._store / parent).is_dir():
                (self._store / parent).unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        _make_room(folder / FILE)
        write_atomic(folder / FILE, data, durable=True)
        fsync([folder.parent])

    def give_files(self, files: Iterable[Path]) -> None:
        """Move files, in this order, into the store; files that are absent here are removed there.

        Raises:
            StoreError: if a folder with other files has the path of one.
        """
        places = []
        for file in files:
            place = self._store / file.relative_to(self.path)
            _make_room(place)
            if file.exists():
                os.replace(file, place)
                places.append(place)
            else:
                place.unlink(missing_ok=True)
        fsync([*places, *{place.parent for place in places}])


def template_place(store: Path) -> Path:
    """Return the path of a store's template."""
    whole = locate(store)
    return whole.with_name(f".{whole.name}.repairing")


def remove_template(place: Path) -> None:
    """Remove what a killed repair has left at and next to a template's path.

    Raises:
        StoreMismatchError: if something else is there.
    """
    if place.exists():
        _check_own(place)
        for folder in place.iterdir():
            if folder.is_dir():
                shutil.rmtree(folder)
        shutil.rmtree(place)  # the root's metadata last: they identify a template
    remove_creation(place)


def _check_own(place: Path) -> None:
    try:
        if any(place.iterdir()):
            read_attributes(place)
    except (NotADirectoryError, StoreMismatchError, StoreError):
        what = "it is no store that a repair has left; move it"
        raise StoreMismatchError(f"{place} is in the way: {what}") from None


def _make_room(file: Path) -> None:
    """Remove a folder that has the path of a file, or of its partial file, if it is the store's.

    Raises:
        StoreError: if it contains anything else.
    """
    for place in (file, partial_path(file)):
        if not place.is_dir() or place.is_symlink():
            continue
        others = [name for name in place.rglob("*") if not _OURS.fullmatch(name.name)]
        if others:
            raise StoreError(f"{others[0]} is in the way: {place} has to be a file; move it")
        shutil.rmtree(place)
