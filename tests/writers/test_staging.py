"""Staging: what is built aside is published as a whole, and only our own files are removed."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import JOINTS, small_config
from support.faulty_disk import FaultyDisk

from grasp_factory.core.place import place_at
from grasp_factory.errors import IrregularFileError, StoreMismatchError
from grasp_factory.writers.zarr.label_columns import added_labels, write_label
from grasp_factory.writers.zarr.staging import StagingFolder
from grasp_factory.writers.zarr.store import prepare_store


def fill(folder: Path) -> None:
    """Write files of a store."""
    (folder / "episodes").mkdir()
    for name in ("episodes/0.0", "zarr.json"):
        (folder / name).touch()


def staging(folder: Path) -> StagingFolder:
    return StagingFolder(place_at(folder / "out"), ".new")


@pytest.fixture
def watched(tmp_path: Path) -> FaultyDisk:
    """Return a disk that fails never."""
    return FaultyDisk(tmp_path, lambda done: False, errno.EIO, stays=False)


def test_a_new_store_is_renamed_and_its_name_is_synced(tmp_path: Path, watched: FaultyDisk) -> None:
    with (
        watched.installed(),
        staging(tmp_path).building() as folder,
    ):
        fill(folder.path)
        watched.done.clear()
    assert watched.done == ["replace .out.new", "fsync ."]


def test_in_an_empty_directory_the_metadata_of_the_root_comes_last_on_the_disk(
    tmp_path: Path, watched: FaultyDisk
) -> None:
    (tmp_path / "out").mkdir()
    with (
        watched.installed(),
        staging(tmp_path).building() as folder,
    ):
        fill(folder.path)
        watched.done.clear()
    assert watched.done == [
        *("fsync out", "replace out/.new/episodes"),
        *("fsync out", "replace out/.new/zarr.json"),
        *("rmdir out/.new", "fsync out"),
    ]


def test_a_failure_removes_nothing_that_somebody_put_there_meanwhile(tmp_path: Path) -> None:
    mine = tmp_path / "out" / "holiday" / "beach.jpg"
    (tmp_path / "out").mkdir()
    mine_too = staging(tmp_path)
    with pytest.raises(ZeroDivisionError), mine_too.building() as folder:
        fill(folder.path)
        mine.parent.mkdir()
        mine.touch()
        raise ZeroDivisionError
    assert mine.exists()
    with pytest.raises(StoreMismatchError, match=r"in the way: it holds beach\.jpg; move it"):
        mine_too.check_leftovers()


@pytest.mark.parametrize("is_inside", [False, True])
def test_a_failure_leaves_nothing_of_ours(tmp_path: Path, is_inside: bool) -> None:
    if is_inside:
        (tmp_path / "out").mkdir()
    with (
        pytest.raises(ZeroDivisionError),
        staging(tmp_path).building() as f,
    ):
        fill(f.path)
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.rglob("*")] == ["out"] * is_inside


def test_a_link_among_the_leftovers_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / ".out.new").mkdir()
    (tmp_path / ".out.new" / "0.0").symlink_to(tmp_path)
    with pytest.raises(IrregularFileError, match=r"out\.new/0\.0 is a link"):
        staging(tmp_path).remove_leftovers()
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


@pytest.mark.parametrize("name", ["holiday/0001.jpg", "holiday/0001", "notes/1-2.npz"])
def test_a_users_folders_beside_a_staging_folder_stay(tmp_path: Path, name: str) -> None:
    file = tmp_path / "out" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    (tmp_path / "out" / ".new").mkdir()
    with (
        pytest.raises(StoreMismatchError, match=f"it holds {file.name}"),
        staging(tmp_path).building(),
    ):
        pass
    assert file.read_text() == "mine"
