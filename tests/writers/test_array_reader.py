"""The direct reader of arrays: what Zarr reads, and a clear error or the same for damaged bytes."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from numcodecs import zstd
from numcodecs.vlen import VLenUTF8
from support.fake_episodes import JOINTS, make_rows, small_config
from support.places import TINY

from grasp_factory.core import schema
from grasp_factory.core.place import place_at, place_of
from grasp_factory.errors import StoreError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.array_layout import ThroughZarr, stored
from grasp_factory.writers.zarr.array_reader import ColumnFiles, ShardFiles, StoredArray
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.store import prepare_store

VIEW = {"eye": [1.0, 0.0, 0.5], "target": [0.5, 0.0, 0.0]}
CONFIG = small_config(cameras={"left": VIEW, "right": VIEW}, video_hz=5, resolution=(16, 16))
N = 15


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store with videos, of blocks 0, 1 and a short 3; 5 is quarantined."""
    path = tmp_path_factory.mktemp("stored") / "store"
    prepare_store(path, CONFIG, JOINTS, N, {})
    for block in (0, 1, 3):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, N, quarantined=(5,)))
    return path


def arrays(path: Path) -> dict[str, zarr.Array[Any]]:
    root: Any = zarr.open_group(AtomicStore(place_of(path), read_only=True), mode="r")
    return {name: node for name, node in root.members(None) if isinstance(node, zarr.Array)}


def same(got: np.ndarray[Any, Any], want: Any) -> bool:
    want = np.asarray(want)
    if (got.dtype, got.shape) != (want.dtype, want.shape):
        return False
    if got.dtype.kind == "T":
        return got.tolist() == want.tolist()  # type: ignore[no-any-return]
    return got.tobytes() == want.tobytes()


class TestWhatIsRead:
    @pytest.fixture(params=["small", "tiny"])
    def path(self, request: pytest.FixtureRequest, small: Path) -> Path:
        return {"small": small, "tiny": TINY}[request.param]

    @pytest.mark.slow
    def test_is_what_zarr_reads_for_any_rows(self, path: Path) -> None:
        for name, array in arrays(path).items():
            mine, n = stored(array), array.shape[0]
            assert isinstance(mine, ColumnFiles | ShardFiles), name
            for start, stop in ((0, n), (0, 1), (n - 1, n), (2, n - 1), (1, 3), (2, 2)):
                assert same(mine.read(start, stop), array[start:stop]), (name, start, stop)

    def test_is_what_zarr_reads_for_any_frames(self, path: Path) -> None:
        for name, array in arrays(path).items():
            if array.ndim < 2:
                continue
            rows = np.array([array.shape[0] - 1, 0, 2, 0])
            for frame in range(min(2, array.shape[1])):
                got = stored(array).read_frames(rows, frame)
                want = np.stack([array[int(i)][frame] for i in rows]).astype(array.dtype)
                assert same(got, want), name

    def test_may_be_changed(self, path: Path) -> None:
        for array in arrays(path).values():
            got = stored(array).read(0, 1)
            got[...] = got[::-1]


@pytest.mark.parametrize(
    "layout",
    [
        {"compressors": [zarr.codecs.GzipCodec()]},
        {"compressors": None},
        {"chunk_key_encoding": {"name": "default", "separator": "/"}},
        {"chunks": (2, 3), "shards": (4, 6)},
        {"chunks": (2, 3)},
        {"serializer": zarr.codecs.BytesCodec(endian="big")},
    ],
    ids=str,
)
def test_any_other_layout_is_left_to_zarr(tmp_path: Path, layout: dict[str, Any]) -> None:
    values = np.arange(30.0).reshape(5, 6)
    keys = {"name": "v2", "separator": "."}
    ours: dict[str, Any] = {
        **{"chunks": (4, 6), "compressors": [zarr.codecs.ZstdCodec()]},
        "chunk_key_encoding": keys,
    }
    store = AtomicStore(place_at(tmp_path / "a"))
    array = zarr.create_array(store, shape=(5, 6), dtype="f8", **(ours | layout))
    array[:] = values
    mine = stored(array)
    assert isinstance(mine, ThroughZarr)
    assert same(mine.read(1, 5), values[1:5])
    assert same(mine.read_frames([4, 0], 2), values[[4, 0], 2])


DAMAGED = ("episodes/spec", "episodes/grasp_position", "streams/tcp_pose", "cameras/left/depth")


@pytest.fixture(scope="module")
def own(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy that tests damage, and mend again."""
    return Path(shutil.copytree(small, tmp_path_factory.mktemp("damaged") / "store"))


@pytest.mark.parametrize("name", DAMAGED)
class TestDamagedBytes:
    @staticmethod
    def open(own: Path, name: str) -> tuple[StoredArray, zarr.Array[Any], Path, bytes]:
        array = zarr.open_array(AtomicStore(place_of(own)), path=name, mode="r")
        file = own / name / ("0" + ".0" * (array.ndim - 1))
        return stored(array), array, file, file.read_bytes()

    @settings(max_examples=60)
    @given(data=st.data())
    def test_that_were_flipped_are_an_error_or_what_zarr_reads(
        self, own: Path, name: str, data: st.DataObject
    ) -> None:
        mine, array, file, good = self.open(own, name)
        place = data.draw(st.integers(0, len(good) - 1))
        bad = bytearray(good)
        bad[place] ^= data.draw(st.integers(1, 255))
        file.write_bytes(bad)
        stop = data.draw(st.sampled_from((4, 8)))  # of 8 rows, both files are decoded together
        try:
            got = mine.read(0, stop)
        except StoreError as error:
            text = f"{own}: {name} of episodes 0 to 3 cannot be read: "
            assert str(error).startswith(text)
            assert "\n" not in str(error)
        else:
            assert same(got, array[:stop])
        finally:
            file.write_bytes(good)

    def test_that_were_cut_off_are_an_error(self, own: Path, name: str) -> None:
        mine, _, file, good = self.open(own, name)
        try:
            for size in {0, 1, 5, 19, len(good) // 2, len(good) - 1}:
                file.write_bytes(good[:size])
                with pytest.raises(StoreError, match="cannot be read: "):
                    mine.read(0, 4)
        finally:
            file.write_bytes(good)

    def test_are_only_met_where_they_are(self, own: Path, name: str) -> None:
        mine, array, file, good = self.open(own, name)
        try:
            file.write_bytes(b"")
            assert same(mine.read(4, 8), array[4:8])
        finally:
            file.write_bytes(good)


def test_any_damage_to_a_shards_index_is_an_error(own: Path) -> None:
    mine, _, file, good = TestDamagedBytes.open(own, "cameras/left/depth")
    index = 16 * CONFIG.block_size * 2 + 4
    try:
        for place in range(len(good) - index, len(good)):
            file.write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
            with pytest.raises(StoreError, match="index does not match its checksum"):
                mine.read(0, 1)
    finally:
        file.write_bytes(good)


def test_a_chunk_that_is_too_short_is_an_error_and_not_filled_up_by_chance(own: Path) -> None:
    name = "episodes/grasp_position"  # a chunk of 4 x 3 numbers of 8 bytes
    mine, _, file, good = TestDamagedBytes.open(own, name)
    try:
        for size in (0, 8, 64, 95, 97, 300):
            file.write_bytes(zstd.compress(bytes(size), 3))
            with pytest.raises(StoreError, match=f"a chunk of {size} bytes, valid: 96"):
                mine.read(0, 4)
    finally:
        file.write_bytes(good)


def test_a_chunk_is_not_made_whole_by_the_one_after_it(own: Path) -> None:
    name = "episodes/grasp_position"
    mine, _, file, good = TestDamagedBytes.open(own, name)
    other = file.with_name("1.0")
    rest = other.read_bytes()
    try:
        file.write_bytes(zstd.compress(bytes(97), 3))
        other.write_bytes(zstd.compress(bytes(95), 3))
        with pytest.raises(StoreError, match=r"episodes 0 to 3 .*a chunk of 97 bytes, valid: 96"):
            mine.read(0, 8)
        file.write_bytes(good + zstd.compress(b"", 3) + b"x")
        with pytest.raises(StoreError, match=r"episodes 0 to 3 "):
            mine.read(0, 8)
    finally:
        file.write_bytes(good)
        other.write_bytes(rest)


def test_words_of_one_length_are_those_that_are_read_one_by_one(own: Path) -> None:
    name = "episodes/checksum"
    mine, _, file, good = TestDamagedBytes.open(own, name)
    assert isinstance(mine, ColumnFiles)

    def check() -> None:
        got = mine.read_equal_words(1, 15, 64)
        assert [bytes(row).rstrip(b"\0").decode() for row in got] == mine.read(1, 15).tolist()

    check()  # with the empty word of a quarantined row, and a missing block
    words = mine.read(0, 4).tolist()
    try:
        file.write_bytes(zstd.compress(bytes(VLenUTF8().encode(np.array(words[::-1], object))), 3))
        check()
        words[2] = "x" * 63
        file.write_bytes(zstd.compress(bytes(VLenUTF8().encode(np.array(words, object))), 3))
        with pytest.raises(StoreError, match="checksum of episodes 0 to 3 cannot be read"):
            check()
    finally:
        file.write_bytes(good)


def test_a_chunk_that_was_never_written_is_its_fill_value(small: Path) -> None:
    for name in ("streams/tcp_pose", "episodes/spec", "cameras/left/rgb"):
        array = arrays(small)[name]
        assert same(stored(array).read(8, 12), array[8:12])
        assert not (small / name / ("2" + ".0" * (array.ndim - 1))).exists()


@pytest.mark.slow
def test_every_array_of_the_schema_is_read_directly(small: Path) -> None:
    for row in schema.expand(CONFIG):
        assert not isinstance(stored(arrays(small)[row.path]), ThroughZarr)
