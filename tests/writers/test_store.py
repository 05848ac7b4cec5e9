"""The coordinator's side of a store: creation, growth, what is pending, refusals, the lock."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import zarr
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree, pending_blocks, tree

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StaleLockWarning, StoreBusyError, StoreError, StoreMismatchError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import store
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.staging import StagingFolder
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = pytest.mark.slow

CONFIG = small_config()


def fill(path: Path, n: int, config: FactoryConfig = CONFIG) -> None:
    prepare_store(path, config, JOINTS, n, {})
    for block in pending_blocks(path, n):
        ZarrWriter(path).write_block(block, make_rows(config, block, n))


@pytest.fixture(scope="module")
def want(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of 13 episodes, made at once."""
    path = tmp_path_factory.mktemp("want") / "store"
    fill(path, 13)
    return path


class Crash(Exception):
    pass


def crash_after(calls: int, function: Any) -> Any:
    """Return ``function``, which raises instead of being called once more than ``calls`` times."""

    def wrapped(*args: Any, **kwargs: Any) -> Any:
        nonlocal calls
        if calls == 0:
            raise Crash
        calls -= 1
        return function(*args, **kwargs)

    return wrapped


def test_a_new_store_says_what_it_is_and_nothing_of_where_and_when(tmp_path: Path) -> None:
    prepare_store(tmp_path / "secret_place", CONFIG, JOINTS, 5, {"robot": {"joints": ["j1"]}})
    attributes = Dataset(tmp_path / "secret_place").attributes
    assert list(attributes) == [
        *("format", "format_version", "seed", "config", "config_sha256", "block_size"),
        *("renderer", "versions", "platform", "conventions", "license", "created_by", "robot"),
        "metadata_sha256",
    ]
    assert attributes["format"] == "grasp-factory"
    assert attributes["format_version"] == 1
    assert attributes["config"] == json.loads(json.dumps(CONFIG.to_plain()))
    assert attributes["config_sha256"] == CONFIG.sha256()
    assert list(attributes["versions"]) == ["python", "pybullet", "numpy", "zarr", "grasp_factory"]
    assert attributes["robot"] == {"joints": ["j1"]}
    everything = b"".join(tree(tmp_path / "secret_place").values())
    for word in ("secret_place", socket.gethostname(), str(time.gmtime().tm_year)):
        assert word.encode() not in everything


def test_the_same_input_gives_the_same_bytes_anywhere(tmp_path: Path) -> None:
    for name in ("a", "b"):
        prepare_store(tmp_path / name, CONFIG, JOINTS, 5, {})
    assert_same_tree(tmp_path / "a", tmp_path / "b")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_an_empty_directory_becomes_a_store(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert len(Dataset(tmp_path / "out")) == 5


def test_an_empty_directory_stays_the_one_it_was(tmp_path: Path) -> None:
    prepare_store(tmp_path / "want", CONFIG, JOINTS, 5, {})
    (tmp_path / "out").mkdir(mode=0o750)
    before = (tmp_path / "out").stat()
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    after = (tmp_path / "out").stat()
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
    assert_same_tree(tmp_path / "out", tmp_path / "want")
    assert not list(tmp_path.rglob("*.creating"))


def crash_at_move(moves: int, into: Path) -> Any:
    """Return ``os.replace``, which raises at a move into a directory after so many of them."""
    replace = os.replace
    crash = crash_after(moves, replace)

    def wrapped(source: Any, target: Any, **at: Any) -> None:
        folder = os.readlink(f"/proc/self/fd/{at['dst_dir_fd']}")
        (crash if folder == str(into) else replace)(source, target, **at)

    return wrapped


MOVES = 5  # cameras, episodes, imu, streams, zarr.json


@pytest.mark.parametrize("calls", range(MOVES))
def test_a_creation_in_an_empty_directory_that_fails_leaves_it_empty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: int
) -> None:
    (tmp_path / "out").mkdir()
    with monkeypatch.context() as patch, pytest.raises(Crash):
        patch.setattr(os, "replace", crash_at_move(calls, tmp_path / "out"))
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("calls", range(MOVES))
def test_a_creation_in_an_empty_directory_that_is_killed_is_begun_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: int
) -> None:
    prepare_store(tmp_path / "want", CONFIG, JOINTS, 5, {})
    (tmp_path / "out").mkdir()
    with monkeypatch.context() as patch, pytest.raises(Crash):
        patch.setattr(os, "replace", crash_at_move(calls, tmp_path / "out"))
        patch.setattr(StagingFolder, "remove_leftovers", lambda _: None)  # as when killed
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert not (tmp_path / "out/zarr.json").exists()
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert_same_tree(tmp_path / "out", tmp_path / "want")
    assert not list(tmp_path.rglob("*.creating"))


def test_what_someone_put_beside_a_creation_that_was_killed_is_kept(tmp_path: Path) -> None:
    (tmp_path / "out/.creating").mkdir(parents=True)
    (tmp_path / "out/thesis.tex").touch()
    with pytest.raises(StoreMismatchError, match=r"out is in the way: it holds thesis\.tex"):
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert (tmp_path / "out/thesis.tex").exists()


def test_a_creation_that_fails_leaves_nothing_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "create_array", crash_after(3, store.create_array))
    with pytest.raises(Crash):
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert list(tmp_path.iterdir()) == []


def test_a_link_leads_to_the_store_and_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "real")
    prepare_store(tmp_path / "link", CONFIG, JOINTS, 5, {})
    assert (tmp_path / "link").is_symlink()
    assert len(Dataset(tmp_path / "real")) == 5


def test_a_grown_store_is_the_store_made_at_once(tmp_path: Path, want: Path) -> None:
    fill(tmp_path / "out", 5)
    fill(tmp_path / "out", 13)
    assert_same_tree(tmp_path / "out", want)


def test_growing_makes_the_cut_block_pending_and_touches_no_other(tmp_path: Path) -> None:
    path = tmp_path / "out"
    fill(path, 9)
    data = [p for p in path.rglob("*") if p.is_file() and p.name != "zarr.json"]
    stamps = {p: (p.stat().st_ino, p.stat().st_mtime_ns) for p in data}
    prepare_store(path, CONFIG, JOINTS, 14, {})
    assert pending_blocks(path, 14) == [2, 3]
    for block in (2, 3):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, 14))
    for p, stamp in stamps.items():
        now = (p.stat().st_ino, p.stat().st_mtime_ns)
        assert (now == stamp) is (p.name.split(".")[0] in "01"), p


def test_a_smaller_number_leaves_the_store_as_it_is(tmp_path: Path) -> None:
    fill(tmp_path / "out", 5)
    before = tree(tmp_path / "out")
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 2, {"robot": "other"})
    assert tree(tmp_path / "out") == before
    assert pending_blocks(tmp_path / "out", 2) == []


def test_a_store_keeps_the_versions_that_it_was_created_with(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    zarr.open_group(tmp_path / "out", mode="r+").attrs["versions"] = {"numpy": "1.0"}
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 9, {"robot": "other"})
    attributes = Dataset(tmp_path / "out").attributes
    assert attributes["versions"] == {"numpy": "1.0"}
    assert "robot" not in attributes


def test_pending_are_the_blocks_with_a_missing_row_below_n(tmp_path: Path) -> None:
    path = tmp_path / "out"
    prepare_store(path, CONFIG, JOINTS, 13, {})
    assert pending_blocks(path, 13) == [0, 1, 2, 3]
    assert pending_blocks(path, 8) == [0, 1]
    ZarrWriter(path).write_block(1, make_rows(CONFIG, 1, 13, quarantined=(4, 5, 6, 7)))
    assert pending_blocks(path, 13) == [0, 2, 3]
    ZarrWriter(path).write_block(0, make_rows(CONFIG, 0, 3))
    assert pending_blocks(path, 3) == []
    assert pending_blocks(path, 4) == [0]


@pytest.mark.parametrize(("done", "n"), [(0, 13), (1, 9), (20, 5), (-1, 9)])
def test_a_growth_that_was_interrupted_is_taken_up_with_any_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: int, n: int
) -> None:
    done %= len(schema.expand(CONFIG))
    prepare_store(tmp_path / "want", CONFIG, JOINTS, n, {})
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    with monkeypatch.context() as patch, pytest.raises(Crash):
        patch.setattr(store, "set_rows", crash_after(done, store.set_rows))
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 100, {})
    assert len(Dataset(tmp_path / "out")) == 5
    (tmp_path / "out/episodes/status/zarr.json.partial").touch()
    prepare_store(tmp_path / "out", CONFIG, JOINTS, n, {})
    assert_same_tree(tmp_path / "out", tmp_path / "want")


def test_a_creation_that_was_interrupted_leaves_the_path_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare_store(tmp_path / "want", CONFIG, JOINTS, 5, {})
    for function, done in (("create_array", 0), ("create_array", 20), ("fsync_tree", 0)):
        with monkeypatch.context() as patch, pytest.raises(Crash):
            patch.setattr(store, function, crash_after(done, getattr(store, function)))
            prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
        assert not (tmp_path / "out").exists()
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert_same_tree(tmp_path / "out", tmp_path / "want")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "want"]


def test_creation_deletes_nothing_that_is_not_its_own(tmp_path: Path) -> None:
    mine = tmp_path / ".out.creating" / "thesis.tex"
    mine.parent.mkdir()
    mine.touch()
    with pytest.raises(StoreMismatchError) as caught:
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert str(caught.value) == f"{mine.parent} is in the way: it holds thesis.tex; move it"
    assert mine.exists()


def put_file(path: Path) -> None:
    path.write_text("hello")


def put_directory(path: Path) -> None:
    path.mkdir()
    (path / "holiday.jpg").touch()


def put_foreign_zarr(path: Path) -> None:
    zarr.create_group(path, attributes={"format": "other"})


def put_foreign_array(path: Path) -> None:
    zarr.create_array(path, shape=(3,), dtype="int32")


def put_newer(path: Path) -> None:
    zarr.create_group(path, attributes={"format": "grasp-factory", "format_version": 2})


def put_other_seed(path: Path) -> None:
    prepare_store(path, small_config(seed=7), JOINTS, 5, {})


def put_other_config(path: Path) -> None:
    prepare_store(path, small_config(motion={"grip_force": 9.0}), JOINTS, 5, {})


def put_other_robot(path: Path) -> None:
    prepare_store(path, CONFIG, 6, 5, {})


REFUSALS = {
    put_file: "{path} is a file, not a grasp-factory store; choose another --out",
    put_directory: "{path} is not a grasp-factory store; choose another --out",
    put_foreign_zarr: "{path} is not a grasp-factory store; choose another --out",
    put_foreign_array: "{path} is not a grasp-factory store; choose another --out",
    put_newer: (
        "{path} has format version 2, this version of grasp-factory reads up to 1:"
        " install a newer one; choose another --out"
    ),
    put_other_seed: (
        "{path} holds a dataset of another config: it has seed: 7, and this run has 0;"
        " use its config (leave this setting out) or choose another --out"
    ),
    put_other_config: (
        "{path} holds a dataset of another config: it has motion.grip_force: 9.0, and this run has"
        " 20.0; use its config (leave this setting out) or choose another --out"
    ),
    put_other_robot: (
        "{path} was made by another version: streams/joint_positions is float32 ({room}, 6),"
        " this one makes float32 ({room}, 7); use that version or choose another --out"
    ),
}


@pytest.mark.parametrize("put", REFUSALS, ids=lambda put: put.__name__)
def test_what_is_no_store_of_this_config_is_refused_and_left_alone(
    tmp_path: Path, put: Any
) -> None:
    path = tmp_path / "out"
    put(path)
    before = tree(tmp_path)
    with pytest.raises(StoreMismatchError) as caught:
        prepare_store(path, CONFIG, JOINTS, 9, {})
    room = schema.sizes(CONFIG, JOINTS)["T"]
    assert str(caught.value) == REFUSALS[put].format(path=path, room=room)
    assert tree(tmp_path) == before


def test_damaged_metadata_is_an_error_of_one_line(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    (tmp_path / "out/zarr.json").write_text('{"attributes": {')
    with pytest.raises(StoreError) as caught:
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    what = "Expecting property name enclosed in double quotes: line 1 column 17 (char 16)"
    assert str(caught.value) == f"{tmp_path / 'out'} is damaged: zarr.json: {what}"


@pytest.mark.parametrize("key", ["config", "config_sha256", "versions", "platform"])
def test_an_attribute_that_is_lost_is_named(tmp_path: Path, key: str) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    file = tmp_path / "out/zarr.json"
    metadata = json.loads(file.read_text())
    del metadata["attributes"][key]
    file.write_text(json.dumps(metadata))
    with pytest.raises(StoreError) as caught:
        Dataset(tmp_path / "out")
    what = f"attribute {key} is missing or broken"
    assert str(caught.value) == f"{tmp_path / 'out'} is damaged: zarr.json: {what}"


def test_a_damaged_commit_marker_is_an_error_of_one_line(tmp_path: Path) -> None:
    fill(tmp_path / "out", 5)
    out = tmp_path / "out"
    (out / "episodes/status/0").write_bytes(b"\0")
    for read in (lambda: pending_blocks(out, 5), lambda: Dataset(out).committed):
        with pytest.raises(StoreError) as caught:
            read()
        assert str(caught.value).startswith(
            f"{tmp_path / 'out'}: episodes/status of episodes 0 to 3 cannot be read: "
        )
        assert "\n" not in str(caught.value)


def test_a_lost_array_is_named(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    (tmp_path / "out/streams/phase/zarr.json").unlink()
    with pytest.raises(StoreError) as caught:
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert str(caught.value).startswith(f"{tmp_path / 'out'} is damaged: array streams/phase: ")
    assert "\n" not in str(caught.value)


def take(path: Path) -> None:
    with StoreLock(path):
        pass


def prepare(path: Path) -> None:
    prepare_store(path, CONFIG, JOINTS, 5, {})


@pytest.mark.parametrize("action", [prepare, take])
class TestWhereNothingCanBeWritten:
    def test_a_missing_parent_is_named(self, tmp_path: Path, action: Any) -> None:
        path = tmp_path / "none" / "out"
        with pytest.raises(StoreMismatchError) as caught:
            action(path)
        assert str(caught.value) == (
            f"{path} cannot be written: there is no directory {tmp_path / 'none'};"
            " choose another --out"
        )

    def test_a_forbidden_parent_says_so(
        self, tmp_path: Path, action: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def forbid(*_: Any, **__: Any) -> Any:
            raise PermissionError(13, "Permission denied")

        with monkeypatch.context() as patch, pytest.raises(StoreError) as caught:
            patch.setattr(os, "open", forbid)
            patch.setattr(Path, "mkdir", forbid)
            action(tmp_path / "out")
        assert str(caught.value) == f"{tmp_path / 'out'} cannot be written: Permission denied"


def test_a_full_disk_is_no_fault_of_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "fsync_tree", fail)
    with pytest.raises(StoreError) as caught:
        prepare_store(tmp_path / "out", CONFIG, JOINTS, 5, {})
    assert str(caught.value) == f"{tmp_path / 'out'} cannot be written: No space left on device"


HOLDER = """
import sys
from pathlib import Path
from grasp_factory.writers.zarr.lock import StoreLock
with StoreLock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path: Path) -> Any:
    """Yield a process that holds the lock of ``out``."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path / "out")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


def test_a_second_process_is_told_who_holds_the_store(tmp_path: Path, holder: Any) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "out")
    for name in ("out", "link"):
        with pytest.raises(StoreBusyError) as caught, StoreLock(tmp_path / name):
            pass
        assert str(caught.value) == (
            f"{tmp_path / name} is being written by process {holder.pid} on"
            f" {socket.gethostname()}; wait for it or choose another --out"
        )
    with StoreLock(tmp_path / "other"):
        pass


def test_a_killed_holder_leaves_the_store_free(tmp_path: Path, holder: Any) -> None:
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    file = tmp_path / ".out.grasp-factory.lock"
    assert file.exists()
    who = f"process {holder.pid} on {socket.gethostname()}"
    with pytest.warns(StaleLockWarning, match=who), StoreLock(tmp_path / "out"):
        assert file.read_text() == f"{socket.gethostname()} {os.getpid()}\n"


def test_a_lock_file_that_somebody_removed_lets_nobody_in(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 4, {})
    with StoreLock(tmp_path / "out") as lock:
        lock.file.unlink()
        with pytest.raises(StoreBusyError, match="is being written by another process"):
            StoreLock(tmp_path / "out").__enter__()
    with StoreLock(tmp_path / "out"):
        pass


def test_a_lock_file_of_zeros_is_what_a_power_cut_left(tmp_path: Path) -> None:
    (tmp_path / ".out.grasp-factory.lock").write_bytes(bytes(12))
    with StoreLock(tmp_path / "out"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_file_system_without_locks_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(StoreError, match="cannot be locked: No locks available; on a file system"):
        StoreLock(tmp_path / "out").__enter__()


def test_the_lock_file_goes_with_the_lock_even_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(Crash), StoreLock(tmp_path / "out"):
        assert [path.name for path in tmp_path.iterdir()] == [".out.grasp-factory.lock"]
        raise Crash
    assert list(tmp_path.iterdir()) == []


def test_whoever_gets_a_lock_file_that_was_just_removed_tries_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = os.open
    removed = []

    def open_and_lose(path: Any, *args: Any, **kwargs: Any) -> int:
        descriptor = opened(path, *args, **kwargs)
        if not removed:  # the holder leaves between our open and our flock
            os.unlink(path)
            removed.append(path)
        return descriptor

    monkeypatch.setattr(os, "open", open_and_lose)
    with StoreLock(tmp_path / "out") as lock:
        assert removed == [lock.file]
        assert lock.file.exists()


def test_the_lock_is_not_taken_twice_in_one_process(tmp_path: Path) -> None:
    with StoreLock(tmp_path / "out"), pytest.raises(StoreBusyError), StoreLock(tmp_path / "out"):
        pass


def put_text(file: Path) -> None:
    file.write_text("my notes\non two lines\n")


def put_long_text(file: Path) -> None:
    file.write_text("host " + "1" * 1000 + "\n")


def put_pipe(file: Path) -> None:
    os.mkfifo(file)


def put_folder(file: Path) -> None:
    file.mkdir()


def put_link(file: Path) -> None:
    (file.parent / "notes.txt").touch()
    file.symlink_to("notes.txt")


@pytest.mark.parametrize(
    "put", [put_text, put_long_text, put_pipe, put_folder, put_link], ids=lambda put: put.__name__
)
def test_a_foreign_file_of_the_locks_name_is_refused_and_left_alone(
    tmp_path: Path, put: Any
) -> None:
    file = tmp_path / ".out.grasp-factory.lock"
    put(file)
    before = file.lstat(), sorted(tmp_path.iterdir())
    with pytest.raises(StoreMismatchError) as caught, StoreLock(tmp_path / "out"):
        pass
    assert str(caught.value).startswith(f"{file} is in the way: it is no lock of grasp-factory; ")
    assert (file.lstat(), sorted(tmp_path.iterdir())) == before


def test_a_file_that_is_called_like_the_store_with_lock_is_not_touched(tmp_path: Path) -> None:
    mine = tmp_path / "out.lock"
    mine.write_text("mine")
    with StoreLock(tmp_path / "out"):
        assert mine.read_text() == "mine"
    assert mine.read_text() == "mine"


def test_a_lock_file_that_someone_replaced_is_not_removed(tmp_path: Path) -> None:
    with StoreLock(tmp_path / "out") as lock:
        lock.file.unlink()
        lock.file.write_text("mine")
    assert lock.file.read_text() == "mine"


def circle(folder: Path) -> Path:
    (folder / "loop").symlink_to("loop")
    return folder / "loop"


NOWHERE: dict[str, Any] = {
    "a circle of links": circle,
    "a path through a circle of links": lambda folder: circle(folder) / "x.zarr",
    "a name that is too long": lambda folder: folder / ("x" * 300),
    "a path that is too long": lambda folder: folder / ("b/" * 3000),
    "a null byte": lambda folder: folder / "a\0b",
    "the root": lambda folder: Path("/"),
}


@pytest.mark.parametrize("what", NOWHERE)
@pytest.mark.parametrize("use", [prepare, take, Dataset], ids=["prepare", "lock", "open"])
def test_a_path_that_leads_nowhere_is_refused_in_one_line(
    tmp_path: Path, what: str, use: Any
) -> None:
    path = NOWHERE[what](tmp_path)
    with pytest.raises(StoreMismatchError) as caught:
        use(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).endswith("; choose another path")


@pytest.mark.parametrize("use", [prepare, take, Dataset], ids=["prepare", "lock", "open"])
def test_a_directory_that_may_not_be_entered_is_named(
    tmp_path: Path, use: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbid(*_: Any, **__: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch, pytest.raises(StoreMismatchError) as caught:
        patch.setattr(os, "stat", forbid)
        use(tmp_path / "out")
    assert str(caught.value) == (
        f"{tmp_path / 'out'} cannot be used: Permission denied; choose another path"
    )


@pytest.mark.parametrize("content", [b"", bytes(10), bytes(4096), b"host 12\n"])
@pytest.mark.parametrize("name", ["lock", "shard-3-of-9.lock"])
def test_a_lock_that_is_a_second_name_of_a_file_is_not_written_to(
    tmp_path: Path, name: str, content: bytes
) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 3, {})
    (tmp_path / "mine").write_bytes(content)
    (tmp_path / f".out.grasp-factory.{name}").hardlink_to(tmp_path / "mine")
    with pytest.raises(StoreMismatchError, match="is in the way"), StoreLock(tmp_path / "out"):
        pass
    assert (tmp_path / "mine").read_bytes() == content
