"""Copying a store from the local disk to object storage, so that no reader sees half a block.

The metadata of arrays comes first, then that of the root. A block is claimed by its checksums, then
come its other objects, and its commit marker last. Every object is put "if absent" and compared if
it is there, so several writers of the same store may be at work, and a killed one is continued.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core import schema
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT, OBJECT
from grasp_factory.core.object_storage.address import RemotePath
from grasp_factory.core.object_storage.objects import Objects
from grasp_factory.core.object_storage.put_once import check_puts_once, is_there, put_once
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.place_tree import files_below
from grasp_factory.errors import StoreMismatchError
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.embedded import DESCRIPTIONS
from grasp_factory.writers.zarr.layout import block_number
from grasp_factory.writers.zarr.metadata_checksum import SEAL

AT_ONCE = 4
"""Objects of a block that are sent at the same time."""
_ROOT = "zarr.json"
_OF_A_MACHINE = {"versions", "platform", "created_by", SEAL}
"""Root attributes that differ between machines that make the same bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Uploaded:
    """A store that is in object storage."""

    path: str
    rows: int
    blocks: int
    there_before: int
    """Blocks that another run had finished."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Files:
    """The files of a store, by when they are sent."""

    arrays: list[Place]
    """Metadata, the root's last, and data that is embedded."""
    blocks: dict[int, list[Place]]
    """The claim first, the commit marker last."""
    beside: list[Place]
    """Labels, annotations and packed segments."""


def upload(
    store: Path, address: RemotePath, *, on_block: Callable[[int], None] = lambda rows: None
) -> Uploaded:
    """Copy a store to an address where nothing is, or a part of the same store.

    Blocks that are missing are left to others.

    Args:
        store: path of the store, on this machine; a block is complete, or missing.
        address: where it shall be.
        on_block: called with the number of rows of each block that is there.

    Raises:
        UsageError: if the server ignores put-if-absent.
        StoreMismatchError: if another store is there, or one of another length.
        StoreError: if the store is damaged.
        StorageError: if the server does not answer. What was sent stays; another call goes on.
    """
    columns, objects = Columns.open(store), Objects(address)
    files = _files(columns)
    check_puts_once(objects)
    *arrays, root = files.arrays
    try:
        _send(objects, arrays)
        _send_root(objects, root)
    except StoreMismatchError as error:
        what = "another store is there, or one of another length"
        raise StoreMismatchError(f"{error}: {what}; choose another address") from None
    there = {facts.key for facts in objects.below(schema.STATUS.path)}
    before = 0
    blocks = {block: places for block, places in files.blocks.items() if places}
    for block, places in blocks.items():
        if _send_block(objects, block, places, is_marked=places[-1].inner in there):
            before += 1
        start, stop = columns.rows(block)
        on_block(stop - start)
    _send(objects, files.beside)
    return Uploaded(path=str(address), rows=columns.length, blocks=len(blocks), there_before=before)


def _files(columns: Columns) -> _Files:
    fields = {field.path: field for field in schema.expand(columns.config)}
    size, place = columns.config.block_size, place_of(columns.path)
    groups = {field.path.partition("/")[0] for field in fields.values()}
    groups |= {"", *DESCRIPTIONS}  # the root's own, and those of embedded data
    first: list[Place] = []
    blocks: dict[int, list[Place]] = {block: [] for block in range(columns.block_count)}
    beside: list[Place] = []
    for file in files_below(place):
        folder = file.parent.inner
        field = fields.get(folder)
        number = None if field is None else block_number(file.name, field)
        if field is not None and number is not None:
            blocks[number // size if field.is_video else number].append(file)
        elif folder.partition("/")[0] in groups:
            first.append(file)
        else:
            beside.append(file)
    order = {schema.CHECKSUM.path: -1, schema.STATUS.path: 1}
    for places in blocks.values():
        places.sort(key=lambda file: (order.get(file.parent.inner, 0), file.inner))
    first.sort(key=lambda file: (file.inner == _ROOT, file.inner))
    return _Files(arrays=first, blocks=blocks, beside=beside)


def _send_block(objects: Objects, block: int, places: list[Place], *, is_marked: bool) -> bool:
    """Send a block; return whether another run had finished it.

    Raises:
        StoreMismatchError: if it is there with other episodes.
    """
    claim, *data, marker = places
    try:
        if is_marked and _is_same(objects, claim):
            return True
        put_once(objects, claim.inner, claim.read_bytes(OBJECT))
        with ThreadPoolExecutor(AT_ONCE) as pool:
            list(pool.map(lambda file: _put(objects, file), data))
        _put(objects, marker)
    except StoreMismatchError:
        raise StoreMismatchError(
            f"{objects.path}: block {block} is there with other episodes, of another writer; choose"
            " another address"
        ) from None
    return False


def _is_same(objects: Objects, file: Place) -> bool:
    try:
        return is_there(objects, file.inner, file.read_bytes(OBJECT))
    except FileNotFoundError:
        return False


def _send(objects: Objects, files: Iterable[Place]) -> None:
    for file in files:
        _put(objects, file)


def _send_root(objects: Objects, file: Place) -> None:
    """Send the root's metadata, unless another machine has, which makes the same bytes.

    Raises:
        StoreMismatchError: if what is there says more than that another machine has made it.
    """
    try:
        _put(objects, file)
    except StoreMismatchError:
        there = objects.get(file.inner, DOCUMENT)
        if _of_every_machine(there) != _of_every_machine(file.read_bytes(DOCUMENT)):
            raise


def _of_every_machine(document: bytes) -> Any:
    """Return the root's metadata without what names the machine and the versions that began it."""
    found = parsed(document)
    known = found.get("attributes") if isinstance(found, dict) else None
    if not isinstance(known, dict):
        return found
    return found | {"attributes": {key: v for key, v in known.items() if key not in _OF_A_MACHINE}}


def _put(objects: Objects, file: Place) -> None:
    put_once(objects, file.inner, file.read_bytes(OBJECT))
