"""A file with a second name is copied before anything is appended; the other name keeps it."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from grasp_factory.core.limits import LOG, Limit
from grasp_factory.core.own_copy import make_own
from grasp_factory.core.place import place_at
from grasp_factory.errors import IrregularFileError, LimitError
from grasp_factory.factory.run_log import RunLog


def linked(tmp_path: Path, content: bytes = b"a line\n") -> tuple[Path, Path]:
    """Return a file, and its second name in a cache, where nobody may write to it."""
    file, cache = tmp_path / "file", tmp_path / "cache"
    file.write_bytes(content)
    os.link(file, cache)
    cache.chmod(0o444)
    return file, cache


def test_the_file_becomes_one_of_its_own_with_the_same_content(tmp_path: Path) -> None:
    file, cache = linked(tmp_path)
    make_own(place_at(file), LOG)
    assert file.read_bytes() == cache.read_bytes() == b"a line\n"
    assert file.stat().st_ino != cache.stat().st_ino
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "file"]


def test_a_file_with_one_name_stays_the_same_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"mine")
    before = (tmp_path / "file").stat()
    make_own(place_at(tmp_path / "file"), LOG)
    assert (tmp_path / "file").stat() == before
    make_own(place_at(tmp_path / "none"), LOG)
    assert not (tmp_path / "none").exists()


def test_a_link_is_refused_and_a_large_file_is_not_read(tmp_path: Path) -> None:
    file, cache = linked(tmp_path, bytes(100))
    (tmp_path / "link").symlink_to(file)
    with pytest.raises(IrregularFileError):
        make_own(place_at(tmp_path / "link"), LOG)
    with pytest.raises(LimitError):
        make_own(place_at(file), Limit("log", 99, "a log"))
    assert file.stat().st_ino == cache.stat().st_ino


def test_the_run_log_is_written_aside(tmp_path: Path) -> None:
    log, cache = tmp_path / "s.zarr.runs.jsonl", tmp_path / "cache"
    log.write_bytes(b"{}\n")
    os.link(log, cache)
    request = SimpleNamespace(n=1, workers=1, shard="0/1")
    with RunLog(tmp_path / "s.zarr", cast(Any, request)) as run:
        run.begin()
    assert cache.read_bytes() == b"{}\n"
    assert len(log.read_bytes().splitlines()) == 2
