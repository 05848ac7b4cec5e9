"""Two writers of one block: the files are those of one of them, whatever happens to the other."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_episodes import JOINTS, make_episode, small_config
from support.helpers import tree
from support.scale import scaled

from grasp_factory.core.episode import Episode
from grasp_factory.errors import StoreError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import writer as writer_module
from grasp_factory.writers.zarr.block_attempt import MOST_CLAIMS, BlockAttempt
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
CONFIG = small_config(block_size=1)
RACES = scaled(4, 200)
CONFLICT = "block 0 was written with another episode 0 by another process"
CALLS = ("open", "replace", "unlink")
"""Functions of ``os`` by which an attempt changes the disk."""


def episodes() -> tuple[Episode, Episode]:
    """Return two episodes of one recipe and of different bytes."""
    one = make_episode(CONFIG, 0)
    phase = one.streams["phase"] + np.uint8(1)
    return one, dataclasses.replace(one, streams={**one.streams, "phase": phase})


ONE, OTHER = episodes()


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return new_store(tmp_path / "out")


def new_store(path: Path) -> Path:
    prepare_store(path, CONFIG, JOINTS, 1, {})
    return path


@pytest.fixture(scope="module")
def wanted(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, bytes]]:
    """Return the files of the store with the one episode, and of that with the other."""
    folder = tmp_path_factory.mktemp("wanted")
    for name, episode in (("one", ONE), ("other", OTHER)):
        write(new_store(folder / name), episode)
    return [tree(folder / "one"), tree(folder / "other")]


def write(store: Path, episode: Episode) -> str:
    """Write the block; return what was refused."""
    try:
        ZarrWriter(store).write_block(0, [episode])
    except StoreError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("second", [ONE, OTHER], ids=["same", "different"])
def test_a_race_has_one_winner_and_leaves_nothing(
    tmp_path: Path, wanted: Sequence[Any], second: Episode
) -> None:
    for number in range(RACES):
        store, said = new_store(tmp_path / f"{number}.zarr"), ["", ""]
        writers, start = [ZarrWriter(store), ZarrWriter(store)], threading.Barrier(2)

        def run(which: int, episode: Episode, said=said, writers=writers, start=start) -> None:
            start.wait()
            try:
                writers[which].write_block(0, [episode])
            except StoreError as error:
                said[which] = str(error)

        threads = [threading.Thread(target=run, args=pair) for pair in enumerate((ONE, second))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if second is ONE:
            assert said == ["", ""]
            assert tree(store) == wanted[0]
        else:
            (lost,) = (which for which in (0, 1) if said[which])
            assert CONFLICT in said[lost]
            assert "\n" not in said[lost]
            assert tree(store) == wanted[1 - lost]


class Stopped:
    """A writer that stops before its n-th call of the operating system, until it is continued."""

    def __init__(self, store: Path, episode: Episode, call: int) -> None:
        self.said = self._left = ""
        self.has_stopped, self._go = threading.Event(), threading.Event()
        self._calls, self._store, self._episode = call, store, episode
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        self.said = write(self._store, self._episode)
        self.has_stopped.set()

    def start(self) -> None:
        self._thread.start()
        self.has_stopped.wait()

    def go_on(self) -> bool:
        """Go on to the end; return whether it had stopped before it."""
        was_alive = self._thread.is_alive() and self._calls < 0
        self._go.set()
        self._thread.join()
        return was_alive

    def count(self) -> None:
        """Count a call of this writer, and stop at the last one."""
        if threading.current_thread() is self._thread:
            self._calls -= 1
            if self._calls == -1:
                self.has_stopped.set()
                self._go.wait()


@pytest.fixture
def stopping(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Stopped]]:
    """Yield a list: the writers in it count their calls."""
    listed: list[Stopped] = []
    os_open = os.open
    for name in CALLS:
        real = getattr(os, name)

        def call(*args: Any, real: Any = real, **more: Any) -> Any:
            is_reading = real is os_open and not args[1] & os.O_CREAT
            for writer in () if is_reading else listed:
                writer.count()
            return real(*args, **more)

        monkeypatch.setattr(os, name, call)
    yield listed
    for writer in listed:
        writer.go_on()


@pytest.mark.parametrize("second", [ONE, OTHER], ids=["same", "different"])
def test_a_writer_that_is_stopped_anywhere_does_no_harm_when_it_goes_on(
    tmp_path: Path, wanted: Sequence[Any], stopping: list[Stopped], second: Episode
) -> None:
    stops = 0
    for call in range(0, 1000, scaled(41, 1)):
        store = new_store(tmp_path / f"{call}.zarr")
        zombie = Stopped(store, ONE, call)
        stopping[:] = [zombie]
        zombie.start()
        said = write(store, second)
        committed = tree(store / "episodes/status")
        had_stopped = zombie.go_on()
        if not had_stopped:
            break
        stops += 1
        assert tree(store / "episodes/status")["0"] == committed["0"]
        if second is ONE:
            assert (said, zombie.said) == ("", "")
            assert tree(store) == wanted[0]
        else:
            assert [bool(said), bool(zombie.said)].count(True) == 1
            assert CONFLICT in said + zombie.said
            assert tree(store) == wanted[0 if said else 1]
    assert stops > 5


def test_what_killed_writers_left_is_removed_by_the_next_run_however_many_they_are(
    store: Path, wanted: Sequence[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(attempt: BlockAttempt, *_: object) -> None:
        raise KeyboardInterrupt

    empty = tree(store)
    with monkeypatch.context() as patch:
        patch.setattr(BlockAttempt, "publish", killed)
        patch.setattr(BlockAttempt, "__exit__", lambda *_: None)
        for _ in range(MOST_CLAIMS):
            with pytest.raises(KeyboardInterrupt):
                write(store, ONE)
    assert len(list(store.rglob("*.claim-*.partial"))) == MOST_CLAIMS
    with monkeypatch.context() as patch:
        patch.setattr(writer_module, "WAITS_S", (0.0, 0.0))
        assert "block 0 is written by other processes again and again" in write(store, ONE)
    ZarrWriter(store).remove_leftovers()
    assert tree(store) == empty
    assert write(store, ONE) == ""
    assert tree(store) == wanted[0]


def test_a_run_that_removes_leftovers_stops_a_writer_that_it_does_not_know_of(
    store: Path, stopping: list[Stopped]
) -> None:
    empty, zombie = tree(store), Stopped(store, ONE, 40)
    stopping[:] = [zombie]
    zombie.start()
    ZarrWriter(store).remove_leftovers()
    before = tree(store)
    assert "episodes/status/0" not in before
    zombie.go_on()  # it begins again, for nobody else is at work
    assert zombie.said == ""
    assert set(before) <= set(tree(store)) | set(empty)
    assert not list(store.rglob("*.partial"))
