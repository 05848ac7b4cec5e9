"""Choosing and reading many episodes: ranges, slices, blocks, splits, balanced draws."""

from __future__ import annotations

import hashlib
import math
import pickle
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_episode, make_rows, small_config
from support.opened_files import opened_shards
from support.places import TINY

from grasp_factory import Range
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.splits import SPLITS
from grasp_factory.dataset import episode_reader
from grasp_factory.dataset.balanced_sampling import draw_evenly
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, UnknownNameError, UsageError
from grasp_factory.objects import OBJECT_SETS, UrdfFile
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.world import DATA
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=[16, 16])
N = 22
QUARANTINED, MISSING = (5, 6), (12, 13, 14, 15)
THERE = [i for i in range(N) if i not in QUARANTINED + MISSING]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store in blocks of 4, of which block 3 is missing."""
    path = tmp_path_factory.mktemp("reading") / "store"
    prepare_store(path, CONFIG, JOINTS, N, {})
    for block in (0, 1, 2, 4, 5):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, N, QUARANTINED))
    return path


@pytest.fixture(scope="module")
def dataset(path: Path) -> Dataset:
    dataset = Dataset(path)
    assert dataset.committed.tolist() == THERE
    return dataset


def indices_of(episodes: Iterable[Any]) -> list[int]:
    return [episode.spec.index for episode in episodes]


bounds = st.none() | st.integers(-3, 3) | st.floats(-3, 3)


class TestRange:
    @given(low=bounds, high=bounds, values=st.lists(st.floats(-4, 4) | st.just(math.nan)))
    def test_holds_what_is_from_one_bound_on_and_below_the_other(
        self, low: float | None, high: float | None, values: list[float]
    ) -> None:
        if (low is None and high is None) or (None not in (low, high) and low >= high):  # type: ignore[operator]
            with pytest.raises(UsageError, match="Range: got at_least "):
                Range(low, high)
            return
        held = Range(low, high).holds(np.array(values))
        least, top = (-math.inf if low is None else low), (math.inf if high is None else high)
        assert held.tolist() == [least <= value < top for value in values]

    @given(cuts=st.lists(st.integers(-5, 5), min_size=1, unique=True).map(sorted))
    def test_s_that_follow_one_another_share_nothing_and_leave_nothing_out(
        self, cuts: list[int]
    ) -> None:
        values = np.arange(-10, 10)
        parts = [Range(low, high) for low, high in zip([None, *cuts], [*cuts, None], strict=True)]
        assert np.sum([part.holds(values) for part in parts], axis=0).tolist() == [1] * 20

    @pytest.mark.parametrize(
        "bounds",
        [(math.nan, 1.0), (0.0, math.inf), ("0", 1), (True, 2), (1.0, 1.0), (10**400,), ([0], 1)],
        ids=str,
    )
    def test_of_what_is_no_pair_of_numbers_is_refused(self, bounds: Any) -> None:
        with pytest.raises(UsageError) as caught:
            Range(*bounds)
        valid = "two finite numbers, the first the smaller one, or one of them and None"
        assert str(caught.value).startswith("Range: got at_least ")
        assert str(caught.value).endswith(f", valid: {valid}")

    @given(data=st.data())
    def test_in_where_picks_the_rows_that_it_holds(
        self, dataset: Dataset, data: st.DataObject
    ) -> None:
        name = data.draw(st.sampled_from(["object_mass", "grasp_score", "n_steps", "quality"]))
        column = dataset.column(name)
        known = np.unique(column[THERE][~np.isnan(column[THERE])]).tolist()
        low, high = data.draw(st.lists(st.sampled_from(known), min_size=2, max_size=2, unique=True))
        asked = Range(*sorted([low, high]))
        want = [i for i in THERE if min(low, high) <= column[i] < max(low, high)]
        assert dataset.where(**{name: asked}).indices.tolist() == want
        with_one_more = [i for i in THERE if i in want or column[i] == max(low, high)]
        assert dataset.where(**{name: [asked, max(low, high)]}).indices.tolist() == with_one_more

    def test_never_holds_what_is_not_there(self, dataset: Dataset) -> None:
        score = dataset.column("grasp_score")[THERE]
        assert np.isnan(score).any()
        kept = dataset.where(grasp_score=[Range(below=0.0), Range(at_least=0.0)])
        assert kept.indices.tolist() == [
            i for i, s in zip(THERE, score, strict=True) if not np.isnan(s)
        ]

    @pytest.mark.parametrize(
        ("column", "valid"),
        [("success", "bool"), ("policy", "string"), ("outcome", "words, of success, never_")],
    )
    def test_of_what_is_no_number_is_refused(
        self, dataset: Dataset, column: str, valid: str
    ) -> None:
        with pytest.raises(UsageError) as caught:
            dataset.where(**{column: Range(0, 1)})
        got = "got Range(at_least=0, below=1)"
        assert str(caught.value).startswith(f"where: {column}: {got}, valid: {valid}")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Return a store of 6 in which every row is there."""
    path = tmp_path_factory.mktemp("whole") / "store"
    prepare_store(path, CONFIG, JOINTS, 6, {})
    for block in (0, 1):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, 6))
    return Dataset(path)


ends = st.none() | st.integers(-9, 9)


class TestSeveralAtOnce:
    @given(start=ends, stop=ends, step=st.none() | st.integers(-4, 4).filter(bool))
    def test_a_slice_is_that_of_a_list(
        self, whole: Dataset, start: int | None, stop: int | None, step: int | None
    ) -> None:
        chosen = slice(start, stop, step)
        assert indices_of(whole[chosen]) == list(range(6))[chosen]

    @given(rows=st.lists(st.integers(-6, 5), max_size=8))
    def test_indices_give_their_episodes_in_their_order(
        self, whole: Dataset, rows: list[int]
    ) -> None:
        want = [i % 6 for i in rows]
        assert indices_of(whole[rows]) == want
        assert indices_of(whole[np.array(rows, np.int32)]) == want

    def test_every_episode_is_the_one_that_is_read_alone(self, dataset: Dataset) -> None:
        some = dataset.where(success=[True, False])
        for i, episode in zip(some.indices, some, strict=True):
            assert episode.checksum() == dataset[i].checksum()

    def test_a_row_without_an_episode_is_told_not_skipped(self, dataset: Dataset) -> None:
        for rows in (slice(4, 8), [7, 5], np.array([-17])):
            with pytest.raises(StoreError, match="episode 5 is quarantined: no luck with 5"):
                dataset[rows]
        with pytest.raises(StoreError, match="episode 12 is missing"):
            dataset[8:14]

    @pytest.mark.parametrize(
        ("rows", "error", "message"),
        [
            ([0, N], IndexError, "episode 22: valid: -22 to 21"),
            (np.array([2**63], np.uint64), IndexError, "episode 9223372036854775808: valid: "),
            ([10**30], IndexError, f"episode {10**30}: valid: "),
            ([0, 1.0], TypeError, "episode index: got 1.0, valid: one integer"),
            (np.array([0.5]), TypeError, "episode index: got "),
            (np.zeros((2, 2), int), TypeError, "episode indices: got an array of shape (2, 2)"),
            (np.array(3), TypeError, "episode indices: got an array of shape (), valid: shape"),
            ([True, False], TypeError, "for a mask: ds[np.array(mask)]"),
            (np.ones(N - 1, bool), IndexError, "got a mask of 21 truth values, valid: 22 of them"),
        ],
    )
    def test_what_is_no_list_of_rows_says_what_is(
        self, dataset: Dataset, rows: Any, error: type[Exception], message: str
    ) -> None:
        for read in (dataset.__getitem__, dataset.iter_blocks, dataset.select):
            with pytest.raises(error) as caught:
                read(rows)
            assert message in str(caught.value)


class TestBlocksOfSomeRows:
    @given(rows=st.lists(st.sampled_from(THERE), max_size=30))
    def test_come_as_they_are_first_named_each_once(
        self, dataset: Dataset, rows: list[int]
    ) -> None:
        blocks = list(dataset.iter_blocks(rows))
        numbers = [int(mine[0]) // 4 for mine, _ in blocks]
        assert numbers == list(dict.fromkeys(row // 4 for row in rows))
        for number, (mine, episodes) in zip(numbers, blocks, strict=True):
            assert mine.tolist() == [row for row in rows if row // 4 == number]
            assert indices_of(episodes) == mine.tolist()

    def test_read_each_shard_once_for_rows_that_follow_one_another(
        self, path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        opened = opened_shards(monkeypatch)
        dataset = Dataset(path)
        for take in (
            lambda: list(dataset[7:11]),
            lambda: list(dataset[[10, 9, 8, 9]]),
            lambda: list(dataset.iter_blocks([20, 4, 7, 21])),
        ):
            opened.clear()
            take()
            assert set(opened.values()) == {1}

    @pytest.mark.parametrize("most", [0, 2**24])
    def test_come_one_by_one_in_the_order_of_their_rows_however_large_their_images(
        self, dataset: Dataset, most: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(episode_reader, "MOST_STILLS", most)
        rows = [20, 4, 7, 21, 4]
        want = [dataset[row].checksum() for row in rows]
        assert [episode.checksum() for episode in dataset.iter_episodes(rows)] == want

    def test_read_no_episode_that_is_not_asked_for(self, path: Path, tmp_path: Path) -> None:
        """The one between is damaged, which reading it with checks would tell."""
        copy = Path(shutil.copytree(path, tmp_path / "copy"))
        depth: Any = zarr.open_group(copy, mode="r+")["cameras/front/depth"]
        depth[9] = depth[9] + np.float32(1.0)
        dataset = Dataset(copy, checked=True)
        with pytest.raises(StoreError, match="episode 9 is damaged"):
            list(dataset[8:11])
        assert indices_of(dataset[[10, 8]]) == [10, 8]
        assert [mine.tolist() for mine, _ in dataset.iter_blocks([8, 10, 11])] == [[8, 10, 11]]

    def test_have_the_time_series_that_are_asked_for_and_all_times(self) -> None:
        dataset = Dataset(TINY)
        for row, episode in enumerate(dataset.iter_episodes([0, 1], ["streams/tcp_pose"])):
            whole = dataset[row]
            assert list(episode.streams) == ["timestamp", "tcp_pose"]
            assert set(episode.imu) == {"timestamp", "T_tcp_imu"}
            np.testing.assert_array_equal(episode.streams["tcp_pose"], whole.streams["tcp_pose"])
            assert (episode.n_steps, episode.n_imu) == (whole.n_steps, whole.n_imu)
            assert episode.columns.keys() == whole.columns.keys()

    @pytest.mark.parametrize("noise", [None, "stereo"])
    @pytest.mark.parametrize("name", ["tcp_pose", "episodes/seed", 3])
    def test_refuse_an_unknown_time_series_before_anything_is_read(
        self, name: Any, noise: str | None
    ) -> None:
        with pytest.raises(UnknownNameError, match=f"unknown time series '{name}'"):
            Dataset(TINY, noise=noise).iter_episodes([], iter([name]))

    def test_name_a_time_series_that_a_store_without_digests_lacks(
        self, path: Path, tmp_path: Path
    ) -> None:
        copy = Path(shutil.copytree(path, tmp_path / "copy"))
        shutil.rmtree(copy / "streams/tcp_pose")
        shutil.rmtree(copy / "episodes/array_crc32c")
        with pytest.raises(StoreError, match="is damaged: streams/tcp_pose is missing"):
            Dataset(copy).iter_episodes([0], ["streams/tcp_pose"])

    def test_with_noise_have_all_time_series(self) -> None:
        dataset = Dataset(TINY, noise="stereo")
        (episode,) = dataset.iter_episodes([0], [])
        assert episode.checksum() == dataset[0].checksum()

    @pytest.mark.parametrize("how", [{}, {"checked": True}, {"noise": "stereo"}], ids=str)
    def test_are_those_read_alone_however_it_is_opened(self, how: dict[str, Any]) -> None:
        dataset = Dataset(TINY, **how)
        rows = [3, 0, 2, 3]
        want = [dataset[i].checksum() for i in rows]
        there = pickle.loads(pickle.dumps(dataset))
        assert [episode.checksum() for episode in there[rows]] == want
        [(mine, episodes)] = there.iter_blocks(rows)
        assert mine.tolist() == rows
        assert [episode.checksum() for episode in episodes] == want


class TestLengths:
    @pytest.mark.parametrize("column", ["n_steps", "n_imu"])
    @pytest.mark.parametrize("length", [-5, -1, 2**31 - 1])
    def test_that_no_time_series_has_are_refused(
        self, column: str, length: int, tmp_path: Path
    ) -> None:
        store = shutil.copytree(TINY, tmp_path / "tiny.zarr")
        array = zarr.open_array(store / "episodes" / column, mode="r+")
        array[0] = length
        damaged = Dataset(store)
        message = f"episode 0 is damaged: episodes/{column}: got {length}, valid: 0 to "
        with pytest.raises(StoreError, match=message):
            damaged[0]
        assert damaged[1].n_steps >= 0
        if column == "n_steps":
            with pytest.raises(StoreError, match=message):
                damaged.series(0, "timestamp")


class TestSplits:
    def test_are_the_rows_of_that_word(self, dataset: Dataset) -> None:
        for name in SPLITS:
            want = [i for i in THERE if make_episode(CONFIG, i).columns["split"] == name]
            assert dataset.split(name).indices.tolist() == want
        assert sorted(np.concatenate([dataset.split(name).indices for name in SPLITS])) == THERE

    def test_of_another_name_are_refused(self, dataset: Dataset) -> None:
        with pytest.raises(UnknownNameError) as caught:
            dataset.split("trian")
        assert str(caught.value) == (
            "unknown split 'trian'; did you mean 'train'? (valid: test, train, val)"
        )

    @pytest.mark.soak
    @pytest.mark.slow
    @settings(max_examples=25)
    @given(seed=st.integers(0, 2**31), first=st.integers(0, 10**6), count=st.integers(1, 4))
    def test_share_no_object_neither_as_target_nor_around_it(
        self, seed: int, first: int, count: int
    ) -> None:
        config = FactoryConfig.from_plain(
            {
                "seed": seed,
                "object_sets": dict.fromkeys(OBJECT_SETS, 1.0),
                "clutter": {"count": count},
            }
        )
        split_of: dict[str, str] = {}
        for index in range(first, first + 30):
            objects = sample_spec(config, index).objects
            assert len({each.split for each in objects}) == 1
            for each in objects:
                assert split_of.setdefault(each.object_id, each.split) == each.split

    def test_share_no_shape(self) -> None:
        """Ids are what splits hang on, so two of them must not stand for one mesh."""
        split_of: dict[str, tuple[str, str]] = {}
        for objects in OBJECT_SETS.values():
            for object_id, model in getattr(objects, "models", {}).items():
                if not isinstance(model.body, UrdfFile):
                    continue
                folder = DATA / model.body.path
                urdf = folder.read_text(encoding="utf-8")
                meshes = sorted(set(re.findall(r'filename="([^"]+\.obj)"', urdf)))
                content = [(folder.parent / mesh).read_bytes() for mesh in meshes]
                key = hashlib.sha256(b"\0".join(content or [urdf.encode()])).hexdigest()
                known, was = split_of.setdefault(key, (object_id, model.split))
                assert was == model.split, (known, object_id)
        assert len(split_of) > 100


classes_of_rows = st.lists(st.sampled_from("abc"), min_size=2).filter(lambda c: len(set(c)) > 1)


class TestEvenDraws:
    @given(classes=classes_of_rows, seed=st.integers(0, 2**63))
    def test_without_a_number_take_the_smallest_class_of_each(
        self, classes: list[str], seed: int
    ) -> None:
        drawn = draw_evenly(np.array(classes), None, seed).tolist()
        smallest = min(Counter(classes).values())
        assert Counter(classes[i] for i in drawn) == dict.fromkeys(classes, smallest)
        assert len(set(drawn)) == len(drawn)

    @given(classes=classes_of_rows, n=st.integers(1, 60), seed=st.integers(0, 9))
    def test_have_as_many_of_each_class_and_repeat_only_as_far_as_needed(
        self, classes: list[str], n: int, seed: int
    ) -> None:
        drawn = draw_evenly(np.array(classes), n, seed).tolist()
        there, times = Counter(classes), Counter(drawn)
        taken = {word: sum(classes[i] == word for i in drawn) for word in there}
        assert sum(taken.values()) == n
        assert max(taken.values()) - min(taken.values()) <= 1
        for i, word in enumerate(classes):
            rounds, rest = divmod(taken[word], there[word])
            assert rounds <= times[i] <= rounds + (rest > 0)

    @given(classes=classes_of_rows, n=st.none() | st.integers(1, 60), seed=st.integers(0, 9))
    def test_hang_on_the_seed_alone(self, classes: list[str], n: int | None, seed: int) -> None:
        draws = [draw_evenly(np.array(classes), n, seed).tolist() for _ in range(2)]
        assert draws[0] == draws[1]

    def test_take_every_row_and_every_order_in_the_long_run(self) -> None:
        classes = np.array(["a", "b", "b", "b"])
        draws = [tuple(draw_evenly(classes, None, seed).tolist()) for seed in range(200)]
        assert set(draws) == {(0, i) for i in (1, 2, 3)} | {(i, 0) for i in (1, 2, 3)}
        firsts = [int(draw_evenly(classes, 1, seed)[0] == 0) for seed in range(400)]
        assert abs(sum(firsts) - 200) < 4 * math.sqrt(400 * 0.25)

    @pytest.mark.parametrize(
        ("classes", "n", "seed", "message"),
        [
            (["a"] * 5, None, 0, "all 5 rows are of one class, valid: rows of two classes or more"),
            ([], 3, 0, "there are no rows, valid: rows of two classes or more"),
            (["a", "b"], 0, 0, "n: got 0, valid: a whole number from 1 on, or None"),
            (["a", "b"], True, 0, "n: got True, valid: a whole number from 1 on, or None"),
            (["a", "b"], 2.0, 0, "n: got 2.0, valid: a whole number from 1 on, or None"),
            (["a", "b"], 2, -1, "seed: got -1, valid: a whole number from 0 on"),
            (["a", "b"], 2, None, "seed: got None, valid: a whole number from 0 on"),
        ],
    )
    def test_of_what_cannot_be_drawn_from_are_refused(
        self, classes: list[str], n: Any, seed: Any, message: str
    ) -> None:
        with pytest.raises(UsageError) as caught:
            draw_evenly(np.array(classes), n, seed)
        assert str(caught.value) == message


class TestBalancedRows:
    @pytest.mark.parametrize("by", ["policy", "outcome", "split"])
    @pytest.mark.parametrize("n", [None, 40])
    def test_have_as_many_of_each_value(self, dataset: Dataset, by: str, n: int | None) -> None:
        column = dataset.column(by)
        rows = dataset.balanced(by=by, n=n, seed=4).indices
        counts = Counter(column[rows].tolist())
        assert set(counts) == set(column[THERE].tolist())
        assert max(counts.values()) - min(counts.values()) <= 1
        assert set(rows.tolist()) <= set(THERE)
        assert len(rows) == (n or len(rows))

    @given(rows=st.permutations(THERE), twice=st.lists(st.sampled_from(THERE)))
    def test_hang_on_which_rows_there_are_and_not_on_their_order(
        self, dataset: Dataset, rows: list[int], twice: list[int]
    ) -> None:
        want = dataset[THERE].balanced(by="split", n=9, seed=1).indices.tolist()
        drawn = dataset[[*rows, *twice]].balanced(by="split", n=9, seed=1)
        assert drawn.indices.tolist() == want
        assert dataset.balanced(by="split", n=9, seed=1).indices.tolist() == want

    def test_are_drawn_from_those_that_are_given(self, dataset: Dataset) -> None:
        some = dataset.where(policy="uniform")
        drawn = some.balanced(by="split", n=30)
        assert set(drawn.indices.tolist()) == set(some.indices.tolist())

    @pytest.mark.parametrize(
        ("read", "message"),
        [
            (
                lambda ds: ds.where(policy="uniform").balanced(by="policy"),
                r"balanced by policy: all \d+ rows are of one class, valid: rows of two classes",
            ),
            (
                lambda ds: ds[[]].balanced(),
                "balanced by success: there are no rows, valid: rows of",
            ),
            (
                lambda ds: ds.balanced(by="object_mass"),
                "balanced: object_mass has real numbers, valid: one word, truth value or",
            ),
            (
                lambda ds: ds.balanced(by="object_ids"),
                r"balanced: object_ids has \(1,\) values a row, valid: one word, truth value or",
            ),
            (lambda ds: ds.balanced(by="polcy"), "unknown column 'polcy'; did you mean 'policy'"),
        ],
    )
    def test_of_what_has_no_classes_are_refused(
        self, dataset: Dataset, read: Callable[[Dataset], Any], message: str
    ) -> None:
        with pytest.raises(UsageError, match=message):
            read(dataset)
