"""Reading with checks: the true values, or an error that names the episode and the array."""

from __future__ import annotations

import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.damage import LABEL, N, change, delete, make_store, readings, same
from support.fake_episodes import JOINTS, make_rows, small_config
from support.scale import scaled

from grasp_factory.curation.merge import split
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError, StoreError
from grasp_factory.writers.zarr.chunks import unpack, unpack_words
from grasp_factory.writers.zarr.encoding import packed_chunk, packed_shard
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store that no test changes."""
    return make_store(tmp_path_factory.mktemp("checked") / "store")


@pytest.fixture
def copy(store: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(store, tmp_path / "store"))


def row_of(store: Path, status: int) -> int:
    return int(np.flatnonzero(Dataset(store).status == status)[0])


def forge(store: Path, path: str, row: int, value: Any) -> None:
    """Change a value of a column such that nothing but its checksum tells."""
    array = Dataset(store).arrays()[path]
    file = store / path / f"{row // array.chunks[0]}{'.0' * (array.ndim - 1)}"
    if array.dtype.kind == "T":
        values: Any = unpack_words(file.read_bytes(), array.chunks).astype(object)
    else:
        values = np.empty(array.chunks, array.dtype)
        unpack(file.read_bytes(), values)
    values[row % array.chunks[0]] = value
    file.write_bytes(packed_chunk(values, 1))


def test_a_whole_store_reads_as_without_checks(store: Path) -> None:
    plain = dict(readings(store))
    for name, value in readings(store, checked=True):
        if name != "columns":
            assert same(value, plain[name]), name


def test_the_checks_travel_to_another_process(copy: Path) -> None:
    dataset = pickle.loads(pickle.dumps(Dataset(copy, noise="stereo", checked=True)))
    i = row_of(copy, 1)
    forge(copy, "episodes/object_mass", i, 77.0)
    with pytest.raises(StoreError, match="object_mass does not match"):
        dataset.value(i, "object_mass")


class TestAForgedValue:
    def test_of_a_column_is_refused_however_it_is_read(self, copy: Path) -> None:
        i = row_of(copy, 1)
        forge(copy, "episodes/object_mass", i, 77.0)
        assert Dataset(copy).value(i, "object_mass") == 77.0
        dataset = Dataset(copy, checked=True)
        reads: list[Callable[[], Any]] = [
            lambda: dataset.value(i, "object_mass"),
            lambda: dataset.column("object_mass"),
            lambda: dataset.where(object_mass=77.0),
            lambda: dataset[i],
            lambda: list(dataset),
            lambda: list(dataset.iter_blocks()),
        ]
        for read in reads:
            with pytest.raises(StoreError, match=f"episode {i} .*object_mass does not match"):
                read()

    def test_of_an_image_is_refused_when_it_is_read_alone(self, copy: Path) -> None:
        i, plain = row_of(copy, 1), Dataset(copy)
        camera = next(iter(plain.config.cameras))
        path, size = f"cameras/{camera}/rgb", plain.config.block_size
        block = i // size
        images = np.array(plain.arrays()[path][block * size : (block + 1) * size])
        images[i % size, 0] ^= 1
        frames = list(images.reshape(-1, *images.shape[2:]))
        shard = packed_shard(frames, size * images.shape[1], 1)
        (copy / path / f"{block}.0.0.0.0").write_bytes(shard)
        assert (plain.image(i, camera, "rgb", 0) == images[i % size, 0]).all()
        checked = Dataset(copy, checked=True)
        for read in (checked.image, lambda *which: checked.images([i], *which[1:])):
            with pytest.raises(StoreError, match=f"episode {i} .*{path} does not match"):
                read(i, camera, "rgb", 0)

    def test_of_another_array_does_not_matter(self, copy: Path) -> None:
        i = row_of(copy, 1)
        truth = Dataset(copy).column("policy")
        forge(copy, "episodes/object_mass", i, 77.0)
        assert (Dataset(copy, checked=True).column("policy") == truth).all()

    def test_of_a_length_is_refused_with_the_series(self, copy: Path) -> None:
        i = row_of(copy, 1)
        forge(copy, "episodes/n_steps", i, 2)
        for name in ("phase", "tcp_pose"):
            with pytest.raises(StoreError, match=f"episode {i} "):
                Dataset(copy, checked=True).series(i, name)

    def test_of_a_recipe_is_refused(self, copy: Path) -> None:
        i = row_of(copy, 1)
        spec = Dataset(copy).spec(i).to_json()
        forge(copy, "episodes/spec", i, spec.replace('"index":', '"index":1'))
        assert Dataset(copy).spec(i).index != i
        with pytest.raises(StoreError, match="episodes/spec does not match"):
            Dataset(copy, checked=True).spec(i)

    def test_of_a_quarantine_is_refused(self, copy: Path) -> None:
        i = row_of(copy, 2)
        forge(copy, "episodes/error", i, "no reason")
        dataset = Dataset(copy, checked=True)
        for read in (lambda: dataset.spec(i), lambda: dataset.column("error")):
            with pytest.raises(StoreError, match=f"episode {i} is damaged"):
                read()

    @pytest.mark.parametrize(("was", "status"), [(1, 0), (1, 2), (1, 7), (2, 1), (2, 0)])
    def test_of_a_status_is_refused(self, copy: Path, was: int, status: int) -> None:
        i = row_of(copy, was)
        forge(copy, "episodes/status", i, status)
        dataset = Dataset(copy, checked=True)
        reads: list[Callable[[], Any]] = [
            lambda: dataset.status,
            lambda: dataset.where(success=True),
            lambda: dataset[i],
            lambda: dataset.value(i, "policy"),
        ]
        for read in reads:
            with pytest.raises(StoreError, match=f"episode {i} .*status does not match"):
                read()

    def test_of_a_reason_that_a_whole_episode_has_is_refused(self, copy: Path) -> None:
        i = row_of(copy, 1)
        forge(copy, "episodes/error", i, "why not")
        with pytest.raises(StoreError, match=f"episode {i} .*error does not match"):
            Dataset(copy, checked=True).column("error")

    def test_of_a_packed_segment_is_not_read(self, copy: Path) -> None:
        truth = Dataset(copy).column("policy")
        segment = copy / "packed/0-1.npz"
        members = dict(np.load(segment, allow_pickle=False))
        members["episodes/policy"] = members["episodes/policy"][::-1]
        np.savez(segment, allow_pickle=False, **members)
        assert (Dataset(copy).column("policy") != truth).any()
        assert (Dataset(copy, checked=True).column("policy") == truth).all()

    def test_of_an_added_label_is_refused(self, copy: Path) -> None:
        file = next((copy / "labels" / LABEL / "outcome" / "c").iterdir())
        whole = file.read_bytes()
        dataset = Dataset(copy, checked=True)
        truth = dataset.label(LABEL)
        for place in range(len(whole)):
            put_back = change(file, place, whole[place] ^ 1)
            try:
                assert (dataset.label(LABEL) == truth).all()
            except StoreError:
                pass
            put_back()
        delete(f"labels/{LABEL}/outcome/zarr.json")(copy)
        with pytest.raises(GraspFactoryError):
            dataset.label(LABEL)


class TestMetadata:
    @pytest.mark.parametrize("name", ["zarr.json", "streams/phase/zarr.json"])
    def test_that_was_changed_is_refused(self, copy: Path, name: str) -> None:
        document = json.loads((copy / name).read_text())
        document["attributes"]["more"] = 1
        (copy / name).write_text(json.dumps(document))
        assert len(Dataset(copy)) == N
        with pytest.raises(StoreError, match=r"zarr\.json of .* run grasp-factory verify"):
            Dataset(copy, checked=True)

    def test_without_digests_is_told(self, copy: Path) -> None:
        shutil.rmtree(copy / "episodes/array_crc32c")
        assert len(Dataset(copy)) == N
        with pytest.raises(StoreError, match="open it without checked=True"):
            Dataset(copy, checked=True)


class TestWhatNoDigestHolds:
    def test_a_number_of_rows_that_only_one_array_has_is_refused(self, copy: Path) -> None:
        file = copy / "episodes/status/zarr.json"
        document = json.loads(file.read_bytes())
        document["shape"][0] -= 1
        file.write_text(json.dumps(document))
        with pytest.raises(StoreError, match=r"has [0-9]+ rows, episodes/status has"):
            Dataset(copy, checked=True)
        with pytest.raises(StoreError, match=r"has [0-9]+ rows, episodes/status has"):
            split(copy, copy.with_name("out"), [0])

    def test_whole_blocks_that_changed_places_are_refused(self, copy: Path) -> None:
        for path in (p for p in Dataset(copy).arrays() if not p.startswith("labels/")):
            files = [next((copy / path).glob(f"{block}*")) for block in (0, 1)]
            aside = files[0].with_name("aside")
            files[0].rename(aside)
            files[1].rename(files[0])
            aside.rename(files[1])
        dataset = Dataset(copy, checked=True)
        i = row_of(copy, 1)
        for read in (
            lambda: dataset[i],
            lambda: dataset.series(i, "phase"),
            lambda: dataset.image(i, next(iter(dataset.config.cameras)), "depth", 1),
            lambda: dataset.column("success"),
        ):
            with pytest.raises(StoreError, match=r"row [0-9]+ holds episode [0-9]+ of seed"):
                read()


class TestRowsThatAreNotThere:
    def test_hold_fill_values_and_need_no_checksum(self, copy: Path) -> None:
        delete("episodes/status/1")(copy)
        dataset = Dataset(copy, checked=True)
        assert dataset.status[4:8].tolist() == [0, 0, 0, 0]
        assert set(dataset.column("policy")[4:8]) == {""}
        with pytest.raises(StoreError, match="episode 5 is missing"):
            dataset[5]


CONFIG = small_config(resolution=[16, 16], video_hz=5)


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fake") / "store"
    prepare_store(path, CONFIG, JOINTS, 7, {})
    for block in range(2):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, 7, quarantined=(1,)))
    return path


@settings(max_examples=scaled(15, 40))
@given(data=st.data())
def test_whatever_byte_is_changed_an_episode_is_true_or_refused(
    fake: Path, data: st.DataObject
) -> None:
    files = sorted(p for p in fake.rglob("*") if p.is_file() and p.name != "zarr.json")
    file = data.draw(st.sampled_from(files))
    place = data.draw(st.integers(0, file.stat().st_size - 1))
    flip = data.draw(st.integers(1, 255))
    truth = {i: Dataset(fake)[i].checksum() for i in (0, 2, 3, 4, 5, 6)}
    put_back = change(file, place, file.read_bytes()[place] ^ flip)
    try:
        dataset = Dataset(fake, checked=True)
        for i, checksum in truth.items():
            try:
                assert dataset[i].checksum() == checksum
            except StoreError:
                pass
    finally:
        put_back()
