"""Snapshots of a store: what changed since then, episode by episode, and nothing is believed."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_episode, make_spec, small_config
from support.helpers import tree
from support.places import TINY
from support.stored import old_store

from grasp_factory.cli.main import cli
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation.merge import merge, split
from grasp_factory.curation.verify import verify
from grasp_factory.curation.versions import check_snapshot, compare, take_snapshot
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.snapshots import (
    PresentVersion,
    SnapshotFolder,
    StoreContents,
    StoredVersion,
    open_version,
    segments,
)
from grasp_factory.errors import (
    GraspFactoryError,
    IrregularFileError,
    LimitError,
    StoreBusyError,
    StoreError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.label_columns import write_label
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=[16, 16])
OTHER = replace(CONFIG, seed=5)


@pytest.fixture(autouse=True)
def small_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segments, "ROWS", 4)
    monkeypatch.setenv("GRASP_FACTORY_USER", "ann")


def rows_of(config: Any, block: int, n: int, bad: tuple[int, ...]) -> list[Any]:
    """Return the rows of a block."""
    return [row_of(config.seed, i, i in bad) for i in range(n)[block * 4 : block * 4 + 4]]


@cache  # making rows takes longer than writing them
def row_of(seed: int, index: int, is_bad: bool) -> Any:
    config = replace(CONFIG, seed=seed)
    if is_bad:
        return Quarantined(make_spec(config, index), "no luck")
    return make_episode(config, index, n_steps=3)


def make_store(path: Path, n: int = 10, bad: tuple[int, ...] = (5,), config: Any = CONFIG) -> Path:
    """Make a store, or grow it, of fake episodes."""
    prepare_store(path, config, JOINTS, n, {})
    for block in range(-(-n // config.block_size)):
        ZarrWriter(path).write_block(block, rows_of(config, block, n, bad))
    return path


def rewrite(path: Path, row: int, change: Callable[[Any], Any]) -> None:
    """Write a block again, in which one row is another one."""
    writer = ZarrWriter(path)
    block = row // writer.block_size
    rows = rows_of(CONFIG, block, writer.length, (5,))
    rows[row % writer.block_size] = change(rows[row % writer.block_size])
    for file in path.rglob(f"{block}*"):  # as if another program had made it
        if file.name.split(".")[0] == str(block) and "status" in str(file):
            file.unlink()
    writer.write_block(block, rows)


def with_other_mass(episode: Any) -> Any:
    return replace(episode, columns=episode.columns | {"lift_height": 0.777})


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_store(tmp_path_factory.mktemp("made") / "s.zarr")


@pytest.fixture
def store(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "s.zarr"))


def by_recipe(path: Path) -> dict[tuple[int, int], tuple[int, str]]:
    """Return status and checksum of each present row by seed and index, one row at a time."""
    dataset = Dataset(path)
    columns = [dataset.column(name) for name in ("status", "seed", "index", "checksum")]
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return {(seed, index): (status, text) for status, seed, index, text in rows if status}


def brute_force(a: Path, b: Path) -> dict[str, set[tuple[int, int]]]:
    left, right = by_recipe(a), by_recipe(b)
    return {
        "added": set(right) - set(left),
        "removed": set(left) - set(right),
        "changed": {key for key in set(left) & set(right) if left[key] != right[key]},
    }


def found(a: Path | str, b: Path | str) -> dict[str, set[tuple[int, int]]]:
    difference = compare(open_version(str(a)), open_version(str(b)))
    words = ("added", "removed", "changed")
    return {w: {(s, i) for _, s, i in getattr(difference, w).tolist()} for w in words}


class TestTaking:
    def test_leaves_the_store_as_it_is(self, store: Path) -> None:
        before = tree(store)
        take_snapshot(store, "first")
        assert tree(store) == before

    def test_the_id_is_the_hash_of_the_file(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        file = store.with_name("s.zarr.snapshots") / f"{taken.id}.json"
        done = subprocess.run(["sha256sum", file], capture_output=True, text=True, check=True)
        assert done.stdout.split()[0] == taken.id

    def test_records_counts_config_and_who(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        snapshot = SnapshotFolder.of(store).read(taken.id)
        assert (snapshot.contents.rows, snapshot.contents.committed) == (10, 9)
        assert snapshot.contents.quarantined == 1
        assert snapshot.contents.attributes["config_sha256"] == CONFIG.sha256()
        assert (snapshot.who, snapshot.message, snapshot.parent) == ("ann", "first", None)

    def test_an_unchanged_store_gets_no_second_one(self, store: Path) -> None:
        first = take_snapshot(store, "first")
        before = tree(store.with_name("s.zarr.snapshots"))
        again = take_snapshot(store, "again")
        assert (again.id, again.is_new) == (first.id, False)
        assert tree(store.with_name("s.zarr.snapshots")) == before

    def test_growing_writes_only_the_new_segments(self, store: Path) -> None:
        first = take_snapshot(store, "first")
        folder = store.with_name("s.zarr.snapshots")
        before = tree(folder)
        make_store(store, 18)
        second = take_snapshot(store, "second")
        after = tree(folder)
        assert second.parent == first.id
        assert before.items() <= after.items()
        new = {name for name in after if name not in before}
        assert len([name for name in new if name.endswith(".rows")]) == 3

    def test_equal_stores_have_equal_contents(self, store: Path, tmp_path: Path) -> None:
        other = shutil.copytree(store, tmp_path / "t.zarr")
        taken = [take_snapshot(path, "first") for path in (store, other)]
        assert taken[0].contents_sha256 == taken[1].contents_sha256

    def test_a_commit_of_git_is_recorded(
        self, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        here = tmp_path / "project"
        here.mkdir()
        monkeypatch.chdir(here)
        names = ("-c", "user.name=a", "-c", "user.email=a@b.example")
        for line in (("init", "-q"), (*names, "commit", "-q", "--allow-empty", "-m", "x")):
            subprocess.run(["git", *line], check=True)
        taken = take_snapshot(store, "first")
        head = subprocess.run(
            ["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=True
        )
        assert SnapshotFolder.of(store).read(taken.id).revision == head.stdout.strip()

    @pytest.mark.parametrize("message", ["", "  ", "x" * 4001, "a\x1b[2Jb"])
    def test_a_message_is_printable_text(self, store: Path, message: str) -> None:
        with pytest.raises(UsageError, match="-m: valid: a text"):
            take_snapshot(store, message)

    def test_a_store_that_is_written_to_is_refused(self, store: Path) -> None:
        with StoreLock(store), pytest.raises(StoreBusyError):
            take_snapshot(store, "first")
        assert not store.with_name("s.zarr.snapshots").exists()

    def test_what_is_no_store_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(StoreMismatchError):
            take_snapshot(tmp_path / "none.zarr", "first")

    def test_a_damaged_checksum_is_named(self, store: Path) -> None:
        (store / "episodes/checksum/1").write_bytes(b"\x28\xb5\x2f\xfdrubbish")
        with pytest.raises(StoreError, match="checksum"):
            take_snapshot(store, "first")

    def test_a_link_in_place_of_the_folder_is_not_followed(
        self, store: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "home").mkdir()
        store.with_name("s.zarr.snapshots").symlink_to(tmp_path / "home")
        with pytest.raises(IrregularFileError):
            take_snapshot(store, "first")
        assert list((tmp_path / "home").iterdir()) == []

    def test_links_to_a_store_lead_to_its_snapshots(self, store: Path, tmp_path: Path) -> None:
        (tmp_path / "link.zarr").symlink_to(store)
        taken = take_snapshot(tmp_path / "link.zarr", "first")
        assert SnapshotFolder.of(store).ids() == [taken.id]

    def test_a_killed_writers_leftover_is_removed(self, store: Path) -> None:
        folder = store.with_name("s.zarr.snapshots") / "segments"
        folder.mkdir(parents=True)
        (folder / "abc.rows.partial").write_bytes(b"half")
        take_snapshot(store, "first")
        assert not list(folder.glob("*.partial"))


class TestIds:
    def test_a_unique_prefix_is_enough(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        assert SnapshotFolder.of(store).resolve(taken.id[:6]) == taken.id

    @pytest.mark.parametrize("prefix", ["abc", "XYZW", "../..", "", "g" * 10])
    def test_what_is_no_prefix_is_refused(self, store: Path, prefix: str) -> None:
        take_snapshot(store, "first")
        with pytest.raises(UsageError, match=r"snapshot .*: valid: 4 or more"):
            SnapshotFolder.of(store).resolve(prefix)

    def test_an_unknown_one_lists_the_known(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        other = "0000" if not taken.id.startswith("0000") else "ffff"
        with pytest.raises(UsageError, match=taken.id[:12]):
            SnapshotFolder.of(store).resolve(other)

    def test_an_ambiguous_one_is_refused(self, store: Path) -> None:
        folder = store.with_name("s.zarr.snapshots")
        folder.mkdir()
        for end in "01":
            (folder / f"{'ab' * 31}0{end}.json").write_text("{}")
        with pytest.raises(UsageError, match="several begin with it"):
            SnapshotFolder.of(store).resolve("abab")


class TestStrangers:
    """A folder of snapshots may come from anybody."""

    def taken(self, store: Path) -> Path:
        return store.with_name("s.zarr.snapshots") / f"{take_snapshot(store, 'first').id}.json"

    def test_a_forged_record_is_refused(self, store: Path) -> None:
        file = self.taken(store)
        file.write_bytes(file.read_bytes().replace(b'"first"', b'"other"'))
        with pytest.raises(StoreError, match="not the one that its name states"):
            SnapshotFolder.of(store).history()

    def test_a_forged_segment_is_refused(self, store: Path) -> None:
        file = self.taken(store)
        for segment in (file.parent / "segments").iterdir():
            data = bytearray(segment.read_bytes())
            data[-1] ^= 1
            segment.write_bytes(data)
        rewrite(store, 2, with_other_mass)
        with pytest.raises(StoreError, match="not the one that its name states"):
            found(f"{store}@{file.name[:8]}", store)

    def test_a_missing_segment_is_named(self, store: Path) -> None:
        file = self.taken(store)
        shutil.rmtree(file.parent / "segments")
        rewrite(store, 2, with_other_mass)
        with pytest.raises(StoreError, match="cannot be read: No such file"):
            found(f"{store}@{file.name[:8]}", store)

    @pytest.mark.parametrize("what", ["link", "pipe", "folder"])
    def test_only_regular_files_are_read(self, store: Path, tmp_path: Path, what: str) -> None:
        file = self.taken(store)
        content = file.read_bytes()
        file.unlink()
        if what == "link":
            (tmp_path / "elsewhere").write_bytes(content)
            file.symlink_to(tmp_path / "elsewhere")
        elif what == "pipe":
            os.mkfifo(file)
        else:
            file.mkdir()
        with pytest.raises(StoreError):
            SnapshotFolder.of(store).history()

    def test_a_huge_file_is_not_read(self, store: Path) -> None:
        file = self.taken(store)
        with file.open("wb") as opened:
            opened.truncate(2**40)
        with pytest.raises(LimitError, match="raise the limit"):
            SnapshotFolder.of(store).history()

    def test_that_are_large_together_are_refused_unread(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first = self.taken(store)
        monkeypatch.setattr(SnapshotFolder, "read", lambda self, name: pytest.fail("read"))
        for k in range(7):
            file = first.with_name(f"{k:064x}.json")
            file.touch()
            os.truncate(file, 4 * 2**20)
        with pytest.raises(LimitError, match=r"snapshots with a size of .*, valid: up to 25\.2 MB"):
            SnapshotFolder.of(store).history()

    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("rows", 10**9),
            ("rows", -1),
            ("committed", 11),
            ("arrays", ["a", "a"]),
            ("segments", ["../../etc/passwd"] * 3),
            ("digests", []),
            ("labels", {"x": {"values_sha256": "no", "thresholds": {}}}),
            ("annotations", {"bytes": 0, "sha256": "0" * 64}),
            ("more", 1),
        ],
    )
    def test_contents_that_cannot_be_are_refused(self, store: Path, key: str, value: Any) -> None:
        file = self.taken(store)
        document = json.loads(file.read_bytes())
        document["contents"][key] = value
        self.refused(store, document)

    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("format", "other"),
            ("version", 2),
            ("parent", "short"),
            ("message", "x" * 5000),
            ("message", ""),
            ("message", "\n\n"),
            ("created", "yesterday"),
            ("contents", 3),
        ],
    )
    def test_records_that_cannot_be_are_refused(self, store: Path, key: str, value: Any) -> None:
        document = json.loads(self.taken(store).read_bytes())
        self.refused(store, document | {key: value})

    def refused(self, store: Path, document: Any) -> None:
        data = json.dumps(document).encode()
        name = hashlib.sha256(data).hexdigest()
        (store.with_name("s.zarr.snapshots") / f"{name}.json").write_bytes(data)
        with pytest.raises(StoreError, match="is no snapshot"):
            SnapshotFolder.of(store).read(name)

    def test_control_characters_are_not_printed(self, store: Path) -> None:
        file = self.taken(store)
        document = json.loads(file.read_bytes()) | {"message": "a\x1b[2Jb", "who": "\x9b31m"}
        data = json.dumps(document).encode()
        name = hashlib.sha256(data).hexdigest()
        (file.parent / f"{name}.json").write_bytes(data)
        done = CliRunner().invoke(cli, ["log", str(store)])
        assert done.exit_code == 0
        assert "\x1b" not in done.output
        assert "\x9b" not in done.output


class TestDiff:
    def test_finds_what_brute_force_finds(self, store: Path, tmp_path: Path) -> None:
        old = shutil.copytree(store, tmp_path / "old.zarr")
        make_store(store, 17)
        rewrite(store, 2, with_other_mass)
        assert found(old, store) == brute_force(old, store)
        assert found(store, old) == brute_force(store, old)
        assert brute_force(old, store)["changed"] == {(0, 2)}

    def test_a_quarantined_row_that_was_made_has_changed(self, store: Path) -> None:
        take_snapshot(store, "first")
        rewrite(store, 5, lambda row: row_of(0, 5, False))
        name = SnapshotFolder.of(store).ids()[0]
        assert found(f"{store}@{name[:9]}", store)["changed"] == {(0, 5)}

    def test_rows_of_merged_stores_are_known_by_their_recipes(
        self, store: Path, tmp_path: Path
    ) -> None:
        other = make_store(tmp_path / "o.zarr", 6, config=OTHER)
        merge([store, other], tmp_path / "m1.zarr")
        merge([other, store], tmp_path / "m2.zarr")
        split(tmp_path / "m1.zarr", tmp_path / "few.zarr", [0, 3, 11])
        for a in ("m1", "m2", "few", "s"):
            for b in ("m1", "m2", "few", "o"):
                pair = (tmp_path / f"{a}.zarr", tmp_path / f"{b}.zarr")
                assert found(*pair) == brute_force(*pair)
        assert not any(found(tmp_path / "m1.zarr", tmp_path / "m2.zarr").values())

    @settings(max_examples=40, deadline=None)
    @given(data=st.data())
    def test_any_two_sets_of_rows(self, data: st.DataObject) -> None:
        rows = st.dictionaries(
            st.tuples(st.integers(0, 2), st.integers(0, 9)),
            st.tuples(st.sampled_from([1, 2]), st.integers(0, 2)),
            max_size=14,
        )
        sides = [data.draw(rows), data.draw(rows)]
        orders = [data.draw(st.permutations(list(side))) for side in sides]
        versions = [Fake(side, order) for side, order in zip(sides, orders, strict=True)]
        difference = compare(*versions)
        a, b = sides
        want = (set(b) - set(a), set(a) - set(b), {k for k in set(a) & set(b) if a[k] != b[k]})
        got = (difference.added, difference.removed, difference.changed)
        assert tuple({(s, i) for _, s, i in part.tolist()} for part in got) == want
        assert difference.unchanged == sum(a[k] == b[k] for k in set(a) & set(b))
        for part, order in ((difference.added, orders[1]), (difference.changed, orders[1])):
            assert all(order[row] == (seed, index) for row, seed, index in part.tolist())

    def test_the_arrays_that_differ_are_counted(self, store: Path, tmp_path: Path) -> None:
        old = shutil.copytree(store, tmp_path / "old.zarr")
        rewrite(store, 2, with_other_mass)
        rewrite(store, 9, with_other_mass)
        difference = compare(open_version(str(old)), open_version(str(store)), arrays=True)
        assert difference.arrays == {"episodes/lift_height": 2}

    def test_settings_labels_and_annotations_are_compared(
        self, store: Path, tmp_path: Path
    ) -> None:
        other = make_store(tmp_path / "o.zarr", config=replace(CONFIG, seed=1))
        write_label(other, "strict", np.zeros(10, np.uint8), to_plain(LabelConfig()))
        AnnotationLog(other).append("ann", [1], [("tag", "odd")])
        difference = compare(PresentVersion(store), PresentVersion(other))
        assert "seed: 0 against 1" in difference.settings
        assert difference.labels == {"strict": "added"}
        assert difference.annotations == "added"

    def test_a_snapshot_is_compared_without_its_store(self, store: Path) -> None:
        first = take_snapshot(store, "first")
        make_store(store, 18)
        second = take_snapshot(store, "second")
        shutil.rmtree(store)
        assert len(found(f"{store}@{first.id[:8]}", f"{store}@{second.id}")["added"]) == 8
        file = store.with_name("s.zarr.snapshots") / f"{first.id}.json"
        assert len(found(file, f"{store}@{second.id}")["added"]) == 8

    @pytest.mark.parametrize("text", ["nothing.zarr", "@", "x@y", "s.zarr@00"])
    def test_an_unknown_version_is_a_usage_error(
        self, store: Path, text: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(store.parent)
        with pytest.raises(UsageError):
            open_version(text)

    def test_two_rows_of_one_recipe_are_refused(self) -> None:
        twice = Fake({(0, 1): (1, 1)}, [(0, 1), (0, 1)])
        with pytest.raises(StoreError, match="two rows have the same recipe"):
            compare(twice, Fake({}, []))


class Fake(StoredVersion):
    """A version of a few rows, of which nothing is on a disk."""

    def __init__(
        self, rows: dict[tuple[int, int], tuple[int, int]], order: list[tuple[int, int]]
    ) -> None:
        whole = np.zeros(len(order), segments.ROW)
        for place, key in enumerate(order):
            status, content = rows[key]
            whole[place] = (key[1], key[0], np.full(32, content, np.uint8), status)
        parts = [whole[k : k + segments.ROWS] for k in range(0, len(whole), segments.ROWS)]
        self.name, self._parts = "fake", parts
        names = tuple(segments.name_of(part.tobytes()) for part in parts)
        statuses = [rows[key][0] for key in order]
        counts = {"committed": statuses.count(1), "quarantined": statuses.count(2)}
        contents = {"rows": len(order), "arrays": (), **counts}
        self.contents = StoreContents(**contents, segments=names, digests=names, attributes={})

    def rows(self, k: int) -> Any:
        return self._parts[k]


class TestVerify:
    def test_an_unchanged_store_agrees(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        plain = verify(store, workers=1)
        report = plain.with_snapshot(check_snapshot(store, taken.id[:8]))
        assert report.problems == plain.problems
        assert any("are as they were" in note for note in report.notes)

    def test_growing_is_a_note(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        make_store(store, 18)
        report = check_snapshot(store, taken.id)
        assert report.problems == ()
        assert "8 rows added" in report.notes[0]

    def test_another_content_is_a_problem_although_the_store_is_whole(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        rewrite(store, 2, with_other_mass)
        assert not any("checksum" in p.what for p in verify(store, workers=1).problems)
        report = check_snapshot(store, taken.id)
        assert [row for row, _ in report.problems] == [2]
        assert "episodes/lift_height" in report.problems[0][1]

    def test_a_row_that_is_missing_is_a_problem(self, store: Path) -> None:
        taken = take_snapshot(store, "first")
        (store / "episodes/status/2").unlink()
        assert [row for row, _ in check_snapshot(store, taken.id).problems] == [8, 9]

    def test_more_annotations_are_a_note_and_others_a_problem(self, store: Path) -> None:
        AnnotationLog(store).append("ann", [1], [("tag", "odd")])
        taken = take_snapshot(store, "first")
        AnnotationLog(store).append("ann", [2], [("tag", "odd")])
        assert check_snapshot(store, taken.id).problems == ()
        log = store / "annotations/log.jsonl"
        log.write_bytes(log.read_bytes().replace(b"odd", b"off"))
        ((row, text),) = check_snapshot(store, taken.id).problems
        assert row is None
        assert "annotations: changed" in text

    def test_a_label_that_is_gone_is_a_problem(self, store: Path) -> None:
        write_label(store, "strict", np.zeros(10, np.uint8), to_plain(LabelConfig()))
        taken = take_snapshot(store, "first")
        shutil.rmtree(store / "labels")
        assert "labels/strict was removed" in check_snapshot(store, taken.id).problems[0][1]


class TestCommands:
    def run(self, *args: object, code: int = 0) -> str:
        done = CliRunner().invoke(cli, [*map(str, args)])
        if isinstance(done.exception, GraspFactoryError):
            raise done.exception
        assert done.exit_code == code, done.output
        return done.output

    def test_snapshot_log_diff_and_verify(self, store: Path) -> None:
        self.run("snapshot", store, "-m", "first ten")
        make_store(store, 18)
        self.run("snapshot", store, "-m", "eighteen")
        lines = self.run("log", store).splitlines()
        assert [line.split()[-1] for line in lines[1:]] == ["eighteen", "ten"]
        assert "+8" in lines[1]
        newest, oldest = (entry["id"] for entry in json.loads(self.run("log", store, "--json")))
        text = self.run("diff", f"{store}@{oldest[:6]}", f"{store}@{newest[:6]}", "--ids")
        assert "8 added, 0 removed, 0 changed, 10 unchanged" in text
        assert len([line for line in text.splitlines() if line.startswith("added")]) == 8
        plain = json.loads(self.run("diff", f"{store}@{oldest}", store, "--ids", "--json"))
        assert plain["added"] == len(plain["rows"]) == 8

    def test_verify_exits_with_1_if_the_store_is_not_as_in_the_snapshot(
        self, tmp_path: Path
    ) -> None:
        tiny = Path(shutil.copytree(TINY, tmp_path / "tiny.zarr"))
        name = json.loads(self.run("snapshot", tiny, "-m", "as it ships", "--json"))["id"]
        line = ("verify", tiny, "--snapshot", name[:6], "--workers", 1)
        assert "are as they were" in self.run(*line)
        AnnotationLog(tiny).append("ann", [0], [("tag", "odd")])
        assert "annotations: added" in self.run(*line)
        last = max((tiny / "episodes/status").glob("[0-9]*"))
        last.unlink()
        assert f"removed since snapshot {name[:12]}" in self.run(*line, code=1)

    def test_equal_versions_are_said_to_be_the_same(self, store: Path) -> None:
        assert "are the same: 10 episodes" in self.run("diff", store, store)

    def test_a_store_without_snapshots_says_how_to_take_one(self, store: Path) -> None:
        assert "has no snapshots" in self.run("log", store)


def test_old_stores_and_labels_are_recorded(tmp_path: Path) -> None:
    path = old_store(tmp_path)
    taken = take_snapshot(path, "old")
    assert check_snapshot(path, taken.id).problems == ()


def test_history_has_every_snapshot_after_its_children(store: Path) -> None:
    ids = [take_snapshot(make_store(store, n), str(n)).id for n in (10, 12, 14, 16)]
    assert [name for name, _ in SnapshotFolder.of(store).history()] == ids[::-1]


def test_a_quarantined_rows_reason_is_part_of_it(store: Path) -> None:
    taken = take_snapshot(store, "first")
    rewrite(store, 5, lambda row: Quarantined(make_spec(CONFIG, 5), "another reason"))
    assert [row for row, _ in check_snapshot(store, taken.id).problems] == [5]


def test_copies_of_a_snapshot_folder_join_without_conflict(store: Path, tmp_path: Path) -> None:
    take_snapshot(store, "first")
    folder = store.with_name("s.zarr.snapshots")
    other = shutil.copytree(store, tmp_path / "t.zarr")
    shutil.copytree(folder, tmp_path / "t.zarr.snapshots")
    make_store(store, 12)
    make_store(other, 16)
    for path in (store, other):
        take_snapshot(path, "more")
    shutil.copytree(tmp_path / "t.zarr.snapshots", folder, dirs_exist_ok=True)
    assert len(SnapshotFolder.of(store).history()) == 3
