"""The index: that it says what the stores say, now and after they change; and its commands."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_episodes import JOINTS, make_rows, make_spec, small_config
from support.replaced_block import replace_block

from grasp_factory.cli.query import SHOWN
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.schema import STATUS
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import (
    COLUMNS,
    Index,
    Query,
    build,
    database,
    default_path,
    fresh,
    indexed_store,
)
from grasp_factory.dataset.index.columns import OF_STORES, STORED
from grasp_factory.dataset.index.database import APPLICATION_ID
from grasp_factory.dataset.index.words import lighting, scenario
from grasp_factory.dataset.selection import read_selection, selection_lines
from grasp_factory.errors import StoreError, StoreMismatchError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=(16, 16))
N = 18
QUARANTINED = (5, 13)
MISSING_BLOCK = 2
Run = Callable[..., tuple[int, str, str]]
ALL = Query()


def make_store(path: Path, config: FactoryConfig = CONFIG, n: int = N) -> Path:
    """Return a store whose third block is missing, with quarantined rows and a short last block."""
    prepare_store(path, config, JOINTS, n, {})
    for block in set(range(-(-n // config.block_size))) - {MISSING_BLOCK}:
        ZarrWriter(path).write_block(block, make_rows(config, block, n, QUARANTINED))
    return path


def rows_of(index: Index) -> list[dict[str, Any]]:
    page = index.page(ALL, 0, 1000)
    assert len(page.rows) == page.total
    return page.rows


def built(store: Path, place: Path) -> list[dict[str, Any]]:
    """Return the rows of a new index of a store."""
    build([store], place)
    with Index(place) as index:
        return rows_of(index)


def journal_of(index: Path, other: str) -> bytes:
    """Return a journal that SQLite would play back, and that names another file to delete."""
    data, magic = index.read_bytes(), bytes.fromhex("d9d505f920a163d7")
    page, name = int.from_bytes(data[16:18]), other.encode()
    head = magic + struct.pack(">5I", 0, 1, len(data) // page, 512, page)
    end = struct.pack(">I", 0x40000000 // page + 1) + name
    return head.ljust(512, b"\0") + end + struct.pack(">2I", len(name), sum(name)) + magic


def tables_of(file: Path) -> dict[str, list[Any]]:
    """Return what an index holds, but for what says how often it was written."""
    with closing(sqlite3.connect(file)) as connection:
        tables = [
            name
            for (name,) in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")
        ]
        return {
            name: sorted(connection.execute(f"SELECT * FROM {name}").fetchall(), key=repr)
            for name in tables
            if name not in ("facts", "stores")
        }


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store that no test changes."""
    return make_store(tmp_path_factory.mktemp("index") / "plain.zarr")


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path_factory.mktemp("cache")))


@pytest.fixture
def store(plain: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(plain, tmp_path / "store.zarr"))


@pytest.fixture
def index(store: Path) -> Iterator[Index]:
    with fresh([store]) as opened:
        yield opened


class TestRows:
    """What the index says of an episode is what the store says."""

    def test_every_row_that_is_there_is_in_it_once(self, index: Index) -> None:
        missing = range(MISSING_BLOCK * 4, MISSING_BLOCK * 4 + 4)
        places = [(row["store"], row["row"]) for row in rows_of(index)]
        assert places == [(0, row) for row in range(N) if row not in missing]
        (store,) = index.stores
        assert (store.rows, store.committed) == (len(places), len(places) - len(QUARANTINED))

    @pytest.mark.slow
    def test_it_has_every_scalar_column_of_the_store(self, store: Path) -> None:
        known = {column.name for column in COLUMNS}
        scalar = {n for n in Dataset(store).columns if Dataset(store).column(n).ndim == 1}
        assert scalar - known == {"spec", "fingerprint"}

    def test_values_are_the_stores(self, store: Path, index: Index) -> None:
        dataset = Dataset(store)
        compared = 0
        for row in rows_of(index):
            if row["status"] == "quarantined":
                continue
            for name in {*STORED, "checksum"} & set(dataset.columns):
                value = dataset.value(row["row"], name)
                if name == "outcome":
                    value = names(Outcome)[value]
                elif name == "collision_body":
                    continue  # only where there is a collision: below
                elif isinstance(value, np.floating) and np.isnan(value):
                    value = None
                elif value == "" or (name == "quality" and value == 0):
                    value = None
                assert row[name] == value, (row["row"], name)
                compared += 1
        assert compared > 300

    def test_the_touched_body_is_that_of_a_collision(self, store: Path, index: Index) -> None:
        dataset = Dataset(store)
        bodies = dataset.features["episodes/collision_body"]
        for row in rows_of(index):
            body = None
            if row["outcome"] == "collision":
                body = bodies.names[int(dataset.value(row["row"], "collision_body"))]
            assert row["collision_body"] == body

    def test_derived_values(self, store: Path, index: Index) -> None:
        for row in rows_of(index):
            block = row["row"] // CONFIG.block_size
            marker = (store / STATUS.path / str(block)).stat()
            date = datetime.fromtimestamp(int(marker.st_mtime), UTC)
            assert datetime.fromisoformat(row["created_at"]) == date
            files = [
                file
                for file in store.rglob(f"{block}*")
                if file.is_file() and file.name.partition(".")[0] == str(block)
            ]
            rows = min(4, N - 4 * block)
            size = sum(file.stat().st_size for file in files) / rows / 1e6
            assert row["file_size_mb"] == pytest.approx(size, abs=1e-6)
            assert row["extracted_path"] == str(store)
            assert (row["scenario"], row["task_type"]) == ("table/single_object", "grasp")
            assert row["operator"] == row["policy"]
            assert row["lighting"] == "normal/slanted"
            assert row["sensor_setup"]["cameras"]["front"]["resolution"] == [16, 16]
            assert row["sensor_setup"]["record_hz"] == CONFIG.record_hz
            if row["status"] == "committed":
                assert row["duration"] == pytest.approx(row["n_steps"] / CONFIG.record_hz)

    def test_a_quarantined_row_has_its_reason_and_its_recipe(self, index: Index) -> None:
        for number in QUARANTINED:
            row, spec = index.row(0, number), make_spec(CONFIG, number)
            assert row is not None
            assert row["error"] == f"no luck with {number}"
            assert (row["policy"], row["object_id"]) == (spec.policy, spec.objects[0].object_id)
            assert (row["seed"], row["index"]) == (spec.seed, number)
            for name in ("success", "outcome", "lift_height", "data_quality", "checksum"):
                assert row[name] is None
        assert index.row(0, 8) is None
        assert index.row(7, 0) is None

    def test_a_store_from_before_a_column_has_null_in_it(self, store: Path) -> None:
        for name in ("quality", "seed", "index", "force_residual"):
            shutil.rmtree(store / "episodes" / name)
        with fresh([store]) as index:
            rows = rows_of(index)
        assert {row["quality"] for row in rows} == {row["force_residual"] for row in rows} == {None}
        assert [row["index"] for row in rows] == [row["row"] for row in rows]  # the recipe has it

    def test_a_damaged_block_says_so_and_leaves_the_others(self, store: Path) -> None:
        whole = built(store, store.with_name("whole.sqlite"))
        file = store / "episodes" / "policy" / "1"
        file.write_bytes(b"nonsense" + file.read_bytes())
        with fresh([store]) as index:
            rows = rows_of(index)
        assert [row["row"] for row in rows] == [row["row"] for row in whole]
        for row, before in zip(rows, whole, strict=True):
            if 4 <= row["row"] < 8:
                assert "episodes/policy of episodes 4 to 7 cannot be read" in row["error"]
            else:
                assert row | {"file_size_mb": 0} == before | {"file_size_mb": 0}

    def test_many_blocks_are_read_like_few(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        few = built(store, tmp_path / "few.sqlite")
        monkeypatch.setattr(indexed_store, "CHUNK", 1)
        assert built(store, tmp_path / "many.sqlite") == few

    @pytest.mark.parametrize(
        ("ambient", "diffuse", "direction", "word"),
        [
            (0.6, 0.5, (0.33, 0.49, 0.81), "normal/slanted"),
            (0.3, 0.5, (1.0, 0.0, 0.5), "dim/side"),
            (0.8, 0.8, (0.0, 0.1, 1.0), "bright/overhead"),
        ],
    )
    def test_light_has_a_word(
        self, ambient: float, diffuse: float, direction: tuple[float, ...], word: str
    ) -> None:
        light = {"ambient": ambient, "diffuse": diffuse, "direction": direction}
        assert lighting(json.dumps(light)) == word

    @pytest.mark.parametrize("light", ["{", "{}", '{"ambient": "x", "diffuse": 1}'])
    def test_light_that_cannot_be_read_has_none(self, light: str) -> None:
        assert lighting(light) is None

    def test_clutter_is_in_the_scenario(self) -> None:
        assert scenario(small_config(clutter={"count": 5})) == "table/clutter_5"


class TestDerived:
    """The index follows from the store and what people said, whatever happened before."""

    def test_it_is_made_anew_with_equal_rows(self, store: Path) -> None:
        AnnotationLog(store).append("me", [0, 5], [("tag", "odd"), ("quality", 2)])
        place = default_path([store])
        before = built(store, place)
        tables = tables_of(place)
        place.unlink()
        with fresh([store]) as index:
            assert rows_of(index) == before
        assert tables_of(place) == tables

    def test_deleting_it_loses_no_tag(self, store: Path) -> None:
        with fresh([store]) as index:
            said = AnnotationLog(store).append("me", [3], [("tag", "rare"), ("note", "look")])
            index.annotated(0, said)
            assert index.ids(Query.parse(["tags=rare"])) == [(0, 3)]
        default_path([store]).unlink()
        with fresh([store]) as index:
            assert index.ids(Query.parse(["tags=rare", "note=look"])) == [(0, 3)]

    def test_a_history_of_changes_ends_where_a_new_index_begins(
        self, store: Path, tmp_path: Path
    ) -> None:
        place, log, writer = default_path([store]), AnnotationLog(store), ZarrWriter(store)
        with fresh([store]) as index:
            log.append("me", [0, 1, 5], [("tag", "Ünusual"), ("quality", 1)])
            assert index.refresh() == 3
            writer.write_block(MISSING_BLOCK, make_rows(CONFIG, MISSING_BLOCK, N))
            assert index.refresh() == 4
            replace_block(store, 0, make_rows(CONFIG, 0, N, (1,)))  # made again: one has no luck
            assert index.refresh() == 4
            log.append("me", [0], [("untag", "Ünusual"), ("quality", None)])
            log.append("me", [5], [("outcome", "success"), ("note", "see")])
            assert index.refresh() == 2
            (store / STATUS.path / "1").unlink()
            assert index.refresh() == 4
            rows = rows_of(index)
        assert built(store, tmp_path / "new.sqlite") == rows
        assert tables_of(tmp_path / "new.sqlite") == tables_of(place)
        assert [row["row"] for row in rows if row["tags"]] == [1]
        assert rows[1]["status"] == "quarantined"

    def test_a_store_that_grows(self, tmp_path: Path) -> None:
        store = tmp_path / "grows"
        prepare_store(store, CONFIG, JOINTS, 6, {})
        for block in (0, 1):
            ZarrWriter(store).write_block(block, make_rows(CONFIG, block, 6))
        with fresh([store]) as index:
            assert len(rows_of(index)) == 6
            prepare_store(store, CONFIG, JOINTS, 12, {})
            for block in (1, 2):
                ZarrWriter(store).write_block(block, make_rows(CONFIG, block, 12))
            index.refresh()
            rows = rows_of(index)
        assert [row["row"] for row in rows] == list(range(12))
        assert built(store, tmp_path / "new.sqlite") == rows

    def test_another_store_in_the_same_place(self, store: Path) -> None:
        with fresh([store]) as index:
            shutil.rmtree(store)
            make_store(store, small_config(resolution=(16, 16), seed=3, block_size=2), n=6)
            index.refresh()
            rows = rows_of(index)
        assert {row["seed"] for row in rows} == {3}
        assert [row["row"] for row in rows] == [0, 1, 2, 3]

    def test_nothing_is_read_again_when_nothing_has_changed(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(indexed_store, "SETTLED_S", -1.0)
        fresh([store]).close()
        monkeypatch.setattr(
            indexed_store.IndexSource, "rows", lambda *_: pytest.fail("rows are read")
        )
        monkeypatch.setattr(
            indexed_store.IndexSource, "blocks", lambda *_: pytest.fail("blocks are listed")
        )
        with fresh([store]) as index:
            assert index.refresh() == 0

    def test_what_changes_just_after_a_look_is_found(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Two changes within one tick of a file system's clock leave one time of change."""
        assert indexed_store.state_of(store) is None
        monkeypatch.setattr(indexed_store, "SETTLED_S", -1.0)
        assert indexed_store.state_of(store) is not None

    def test_annotations_are_put_down_at_once(self, store: Path, index: Index) -> None:
        log = AnnotationLog(store)
        box = {"id": "0" * 12, "camera": "front", "frame": 0, "shape": "box", "label": "x"}
        said = log.append(
            "me", [2], [("tag", "b"), ("tag", "a"), ("mark", box | {"pixels": [1, 1, 2, 2]})]
        )
        index.annotated(0, said)
        row = index.row(0, 2)
        assert row is not None
        assert (row["tags"], row["marks"], row["note"]) == (["a", "b"], 1, None)
        assert index.refresh() == 0
        said = log.append("me", [2], [("untag", "a"), ("untag", "b"), ("unmark", "0" * 12)])
        index.annotated(0, said)
        assert index.row(0, 2) == row | {"tags": [], "marks": None}
        assert index.words("tags") == []

    def test_a_query_that_is_remembered_sees_a_new_tag(self, store: Path, index: Index) -> None:
        query = Query.parse(["tags=odd"])
        assert index.ids(query) == []
        index.annotated(0, AnnotationLog(store).append("me", [2], [("tag", "odd")]))
        assert index.ids(query) == [(0, 2)]
        assert index.page(query).total == 1

    def test_a_persons_quality_comes_before_the_stores(self, store: Path, index: Index) -> None:
        row = index.row(0, 0)
        assert row is not None
        assert row["data_quality"] == row["quality"]
        said = AnnotationLog(store).append("me", [0], [("quality", 3), ("outcome", "unstable")])
        index.annotated(0, said)
        assert index.row(0, 0) == row | {
            "data_quality": 3,
            "corrected_outcome": "unstable",
            "marks": 0,
        }


class TestFile:
    """The file: where it is, what it may replace, what becomes of it."""

    def test_several_stores(self, store: Path, plain: Path, tmp_path: Path) -> None:
        result = build([store, plain], tmp_path / "both.sqlite")
        assert result.rows == 28
        with fresh([tmp_path / "both.sqlite"]) as index:
            assert [s.path for s in index.stores] == [store, plain]
            assert [s.name for s in index.stores] == ["store.zarr", "plain.zarr"]
            found = index.ids(Query.parse(["row=[0,17]"], "-row,extracted_path"))
            order = sorted([0, 1], key=lambda k: str([store, plain][k]))
            assert found == [(k, 17) for k in order] + [(k, 0) for k in order]
            assert index.count(Query.parse([f"extracted_path={plain}"])) == 14
        for name in OF_STORES:
            assert name in {column.name for column in COLUMNS}

    def test_several_stores_have_a_place_in_the_cache(
        self, store: Path, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("GRASP_FACTORY_CACHE", str(tmp_path / "cache"))
        with fresh([store, plain]) as first, fresh([store, plain]) as again:
            assert first.path == again.path
            assert tmp_path / "cache" in first.path.parents
            assert len(rows_of(again)) == 28

    @pytest.mark.parametrize("content", [b"", b"some text", b"SQLite format 3\0" + bytes(200)])
    def test_a_file_that_is_no_index_is_left_alone(self, store: Path, content: bytes) -> None:
        place = default_path([store])
        place.write_bytes(content)
        for make in (lambda: fresh([store]), lambda: build([store], place), lambda: Index(place)):
            with pytest.raises(UsageError, match="is no index of grasp-factory"):
                make()
        assert place.read_bytes() == content
        assert not list(place.parent.glob(".*"))

    def test_somebodys_database_is_left_alone(self, store: Path) -> None:
        place = default_path([store])
        with closing(sqlite3.connect(place)) as other:
            other.execute("CREATE TABLE precious (x)")
        with pytest.raises(UsageError, match="is no index of grasp-factory"):
            fresh([store])
        assert place.stat().st_size > 0

    def test_an_index_of_another_version_is_made_anew(self, store: Path) -> None:
        expected = built(store, default_path([store]))
        with closing(sqlite3.connect(default_path([store]))) as old:
            old.execute("DROP TABLE episodes")
            old.execute("PRAGMA user_version = 99")
            assert old.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
        with pytest.raises(UsageError, match=r"another version .*: make|index STORE\.\.\. --out"):
            fresh([default_path([store])])
        with fresh([store]) as index:
            assert rows_of(index) == expected

    def test_a_damaged_index_is_made_anew_or_says_what_to_do(self, store: Path) -> None:
        place = default_path([store])
        build([store], place)
        with fresh([store]) as index:
            expected = rows_of(index)
        data = bytearray(place.read_bytes())
        data[4096:] = b"\xaa" * (len(data) - 4096)
        place.write_bytes(data)
        with pytest.raises(StoreError, match=r"is damaged: .*; delete it"):
            fresh([place])
        with fresh([store]) as index:
            assert rows_of(index) == expected

    def test_a_store_that_has_moved(self, store: Path, tmp_path: Path) -> None:
        build([store], tmp_path / "i.sqlite")
        fresh([store]).close()
        moved = tmp_path / "moved.zarr"
        store.rename(moved)
        default_path([store]).rename(default_path([moved]))
        with pytest.raises(StoreError, match=r"there is no store at .*store\.zarr any more"):
            fresh([tmp_path / "i.sqlite"])
        with fresh([moved]) as index:
            assert {row["extracted_path"] for row in rows_of(index)} == {str(moved)}

    def test_an_index_of_other_stores_is_not_replaced_unasked(
        self, store: Path, plain: Path, tmp_path: Path
    ) -> None:
        place = tmp_path / "i.sqlite"
        build([plain], place)
        with pytest.raises(UsageError, match=r"is the index of .*plain\.zarr"):
            fresh([store], place)
        build([store], place)
        with fresh([store], place) as index:
            assert index.stores[0].path == store

    @pytest.mark.parametrize("where", ["nowhere/i.sqlite", "file/i.sqlite", "store.zarr/i.sqlite"])
    def test_a_place_that_cannot_be_written(self, store: Path, where: str) -> None:
        (store.parent / "file").touch()
        with pytest.raises(UsageError, match=r"--index FILE|lie in the store"):
            fresh([store], store.parent / where)
        assert not (store / "i.sqlite").exists()

    @pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
    def test_a_folder_that_cannot_be_written(self, store: Path) -> None:
        fresh([store]).close()
        store.parent.chmod(0o500)
        default_path([store]).chmod(0o400)
        try:
            with fresh([store]) as index:
                assert len(rows_of(index)) == 14
            default_path([store]).chmod(0o600)
            with pytest.raises(UsageError, match="--index FILE"):
                build([store], default_path([store]))
        finally:
            store.parent.chmod(0o700)

    def test_an_index_that_nobody_may_write_is_used_while_it_holds(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        fresh([store]).close()

        def refuse(*_: object) -> None:
            raise UsageError("index cannot be written; --index FILE")

        monkeypatch.setattr("grasp_factory.dataset.index.handle.writing", refuse)
        with fresh([store]) as index:  # it looks again, for the store is new
            assert len(rows_of(index)) == 14
        ZarrWriter(store).write_block(MISSING_BLOCK, make_rows(CONFIG, MISSING_BLOCK, N))
        with pytest.raises(UsageError, match="--index FILE"):
            fresh([store])

    def test_what_is_no_store(self, tmp_path: Path) -> None:
        (tmp_path / "folder").mkdir()
        for path in (tmp_path / "folder", tmp_path / "none"):
            with pytest.raises(StoreMismatchError):
                fresh([path])
        with pytest.raises(UsageError, match="no store is named"):
            fresh([])
        assert [path.name for path in tmp_path.iterdir()] == ["folder"]

    def test_a_store_is_not_indexed_twice(self, store: Path) -> None:
        place = store.with_name("i.sqlite")
        (link := store.with_name("link.zarr")).symlink_to(store)
        for again in (store, link, store / ".." / store.name):
            with pytest.raises(UsageError, match="each once"):
                build([store, again], place)
            with pytest.raises(UsageError, match="each once"):
                fresh([store, again], place)

    def test_no_way_to_name_a_store_puts_an_index_into_it(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(store / "episodes")
        before = sorted(store.rglob("*"))
        with fresh([Path("..")]) as index:
            assert index.path == default_path([store])
        with pytest.raises(UsageError, match="it would lie in the store"):
            build([store], Path("../../" + store.name + "/i.sqlite"))
        assert sorted(store.rglob("*")) == before

    def test_a_store_whose_name_is_no_text_is_refused(self, store: Path) -> None:
        odd = store.rename(store.with_name("odd\udcff.zarr"))
        with pytest.raises(UsageError, match="is not UTF-8; rename it"):
            fresh([odd])

    def test_a_build_that_fails_leaves_the_old_one(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        place = default_path([store])
        before = built(store, place)

        def stop(row: int) -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            build([store], place, on_row=stop)
        assert not list(place.parent.glob(".*"))
        with Index(place) as index:
            assert rows_of(index) == before

    def test_a_build_that_ends_keeps_the_file_of_another_that_begins(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        move = database.move_into_place

        def move_and_begin(partial: Path, file: Path, **options: bool) -> None:
            move(partial, file, **options)
            partial.write_bytes(b"another build")

        monkeypatch.setattr(database, "move_into_place", move_and_begin)
        place = default_path([store])
        build([store], place)
        assert [file.read_bytes() for file in place.parent.glob(".*")] == [b"another build"]

    def test_an_index_that_a_killed_process_was_changing_is_built_again(self, store: Path) -> None:
        place = default_path([store])
        before = built(store, place)
        code = (
            "import os, sys; from pathlib import Path;"
            "from grasp_factory.dataset.index import database;"
            "change = database.writing(Path(sys.argv[1])); c = change.__enter__();"
            "c.execute('DELETE FROM episodes'); os._exit(9)"
        )
        assert subprocess.run([sys.executable, "-c", code, place], check=False).returncode == 9
        assert [file.name for file in place.parent.glob("*.sqlite*")] == [place.name]
        inode = place.stat().st_ino
        with fresh([store]) as index:
            assert rows_of(index) == before
        assert place.stat().st_ino != inode

    @pytest.mark.parametrize("is_named", [True, False])
    def test_a_journal_that_somebody_put_beside_it_is_not_played_back(
        self, store: Path, tmp_path: Path, is_named: bool
    ) -> None:
        place = tmp_path / "index.sqlite" if is_named else default_path([store])
        before = built(store, place)
        (tmp_path / "precious").write_text("mine")
        journal = journal_of(place, str(tmp_path / "precious"))
        place.with_name(f"{place.name}-journal").write_bytes(journal)
        if is_named:
            with pytest.raises(UsageError, match="was not built by you"):
                fresh([store], place)
            build([store], place)
        with fresh([store], place if is_named else None) as index:
            assert rows_of(index) == before
        assert (tmp_path / "precious").read_text() == "mine"
        assert not place.with_name(f"{place.name}-journal").exists()

    @pytest.mark.parametrize("name", ["index.sqlite", ".index.sqlite.building"])
    def test_a_second_name_of_another_file_is_not_written_to(
        self, store: Path, tmp_path: Path, name: str
    ) -> None:
        (tmp_path / "precious").write_text("mine")
        (tmp_path / name).hardlink_to(tmp_path / "precious")
        with pytest.raises((UsageError, StoreError), match=r"index\.sqlite"):
            build([store], tmp_path / "index.sqlite")
        assert (tmp_path / "precious").read_text() == "mine"


class TestSharing:
    """Several threads and processes at one index."""

    @pytest.mark.slow
    def test_readers_go_on_while_it_is_brought_up_to_date(self, store: Path) -> None:
        log, stop, faults = AnnotationLog(store), threading.Event(), []

        def read(index: Index) -> int:
            count = 0
            while not stop.is_set():
                page = index.page(Query.parse([], "-lift_height"), 0, 5)
                if page.total not in (14, 18) or len(page.rows) != 5:
                    faults.append(page)
                index.neighbours(Query.parse(["success=true"]), 0, 3)
                count += 1
            return count

        with fresh([store]) as index, ThreadPoolExecutor(3) as pool:
            reading = [pool.submit(read, index) for _ in range(3)]
            try:
                for number in range(15):
                    log.append("me", [number % 4], [("tag", f"t{number}")])
                    assert index.refresh() == 1
                ZarrWriter(store).write_block(MISSING_BLOCK, make_rows(CONFIG, MISSING_BLOCK, N))
                assert index.refresh() == 4
            finally:
                stop.set()
            assert all(done.result() > 0 for done in reading)
            assert faults == []
            assert index.count(ALL) == 18

    @pytest.mark.slow
    def test_processes_that_open_it_at_once(self, store: Path) -> None:
        code = (
            "import sys; from pathlib import Path;"
            "from grasp_factory.dataset.index import Query, fresh;"
            "print(fresh([Path(sys.argv[1])]).count(Query()))"
        )
        command = [sys.executable, "-c", code, str(store)]
        running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
        assert [process.communicate()[0] for process in running] == ["14\n"] * 3
        assert not list(store.parent.glob(".*"))

    def test_an_index_that_is_made_anew_is_taken_up(self, store: Path) -> None:
        with fresh([store]) as index:
            assert index.count(ALL) == 14
            ZarrWriter(store).write_block(MISSING_BLOCK, make_rows(CONFIG, MISSING_BLOCK, N))
            build([store], index.path)
            assert index.count(ALL) == 18

    def test_an_index_that_is_gone(self, store: Path) -> None:
        with fresh([store]) as index:
            index.path.unlink()
            with pytest.raises(StoreError, match="there is no index at"):
                index.count(ALL)


class TestSelection:
    """Lists of episodes."""

    def read(self, text: str, store: Path) -> list[int]:
        file = io.StringIO(text)
        file.name = "ids.txt"
        return read_selection(file, store)

    def test_rows_in_the_order_of_the_file(self, tmp_path: Path) -> None:
        assert self.read("7\n\n 0 \n3\n", tmp_path) == [7, 0, 3]
        assert self.read("", tmp_path) == []

    def test_lines_of_other_stores_are_left_out_and_counted(self, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to(tmp_path)
        text = f"{tmp_path}:3\n/other:store:4\n{tmp_path / 'link'}:5\n6\n/other:store:7\n"
        with pytest.warns(match="2 of 5 lines are of other stores"):
            assert self.read(text, tmp_path) == [3, 5, 6]

    def test_a_list_of_other_stores_alone_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(
            UsageError, match=r"2 of 2 lines are of other stores, none of .*'/other'"
        ):
            self.read("/other:4\n/other:5", tmp_path)

    @pytest.mark.parametrize("line", ["x y", "-1", ":4", "a:", "a:b", "1.5", "9" * 10, "٣", "\0"])
    def test_what_is_no_episode_is_refused(self, line: str, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"--ids ids\.txt: line 2: got .*, valid: one episode"):
            self.read(f"1\n{line}\n", tmp_path)

    def test_a_file_without_an_end_is_refused(self, tmp_path: Path) -> None:
        with open("/dev/zero") as file, pytest.raises(UsageError, match="/dev/zero: line 1: got"):
            read_selection(file, tmp_path)

    def test_what_is_printed_is_read_again(self, tmp_path: Path) -> None:
        for named in (True, False):
            lines = selection_lines([(tmp_path, 3), (tmp_path, 1)], named=named)
            assert self.read("\n".join(lines), tmp_path) == [3, 1]


class TestCommands:
    """``grasp-factory index`` and ``query``."""

    def test_index_says_what_it_made(self, run: Run, store: Path, tmp_path: Path) -> None:
        code, out, err = run("index", store)
        assert (code, err) == (0, "")
        assert out.startswith(f"{default_path([store])}: 14 rows of 1 store in ")
        code, out, err = run("index", store, "--out", tmp_path / "i.sqlite", "--json")
        made = json.loads(out)
        assert (made["rows"], made["path"]) == (14, str(tmp_path / "i.sqlite"))
        assert made["bytes"] == (tmp_path / "i.sqlite").stat().st_size

    def test_a_table_and_how_many_there_are(self, run: Run, store: Path) -> None:
        code, out, err = run("query", store, "--where", "status=committed", "--limit", "3")
        assert (code, err) == (0, "12 episodes, 3 shown\n")
        head, *lines = out.splitlines()
        assert head.split()[:3] == ["row", "outcome", "object_id"]
        assert [line.split()[0] for line in lines] == ["0", "1", "2"]

    def test_the_table_has_the_columns_that_are_asked_for(self, run: Run, store: Path) -> None:
        words = ("--where", "slip_distance!=null", "--where", "policy!=null", "--sort=-object_mass")
        _, out, _ = run("query", store, *words)
        head = out.splitlines()[0].split()
        assert head == [*SHOWN[:-1], "slip_distance", "object_mass", SHOWN[-1]]
        _, out, _ = run("query", store, *words, "--columns", "row")
        assert out.splitlines()[0] == "row"

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["policy=topdown"], "no row has policy 'topdown'; did you mean 'top_down'? (valid: "),
            (["policy=[uniform,topdown]"], "no row has policy 'topdown'; did you mean 'top_down'?"),
            (["split=val,test"], "unknown split 'val,test'; for any of several: [val,test] (valid"),
            (
                ["split=val", "row>2", "split=[test,train]"],
                "split='val' and split='test,train': no row has both, valid: split=[val,test,train]"
                " for any of them",
            ),
            (["row=1", "row=2"], "row='1' and row='2': no row has both, valid: row=[1,2] for any"),
            (["row>5", "row<3", "row<9"], "row>5 and row<3: no number is both"),
            (
                ["lift_height=(0.1, 0.2)"],
                "lift_height=: got '(0.1, 0.2)', valid: a number; for a range two conditions:"
                " 'lift_height>=0.1' 'lift_height<=0.2'",
            ),
            (["lift>0"], "unknown column 'lift'; did you mean 'lift_height'? (valid: "),
        ],
    )
    @pytest.mark.parametrize("output", [[], ["--ids"], ["--count"]], ids=str)
    def test_what_no_row_can_fulfil_is_an_error(
        self, run: Run, store: Path, words: list[str], message: str, output: list[str]
    ) -> None:
        conditions = [part for word in words for part in ("--where", word)]
        code, out, err = run("query", store, *conditions, *output)
        assert (code, out) == (2, "")
        assert err.startswith(f"Error: {message}")
        assert err.count("\n") == 1

    @pytest.mark.parametrize(
        "words",
        [
            ["policy!=topdown"],
            ["policy~topdown"],
            ["split=[val,test]", "split=[test,train]"],
            ["tags=odd", "tags=rare"],
            ["created_at=2026", "created_at=2026-03"],
            ["policy=null"],
        ],
        ids=str,
    )
    def test_what_a_row_could_fulfil_is_none(self, run: Run, store: Path, words: list[str]) -> None:
        conditions = [part for word in words for part in ("--where", word)]
        assert run("query", store, *conditions)[0] == 0

    def test_the_table_of_several_stores_says_which_is_which(
        self, run: Run, store: Path, plain: Path, tmp_path: Path
    ) -> None:
        for number, paths in enumerate([(store, plain), (plain, store)]):
            place = tmp_path / f"{number}.sqlite"
            code, _, err = run("query", *paths, "--limit", "1", "--index", place)
            assert (code, err.splitlines()[:2]) == (0, [f"store {k}: {paths[k]}" for k in (0, 1)])

    def test_a_list_cannot_name_a_store_over_two_lines(
        self, run: Run, store: Path, plain: Path, tmp_path: Path
    ) -> None:
        odd = store.rename(store.with_name("a\nb.zarr"))
        code, out, err = run("query", odd, plain, "--ids", "--index", tmp_path / "i.sqlite")
        assert (code, out) == (2, "")
        assert "a list names stores by line; rename it" in err

    def test_the_columns_are_told_without_a_store(self, run: Run) -> None:
        code, out, _ = run("query", "--where", "help")
        assert code == 0
        assert "lift_height" in out

    def test_ids_are_a_selection(self, run: Run, store: Path, tmp_path: Path) -> None:
        code, out, err = run("query", store, "--where", "success=false", "--ids", "--sort=-row")
        assert (code, err) == (0, "")
        rows = [int(line) for line in out.split()]
        assert sorted(rows) == Dataset(store).where(success=False).indices.tolist()
        assert rows == sorted(rows, reverse=True)
        (tmp_path / "ids.txt").write_text(out)
        code, out, err = run("split", store, tmp_path / "out", "--ids", tmp_path / "ids.txt")
        assert code == 0, err
        assert not Dataset(tmp_path / "out").column("success").any()

    def test_rows_without_an_episode_in_a_list_are_left_out(
        self, run: Run, store: Path, tmp_path: Path
    ) -> None:
        _, out, _ = run("query", store, "--ids")
        (tmp_path / "ids.txt").write_text(out)
        code, _, err = run("split", store, tmp_path / "out", "--ids", tmp_path / "ids.txt")
        committed = Dataset(store).committed
        lost = len(out.split()) - len(committed)
        assert lost > 0
        said = (
            f"--ids: {lost} of {len(out.split())} rows of {store} have no episode and are left out"
        )
        assert (code, err.count(said)) == (0, 1)
        assert len(Dataset(tmp_path / "out")) == len(committed)
        code, _, err = run("sheet", store, tmp_path / "s.png", "--ids", tmp_path / "ids.txt")
        assert (code, err.count(said)) == (0, 1)
        _, out, _ = run("query", store, "--ids", "--where", "status=quarantined")
        (tmp_path / "ids.txt").write_text(out)
        code, _, err = run("split", store, tmp_path / "none", "--ids", tmp_path / "ids.txt")
        assert (code, err.count("have no episode: nothing is left")) == (2, 1)

    def test_ids_of_several_stores_name_them(
        self, run: Run, store: Path, plain: Path, tmp_path: Path
    ) -> None:
        place = tmp_path / "i.sqlite"
        _, out, _ = run("query", store, plain, "--index", place, "--ids", "--where", "row=[1,3]")
        assert out.splitlines() == [f"{p}:{row}" for p in (store, plain) for row in (1, 3)]
        (tmp_path / "ids.txt").write_text(out)
        code, _, err = run("split", plain, tmp_path / "out", "--ids", tmp_path / "ids.txt")
        assert (code, err.count("2 of 4 lines are of other stores")) == (0, 1)
        assert len(Dataset(tmp_path / "out")) == 2

    def test_json_has_rows_and_how_many_there_are(self, run: Run, store: Path) -> None:
        _, out, _ = run("query", store, "--json", "--offset", "2", "--limit", "2")
        found = json.loads(out)
        assert found["total"] == 14
        assert [row["row"] for row in found["rows"]] == [2, 3]
        assert list(found["rows"][0]) == [column.name for column in COLUMNS]
        _, out, _ = run("query", store, "--json", "--columns", "row, tags", "--limit", "1")
        assert json.loads(out)["rows"] == [{"row": 0, "tags": []}]

    def test_csv_has_a_line_for_each(self, run: Run, store: Path) -> None:
        AnnotationLog(store).append("me", [1], [("tag", "a b"), ("note", 'say "x",\nthen y')])
        _, out, _ = run("query", store, "--csv")
        rows = list(csv.DictReader(io.StringIO(out)))
        assert len(rows) == 14
        assert (rows[1]["note"], json.loads(rows[1]["tags"])) == ('say "x",\nthen y', ["a b"])
        assert (rows[0]["note"], rows[0]["tags"]) == ("", "")
        assert rows[0]["success"] in ("true", "false")
        assert json.loads(rows[0]["sensor_setup"])["record_hz"] == CONFIG.record_hz

    def test_a_count(self, run: Run, store: Path) -> None:
        assert run("query", store, "--count", "--where", "row<4") == (0, "4\n", "")

    def test_nothing_found(self, run: Run, store: Path) -> None:
        assert run("query", store, "--where", "row<0") == (0, "", "0 episodes\n")
        assert run("query", store, "--where", "row<0", "--ids") == (0, "", "")

    def test_pages_of_output_are_joined(
        self, run: Run, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        whole = run("query", store, "--csv", "--sort", "lift_height")
        monkeypatch.setattr("grasp_factory.cli.query.PAGE", 3)
        assert run("query", store, "--csv", "--sort", "lift_height") == whole

    def test_help_lists_the_columns(self, run: Run) -> None:
        code, out, _ = run("query", "anything", "--where", "help")
        assert code == 0
        assert [column.name for column in COLUMNS if f"\n{column.name} " not in out] == []

    def test_text_of_people_cannot_steer_a_terminal(self, run: Run, store: Path) -> None:
        AnnotationLog(store).append("me", [0], [("note", "one\ntwo")])
        _, out, _ = run("query", store, "--columns", "row,note", "--where", "note!=null")
        assert out.splitlines() == ["row  note", "  0  one two"]

    @pytest.mark.parametrize(
        ("args", "message"),
        [
            (("--where", "lift=3"), "unknown column 'lift'"),
            (("--where", "row"), "condition 'row': valid: COLUMN=VALUE"),
            (("--sort", "nope"), "unknown column 'nope'"),
            (("--columns", "row,polcy"), "unknown column 'polcy'; did you mean 'policy'?"),
            (
                ("--json", "--csv"),
                "--json, --csv, --ids and --count: got several, valid: one of them",
            ),
            (("--limit", "-1"), "Invalid value for '--limit'"),
            (("--index", "/nowhere/i.sqlite"), "cannot be written: No such file"),
        ],
    )
    def test_mistakes_are_one_line(
        self, run: Run, store: Path, args: tuple[str, ...], message: str
    ) -> None:
        code, out, err = run("query", store, *args)
        assert (code, out) == (2, "")
        assert message in err
        assert err.count("\n") == 1
