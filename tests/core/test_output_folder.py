"""Folders appear at their place as a whole, also if the process is killed at any call."""

from __future__ import annotations

import multiprocessing
import os
import signal
from pathlib import Path

import pytest
from support.killed_publishing import publish_until_killed

from grasp_factory.core.output_folder import check_free, publish
from grasp_factory.errors import UsageError


def built(folder: Path) -> Path:
    (folder / "built").mkdir()
    (folder / "built/file").write_text("whole")
    return folder / "built"


@pytest.mark.parametrize("is_done", [False, True])
def test_a_process_that_is_killed_leaves_the_whole_or_a_free_place(
    tmp_path: Path, is_done: bool
) -> None:
    spawn = multiprocessing.get_context("spawn")
    for calls in range(5):
        folder = tmp_path / str(calls)
        folder.mkdir()
        built(folder)
        process = spawn.Process(target=publish_until_killed, args=(folder, calls, is_done))
        process.start()
        process.join()
        if (folder / "out/file").exists():
            assert (folder / "out/file").read_text() == "whole"
        else:
            check_free(folder / "out", "a test")
            publish(folder / "built", folder / "out", "a test")
        if process.exitcode == 0:
            break
        assert process.exitcode == -signal.SIGKILL
    assert calls > 0


@pytest.mark.parametrize("what", ["a file", "a folder with a file", "a link to nothing"])
def test_what_appears_after_the_check_is_not_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    out = tmp_path / "out"
    if what == "a file":
        out.write_text("mine")
    elif what == "a link to nothing":
        out.symlink_to("nowhere")
    else:
        out.mkdir()
        (out / "mine").touch()
    monkeypatch.setattr(os.path, "lexists", lambda path: False)
    with pytest.raises(UsageError, match="out exists, and a test overwrites nothing"):
        publish(built(tmp_path), out, "a test")
    assert (tmp_path / "built/file").exists()
