"""Stores that pretend to be others: what is kept of one is not shown for another."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import google_crc32c
import pytest
from flask.testing import FlaskClient
from numcodecs.zstd import compress
from support.fake_episodes import JOINTS, make_rows, small_config

from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.clips import WantedClip
from grasp_factory.apps.browse.image_files import thumbnail
from grasp_factory.apps.browse.open_stores import OpenStores
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.core.cache import VARIABLE
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import Query, fresh
from grasp_factory.errors import UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config()
N = 4


@pytest.fixture
def honest(tmp_path: Path) -> Path:
    path = tmp_path / "honest.zarr"
    prepare_store(path, CONFIG, JOINTS, N, {"robot": ROBOTS[CONFIG.robot].facts()})
    ZarrWriter(path).write_block(0, make_rows(CONFIG, 0, N))
    return path


@pytest.fixture
def forged(honest: Path) -> Path:
    """Return a copy with the same checksums, in which two episodes have each other's images."""
    path = Path(shutil.copytree(honest, honest.with_name("forged.zarr")))
    shard = path / "cameras/front/rgb/0.0.0.0.0"
    data = shard.read_bytes()
    frames = 2 * 16  # offset and length of two images
    index = len(data) - 4 - N * frames
    first, second = data[index : index + frames], data[index + frames : index + 2 * frames]
    changed = data[:index] + second + first + data[index + 2 * frames : -4]
    shard.write_bytes(changed + google_crc32c.value(changed[index:]).to_bytes(4, "little"))
    return path


@pytest.fixture
def page(tmp_path: Path) -> Callable[[Path], FlaskClient]:
    """Return a function that returns a client of a page over a store; pictures are shared."""
    kept = Thumbnails(tmp_path / "thumbnails")

    def client(store: Path) -> FlaskClient:
        index = fresh([store], tmp_path / f"{store.name}.sqlite")
        return create_app(index, "", {"localhost"}, thumbnails=kept).test_client()

    return client


def test_a_picture_of_a_forged_store_is_not_shown_for_the_store_that_it_copies(
    honest: Path, forged: Path, page: Callable[[Path], FlaskClient]
) -> None:
    own = thumbnail(Dataset(honest), 0, "front", 0)
    theirs = thumbnail(Dataset(forged), 0, "front", 0)
    assert own != theirs
    assert Dataset(honest).value(0, "checksum") == Dataset(forged).value(0, "checksum")
    assert page(forged).get("/thumb/0/0.jpg").data == theirs
    assert page(honest).get("/thumb/0/0.jpg").data == own
    assert page(forged).get("/thumb/0/0.jpg").data == theirs


def test_a_browser_that_has_a_picture_of_a_forged_store_asks_for_that_of_the_other(
    honest: Path, forged: Path, page: Callable[[Path], FlaskClient]
) -> None:
    answers = [page(store).get("/thumb/0/0.jpg") for store in (forged, honest)]
    tags = [answer.headers["ETag"] for answer in answers]
    assert tags[0] != tags[1]
    versions = [
        page(store).get("/api/episodes").json["rows"][0]["version"] for store in (forged, honest)
    ]
    assert versions[0] != versions[1]


def test_a_clip_of_a_forged_store_has_another_key(
    honest: Path, forged: Path, tmp_path: Path
) -> None:
    keys = []
    for store in (honest, forged):
        opened = OpenStores(fresh([store], tmp_path / f"{store.name}.sqlite").stores).open(0)
        version = opened.version(0)
        wanted = WantedClip(opened=opened, row=0, version=version, camera="front", size="small")
        keys.append(wanted.key)
    assert keys[0] != keys[1]


class TestAnIndexThatCameWithAStore:
    @pytest.fixture
    def index(self, honest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """Return an index that another user built, at another machine's cache."""
        place = tmp_path / "index.sqlite"
        with monkeypatch.context() as patch:
            patch.setenv(VARIABLE, str(tmp_path / "their cache"))
            fresh([honest], place).close()
        return place

    def test_is_refused_when_it_is_named(self, index: Path) -> None:
        with pytest.raises(UsageError, match="was not built by you on this machine"):
            fresh([index])

    def test_is_refused_when_it_is_named_for_its_store(self, index: Path, honest: Path) -> None:
        with pytest.raises(UsageError, match="was not built by you on this machine"):
            fresh([honest], index)

    def test_is_refused_in_the_place_of_one_that_was_built_here(
        self, index: Path, honest: Path, tmp_path: Path
    ) -> None:
        own = tmp_path / "own.sqlite"
        fresh([honest], own).close()
        own.write_bytes(index.read_bytes())  # the same inode, and another token
        with pytest.raises(UsageError, match="was not built by you on this machine"):
            fresh([own])

    def test_is_not_used_for_a_query_of_its_store(self, index: Path, honest: Path) -> None:
        shipped = honest.with_name(f"{honest.name}.index.sqlite")
        shutil.copy(index, shipped)
        before = shipped.read_bytes()
        with fresh([honest]) as built:
            assert built.path != shipped
            assert len(built.ids(Query.parse([]))) == N
        assert shipped.read_bytes() == before


def test_rows_of_a_forged_store_are_not_shown_for_the_store_that_takes_its_place(
    honest: Path,
) -> None:
    """Both have the same times of modification and, written over each other, the same inodes."""
    forged = Path(shutil.copytree(honest, honest.with_name("forged.zarr")))
    successes = Query.parse(["success=true"])
    marker, column = forged / "episodes/status/0", forged / "episodes/success/0"
    column.write_bytes(compress(bytes([1] * N), 1))
    with fresh([forged]) as index:
        assert index.count(successes) == N
    for file in (column, marker):
        times = marker.stat()
        file.write_bytes((honest / file.relative_to(forged)).read_bytes())
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    with fresh([honest]) as index:
        wanted = index.count(successes)
    with fresh([forged]) as index:
        assert index.count(successes) == wanted < N


def test_an_index_in_the_cache_is_removed_when_it_was_not_used_for_a_long_time(
    honest: Path, forged: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    with fresh([honest]) as old, fresh([forged]) as used:
        paths = old.path, used.path
    os.utime(paths[0], (0, 0))
    with fresh([forged]):
        pass
    assert [path.exists() for path in paths] == [False, True]
    kept = {file.stem for file in (tmp_path / "cache/indexes/made_here").iterdir()}
    assert kept == {f"{paths[1].stat().st_dev}-{paths[1].stat().st_ino}"}
