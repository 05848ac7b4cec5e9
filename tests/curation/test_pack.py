"""Packing: the bytes of a store that was made with larger blocks, or nothing at all."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from click.testing import CliRunner
from support.fake_episodes import JOINTS, make_episode, make_spec, small_config
from support.helpers import assert_same_tree, tree
from support.scale import sampled
from support.stored import old_store, varied

from grasp_factory.cli.main import cli
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.place import place_at
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation.merge import merge, split
from grasp_factory.curation.pack import block_joining, pack_store
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreError, StoreMismatchError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.encoding import packed_shard
from grasp_factory.writers.zarr.label_columns import write_label
from grasp_factory.writers.zarr.shard_joining import join_shards
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=[16, 16], video_hz=10)
BAD = (1, 5, 13)
"""Quarantined rows."""


@cache
def row_of(seed: int, index: int) -> Any:
    """Return a row with a video, of several lengths; making it takes longer than writing it."""
    config = replace(CONFIG, seed=seed)
    if index in BAD:
        return Quarantined(make_spec(config, index), f"no luck with {index}")
    return make_episode(config, index, n_steps=index % 4)


def make_store(path: Path, n: int, block_size: int = 4, seed: int = 0) -> Path:
    """Make a store directly with blocks of a size."""
    config = replace(CONFIG, seed=seed, block_size=block_size)
    prepare_store(path, config, JOINTS, n, {})
    writer = ZarrWriter(path)
    for start in range(0, n, block_size):
        rows = [row_of(seed, i) for i in range(start, min(start + block_size, n))]
        writer.write_block(start // block_size, rows)
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_store(tmp_path_factory.mktemp("made") / "s.zarr", 14)


@pytest.fixture
def store(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "s.zarr"))


class TestEqualToDirectGeneration:
    @pytest.mark.parametrize("n", [1, 4, 7, 8, 14, 16])
    @pytest.mark.parametrize("size", sampled([64, 12, 8, 512], 2))
    def test_with_videos_quarantined_rows_and_short_tails(
        self, tmp_path: Path, n: int, size: int
    ) -> None:
        pack_store(make_store(tmp_path / "s.zarr", n), tmp_path / "packed.zarr", size)
        make_store(tmp_path / "direct.zarr", n, size)
        assert_same_tree(tmp_path / "packed.zarr", tmp_path / "direct.zarr")

    def test_in_two_steps_as_in_one(self, store: Path, tmp_path: Path) -> None:
        pack_store(store, tmp_path / "a.zarr", 8)
        pack_store(tmp_path / "a.zarr", tmp_path / "b.zarr", 16)
        pack_store(store, tmp_path / "c.zarr", 16)
        assert_same_tree(tmp_path / "b.zarr", tmp_path / "c.zarr")

    def test_of_merged_stores_as_merging_packed_ones(self, store: Path, tmp_path: Path) -> None:
        other = make_store(tmp_path / "o.zarr", 6, seed=5)
        merge([store, other], tmp_path / "m.zarr")
        pack_store(tmp_path / "m.zarr", tmp_path / "packed.zarr", 8)
        for name in ("s", "o"):
            pack_store(tmp_path / f"{name}.zarr", tmp_path / f"{name}8.zarr", 8)
        merge([tmp_path / "s8.zarr", tmp_path / "o8.zarr"], tmp_path / "m8.zarr")
        assert_same_tree(tmp_path / "packed.zarr", tmp_path / "m8.zarr")

    @pytest.mark.slow
    def test_of_a_simulated_store_every_episode_is_whole(self, tmp_path: Path) -> None:
        pack_store(varied(), tmp_path / "packed.zarr", 64)
        assert verify(tmp_path / "packed.zarr", workers=1).is_whole
        before, after = Dataset(varied()), Dataset(tmp_path / "packed.zarr")
        assert before.column("checksum").tolist() == after.column("checksum").tolist()

    def test_with_packed_segments(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", 1)
        pack_store(store, tmp_path / "packed.zarr", 8)
        segment_packing.pack(make_store(tmp_path / "direct.zarr", 14, 8))
        assert (tmp_path / "packed.zarr/packed").is_dir()
        assert_same_tree(tmp_path / "packed.zarr", tmp_path / "direct.zarr")

    def test_it_grows_on_like_such_a_store(self, store: Path, tmp_path: Path) -> None:
        pack_store(store, tmp_path / "packed.zarr", 8)
        make_store(tmp_path / "packed.zarr", 17, 8)
        make_store(tmp_path / "direct.zarr", 17, 8)
        assert_same_tree(tmp_path / "packed.zarr", tmp_path / "direct.zarr")

    def test_plain_zarr_opens_it(self, store: Path, tmp_path: Path) -> None:
        pack_store(store, tmp_path / "packed.zarr", 8)
        a, b = (zarr.open(path, mode="r") for path in (store, tmp_path / "packed.zarr"))
        for name in ("cameras/front/rgb", "streams/tcp_pose", "videos/front/rgb"):
            assert np.asarray(a[name][:]).tobytes() == np.asarray(b[name][:]).tobytes()


def test_labels_and_annotations_are_copied(store: Path, tmp_path: Path) -> None:
    write_label(store, "strict", np.arange(14, dtype=np.uint8) % 3, to_plain(LabelConfig()))
    AnnotationLog(store).append("ann", [3], [("tag", "odd")])
    packed = pack_store(store, tmp_path / "packed.zarr", 8)
    found = Dataset(tmp_path / "packed.zarr")
    assert packed.labels == ("strict",)
    assert found.label("strict").tolist() == Dataset(store).label("strict").tolist()
    assert found.tagged("odd").indices.tolist() == [3]


def test_the_source_stays_as_it_is(store: Path, tmp_path: Path) -> None:
    before = tree(store)
    pack_store(store, tmp_path / "packed.zarr", 8)
    assert tree(store) == before


class TestRefusals:
    @pytest.mark.parametrize("size", [4, 2, 6, 0, -8])
    def test_only_larger_multiples_are_valid(self, store: Path, tmp_path: Path, size: int) -> None:
        with pytest.raises(UsageError, match="valid: a larger multiple of 4"):
            pack_store(store, tmp_path / "packed.zarr", size)

    def test_blocks_have_at_most_1024_rows(self, store: Path, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="1 to 1024"):
            pack_store(store, tmp_path / "packed.zarr", 2048)

    def test_missing_rows_are_named(self, store: Path, tmp_path: Path) -> None:
        (store / "episodes/status/1").unlink()
        with pytest.raises(StoreMismatchError, match=r"4 of 14 rows of .* are missing"):
            pack_store(store, tmp_path / "packed.zarr", 8)

    def test_nothing_is_overwritten(self, store: Path, tmp_path: Path) -> None:
        (tmp_path / "packed.zarr").mkdir()
        (tmp_path / "packed.zarr/mine").touch()
        with pytest.raises(StoreMismatchError, match="only new stores are made"):
            pack_store(store, tmp_path / "packed.zarr", 8)

    def test_a_store_of_an_old_version_is_packed_or_refused_in_a_line(self, tmp_path: Path) -> None:
        path = old_store(tmp_path)
        size = 2 * Dataset(path).config.block_size
        try:
            pack_store(path, tmp_path / "packed.zarr", size)
        except UsageError as error:
            assert "\n" not in str(error)
        else:
            same = [
                Dataset(p).column("checksum").tolist() for p in (path, tmp_path / "packed.zarr")
            ]
            assert same[0] == same[1]

    def test_an_array_that_was_rewritten_is_refused(self, store: Path, tmp_path: Path) -> None:
        file = store / "streams/reward/zarr.json"
        text = file.read_text()
        assert '"level": 1' in text
        file.write_text(text.replace('"level": 1', '"level": 3'))
        with pytest.raises(StoreMismatchError, match="streams/reward has another layout"):
            pack_store(store, tmp_path / "packed.zarr", 8)

    @pytest.mark.parametrize(
        "name", ["cameras/front/rgb/1.0.0.0.0", "streams/reward/0.0", "videos/front/rgb/3.0.0.0.0"]
    )
    @pytest.mark.parametrize("damage", ["cut", "index"])
    def test_a_damaged_shard_is_named_and_nothing_is_there(
        self, store: Path, tmp_path: Path, name: str, damage: str
    ) -> None:
        data = (store / name).read_bytes()
        cut = data[: len(data) // 2] if damage == "cut" else data[:-8] + bytes(8)
        (store / name).write_bytes(cut)
        with pytest.raises(StoreError, match=name.rpartition("/")[0]):
            pack_store(store, tmp_path / "packed.zarr", 8)
        assert not (tmp_path / "packed.zarr").exists()

    def test_a_shard_that_is_missing_is_named(self, store: Path, tmp_path: Path) -> None:
        (store / "streams/reward/1.0").unlink()
        with pytest.raises(StoreError, match="streams/reward of rows 0 to 7"):
            pack_store(store, tmp_path / "packed.zarr", 8)


class TestHostileShards:
    def test_chunks_that_lie_over_each_other_are_refused(self, tmp_path: Path) -> None:
        piece = np.zeros(64, np.uint8)
        good = packed_shard([piece, piece], 2, 1)
        index = np.frombuffer(good[-36:-4], "<u8").reshape(2, 2).copy()
        index[1] = index[0]
        self.refused(tmp_path, good[:-36], index)

    def test_a_chunk_that_is_too_long_is_refused(self, tmp_path: Path) -> None:
        self.refused(tmp_path, bytes(10**6), np.array([[0, 10**6], [2**64 - 1, 2**64 - 1]], "<u8"))

    def test_lengths_whose_sum_overflows_are_refused(self, tmp_path: Path) -> None:
        self.refused(tmp_path, b"", np.array([[0, 2**63], [2**63, 2**63]], "<u8"))

    def test_gaps_are_refused(self, tmp_path: Path) -> None:
        absent = 2**64 - 1
        self.refused(tmp_path, bytes(10), np.array([[absent, absent], [0, 10]], "<u8"))
        self.refused(tmp_path, bytes(10), np.array([[2, 8], [absent, absent]], "<u8"))

    def refused(self, folder: Path, data: bytes, index: Any) -> None:
        import google_crc32c

        table = index.tobytes()
        crc = google_crc32c.value(table).to_bytes(4, "little")
        (folder / "a").write_bytes(data + table + crc)
        places = [place_at(folder / name) for name in ("a", "b")]
        with pytest.raises(ValueError, match="do not follow one another"):
            join_shards([places[0]], places[1], chunks=2, room=4, chunk_bytes=64)
        assert sorted(p.name for p in folder.iterdir()) == ["a"]


class TestInterruptions:
    def test_a_run_that_ended_early_goes_on(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        out = tmp_path / "packed.zarr"
        stop_at(monkeypatch, 1)
        with pytest.raises(KeyboardInterrupt):
            pack_store(store, out, 8)
        assert not out.exists()
        monkeypatch.undo()
        assert pack_store(store, out, 8).resumed == 1
        assert_same_tree(out, make_store(tmp_path / "direct.zarr", 14, 8))
        assert not list(tmp_path.glob(".packed*"))

    def test_another_source_or_size_begins_again(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        out, other = tmp_path / "packed.zarr", make_store(tmp_path / "o.zarr", 14, seed=5)
        for source, size in ((other, 8), (store, 12)):
            stop_at(monkeypatch, 1)
            with pytest.raises(KeyboardInterrupt):
                pack_store(source, out, size)
            monkeypatch.undo()
        assert pack_store(store, out, 8).resumed == 0
        assert_same_tree(out, make_store(tmp_path / "direct.zarr", 14, 8))

    def test_a_place_that_is_an_empty_directory_is_kept(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        out = tmp_path / "packed.zarr"
        out.mkdir()
        inode = out.stat().st_ino
        stop_at(monkeypatch, 1)
        with pytest.raises(KeyboardInterrupt):
            pack_store(store, out, 8)
        monkeypatch.undo()
        assert not (out / "zarr.json").exists()
        pack_store(store, out, 8)
        assert out.stat().st_ino == inode
        assert_same_tree(out, make_store(tmp_path / "direct.zarr", 14, 8))

    def test_a_foreign_file_in_the_way_is_not_removed(self, store: Path, tmp_path: Path) -> None:
        mine = tmp_path / ".packed.zarr.packing" / "notes.txt"
        mine.parent.mkdir()
        mine.write_text("mine")
        with pytest.raises(StoreMismatchError, match=r"notes\.txt; move it"):
            pack_store(store, tmp_path / "packed.zarr", 8)
        assert mine.read_text() == "mine"

    @pytest.mark.slow
    @pytest.mark.filterwarnings("ignore::grasp_factory.errors.StaleLockWarning")
    @pytest.mark.parametrize("part", sampled([k / 10 for k in range(10)], 3))
    def test_killed_at_any_instant_it_is_whole_or_not_there(
        self, store: Path, tmp_path: Path, part: float
    ) -> None:
        out = tmp_path / "packed.zarr"
        code = (
            "import sys; from grasp_factory.curation.pack import pack_store; print(flush=True);"
            "pack_store(sys.argv[1], sys.argv[2], 8); print('done', flush=True)"
        )
        command = [sys.executable, "-c", code, str(store), str(out)]
        started = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.PIPE) as whole:
            assert whole.stdout
            whole.stdout.readline()
            started = time.monotonic()
            whole.stdout.readline()
        lasted = time.monotonic() - started
        expected = tree(out)
        shutil.rmtree(out)
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout
            process.stdout.readline()
            time.sleep(part * lasted)
            os.kill(process.pid, signal.SIGKILL)
        if out.exists():
            assert tree(out) == expected
            return
        pack_store(store, out, 8)
        assert tree(out) == expected
        assert not list(tmp_path.glob(".packed.zarr.packing*"))


def stop_at(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    """Let Ctrl-C come when a block is joined."""
    join: Callable[..., None] = block_joining.BlockJoiner.join

    def stopped(self: Any, number: int) -> None:
        if number == block:
            raise KeyboardInterrupt
        join(self, number)

    monkeypatch.setattr(block_joining.BlockJoiner, "join", stopped)


def test_the_command_says_what_it_made(store: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(cli, ["pack", str(store), str(tmp_path / "p.zarr"), "--shard", "8"])
    assert done.exit_code == 0, done.output
    assert "14 rows in 2 blocks" in done.output


def test_split_of_a_packed_store_has_its_block_size(store: Path, tmp_path: Path) -> None:
    pack_store(store, tmp_path / "packed.zarr", 8)
    split(tmp_path / "packed.zarr", tmp_path / "few.zarr", [0, 3])
    assert Dataset(tmp_path / "few.zarr").config.block_size == 8
