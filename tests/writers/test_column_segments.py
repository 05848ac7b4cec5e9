"""Packed segments: the same columns, quicker; derived from the blocks, and never in their way."""

from __future__ import annotations

import json
import os
import shutil
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree, pending_blocks, tree

from grasp_factory.core.place import place_of
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import StoreError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import column_segments, segment_packing
from grasp_factory.writers.zarr.block_attempt import BlockAttempt
from grasp_factory.writers.zarr.column_segments import FOLDER, apart, coded, segments
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.segment_packing import is_time_to_pack, pack
from grasp_factory.writers.zarr.sizes import store_bytes
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = pytest.mark.slow

CONFIG = small_config(resolution=(16, 16))
N = 27
"""Six whole blocks of 4 and a short one, of which segments of 2 blocks take 0 to 1 and 4 to 5."""
MISSING = 2


@pytest.fixture(autouse=True)
def small_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", 2)


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store without segments; block 2 is missing, 1 and 5 are quarantined."""
    path = tmp_path_factory.mktemp("loose") / "store"
    prepare_store(path, CONFIG, JOINTS, N, {})
    for block in range(7):
        if block != MISSING:
            ZarrWriter(path).write_block(block, make_rows(CONFIG, block, N, quarantined=(1, 5)))
    return path


@pytest.fixture
def path(loose: Path, tmp_path: Path) -> Path:
    """Return a packed copy of it."""
    path = Path(shutil.copytree(loose, tmp_path / "store"))
    pack(path)
    return path


def columns(path: Path) -> dict[str, list[Any]]:
    dataset = Dataset(path)
    out = {}
    for name in dataset.columns:
        column = dataset.column(name)
        text = column.dtype.kind == "T"
        out[name] = [column.dtype, column.shape, column.tolist() if text else column.tobytes()]
    return out


def names(path: Path) -> list[str]:
    return sorted(segment.file.name for segment in segments(place_of(path)))


class TestPackedColumns:
    def test_are_those_of_the_blocks(self, loose: Path, path: Path) -> None:
        assert names(path) == ["0-1.npz", "4-5.npz"]
        assert columns(path) == columns(loose)

    def test_are_read_without_the_blocks_files(self, loose: Path, path: Path) -> None:
        for name in ("policy", "success", "status", "grasp_position"):
            for file in (path / "episodes" / name).glob("[0145]*"):
                file.write_bytes(b"")
        packed, want = columns(path), columns(loose)
        for name in ("policy", "success", "status", "grasp_position"):
            assert packed[name] == want[name]

    def test_answer_the_same_questions(self, loose: Path, path: Path) -> None:
        for conditions in (
            {"success": True, "policy": "uniform"},
            {"split": ["train", "val"], "outcome": "success"},
            {"policy": "uniform", "split": "test"},
        ):
            want = Dataset(loose).where(**conditions).indices.tolist()
            assert Dataset(path).where(**conditions).indices.tolist() == want

    def test_leave_out_what_is_long(self, path: Path) -> None:
        with np.load(path / FOLDER / "0-1.npz", allow_pickle=False) as members:
            assert not [m for m in members if "spec" in m or "checksum" in m or "error" in m]
            assert "episodes/policy.words" in members

    def test_say_what_is_pending(self, path: Path) -> None:
        assert pending_blocks(path, N) == [MISSING]
        assert pending_blocks(path, 8) == []

    def test_yield_to_a_marker_that_was_removed_by_hand(self, path: Path) -> None:
        (path / "episodes/status/1").unlink()
        assert pending_blocks(path, N) == [1, MISSING]
        assert 4 not in Dataset(path).committed

    def test_do_not_trouble_zarrs_readers(self, path: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            root: Any = zarr.open_group(path, mode="r")
            assert FOLDER in dict(root.members(max_depth=None))

    def test_are_not_what_anything_depends_on(self, loose: Path, path: Path) -> None:
        shutil.rmtree(path / FOLDER)
        assert_same_tree(path, loose)
        pack(path)
        assert names(path) == ["0-1.npz", "4-5.npz"]


@pytest.fixture(scope="module")
def packed(loose: Path, tmp_path_factory: pytest.TempPathFactory) -> Columns:
    """Return the columns of a packed copy, whose segments tests damage and mend again."""
    path = Path(shutil.copytree(loose, tmp_path_factory.mktemp("packed") / "store"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(segment_packing, "SEGMENT_BLOCKS", 2)
        pack(path)
    return Columns.open(path)


class TestDamagedSegments:
    @settings(max_examples=60)
    @given(place=st.integers(0, 2**16), flip=st.integers(1, 255))
    def test_never_change_a_column(self, packed: Columns, place: int, flip: int) -> None:
        names = ("success", "policy", "object_mass", "status")
        want = packed.read(*names)
        file = packed.path / FOLDER / "0-1.npz"
        good = file.read_bytes()
        bad = bytearray(good)
        bad[place % len(good)] ^= flip
        file.write_bytes(bad)
        try:
            got = packed.read(*names)
        finally:
            file.write_bytes(good)
        for name in names:
            np.testing.assert_array_equal(got[name], want[name])

    @pytest.mark.parametrize("size", [0, 1, 100, -1])
    def test_that_were_cut_off_are_passed_over(self, loose: Path, path: Path, size: int) -> None:
        file = path / FOLDER / "0-1.npz"
        file.write_bytes(file.read_bytes()[:size])
        assert columns(path) == columns(loose)
        assert store_bytes(Columns.open(path)) == sum(map(len, tree(path).values()))

    def test_of_another_shape_are_passed_over(self, loose: Path, path: Path) -> None:
        shutil.copy(path / FOLDER / "4-5.npz", path / FOLDER / "0-3.npz")
        (path / FOLDER / "0-1.npz").write_bytes(b"")
        assert columns(path) == columns(loose)

    def test_that_share_blocks_with_another_are_not_read(self, loose: Path, path: Path) -> None:
        shutil.copy(path / FOLDER / "4-5.npz", path / FOLDER / "0-3.npz")
        shutil.copy(path / FOLDER / "4-5.npz", path / FOLDER / "00-1.npz")
        assert names(path) == ["0-1.npz", "0-3.npz", "4-5.npz"]
        assert len(list(apart(segments(place_of(path))))) == 2
        assert columns(path) == columns(loose)

    @pytest.mark.parametrize(
        "change",
        [
            lambda old: old[:-2] + b"\x01\x00x",  # a comment
            lambda old: old[:-22] + b"PK\x06\x07" + bytes(16) + old[-22:],  # a larger directory
            lambda old: old[:-10] + struct.pack("<I", 2**31) + old[-6:],  # its bytes
            lambda old: old[:-14] + struct.pack("<HH", 9999, 9999) + old[-10:],  # its members
        ],
    )
    def test_with_a_directory_that_none_has_are_not_opened(
        self, loose: Path, path: Path, change: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        want, opened = columns(loose), []
        for file in (path / FOLDER).glob("*.npz"):
            file.write_bytes(change(file.read_bytes()))
        monkeypatch.setattr(column_segments, "ZipFile", opened.append)
        assert columns(path) == want
        assert opened == []

    def test_never_run_code(self, loose: Path, path: Path, tmp_path: Path) -> None:
        mark = tmp_path / "it ran"

        class Trap:
            def __reduce__(self) -> Any:
                return Path.touch, (mark,)

        member = np.array([Trap()], object)
        np.savez(path / FOLDER / "0-1.npz", **{"episodes/success": member})  # type: ignore[arg-type]
        want = Dataset(loose).column("success")
        assert Dataset(path).column("success").tolist() == want.tolist()
        assert not mark.exists()


class Crash(Exception):
    pass


class TestPacking:
    def test_waits_for_blocks_that_are_missing_or_cut_short(self, path: Path) -> None:
        ZarrWriter(path).write_block(MISSING, make_rows(CONFIG, MISSING, 11))  # a row is missing
        pack(path)
        assert names(path) == ["0-1.npz", "4-5.npz"]
        ZarrWriter(path).write_block(MISSING, make_rows(CONFIG, MISSING, N))
        pack(path)
        assert names(path) == ["0-1.npz", "2-3.npz", "4-5.npz"]

    def test_gives_the_same_bytes_in_any_order(self, loose: Path, path: Path) -> None:
        for out in (path, loose.with_name("other")):
            if out != path:
                shutil.copytree(loose, out)
            ZarrWriter(out).write_block(MISSING, make_rows(CONFIG, MISSING, N))
            pack(out)
        assert_same_tree(path, loose.with_name("other"))

    def test_again_changes_nothing(self, path: Path) -> None:
        def state() -> dict[Path, int]:
            return {file: file.stat().st_mtime_ns for file in path.rglob("*")}

        before = state()
        pack(path)
        assert state() == before

    @pytest.mark.parametrize("renames", range(3))  # the folder's own file, and two segments
    def test_that_was_killed_leaves_nothing_that_stays(
        self, loose: Path, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, renames: int
    ) -> None:
        out = Path(shutil.copytree(loose, tmp_path / "out"))
        replace, left = os.replace, renames

        def kill(*names: str, **folders: int) -> None:
            nonlocal left
            if left == 0:
                raise Crash
            left -= 1
            replace(*names, **folders)

        with monkeypatch.context() as patch, pytest.raises(Crash):
            patch.setattr(os, "replace", kill)
            pack(out)
        assert list(out.rglob("*.partial"))
        assert columns(out) == columns(loose)
        pack(out)
        assert_same_tree(out, path)

    def test_removes_what_a_killed_one_left_of_a_segment_that_is_not_complete_any_more(
        self, path: Path
    ) -> None:
        before = tree(path)
        (path / FOLDER / "2-3.npz.partial").touch()
        pack(path)
        assert tree(path) == before

    def test_leaves_out_what_cannot_be_read(self, path: Path) -> None:
        shutil.rmtree(path / FOLDER)
        (path / "episodes/object_mass/1").write_bytes(b"damaged")
        pack(path)
        assert names(path) == ["4-5.npz"]
        with pytest.raises(StoreError, match="episodes/object_mass of episodes 4 to 7 cannot be"):
            Dataset(path).column("object_mass")

    def test_that_cannot_write_says_so(self, path: Path) -> None:
        shutil.rmtree(path / FOLDER)
        (path / FOLDER).write_text("in the way")
        with pytest.raises(StoreError) as caught:
            pack(path)
        assert str(caught.value).startswith(f"{path / FOLDER} cannot be written: ")

    def test_comes_once_in_each_segment(self) -> None:
        assert [i for i in range(40) if is_time_to_pack(i, block_size=4)] == [4, 12, 20, 28, 36]


class TestABlockThatIsWrittenAgain:
    def test_takes_its_segment_away_first(
        self, path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        writer, rows = ZarrWriter(path), make_rows(CONFIG, 1, N)

        def killed(*_: Any) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(BlockAttempt, "publish", killed)
            writer.write_block(1, rows)
        assert names(path) == ["4-5.npz"]
        assert pending_blocks(path, N) == [MISSING]
        assert Dataset(path).status[4:8].tolist() == [1, 2, 1, 1]
        writer.write_block(1, rows)
        assert Dataset(path).status[4:8].tolist() == [1, 1, 1, 1]
        pack(path)
        assert Dataset(path).status[4:8].tolist() == [1, 1, 1, 1]

    def test_lists_no_directory_with_a_name_for_each_block(
        self, path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        listed: list[str] = []
        for name in ("listdir", "scandir"):
            real = getattr(os, name)
            monkeypatch.setattr(
                os,
                name,
                lambda folder, real=real: (
                    listed.append(os.readlink(f"/proc/self/fd/{folder}")) or real(folder)
                ),
            )
        ZarrWriter(path).write_block(5, make_rows(CONFIG, 5, N))
        assert set(listed) <= {str(path / FOLDER)}


class TestTheSizeOfAStore:
    def test_is_that_of_all_its_files(self, loose: Path, path: Path) -> None:
        for store in (loose, path):
            size = sum(map(len, tree(store).values()))
            assert store_bytes(Columns.open(store)) == size
            assert summarise(Dataset(store)).bytes == size

    def test_of_videos_too(self, tmp_path: Path) -> None:
        config = small_config(resolution=(16, 16), video_hz=5)
        path = tmp_path / "videos"
        prepare_store(path, config, JOINTS, 15, {}, carried={"objects/mine": b"zip" * 9})
        for block in range(4):
            ZarrWriter(path).write_block(block, make_rows(config, block, 15, quarantined=(3,)))
        pack(path)
        assert names(path) == ["0-1.npz"]
        assert store_bytes(Columns.open(path)) == sum(map(len, tree(path).values()))

    def test_is_known_without_a_look_at_packed_blocks(self, path: Path) -> None:
        size = store_bytes(Columns.open(path))
        for array in ("cameras/front/rgb", "streams/phase"):
            for file in (path / array).glob("[0145].*"):
                file.unlink()
        assert store_bytes(Columns.open(path)) == size


@given(words=st.lists(st.text(st.characters(exclude_categories=["Cs"])), max_size=20))
def test_words_and_codes_are_the_same_text(words: list[str]) -> None:
    column = np.array(words, np.dtypes.StringDType())
    codes, text = coded(column)
    known = json.loads(text.tobytes())
    assert [known[code] for code in codes] == words
    assert known == sorted(set(words))


def test_more_than_256_words_take_wider_codes() -> None:
    column = np.array([f"object_{i}" for i in range(300)], np.dtypes.StringDType())
    assert coded(column)[0].dtype == np.uint16
