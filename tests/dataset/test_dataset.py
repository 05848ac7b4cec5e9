"""Reading a store: the records that went in come out, and everything else is one clear line."""

from __future__ import annotations

import dataclasses
import pickle
import shutil
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_episode, make_rows, make_spec, small_config
from support.opened_files import opened_shards

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, StoreMismatchError, UnknownNameError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config()
ROOM = schema.sizes(CONFIG, JOINTS)["T"]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of 13: 5 and 6 are quarantined, block 2 (8 to 11) is missing."""
    path = tmp_path_factory.mktemp("dataset") / "store"
    prepare_store(path, CONFIG, JOINTS, 13, {})
    writer = ZarrWriter(path)
    for block in (0, 1, 3):
        writer.write_block(block, make_rows(CONFIG, block, 13, quarantined=(5, 6)))
    return path


@pytest.fixture(scope="module")
def dataset(path: Path) -> Dataset:
    return Dataset(path)


@pytest.fixture
def own_path(path: Path, tmp_path: Path) -> Path:
    """Return a copy of the store that the test may damage."""
    return Path(shutil.copytree(path, tmp_path / "own"))


def assert_identical(got: Mapping[str, Any], want: Mapping[str, Any]) -> None:
    assert list(got) == list(want)
    for name, array in want.items():
        assert (got[name].dtype, got[name].shape) == (array.dtype, array.shape), name
        assert got[name].tobytes() == array.tobytes(), name


def test_an_episode_comes_back_bit_for_bit(dataset: Dataset) -> None:
    want, got = make_episode(CONFIG, 3), dataset[3]
    assert isinstance(got, Episode)
    assert_identical(got.contents(), want.contents())
    assert got.checksum() == want.checksum()
    assert (got.spec, got.outcome) == (want.spec, want.outcome)
    for name, value in want.columns.items():
        assert type(got.columns[name]) is type(value), name


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 2**63 - 1),
    n_steps=st.integers(0, ROOM),
    cameras=st.sampled_from([("front",), ("left", "right")]),
    score=st.floats() | st.just(-0.0),
    word=st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")),
)
def test_any_episode_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    *,
    seed: int,
    n_steps: int,
    cameras: tuple[str, ...],
    score: float,
    word: str,
) -> None:
    view = {"eye": [1.0, 0.0, 0.5], "target": [0.5, 0.0, 0.0]}
    config = small_config(seed=seed, cameras=dict.fromkeys(cameras, view), resolution=(16, 16))
    path = tmp_path_factory.mktemp("any") / "store"
    prepare_store(path, config, JOINTS, 1, {})
    want = make_episode(config, 0, n_steps)
    columns = dict(want.columns) | {"grasp_score": score, "object_id": word}
    want = dataclasses.replace(want, columns=columns)
    ZarrWriter(path).write_block(0, [want])
    dataset = Dataset(path)
    assert_identical(dataset[0].contents(), want.contents())
    assert dataset.verify(0)


def test_python_and_numpy_numbers_in_columns_are_the_same_episode() -> None:
    episode = make_episode(CONFIG, 0, n_steps=1)
    columns = {name: np.asarray(value)[()] for name, value in episode.columns.items()}
    columns |= {"object_mass": 1, "collision_body": np.int64(2)}
    same = dict(episode.columns) | {"object_mass": 1.0, "collision_body": 2}
    a = dataclasses.replace(episode, columns=columns)
    b = dataclasses.replace(episode, columns=same)
    assert a.checksum() == b.checksum()


def test_config_and_attributes_are_those_of_the_run(dataset: Dataset) -> None:
    assert dataset.config == CONFIG
    assert isinstance(dataset.config, FactoryConfig)
    assert dataset.attributes["config_sha256"] == CONFIG.sha256()
    assert repr(dataset).startswith(f"Dataset({str(dataset.path)!r}): 13 rows\n")


def test_status_says_what_is_committed_quarantined_and_missing(dataset: Dataset) -> None:
    assert len(dataset) == 13
    assert dataset.status.tolist() == [1, 1, 1, 1, 1, 2, 2, 1, 0, 0, 0, 0, 1]
    assert dataset.committed.tolist() == [0, 1, 2, 3, 4, 7, 12]


def test_negative_indices_count_from_the_end(dataset: Dataset) -> None:
    assert dataset[-1].spec.index == 12
    assert dataset.spec(-8).index == 5


@pytest.mark.parametrize("index", [13, -14])
def test_an_index_out_of_range_names_the_range(dataset: Dataset, index: int) -> None:
    for read in (dataset.__getitem__, dataset.spec, dataset.verify):
        with pytest.raises(IndexError) as caught:
            read(index)
        assert str(caught.value) == f"episode {index}: valid: -13 to 12"


@pytest.mark.parametrize("index", ["a", (0, 1), slice(0, 2), 1.0, None, [0]], ids=str)
def test_an_index_that_is_no_integer_says_what_to_use(dataset: Dataset, index: Any) -> None:
    takes_one = [dataset.spec, dataset.verify, dataset.series]
    if not isinstance(index, slice | list | str):
        takes_one.append(dataset.__getitem__)
    for read in takes_one:
        with pytest.raises(TypeError) as caught:
            read(index)
        assert str(caught.value).startswith("episode index: got ")
        assert str(caught.value).endswith(
            "valid: one integer, as in ds[3]; for several: ds[3:10] or ds[[3, 5]]"
        )


@pytest.mark.parametrize("index", [True, np.True_], ids=str)
def test_a_truth_value_is_no_index(dataset: Dataset, index: Any) -> None:
    for read in (dataset.__getitem__, dataset.spec, dataset.verify, dataset.series):
        with pytest.raises(TypeError) as caught:
            read(index)
        assert str(caught.value) == (
            f"episode index: got {index!r}, valid: an integer; for a mask: ds[np.array(mask)]"
        )


def test_a_store_of_no_episodes_has_no_index(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 0, {})
    dataset = Dataset(tmp_path / "out")
    assert (len(dataset), dataset.committed.tolist(), list(dataset)) == (0, [], [])
    with pytest.raises(IndexError) as caught:
        dataset[0]
    assert str(caught.value) == "episode 0: there are no episodes"


def test_a_missing_row_says_so(dataset: Dataset) -> None:
    for read in (dataset.__getitem__, dataset.spec, dataset.verify):
        with pytest.raises(StoreError) as caught:
            read(8)
        assert str(caught.value) == f"{dataset.path}: episode 8 is missing"


def test_a_quarantined_row_has_a_recipe_and_a_reason(dataset: Dataset) -> None:
    assert dataset.spec(5) == make_spec(CONFIG, 5)
    for read in (dataset.__getitem__, dataset.verify):
        with pytest.raises(StoreError) as caught:
            read(5)
        message = f"{dataset.path}: episode 5 is quarantined: no luck with 5"
        assert str(caught.value) == message


def test_one_image_is_read_alone(dataset: Dataset) -> None:
    front = make_episode(CONFIG, 7).cameras["front"]
    np.testing.assert_array_equal(dataset.image(7, "front", "rgb", 1), front.rgb[1])
    np.testing.assert_array_equal(dataset.image(7, "front", "depth", 0), front.depth[0])
    for camera, kind, message in (
        ("frnt", "rgb", "unknown camera 'frnt'; did you mean 'front'? (valid: front)"),
        ("front", "xyz", "unknown image kind 'xyz' (valid: depth, rgb, segmentation)"),
    ):
        with pytest.raises(UnknownNameError) as caught:
            dataset.image(7, camera, kind, 0)
        assert str(caught.value) == message
    with pytest.raises(IndexError) as out_of_range:
        dataset.image(7, "front", "rgb", 2)
    assert str(out_of_range.value) == "frame 2: valid: 0 (before) and 1 (after)"


class TestImagesOfSeveralEpisodes:
    def test_are_each_ones_in_the_given_order(self, dataset: Dataset) -> None:
        indices = [12, 0, -1, 3, 7, 4]
        for kind in ("rgb", "depth", "segmentation"):
            for frame in (0, 1):
                images = dataset.images(np.array(indices), "front", kind, frame)
                want = np.stack([dataset.image(i, "front", kind, frame) for i in indices])
                assert (images.dtype, images.shape) == (want.dtype, want.shape)
                assert images.tobytes() == want.tobytes()

    def test_open_each_shard_once(self, path: Path, opened: Counter[str]) -> None:
        Dataset(path).images([12, 0, 3, 7, 4, 1], "front", "rgb", 0)
        assert list(opened.values()) == [1, 1, 1]

    def test_have_the_noise_of_single_ones(self, path: Path) -> None:
        noisy = Dataset(path, noise="stereo", noise_seed=4)
        images = noisy.images([7, 0], "front", "depth", 0)
        assert images[0].tobytes() == noisy.image(7, "front", "depth", 0).tobytes()
        assert images[1].tobytes() == noisy[0].cameras["front"].depth[0].tobytes()

    def test_may_be_none(self, dataset: Dataset) -> None:
        assert dataset.images([], "front", "depth", 0).shape == (0, 24, 32)

    def test_name_the_row_that_is_not_there(self, dataset: Dataset) -> None:
        with pytest.raises(StoreError) as caught:
            dataset.images([0, 8], "front", "rgb", 0)
        assert str(caught.value) == f"{dataset.path}: episode 8 is missing"


class TestOneValue:
    def test_is_that_of_the_episode(self, dataset: Dataset) -> None:
        want = make_episode(CONFIG, 7)
        assert dataset.value(7, "object_mass") == want.columns["object_mass"]
        assert isinstance(dataset.value(7, "success"), np.bool_)
        assert dataset.value(-1, "policy") == make_episode(CONFIG, 12).columns["policy"]
        np.testing.assert_array_equal(dataset.value(7, "object_ids"), want.columns["object_ids"])

    def test_names_what_is_not_there(self, dataset: Dataset) -> None:
        with pytest.raises(UnknownNameError, match="unknown column 'sucess'; did you mean"):
            dataset.value(7, "sucess")
        with pytest.raises(StoreError, match="episode 5 is quarantined: no luck with 5"):
            dataset.value(5, "success")


def test_values_of_several_episodes_are_those_of_each(dataset: Dataset) -> None:
    rows = [7, 0, 12, -1]
    for name in ("object_mass", "policy", "object_ids", "success"):
        got = dataset.values(rows, name)
        assert got.tolist() == [np.asarray(dataset.value(row, name)).tolist() for row in rows]
    assert dataset[[7, 0]].values([1], "policy").tolist() == [dataset.value(0, "policy")]
    assert dataset.values([], "policy").shape == (0,)
    with pytest.raises(UnknownNameError):
        dataset.values([7], "sucess")
    with pytest.raises(StoreError):
        dataset.values([0, 5], "success")


def test_a_column_is_one_array_with_a_value_per_row(dataset: Dataset) -> None:
    mass = [make_spec(CONFIG, i).objects[0].mass for i in dataset.committed]
    assert dataset.column("object_mass")[dataset.committed].tolist() == mass
    assert dataset.column("grasp_position").shape == (13, 3)
    assert dataset.column("policy")[0] == make_spec(CONFIG, 0).policy
    assert {"success", "outcome", "split", "spec", "n_steps"} <= set(dataset.columns)


def test_an_unknown_column_lists_the_columns(dataset: Dataset) -> None:
    for read in (dataset.column, lambda name: dataset.where(**{name: 1})):
        with pytest.raises(UnknownNameError) as caught:
            read("sucess")
        valid = ", ".join(sorted(dataset.columns))
        message = f"unknown column 'sucess'; did you mean 'success'? (valid: {valid})"
        assert str(caught.value) == message


CONDITIONS = [
    {},
    {"success": True},
    {"success": np.False_},
    {"policy": "top_down"},
    {"policy": np.str_("uniform"), "split": ["train", "val"]},
    {"split": np.array(["test"])},
    {"split": []},
    {"outcome": "success"},
    {"outcome": [Outcome.NO_PLAN, "unreachable", 5]},
    {"object_mass": make_spec(CONFIG, 4).objects[0].mass},
    {"n_steps": range(40)},
]


@pytest.mark.parametrize("conditions", CONDITIONS, ids=str)
def test_where_picks_the_committed_rows_that_match(dataset: Dataset, conditions: Any) -> None:
    def matches(episode: Episode) -> bool:
        values = {
            **{name: episode.columns[name] for name in ("policy", "split", "object_mass")},
            "success": episode.success,
            "n_steps": episode.n_steps,
        }
        words = (episode.outcome, episode.outcome.name.lower())
        return all(
            any(item in words if name == "outcome" else item == values[name] for item in wanted)
            for name, value in conditions.items()
            for wanted in [[value] if isinstance(value, str) or np.ndim(value) == 0 else value]
        )

    want = [i for i in dataset.committed if matches(make_episode(CONFIG, int(i)))]
    assert dataset.where(**conditions).indices.tolist() == want


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"outcome": "missed"}, "unknown outcome 'missed' (valid: "),
        ({"outcome": 77}, "where: outcome: got 77, valid: a code from 0 to 10, or its word: succ"),
        ({"success": "yes"}, "where: success: got 'yes', valid: bool"),
        ({"success": 1}, "where: success: got 1, valid: bool"),
        ({"policy": 3}, "where: policy: got 3, valid: string"),
        ({"object_mass": True}, "where: object_mass: got True, valid: float64"),
        ({"policy": "top-down"}, "no row has policy 'top-down'; did you mean 'top_down'? (valid: "),
        ({"split": ["train", "vla"]}, "no row has split 'vla'; did you mean 'val'? (valid: test, "),
        (
            {"lift_height": (0.05, 0.2)},
            "where: lift_height: got (0.05, 0.2), valid: Range(0.05, 0.2) for numbers between, "
            "[0.05, 0.2] for one of them",
        ),
        ({"lift_height": ">0.05"}, "where: lift_height: got '>0.05', valid: float64, or Range(at"),
        ({"grasp_position": 0.0}, "where: grasp_position has (3,) values a row, valid: one"),
    ],
)
def test_where_refuses_what_no_row_could_hold(
    dataset: Dataset, conditions: Any, message: str
) -> None:
    with pytest.raises(UsageError) as caught:
        dataset.where(**conditions)
    assert str(caught.value).startswith(message)


def test_blocks_give_each_committed_episode_once_with_its_index(dataset: Dataset) -> None:
    blocks = list(dataset.iter_blocks())
    assert [indices.tolist() for indices, _ in blocks] == [[0, 1, 2, 3], [4, 7], [12]]
    for indices, episodes in blocks:
        for i, episode in zip(indices, episodes, strict=True):
            assert episode.checksum() == make_episode(CONFIG, int(i)).checksum()
    assert [episode.spec.index for episode in dataset] == dataset.committed.tolist()


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    return opened_shards(monkeypatch)


def test_blocks_read_each_shard_once(path: Path, opened: Counter[str]) -> None:
    list(Dataset(path).iter_blocks())
    shards = [field for field in schema.expand(CONFIG) if field.length_column or field.is_image]
    assert list(opened.values()) == [1] * 3 * len(shards)


def test_an_intact_episode_verifies(dataset: Dataset) -> None:
    assert all(dataset.verify(i) for i in dataset.committed)


def test_any_changed_value_fails_to_verify(own_path: Path) -> None:
    root: Any = zarr.open_group(own_path, mode="r+")
    dataset = Dataset(own_path)
    row = int(np.flatnonzero((dataset.column("n_steps") > 0) & (dataset.status == 1))[0])
    changes = {
        "cameras/front/depth": lambda x: np.nextafter(x, np.inf, dtype=np.float32),
        "streams/phase": lambda x: x + 1,
        "episodes/success": lambda x: ~x,
        "episodes/outcome": lambda x: (x + 1) % 3,
        "episodes/policy": lambda x: x + "!",
        "episodes/spec": lambda x: x + " ",
        "episodes/checksum": lambda x: x[1:] + "0",
        "episodes/n_steps": lambda x: x - 1,
    }
    for path, change in changes.items():
        array = root[path]
        before = array[row]
        array[row] = np.asarray(change(np.asarray(before)[()]), array.dtype)
        assert not dataset.verify(row), path
        array[row] = before
    assert dataset.verify(row)


def test_a_lost_or_broken_shard_fails_to_verify_and_is_named(own_path: Path) -> None:
    shard = own_path / "streams/tcp_pose/0.0.0"
    shard.write_bytes(shard.read_bytes()[:-40])
    dataset = Dataset(own_path)
    assert not dataset.verify(0)
    with pytest.raises(StoreError) as caught:
        dataset[0]
    assert str(caught.value).startswith(
        f"{own_path}: streams/tcp_pose of episodes 0 to 0 cannot be read: "
    )
    shard.unlink()
    assert not dataset.verify(0)
    assert dataset.verify(4)


def test_the_recipes_of_several_episodes_are_those_of_each(dataset: Dataset) -> None:
    rows = dataset.committed[::-1].tolist() * 40
    found = list(dataset.specs(rows))
    assert found == [dataset.spec(row) for row in rows]
    assert [spec.to_json() for spec in found] == [str(dataset.value(row, "spec")) for row in rows]


def test_a_broken_recipe_is_named(own_path: Path) -> None:
    root: Any = zarr.open_group(own_path, mode="r+")
    root["episodes/spec"][0] = '{"index": 0}'
    for read in (Dataset(own_path).spec, Dataset(own_path).__getitem__):
        with pytest.raises(StoreError) as caught:
            read(0)
        assert str(caught.value).startswith(f"{own_path}: episode 0 is damaged: ")


def test_a_store_that_grows_while_it_is_read_shows_what_is_new(own_path: Path) -> None:
    dataset = Dataset(own_path)
    ZarrWriter(own_path).write_block(2, make_rows(CONFIG, 2, 13))
    assert dataset.committed.tolist() == [0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 12]
    assert dataset[8].spec.index == 8


def test_a_store_from_before_a_column_was_added_is_read_without_it(own_path: Path) -> None:
    shutil.rmtree(own_path / "episodes/grasp_score")
    dataset = Dataset(own_path)
    assert "grasp_score" not in dataset.columns
    assert "grasp_score" not in dataset[0].columns


@pytest.mark.parametrize("name", ["streams/tcp_pose", "cameras/front/depth"])
def test_images_and_series_that_are_lost_are_named(own_path: Path, name: str) -> None:
    """A store lists its arrays. That tells a lost array from one that a later version added."""
    (own_path / name / "zarr.json").unlink()
    with pytest.raises(StoreError, match=f"is damaged: array {name} is missing; run"):
        Dataset(own_path)


def test_it_travels_to_another_process_as_its_path(dataset: Dataset) -> None:
    there = pickle.loads(pickle.dumps(dataset))
    assert there[0].checksum() == dataset[0].checksum()


class TestWhatIsNoStoreIsRefusedInOneLine:
    def test_nothing(self, tmp_path: Path) -> None:
        with pytest.raises(StoreMismatchError) as caught:
            Dataset(tmp_path / "none")
        assert str(caught.value) == f"there is no store at {tmp_path / 'none'}"

    def test_a_file(self, tmp_path: Path) -> None:
        (tmp_path / "file").touch()
        with pytest.raises(StoreMismatchError) as caught:
            Dataset(str(tmp_path / "file"))
        message = f"{tmp_path / 'file'} is a file, not a grasp-factory store"
        assert str(caught.value) == message

    def test_a_foreign_store(self, tmp_path: Path) -> None:
        zarr.create_group(tmp_path / "v3")
        zarr.create_group(tmp_path / "v2", zarr_format=2)
        for name in ("v2", "v3", ""):
            with pytest.raises(StoreMismatchError) as caught:
                Dataset(tmp_path / name)
            assert str(caught.value) == f"{tmp_path / name} is not a grasp-factory store"

    def test_a_newer_version(self, own_path: Path) -> None:
        zarr.open_group(own_path, mode="r+").attrs["format_version"] = 2
        with pytest.raises(StoreMismatchError) as caught:
            Dataset(own_path)
        assert str(caught.value) == (
            f"{own_path} has format version 2, this version of grasp-factory reads up to 1:"
            " install a newer one"
        )

    @pytest.mark.parametrize("text", ["", "{", "[]", "null", "3", '"x"', "[" * 100_000])
    def test_broken_json(self, own_path: Path, text: str) -> None:
        (own_path / "zarr.json").write_text(text)
        with pytest.raises((StoreError, StoreMismatchError)) as caught:
            Dataset(own_path)
        assert str(caught.value).startswith(f"{own_path} is ")
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("text", ["", "[]", '{"zarr_format": 3, "node_type": "array"}'])
    def test_a_broken_array(self, own_path: Path, text: str) -> None:
        (own_path / "streams/phase/zarr.json").write_text(text)
        with pytest.raises(StoreError) as caught:
            Dataset(own_path)
        assert str(caught.value).startswith(f"{own_path} is damaged: array streams/phase: ")
        assert "\n" not in str(caught.value)

    def test_a_broken_config(self, own_path: Path) -> None:
        zarr.open_group(own_path, mode="r+").attrs["config"] = {"sed": 1}
        with pytest.raises(StoreError) as caught:
            Dataset(own_path)
        assert str(caught.value).startswith(f"{own_path} is damaged: unknown key 'sed'")
