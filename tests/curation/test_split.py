"""Splitting: some episodes of a store into a new one."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree, tree
from support.scale import scaled

from grasp_factory.curation.merge import merge, split
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreBusyError, StoreError, StoreMismatchError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.header import root_attributes
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.store import create_store

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "grasp_factory"]
CONFIG = small_config(resolution=[16, 16])
N = 16
MISSING = (8, 9, 10, 11)
QUARANTINED = (5, 13)
THERE = sorted(set(range(N)) - set(MISSING) - set(QUARANTINED))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of fake episodes, of which some are missing or quarantined."""
    path = tmp_path_factory.mktemp("split") / "store"
    create_store(path, CONFIG, root_attributes(CONFIG, {}), joints=JOINTS, n=N, carried={})
    for block in (0, 1, 3):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, N, QUARANTINED))
    return path


@pytest.fixture(scope="module")
def collected(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of two seeds: rows 0 to 11 as in ``store``, 12 to 17 of seed 5."""
    folder = tmp_path_factory.mktemp("collected")
    config = replace(CONFIG, seed=5)
    facts = root_attributes(config, {})
    create_store(folder / "other", config, facts, joints=JOINTS, n=6, carried={})
    for block in (0, 1):
        ZarrWriter(folder / "other").write_block(block, make_rows(config, block, 6))
    merge([store, folder / "other"], folder / "out")
    return folder / "out"


def rows_of(path: Path) -> list[tuple[int, int, str]]:
    """Return seed, index and checksum of each row."""
    dataset = Dataset(path)
    columns = (dataset.column(c).tolist() for c in ("seed", "index", "checksum"))
    return list(zip(*columns, strict=True))


def chosen(path: Path, indices: Any) -> list[tuple[int, int, str]]:
    rows = rows_of(path)
    return [rows[i] for i in indices]


def run(*args: object, **more: Any) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **more)


class TestSplit:
    """The library's function."""

    def test_the_rows_come_in_ascending_order(self, store: Path, tmp_path: Path) -> None:
        done = split(store, tmp_path / "out", [14, 0, 7, 6, 3])
        assert rows_of(tmp_path / "out") == chosen(store, [0, 3, 6, 7, 14])
        assert (done.rows, done.committed, done.can_grow) == (5, 5, False)

    def test_every_episode_reads_as_it_was(self, store: Path, tmp_path: Path) -> None:
        split(store, tmp_path / "out", THERE)
        new, old = Dataset(tmp_path / "out"), Dataset(store)
        assert new.committed.tolist() == list(range(len(THERE)))
        for row, i in enumerate(THERE):
            assert new.verify(row)
            assert new[row].checksum() == old[i].checksum()

    @settings(max_examples=scaled(2, 6))
    @given(data=st.data())
    def test_the_parts_give_all_rows_back(
        self, store: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        folder = tmp_path_factory.mktemp("parts")
        part_of = data.draw(st.lists(st.integers(0, 2), min_size=10, max_size=10))
        parts = []
        for k in sorted(set(part_of)):
            mine = [i for i, part in zip(THERE, part_of, strict=True) if part == k]
            split(store, folder / str(k), data.draw(st.permutations(mine)))
            parts.append(folder / str(k))
        merge(data.draw(st.permutations(parts)), folder / "all")
        split(store, folder / "want", THERE)
        assert_same_tree(folder / "all", folder / "want")

    def test_provenance_stays_with_the_rows(self, collected: Path, tmp_path: Path) -> None:
        split(collected, tmp_path / "both", [1, 12, 13])
        split(collected, tmp_path / "one", [14])
        before = Dataset(collected).attributes["sources"]
        both = Dataset(tmp_path / "both").attributes["sources"]
        assert both == [{**before[0], "rows": 1}, {**before[1], "rows": 2}]
        assert Dataset(tmp_path / "one").attributes["sources"] == [{**before[1], "rows": 1}]

    def test_the_same_choice_gives_the_same_bytes(self, store: Path, tmp_path: Path) -> None:
        shutil.copytree(store, tmp_path / "renamed")
        split(store, tmp_path / "a", [1, 2, 3, 4])
        split(tmp_path / "renamed", tmp_path / "b", (i for i in np.array([4, 3, 2, 1])))
        assert_same_tree(tmp_path / "a", tmp_path / "b")

    def test_a_split_of_a_split_is_a_split(self, store: Path, tmp_path: Path) -> None:
        split(store, tmp_path / "a", [1, 3, 7, 15])
        split(tmp_path / "a", tmp_path / "ab", [1, 3])
        split(store, tmp_path / "direct", [3, 15])
        assert_same_tree(tmp_path / "ab", tmp_path / "direct")

    def test_the_source_stays_as_it_is(self, store: Path, tmp_path: Path) -> None:
        before = tree(store)
        split(store, tmp_path / "out", [0, 14])
        assert tree(store) == before
        assert [path.name for path in store.parent.iterdir()] == ["store"]

    def test_it_goes_into_an_empty_directory(self, store: Path, tmp_path: Path) -> None:
        (tmp_path / "out").mkdir()
        split(store, tmp_path / "out", [0, 14])
        split(store, tmp_path / "want", [0, 14])
        assert_same_tree(tmp_path / "out", tmp_path / "want")


class TestRefusals:
    """What cannot be split off is said, and nothing is written."""

    @pytest.mark.parametrize(
        ("indices", "message"),
        [
            ([0, 16], r"episode 16 of \S+ valid: 0 to 15"),
            ([-1], r"episode -1 of \S+ valid: 0 to 15"),
            ([True], r"episode True of \S+ valid"),
            ([1.0], r"episode 1.0 of \S+ valid"),
            (["1"], r"episode '1' of \S+ valid"),
            ([10**30], r"episode 10+ of \S+ valid"),
            ([3, 1, 3], "episode 3 of .* is chosen twice"),
            ([0, 9], "episode 9 of .* is missing: only episodes that are there"),
            ([0, 13], "episode 13 of .* is quarantined: only episodes that are there"),
            ([], "no episodes of .* are chosen"),
        ],
    )
    def test_rows_that_are_none(
        self, store: Path, tmp_path: Path, indices: Any, message: str
    ) -> None:
        with pytest.raises(UsageError, match=message):
            split(store, tmp_path / "out", indices)
        assert list(tmp_path.iterdir()) == []

    def test_places_that_are_taken(self, store: Path, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("mine")
        before = tree(store)
        for out in (tmp_path / "file", store):
            with pytest.raises(StoreMismatchError, match="exists, only new stores are made"):
                split(store, out, [0])
        with pytest.raises(StoreMismatchError, match="lies in the store"):
            split(store, store / "out", [0])
        with StoreLock(tmp_path / "out"), pytest.raises(StoreBusyError):
            split(store, tmp_path / "out", [0])
        assert tree(store) == before

    def test_what_is_no_store(self, tmp_path: Path) -> None:
        with pytest.raises(StoreMismatchError, match="there is no store at"):
            split(tmp_path / "nothing", tmp_path / "out", [0])

    def test_a_damaged_episode_alone_is_refused(self, store: Path, tmp_path: Path) -> None:
        shutil.copytree(store, tmp_path / "bad")
        mass = tmp_path / "bad" / "episodes" / "object_mass"
        shutil.copy(mass / "0", mass / "3")
        split(tmp_path / "bad", tmp_path / "sound", [0, 4])
        with pytest.raises(StoreError, match=r"episode 14 does not match its checksum; run `gras"):
            split(tmp_path / "bad", tmp_path / "out", [0, 14])
        assert not (tmp_path / "out").exists()


class TestCommand:
    """``grasp-factory split``."""

    def test_rows_by_number(self, store: Path, tmp_path: Path) -> None:
        done = run("split", store, "out", "--episodes", "7,0,3", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("out: 3 episodes, all read back and compared\n")
        assert rows_of(tmp_path / "out") == chosen(store, [0, 3, 7])

    def test_rows_of_a_file_and_of_stdin(self, store: Path, tmp_path: Path) -> None:
        (tmp_path / "ids.txt").write_text("7\n\n 0 \n3\n")
        assert run("split", store, "a", "--ids", "ids.txt", cwd=tmp_path).returncode == 0
        done = run("split", store, "b", "--ids", "-", cwd=tmp_path, input="3\n7\n0")
        assert done.returncode == 0, done.stderr
        assert rows_of(tmp_path / "a") == chosen(store, [0, 3, 7])
        assert_same_tree(tmp_path / "a", tmp_path / "b")

    def test_rows_by_value(self, store: Path, tmp_path: Path) -> None:
        dataset = Dataset(store)
        done = run("split", store, "out", "--where", "split=train", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert rows_of(tmp_path / "out") == chosen(store, dataset.where(split="train").indices)
        assert set(Dataset(tmp_path / "out").column("split")) == {"train"}

    def test_several_choices_mean_what_is_in_all_of_them(self, store: Path, tmp_path: Path) -> None:
        dataset = Dataset(store)
        some = dataset.where(split=["train", "val"], success=False)
        want = set(some.indices.tolist()) - {THERE[0]}
        (tmp_path / "ids.txt").write_text("\n".join(map(str, THERE[1:])))
        done = run(
            *("split", store, "out", "--ids", "ids.txt", "--where", "split=[train, val]"),
            *("--where", "success=false", "--where", "split=[val, train, test]", "--json"),
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["committed"] == len(want) > 0
        assert rows_of(tmp_path / "out") == chosen(store, sorted(want))

    @pytest.mark.parametrize(
        ("args", "message"),
        [
            ((), "no episodes are chosen: name them with --episodes, --ids or --where"),
            (("--episodes", "1;2"), "--episodes: got '1;2', valid: indices such as 0,3,7"),
            (("--episodes", "99"), "episode 99 of store: valid: 0 to 15"),
            (("--episodes", "1,1"), "episode 1 of store is chosen twice"),
            (("--ids", "words"), "--ids words: line 2: got 'x y', valid: one episode index a line"),
            (("--ids", "binary"), "--ids binary: it is no text"),
            (("--ids", "nothing"), "Invalid value for '--ids': 'nothing': No such file"),
            (("--where", "split"), "--where: got 'split', valid: COLUMN=VALUE"),
            (("--where", "spilt=train"), "unknown column 'spilt'; did you mean 'split'?"),
            (("--where", "self=1"), "unknown column 'self'"),
            (("--where", "split=3"), "where: split: got 3, valid: string"),
            (("--where", "outcome=nope"), "unknown outcome 'nope'"),
            (("--where", "split={a: 1}"), "--where split: got {'a': 1}, valid: a value, or"),
            (("--where", "split="), "--where split: got None, valid: a value, or"),
            (("--where", "split=[a"), "--where split is not valid YAML"),
            (("--where", "split=nope"), "no row has split 'nope' (valid: test, train, val)"),
            (
                ("--where", "policy=topdown"),
                "no row has policy 'topdown'; did you mean 'top_down'?",
            ),
            (
                ("--where", "split=val,test"),
                "no row has split 'val,test'; for any of several: [val,",
            ),
            (
                ("--where", "split=val", "--where", "split=train"),
                "--where 'split=val' and 'split=train': no episode has both, valid: "
                "split=[val,train] for any of them",
            ),
            (("--where", "object_com=1"), "where: object_com has (1, 3) values a row, valid: one"),
            (("--episodes", "1", "--where", "seed=4"), "no episodes of store are chosen"),
        ],
    )
    def test_a_mistake_is_one_line(
        self,
        store: Path,
        tmp_path: Path,
        complaint: Callable[..., tuple[int, str]],
        args: Any,
        message: str,
    ) -> None:
        (tmp_path / "store").symlink_to(store)
        (tmp_path / "words").write_text("1\nx y\n")
        (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
        code, error = complaint("split", "store", "out", *args)
        assert code == 2
        assert error.startswith(f"Error: {message}")
        assert error.count("\n") == 1
        assert not (tmp_path / "out").exists()
