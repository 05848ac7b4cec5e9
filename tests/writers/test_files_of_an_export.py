"""How many files an export has whose parts are files: enough for workers, or as the user asks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.exporter_contract import make_store

from grasp_factory.curation.restore import restore
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters import EXPORTERS
from grasp_factory.writers.exporters.base import episodes_of_each_file
from grasp_factory.writers.exporters.exporting import run_export
from grasp_factory.writers.exporters.selection import select


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> list[Dataset]:
    """Return four stores of five episodes each."""
    folder = tmp_path_factory.mktemp("stores")
    return [make_store(folder / f"{seed}.zarr", seed=seed) for seed in range(4)]


@pytest.mark.parametrize(
    ("episodes", "each"), [(1, 8), (20, 8), (64, 8), (100, 13), (192, 24), (512, 64), (10**6, 64)]
)
def test_there_are_eight_files_if_each_has_8_to_64_episodes(episodes: int, each: int) -> None:
    assert episodes_of_each_file(episodes, 0) == each
    assert episodes_of_each_file(episodes, 5) == 5


@pytest.mark.parametrize("name", ["gqcnn", "lerobot", "webdataset"])
def test_formats_whose_parts_are_files_have_so_many(stores: list[Dataset], name: str) -> None:
    chosen = select([(store, store.committed.tolist()) for store in stores])
    exporter = EXPORTERS[name]
    parts = exporter.split(chosen, exporter.settings({}))
    assert [len(part) for part in parts] == [8, 8, 4]


def test_episodes_of_each_file_are_read_back(stores: list[Dataset], tmp_path: Path) -> None:
    chosen = [(store, store.committed.tolist()) for store in stores]
    run_export(EXPORTERS["lerobot"], chosen, tmp_path / "out", {"video": "image"})
    restore(tmp_path / "out", tmp_path / "store.zarr")
    after = Dataset(tmp_path / "store.zarr", checked=True)
    before = [episode for store in stores for episode in store.iter_episodes(store.committed)]
    for old, new in zip(before, after, strict=True):
        values = [episode.contents()["videos/front/rgb"] for episode in (old, new)]
        np.testing.assert_array_equal(*values)
        values = [episode.contents()["streams/wrist_wrench"] for episode in (old, new)]
        np.testing.assert_array_equal(*values)
