"""Files that are locked: one holder, of the file that has the name."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path
from typing import Any

import pytest

from grasp_factory.core.locked_file import CannotLockError, has_name, open_locked, try_upgrade


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_a_lock_has_one_holder_until_it_is_closed(tmp_path: Path) -> None:
    held = open_locked(tmp_path / "lock")
    before = open_files()
    with pytest.raises(BlockingIOError):
        open_locked(tmp_path / "lock")
    assert open_files() == before
    os.close(held)
    os.close(open_locked(tmp_path / "lock"))


def test_a_shared_lock_becomes_exclusive_when_nobody_else_has_it(tmp_path: Path) -> None:
    mine, other = (open_locked(tmp_path / "lock", shared=True) for _ in range(2))
    assert not try_upgrade(mine)
    os.close(other)
    assert try_upgrade(mine)
    os.close(mine)


@pytest.mark.parametrize("is_replaced", [False, True], ids=["removed", "replaced"])
def test_a_file_that_loses_its_name_before_it_is_locked_is_opened_again(
    tmp_path: Path, is_replaced: bool
) -> None:
    file, opened = tmp_path / "lock", list[int]()

    def lose(descriptor: int) -> None:
        if not opened:
            file.unlink()
            if is_replaced:
                file.touch()
        opened.append(os.fstat(descriptor).st_ino)

    before = open_files()
    descriptor = open_locked(file, check=lose)
    assert len(opened) == 2
    assert has_name(descriptor, file)
    assert open_files() == before + 1
    os.close(descriptor)


def test_what_the_check_refuses_is_not_locked_and_is_closed(tmp_path: Path) -> None:
    def refuse(descriptor: int) -> None:
        raise ZeroDivisionError

    before = open_files()
    with pytest.raises(ZeroDivisionError):
        open_locked(tmp_path / "lock", check=refuse)
    assert open_files() == before


def test_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lock").symlink_to("elsewhere")
    with pytest.raises(OSError, match="symbolic links") as caught:
        open_locked(tmp_path / "lock")
    assert caught.value.errno == errno.ELOOP
    assert not (tmp_path / "elsewhere").exists()


def test_a_file_system_without_locks_is_an_error_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    before = open_files()
    with pytest.raises(CannotLockError, match="it cannot be locked: No locks available"):
        open_locked(tmp_path / "lock")
    assert open_files() == before
