"""Folders for the files of one process: removed at the end, or by the next process."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from grasp_factory.core.scratch_folder import scratch_folder

DEAD = 2**22 + 1
"""No process has this id."""


def test_a_scratch_folder_is_removed_at_the_end_also_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), scratch_folder(tmp_path, "out") as folder:
        (folder / "file").touch()
        assert folder.parent == tmp_path
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    host = socket.gethostname()
    left = tmp_path / f".out-{host}-{DEAD}-abc"
    kept = [
        tmp_path / name
        for name in (
            f".out-{host}-{os.getpid()}-abc",
            f".out-{host}-{DEAD}-{os.getpid()}-abc",  # of a host whose name ends in a number
            f".out-other-{DEAD}-abc",
            f".other-{host}-{DEAD}-abc",
            f".out-{host}-notes",
        )
    ]
    for folder in (left, *kept):
        folder.mkdir()
    with scratch_folder(tmp_path, "out"):
        assert not left.exists()
    assert sorted(tmp_path.iterdir()) == sorted(kept)


@pytest.mark.parametrize("name", ["a?b#c", "a%41", "a&b=c", "a[b]*", "a\nb"])
def test_the_name_has_no_signs_of_a_uri_or_a_pattern(tmp_path: Path, name: str) -> None:
    with scratch_folder(tmp_path, name) as folder:
        assert not set(folder.name) & set("?#%&=[]*\n")
        assert folder.parent == tmp_path
    assert list(tmp_path.iterdir()) == []
