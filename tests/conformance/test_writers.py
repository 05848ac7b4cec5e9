"""The contract of a writer, which every row of ``WRITERS`` keeps.

- It takes blocks in any order, the last one short, and replaces a block that is written again.
- What it keeps is what it was given: episodes bit by bit, and the recipe and the reason of a
  quarantined row.
- It refuses rows that are not those of the block, all of them, and says which are valid.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_episodes import JOINTS, make_rows, make_spec, small_config

from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError
from grasp_factory.writers import WRITERS, ZarrWriter
from grasp_factory.writers.base import Quarantined, Writer
from grasp_factory.writers.memory import MemoryWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(block_size=2)
N = 5  # blocks 0, 1 and a short 2


def open_zarr(path: Path) -> Writer:
    prepare_store(path, CONFIG, JOINTS, N, {})
    return ZarrWriter(path)


def read_zarr(writer: Any) -> dict[int, Episode | Quarantined]:
    dataset = Dataset(writer.path)
    rows: dict[int, Episode | Quarantined] = {int(i): dataset[i] for i in dataset.committed}
    for i in np.flatnonzero(dataset.status == 2):
        rows[int(i)] = Quarantined(dataset.spec(i), str(dataset.column("error")[i]))
    return rows


def read_memory(writer: Any) -> dict[int, Episode | Quarantined]:
    return {row.spec.index: row for rows in writer.blocks.values() for row in rows}


HARNESSES: dict[str, tuple[Callable[[Path], Writer], Callable[[Any], dict[int, Any]]]] = {
    "zarr": (open_zarr, read_zarr),
    "memory": (lambda path: MemoryWriter(path, block_size=CONFIG.block_size), read_memory),
}
"""Writer name to how a test opens one with blocks of 2, and reads back what it keeps."""


def test_every_writer_has_a_harness_here() -> None:
    assert sorted(HARNESSES) == sorted(WRITERS)


@pytest.mark.parametrize("name", WRITERS)
class TestEveryWriter:
    @pytest.fixture
    def writer(self, name: str, tmp_path: Path) -> Writer:
        return HARNESSES[name][0](tmp_path / "out")

    @pytest.fixture
    def read(self, name: str) -> Callable[[Any], dict[int, Any]]:
        return HARNESSES[name][1]

    def test_gives_back_what_it_was_given(self, writer: Writer, read: Any) -> None:
        rows = make_rows(CONFIG, 0, N)
        writer.write_block(0, rows)
        back = read(writer)
        assert [back[i].checksum() for i in range(2)] == [row.checksum() for row in rows]
        assert [back[i].spec for i in range(2)] == [row.spec for row in rows]

    def test_keeps_the_recipe_and_the_reason_of_a_quarantined_row(
        self, writer: Writer, read: Any
    ) -> None:
        rows = make_rows(CONFIG, 1, N, quarantined=(3,))
        writer.write_block(1, rows)
        assert read(writer)[3] == Quarantined(make_spec(CONFIG, 3), "no luck with 3")

    def test_takes_blocks_in_any_order(self, writer: Writer, read: Any) -> None:
        for block in (2, 0, 1):
            writer.write_block(block, make_rows(CONFIG, block, N))
        assert sorted(read(writer)) == [0, 1, 2, 3, 4]

    def test_replaces_a_block_that_is_written_again(self, writer: Writer, read: Any) -> None:
        writer.write_block(0, make_rows(CONFIG, 0, N, quarantined=(0, 1)))
        writer.write_block(0, make_rows(CONFIG, 0, N))
        assert all(isinstance(row, Episode) for row in read(writer).values())

    def test_takes_a_short_block(self, writer: Writer, read: Any) -> None:
        writer.write_block(2, make_rows(CONFIG, 2, N))
        assert list(read(writer)) == [4]

    @pytest.mark.slow
    @pytest.mark.parametrize("indices", [[], [1], [1, 2], [0, 0], [0, 2], [0, 1, 2]])
    def test_refuses_rows_that_are_not_the_block(
        self, writer: Writer, read: Any, indices: list[int]
    ) -> None:
        rows = [Quarantined(make_spec(CONFIG, i), "") for i in indices]
        with pytest.raises(StoreError) as caught:
            writer.write_block(0, rows)
        valid = "1 to 2 consecutive episodes from 0 on"
        assert str(caught.value) == f"block 0: got episodes {indices}, valid: {valid}"
        assert read(writer) == {}
