"""Making a store in object storage: it is made and packed in the cache first, then sent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.cache import cache_dir, digest
from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.object_storage.address import RemotePath
from grasp_factory.core.object_storage.client import endpoint
from grasp_factory.core.object_storage.objects import Objects
from grasp_factory.core.object_storage.put_once import check_puts_once, put_once
from grasp_factory.core.place import place_at
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import count
from grasp_factory.curation.pack import Packed, pack_part, pack_store
from grasp_factory.curation.upload.uploading import upload
from grasp_factory.curation.versions.origin import SUFFIX
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.snapshots.version import rows_sha256
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import ConfigError, StoreMismatchError, UsageError
from grasp_factory.factory.block_job import shard_rows
from grasp_factory.factory.run_records import Summary
from grasp_factory.factory.run_request import Request, Shard
from grasp_factory.writers.zarr.budgets import check_block_size
from grasp_factory.writers.zarr.writer import MISSING, QUARANTINED

LARGEST = 512
"""Most episodes of a block in object storage, where each object costs a request."""
BLOCKS_OF_A_PART = 4
"""Least blocks of each part of a store, so that none has a quarter more than another."""
MADE_BY = 8
"""Episodes of a block while it is made, if that divides the store's own size."""
FOLDER = "uploads"
"""Folder of the cache in which stores wait until all of them is sent."""
_MADE, _PACKED = "made.zarr", "packed.zarr"


def generate_there(
    request: Request,
    make: Callable[[Request], Summary],
    check_platform: Callable[[Dataset, FactoryConfig], None],
    on_send: Callable[[int], None] = lambda rows: None,
) -> Summary:
    """Make the store of a request in object storage, at its ``out``.

    Its blocks are made in the cache of this machine, joined to blocks of up to ``LARGEST``
    episodes, and sent. The same call goes on where one before has ended. Each part of a store
    (``request.shard``) may be made on another machine: it has every ``count``-th of these blocks.

    Args:
        request: the request.
        make: makes the store of a request on this machine.
        check_platform: raises for a store that another platform has begun: see ``platform_check``.
        on_send: called with the number of episodes before they are sent.

    Raises:
        UsageError: for a server that ignores put-if-absent, or if another store is there, also one
            that another platform has begun.
        StorageError: if the server does not answer; what is made stays in the cache.
    """
    address = _address(request.out)
    there = _there(request, address)
    size = request.config.block_size
    config = replace(request.config, block_size=size if size % MADE_BY else MADE_BY)
    larger = _largest(config, request) if there is None else there.config.block_size
    scratch = _scratch(address, request.shard, request.n, request.config.sha256(), larger)
    if there is not None:
        if not (there.status[_rows(request, larger)] == MISSING).any():
            _remove(scratch)
            return _finished(request, there)
        check_platform(there, request.config)
    check_puts_once(Objects(address))
    scratch.mkdir(parents=True, exist_ok=True)
    part = replace(request, out=scratch / _MADE, config=config, shard=_joined(request, larger))
    summary = make(part)
    if summary.failed:
        return summary
    on_send(summary.asked)
    made = scratch / _MADE
    if larger > config.block_size:
        made = _packed(made, scratch, larger)
    try:
        upload(made, address)
    except StoreMismatchError:
        begun = _there(request, address)
        if begun is None or begun.config.block_size == larger:
            raise
        _remove(scratch)  # another machine has begun it meanwhile, in blocks of another size
        return generate_there(request, make, check_platform, on_send)
    _remove(scratch)
    return replace(summary, store=summarise(Dataset(address)))


def pack_there(
    store: Path,
    address: Path,
    block_size: int,
    *,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[], None] = lambda: None,
) -> Packed:
    """Pack a store to one in object storage; see ``pack_store`` and ``upload``.

    The new store waits in the cache of this machine until all of it is sent.
    """
    there = _address(address)
    check_puts_once(Objects(there))
    scratch = _scratch(there)
    scratch.mkdir(parents=True, exist_ok=True)
    packed = scratch / _PACKED
    if not _is_packed(store, packed, block_size):
        pack_store(store, packed, block_size, on_start=on_start, on_row=on_row)
    sent = upload(packed, there)
    origin = place_at(packed.with_name(packed.name + SUFFIX))
    if origin.is_file():
        put_once(Objects(there.parent), there.name + SUFFIX, origin.read_bytes(DOCUMENT))
    labels = tuple(Dataset(packed).labels)
    _remove(scratch)
    return Packed(
        path=str(there),
        rows=sent.rows,
        block_size=block_size,
        blocks=sent.blocks,
        resumed=sent.there_before,
        labels=labels,
    )


def _address(out: Path) -> RemotePath:
    if not isinstance(out, RemotePath):
        raise UsageError(f"{out} is no address of object storage")
    return out


def _scratch(address: RemotePath, *what: object) -> Path:
    """Return the folder for what is made for an address; what differs has another one."""
    name = " ".join(map(str, (endpoint(address), address, *what)))
    return cache_dir() / FOLDER / digest(name.encode())


def _remove(scratch: Path) -> None:
    if scratch.exists():
        place_at(scratch).rmtree()


def _joined(request: Request, block_size: int) -> Shard:
    """Return a request's part, whose blocks will be joined to those of a size."""
    return replace(request.shard, together=block_size if request.shard.count > 1 else 0)


def _rows(request: Request, block_size: int) -> NDArray[np.int64]:
    """Return the rows of a request's part, in a store with blocks of a size."""
    return shard_rows(replace(request, shard=_joined(request, block_size)))


def _largest(config: FactoryConfig, request: Request) -> int:
    """Return the largest size of blocks, up to ``LARGEST``, that readers accept.

    With several parts, there must be blocks enough for parts of nearly the same size.
    """
    size, parts = config.block_size, request.shard.count
    most = request.n // (BLOCKS_OF_A_PART * parts) if parts > 1 else LARGEST
    while size * 2 <= min(LARGEST, most):
        try:
            check_block_size(replace(config, block_size=size * 2))
        except ConfigError:
            break
        size *= 2
    return size


def _packed(made: Path, scratch: Path, block_size: int) -> Path:
    packed = scratch / _PACKED
    if not _is_packed(made, packed, block_size):
        pack_part(made, packed, block_size)
    return packed


def _is_packed(made: Path, packed: Path, block_size: int) -> bool:
    """Return whether a run before this one has packed these rows; remove what is older."""
    if not packed.exists():
        return False
    is_same = Dataset(packed).config.block_size == block_size and rows_sha256(
        packed
    ) == rows_sha256(made)
    if not is_same:
        place_at(packed).rmtree()
    return is_same


def _there(request: Request, address: RemotePath) -> Dataset | None:
    """Return the store of a request that is there, whole or in part; None if none is.

    Raises:
        StoreMismatchError: if another store is there, or one of another length.
    """
    try:
        there = Dataset(address)
    except StoreMismatchError:
        return None
    size = there.config.block_size
    asked = replace(request.config, block_size=size)
    different = first_difference(to_plain(there.config), to_plain(asked))
    if different:
        raise StoreMismatchError(
            f"{address} holds another store ({different}); choose another --out"
        )
    if len(there) != request.n:
        raise StoreMismatchError(
            f"{address} has {len(there)} episodes, asked for {request.n}: a store in object storage"
            " does not grow; make another one with another --seed, and read both"
        )
    return there


def _finished(request: Request, there: Dataset) -> Summary:
    """Return the summary of a part that is there as a whole.

    Raises:
        UsageError: if some of it shall be tried again.
    """
    part = _rows(request, there.config.block_size)
    rows = part[there.status[part] == QUARANTINED]
    if request.retry_quarantined and len(rows):
        raise UsageError(
            f"{there.paths[0]}: {count(len(rows), 'quarantined episode')} cannot be tried again: a"
            " store in object storage does not change; leave out --retry-quarantined"
        )
    errors = there.column("error")
    return Summary(
        asked=len(part),
        made=0,
        already_there=len(part),
        seconds=0.0,
        episodes_per_second=None,
        quarantined={int(row): str(errors[row]) for row in rows},
        failed=len(rows) > request.max_failures * len(part),
        store=summarise(there),
    )
