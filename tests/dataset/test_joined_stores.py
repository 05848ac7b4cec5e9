"""Several stores as one dataset: its rows are theirs, one after another."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree

from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Make three stores with other seeds and sizes of blocks; one has a missing block."""
    folder, out = tmp_path_factory.mktemp("stores"), []
    for seed, (n, size) in enumerate([(6, 4), (5, 2), (4, 4)]):
        config = small_config(seed=seed, block_size=size)
        path = folder / f"{seed}.zarr"
        prepare_store(path, config, JOINTS, n, {})
        for block in range(-(-n // size) - (seed == 1)):
            rows = make_rows(config, block, n, quarantined=(1,))
            ZarrWriter(path).write_block(block, rows)
        out.append(path)
    AnnotationLog(out[2]).append("me", [3], [("tag", "fine")])
    return out


def test_every_row_is_that_of_its_store(stores: list[Path]) -> None:
    joined, single = Dataset(stores, checked=True), [Dataset(path) for path in stores]
    assert joined.starts.tolist() == [0, 6, 11, 15]
    for name in joined.columns:
        parts = [dataset.column(name) for dataset in single]
        np.testing.assert_array_equal(joined.column(name), np.concatenate(parts))
    for index in joined.committed.tolist():
        path, row = joined.stored_at(index)
        mine, other = joined[index].contents(), Dataset(path)[row].contents()
        assert mine.keys() == other.keys()
        for array, values in mine.items():
            np.testing.assert_array_equal(values, other[array])
    assert [episode.spec.seed for episode in joined] == [0] * 5 + [1] * 3 + [2] * 3
    assert list(joined.annotations) == [14]


def test_views_and_images_cross_the_stores(stores: list[Path]) -> None:
    joined = Dataset(stores)
    view = pickle.loads(pickle.dumps(joined.shuffle(3)))
    images = view.images(range(len(view)), "front", "rgb", 1)
    for k in range(len(view)):
        path, row = view.stored_at(k)
        np.testing.assert_array_equal(images[k], Dataset(path).image(row, "front", "rgb", 1))
    assert view.tagged("fine").indices.tolist() == [14]
    assert len(joined.where(success=True)) + len(joined.where(success=False)) == len(view)


def test_what_needs_one_store_says_so(stores: list[Path]) -> None:
    with pytest.raises(UsageError, match="got 3 stores, valid: one"):
        Dataset(stores).arrays()


def test_an_export_has_the_chosen_episodes_store_by_store(
    stores: list[Path], tmp_path: Path, run: Run
) -> None:
    joined = Dataset(stores)
    joined.export("sequences", tmp_path / "all")
    assert run("export", *stores, tmp_path / "told", "--to", "sequences")[0] == 0
    assert_same_tree(tmp_path / "all", tmp_path / "told")
    joined.select([14, 0, 8, 3]).export("sequences", tmp_path / "few")
    lines = (tmp_path / "few" / "grasp_factory_episodes.jsonl").read_text().splitlines()
    rows = [(line["store"], line["row"]) for line in map(json.loads, lines)]
    assert rows == [(0, 0), (0, 3), (1, 2), (2, 3)]


def test_info_adds_the_stores_and_shows_each(stores: list[Path], run: Run) -> None:
    single = [summarise(Dataset(path)) for path in stores]
    code, said, _ = run("info", *stores, "--json")
    told = json.loads(said)
    assert (code, told["stores"]) == (0, to_plain(single))
    for key in ("episodes", "committed", "missing", "quarantined", "successes", "bytes"):
        assert told[key] == sum(getattr(summary, key) for summary in single)
    assert sum(told["outcomes"].values()) == told["committed"]
    said = run("info", *stores)[1]
    assert said.startswith(f"{stores[0]} and 2 more: 11 episodes")
    assert all(any(line.startswith(str(path)) for line in said.splitlines()) for path in stores)
    code, said, told = run("info", *stores, "--full")
    assert (code, said, told) == (2, "", "Error: --full: valid for one store only\n")


def test_stores_of_different_kinds_are_refused(stores: list[Path], tmp_path: Path) -> None:
    prepare_store(tmp_path / "a.zarr", small_config(record_hz=20), JOINTS, 4, {})
    with pytest.raises(UsageError, match=r"of different kinds: record_hz: 10 against 20"):
        Dataset([stores[0], tmp_path / "a.zarr"])
    with pytest.raises(UsageError, match="named twice"):
        Dataset([stores[0], stores[0]])
    with pytest.raises(UsageError, match="no stores"):
        Dataset([])
