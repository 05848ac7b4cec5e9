"""Making a store in object storage: some of it is made and packed in the cache, then sent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path

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
from grasp_factory.curation.upload.stages import (
    config_here,
    joined,
    largest_block,
    rows_of,
    stages_of,
)
from grasp_factory.curation.upload.uploading import upload
from grasp_factory.curation.versions.origin import SUFFIX
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.snapshots.version import rows_sha256
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import StoreMismatchError, UsageError
from grasp_factory.factory.run_records import Summary
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.zarr.writer import MISSING, QUARANTINED

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
    episodes, and sent, about ``STAGE`` episodes at a time, so that the cache needs room for no
    more. The same call goes on where one before has ended, also on another machine. Each part of a
    store (``request.shard``) may be made on another machine: it has every ``count``-th of these
    blocks.

    Args:
        request: the request.
        make: makes the store of a request on this machine; called for each stage.
        check_platform: raises for a store that another platform has begun: see ``platform_check``.
        on_send: called with the number of episodes before they are sent.

    Raises:
        UsageError: for a server that ignores put-if-absent, or if another store is there, also one
            that another platform has begun.
        StorageError: if the server does not answer; what is made stays in the cache.
    """
    address = _address(request.out)
    there = _there(request, address)
    larger = largest_block(request) if there is None else there.config.block_size
    stages = stages_of(request, larger)
    if there is not None:
        is_missing = there.status == MISSING
        whole = [not is_missing[rows_of(stage, larger)].any() for stage in stages]
        for stage in compress(stages, whole):
            _remove(_scratch_of(stage, larger))
        if all(whole):
            return _finished(request, there)
        stages = [stage for stage, is_whole in zip(stages, whole, strict=True) if not is_whole]
        check_platform(there, request.config)
    check_puts_once(Objects(address))
    done: list[Summary] = []
    for stage in stages:
        summary = _make_and_send(stage, larger, make, on_send)
        if summary is None:  # another machine has begun it meanwhile, in blocks of another size
            return generate_there(request, make, check_platform, on_send)
        if summary.failed:
            return summary
        done.append(summary)
    return _joined_summary(request, done, Dataset(address))


def _make_and_send(
    request: Request,
    larger: int,
    make: Callable[[Request], Summary],
    on_send: Callable[[int], None],
) -> Summary | None:
    """Make a stage of a part and send it; return None if there are blocks of another size."""
    address, scratch = _address(request.out), _scratch_of(request, larger)
    scratch.mkdir(parents=True, exist_ok=True)
    made, config = scratch / _MADE, config_here(request)
    summary = make(replace(request, out=made, config=config, shard=joined(request, larger)))
    if summary.failed:
        return summary
    on_send(summary.asked)
    if larger > config.block_size:
        made = _packed(made, scratch, larger)
    try:
        upload(made, address)
    except StoreMismatchError:
        begun = _there(request, address)
        if begun is None or begun.config.block_size == larger:
            raise
        _remove(scratch)
        return None
    _remove(scratch)
    return summary


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


def _scratch_of(request: Request, larger: int) -> Path:
    """Return the folder of a stage that will have blocks of a size."""
    what = request.shard, request.n, request.config.sha256(), larger
    return _scratch(_address(request.out), *what)


def _remove(scratch: Path) -> None:
    if scratch.exists():
        place_at(scratch).rmtree()


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
    summary = _joined_summary(request, [], there)
    if request.retry_quarantined and summary.quarantined:
        quarantined = count(len(summary.quarantined), "quarantined episode")
        raise UsageError(
            f"{there.paths[0]}: {quarantined} cannot be tried again: a store in object storage does"
            " not change; leave out --retry-quarantined"
        )
    return summary


def _joined_summary(request: Request, stages: Sequence[Summary], there: Dataset) -> Summary:
    """Return the summary of a part that is there, some stages of which this run has sent."""
    part = rows_of(request, there.config.block_size)
    rows = part[there.status[part] == QUARANTINED]
    errors = there.column("error")
    made, seconds = (sum(getattr(stage, name) for stage in stages) for name in ("made", "seconds"))
    return Summary(
        asked=len(part),
        made=made,
        already_there=len(part) - made,
        seconds=round(seconds, 3),
        episodes_per_second=round(made / seconds, 3) if made else None,
        quarantined={int(row): str(errors[row]) for row in rows},
        failed=len(rows) > request.max_failures * len(part),
        store=summarise(there),
    )
