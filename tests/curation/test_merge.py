"""Merging: several stores into one, with the same episodes in it, or nothing at all."""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.elsewhere import HERE, THERE, set_texts
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree, tree
from support.scale import scaled, soak_only
from support.scenes import SMALL
from support.stored import old_store

from grasp_factory.core.atomic_file import write_atomic
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.place import place_at
from grasp_factory.core.platforms import FINGERPRINT, Fingerprint
from grasp_factory.curation.merge import Collected, building, merge, split
from grasp_factory.curation.merge.union import NOBODY, Rows, in_place, union
from grasp_factory.curation.relabel import relabel
from grasp_factory.curation.replay import replay
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import (
    GraspFactoryError,
    IrregularFileError,
    StoreBusyError,
    StoreError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.factory import generate as factory
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.header import root_attributes
from grasp_factory.writers.zarr.label_columns import NOT_LABELLED, write_label
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.metadata_checksum import SEAL, seal
from grasp_factory.writers.zarr.store import create_store, prepare_store

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "grasp_factory"]
CONFIG = small_config(resolution=[16, 16])
OTHER = replace(CONFIG, seed=5)
SIZE = CONFIG.block_size
N = 14
"""Three whole blocks of 4 and a short one."""
BLOCKS = range(-(-N // SIZE))
BAD = (5, 13)
"""Quarantined episodes."""


def make_store(
    path: Path,
    config: FactoryConfig = CONFIG,
    n: int = N,
    blocks: Iterable[int] = BLOCKS,
    **facts: Any,
) -> Path:
    """Make a store of fake episodes, of which only some blocks are there."""
    attributes = root_attributes(config, {}) | facts
    create_store(path, config, attributes, joints=JOINTS, n=n, carried={})
    for block in blocks:
        ZarrWriter(path).write_block(block, make_rows(config, block, n, BAD))
    return path


def part_of(store: Path, path: Path, blocks: Iterable[int]) -> Path:
    """Make a copy of a store in which only some blocks are there."""
    kept = {str(block) for block in blocks}

    def others(_: str, names: list[str]) -> list[str]:
        chunks = [name for name in names if name[0].isdecimal()]
        return [name for name in chunks if name.partition(".")[0] not in kept]

    return Path(shutil.copytree(store, path, ignore=others))


def with_fact(key: str, **facts: str) -> dict[str, Any]:
    """Return root attributes of which a few facts under ``key`` are others."""
    return {key: root_attributes(CONFIG, {})[key] | facts}


def rows_of(path: Path) -> list[tuple[int, int, int, str]]:
    """Return status, seed, index and checksum of each row."""
    dataset = Dataset(path)
    columns = (dataset.column(c).tolist() for c in ("status", "seed", "index", "checksum"))
    return list(zip(*columns, strict=True))


def present(path: Path) -> set[tuple[int, int, int, str]]:
    return {row for row in rows_of(path) if row[0]}


def edit_attributes(path: Path, **changes: Any) -> None:
    """Change a store's root attributes, and seal them again."""
    document = json.loads((path / "zarr.json").read_bytes())
    document["attributes"] |= changes
    del document["attributes"][SEAL]
    write_atomic(path / "zarr.json", json.dumps(document).encode())
    seal(place_at(path / "zarr.json"))


def run(*args: object, **more: Any) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **more)


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of stores that no test changes.

    ``whole`` has all blocks of a seed, ``even`` and ``odd`` those of a number, ``other`` is of
    another seed.
    """
    folder = tmp_path_factory.mktemp("stores")
    make_store(folder / "whole")
    part_of(folder / "whole", folder / "even", BLOCKS[::2])
    part_of(folder / "whole", folder / "odd", BLOCKS[1::2])
    make_store(folder / "other", OTHER, n=6, blocks=range(2))
    return folder


@pytest.fixture(scope="module")
def mixed(stores: Path) -> Path:
    """Return a store of ``even`` and ``other``, which no test changes."""
    merge([stores / "even", stores / "other"], stores / "mixed")
    return stores / "mixed"


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return real episodes: ``whole``, and ``a`` and ``b`` with two blocks each."""
    folder = tmp_path_factory.mktemp("labelled")
    config = replace(SMALL, resolution=(32, 24), block_size=4)
    factory.generate(config, 14, folder / "whole", workers=1)
    for name, blocks in (("a", [0, 2]), ("b", [1, 3])):
        part_of(folder / "whole", folder / name, blocks)
    for name in ("whole", "a", "b"):
        relabel(folder / name, "firm", LabelConfig(min_grip_force=30.0))
    return folder


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of so many blocks that a merge takes a second."""
    path = tmp_path_factory.mktemp("many") / "store"
    return make_store(path, n=48, blocks=range(12))


class TestUnion:
    """Which row of which store becomes which row of the result."""

    ROWS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 9)), max_size=12, unique=True)

    @staticmethod
    def rows(keys: Sequence[tuple[int, int]]) -> Rows:
        seeds, indices = np.array(keys, np.int64).reshape(-1, 2).T
        row = np.arange(len(keys))
        return Rows(row=row, seed=seeds, index=indices, is_quarantined=row < 0)

    @given(st.lists(ROWS, min_size=1, max_size=4))
    def test_each_recipe_is_in_it_once_in_the_stated_order(self, stores: list[Any]) -> None:
        plan = union([self.rows(keys) for keys in stores]).plan
        got = list(zip(plan.seed.tolist(), plan.index.tolist(), strict=True))
        everything = [key for keys in stores for key in keys]
        seeds = list(dict.fromkeys(seed for seed, _ in everything))
        assert got == sorted(set(everything), key=lambda key: (seeds.index(key[0]), key[1]))

    @given(st.lists(ROWS, min_size=1, max_size=4))
    def test_a_row_comes_from_the_first_store_that_has_it(self, stores: list[Any]) -> None:
        found = union([self.rows(keys) for keys in stores])
        for plan in (found.plan, *found.repeats):
            for store, row, *key in zip(
                plan.store, plan.row, plan.seed.tolist(), plan.index.tolist(), strict=True
            ):
                assert stores[store][row] == tuple(key)
        for store, *key in zip(
            found.plan.store, found.plan.seed.tolist(), found.plan.index.tolist(), strict=True
        ):
            assert store == next(k for k, keys in enumerate(stores) if tuple(key) in keys)

    @given(st.lists(ROWS, min_size=1, max_size=4))
    def test_what_is_left_out_stands_beside_what_is_in_its_place(self, stores: list[Any]) -> None:
        found = union([self.rows(keys) for keys in stores])
        left_out, kept = found.repeats
        assert (left_out.seed == kept.seed).all()
        assert (left_out.index == kept.index).all()
        assert (left_out.store > kept.store).all()
        assert len(left_out) + len(found.plan) == sum(map(len, stores))

    def test_an_episode_comes_before_one_in_quarantine_whatever_the_order(self) -> None:
        bad = self.rows([(0, 0), (0, 1)])
        bad = replace(bad, is_quarantined=np.array([True, True]))
        plan = union([bad, self.rows([(0, 1)])]).plan
        assert plan.store.tolist() == [0, 1]

    @given(st.sets(st.integers(0, 19)), st.integers(0, 3))
    def test_in_a_plain_store_the_row_is_the_index(self, indices: set[int], more: int) -> None:
        rows = self.rows([(7, index) for index in sorted(indices, reverse=True)])
        length = max(indices, default=0) + 1 + more
        plan = in_place(union([rows]).plan, 7, length)
        assert set(np.flatnonzero(plan.store != NOBODY).tolist()) == indices
        assert plan.index.tolist() == list(range(length))
        for index in indices:
            assert rows.index[plan.row[index]] == index

    @given(st.lists(ROWS, min_size=1, max_size=4))
    def test_stretches_cover_each_row_that_is_there(self, stores: list[Any]) -> None:
        plan = union([self.rows(keys) for keys in stores]).plan
        covered = [(k, row) for k, first, stop in plan.runs() for row in range(first, stop)]
        assert covered == list(zip(plan.store.tolist(), plan.row.tolist(), strict=True))


class TestPartsOfOneDataset:
    """Stores of one seed, of which each has some blocks."""

    def test_together_they_are_the_store_of_one_run(self, stores: Path, tmp_path: Path) -> None:
        done = merge([stores / "even", stores / "odd"], tmp_path / "out")
        assert_same_tree(tmp_path / "out", stores / "whole")
        assert (done.rows, done.committed, done.quarantined, done.missing) == (N, N - 2, 2, 0)
        assert done.can_grow
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["out", "out.origin.json"]

    @settings(max_examples=scaled(2, 8))
    @given(
        spread=st.lists(st.sets(st.integers(0, 2), max_size=3), min_size=4, max_size=4),
        order=st.permutations(range(3)),
    )
    def test_any_spread_of_the_blocks_gives_their_union(
        self, stores: Path, tmp_path_factory: pytest.TempPathFactory, spread: Any, order: Any
    ) -> None:
        folder = tmp_path_factory.mktemp("spread")
        parts = [
            part_of(stores / "whole", folder / f"part{k}", [b for b in BLOCKS if k in spread[b]])
            for k in order
        ]
        done = merge(parts, folder / "out")
        there = [b for b in BLOCKS if spread[b]]
        assert_same_tree(folder / "out", part_of(stores / "whole", folder / "want", there))
        assert done.missing == N - sum(min(SIZE, N - b * SIZE) for b in there)
        assert done.repeated == sum(min(SIZE, N - b * SIZE) * (len(spread[b]) - 1) for b in there)

    def test_the_longest_gives_the_length(self, stores: Path, tmp_path: Path) -> None:
        short = make_store(tmp_path / "short", n=6, blocks=[0, 1])
        done = merge([short, stores / "odd"], tmp_path / "out")
        assert done.rows == N
        assert [row[0] for row in rows_of(tmp_path / "out")] == [
            *[1, 1, 1, 1, 1, 2, 1, 1],
            *[0, 0, 0, 0, 1, 2],
        ]

    def test_rows_of_a_block_that_was_cut_short_stay_without_those_after_them(
        self, stores: Path, tmp_path: Path
    ) -> None:
        short = make_store(tmp_path / "short", n=6, blocks=[0, 1])
        done = merge([stores / "even", short], tmp_path / "out")
        assert [row[0] for row in rows_of(tmp_path / "out")][4:8] == [1, 2, 0, 0]
        assert done.missing == N - 4 - 2 - 4

    def test_one_store_alone_is_copied(self, stores: Path, tmp_path: Path) -> None:
        merge([stores / "even"], tmp_path / "out")
        assert_same_tree(tmp_path / "out", stores / "even")

    def test_columns_are_packed_as_a_run_does(
        self, stores: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", 2)
        shutil.copytree(stores / "whole", tmp_path / "want")
        segment_packing.pack(tmp_path / "want")
        merge([stores / "even", stores / "odd"], tmp_path / "out")
        assert (tmp_path / "out" / "packed" / "0-1.npz").exists()
        assert_same_tree(tmp_path / "out", tmp_path / "want")

    def test_the_inputs_stay_as_they_are(self, stores: Path, tmp_path: Path) -> None:
        before = tree(stores)
        merge([stores / "even", stores / "odd", stores / "other"], tmp_path / "out")
        assert tree(stores) == before

    def test_a_part_that_is_being_written_may_be_read(self, stores: Path, tmp_path: Path) -> None:
        with StoreLock(stores / "even"):
            merge([stores / "even", stores / "odd"], tmp_path / "out")
        assert_same_tree(tmp_path / "out", stores / "whole")

    def test_an_episode_that_one_has_quarantined_is_taken_from_the_other(
        self, stores: Path, tmp_path: Path
    ) -> None:
        bad = make_store(tmp_path / "bad", blocks=[])
        ZarrWriter(bad).write_block(0, make_rows(CONFIG, 0, N, quarantined=(0, 1, 2, 3)))
        for order in ([bad, stores / "whole"], [stores / "whole", bad]):
            merge(order, tmp_path / "out")
            assert_same_tree(tmp_path / "out", stores / "whole")
            shutil.rmtree(tmp_path / "out")

    def test_an_episode_that_differs_is_named_with_both_stores(
        self, stores: Path, tmp_path: Path
    ) -> None:
        liar = make_store(tmp_path / "liar", blocks=[])
        rows = make_rows(CONFIG, 2, N, BAD)
        rows[1] = replace(rows[1], columns={**rows[1].columns, "object_mass": 3.0})  # type: ignore[type-var]
        ZarrWriter(liar).write_block(2, rows)
        with pytest.raises(StoreMismatchError, match=r"episode 9 of seed 0 is not the same in"):
            merge([stores / "even", liar], tmp_path / "out")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize("name", ["pybullet", "numpy", "grasp_factory"])
    def test_other_versions_of_a_generator_are_refused(
        self, stores: Path, tmp_path: Path, name: str
    ) -> None:
        other = with_fact("versions", **{name: "0.1"})
        old = make_store(tmp_path / "old", blocks=[1], **other)
        with pytest.raises(StoreMismatchError, match=rf"versions made \({name}: '0.1' against"):
            merge([stores / "even", old], tmp_path / "out")

    def test_another_platform_is_told(self, stores: Path, tmp_path: Path) -> None:
        far = make_store(tmp_path / "far", blocks=[1, 3], **with_fact("platform", cpu="Z80"))
        done = merge([stores / "even", far], tmp_path / "out")
        assert len(done.warnings) == 1
        assert "cpu: 'Z80' against" in done.warnings[0]
        assert_same_tree(tmp_path / "out", stores / "whole")

    @pytest.mark.soak
    def test_shards_that_were_made_apart_are_the_dataset(self, tmp_path: Path) -> None:
        settings = ("--n", 4, "--resolution", "32x24", "--set", "block_size=2", "--workers", 1)
        for out, more in (("a", ("--shard", "0/2")), ("b", ("--shard", "1/2")), ("want", ())):
            done = run("generate", *settings, *more, "--out", tmp_path / out)
            assert done.returncode == 0, done.stderr
        merge([tmp_path / "b", tmp_path / "a"], tmp_path / "out")
        assert_same_tree(tmp_path / "out", tmp_path / "want")

    @pytest.mark.soak
    def test_the_rest_can_be_made_later(self, tmp_path: Path) -> None:
        config = replace(SMALL, resolution=(32, 24), block_size=2)
        factory.generate(config, 6, tmp_path / "want", workers=1)
        for name, blocks in (("a", [0]), ("b", [2])):
            part_of(tmp_path / "want", tmp_path / name, blocks)
        done = merge([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
        assert done.missing == 2
        made = factory.generate(config, 6, tmp_path / "out", workers=1)
        assert made.made == 2
        assert_same_tree(tmp_path / "out", tmp_path / "want")


class TestSeveralSeeds:
    """Stores that become one whose rows have recipes of any seed."""

    def test_all_rows_are_there_seed_by_seed(self, stores: Path, tmp_path: Path) -> None:
        done = merge([stores / "other", stores / "even"], tmp_path / "out")
        rows = rows_of(tmp_path / "out")
        evens = [i for b in BLOCKS[::2] for i in range(b * SIZE, b * SIZE + SIZE)]
        assert [row[1:3] for row in rows] == [*((5, i) for i in range(6)), *((0, i) for i in evens)]
        assert set(rows) == present(stores / "other") | present(stores / "even")
        assert not done.can_grow
        assert done.missing == 0

    def test_every_episode_reads_as_it_was(self, stores: Path, mixed: Path) -> None:
        merged, other = Dataset(mixed), Dataset(stores / "other")
        for i in other.committed.tolist():
            assert merged.verify(8 + i)
            assert merged[8 + i].checksum() == other[i].checksum()
        assert merged.spec(8 + 5) == other.spec(5)  # quarantined
        with pytest.raises(StoreError, match="is quarantined: no luck with 5"):
            merged[8 + 5]

    def test_the_sources_are_named_by_seed(self, stores: Path, tmp_path: Path) -> None:
        old = make_store(
            tmp_path / "old", OTHER, blocks=[0], **with_fact("versions", pybullet="3.2.6")
        )
        done = merge([stores / "even", old, stores / "odd"], tmp_path / "out")
        attributes = Dataset(tmp_path / "out").attributes
        assert [(s["seed"], s["rows"]) for s in attributes["sources"]] == [(0, N), (5, 4)]
        assert [s["config_sha256"] for s in attributes["sources"]] == [
            CONFIG.sha256(),
            OTHER.sha256(),
        ]
        makers = [maker for s in attributes["sources"] for maker in s["made_with"]]
        assert [maker["versions"] for maker in makers] == [
            root_attributes(CONFIG, {})["versions"],
            with_fact("versions", pybullet="3.2.6")["versions"],
        ]
        assert attributes["seed"] == CONFIG.seed
        assert attributes["config_sha256"] == CONFIG.sha256()
        assert done.sources[1].made_with[0].versions["pybullet"] == "3.2.6"

    def test_platforms_of_one_seed_stand_side_by_side(self, stores: Path, tmp_path: Path) -> None:
        far = make_store(tmp_path / "far", blocks=[1], **with_fact("platform", cpu="Z80"))
        done = merge([stores / "even", far, stores / "other"], tmp_path / "out")
        here = root_attributes(CONFIG, {})["platform"]["cpu"]
        assert [m.platform["cpu"] for m in done.sources[0].made_with] == [here, "Z80"]
        again = merge([tmp_path / "out"], tmp_path / "again")
        assert again.sources == done.sources
        assert len(done.warnings) == 1

    @pytest.mark.soak
    def test_the_result_does_not_depend_on_the_grouping(self, stores: Path, tmp_path: Path) -> None:
        third = make_store(tmp_path / "third", replace(CONFIG, seed=9), blocks=[0, 1])
        a, b, c, d = stores / "even", stores / "other", stores / "odd", third
        merge([a, b, c, d], tmp_path / "at_once")
        merge([a, b], tmp_path / "ab")
        merge([c, d], tmp_path / "cd")
        merge([tmp_path / "ab", tmp_path / "cd"], tmp_path / "pairs")
        merge([tmp_path / "ab", c], tmp_path / "abc")
        merge([tmp_path / "abc", d], tmp_path / "one_by_one")
        assert_same_tree(tmp_path / "pairs", tmp_path / "at_once")
        assert_same_tree(tmp_path / "one_by_one", tmp_path / "at_once")

    def test_the_bytes_tell_nothing_of_where_and_when(
        self, stores: Path, mixed: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "secret_place").mkdir()
        for name, source in (("even", "even"), ("renamed", "other")):
            shutil.copytree(stores / source, tmp_path / "secret_place" / name)
        inputs = [tmp_path / "secret_place" / name for name in ("even", "renamed")]
        merge(inputs, tmp_path / "secret_place" / "out")
        assert_same_tree(tmp_path / "secret_place" / "out", mixed)
        everything = b"".join(tree(mixed).values())
        assert b"secret_place" not in everything

    @settings(max_examples=scaled(2, 8))
    @given(
        parts=st.lists(
            st.tuples(st.sampled_from([0, 5]), st.sets(st.integers(0, 2))), min_size=2, max_size=4
        )
    )
    def test_any_spread_gives_the_union(
        self, stores: Path, tmp_path_factory: pytest.TempPathFactory, parts: list[Any]
    ) -> None:
        folder = tmp_path_factory.mktemp("parts")
        paths = [
            part_of(stores / ("other" if seed else "whole"), folder / str(k), blocks)
            for k, (seed, blocks) in enumerate(parts)
        ]
        want = set().union(*(present(path) for path in paths))
        if not want and len({seed for seed, _ in parts}) > 1:
            with pytest.raises(UsageError, match="there is nothing to merge"):
                merge(paths, folder / "out")
            return
        merge(paths, folder / "out")
        rows = [row for row in rows_of(folder / "out") if row[0]]
        assert set(rows) == want
        assert len(rows) == len(want)

    def test_each_row_is_counted_once_it_is_there(self, stores: Path, tmp_path: Path) -> None:
        calls: list[int | str] = []
        merge(
            [stores / "even", stores / "other"],
            tmp_path / "out",
            on_start=calls.append,
            on_row=lambda: calls.append("row"),
        )
        assert calls == [14, *["row"] * 14]

    def test_generate_does_not_grow_it(self, mixed: Path) -> None:
        with pytest.raises(StoreMismatchError, match="was put together from other stores"):
            prepare_store(mixed, CONFIG, JOINTS, 40, {})

    def test_info_shows_where_its_rows_are_from(self, mixed: Path) -> None:
        done = run("info", mixed, "--full")
        assert done.returncode == 0, done.stderr
        assert "merged from\nseed  rows  made with\n   0     8  grasp_factory" in done.stdout


class TestLabels:
    """Labels that were added with ``relabel``."""

    def test_a_label_of_all_parts_is_that_of_the_whole(
        self, labelled: Path, tmp_path: Path
    ) -> None:
        done = merge([labelled / "a", labelled / "b"], tmp_path / "out")
        assert done.labels == ("firm",)
        assert_same_tree(tmp_path / "out", labelled / "whole")
        labels = Dataset(tmp_path / "out").label("firm")
        assert len(set(labels.tolist()) - {int(Outcome.SUCCESS)}) > 1

    def test_a_label_goes_with_the_rows_that_are_split_off(
        self, labelled: Path, tmp_path: Path
    ) -> None:
        split(labelled / "whole", tmp_path / "out", [12, 1, 6])
        got = Dataset(tmp_path / "out").label("firm")
        assert got.tolist() == Dataset(labelled / "whole").label("firm")[[1, 6, 12]].tolist()

    def test_rows_of_any_seed_replay_to_the_same_bytes(
        self, labelled: Path, tmp_path: Path
    ) -> None:
        config = Dataset(labelled / "a").config
        factory.generate(replace(config, seed=5), 2, tmp_path / "other", workers=1)
        merge([tmp_path / "other", labelled / "a"], tmp_path / "out")
        for row, seed in ((1, 5), (3, 0)):
            assert Dataset(tmp_path / "out").spec(row).seed == seed
            assert replay(tmp_path / "out", row).same

    def test_what_only_some_have_or_have_otherwise_is_left_out(
        self, stores: Path, tmp_path: Path
    ) -> None:
        for name in ("even", "other"):
            shutil.copytree(stores / name, tmp_path / name)
            rows = len(Dataset(tmp_path / name))
            outcome = np.zeros(rows, np.uint8)
            write_label(tmp_path / name, "same", outcome, {"min_lift": 0.1})
            write_label(tmp_path / name, "differs", outcome, {"min_lift": rows / 100})
        write_label(tmp_path / "even", "alone", np.zeros(N, np.uint8), {"min_lift": 0.1})
        labels = tmp_path / "even" / "labels"
        shutil.copytree(labels / "alone", labels / "by hand")
        done = merge([tmp_path / "even", tmp_path / "other"], tmp_path / "out")
        assert done.labels == ("same",)
        assert set(done.labels_left_out) == {"differs", "alone", "by hand"}
        assert done.labels_left_out["alone"] == f"{tmp_path / 'other'} has none of that name"
        assert Dataset(tmp_path / "out").labels == ["same"]

    def test_rows_that_came_after_the_label_stay_without_it(
        self, stores: Path, tmp_path: Path
    ) -> None:
        shutil.copytree(stores / "whole", tmp_path / "grown")
        write_label(tmp_path / "grown", "early", np.full(6, 3, np.uint8), {})
        merge([tmp_path / "grown"], tmp_path / "out")
        label = Dataset(tmp_path / "out").label("early")
        assert label.tolist() == [3] * 6 + [NOT_LABELLED] * (N - 6)

    def test_a_damaged_label_is_refused(self, stores: Path, tmp_path: Path) -> None:
        shutil.copytree(stores / "whole", tmp_path / "bad")
        write_label(tmp_path / "bad", "mine", np.full(N, 3, np.uint8), {})
        write_label(tmp_path / "bad", "yours", np.full(N, 4, np.uint8), {})
        labels = tmp_path / "bad" / "labels"
        shutil.copy(labels / "yours/outcome/c/0", labels / "mine/outcome/c/0")
        with pytest.raises(StoreError, match=r"labels/mine is damaged: remove that directory"):
            merge([tmp_path / "bad"], tmp_path / "out")
        shutil.rmtree(labels / "mine")
        document = labels / "yours" / "outcome" / "zarr.json"
        document.write_text(document.read_text().replace('"thresholds": {}', '"thresholds": 7'))
        with pytest.raises(StoreError, match=r"labels/yours is damaged: remove that directory"):
            merge([tmp_path / "bad"], tmp_path / "out")
        assert not (tmp_path / "out").exists()


class TestRefusals:
    """What cannot be merged is said in a line, and nothing is written."""

    @pytest.fixture(autouse=True)
    def nothing_is_left(self, tmp_path: Path, stores: Path) -> Any:
        yield
        assert not list(tmp_path.rglob(".*merging*"))
        assert not list(stores.rglob(".*"))

    def test_another_config(self, stores: Path, tmp_path: Path) -> None:
        other = small_config(resolution=[16, 20])
        path = make_store(tmp_path / "tall", other, blocks=[0])
        with pytest.raises(StoreMismatchError, match=r"another config .*\(resolution: \[16, 20\]"):
            merge([stores / "even", path], tmp_path / "out")

    def test_other_facts(self, stores: Path, tmp_path: Path) -> None:
        path = make_store(tmp_path / "odd", blocks=[1], robot={"tool_mass": 2.0})
        with pytest.raises(StoreMismatchError, match=r"has other attributes than .*\(robot: "):
            merge([stores / "even", path], tmp_path / "out")

    def test_a_config_that_this_version_reads_otherwise(self, stores: Path, tmp_path: Path) -> None:
        shutil.copytree(stores / "even", tmp_path / "old")
        config = CONFIG.to_plain()
        del config["imu_hz"]
        edit_attributes(tmp_path / "old", config=config, config_sha256="0" * 64)
        with pytest.raises(StoreMismatchError, match=r"another version .*\(imu_hz: 'absent"):
            merge([tmp_path / "old"], tmp_path / "out")

    def test_no_stores(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="no stores: name one or more"):
            merge([], tmp_path / "out")

    def test_no_episodes(self, tmp_path: Path) -> None:
        make_store(tmp_path / "a", blocks=[])
        make_store(tmp_path / "b", OTHER, blocks=[])
        with pytest.raises(UsageError, match="there is nothing to merge"):
            merge([tmp_path / "a", tmp_path / "b"], tmp_path / "out")

    def test_what_is_no_store(self, stores: Path, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("x")
        for path in (tmp_path / "nothing", tmp_path / "file", tmp_path):
            with pytest.raises(StoreMismatchError, match=r"no store at|not a grasp-factory store"):
                merge([stores / "even", path], tmp_path / "out")

    def test_the_same_store_twice(self, stores: Path, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to(stores / "even")
        for twin in (stores / "even", stores / "odd" / ".." / "even", tmp_path / "link"):
            with pytest.raises(UsageError, match=r"is the same store as .*: name it once"):
                merge([stores / "even", stores / "odd", twin], tmp_path / "out")

    def test_a_place_that_is_taken(self, stores: Path, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("mine")
        (tmp_path / "full").mkdir()
        (tmp_path / "full" / "notes.txt").write_text("mine")
        make_store(tmp_path / "store", blocks=[0])
        before = tree(tmp_path)
        for name in ("file", "full", "store"):
            with pytest.raises(StoreMismatchError, match="exists, only new stores are made"):
                merge([stores / "even"], tmp_path / name)
        assert tree(tmp_path) == before

    def test_a_place_in_a_store(self, stores: Path) -> None:
        for place in (stores / "even" / "out", stores / "even" / "episodes" / "out"):
            with pytest.raises(StoreMismatchError, match="lies in the store"):
                merge([stores / "odd", stores / "even"], place)

    def test_a_place_in_no_directory(self, stores: Path, tmp_path: Path) -> None:
        with pytest.raises(StoreMismatchError, match="cannot be written"):
            merge([stores / "even"], tmp_path / "no" / "where")

    def test_a_place_where_another_process_writes(self, stores: Path, tmp_path: Path) -> None:
        with StoreLock(tmp_path / "out"), pytest.raises(StoreBusyError):
            merge([stores / "even"], tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_a_damaged_episode(self, stores: Path, tmp_path: Path) -> None:
        bad = Path(shutil.copytree(stores / "odd", tmp_path / "bad"))
        block = bad / "episodes" / "object_mass" / "1"
        shutil.copy(stores / "even" / "episodes" / "object_mass" / "0", block)
        with pytest.raises(StoreError, match=r"episode 4 does not match its checksum; run `gr"):
            merge([stores / "even", bad], tmp_path / "out")
        assert [p.name for p in tmp_path.iterdir()] == ["bad"]

    def test_metadata_that_is_not_as_it_was_sealed(self, stores: Path, tmp_path: Path) -> None:
        bad = Path(shutil.copytree(stores / "odd", tmp_path / "bad"))
        document = bad / "zarr.json"
        document.write_text(document.read_text().replace('"license": "MIT"', '"license": "MIX"'))
        with pytest.raises(
            StoreError, match=r"bad is damaged: zarr.json is not as it was written; run"
        ):
            merge([stores / "even", bad], tmp_path / "out")

    def test_a_file_that_cannot_be_read(self, stores: Path, tmp_path: Path) -> None:
        bad = Path(shutil.copytree(stores / "odd", tmp_path / "bad"))
        (bad / "streams" / "phase" / "1.0").write_bytes(b"nonsense")
        with pytest.raises(StoreError, match=r"streams/phase .* cannot be read: .*; run `grasp-fa"):
            merge([stores / "even", bad], tmp_path / "out")

    def test_blocks_that_changed_places(self, stores: Path, tmp_path: Path) -> None:
        bad = Path(shutil.copytree(stores / "whole", tmp_path / "bad"))
        for file in tree(bad):
            number, _, rest = Path(file).name.partition(".")
            if number == "0" and rest != "npz":
                a = bad / file
                b = a.with_name(".".join(filter(None, ("2", rest))))
                a.rename(bad / "aside")
                b.rename(a)
                (bad / "aside").rename(b)
        with pytest.raises(StoreError, match=r"row 0 holds episode 8 of seed 0, not 0 of 0; run"):
            merge([bad], tmp_path / "out")

    def test_a_store_that_does_not_say_where_its_rows_are_from(
        self, stores: Path, tmp_path: Path
    ) -> None:
        merge([stores / "even", stores / "other"], tmp_path / "bad")
        sources = Dataset(tmp_path / "bad").attributes["sources"]
        for wrong in (7, "x", [1], [{"seed": "x"}], [{**sources[0], "made_with": [{}]}]):
            edit_attributes(tmp_path / "bad", sources=wrong)
            with pytest.raises(StoreError, match=r"attribute sources is damaged"):
                merge([tmp_path / "bad"], tmp_path / "out")
        edit_attributes(tmp_path / "bad", sources=sources[:1])
        with pytest.raises(StoreError, match="sources does not name seed 5"):
            merge([tmp_path / "bad"], tmp_path / "out")

    def test_a_disk_that_fails_to_keep_what_was_written(
        self, stores: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        write = ZarrWriter.write_block

        def forgetful(self: ZarrWriter, block: int, rows: Any, texts: Any) -> None:
            write(self, block, [*rows[:-1], rows[0]] if self._is_collected else rows, texts)

        monkeypatch.setattr(building.ZarrWriter, "write_block", forgetful)
        with pytest.raises(StoreError, match="after writing, rows 0 to 3 are others; disk or"):
            merge([stores / "even", stores / "other"], tmp_path / "out")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize("into_a_directory", [False, True])
    def test_a_full_disk(
        self, stores: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, into_a_directory: bool
    ) -> None:
        def full(*_: Any) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        out = tmp_path / "out"
        if into_a_directory:
            out.mkdir()
        monkeypatch.setattr("grasp_factory.writers.zarr.block_attempt.fsync_places", full)
        with pytest.raises(StoreError, match="out cannot be written: No space left on device"):
            merge([stores / "even"], out)
        assert list(tmp_path.rglob("*")) == [out] * into_a_directory


@pytest.mark.parametrize("seed", range(scaled(2, 12)))
def test_a_byte_that_changed_is_refused_or_has_no_part_in_the_result(
    stores: Path, tmp_path: Path, seed: int
) -> None:
    rng = random.Random(seed)
    merge([stores / "even", stores / "other"], tmp_path / "sound")
    shutil.copytree(tmp_path / "sound", tmp_path / "bad")
    files = sorted(tree(tmp_path / "bad"))
    metadata = [file for file in files if file.endswith("zarr.json")]
    file = tmp_path / "bad" / rng.choice(rng.choice([files, metadata, ["zarr.json"]]))
    data = bytearray(file.read_bytes())
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    file.write_bytes(data)
    try:
        merge([tmp_path / "bad"], tmp_path / "out")
    except GraspFactoryError as error:
        assert len(str(error).splitlines()) == 1
        assert not (tmp_path / "out").exists()
    else:
        assert_same_tree(tmp_path / "out", tmp_path / "sound")


class TestKilled:
    """A merge that was killed leaves no result, and the next one goes through."""

    @staticmethod
    def kill_a_merge(inputs: Sequence[Path], out: Path, until: Callable[[], bool]) -> None:
        """Start a merge, and kill it outright once something is so."""
        process = subprocess.Popen([*COMMAND, "merge", str(out), *map(str, inputs)])
        deadline = time.monotonic() + 60
        while not until():
            assert process.poll() is None, "it ended too early"
            assert time.monotonic() < deadline
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL

    @pytest.mark.parametrize("into_a_directory", [True, *soak_only(False)])
    def test_nothing_is_there_and_it_can_be_run_again(
        self, many: Path, tmp_path: Path, into_a_directory: bool
    ) -> None:
        out = tmp_path / "out"
        aside = out / ".merging" if into_a_directory else tmp_path / ".out.merging"
        if into_a_directory:
            out.mkdir(mode=0o750)
        markers = aside / "episodes" / "status"
        self.kill_a_merge([many], out, (markers / "1").exists)
        assert (markers / "0").exists()
        assert not (out / "zarr.json").exists()
        assert out.exists() == into_a_directory
        done = run("merge", out, many)
        assert done.returncode == 0, done.stderr
        assert_same_tree(out, many)
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["out", "out.origin.json"]
        assert out.stat().st_mode & 0o777 == 0o750 or not into_a_directory

    def test_one_killed_while_it_moves_into_a_directory_goes_through_too(
        self, stores: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        out = tmp_path / "out"
        out.mkdir()

        class Killed(BaseException):
            pass

        replaced = os.replace

        def move(source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
            if target == "streams" and os.readlink(f"/proc/self/fd/{dst_dir_fd}") == str(out):
                raise Killed
            replaced(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)

        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", move)
            patch.setattr(shutil, "rmtree", lambda path, dir_fd: None)
            with pytest.raises(Killed):
                merge([stores / "whole"], out)
        assert not (out / "streams").exists()
        assert (out / "imu").exists() or (out / "episodes").exists()
        assert (out / ".merging" / "zarr.json").exists()
        merge([stores / "whole"], out)
        assert_same_tree(out, stores / "whole")

    def test_a_file_of_somebody_else_in_its_leftovers_is_kept(
        self, stores: Path, tmp_path: Path
    ) -> None:
        aside = tmp_path / ".out.merging"
        aside.mkdir()
        (aside / "thesis.txt").write_text("mine")
        with pytest.raises(StoreMismatchError, match=r"in the way: it holds thesis.txt"):
            merge([stores / "even"], tmp_path / "out")
        (aside / "thesis.txt").rename(tmp_path / "thesis.txt")
        (aside / "3.0").symlink_to(tmp_path / "thesis.txt")
        with pytest.raises(IrregularFileError, match=r"3.0 is a link"):
            merge([stores / "even"], tmp_path / "out")
        aside.rename(tmp_path / "elsewhere")
        aside.symlink_to(tmp_path / "elsewhere")
        with pytest.raises(IrregularFileError, match=r"out.merging is a link"):
            merge([stores / "even"], tmp_path / "out")
        assert (tmp_path / "thesis.txt").read_text() == "mine"

    def test_what_a_killed_one_left_is_no_input(self, stores: Path, tmp_path: Path) -> None:
        shutil.copytree(stores / "even", tmp_path / ".out.merging")
        with pytest.raises(StoreMismatchError, match="is what a killed run left"):
            merge([tmp_path / ".out.merging"], tmp_path / "out")
        assert_same_tree(tmp_path / ".out.merging", stores / "even")

    def test_ctrl_c_leaves_nothing(self, many: Path, tmp_path: Path) -> None:
        process = subprocess.Popen(
            [*COMMAND, "merge", str(tmp_path / "out"), str(many)], stderr=subprocess.PIPE, text=True
        )
        marker = tmp_path / ".out.merging" / "episodes" / "status" / "1"
        while not marker.exists():
            assert process.poll() is None, "it ended too early"
            time.sleep(0.001)
        process.send_signal(signal.SIGINT)
        assert process.communicate()[1].endswith("Error: stopped\n")
        assert process.returncode == 130
        assert list(tmp_path.iterdir()) == []


class TestCommand:
    """``grasp-factory merge``."""

    def test_it_says_what_it_did(self, stores: Path, tmp_path: Path) -> None:
        done = run("merge", "out", stores / "even", stores / "other", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        lines = done.stdout.splitlines()
        assert lines[0] == "out: 13 episodes, all read back and compared"
        assert [line.split()[:2] for line in lines[1:4]] == [
            ["seed", "rows"],
            ["0", "8"],
            ["5", "6"],
        ]
        assert lines[4:] == ["1 of 14 episodes are quarantined"]
        assert done.stderr == ""

    def test_json_has_all_of_it(self, stores: Path, tmp_path: Path) -> None:
        done = run("merge", "out", stores / "even", stores / "whole", "--json", cwd=tmp_path)
        facts = json.loads(done.stdout)
        assert set(facts) == set(Collected.__slots__)
        assert (facts["rows"], facts["committed"], facts["repeated"]) == (N, N - 2, 8)
        assert facts["can_grow"] is True

    def test_missing_rows_are_said(self, stores: Path, tmp_path: Path) -> None:
        done = run("merge", tmp_path / "out", stores / "even")
        assert done.stdout.splitlines()[-1] == (
            f"6 of {N} episodes are missing: run `grasp-factory generate` on this store"
        )

    @pytest.mark.parametrize(
        ("args", "message"),
        [
            (("out",), "no stores: name one or more to merge"),
            (("out", "nothing"), "there is no store at nothing"),
            (("stores", "stores/even"), "stores exists, only new stores are made"),
            (("out", "stores/even", "stores/even"), "stores/even is the same store as"),
            (("stores/even/out", "stores/even"), "stores/even/out lies in the store"),
        ],
    )
    def test_a_mistake_is_one_line(
        self,
        stores: Path,
        tmp_path: Path,
        complaint: Callable[..., tuple[int, str]],
        args: Any,
        message: str,
    ) -> None:
        (tmp_path / "stores").symlink_to(stores)
        code, error = complaint("merge", *args)
        assert code == 2
        assert error.startswith(f"Error: {message}")
        assert error.count("\n") == 1


class TestOwnObjects:
    """Stores that carry a user's own objects."""

    @pytest.fixture
    def parts(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> tuple[FactoryConfig, list[Path]]:
        """Return config and paths of two stores with an archive; its bytes are opaque here."""
        config = replace(CONFIG, object_sets={"mine": 1.0}, object_folders={"mine": "0" * 64})
        paths = []
        for seed in (0, 5):
            path, own = tmp_path / f"seed{seed}", replace(config, seed=seed)
            facts = root_attributes(own, {})
            archive = {"objects/mine": b"an archive of meshes"}
            create_store(path, own, facts, joints=JOINTS, n=4, carried=archive)
            ZarrWriter(path).write_block(0, make_rows(own, 0, 4))
            paths.append(path)
        return config, paths

    def test_they_travel_along(self, parts: Any, tmp_path: Path) -> None:
        merge(parts[1], tmp_path / "out")
        split(tmp_path / "out", tmp_path / "half", [0, 5])
        for name in ("out", "half"):
            assert_same_tree(tmp_path / name / "objects", parts[1][0] / "objects")

    def test_a_damaged_archive_is_replaced_by_another_stores(
        self, parts: Any, tmp_path: Path
    ) -> None:
        want = tree(parts[1][1] / "objects")
        (parts[1][0] / "objects" / "mine" / "0").write_bytes(b"nonsense")
        merge(parts[1], tmp_path / "out")
        assert tree(tmp_path / "out" / "objects") == want
        with pytest.raises(StoreError, match=r"objects/mine is damaged; run `grasp-factory ver"):
            merge(parts[1][:1], tmp_path / "again")


class TestPlatforms:
    """Rows keep the fingerprint of where they were made, and within a seed there is one."""

    @pytest.fixture
    def here(self, tmp_path: Path) -> Path:
        return told(make_store(tmp_path / "here", blocks=[0, 2]), HERE)

    @pytest.fixture
    def there(self, tmp_path: Path) -> Path:
        return told(make_store(tmp_path / "there", blocks=[1, 3]), THERE)

    def test_parts_of_one_platform_are_that_dataset_whatever_the_machine(
        self, here: Path, tmp_path: Path
    ) -> None:
        far = make_store(tmp_path / "far", blocks=[1, 3], **with_fact("platform", cpu="Z80"))
        done = merge([here, told(far, HERE)], tmp_path / "out")
        assert done.warnings == ()
        whole = told(make_store(tmp_path / "whole"), HERE)
        assert Dataset(tmp_path / "out").column("fingerprint").tolist() == [HERE.text] * N
        assert rows_of(tmp_path / "out") == rows_of(whole)

    def test_rows_of_one_seed_from_two_platforms_are_refused(
        self, here: Path, there: Path, tmp_path: Path
    ) -> None:
        what = (
            r"hold episodes of seed 0 from different platforms: the fingerprint differs in engine"
            r" \(simulation steps\); keep them apart, or add --accept-other-platform"
        )
        with pytest.raises(StoreMismatchError, match=what):
            merge([here, there], tmp_path / "out")
        done = run("merge", tmp_path / "out", here, there)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert not (tmp_path / "out").exists()

    def test_accepted_it_is_warned_of_and_each_row_keeps_its_own(
        self, here: Path, there: Path, tmp_path: Path
    ) -> None:
        done = merge([here, there], tmp_path / "out", accept_other_platform=True)
        (warning,) = done.warnings
        assert "seed 0 from different platforms" in warning
        texts = Dataset(tmp_path / "out").column("fingerprint").tolist()
        want = [THERE.text if row // SIZE in (1, 3) else HERE.text for row in range(N)]
        assert texts == want
        assert [maker.fingerprint for maker in done.sources[0].made_with] == [
            HERE.parts(),
            THERE.parts(),
        ]
        again = merge([tmp_path / "out"], tmp_path / "again")
        assert again.warnings == ()
        split(tmp_path / "out", tmp_path / "few", [1, SIZE + 2])
        few = Dataset(tmp_path / "few").column("fingerprint").tolist()
        assert few == [want[1], want[SIZE + 2]]

    def test_seeds_of_two_platforms_are_warned_of(self, here: Path, tmp_path: Path) -> None:
        other = told(make_store(tmp_path / "other", OTHER, blocks=[0]), THERE)
        done = merge([here, other], tmp_path / "out")
        (warning,) = done.warnings
        assert "were made on different platforms: the fingerprint differs in engine" in warning
        sources = Dataset(tmp_path / "out").attributes["sources"]
        assert [s["made_with"][0]["fingerprint"] for s in sources] == [HERE.parts(), THERE.parts()]

    def test_a_part_that_holds_rows_of_both_differs_from_one_that_does_not(
        self, here: Path, tmp_path: Path
    ) -> None:
        mixed = told(make_store(tmp_path / "mixed", blocks=[1, 3]), HERE)
        set_texts(mixed, {SIZE: THERE.text})
        with pytest.raises(StoreMismatchError, match="from different platforms"):
            merge([here, mixed], tmp_path / "out")

    def test_stores_of_a_version_without_fingerprints_are_merged_as_before(
        self, tmp_path: Path
    ) -> None:
        old = old_store(tmp_path)
        done = merge([old], tmp_path / "out")
        assert done.warnings == ()
        split(tmp_path / "out", tmp_path / "few", [0, 2])
        for store in (tmp_path / "out", tmp_path / "few"):
            assert set(Dataset(store).column("fingerprint").tolist()) == {""}
            assert verify(store).is_whole

    def test_a_store_put_together_by_a_version_without_fingerprints_is_read(
        self, stores: Path, tmp_path: Path
    ) -> None:
        merge([stores / "even", stores / "other"], tmp_path / "out")
        sources = Dataset(tmp_path / "out").attributes["sources"]
        for source in sources:
            for maker in source["made_with"]:
                del maker["fingerprint"]
        edit_attributes(tmp_path / "out", sources=sources)
        done = merge([tmp_path / "out"], tmp_path / "again")
        assert [maker.fingerprint for maker in done.sources[0].made_with] == [{}]


def told(store: Path, fingerprint: Fingerprint) -> Path:
    """Let a store and its rows tell a platform; return it."""
    edit_attributes(store, **{FINGERPRINT: fingerprint.parts()})
    rows = np.flatnonzero(Dataset(store).status)
    set_texts(store, dict.fromkeys(rows.tolist(), fingerprint.text))
    return store
