"""Files that are written atomically, and the order in which they reach the disk."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
from support.faulty_disk import FaultyDisk

from grasp_factory.core.atomic_file import fsync_descriptors, partial_path, replacing, write_atomic


def test_a_durable_write_syncs_the_content_before_the_name(tmp_path: Path) -> None:
    with FaultyDisk(tmp_path, lambda done: False, errno.EIO, stays=False).installed() as disk:
        write_atomic(tmp_path / "file", b"new", durable=True)
    assert disk.done == [
        "unlink file.partial",
        "write file.partial",
        "fsync file.partial",
        "replace file.partial",
        "fsync .",
    ]
    assert (tmp_path / "file").read_bytes() == b"new"


def test_a_write_that_is_not_durable_syncs_nothing(tmp_path: Path) -> None:
    with FaultyDisk(tmp_path, lambda done: False, errno.EIO, stays=False).installed() as disk:
        write_atomic(tmp_path / "file", b"new")
    assert disk.done == ["unlink file.partial", "write file.partial", "replace file.partial"]


@pytest.mark.parametrize("step", ["write", "fsync", "replace"])
def test_a_write_that_fails_leaves_the_file_as_it_was(tmp_path: Path, step: str) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"old")
    faulty = FaultyDisk(tmp_path, lambda done: done.startswith(step), errno.ENOSPC, stays=False)
    with faulty.installed(), pytest.raises(OSError, match="No space left"):
        write_atomic(file, b"new", durable=True)
    assert file.read_bytes() == b"old"
    write_atomic(file, b"new", durable=True)
    assert file.read_bytes() == b"new"
    assert not partial_path(file).exists()


def test_a_replacement_that_fails_removes_the_partial_file(tmp_path: Path) -> None:
    file, aside = tmp_path / "file", tmp_path / "other"
    file.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), replacing(file, aside):
        aside.write_bytes(b"half")
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == [file]
    assert file.read_bytes() == b"old"
    with replacing(file, aside):
        aside.write_bytes(b"new")
    assert list(tmp_path.iterdir()) == [file]
    assert file.read_bytes() == b"new"


def test_after_a_failure_the_other_files_are_not_waited_for(tmp_path: Path) -> None:
    opened: list[int] = []

    def opener(k: int) -> int:
        if k == 0:
            raise OSError(errno.EIO, "Input/output error")
        time.sleep(0.001)
        opened.append(k)
        return os.open(tmp_path, os.O_RDONLY)

    with pytest.raises(OSError, match="Input/output"):
        fsync_descriptors(partial(opener, k) for k in range(20_000))
    assert len(opened) < 10_000


def test_a_process_without_more_threads_syncs_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(ThreadPoolExecutor, "submit", refuse)
    opened: list[str] = []
    fsync_descriptors(
        lambda: opened.append("file") or os.open(tmp_path, os.O_RDONLY) for _ in range(40)
    )
    assert len(opened) == 40


def test_many_files_to_sync_are_not_all_in_memory(tmp_path: Path) -> None:
    opened: list[str] = []
    waiting = []

    def openers() -> Iterator[Callable[[], int]]:
        for k in range(3000):
            waiting.append(k - len(opened))
            yield lambda: opened.append("file") or os.open(tmp_path, os.O_RDONLY)

    fsync_descriptors(openers())
    assert len(opened) == 3000
    assert max(waiting) <= 1000
