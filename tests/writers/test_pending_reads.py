"""A read of several chunks of which one is damaged: the others are not read any more."""

from __future__ import annotations

import asyncio
import gc
import threading
from pathlib import Path

import numpy as np
import pytest
import zarr
from zarr.core import sync

from grasp_factory.core.place import place_of
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.header import read_array

CHUNKS = 500


@pytest.fixture
def damaged(tmp_path: Path) -> zarr.Array:
    """Return an array whose first chunk is cut."""
    (tmp_path / "a").mkdir()
    store = AtomicStore(place_of(tmp_path / "a"))
    array = zarr.create_array(store, shape=(CHUNKS,), chunks=(1,), dtype="uint8")
    array[:] = np.ones(CHUNKS, np.uint8)
    (tmp_path / "a/c/0").write_bytes(b"")
    return array


def pending() -> set[asyncio.Task[object]]:
    loop = sync.loop[0]
    assert loop is not None
    return {task for task in asyncio.all_tasks(loop) if not task.done()}


def test_a_read_that_fails_leaves_no_task_behind(damaged: zarr.Array) -> None:
    with pytest.raises(StoreError, match="cannot be read"):
        read_array(damaged)
    assert not pending()


class Content(bytes):
    """The bytes of a file; counts those that are in memory."""

    alive = 0

    def __init__(self, data: bytes) -> None:
        Content.alive += 1

    def __del__(self) -> None:
        Content.alive -= 1


def test_a_chunk_that_could_not_be_read_does_not_stay_in_memory(
    damaged: zarr.Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(AtomicStore, "read", lambda store, key, part=None: Content(b"damaged"))
    gc.disable()
    try:
        for _ in range(3):
            with pytest.raises(StoreError, match="cannot be read"):
                read_array(damaged, slice(0, 1))
        assert Content.alive == 0
    finally:
        gc.enable()


def test_reads_of_other_threads_are_not_cancelled(damaged: zarr.Array) -> None:
    found: list[int] = []

    def read_others() -> None:
        for _ in range(3):
            found.append(int(read_array(damaged, slice(1, CHUNKS)).sum()))

    reader = threading.Thread(target=read_others)
    reader.start()
    with pytest.raises(StoreError, match="cannot be read"):
        read_array(damaged)
    reader.join()
    assert found == [CHUNKS - 1] * 3
    assert not pending()
