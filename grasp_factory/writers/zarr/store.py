"""What the coordinator does with a store: create it, grow it, and find the missing rows.

Only one process may do this at a time (see ``lock``), and only while no block is being written.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.config_difference import differing_values
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.plugin_origin import changed_file
from grasp_factory.core.place import Place, place_at, place_of
from grasp_factory.core.place_tree import entries, files_below, fsync_tree
from grasp_factory.core.regular_file import irregular
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.budgets import check_block_size
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.embedded import DESCRIPTIONS, add_embedded
from grasp_factory.writers.zarr.files import cannot_write, locate
from grasp_factory.writers.zarr.header import (
    SOURCES,
    fields_of,
    open_array,
    open_store,
    place_in,
    read_attributes,
    root_attributes,
)
from grasp_factory.writers.zarr.layout import create_array, documents, shapes
from grasp_factory.writers.zarr.metadata_checksum import seal, set_rows
from grasp_factory.writers.zarr.staging import CREATING, StagingFolder
from grasp_factory.writers.zarr.writer import COMMITTED

_OTHER = "choose another --out"


def check_place(path: Path, config: FactoryConfig) -> Path:
    """Check that ``path`` holds a store of this config, or nothing; return its real path.

    Raises:
        ConfigError: if readers would refuse the size of its blocks.
        StoreMismatchError: if it holds anything else, or cannot lead to a store.
        StoreError: if the store there is damaged, or cannot be read.
        IrregularFileError: if there is a link among its folders, or in one of them.
    """
    target = locate(path)
    try:
        if _creation(target).is_free():
            check_block_size(config)
        else:
            _check_same(path, config)
            _check_regular(place_of(target))
    except (FileNotFoundError, NotADirectoryError):
        pass  # there is not even a directory for it, which is an error when it is written
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}") from None
    return target


def prepare_store(
    path: Path,
    config: FactoryConfig,
    joints: int,
    n: int,
    extra: Mapping[str, Any],
    *,
    carried: Mapping[str, bytes] = MappingProxyType({}),
) -> None:
    """Create the store of a config at ``path``, or grow the one that is there to ``n`` episodes.

    A new store is staged (``StagingFolder``). An existing one keeps the versions and the ``extra``
    attributes that it was created with.

    Args:
        path: the store.
        config: its config.
        joints: joint count of the config's robot.
        n: episodes.
        extra: more root attributes, JSON data, for a new store.
        carried: data to embed in a new store, by path in it (``embedded_in``).

    Raises:
        StoreMismatchError: if the path holds anything else, or cannot be written.
        StoreError: if the store there is damaged, or the disk fails.
    """
    target = locate(path)  # the rename would replace a link
    try:
        if _creation(target).is_free():
            attributes = root_attributes(config, extra)
            create_store(target, config, attributes, joints=joints, n=n, carried=carried)
        else:
            _check_same(path, config)
            _grow(path, config, joints, n)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise cannot_write(path, error) from None
    except OSError as error:
        raise StoreError(f"{path} cannot be written: {error.strerror}") from None


def missing_rows(path: Path, *, quarantined: bool = False) -> NDArray[np.int64]:
    """Return the missing rows, ascending; with ``quarantined`` also those in quarantine.

    Raises:
        StoreMismatchError: if there is no store.
        StoreError: if it is damaged.
    """
    status = Columns.open(path).read("status")["status"]
    return np.flatnonzero((status != COMMITTED) if quarantined else (status == 0))


def create_store(
    target: Path,
    config: FactoryConfig,
    attributes: Mapping[str, Any],
    *,
    joints: int,
    n: int,
    carried: Mapping[str, bytes],
    fields: Collection[schema.Field] = (),
) -> None:
    """Create an empty store at a path with nothing or an empty directory; see ``prepare_store``.

    Args:
        target: its path, links followed (``files.locate``).
        config: its config.
        attributes: of the root: those of ``header.root_attributes`` and more.
        joints: joint count of the config's robot.
        n: rows.
        carried: data to embed, by path in the store.
        fields: of its arrays; empty for all of the schema. A store that was made before a sensor
            was added has fewer.

    Raises:
        StoreMismatchError: if something that is not ours is in the way.
        OSError: if the disk fails.
    """
    with _creation(target).building() as folder:
        store = AtomicStore(folder)
        root = zarr.create_group(store, zarr_format=3, attributes=dict(attributes))
        for name, content in carried.items():
            add_embedded(root, name, content)
        for file in files_below(folder):
            if file.name == "zarr.json":
                seal(file)
        own = fields or schema.expand(config)
        for name, metadata in documents(own, config, joints, n).items():
            create_array(folder, name, metadata)
        fsync_tree(folder)


def remove_creation(target: Path) -> None:
    """Remove what a killed ``create_store`` has left of a store at ``target``.

    Raises:
        StoreMismatchError: if something that is not ours is in it.
    """
    _creation(target).remove_leftovers()


def _creation(target: Path) -> StagingFolder:
    return StagingFolder(place_at(target), CREATING, _is_of_creation)


def _is_of_creation(path: str) -> bool:
    """Return whether ``create_store`` makes such a file: metadata or embedded data.

    The data of a block is not, so leftovers are never removed together with episodes.
    """
    *folders, name = path.split("/")
    is_chunk = name.partition(".")[0].isdigit()
    return name.startswith("zarr.") or (is_chunk and not DESCRIPTIONS.keys().isdisjoint(folders))


def _check_same(path: Path, config: FactoryConfig) -> None:
    try:
        attributes = read_attributes(path)
    except StoreMismatchError as error:
        raise StoreMismatchError(f"{error}; {_OTHER}") from None
    if SOURCES in attributes:
        raise StoreMismatchError(f"{path} was put together from other stores; {_OTHER}")
    if attributes.get("config_sha256") != config.sha256():
        stored = attributes["config"]
        if changed := changed_file(stored, config.plugins):
            raise StoreMismatchError(
                f"{changed} has changed since {path} was begun; {_OTHER}, or put the old file back:"
                f" `grasp-factory info --full {path}` prints it"
            )
        found = differing_values(stored, config.to_plain())
        key, old, new = found or ("config_sha256", "another", config.sha256())
        raise StoreMismatchError(
            f"{path} holds a dataset of another config: it has {key}: {old}, and this run has"
            f" {new}; use its config (leave this setting out) or {_OTHER}"
        )


def _check_regular(store: Place) -> None:
    """Check, before hours of work, that there is no link in the folders of a store."""
    for folder in (store, *(store / name for name in entries(store).folders)):
        for name in entries(folder).others:
            raise irregular(folder.path / name)


def _grow(path: Path, config: FactoryConfig, joints: int, n: int) -> None:
    """Resize the arrays, ``status`` last: its length is that of the last growth that finished.

    After a kill in between, some arrays are longer than ``status``. Nothing has been written
    there, so they are resized to the new length, even if it is shorter.
    """
    root, _ = open_store(path, mode="r+")
    store = place_in(root)
    with contextlib.suppress(OSError):  # left by a creation that was killed at its end
        (store / CREATING).rmdir()
    own = fields_of(path, config, root.attrs.asdict()).values()
    fields = sorted(own, key=lambda row: row == schema.STATUS)
    arrays = {row: open_array(root, row.path) for row in fields}
    n = max(n, arrays[schema.STATUS].shape[0])
    room = shapes(schema.expand(config), config, joints, n)
    for row, array in arrays.items():
        _check_layout(path, row, array, room[row])
    for row, array in arrays.items():
        metadata = store / row.path / "zarr.json"
        metadata.partial.unlink(missing_ok=True)
        if array.shape[0] != n:
            set_rows(metadata, n)


def _check_layout(
    path: Path, row: schema.Field, array: zarr.Array[Any], want: tuple[int, ...]
) -> None:
    kind = "string" if array.dtype.kind == "T" else array.dtype.name
    if (kind, array.shape[1:]) != (row.dtype, want[1:]):
        raise StoreMismatchError(
            f"{path} was made by another version: {row.path} is {kind} {array.shape[1:]}, this one"
            f" makes {row.dtype} {want[1:]}; use that version or {_OTHER}"
        )
