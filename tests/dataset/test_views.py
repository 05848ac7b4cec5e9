"""Views: datasets of some rows, which read as these rows do one by one."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.bench_views import few, make
from hypothesis import given
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_rows, small_config
from support.opened_files import opened_shards

from grasp_factory import Dataset, Range
from grasp_factory.core.enums import Outcome
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.errors import MissingLibraryError, StoreError, UnknownNameError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=[16, 16])
N, QUARANTINED, MISSING = 22, (5, 6), (12, 13, 14, 15)
THERE = [i for i in range(N) if i not in QUARANTINED + MISSING]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store in blocks of 4, of which block 3 is missing."""
    path = tmp_path_factory.mktemp("views") / "store"
    prepare_store(path, CONFIG, JOINTS, N, {})
    for block in (0, 1, 2, 4, 5):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, N, QUARANTINED))
    return path


@pytest.fixture(scope="module")
def dataset(path: Path) -> Dataset:
    return Dataset(path)


def numbers_of(view: Dataset) -> list[int]:
    """Return the index of each episode of a view, which is its row in this store."""
    return [episode.spec.index for episode in view]


rows_of_views = st.lists(st.sampled_from(THERE), max_size=12)


@given(rows=rows_of_views)
def test_a_view_reads_as_its_rows_one_by_one(dataset: Dataset, rows: list[int]) -> None:
    view = dataset.select(rows)
    assert (len(view), view.indices.tolist(), numbers_of(view)) == (len(rows), rows, rows)
    assert view.committed.tolist() == list(range(len(rows)))
    for name in ("object_mass", "policy", "outcome", "grasp_position"):
        np.testing.assert_array_equal(view.column(name), dataset.column(name)[rows])
        np.testing.assert_array_equal(view[name], dataset[name][rows])
    for k, row in enumerate(rows[:3]):
        assert view[k].checksum() == dataset[row].checksum()
        assert view.value(k, "object_id") == dataset.value(row, "object_id")
        assert view.spec(k) == dataset.spec(row)
        assert view.verify(k)
        images = view.image(k, "front", "rgb", 0), dataset.image(row, "front", "rgb", 0)
        np.testing.assert_array_equal(*images)


@given(rows=rows_of_views, data=st.data())
def test_a_view_of_a_view_is_that_of_a_list(
    dataset: Dataset, rows: list[int], data: st.DataObject
) -> None:
    view = dataset[rows]
    ends = st.none() | st.integers(-14, 14)
    chosen = slice(data.draw(ends), data.draw(ends), data.draw(st.sampled_from([None, 1, 2, -1])))
    assert view[chosen].indices.tolist() == rows[chosen]
    mask = np.array(
        data.draw(st.lists(st.booleans(), min_size=len(rows), max_size=len(rows))), bool
    )
    assert view[mask].indices.tolist() == np.array(rows, int)[mask].tolist()
    assert sorted(view.shuffle(3).indices.tolist()) == sorted(rows)
    assert view.shuffle(3).indices.tolist() == view.shuffle(3).indices.tolist()


@given(rows=rows_of_views)
def test_conditions_on_a_view_choose_among_its_rows_in_their_order(
    dataset: Dataset, rows: list[int]
) -> None:
    view, light = dataset[rows], Range(below=0.25)
    mass, policy = dataset.column("object_mass"), dataset.column("policy")
    want = [row for row in rows if mass[row] < 0.25 and policy[row] == "top_down"]
    assert view.where(object_mass=light, policy="top_down").indices.tolist() == want
    assert view.where(object_mass=light).where(policy="top_down").indices.tolist() == want


def test_the_whole_chain_is_its_rows_one_by_one(dataset: Dataset) -> None:
    view = dataset.where(object_mass=Range(below=0.4)).split("train").shuffle(1)[:10]
    table = view.to_pandas()
    assert 0 < len(table) == len(view) <= 10
    assert table.index.tolist() == view.indices.tolist()
    for row, line in zip(view.indices.tolist(), table.to_dict("records"), strict=True):
        episode = dataset[row]
        assert line["outcome"] == str(episode.outcome)
        assert line["success"] == episode.success
        for name in ("object_id", "split", "policy", "object_mass", "collision_body"):
            assert line[name] == dataset[name][row]
        np.testing.assert_array_equal(line["grasp_position"], episode.columns["grasp_position"])


def test_a_table_of_all_has_a_line_for_each_episode(dataset: Dataset) -> None:
    table = dataset.to_pandas(["outcome", "lift_height"])
    assert table.index.tolist() == THERE
    assert list(table) == ["outcome", "lift_height"]
    np.testing.assert_array_equal(table["lift_height"], dataset["lift_height"][THERE])
    with pytest.raises(UnknownNameError, match="unknown column 'outcom'; did you mean 'outcome'"):
        dataset.to_pandas(["outcom"])


@pytest.mark.parametrize(
    ("library", "read"),
    [("pandas", lambda ds: ds.to_pandas()), ("torch", lambda ds: ds.to_torch())],
)
def test_a_library_that_is_missing_is_named(
    dataset: Dataset,
    library: str,
    read: Callable[[Dataset], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
    message = rf"this needs {library}, .*: pip install 'grasp-factory\[{library}\]'"
    with pytest.raises(MissingLibraryError, match=message):
        read(dataset)


def test_a_view_opens_no_episode_until_it_is_read(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = opened_shards(monkeypatch)
    view = Dataset(path).where(success=[True, False]).shuffle(0)[2:6]
    assert not opened
    assert len(list(view)) == 4
    assert opened


@pytest.mark.parametrize(
    "how", [{}, {"checked": True}, {"noise": "stereo", "noise_seed": 3}], ids=str
)
def test_a_view_travels_to_another_process(path: Path, how: dict[str, Any]) -> None:
    view = Dataset(path, **how)[[9, 0, 9]]
    there = pickle.loads(pickle.dumps(view))
    assert there.indices.tolist() == [9, 0, 9]
    assert [e.checksum() for e in there] == [e.checksum() for e in view]
    assert there.whole.indices.tolist() == list(range(N))


class TestFilter:
    def test_takes_an_episode(self, dataset: Dataset) -> None:
        kept = dataset.filter(lambda episode: episode.success)
        assert kept.indices.tolist() == dataset.where(success=True).indices.tolist()
        of_view = dataset[[9, 0, 9, 1]].filter(lambda episode: episode.spec.index > 0)
        assert of_view.indices.tolist() == [9, 9, 1]

    def test_takes_columns_with_their_words(self, dataset: Dataset) -> None:
        kept = dataset.filter(
            lambda word, mass: word != "success" and mass < 0.3, ["outcome", "object_mass"]
        )
        outcome, mass = dataset["outcome"], dataset["object_mass"]
        want = [i for i in THERE if outcome[i] != "success" and mass[i] < 0.3]
        assert kept.indices.tolist() == want
        one = dataset.filter(lambda policy: policy == "uniform", "policy")
        assert one.indices.tolist() == dataset.where(policy="uniform").indices.tolist()


class TestWords:
    def test_are_what_a_column_of_codes_reads_as(self, dataset: Dataset) -> None:
        words = [Outcome(code).name.lower() for code in dataset.column("outcome")[THERE]]
        assert dataset["outcome"][THERE].tolist() == words
        assert set(dataset["outcome"][[*MISSING]]) == {""}
        assert dataset.column("outcome", names=True).tolist() == dataset["outcome"].tolist()
        assert dataset["success"].dtype == np.bool_

    def test_are_what_an_outcome_prints(self, dataset: Dataset) -> None:
        outcome = dataset[0].outcome
        assert f"{outcome}" == str(outcome) == f"{outcome:s}" == dataset["outcome"][0]
        assert int(outcome) == dataset.column("outcome")[0]

    def test_of_an_unknown_column_list_the_columns(self, dataset: Dataset) -> None:
        with pytest.raises(
            UnknownNameError, match="unknown column 'sucess'; did you mean 'success'"
        ):
            dataset["sucess"]


class TestUnknownTexts:
    def test_are_errors_unless_the_whole_store_has_them(self, dataset: Dataset) -> None:
        some = dataset.where(policy="uniform")
        assert len(some.where(policy="top_down")) == 0
        with pytest.raises(UnknownNameError) as caught:
            some.where(policy="topdown")
        valid = ", ".join(sorted({*dataset.column("policy")[THERE].tolist()}))
        assert str(caught.value) == (
            f"no row has policy 'topdown'; did you mean 'top_down'? (valid: {valid})"
        )

    def test_name_a_bounded_number_of_the_valid_ones(self) -> None:
        from grasp_factory.errors import unknown_value

        message = str(unknown_value("object_id", "x", [f"{i:03}" * 99 for i in range(70)]))
        assert "and 20 more" in message
        assert len(message) < 4000

    def test_say_how_several_are_written(self, dataset: Dataset) -> None:
        with pytest.raises(UnknownNameError, match=r"for any of several: \[val,test\]"):
            dataset.where(split="val,test")

    def test_of_a_store_without_episodes_find_nothing(self, tmp_path: Path) -> None:
        prepare_store(tmp_path / "empty", CONFIG, JOINTS, 4, {})
        assert len(Dataset(tmp_path / "empty").where(policy="uniform", split="test")) == 0


def test_a_shuffle_needs_a_seed_that_is_a_number(dataset: Dataset) -> None:
    for seed in (-1, 1.5, True):
        with pytest.raises(UsageError, match=r"seed: got .*, valid: a whole number from 0 on"):
            dataset.shuffle(seed)  # type: ignore[arg-type]


def test_many_rows_are_checked_as_few_are(dataset: Dataset) -> None:
    many = np.tile(THERE, 10)
    assert dataset[many].indices.tolist() == many.tolist()
    with pytest.raises(StoreError, match="episode 5 is quarantined: no luck with 5"):
        dataset[np.append(many, 5)]


def test_annotations_and_labels_of_a_view_are_those_of_its_rows(path: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(path, tmp_path / "copy"))
    AnnotationLog(copy).append("anna", [0, 9], [("tag", "odd")])
    view = Dataset(copy)[[9, 1, 0, 9]]
    assert sorted(view.annotations) == [0, 2, 3]
    assert view.tagged("odd").indices.tolist() == [9, 0, 9]


def test_an_export_of_a_view_has_its_rows(dataset: Dataset, tmp_path: Path) -> None:
    view = dataset[[9, 0, 2]]
    done = view.export("coco", tmp_path / "out", [0, 2])
    assert done.episodes == 2


def test_a_view_is_a_data_set_of_a_loader(dataset: Dataset) -> None:
    data = pytest.importorskip("torch.utils.data")
    view = dataset.where(success=[True, False]).shuffle(2)
    loader = data.DataLoader(view, 4, num_workers=2, collate_fn=_masses, timeout=100)
    masses = [mass for batch in loader for mass in batch]
    np.testing.assert_array_equal(masses, view["object_mass"])


def _masses(episodes: list[Any]) -> list[float]:
    return [episode.columns["object_mass"] for episode in episodes]


@pytest.mark.soak
@pytest.mark.slow
def test_a_million_rows_are_chosen_as_one_by_one(tmp_path: Path) -> None:
    make(tmp_path / "s", 1_000_000)
    dataset = Dataset(tmp_path / "s")
    view = few(dataset)
    table = view.to_pandas()
    columns = [dataset.column(name).tolist() for name in ("success", "policy", "split")]
    rows = enumerate(zip(*columns, strict=True))
    want = [row for row, values in rows if values == (False, "top_down", "test")]
    assert len(dataset) >= 1_000_000
    assert np.random.default_rng(1).permutation(want)[:10].tolist() == view.indices.tolist()
    for row, line in zip(view.indices.tolist(), table.to_dict("records"), strict=True):
        assert line["object_mass"] == dataset.value(row, "object_mass")
        assert line["object_id"] == dataset.value(row, "object_id")
