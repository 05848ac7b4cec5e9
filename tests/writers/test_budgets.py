"""Budgets: a store that readers would refuse is not begun, and the others are read."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import pytest
from numcodecs.zstd import compress
from support.fake_episodes import JOINTS, make_rows, small_config

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import VARIABLE, Limit
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, LimitError, StoreError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import budgets
from grasp_factory.writers.zarr.array_reader import ColumnFiles
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.store import check_place, prepare_store

LARGE = FactoryConfig(resolution=(1920, 1080), block_size=40)


def blocks_of(episodes: int) -> FactoryConfig:
    return dataclasses.replace(LARGE, block_size=episodes)


def test_the_largest_valid_block_is_read_and_a_larger_one_is_not_begun(tmp_path: Path) -> None:
    path = tmp_path / "s.zarr"
    with pytest.raises(ConfigError, match=r"^block_size: got 40, valid: up to \d+ ") as caught:
        check_place(path, LARGE)
    (valid,) = map(int, re.findall(r"up to (\d+) with", str(caught.value)))
    with pytest.raises(ConfigError, match=f"valid: up to {valid} "):
        check_place(path, blocks_of(valid + 1))
    check_place(path, blocks_of(valid))
    prepare_store(path, blocks_of(valid), JOINTS, 100, {})
    assert len(Dataset(path)) == 100


def test_a_raised_limit_allows_larger_blocks_to_be_begun_and_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "s.zarr"
    prepare_store(path, LARGE, JOINTS, 100, {})
    with pytest.raises(LimitError, match=r"a block of episodes.* --limit block=SIZE"):
        Dataset(path)
    monkeypatch.setenv(VARIABLE, "block=2GiB")
    check_place(tmp_path / "new.zarr", LARGE)
    assert len(Dataset(path)) == 100


def test_a_video_of_more_frames_than_readers_accept_is_not_begun(tmp_path: Path) -> None:
    slow = FactoryConfig.from_plain(
        {"video_hz": 240, "resolution": [32, 24], "block_size": 1, "motion": {"lift_speed": 0.02}}
    )
    with pytest.raises(ConfigError, match=r"^video_hz: got 240, valid: lower: .* accept 4000"):
        check_place(tmp_path / "s.zarr", slow)
    check_place(tmp_path / "s.zarr", dataclasses.replace(slow, video_hz=10))


def test_parameters_that_would_make_recipes_too_long_for_readers_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = dataclasses.replace(LARGE, block_size=4, policy_parameters={"x": {"y": "z" * 40_000}})
    with pytest.raises(ConfigError, match=r"^policy_parameters: got '40,016 bytes"):
        check_place(tmp_path / "s.zarr", config)
    monkeypatch.setenv(VARIABLE, "word=1MiB")
    check_place(tmp_path / "s.zarr", config)


def test_a_store_that_was_begun_already_is_continued(tmp_path: Path) -> None:
    prepare_store(tmp_path / "s.zarr", LARGE, JOINTS, 100, {})
    check_place(tmp_path / "s.zarr", LARGE)


def test_small_images_are_never_refused(tmp_path: Path) -> None:
    check_place(tmp_path / "s.zarr", dataclasses.replace(small_config(), block_size=1024))


def edit(path: Path, name: str, **changed: Any) -> None:
    """Change an array's metadata; ``chunks`` are the shape of its files."""
    file = path / name / "zarr.json"
    document = json.loads(file.read_text())
    if chunks := changed.pop("chunks", None):
        document["chunk_grid"]["configuration"]["chunk_shape"] = chunks
    file.write_text(json.dumps(document | changed))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Return a store of 4 blocks of 4 rows."""
    config = small_config(resolution=(16, 16))
    prepare_store(tmp_path / "s.zarr", config, JOINTS, 16, {})
    for block in range(4):
        ZarrWriter(tmp_path / "s.zarr").write_block(block, make_rows(config, block, 16))
    return tmp_path / "s.zarr"


def test_a_block_is_counted_as_a_whole_whatever_its_chunks_are(tmp_path: Path) -> None:
    path = tmp_path / "s.zarr"
    prepare_store(path, LARGE, JOINTS, 100, {})
    for name in LARGE.cameras:
        for kind, tail in (("rgb", [3]), ("depth", []), ("segmentation", [])):
            edit(path, f"cameras/{name}/{kind}", chunks=[1, 2, 1080, 1920, *tail])
    with pytest.raises(LimitError, match="a block of episodes"):
        Dataset(path)


@pytest.mark.parametrize(
    ("name", "chunks", "said"),
    [
        ("episodes/seed", [20_000], "episodes/seed: a number of rows of a chunk of 20,000"),
        ("episodes/object_ids", [4, 2_000_000], "episodes/object_ids: a chunk of 512.0 MB"),
        ("cameras/front/rgb", [4, 2, 16, 16, 3], ""),
        ("cameras/front/rgb", [9999, 2, 16, 16, 3], "a number of chunks of 19,998"),
    ],
)
def test_chunks_are_measured_before_they_are_read(
    small: Path, name: str, chunks: list[int], said: str
) -> None:
    edit(small, name, chunks=chunks)
    if not said:
        assert len(Dataset(small)) == 16
        return
    with pytest.raises(LimitError, match=said):
        Dataset(small)


def test_a_text_that_missing_rows_have_is_refused(small: Path) -> None:
    edit(small, "episodes/policy", fill_value="x" * 1000)
    with pytest.raises(StoreError, match=r"policy has the fill value '.*', valid: an empty text"):
        Dataset(small)


def test_the_text_of_columns_is_counted_while_it_is_read(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = Columns.open(small)
    size = sum(len(word) for word in columns.read("checksum")["checksum"].tolist())
    monkeypatch.setattr(budgets, "WORDS", Limit("words", size, "the text"))
    columns.read("checksum", "seed")
    with pytest.raises(LimitError, match="the text of "):
        columns.read("checksum", "policy")


def test_a_column_of_too_many_values_is_refused(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(budgets, "COLUMN", Limit("column", 16 * 8, "a column"))
    columns = Columns.open(small)
    assert len(columns.read("seed")["seed"]) == 16
    with pytest.raises(LimitError, match="grasp_position: a column of 384"):
        columns.read("grasp_position")


def test_a_chunk_of_many_blocks_is_decoded_once(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    want = Dataset(small).column("seed")
    edit(small, "episodes/seed", chunks=[16])
    (small / "episodes/seed/0").write_bytes(compress(want.tobytes(), 1))
    reads: list[int] = []
    read = ColumnFiles._read_file

    def counted(array: ColumnFiles, file: int, *rest: Any) -> None:
        reads.append(file)
        read(array, file, *rest)

    monkeypatch.setattr(ColumnFiles, "_read_file", counted)
    assert Columns.open(small).read("seed")["seed"].tolist() == want.tolist()
    assert reads == [0]
