"""An empty store like the damaged one, next to it: the source of metadata and rebuilt blocks."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Self

from grasp_factory.core.atomic_file import PARTIAL
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place, fsync_places, place_at, place_of
from grasp_factory.core.place_tree import files_below
from grasp_factory.curation.verify.documents import FILE, read_document
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.block_attempt import ATTEMPT_FILE
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.header import read_attributes
from grasp_factory.writers.zarr.store import remove_creation

_LAYOUT = ("data_type", "chunk_grid", "chunk_key_encoding", "codecs")
_OURS = re.compile(rf"(zarr\.json|c)({re.escape(PARTIAL)})?|[0-9]+(\.[0-9]+)*({ATTEMPT_FILE})?")
"""Names of the files and folders of a store's arrays."""


class Template:
    """Created as ``.NAME.repairing`` next to the store, whose lock is held; removed at the end.

    Attributes:
        place: its place.
    """

    def __init__(self, store: Path, create: Callable[[Path], None]) -> None:
        """Create nothing yet.

        Args:
            store: the store that is repaired.
            create: creates an empty store like it at the path that it is called with.
        """
        self._store, self.place, self._create = (
            place_of(locate(store)),
            template_place(store),
            create,
        )

    def __enter__(self) -> Self:
        """Create the template.

        Raises:
            StoreMismatchError: if something else is at its path.
            StoreError: if the disk fails.
        """
        try:
            remove_template(self.place)
            self._create(self.place.path)
        except OSError as error:
            raise StoreError(f"{self.place} cannot be written: {error.strerror}") from None
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the template."""
        with contextlib.suppress(OSError):
            self.place.rmtree()

    def differs(self, names: Iterable[str]) -> str:
        """Return the first of these arrays whose metadata is intact in the store, but differs here.

        If there is none, this version writes the metadata that the store's version wrote.
        """
        for name in names:
            ours, theirs, fault = self._documents(name)
            if not fault and ours != theirs:
                return name
        return ""

    def differs_in_layout(self, names: Iterable[str]) -> str:
        """Return the first of these arrays whose files in the store are other than those here.

        A file of the template says nothing in the store if the chunks or the codecs differ.
        """
        for name in names:
            ours, theirs, _ = self._documents(name)
            if any(ours.get(key) != theirs.get(key) for key in _LAYOUT):
                return name
        return ""

    def _documents(self, name: str) -> tuple[dict[str, Any], dict[str, Any], str]:
        """Return the metadata of an array here and in the store, and what is wrong with that."""
        ours, theirs = (read_document(place / name / FILE) for place in (self.place, self._store))
        return ours[0], *theirs

    def give_document(self, name: str) -> None:
        """Replace the ``zarr.json`` of an array or group in the store by the template's.

        Raises:
            StoreError: if a folder with other files has its path.
        """
        self._write_document(name, (self.place / name / FILE).read_bytes(DOCUMENT))

    def give_empty_group(self, name: str) -> None:
        """Write the ``zarr.json`` of a group without attributes into the store."""
        document = parsed((self.place / "episodes" / FILE).read_bytes(DOCUMENT))
        self._write_document(name, json.dumps(document | {"attributes": {}}, indent=2).encode())

    def _write_document(self, name: str, data: bytes) -> None:
        folder = self._store
        for part in filter(None, name.split("/")):
            folder = folder / part
            if not folder.is_dir():
                folder.unlink(missing_ok=True)
                folder.mkdir()
        _make_room(folder / FILE)
        (folder / FILE).write(data, durable=True)
        fsync_places([folder.parent])

    def give_files(self, files: Iterable[Place]) -> None:
        """Move files, in this order, into the store; files that are absent here are removed there.

        Raises:
            StoreError: if a folder with other files has the path of one.
        """
        places = []
        for file in files:
            place = self._store / file.below(self.place)
            _make_room(place)
            if file.exists():
                file.replace(place)
                places.append(place)
            else:
                place.unlink(missing_ok=True)
        folders = {place.parent.inner: place.parent for place in places}
        fsync_places([*places, *folders.values()])


def template_place(store: Path) -> Place:
    """Return the place of a store's template."""
    whole = locate(store)
    return place_at(whole.with_name(f".{whole.name}.repairing"))


def remove_template(place: Place) -> None:
    """Remove what a killed repair has left at and next to a template's path.

    Raises:
        StoreMismatchError: if something else is there.
    """
    if place.exists():
        _check_own(place)
        for folder in place.glob("*"):
            if folder.is_dir():
                folder.rmtree()
        place.rmtree()  # the root's metadata last: they identify a template
    remove_creation(place.path)


def _check_own(place: Place) -> None:
    try:
        if place.names():
            read_attributes(place.path)
    except (NotADirectoryError, StoreMismatchError, StoreError):
        what = "it is no store that a repair has left; move it"
        raise StoreMismatchError(f"{place} is in the way: {what}") from None


def _make_room(file: Place) -> None:
    """Remove a folder that has the path of a file, or of its partial file, if it is the store's.

    Raises:
        StoreError: if it contains anything else.
    """
    for place in (file, file.partial):
        if not place.is_dir():
            continue
        others = [inner for inner in files_below(place) if not _OURS.fullmatch(inner.name)]
        if others:
            raise StoreError(f"{others[0]} is in the way: {place} has to be a file; move it")
        place.rmtree()
