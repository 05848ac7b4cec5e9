"""Staging: what is built aside is published as a whole, and only our own files are removed."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import JOINTS, small_config
from support.faulty_disk import FaultyDisk

from grasp_factory.errors import StoreMismatchError
from grasp_factory.writers.zarr.label_columns import added_labels, write_label
from grasp_factory.writers.zarr.staging import StagingFolder
from grasp_factory.writers.zarr.store import prepare_store


def fill(folder: Path) -> None:
    """Write files of a store."""
    (folder / "episodes").mkdir()
    for name in ("episodes/0.0", "zarr.json"):
        (folder / name).touch()


@pytest.fixture
def watched(tmp_path: Path) -> FaultyDisk:
    """Return a disk that fails never."""
    return FaultyDisk(tmp_path, lambda done: False, errno.EIO, stays=False)


def test_a_new_store_is_renamed_and_its_name_is_synced(tmp_path: Path, watched: FaultyDisk) -> None:
    with watched.installed(), StagingFolder(tmp_path / "out", ".new").building() as folder:
        fill(folder)
        watched.done.clear()
    assert watched.done == ["replace .out.new", "fsync ."]


def test_in_an_empty_directory_the_metadata_of_the_root_comes_last_on_the_disk(
    tmp_path: Path, watched: FaultyDisk
) -> None:
    (tmp_path / "out").mkdir()
    with watched.installed(), StagingFolder(tmp_path / "out", ".new").building() as folder:
        fill(folder)
        watched.done.clear()
    assert watched.done == [
        *("fsync out", "replace out/.new/episodes"),
        *("fsync out", "replace out/.new/zarr.json"),
        *("rmdir out/.new", "fsync out"),
    ]


def test_a_failure_removes_nothing_that_somebody_put_there_meanwhile(tmp_path: Path) -> None:
    mine = tmp_path / "out" / "holiday" / "beach.jpg"
    (tmp_path / "out").mkdir()
    staging = StagingFolder(tmp_path / "out", ".new")
    with pytest.raises(ZeroDivisionError), staging.building() as folder:
        fill(folder)
        mine.parent.mkdir()
        mine.touch()
        raise ZeroDivisionError
    assert mine.exists()
    with pytest.raises(StoreMismatchError, match=r"in the way: it holds beach\.jpg; move it"):
        staging.check_leftovers()


@pytest.mark.parametrize("is_inside", [False, True])
def test_a_failure_leaves_nothing_of_ours(tmp_path: Path, is_inside: bool) -> None:
    if is_inside:
        (tmp_path / "out").mkdir()
    with pytest.raises(ZeroDivisionError), StagingFolder(tmp_path / "out", ".new").building() as f:
        fill(f)
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.rglob("*")] == ["out"] * is_inside


def test_a_link_among_the_leftovers_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / ".out.new").mkdir()
    (tmp_path / ".out.new" / "0.0").symlink_to(tmp_path)
    with pytest.raises(StoreMismatchError, match=r"in the way: it holds 0\.0; move it"):
        StagingFolder(tmp_path / "out", ".new").remove_leftovers()
    assert (tmp_path / ".out.new" / "0.0").is_symlink()


def test_what_a_killed_run_left_of_a_label_is_replaced_but_no_file_of_a_user(
    tmp_path: Path,
) -> None:
    store, outcome = tmp_path / "store", np.zeros(5, np.uint8)
    prepare_store(store, small_config(), JOINTS, 5, {})
    left = store / "labels" / ".mine.creating"
    (left / "outcome" / "c").mkdir(parents=True)
    (left / "outcome" / "c" / "0").touch()
    write_label(store, "mine", outcome, {})
    assert added_labels(store) == ["mine"]
    assert not left.exists()
    mine = store / "labels" / ".other.creating" / "thesis.tex"
    mine.parent.mkdir()
    mine.touch()
    with pytest.raises(StoreMismatchError, match="thesis"):
        write_label(store, "other", outcome, {})
    assert mine.exists()
