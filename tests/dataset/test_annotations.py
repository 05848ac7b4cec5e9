"""Annotations: what people say of episodes stays, whoever else writes, whatever is cut short."""

from __future__ import annotations

import csv
import errno
import fcntl
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_rows, small_config
from support.faulty_disk import FaultyDisk
from support.helpers import assert_same_tree, tree
from support.places import TINY
from support.scale import sampled

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.limits import Limit
from grasp_factory.core.place import place_at
from grasp_factory.curation.merge import merge, split
from grasp_factory.curation.repair import repair
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.annotations import (
    KINDS,
    Annotation,
    AnnotationLog,
    Change,
    Mark,
    carry,
    default_who,
    fold,
    log_file,
)
from grasp_factory.dataset.annotations.lines import decode, encode
from grasp_factory.dataset.annotations.values import checked
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import (
    LimitError,
    StoreBusyError,
    StoreError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.header import root_attributes
from grasp_factory.writers.zarr.metadata_checksum import is_sealed
from grasp_factory.writers.zarr.store import create_store, prepare_store

pytestmark = pytest.mark.slow

CONFIG = small_config(resolution=[16, 16])
WIDTH, HEIGHT = CONFIG.resolution
N = 16
MISSING = (8, 9, 10, 11)
QUARANTINED = (5, 13)
WHEN = "2026-01-31T08:15:00.250Z"
MARK = {
    "id": "0123456789ab",
    "camera": "front",
    "frame": 0,
    "shape": "box",
    "label": "handle",
    "pixels": [1.5, 2.0, 3.0, 4.25],
}
ADD = """
import sys
from grasp_factory.dataset.annotations import AnnotationLog
log, who, first, count = AnnotationLog(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
print("ready", flush=True)
sys.stdin.readline()
for i in range(first, first + count):
    log.append(who, [i % 4], [("note", f"{who} {i}")])
    print(i, flush=True)
"""
"""A process that writes so many notes, one after the other, and says which are done."""


def make_store(path: Path, *, seed: int = CONFIG.seed, n: int = N) -> Path:
    """Return a store of fake episodes, of which some are missing or quarantined."""
    config = replace(CONFIG, seed=seed)
    create_store(path, config, root_attributes(config, {}), joints=JOINTS, n=n, carried={})
    for block in sorted(set(range(n // 4)) - {MISSING[0] // 4}):
        ZarrWriter(path).write_block(block, make_rows(config, block, n, QUARANTINED))
    return path


def log_of(path: Path) -> Path:
    return path / "annotations" / "log.jsonl"


def adding(path: Path, who: str, first: int, count: int) -> subprocess.Popen[str]:
    """Return a process that writes notes as soon as it reads a line."""
    command = [sys.executable, "-c", ADD, str(path), who, str(first), str(count)]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    process = subprocess.Popen(command, text=True, **pipes)
    assert process.stdout
    assert process.stdout.readline() == "ready\n"
    return process


def start(process: subprocess.Popen[str]) -> None:
    assert process.stdin
    process.stdin.write("\n")
    process.stdin.flush()


def tags_of(path: Path) -> set[str]:
    return {tag for said in AnnotationLog(path).annotations().values() for tag in said.tags}


def said_in(path: Path) -> set[Any]:
    return {change.value for change in AnnotationLog(path).changes()}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store without annotations, which no test changes."""
    return make_store(tmp_path_factory.mktemp("annotations") / "store")


@pytest.fixture
def store(plain: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(plain, tmp_path / "store"))


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    """Return a store of four real episodes, in which nothing is wrong."""
    return Path(shutil.copytree(TINY, tmp_path / "sample"))


LETTERS = st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cs", "Co", "Zl", "Zp"))
TAGS = st.text(LETTERS.filter(lambda c: c != ","), min_size=1, max_size=20).filter(
    lambda text: 0 < len(text.strip()) and len(text.encode()) < 64
)
MARKS = st.fixed_dictionaries(
    {
        "id": st.sampled_from(["000000000001", "000000000002", "abcdefabcdef"]),
        "camera": st.just("front"),
        "frame": st.sampled_from([0, 1]),
        "shape": st.just("point"),
        "label": st.sampled_from(["", "rim"]),
        "pixels": st.lists(st.floats(0, WIDTH), min_size=2, max_size=2),
    }
)
SAID = st.one_of(
    st.tuples(st.sampled_from(["tag", "untag"]), st.sampled_from(["odd", "dark", "für später"])),
    st.tuples(st.just("note"), st.sampled_from(["", "looks odd", "two\nlines"])),
    st.tuples(st.just("quality"), st.none() | st.integers(1, 5)),
    st.tuples(st.just("outcome"), st.none() | st.sampled_from(names(Outcome))),
    st.tuples(st.just("mark"), MARKS),
    st.tuples(st.just("unmark"), st.sampled_from(["000000000001", "abcdefabcdef"])),
)


def made(
    said: Iterable[tuple[int, tuple[str, Any]]], who: str = "ann", when: str = WHEN
) -> list[Change]:
    """Return changes from rows with kinds and values."""
    return [
        Change(when=when, who=who, row=row, kind=kind, value=checked(kind, value))
        for row, (kind, value) in said
    ]


CHANGES = st.lists(st.tuples(st.integers(0, 3), SAID), max_size=25).map(made)


class TestFolding:
    """What stands after changes."""

    @given(CHANGES)
    def test_a_row_stands_as_its_own_changes_leave_it(self, changes: list[Change]) -> None:
        whole = fold(changes)
        apart = [fold(c for c in changes if c.row == row) for row in range(4)]
        assert whole == {row: said for one in apart for row, said in one.items()}

    def test_thousands_of_tags_cost_a_moment(self) -> None:
        changes = made([(0, ("tag", f"{i * 7919 % 5000:04}")) for i in range(5000)])
        started = time.process_time()
        found = fold(changes)
        assert time.process_time() - started < 5.0
        assert found[0].tags == tuple(f"{i:04}" for i in range(5000))

    @given(CHANGES, TAGS)
    def test_a_tag_that_is_given_and_taken_leaves_nothing(
        self, changes: list[Change], tag: str
    ) -> None:
        before = fold(changes)
        given_and_taken = made([(0, ("untag", tag)), (0, ("tag", tag)), (0, ("untag", tag))])
        after = fold([*changes, *given_and_taken])
        was = before.get(0, Annotation(row=0))
        now = after.get(0, Annotation(row=0))
        assert set(now.tags) == set(was.tags) - {checked("tag", tag)}
        assert replace(now, tags=(), changed="", by="") == replace(was, tags=(), changed="", by="")

    @given(CHANGES, st.integers(1, 5), st.sampled_from(names(Outcome)))
    def test_the_last_word_stands(self, changes: list[Change], quality: int, word: str) -> None:
        last = made([(0, ("quality", quality)), (0, ("outcome", word)), (0, ("note", "last"))])
        found = fold([*changes, *last])[0]
        assert (found.quality, found.outcome, found.note) == (quality, word, "last")

    @given(CHANGES)
    def test_taking_everything_back_leaves_no_annotation(self, changes: list[Change]) -> None:
        back: list[tuple[int, tuple[str, Any]]] = []
        for row, said in fold(changes).items():
            back += [(row, ("untag", tag)) for tag in said.tags]
            back += [(row, ("unmark", mark.id)) for mark in said.marks]
            back += [(row, (kind, None)) for kind in ("quality", "outcome")]
            back += [(row, ("note", ""))]
        assert fold([*changes, *made(back)]) == {}

    @given(CHANGES)
    def test_saying_what_stands_changes_nothing_and_nobody_has_said_it(
        self, changes: list[Change]
    ) -> None:
        again: list[tuple[int, tuple[str, Any]]] = []
        for row, said in fold(changes).items():
            again += [(row, ("tag", tag)) for tag in said.tags]
            again += [(row, ("note", said.note)), (row, ("quality", said.quality))]
            again += [(row, ("outcome", said.outcome))]
        assert fold([*changes, *made(again, who="somebody else")]) == fold(changes)

    def test_a_mark_with_the_id_of_another_takes_its_place(self) -> None:
        other = MARK | {"id": "ffffffffffff", "label": "rim"}
        moved = MARK | {"pixels": [0, 0, 1, 1]}
        said = [(0, ("mark", MARK)), (0, ("mark", other)), (0, ("mark", moved))]
        found = fold(made(said))[0].marks
        assert [(mark.id, mark.pixels) for mark in found] == [
            (MARK["id"], (0.0, 0.0, 1.0, 1.0)),
            ("ffffffffffff", (1.5, 2.0, 3.0, 4.25)),
        ]

    def test_who_changed_it_last_and_when_is_known(self) -> None:
        later = "2026-02-01T00:00:00.000Z"
        changes = made([(3, ("tag", "odd"))]) + made([(3, ("note", "x"))], "bob", later)
        assert (fold(changes)[3].by, fold(changes)[3].changed) == ("bob", later)


class TestValues:
    """What may be said."""

    @given(TAGS)
    def test_a_tag_of_any_script_comes_back_as_it_is_kept(self, tag: str) -> None:
        kept = checked("tag", tag)
        assert checked("tag", kept) == kept
        line = encode(made([(0, ("tag", tag))])[0])
        assert decode(line[:-1]).value == kept
        assert line.count(b"\n") == 1

    def test_letters_that_look_the_same_are_one_tag(self) -> None:
        assert checked("tag", "Bl\u00fcte") == checked("tag", "  Blu\u0308te ")

    @pytest.mark.parametrize(
        "tag",
        [
            "<img src=x onerror=alert(1)>",
            "\u0645\u0631\u063a\u0648\u0628\u200c\u0647\u0627",
            "奇怪",
            "👩\u200d🔬",
            "'; DROP TABLE x",
            "x" * 64,
        ],
    )
    def test_a_tag_may_hold(self, tag: str) -> None:
        assert checked("tag", tag) == tag

    @pytest.mark.parametrize(
        "tag",
        ["", "  ", "a,b", "a\nb", "a\rb", "a\u2028b", "a\x00b", "a\x1b[31mb", "a\u202eb", "\ud800",
         "a\ufeffb", "x" * 65, "x" * 10**6, 7, None, b"odd", ["odd"]],
    )  # fmt: skip
    def test_a_tag_may_not_hold(self, tag: object) -> None:
        with pytest.raises(UsageError, match=r"tag: got .*, valid: 1 to 64 printable characters"):
            checked("tag", tag)

    def test_a_note_has_lines_and_an_end(self) -> None:
        assert checked("note", " one\r\ntwo\tthree\n") == "one\ntwo\tthree"
        assert checked("note", "x" * 4000) == "x" * 4000
        for bad in ("x" * 4001, "a\x1b[2Jb", 3):
            with pytest.raises(UsageError, match=r"note: got .*, valid: up to 4000 printable"):
                checked("note", bad)

    @pytest.mark.parametrize("value", [0, 6, -1, 2.0, True, "3", [3]])
    def test_a_quality_is_one_to_five(self, value: object) -> None:
        with pytest.raises(UsageError, match=r"quality: got .*, valid: 1 to 5, or none"):
            checked("quality", value)

    @pytest.mark.parametrize("value", ["Success", "", 0, True, ["success"]])
    def test_an_outcome_is_a_word(self, value: object) -> None:
        with pytest.raises(UsageError, match=r"outcome: got .*, valid: success, .* or none"):
            checked("outcome", value)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"id": "x"}, r"mark.id: got 'x'"),
            ({"id": "0123456789AB"}, r"mark.id"),
            ({"camera": 1}, r"mark.camera"),
            ({"frame": 2}, r"mark.frame: got 2, valid: 0 \(before\) or 1 \(after\)"),
            ({"frame": True}, r"mark.frame"),
            ({"shape": "ring"}, r"mark.shape: got 'ring', valid: box, point"),
            ({"label": "a\nb"}, r"mark.label"),
            ({"label": "x" * 65}, r"mark.label"),
            ({"pixels": [1, 2]}, r"mark.pixels: got .* valid: 4 numbers"),
            ({"shape": "point"}, r"mark.pixels: got .* valid: 2 numbers"),
            ({"pixels": [1, 2, 0, 4]}, r"mark.pixels"),
            ({"pixels": [-1, 2, 3, 4]}, r"mark.pixels"),
            ({"pixels": [1, 2, 3, float("nan")]}, r"mark.pixels"),
            ({"pixels": "1234"}, r"mark.pixels"),
            ({"colour": "red"}, r"unknown key 'mark.colour'"),
        ],
    )
    def test_a_mark_is_checked(self, change: dict[str, Any], said: str) -> None:
        with pytest.raises(UsageError, match=said):
            checked("mark", MARK | change)
        with pytest.raises(UsageError, match="mark"):
            checked("mark", "box")

    @pytest.mark.parametrize("kind", ["tags", "", None, 3, ["tag"]])
    def test_an_unknown_kind_is_answered_with_all_kinds(self, kind: Any) -> None:
        with pytest.raises(UsageError, match="unknown kind") as caught:
            checked(kind, "x")
        assert all(word in str(caught.value) for word in KINDS)


class TestALine:
    @given(CHANGES)
    def test_comes_back_as_it_was(self, changes: list[Change]) -> None:
        assert [decode(encode(change)[:-1]) for change in changes] == changes

    @given(st.binary(max_size=200))
    def test_that_is_anything_is_no_change(self, data: bytes) -> None:
        with pytest.raises(ValueError, match="has no checksum"):
            decode(data)

    @given(SAID, st.integers(0, 10**6), st.integers(0, 255))
    def test_of_which_a_byte_is_another_is_no_change(
        self, said: tuple[str, Any], place: int, value: int
    ) -> None:
        line = bytearray(encode(made([(2, said)])[0])[:-1])
        place %= len(line)
        same = line[place] == value
        line[place] = value
        if not same:
            with pytest.raises(ValueError, match="checksum"):
                decode(bytes(line))

    def test_is_json_that_says_all(self) -> None:
        record = json.loads(encode(made([(2, ("tag", "für später"))])[0]))
        del record["crc32"]
        assert record == {
            "when": WHEN, "who": "ann", "row": 2, "kind": "tag", "value": "für später",
        }  # fmt: skip

    @pytest.mark.parametrize(
        "change",
        [{"row": -1}, {"row": True}, {"row": 10**12}, {"kind": "shout"}, {"value": "a,b"},
         {"who": ""}, {"when": "yesterday"}, {"when": "2026-13-31T08:15:00.250Z"}],
    )  # fmt: skip
    def test_with_a_right_checksum_and_a_wrong_word_is_no_change(
        self, change: dict[str, Any]
    ) -> None:
        line = encode(replace(made([(2, ("tag", "odd"))])[0], **change))
        with pytest.raises(ValueError, match="no change that this version knows"):
            decode(line[:-1])


class TestTheLog:
    def test_of_a_new_store_is_not_there(self, store: Path) -> None:
        log = AnnotationLog(store)
        assert (log.changes(), log.annotations(), log.of(0)) == ([], {}, None)
        assert log.state() == (0, 0)
        assert not (store / "annotations").exists()

    def test_says_what_was_said_by_whom_and_when(self, store: Path) -> None:
        log, begun = AnnotationLog(store), time.time()
        found = log.append("ann", [2, 5], [("tag", "odd"), ("quality", 4), ("mark", MARK)])
        assert found == log.annotations() == AnnotationLog(store).annotations()
        assert sorted(found) == [2, 5]
        said = log.of(2)
        assert said
        assert (said.tags, said.quality, said.note, said.outcome) == (("odd",), 4, "", None)
        assert said.marks == (Mark(**(MARK | {"pixels": tuple(MARK["pixels"])})),)
        assert said.by == "ann"
        change = log.history(2)[0]
        assert (change.who, change.kind, change.value) == ("ann", "tag", "odd")
        stamp = time.strftime("%Y-%m-%dT%H:%M:", time.gmtime(begun))
        later = time.strftime("%Y-%m-%dT%H:%M:", time.gmtime(time.time()))
        assert change.when[:17] in (stamp, later)
        assert said.changed == log.history(2)[-1].when

    def test_gives_none_for_what_is_taken_back(self, store: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [1], [("tag", "odd"), ("outcome", "collision")])
        assert log.append("bob", [1], [("untag", "odd"), ("outcome", None)]) == {1: None}
        assert log.annotations() == {}
        assert [change.who for change in log.history(1)] == ["ann", "ann", "bob", "bob"]

    def test_does_not_grow_by_what_changes_nothing(self, store: Path) -> None:
        log = AnnotationLog(store)
        assert log.append("ann", [1], [("untag", "odd"), ("note", "")]) == {1: None}
        assert not (store / "annotations").exists()
        log.append("ann", [1], [("tag", "odd")])
        before = log.state()
        assert log.append("bob", [1], [("tag", " odd "), ("quality", None)])[1] == log.of(1)
        assert log.state() == before

    def test_tells_cheaply_that_it_has_changed(self, store: Path) -> None:
        log, other = AnnotationLog(store), AnnotationLog(store)
        states = [log.state()]
        for tag in ("a", "b"):
            other.append("ann", [0], [("tag", tag)])
            states.append(log.state())
            said = log.of(0)
            assert said and tag in said.tags
        assert len(set(states)) == 3

    def test_is_read_anew_when_another_one_takes_its_place(
        self, store: Path, tmp_path: Path
    ) -> None:
        log = AnnotationLog(store)
        log.append("ann", [0], [("tag", "here")])
        other = Path(shutil.copytree(store, tmp_path / "other"))
        AnnotationLog(other).append("ann", [0], [("tag", "there"), ("untag", "here")])
        assert tags_of(store) == {"here"}
        os.replace(log_of(other), log_of(store))
        said = log.of(0)
        assert said and said.tags == ("there",)
        log_of(store).write_bytes(b"")
        assert log.annotations() == {}
        log_of(store).unlink()
        assert (log.annotations(), log.state()) == ({}, (0, 0))

    @pytest.mark.parametrize(
        ("rows", "said"),
        [
            ([N], rf"episode {N} of .*: valid: 0 to {N - 1}"),
            ([0, -1], r"episode -1 of .*: valid"),
            ([10**30], r"episode 10+ of .*: valid"),
            ([0, 9, 3], r"episode 9 of .* is missing: only rows that are there can be annotated"),
            (["0"], r"row '0': valid"),
            ([True], r"row True: valid"),
        ],
    )
    def test_refuses_rows_that_are_not_there(self, store: Path, rows: list[Any], said: str) -> None:
        with pytest.raises(UsageError, match=said):
            AnnotationLog(store).append("ann", rows, [("tag", "odd")])
        assert not (store / "annotations").exists()

    def test_takes_numbers_of_numpy_and_each_row_once(self, store: Path) -> None:
        rows = np.array([3, 0, 3])
        assert sorted(AnnotationLog(store).append("ann", rows, [("quality", 1)])) == [0, 3]

    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ([], "no changes"),
            ([("tag", "fine"), ("quality", 9)], "quality: got 9"),
            ([("mark", MARK | {"camera": "rear"})], r"mark.camera: got 'rear', valid: front"),
            ([("mark", MARK | {"pixels": [10, 2, 7, 4]})], r"mark.pixels: .* 16x16 pixels"),
            ([("mark", MARK | {"pixels": [1, 2, 3, 15]})], r"mark.pixels"),
        ],
    )
    def test_refuses_all_if_one_thing_is_wrong(
        self, store: Path, changes: list[tuple[str, Any]], said: str
    ) -> None:
        with pytest.raises(UsageError, match=said):
            AnnotationLog(store).append("ann", [0], changes)
        assert not (store / "annotations").exists()

    def test_takes_marks_up_to_the_edge(self, store: Path) -> None:
        whole = MARK | {"pixels": [0, 0, WIDTH, HEIGHT]}
        corner = MARK | {"id": "f" * 12, "shape": "point", "pixels": [WIDTH, HEIGHT]}
        found = AnnotationLog(store).append("ann", [0], [("mark", whole), ("mark", corner)])[0]
        assert found and len(found.marks) == 2

    @pytest.mark.parametrize("who", ["", "  ", "a\nb", "x" * 65, None])
    def test_refuses_a_name_that_is_none(self, store: Path, who: Any) -> None:
        with pytest.raises(UsageError, match="who: got"):
            AnnotationLog(store).append(who, [0], [("tag", "odd")])

    def test_refuses_more_than_anybody_says(self, store: Path) -> None:
        log, tags = AnnotationLog(store), [("tag", f"{i:03}") for i in range(65)]
        marks = [("mark", MARK | {"id": f"{i:012x}"}) for i in range(501)]
        with pytest.raises(UsageError, match="got 101 changes, valid: up to 100 at once"):
            log.append("ann", [0], [("note", str(i)) for i in range(101)])
        with pytest.raises(UsageError, match=r"episode 0 would have 65 tags, valid: up to 64"):
            log.append("ann", [0, 1], tags)
        assert log.changes() == []
        log.append("ann", [0], tags[:64])
        with pytest.raises(UsageError, match="episode 0 would have 65 tags"):
            log.append("ann", [0], tags[64:])
        for first in range(0, 500, 100):
            log.append("ann", [1], marks[first : first + 100])
        with pytest.raises(UsageError, match="episode 1 would have 501 marks, valid: up to 500"):
            log.append("ann", [1], marks[500:])

    def test_takes_tags_off_an_episode_that_has_too_many(self, store: Path) -> None:
        said = [(0, ("tag", f"{i:03}")) for i in range(100)]
        AnnotationLog(store).append("ann", [0], [("tag", "000")])
        log_of(store).write_bytes(b"".join(map(encode, made(said))))
        log = AnnotationLog(store)
        assert len(log.append("ann", [0], [("untag", "007")])[0].tags) == 99  # type: ignore[union-attr]
        with pytest.raises(UsageError, match="would have 100 tags"):
            log.append("ann", [0], [("tag", "more")])

    def test_never_grows_larger_than_what_is_read(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        AnnotationLog(store).append("ann", [0], [("tag", "one")])
        before = log_of(store).read_bytes()
        monkeypatch.setattr(log_file, "LOG", Limit("log", len(before), "a log"))
        with pytest.raises(LimitError, match=r"log\.jsonl: a log of "):
            AnnotationLog(store).append("ann", [0], [("tag", "two")])
        assert log_of(store).read_bytes() == before
        assert tags_of(store) == {"one"}

    def test_of_no_store_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(StoreMismatchError, match="there is no store at"):
            AnnotationLog(tmp_path / "nothing").append("ann", [0], [("tag", "odd")])

    def test_is_passed_by_by_readers_of_zarr(self, store: Path) -> None:
        AnnotationLog(store).append("ann", [0], [("tag", "odd")])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            members = dict(zarr.open_group(store, mode="r").members(max_depth=None))
        assert isinstance(members["annotations"], zarr.Array)
        assert members["annotations"].shape == (0,)

    def test_leaves_every_other_byte_of_the_store_alone(self, plain: Path, store: Path) -> None:
        AnnotationLog(store).append("ann", [0, 5], [("tag", "odd"), ("note", "look")])
        assert sorted(tree(store).keys() - tree(plain).keys()) == [
            "annotations/log.jsonl", "annotations/zarr.json",
        ]  # fmt: skip
        shutil.rmtree(store / "annotations")
        assert_same_tree(plain, store)


class TestWhoSaysIt:
    def test_is_the_variable_or_the_account(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("GRASP_FACTORY_USER", "Ann Ön")
        assert default_who() == "Ann Ön"
        monkeypatch.delenv("GRASP_FACTORY_USER")
        monkeypatch.setenv("LOGNAME", "bob")
        assert default_who() == "bob"

    def test_is_unknown_where_the_account_has_no_name(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def nobody() -> str:
            raise KeyError("getpwuid(): uid not found: 12345")

        monkeypatch.delenv("GRASP_FACTORY_USER", raising=False)
        monkeypatch.setattr("getpass.getuser", nobody)
        assert default_who() == "unknown"


class TestSeveralWriters:
    def test_lose_nothing_of_each_other(self, sample: Path) -> None:
        count = 200
        processes = [adding(sample, who, 0, count) for who in ("ann", "bob")]
        for process in processes:
            start(process)
        assert [process.communicate(timeout=120)[0].count("\n") for process in processes] == [
            count, count,
        ]  # fmt: skip
        assert [process.returncode for process in processes] == [0, 0]
        log = AnnotationLog(sample)
        assert (log.damaged(), log.is_finished()) == ([], True)
        assert said_in(sample) == {f"{who} {i}" for who in ("ann", "bob") for i in range(count)}
        assert [change.who for change in log.changes()].count("ann") == count
        assert verify(sample).problems == ()

    @pytest.mark.parametrize("seed", sampled(range(6), 2))
    def test_that_are_killed_have_said_what_they_had_done(self, sample: Path, seed: int) -> None:
        rng = np.random.default_rng(seed)
        process = adding(sample, "ann", 0, 100_000)
        start(process)
        assert process.stdout
        done = [process.stdout.readline() for _ in range(int(rng.integers(1, 30)))]
        time.sleep(rng.uniform(0.0, 0.02))
        process.send_signal(signal.SIGKILL)
        done += process.communicate()[0].splitlines()
        assert process.returncode == -signal.SIGKILL
        promised = {f"ann {int(line)}" for line in done if line.strip()}
        assert promised <= said_in(sample)
        AnnotationLog(sample).append("bob", [0], [("tag", "after")])
        assert said_in(sample) >= promised | {"after"}
        assert verify(sample).problems == ()

    def test_may_be_threads_of_one_log(self, store: Path) -> None:
        log, count = AnnotationLog(store), 20

        def say(who: str) -> None:
            for i in range(count):
                log.append(who, [i % 4], [("tag", f"{who} {i}")])

        with ThreadPoolExecutor(4) as pool:
            list(pool.map(say, "abcd"))
        assert log.annotations() == AnnotationLog(store).annotations()
        assert tags_of(store) == {f"{who} {i}" for who in "abcd" for i in range(count)}

    @pytest.mark.parametrize("kind", [fcntl.LOCK_EX, fcntl.LOCK_SH], ids=["alone", "shared"])
    def test_wait_for_each_other_but_not_for_ever(
        self, store: Path, monkeypatch: pytest.MonkeyPatch, kind: int
    ) -> None:
        monkeypatch.setattr(log_file, "WAIT_S", 0.05)
        log = AnnotationLog(store)
        log.append("ann", [0], [("tag", "odd")])
        with log_of(store).open("rb") as held:
            fcntl.flock(held, kind)
            with pytest.raises(StoreBusyError, match="another process holds it for more than"):
                log.append("ann", [0], [("tag", "more")])
            assert log.of(0) == AnnotationLog(store).of(0)
        log.append("ann", [0], [("tag", "more")])
        assert tags_of(store) == {"odd", "more"}


class TestALineThatIsCutShort:
    @pytest.fixture
    def written(self, store: Path) -> bytes:
        log = AnnotationLog(store)
        for tag in ("one", "two", "drei später"):
            log.append("ann", [0], [("tag", tag)])
        return log_of(store).read_bytes()

    def test_costs_nothing_but_itself(self, store: Path, written: bytes) -> None:
        first = written.index(b"\n") + 1
        for size in range(first, len(written)):
            log_of(store).write_bytes(written[:size])
            whole = written[:size].count(b"\n")
            log = AnnotationLog(store)
            assert len(log.changes()) == whole
            assert log.damaged() == []
            assert log.is_finished() == written[:size].endswith(b"\n")
            log.append("bob", [1], [("tag", "next")])
            last = written[:size].rsplit(b"\n", 1)[-1] + b"\n"
            kept = whole + (last in written.splitlines(keepends=True))
            found = AnnotationLog(store)
            assert len(found.changes()) == kept + 1
            assert (found.damaged(), found.is_finished()) == ([], True)

    @pytest.mark.parametrize("left", [b"\0" * 300, b"{", b'{"when": "2026', b"x" * 200_000])
    def test_may_hold_anything(self, store: Path, written: bytes, left: bytes) -> None:
        log_of(store).write_bytes(written + left)
        AnnotationLog(store).append("ann", [0], [("tag", "next")])
        assert log_of(store).read_bytes().startswith(written + b'{"when"')
        assert tags_of(store) == {"one", "two", "drei später", "next"}

    def test_is_told_by_verify_and_removed_by_repair(self, sample: Path) -> None:
        AnnotationLog(sample).append("ann", [0], [("tag", "odd")])
        written = log_of(sample).read_bytes()
        log_of(sample).write_bytes(written + b'{"when": "2026')
        (problem,) = verify(sample).problems
        assert str(problem) == (
            "store, annotations/log.jsonl: its last line is unfinished: who wrote it was killed, or"
            " its end is lost; run grasp-factory repair"
        )
        done = repair(sample)
        assert done.mended == ("annotations/log.jsonl: what is left of its last line is removed",)
        assert log_of(sample).read_bytes() == written
        assert done.is_whole


class TestALineThatIsDamaged:
    @pytest.fixture
    def damaged(self, sample: Path) -> Path:
        """Return a store with a log of which the second of three lines is damaged."""
        log = AnnotationLog(sample)
        for tag in ("one", "two", "three"):
            log.append("ann", [0], [("tag", tag)])
        log_of(sample).write_bytes(log_of(sample).read_bytes().replace(b'"two"', b'"tw0"'))
        return sample

    def test_is_passed_by_by_readers_and_named(self, damaged: Path) -> None:
        log = AnnotationLog(damaged)
        assert tags_of(damaged) == {"one", "three"}
        assert log.damaged() == [(2, "does not match its checksum")]
        assert Dataset(damaged).tagged("one").indices.tolist() == [0]
        log.append("bob", [1], [("tag", "four")])
        assert AnnotationLog(damaged).damaged() == log.damaged()

    def test_is_named_by_verify_and_left_by_repair(self, damaged: Path) -> None:
        said = [str(problem) for problem in verify(damaged).problems]
        assert said == [
            "store, annotations/log.jsonl: line 2 does not match its checksum; nothing tells what"
            " it said: look at it, then delete that line"
        ]
        before = log_of(damaged).read_bytes()
        done = repair(damaged)
        assert done.failed == (
            "annotations/log.jsonl: line 2 does not match its checksum: only people can mend that:"
            " nothing tells what it said: look at it, then delete that line",
        )
        assert log_of(damaged).read_bytes() == before
        assert not done.is_whole

    def test_is_not_lost_by_a_merge_or_a_split(self, damaged: Path, tmp_path: Path) -> None:
        for command in (lambda out: merge([damaged], out), lambda out: split(damaged, out, [0])):
            with pytest.raises(StoreError, match=r"log.jsonl, line 2 does not match its checksum"):
                command(tmp_path / "out")
            assert sorted(path.name for path in tmp_path.iterdir()) == ["sample"]

    def test_is_one_of_many_that_are_counted(self, damaged: Path) -> None:
        log_of(damaged).write_bytes(b"nonsense\n" * 50)
        said = [problem.what for problem in verify(damaged).problems]
        assert len(said) == 21
        assert said[0] == "line 1 has no checksum"
        assert said[-1] == "30 more of its lines are damaged"

    def test_any_byte_that_is_another_is_told(self, store: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [0], [("tag", "odd"), ("note", "schön")])
        whole = log_of(store).read_bytes()
        for place in range(len(whole)):
            changed = bytearray(whole)
            changed[place] ^= 1 << (place % 8)
            log_of(store).write_bytes(changed)
            found = AnnotationLog(store)
            assert found.damaged() or not found.is_finished()


class TestAStoreWithAnnotations:
    @pytest.fixture
    def annotated(self, sample: Path) -> Path:
        camera = next(iter(Dataset(sample).config.cameras))
        mark = MARK | {"camera": camera}
        AnnotationLog(sample).append("ann", [0, 3], [("tag", "odd"), ("mark", mark)])
        return sample

    @pytest.fixture
    def growing(self, tmp_path: Path) -> Path:
        """Return a store of two whole blocks, of which an episode is quarantined."""
        path = tmp_path / "growing"
        create_store(path, CONFIG, root_attributes(CONFIG, {}), joints=JOINTS, n=8, carried={})
        for block in (0, 1):
            ZarrWriter(path).write_block(block, make_rows(CONFIG, block, 8, (5,)))
        AnnotationLog(path).append("ann", [0, 5], [("tag", "odd"), ("mark", MARK)])
        return path

    def about(self, path: Path) -> list[str]:
        report = verify(path)
        return [*map(str, report.problems), *report.notes]

    def test_has_no_problem_for_it(self, annotated: Path) -> None:
        assert self.about(annotated) == []

    def test_is_told_of_strangers_there(self, annotated: Path) -> None:
        (annotated / "annotations" / "mine.txt").touch()
        assert self.about(annotated) == [
            "annotations: 'mine.txt': not the store's; nothing reads it"
        ]

    @pytest.mark.parametrize("damage", ["delete", "edit", "shape"])
    def test_gets_the_folders_description_again(self, annotated: Path, damage: str) -> None:
        file = annotated / "annotations" / "zarr.json"
        whole, said = file.read_bytes(), log_of(annotated).read_bytes()
        if damage == "delete":
            file.unlink()
        else:
            old, new = {"edit": (b"uint8", b"int8"), "shape": (b"0", b"7")}[damage]
            file.write_bytes(whole.replace(old, new, 1))
        assert len(self.about(annotated)) == 1
        assert "annotations/zarr.json is made again" in repair(annotated).mended
        assert file.read_bytes() == whole
        assert log_of(annotated).read_bytes() == said

    def test_gets_it_again_also_from_the_next_change(self, annotated: Path) -> None:
        (annotated / "annotations" / "zarr.json").unlink()
        AnnotationLog(annotated).append("ann", [1], [("tag", "odd")])
        assert self.about(annotated) == []

    def test_of_rows_that_it_does_not_have_is_told(self, annotated: Path) -> None:
        with log_of(annotated).open("ab") as log:
            log.write(encode(made([(900, ("tag", "odd"))])[0]))
        (said,) = self.about(annotated)
        assert "tells of row 900, the store has 4" in said

    def test_keeps_it_when_it_grows(self, growing: Path) -> None:
        before = AnnotationLog(growing).annotations()
        prepare_store(growing, CONFIG, JOINTS, 12, {})
        ZarrWriter(growing).write_block(2, make_rows(CONFIG, 2, 12))
        assert AnnotationLog(growing).annotations() == before
        assert AnnotationLog(growing).append("ann", [11], [("quality", 2)])[11]

    def test_keeps_it_when_a_row_is_made_again(self, growing: Path) -> None:
        ZarrWriter(growing).write_block(1, make_rows(CONFIG, 1, 8))
        assert Dataset(growing).tagged("odd").indices.tolist() == [0, 5]

    def test_is_read_by_datasets(self, growing: Path) -> None:
        dataset = Dataset(growing)
        assert sorted(dataset.annotations) == [0, 5]
        assert dataset.annotations[0].tags == ("odd",)
        assert dataset.tagged("odd").indices.tolist() == [0]  # 5 is quarantined
        assert dataset.tagged("odd").indices.dtype == np.int64
        AnnotationLog(growing).append("ann", [0, 3], [("tag", "späte")])
        assert dataset.tagged("spa\u0308te", "odd").indices.tolist() == [0]
        assert dataset.tagged("späte").indices.tolist() == [0, 3]
        assert dataset.tagged("none").indices.tolist() == []
        with pytest.raises(UsageError, match="no tags: name one or more"):
            dataset.tagged()


class TestAStoreThatCannotBeWritten:
    @pytest.mark.parametrize("kind", ["folder", "link", "pipe"])
    def test_because_something_has_the_logs_name(
        self, store: Path, tmp_path: Path, kind: str
    ) -> None:
        (store / "annotations").mkdir()
        make: dict[str, Callable[[], object]] = {
            "folder": log_of(store).mkdir,
            "link": lambda: log_of(store).symlink_to(tmp_path / "elsewhere"),
            "pipe": lambda: os.mkfifo(log_of(store)),
        }
        make[kind]()
        with pytest.raises(StoreError, match=r"log.jsonl (is in the way|is a link)"):
            AnnotationLog(store).append("ann", [0], [("tag", "odd")])
        assert not (tmp_path / "elsewhere").exists()

    @pytest.mark.parametrize("there", ["empty", "log", "nothing"])
    def test_because_its_folder_is_a_link_which_is_not_read_either(
        self, sample: Path, tmp_path: Path, there: str
    ) -> None:
        AnnotationLog(sample).append("ann", [0], [("tag", "odd")])
        elsewhere = tmp_path / "elsewhere"
        shutil.move(sample / "annotations", elsewhere)
        if there == "empty":
            shutil.rmtree(elsewhere)
            elsewhere.mkdir()
        elif there == "nothing":
            shutil.rmtree(elsewhere)
        (sample / "annotations").symlink_to(elsewhere)
        before = tree(elsewhere) if elsewhere.exists() else None
        refused = pytest.raises(StoreError, match=r"annotations is a link, .*: put a copy")
        with refused:
            AnnotationLog(sample).append("ann", [0], [("tag", "more")])
        with refused:
            AnnotationLog(sample).annotations()
        with refused:
            split(sample, tmp_path / "part", [0])
        assert (tree(elsewhere) if elsewhere.exists() else None) == before
        (problem,) = verify(sample).problems
        assert "annotations is a link" in problem.advice
        with refused:
            repair(sample)

    def test_because_its_log_is_a_link_which_is_not_read_either(
        self, sample: Path, tmp_path: Path
    ) -> None:
        AnnotationLog(sample).append("ann", [0], [("tag", "odd")])
        shutil.move(log_of(sample), tmp_path / "elsewhere")
        log_of(sample).symlink_to(tmp_path / "elsewhere")
        with pytest.raises(StoreError, match=r"log\.jsonl is a link"):
            AnnotationLog(sample).annotations()
        assert "is a link" in verify(sample).problems[0].advice

    def test_because_something_has_the_folders_name(self, store: Path) -> None:
        (store / "annotations").touch()
        assert AnnotationLog(store).annotations() == {}
        with pytest.raises(StoreError, match=r"annotations/log.jsonl cannot be written: "):
            AnnotationLog(store).append("ann", [0], [("tag", "odd")])

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
    def test_because_it_is_read_only(self, store: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [0], [("tag", "odd")])
        log_of(store).chmod(0o444)
        with pytest.raises(StoreError, match="can be read, but not annotated"):
            log.append("ann", [0], [("tag", "more")])
        assert tags_of(store) == {"odd"}

    def test_because_permission_is_refused(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        real = os.open

        def refuse(path: Any, flags: int, *more: Any, **named: Any) -> int:
            if flags & os.O_RDWR and str(path) == "log.jsonl":
                raise PermissionError(13, "Permission denied", str(path))
            return real(path, flags, *more, **named)

        log = AnnotationLog(store)
        log.append("ann", [0], [("tag", "odd")])
        monkeypatch.setattr(os, "open", refuse)
        with pytest.raises(StoreError, match=r"Permission denied; .* not annotated"):
            log.append("ann", [0], [("tag", "more")])
        assert tags_of(store) == {"odd"}

    @pytest.mark.parametrize("error", [errno.ENOSPC, errno.EROFS])
    @pytest.mark.parametrize("is_new", [True, False])
    def test_because_any_call_fails_is_as_it_was_or_has_it_all(
        self, store: Path, tmp_path: Path, error: int, is_new: bool
    ) -> None:
        if not is_new:
            AnnotationLog(store).append("ann", [0], [("tag", "before")])
        before = tags_of(store)

        def say(path: Path, fails: int) -> FaultyDisk:
            disk = FaultyDisk(path, lambda _: len(disk.done) == fails + 1, error, stays=False)
            with disk.installed():
                AnnotationLog(path).append("ann", [1, 2], [("tag", "more")])
            return disk

        big = shutil.ignore_patterns("cameras", "streams", "imu")
        calls = len(say(Path(shutil.copytree(store, tmp_path / "all", ignore=big)), 10**6).done)
        assert calls > (4 if is_new else 1)
        raised = 0
        for fails in range(calls):
            path = Path(shutil.copytree(store, tmp_path / f"store{fails}", ignore=big))
            try:
                say(path, fails)
            except StoreError as caught:
                assert "log.jsonl cannot be written" in str(caught)
                assert tags_of(path) == before
                raised += 1
            else:  # a folder that is there already is not missed
                assert tags_of(path) == before | {"more"}
            found = AnnotationLog(path).append("ann", [1, 2], [("tag", "after")])
            assert all(said and "after" in said.tags for said in found.values())
            assert AnnotationLog(path).damaged() == []
            assert is_sealed(place_at(path / "annotations" / "zarr.json"))
        assert raised >= (6 if is_new else 2)

    def test_the_first_one_leaves_nothing_where_nothing_can_be_written(
        self, plain: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        before = tree(plain)

        def full(*_: Any) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        for name in ("write_placeholder", "settle"):
            with monkeypatch.context() as patch:
                patch.setattr(f"grasp_factory.dataset.annotations.log_file.{name}", full)
                with pytest.raises(StoreError, match="cannot be written: No space left"):
                    AnnotationLog(plain).append("ann", [0], [("tag", "odd")])
            assert tree(plain) == before
            assert not (plain / "annotations").exists()

    def test_because_the_disk_is_full_is_as_it_was(self, store: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [0], [("tag", "odd")])
        before = log_of(store).read_bytes()
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 50, hard))
        try:
            with pytest.raises(StoreError, match=r"log.jsonl cannot be written: File too large"):
                log.append("ann", [0, 1, 2], [("tag", "more")])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
            signal.signal(signal.SIGXFSZ, handler)
        assert log_of(store).read_bytes() == before
        log.append("ann", [0], [("tag", "more")])
        assert tags_of(store) == {"odd", "more"}


class TestMerging:
    def test_of_stores_without_annotations_makes_none(self, plain: Path, tmp_path: Path) -> None:
        assert merge([plain], tmp_path / "out").annotations == 0
        assert not (tmp_path / "out" / "annotations").exists()

    def test_takes_those_of_every_row_along(self, store: Path, tmp_path: Path) -> None:
        other = make_store(tmp_path / "other", seed=5)
        AnnotationLog(store).append("ann", [1, 5], [("tag", "odd"), ("quality", 3)])
        AnnotationLog(other).append("bob", [0, 15], [("note", "look"), ("mark", MARK)])
        out = tmp_path / "out"
        assert merge([store, other], out).annotations == 4
        dataset, found = Dataset(out), Dataset(out).annotations
        seed, index = dataset.column("seed"), dataset.column("index")
        told = {(int(seed[row]), int(index[row])): said for row, said in found.items()}
        assert {key: (said.by, said.tags, said.note) for key, said in told.items()} == {
            (CONFIG.seed, 1): ("ann", ("odd",), ""),
            (CONFIG.seed, 5): ("ann", ("odd",), ""),
            (5, 0): ("bob", (), "look"),
            (5, 15): ("bob", (), "look"),
        }
        whens = [change.when for change in AnnotationLog(out).changes()]
        assert whens == sorted(whens)
        assert [str(p) for p in verify(out).problems if "annotations" in p.array] == []

    def test_of_one_episode_has_both_histories_in_the_order_of_time(
        self, store: Path, tmp_path: Path
    ) -> None:
        other = Path(shutil.copytree(store, tmp_path / "other"))
        for turn, (path, who) in enumerate([(store, "ann"), (other, "bob")] * 2):
            AnnotationLog(path).append(who, [3], [("quality", turn + 1), ("tag", who)])
            time.sleep(0.002)
        AnnotationLog(other).append("bob", [3], [("untag", "bob")])
        out = tmp_path / "out"
        assert merge([store, other], out).annotations == 1
        log = AnnotationLog(out)
        said = log.of(3)
        assert said
        assert (said.quality, said.tags, said.by) == (4, ("ann",), "bob")
        qualities = [c.value for c in log.history(3) if c.kind == "quality"]
        assert qualities == [1, 2, 3, 4]

    def test_of_parts_of_one_store_has_each_change_once(self, store: Path, tmp_path: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [0, 1, 2, 3], [("tag", "odd"), ("untag", "odd"), ("tag", "odd")])
        log.append("bob", [2], [("note", "look")])
        split(store, tmp_path / "a", [0, 1, 2])
        split(store, tmp_path / "b", [1, 2, 3])
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
        after = AnnotationLog(tmp_path / "out")
        assert after.annotations() == log.annotations()
        assert sorted(map(encode, after.changes())) == sorted(map(encode, log.changes()))

    def test_of_one_annotated_store_keeps_every_byte_of_the_log(
        self, store: Path, tmp_path: Path
    ) -> None:
        log = AnnotationLog(store)
        for i, kind in enumerate(["a", "b", "c"]):
            log.append("ann", [i], [("tag", kind)])
        merge([store], tmp_path / "out")
        assert tree(tmp_path / "out" / "annotations") == tree(store / "annotations")

    def test_may_be_killed_and_run_again(self, store: Path, tmp_path: Path) -> None:
        AnnotationLog(store).append("ann", [0], [("tag", "odd")])
        left = tmp_path / ".out.merging"
        shutil.copytree(store, left)
        (left / "annotations" / "log.jsonl.partial").touch()
        merge([store], tmp_path / "out")
        assert tags_of(tmp_path / "out") == {"odd"}
        assert not left.exists()


class TestSplitting:
    def test_takes_those_of_the_chosen_rows_along(self, store: Path, tmp_path: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [1, 4, 15], [("tag", "odd")])
        log.append("bob", [4], [("note", "look"), ("untag", "odd")])
        out = tmp_path / "out"
        assert split(store, out, [15, 4, 2]).annotations == 2
        assert {row: (said.tags, said.note) for row, said in Dataset(out).annotations.items()} == {
            1: ((), "look"),
            2: (("odd",), ""),
        }
        assert [(c.who, c.row) for c in AnnotationLog(out).changes()] == [
            ("ann", 1), ("ann", 2), ("bob", 1), ("bob", 1),
        ]  # fmt: skip

    def test_of_rows_without_any_makes_none(self, store: Path, tmp_path: Path) -> None:
        AnnotationLog(store).append("ann", [1], [("tag", "odd")])
        assert split(store, tmp_path / "out", [2, 3]).annotations == 0
        assert not (tmp_path / "out" / "annotations").exists()


@given(CHANGES)
def test_what_is_carried_stands_as_it_stood(
    tmp_path_factory: pytest.TempPathFactory, changes: list[Change]
) -> None:
    stores = [tmp_path_factory.mktemp("carry") for _ in range(2)]
    (stores[0] / "annotations").mkdir()
    log_of(stores[0]).write_bytes(b"".join(map(encode, changes)))
    rows = {0: 7, 2: 0, 3: 1}
    count = carry(stores[0], stores[1], rows)
    assert count == sum(change.row in rows for change in changes)
    before, after = (AnnotationLog(path).annotations() for path in stores)
    assert after == {
        rows[row]: replace(said, row=rows[row]) for row, said in before.items() if row in rows
    }


class TestTheCommands:
    def test_say_and_list(self, run: Callable[..., tuple[int, str, str]], store: Path) -> None:
        code, out, _ = run("tag", store, "--episodes", "1,3", "--add", "odd", "--add", "für später",
                           "--note", "look", "--quality", 2, "--who", "ann")  # fmt: skip
        assert (code, out) == (0, f"{store}: 2 episodes annotated by ann\n")
        run("tag", store, "--episodes", "3", "--remove", "odd", "--quality", "none",
            "--outcome", "collision", "--note", "", "--who", "bob")  # fmt: skip
        code, out, _ = run("tags", store)
        assert code == 0
        assert [line.split() for line in out.splitlines()[:3]] == [
            ["tag", "episodes"], ["für", "später", "2"], ["odd", "1"],
        ]  # fmt: skip
        assert out.splitlines()[3] == (
            "2 episodes annotated: 2 tagged, 1 with a note, 1 with a quality,"
            " 1 with a corrected outcome"
        )

    def test_export_all_of_it(self, run: Callable[..., tuple[int, str, str]], store: Path) -> None:
        log = AnnotationLog(store)
        log.append("ann", [1], [("tag", "b"), ("tag", "a"), ("note", 'say "x",\nand y')])
        log.append("bob", [3], [("mark", MARK), ("outcome", "success"), ("quality", None)])
        records = json.loads(run("tags", store, "--json")[1])
        assert [record["row"] for record in records] == [1, 3]
        assert records[0]["tags"] == ["a", "b"]
        assert records[1]["marks"] == [MARK]
        rows = list(csv.DictReader(io.StringIO(run("tags", store, "--csv")[1])))
        assert [(row["row"], row["tags"], row["by"]) for row in rows] == [
            ("1", "a,b", "ann"), ("3", "", "bob"),
        ]  # fmt: skip
        assert rows[0]["note"] == 'say "x",\nand y'
        assert json.loads(rows[1]["marks"]) == [MARK]

    def test_export_the_history(
        self, run: Callable[..., tuple[int, str, str]], store: Path
    ) -> None:
        log = AnnotationLog(store)
        log.append("ann", [1], [("tag", "a"), ("mark", MARK)])
        log.append("bob", [1, 2], [("untag", "a"), ("quality", 5)])
        changes = log.changes()
        told = json.loads(run("tags", store, "--history", "--json")[1])
        assert [Change(**record) for record in told] == changes
        rows = list(csv.DictReader(io.StringIO(run("tags", store, "--history", "--csv")[1])))
        assert [(row["when"], row["who"], int(row["row"]), row["kind"]) for row in rows] == [
            (c.when, c.who, c.row, c.kind) for c in changes
        ]
        text = run("tags", store, "--history")[1].splitlines()
        assert len(text) == 1 + len(changes)
        assert "box handle on front 0 at 1.5, 2, 3, 4.25" in text[2]
        assert len(run("tags", store, "--history", "--episodes", "2")[1].splitlines()) == 2

    def test_take_a_selection(
        self, run: Callable[..., tuple[int, str, str]], store: Path, tmp_path: Path
    ) -> None:
        ids = tmp_path / "ids.txt"
        ids.write_text("3\n0\n\n7\n")
        run("tag", store, "--ids", ids, "--add", "odd")
        assert Dataset(store).tagged("odd").indices.tolist() == [0, 3, 7]
        run("tag", store, "--ids", ids, "--episodes", "0,1", "--remove", "odd")
        assert Dataset(store).tagged("odd").indices.tolist() == [3, 7]

    def test_print_what_stands_for_scripts(
        self, run: Callable[..., tuple[int, str, str]], store: Path
    ) -> None:
        run("tag", store, "--episodes", "1", "--add", "odd")
        code, out, _ = run("tag", store, "--episodes", "1,2", "--remove", "odd", "--json")
        assert (code, json.loads(out)) == (
            0, [{"row": 1, "annotation": None}, {"row": 2, "annotation": None}],
        )  # fmt: skip

    @pytest.mark.parametrize(
        ("args", "said"),
        [
            (("--add", "x"), "no episodes are chosen: name them with --episodes or --ids"),
            (("--episodes", "0"), "no changes: name a tag"),
            (
                ("--episodes", "0", "--add", "x", "--remove", "x"),
                "--add and --remove both name 'x'",
            ),
            (("--episodes", "0", "--add", "a,b"), "tag: got 'a,b', valid: 1 to 64 printable"),
            (("--episodes", "0", "--add", "\x1b[31m"), "tag: got '\\x1b[31m'"),
            (("--episodes", "0", "--quality", "6"), "quality: got 6, valid: 1 to 5, or none"),
            (("--episodes", "0", "--quality", "good"), "quality: got 'good', valid: 1 to 5"),
            (("--episodes", "0", "--outcome", "fine"), "outcome: got 'fine', valid: success"),
            (("--episodes", "0", "--note", "x" * 4001), "note: got"),
            (("--episodes", "0", "--add", "x", "--who", ""), "who: got ''"),
            (("--episodes", "99", "--add", "x"), "episode 99 of"),
            (("--episodes", "9", "--add", "x"), "is missing: only rows that are there"),
            (("--episodes", "1-3", "--add", "x"), "--episodes: got '1-3', valid: indices"),
        ],
    )
    def test_answer_a_mistake_in_a_line(
        self,
        complaint: Callable[..., tuple[int, str]],
        store: Path,
        args: tuple[str, ...],
        said: str,
    ) -> None:
        code, text = complaint("tag", store, *args)
        assert code == 2
        assert said in text
        assert "Traceback" not in text
        assert "\x1b" not in text
        assert not (store / "annotations").exists()

    def test_of_no_store_or_of_two_forms_are_refused(
        self, complaint: Callable[..., tuple[int, str]], store: Path
    ) -> None:
        assert complaint("tags", "nothing")[0] == 2
        code, text = complaint("tags", store, "--json", "--csv")
        assert (code, "choose one of them" in text) == (2, True)

    def test_list_nothing_of_a_store_without(
        self, run: Callable[..., tuple[int, str, str]], store: Path
    ) -> None:
        assert run("tags", store)[:2] == (0, "no annotations; `grasp-factory tag` adds them\n")
        assert json.loads(run("tags", store, "--json")[1]) == []

    def test_warn_of_a_damaged_line(
        self, run: Callable[..., tuple[int, str, str]], store: Path
    ) -> None:
        AnnotationLog(store).append("ann", [1], [("tag", "odd")])
        with log_of(store).open("ab") as log:
            log.write(b"nonsense\n")
        code, out, said = run("tags", store, "--json")
        assert (code, len(json.loads(out))) == (0, 1)
        assert said == "warning: annotations/log.jsonl, line 2 has no checksum\n"


def test_a_log_with_a_second_name_is_written_aside(store: Path, tmp_path: Path) -> None:
    """A tool that keeps versions may link a store's files into its cache, read-only."""
    AnnotationLog(store).append("ann", [0], [("tag", "odd")])
    cache = tmp_path / "cache"
    os.link(log_of(store), cache)
    cache.chmod(0o444)
    before = cache.read_bytes()
    AnnotationLog(store).append("ann", [1], [("tag", "low")])
    assert cache.read_bytes() == before
    assert log_of(store).read_bytes().startswith(before)
    assert log_of(store).stat().st_nlink == cache.stat().st_nlink == 1
    assert set(AnnotationLog(store).annotations()) == {0, 1}


def test_of_appenders_to_a_log_with_a_second_name_none_loses_a_line(
    store: Path, tmp_path: Path
) -> None:
    AnnotationLog(store).append("ann", [0], [("tag", "first")])
    os.link(log_of(store), tmp_path / "cache")

    def append(k: int) -> None:
        AnnotationLog(store).append("ann", [k % 4], [("tag", f"t{k}")])

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(append, range(24)))
    assert len(AnnotationLog(store).changes()) == 25
    assert AnnotationLog(store).damaged() == []
    assert len((tmp_path / "cache").read_bytes().splitlines()) == 1
