"""Verifying: whatever is not as it was written is named, and what is, is not."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numcodecs import zstd
from support.damage import (
    CONFIG,
    LABEL,
    SEGMENT_BLOCKS,
    Damage,
    N,
    change,
    cut,
    delete,
    empty,
    files,
    lengthen,
    make_store,
    readings,
    same,
    swap,
)
from support.elsewhere import HERE, THERE, made_there, move, set_texts
from support.helpers import tree
from support.replaced_block import replace_block
from support.scale import scaled
from support.stored import made_here_but_for_our_version, old_store
from zarr.codecs import GzipCodec

from grasp_factory import __version__
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.core.finite_check import non_finite
from grasp_factory.core.limits import VARIABLE, WORD
from grasp_factory.core.schema import FIELDS
from grasp_factory.curation.repair import repair
from grasp_factory.curation.verify import verification, verify
from grasp_factory.curation.verify.deep import draw
from grasp_factory.curation.verify.problems import REPAIR
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import (
    GraspFactoryError,
    IrregularFileError,
    StoreError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.factory.generate import generate
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.column_segments import FOLDER
from grasp_factory.writers.zarr.encoding import packed_shard
from grasp_factory.writers.zarr.label_columns import added_labels
from grasp_factory.writers.zarr.layout import ZSTD_LEVEL
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = pytest.mark.slow

FLIPS = scaled(10, 200)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store that no test changes."""
    return make_store(tmp_path_factory.mktemp("verify") / "store")


@pytest.fixture
def copy(store: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(store, tmp_path / "store"))


class TestAWholeStore:
    def test_has_no_problem_and_is_not_touched(self, store: Path) -> None:
        before = tree(store)
        report = verify(store)
        assert (report.problems, report.notes, report.changed) == ((), (), ())
        assert tree(store) == before

    def test_is_counted(self, store: Path) -> None:
        report = verify(store)
        status = Dataset(store).status.tolist()
        assert report.episodes == N
        assert (report.committed, report.quarantined) == (status.count(1), status.count(2))
        assert report.quarantined > 0 < report.committed

    def test_may_be_of_any_make(self, tmp_path: Path) -> None:
        config = FactoryConfig.from_plain(
            {
                "resolution": [48, 36],
                "robot": "panda",
                "policies": {"antipodal": 1.0, "perturbed": 1.0, "uniform": 1.0},
                "clutter": {"count": 3},
                "record_hz": 60,
                "block_size": 3,
            }
        )
        generate(config, 6, tmp_path / "store", workers=1)
        assert verify(tmp_path / "store").problems == ()

    def test_that_is_empty_lacks_its_rows(self, tmp_path: Path) -> None:
        prepare_store(tmp_path / "store", CONFIG, 7, N, {})
        report = verify(tmp_path / "store")
        assert report.missing == N
        assert [problem.episode for problem in report.problems] == [0, 4, 8]
        assert "generate" in report.problems[0].advice

    def test_is_the_same_for_workers(self, store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(verification, "FEW", 0)
        monkeypatch.setattr(verification, "BLOCKS_AT_ONCE", 1)
        seen: list[int] = []
        report = verify(store, workers=2, on_episode=seen.append)
        assert report == verify(store)
        assert sorted(seen) == list(range(N))


@pytest.mark.timeout(900)
def test_a_changed_byte_is_reported_or_is_no_content(store: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(store, tmp_path / "store"))
    truth, checked_truth = dict(readings(copy)), dict(readings(copy, checked=True))
    every = files(copy)
    sizes = np.array([file.stat().st_size for file in every])
    rng = np.random.default_rng(7)
    silent = 0
    for flip in range(FLIPS):
        # By bytes the images' files would take nearly all of them, by files the small ones.
        share = sizes / sizes.sum() if flip % 2 else None
        file = every[int(rng.choice(len(every), p=share))]
        place = int(rng.integers(file.stat().st_size))
        put_back = change(file, place, file.read_bytes()[place] ^ int(rng.integers(1, 256)))
        what = f"byte {place} of {file.relative_to(copy)}"
        if verify(copy).is_whole:
            silent += 1
            read = dict(readings(copy))
            assert list(read) == list(truth), what
            assert [k for k, value in read.items() if not same(value, truth[k])] == [], what
        for name, value in readings(copy, checked=True):
            is_true = isinstance(value, GraspFactoryError) or same(value, checked_truth[name])
            assert is_true, f"{what}: {name}"
        put_back()
    assert tree(copy) == tree(store)
    assert silent < FLIPS / 4


NAMES = (
    "streams/tcp_pose/1.0.0",
    "cameras/front/depth/0.0.0.0",
    "episodes/status/0",
    "episodes/status/2",
    "episodes/checksum/1",
    "episodes/array_crc32c/0.0",
    "episodes/n_steps/0",
    "episodes/object_mass/2",
    "episodes/spec/0",
    "episodes/error/0",
    "imu/timestamp/0.0",
    f"labels/{LABEL}/outcome/c/0",
    "episodes/zarr.json",
    "streams/phase/zarr.json",
    "episodes/status/zarr.json",
    f"labels/{LABEL}/zarr.json",
    "labels/zarr.json",
    "packed/zarr.json",
    "packed/0-1.npz",
)


def damages() -> Iterator[Any]:
    """Yield every kind of damage to every file; a normal run has each file with one kind."""
    for i, name in enumerate(NAMES):
        for k, kind in enumerate((cut, delete, empty, lengthen)):
            marks = () if (i + k) % 4 == 0 else pytest.mark.soak
            yield pytest.param(kind(name), name, id=f"{kind.__name__} {name}", marks=marks)


@pytest.mark.parametrize(("damage", "name"), list(damages()))
def test_a_file_that_is_cut_deleted_emptied_or_lengthened_is_named(
    store: Path, copy: Path, damage: Damage, name: str
) -> None:
    damage(copy)
    problems = verify(copy).problems
    if name == "packed/0-1.npz" and not problems:  # it is derived, and need not be there
        assert all(same(*pair) for pair in zip(readings(copy), readings(store), strict=True))
        return
    array = name if name.startswith("packed/0") else str(Path(name).parent).removesuffix("/c")
    assert array in {problem.array for problem in problems}
    for problem in problems:
        assert problem.advice
        if problem.episode is not None and Path(name).name != "zarr.json":
            block = int(Path(name).name.split(".")[0])
            assert problem.episode // CONFIG.block_size == block


SWAPS = (
    ("streams/phase/0.0", "streams/phase/1.0"),
    ("streams/phase/0.0", "streams/reward/0.0"),
    ("streams/joint_positions/0.0.0", "streams/joint_velocities/0.0.0"),
    ("cameras/front/rgb/0.0.0.0.0", "cameras/front/rgb/2.0.0.0.0"),
    ("episodes/status/0", "episodes/status/2"),
    ("episodes/checksum/0", "episodes/checksum/1"),
    ("episodes/status/1", "episodes/checksum/1"),
    ("episodes/policy/0", "episodes/split/0"),
    (f"labels/{LABEL}/outcome/c/0", f"labels/{LABEL}/success/c/0"),
    ("streams/zarr.json", "imu/zarr.json"),
    ("streams/joint_positions/zarr.json", "streams/joint_velocities/zarr.json"),
    ("episodes/status/zarr.json", "episodes/checksum/zarr.json"),
)


@pytest.mark.parametrize(("a", "b"), SWAPS, ids=[f"{a} and {b}" for a, b in SWAPS])
def test_files_that_are_swapped_are_found(copy: Path, a: str, b: str) -> None:
    before = tree(copy)
    swap(a, b)(copy)
    assert verify(copy).is_whole == (tree(copy) == before)


def test_whole_blocks_that_are_swapped_are_found(copy: Path) -> None:
    for file in files(copy):
        number = file.name.partition(".")[0]
        other = file.with_name("1" + file.name[1:])
        if number == "0" and not {LABEL, "videos"} & set(file.parts):
            swap(str(file.relative_to(copy)), str(other.relative_to(copy)))(copy)
    problems = verify(copy).problems
    assert {problem.episode for problem in problems} == set(range(8))
    assert "episodes/index" in {problem.array for problem in problems}
    assert {problem.advice for problem in problems} == {REPAIR}


def test_a_label_of_more_rows_than_the_store_is_a_problem(copy: Path) -> None:
    file = copy / "labels" / LABEL / "outcome" / "zarr.json"
    document = json.loads(file.read_text())
    document["shape"] = [10**9]
    file.write_text(json.dumps(document))
    (problem,) = verify(copy).problems
    assert f"of 1000000000 rows, valid: up to {N}" in problem.what
    with pytest.raises(StoreError, match="is of 1000000000 rows, valid: up to"):
        Dataset(copy).label(LABEL)


def rewrite(store: Path, paths: Iterable[str], **changed: Any) -> None:
    """Write arrays anew as another program may: without shards, with gzip, also other values."""
    root = zarr.open_group(store, mode="r+")
    for path in paths:
        old = root[path]
        assert isinstance(old, zarr.Array)
        values = old[:]
        if path in changed:
            values[0] = changed[path]
        new = root.create_array(
            path,
            shape=old.shape,
            chunks=old.chunks,
            dtype=str if values.dtype.kind == "T" else old.dtype,
            chunk_key_encoding={"name": "v2", "separator": "."},
            compressors=[GzipCodec(level=1)],
            fill_value=old.fill_value,
            attributes=old.attrs.asdict(),
            dimension_names=old.metadata.dimension_names,  # type: ignore[union-attr]
            overwrite=True,
            config={"write_empty_chunks": True},
        )
        new[:] = values


class TestArraysThatAnotherProgramWroteAnew:
    @pytest.mark.soak
    def test_are_noted_where_their_values_are_the_old_ones(
        self, store: Path, copy: Path, run: Any
    ) -> None:
        rewrite(copy, every_array(copy))
        shutil.rmtree(copy / FOLDER)
        assert verify(copy).problems == ()
        code, out, _ = run("verify", copy)
        assert code == 0
        assert "the values are those that were written" in out
        assert "not the store's" not in out
        before = tree(copy)
        assert repair(copy).mended == ()
        assert tree(copy) == before
        assert all(same(*pair) for pair in zip(readings(copy), readings(store), strict=True))

    @pytest.mark.parametrize(
        ("path", "value"),
        [("streams/phase", 1), ("episodes/policy", "x"), (f"labels/{LABEL}/outcome", 77)],
    )
    def test_are_a_problem_where_they_are_not(self, copy: Path, path: str, value: Any) -> None:
        rewrite(copy, [path], **{path: value})
        assert path in {problem.array for problem in verify(copy).problems}

    def test_stay_as_they_are_when_rows_are_broken(self, copy: Path) -> None:
        rewrite(copy, ["episodes/policy"])
        delete("streams/phase/0.0")(copy)
        before = tree(copy)
        repaired = repair(copy)
        assert "grasp-factory split" in repaired.failed[0]
        assert not repaired.is_whole
        assert tree(copy) == before

    def test_with_chunks_under_other_names_are_a_problem(self, copy: Path) -> None:
        file = copy / "streams/phase/zarr.json"
        document = json.loads(file.read_text())
        document["chunk_key_encoding"] = {"name": "default", "configuration": {"separator": "/"}}
        file.write_text(json.dumps(document))
        assert {problem.array for problem in verify(copy).problems} == {"streams/phase"}


def every_array(store: Path) -> list[str]:
    """Return the paths of all arrays of a store but the packed columns."""
    members = zarr.open_group(store, mode="r").members(max_depth=None)
    return [path for path, node in members if isinstance(node, zarr.Array) and path != FOLDER]


def replaced(name: str, make: Any) -> Damage:
    """Return what puts something else in the place of a file or folder."""

    def damage(store: Path) -> None:
        place = store / name
        shutil.rmtree(place) if place.is_dir() else place.unlink()
        make(place)

    return damage


WRONG = {
    "streams/phase/0.0": os.mkfifo,
    "episodes/policy/0": os.mkfifo,
    "cameras/zarr.json": os.mkfifo,
    "streams/reward/0.0": Path.mkdir,
    "episodes/split/0": Path.mkdir,
    "streams/zarr.json": Path.mkdir,
    "imu": Path.touch,
    "streams/shake_level": Path.touch,
}


def test_pipes_are_refused_and_folders_for_files_are_mended(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", SEGMENT_BLOCKS)
    truth = tree(copy)
    for name, make in WRONG.items():
        replaced(name, make)(copy)
    arrays = {problem.array for problem in verify(copy).problems}
    assert arrays >= {name if make == Path.touch else str(Path(name).parent)
                      for name, make in WRONG.items()}  # fmt: skip
    for _ in readings(copy):
        pass  # nothing hangs, and no error but ours passes
    with pytest.raises(IrregularFileError, match="is no regular file; move it"):
        repair(copy)
    for name, make in WRONG.items():
        if make == os.mkfifo:
            (copy / name).unlink()
    repair(copy)
    assert tree(copy) == truth


@pytest.mark.parametrize("name", [f"labels/{LABEL}/outcome/c/0", "packed/0-1.npz"])
def test_a_pipe_beside_the_rows_is_named(copy: Path, name: str) -> None:
    replaced(name, os.mkfifo)(copy)
    array = name if name.startswith(FOLDER) else f"labels/{LABEL}/outcome"
    assert array in {problem.array for problem in verify(copy).problems}


def test_a_folder_with_a_persons_files_is_not_removed(copy: Path) -> None:
    replaced("streams/phase/0.0", Path.mkdir)(copy)
    notes = copy / "streams/phase/0.0/notes.txt"
    notes.write_text("x")
    with pytest.raises(StoreError, match=r"notes\.txt is in the way"):
        repair(copy)
    assert notes.read_text() == "x"


def test_what_people_keep_among_the_labels_is_noted(copy: Path) -> None:
    (copy / "labels/notes").mkdir()
    (copy / "labels/notes/a.txt").write_text("x")
    (copy / "labels/__pycache__").mkdir()
    zarr.open_group(copy, mode="r+").create_array("labels/mine", shape=(3,), dtype="i4")
    report = verify(copy)
    assert report.problems == ()
    (note,) = report.notes
    assert note.startswith("labels: '__pycache__', 'mine', 'notes': not the store's")
    assert added_labels(copy) == [LABEL]


def test_a_damaged_label_is_named_by_readers_in_words(copy: Path, run: Any) -> None:
    delete(f"labels/{LABEL}/outcome/zarr.json")(copy)
    code, _, err = run("info", copy)
    assert code == 1
    assert f"array labels/{LABEL}/outcome: zarr.json is missing" in err


def test_words_that_are_long_on_average_are_refused_before_they_are_decoded(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    most = CONFIG.block_size * (WORD.usual + 4) + 4
    (copy / "episodes/policy/1").write_bytes(zstd.compress(bytes(most + 1), 1))
    problems = [p for p in verify(copy).problems if f"valid: up to {most}; if you" in p.what]
    assert [p.episode for p in problems] == [4, 5, 6, 7]
    assert "raise the limit: grasp-factory --limit word=SIZE" in problems[0].what
    monkeypatch.setenv(VARIABLE, "word=1MiB")
    assert not any("valid: up to" in p.what for p in verify(copy).problems)


class TestTheRoot:
    @pytest.mark.parametrize("damage", [cut, delete, empty])
    def test_unreadable_is_the_one_problem(self, copy: Path, damage: Any) -> None:
        damage("zarr.json")(copy)
        (problem,) = verify(copy).problems
        assert (problem.episode, problem.array) == (None, "")
        assert "copy its zarr.json" in problem.advice

    def test_with_another_fact_in_it_is_a_problem_beside_others(self, copy: Path) -> None:
        text = (copy / "zarr.json").read_text()
        (copy / "zarr.json").write_text(text.replace('"license": "MIT"', '"license": "BSD"'))
        delete("episodes/n_imu/0")(copy)
        assert {"", "episodes/n_imu"} <= {problem.array for problem in verify(copy).problems}

    def test_of_something_else_is_a_usage_error(self, tmp_path: Path) -> None:
        for make in (lambda path: None, Path.mkdir, lambda path: path.write_text("x")):
            path = tmp_path / f"place{make}"[:40]
            make(path)
            with pytest.raises(StoreMismatchError):
                verify(path)

    def test_of_a_version_without_seals_says_so(self, copy: Path) -> None:
        for name in ("zarr.json", "episodes/status/zarr.json"):
            document = json.loads((copy / name).read_text())
            del document["attributes"]["metadata_sha256"]
            (copy / name).write_text(json.dumps(document))
        with pytest.raises(StoreMismatchError, match="sealed no metadata"):
            verify(copy)


def test_rows_of_another_number_than_the_other_arrays_are_named(copy: Path) -> None:
    for rows in (N + 4, 0, -1, None, "x"):
        file = copy / "streams/phase/zarr.json"
        whole = file.read_bytes()
        document = json.loads(whole)
        document["shape"] = [rows, *document["shape"][1:]]
        file.write_text(json.dumps(document))
        problems = verify(copy).problems
        assert [problem.array for problem in problems] == ["streams/phase"]
        file.write_bytes(whole)


def test_white_space_in_metadata_is_no_content(copy: Path) -> None:
    for file in copy.rglob("zarr.json"):
        file.write_text(file.read_text().replace("\n", "\n "))
    assert verify(copy).is_whole


def test_what_a_killed_run_or_a_person_left_is_noted_and_harmless(copy: Path) -> None:
    for name in ("streams/phase/0.0.partial", "labels/.x.creating/zarr.json", "me/notes.txt"):
        (copy / name).parent.mkdir(exist_ok=True)
        (copy / name).write_text("x")
    report = verify(copy)
    assert report.is_whole
    killed = [note for note in report.notes if "a run that was killed" in note]
    assert len(killed) == 2
    assert sum("'me'" in note for note in report.notes) == 1


def test_a_segment_under_anothers_name_is_named(copy: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(segment_packing, "SEGMENT_BLOCKS", 1)
        shutil.rmtree(copy / FOLDER)
        segment_packing.pack(copy)
    assert verify(copy).is_whole
    swap(f"{FOLDER}/0-0.npz", f"{FOLDER}/1-1.npz")(copy)
    arrays = [problem.array for problem in verify(copy).problems]
    assert arrays == [f"{FOLDER}/0-0.npz", f"{FOLDER}/1-1.npz"]


def altered(episode: Episode, path: str, value: Any) -> Episode:
    """Return an episode with another column, or the first values of another stream."""
    group, name = path.split("/")
    if group == "episodes":
        return replace(episode, columns={**episode.columns, name: value})
    series = {key: values.copy() for key, values in episode.streams.items()}
    series[name][: len(value)] = value
    return replace(episode, streams=series)


NAN, INF = float("nan"), float("inf")
UNTRUE: dict[str, tuple[str, Any]] = {
    "a time that jumps": ("streams/timestamp", [0.5]),
    "a phase that goes back": ("streams/phase", [3]),
    "a phase without a word": ("streams/phase", [77]),
    "a level outside of the shake": ("streams/shake_level", [1.0]),
    "a body without a contact": ("streams/tactile_body", [1]),
    "a body without a word": ("streams/tactile_body", [99]),
    "a quaternion that is too long": ("streams/tcp_pose", [[0.5, 0.0, 0.3, 0.0, 0.0, 0.0, 1.5]]),
    "a position that is not a number": ("streams/joint_positions", [[NAN] * 7]),
    "an infinite force": ("streams/tactile_force", [np.full((2, 12, 3), INF)]),
    "a reward in between": ("streams/reward", [1.0]),
    "another slip": ("episodes/slip_distance", 0.123),
    "another lift": ("episodes/lift_height", 0.05),
    "a negative area": ("episodes/contact_area", -1.0),
    "an object of another name": ("episodes/object_id", "none"),
    "another mass": ("episodes/object_mass", 7.0),
    "another split": ("episodes/split", "nowhere"),
    "a grasp in part": ("episodes/grasp_position", np.array([NAN, 0.0, 0.0])),
    "a score of none": ("episodes/quality", 9),
    "a score of its own": ("episodes/quality", 4),
    "another way of the objects": ("episodes/object_displacement", np.array([5.0])),
}


@pytest.fixture(scope="module")
def held(store: Path) -> tuple[int, list[Any]]:
    """Return a successful episode's row, and all rows of its block."""
    dataset = Dataset(store)
    i = int(dataset.where(success=True).indices[0])
    first = i // 4 * 4
    return i, [
        dataset[row]
        if dataset.status[row] == 1
        else Quarantined(dataset.spec(row), dataset.column("error")[row])
        for row in range(first, min(first + 4, N))
    ]


@pytest.mark.parametrize("what", UNTRUE)
def test_what_cannot_be_true_is_named_even_where_checksums_match(
    copy: Path, held: tuple[int, list[Any]], what: str
) -> None:
    i, rows = held
    path, value = UNTRUE[what]
    rows = [altered(row, path, value) if row.spec.index == i else row for row in rows]
    shutil.rmtree(copy / FOLDER)
    replace_block(copy, i // 4, rows, [HERE.text] * len(rows))
    assert Dataset(copy).verify(i)
    problems = verify(copy).problems
    assert {problem.episode for problem in problems} == {i}
    assert path.replace("_body", "_position") in {
        problem.array.replace("_body", "_position") for problem in problems
    }


@pytest.mark.parametrize("outcome", [Outcome.NO_PLAN, Outcome.LOST_IN_LIFT])
def test_an_outcome_that_the_streams_do_not_give_is_named(
    copy: Path, held: tuple[int, list[Any]], outcome: Outcome
) -> None:
    i, rows = held
    rows = [replace(row, outcome=outcome) if row.spec.index == i else row for row in rows]
    replace_block(copy, i // 4, rows, [HERE.text] * len(rows))
    arrays = {problem.array for problem in verify(copy).problems}
    assert {"episodes/outcome", "streams/reward"} <= arrays


@pytest.mark.parametrize("place", [0, 1, -1])
def test_a_value_in_the_padding_is_named(copy: Path, place: int) -> None:
    path, dataset = "streams/gripper_width", Dataset(copy)
    i, size = int(dataset.committed[0]), CONFIG.block_size
    start, n_steps = i // size * size, int(dataset.value(i, "n_steps"))
    series = np.array(dataset.arrays()[path][start : start + size])
    series[i - start, n_steps:][place] = 0.05
    file = copy / path / f"{i // size}.0"
    file.write_bytes(packed_shard(list(series), size, ZSTD_LEVEL))
    problems = verify(copy).problems
    assert [(problem.episode, problem.array) for problem in problems] == [(i, path)]


CAMERA: dict[str, tuple[str, Any]] = {
    "a depth of nothing": ("depth", 0.0),
    "a depth beyond the range": ("depth", 1000.0),
    "a mask without a word": ("segmentation", 200),
    "more than all is visible": ("visibility", 1.5),
    "a pose that is none": ("T_world_camera", 2.0),
    "other intrinsics": ("intrinsics", 10.0),
}


@pytest.mark.parametrize("what", CAMERA)
def test_a_camera_that_cannot_be_is_named(
    copy: Path, held: tuple[int, list[Any]], what: str
) -> None:
    i, rows = held
    name, value = CAMERA[what]
    frames = rows[i % 4].cameras["front"]
    wrong = getattr(frames, name).copy()
    wrong.flat[0] = value
    cameras = {"front": replace(frames, **{name: wrong})}
    rows = [replace(row, cameras=cameras) if row.spec.index == i else row for row in rows]
    replace_block(copy, i // 4, rows, [HERE.text] * len(rows))
    assert [(problem.episode, problem.array) for problem in verify(copy).problems
            if not problem.array.startswith(FOLDER)] == [(i, f"cameras/front/{name}")]  # fmt: skip


class TestFingerprints:
    @pytest.mark.parametrize("text", [HERE.text[:-1] + "x", str(HERE), "nonsense", ""])
    def test_a_text_that_is_damaged_or_lost_is_a_problem_of_its_row(
        self, copy: Path, text: str
    ) -> None:
        shutil.rmtree(copy / FOLDER)
        quarantined = int(np.flatnonzero(Dataset(copy).status == 2)[0])
        for row in (4, quarantined):
            set_texts(copy, {row: text})
            (problem,) = verify(copy).problems
            assert (problem.episode, problem.array) == (row, "episodes/fingerprint")
            with pytest.raises(StoreError, match=f"episode {row} is damaged"):
                Dataset(copy, checked=True).column("fingerprint")
            set_texts(copy, {row: HERE.text})

    def test_rows_of_another_platform_are_counted_in_one_note(self, copy: Path) -> None:
        shutil.rmtree(copy / FOLDER)
        set_texts(copy, {1: THERE.text, 6: THERE.text})
        report = verify(copy)
        assert report.is_whole
        what = "the fingerprint differs from the store's in engine (simulation steps)"
        assert report.notes == (f"2 rows of other platforms: {what}",)

    def test_a_store_that_was_made_elsewhere_is_whole_without_a_note(self, copy: Path) -> None:
        shutil.rmtree(copy / FOLDER)
        report = verify(made_there(copy, N))
        assert report.is_whole
        assert report.notes == ()

    def test_a_store_of_a_version_without_fingerprints_is_whole(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store = old_store(tmp_path)
        made_here_but_for_our_version(store, monkeypatch)
        report = verify(store)
        assert (report.committed, report.quarantined, report.notes) == (3, 1, ())
        assert report.is_whole
        assert report.changed == (f"grasp_factory: 0.4.0, now {__version__}",)


class TestDeep:
    def test_episodes_are_simulated_again_and_are_the_same(self, store: Path) -> None:
        report = verify(store, deep=2, deep_seed=5)
        assert report.is_whole
        assert report.deep_seed == 5
        assert len(report.simulated) == 2
        assert verify(store, deep=2, deep_seed=5).simulated == report.simulated

    def test_the_seed_is_told_when_none_is_given(self, store: Path) -> None:
        report = verify(store, deep=1)
        assert verify(store, deep=1, deep_seed=report.deep_seed).simulated == report.simulated

    def test_what_the_recipe_does_not_give_is_named_with_what_has_changed(
        self, copy: Path, held: tuple[int, list[Any]], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        i, rows = held
        frames = rows[i % 4].cameras["front"]
        rgb = frames.rgb.copy()
        rgb[0, 0, 0, 0] ^= 1
        cameras = {"front": replace(frames, rgb=rgb)}
        rows = [replace(row, cameras=cameras) if row.spec.index == i else row for row in rows]
        shutil.rmtree(copy / FOLDER)
        replace_block(copy, i // 4, rows, [HERE.text] * len(rows))
        assert verify(copy).is_whole
        (problem,) = verify(copy, deep=N).problems
        assert (problem.episode, problem.array) == (i, "cameras/front/rgb")
        monkeypatch.setattr("grasp_factory.core.machine.platform.machine", lambda: "abacus")
        report = verify(copy, deep=N)
        assert any("abacus" in change for change in report.changed)
        assert "abacus" in report.problems[0].what

    @pytest.mark.soak
    def test_a_difference_under_another_fingerprint_is_a_note_and_no_damage(
        self, copy: Path, held: tuple[int, list[Any]], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        i, rows = held
        frames = rows[i % 4].cameras["front"]
        cameras = {"front": replace(frames, rgb=frames.rgb ^ 1)}
        rows = [replace(row, cameras=cameras) if row.spec.index == i else row for row in rows]
        shutil.rmtree(copy / FOLDER)
        replace_block(copy, i // 4, rows, [HERE.text] * len(rows))
        same = "fingerprint and versions are the recording's"
        assert same in verify(copy, deep=N).problems[0].what
        move(monkeypatch)
        report = verify(copy, deep=N)
        assert report.is_whole
        (note,) = report.notes
        assert f"{report.committed} of {report.committed} episodes simulated again" in note
        assert "differs in engine (simulation steps)" in note
        assert f"; episodes that differ here, and are whole as stored: {i}" in note

    def test_that_none_differs_on_another_platform_is_told_in_a_note(
        self, copy: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        move(monkeypatch)
        report = verify(copy, deep=1)
        assert report.is_whole
        assert [note.rpartition("; ")[2] for note in report.notes] == ["none differs here"]

    def test_rows_are_drawn_without_repeating(self) -> None:
        assert draw([3, 5, 9], 10, 0) == (3, 5, 9)
        assert draw([], 3, 0) == ()
        assert {len(set(draw(list(range(9)), 4, seed))) for seed in range(20)} == {4}
        assert len({draw(list(range(9)), 4, seed) for seed in range(20)}) > 5

    @pytest.mark.parametrize("numbers", [{"deep": -1}, {"workers": 0}, {"deep_seed": -1}])
    def test_numbers_that_are_none_are_usage_errors(
        self, store: Path, numbers: dict[str, Any]
    ) -> None:
        with pytest.raises(UsageError, match=next(iter(numbers))):
            verify(store, **numbers)


class TestTheCommand:
    def test_says_that_all_is_well_and_exits_with_0(self, store: Path, run: Any) -> None:
        code, out, err = run("verify", store)
        assert (code, err) == (0, "")
        assert "no problems found" in out

    def test_names_every_problem_and_exits_with_1(self, copy: Path, run: Any) -> None:
        delete("streams/phase/0.0")(copy)
        code, out, _ = run("verify", copy)
        assert code == 1
        assert "streams/phase: file 0.0 is missing, which has rows 0 to 3; run grasp-f" in out

    def test_prints_json_with_all_of_it(self, copy: Path, run: Any) -> None:
        delete("episodes/spec/0")(copy)
        code, out, _ = run("verify", copy, "--json", "--deep", 1, "--deep-seed", 3)
        found = json.loads(out)
        assert code == 1
        assert not found["is_whole"]
        assert found["deep_seed"] == 3
        assert {p["array"] for p in found["problems"]} == {"episodes/spec"}
        assert set(found["problems"][0]) == {"episode", "array", "what", "advice"}

    def test_text_is_cut_after_50_problems(
        self, copy: Path, run: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("grasp_factory.cli.verify.MOST_LINES", 2)
        for block in range(3):
            delete(f"episodes/spec/{block}")(copy)
        problems = len(verify(copy).problems)
        assert f"and {problems - 2} more" in run("verify", copy)[1]

    def test_exits_with_2_where_there_is_no_store(self, tmp_path: Path, run: Any) -> None:
        code, out, err = run("verify", tmp_path / "none")
        assert (code, out) == (2, "")
        assert err.startswith("Error: there is no store")


class TestNumbers:
    def test_gaps_are_where_the_schema_has_them(self) -> None:
        gaps = {field.path for field in FIELDS if field.gaps}
        assert all(np.dtype(field.dtype).kind == "f" for field in FIELDS if field.gaps)
        for field in FIELDS:
            if field.dtype == "string" or np.dtype(field.dtype).kind != "f":
                continue
            for bad, is_refused in ((NAN, field.path not in gaps), (INF, True), (0.0, False)):
                contents = {field.path: np.array([1.0, bad])}
                assert (non_finite(contents, FIELDS) == field.path) is is_refused

    def test_the_first_array_is_named(self) -> None:
        contents = {"a": np.array([1]), "b": np.array([INF]), "c": np.array([NAN])}
        assert non_finite(contents, FIELDS) == "b"
        assert non_finite({}, FIELDS) == ""
