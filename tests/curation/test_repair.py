"""Repairing: what verify finds is made again, byte for byte, and nothing whole is touched."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.damage import (
    CONFIG,
    LABEL,
    SEGMENT_BLOCKS,
    Damage,
    N,
    cut,
    delete,
    empty,
    lengthen,
    make_store,
    swap,
)
from support.elsewhere import HERE, THERE, move, set_attributes, set_texts
from support.helpers import assert_same_tree, tree
from support.hostile.table import coded
from support.places import REPOSITORY
from support.sabotage import SABOTAGE
from support.scale import IS_SOAK, sampled, scaled, soak_only
from support.stored import old_store

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import LOST
from grasp_factory.core.os_errors import HOW_TO_CONTINUE
from grasp_factory.core.place import place_at, place_of
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.curation.merge import split
from grasp_factory.curation.repair import rebuild, recovery, refusals, repair
from grasp_factory.curation.repair.refusals import check_losses
from grasp_factory.curation.verify import verify
from grasp_factory.curation.verify.partial_store import open_pieces
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import (
    GraspFactoryError,
    GraspFactoryWarning,
    LimitError,
    StoreBusyError,
    StoreError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.factory.block_maker import BlockMaker
from grasp_factory.factory.generate import generate
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr import layout, segment_packing
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.metadata_checksum import seal, set_rows
from grasp_factory.writers.zarr.writer import COMMITTED

pytestmark = pytest.mark.slow

PACKED = "packed/0-1.npz"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store that no test changes."""
    return make_store(tmp_path_factory.mktemp("repair") / "store")


@pytest.fixture
def copy(store: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(store, tmp_path / "store"))


@pytest.fixture(autouse=True)
def small_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", SEGMENT_BLOCKS)


def no_simulation(*_: Any) -> Any:
    raise AssertionError("an episode was simulated")


DAMAGES: dict[str, Damage] = {
    "a stream that is cut": cut("streams/tcp_pose/1.0.0"),
    "images that are deleted": delete("cameras/front/rgb/0.0.0.0.0"),
    "a depth shard that is empty": empty("cameras/front/depth/2.0.0.0"),
    "a video that is deleted": delete("videos/front/rgb/0.0.0.0.0"),
    "a commit marker that is deleted": delete("episodes/status/1"),
    "a commit marker that is cut": cut("episodes/status/0"),
    "checksums that are deleted": delete("episodes/checksum/2"),
    "digests that are cut": cut("episodes/array_crc32c/0.0"),
    "recipes that are longer": lengthen("episodes/spec/1"),
    "lengths that are deleted": delete("episodes/n_steps/0"),
    "reasons that are deleted": delete("episodes/error/0"),
    "reasons of none that are deleted": delete("episodes/error/2"),
    "shards of two blocks swapped": swap("streams/phase/0.0", "streams/phase/1.0"),
    "shards of two arrays swapped": swap(
        "streams/joint_positions/0.0.0", "streams/joint_torques/0.0.0"
    ),
    "shards of unlike arrays swapped": swap("streams/phase/0.0", "streams/reward/0.0"),
    "commit markers swapped": swap("episodes/status/0", "episodes/status/2"),
    "checksums swapped": swap("episodes/checksum/0", "episodes/checksum/1"),
    "metadata that is cut": cut("streams/phase/zarr.json"),
    "metadata that is deleted": delete("episodes/status/zarr.json"),
    "metadata of digests that is deleted": delete("episodes/array_crc32c/zarr.json"),
    "metadata of two arrays swapped": swap(
        "episodes/status/zarr.json", "episodes/checksum/zarr.json"
    ),
    "metadata of a group that is empty": empty("cameras/front/zarr.json"),
    "a label that is cut": cut(f"labels/{LABEL}/outcome/c/0"),
    "a label's metadata that is deleted": delete(f"labels/{LABEL}/success/zarr.json"),
    "metadata of labels that is cut": cut("labels/zarr.json"),
    "a segment that is cut": cut(PACKED),
    "a segment that is deleted": delete(PACKED),
    "metadata of segments that is empty": empty("packed/zarr.json"),
}


@pytest.mark.parametrize("what", sampled(DAMAGES, 6))
def test_damage_is_found_and_mended_to_the_same_bytes(store: Path, copy: Path, what: str) -> None:
    DAMAGES[what](copy)
    result = repair(copy)
    assert result.failed == ()
    assert result.is_whole
    assert all(made.is_same is not False for made in result.remade)
    if what == "a segment that is deleted":  # which is no damage
        segment_packing.pack(copy)
    else:
        assert result.before.problems
        assert result.mended or result.remade
    assert_same_tree(store, copy)


@pytest.mark.soak
def test_everything_at_once_is_mended(store: Path, copy: Path) -> None:
    delete("episodes/zarr.json")(copy)
    delete("streams/tcp_pose/zarr.json")(copy)
    for name in ("streams/tcp_pose/0.0.0", "episodes/spec/1", "episodes/status/2"):
        delete(name)(copy)
    cut(PACKED)(copy)
    empty(f"labels/{LABEL}/success/c/0")(copy)
    assert repair(copy, workers=2).is_whole
    assert_same_tree(store, copy)


def test_a_whole_store_is_not_touched(
    store: Path, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp_factory.factory.block_maker.run_episode", no_simulation)
    times = {file: file.stat().st_mtime_ns for file in copy.rglob("*")}
    result = repair(copy)
    assert result.is_whole
    assert (result.mended, result.failed, result.remade) == ((), (), ())
    assert {file: file.stat().st_mtime_ns for file in copy.rglob("*")} == times


def test_episodes_that_are_whole_are_not_simulated(store: Path, copy: Path) -> None:
    for name in ("episodes/status/0", "episodes/checksum/1", "episodes/array_crc32c/2.0"):
        delete(name)(copy)
    result = repair(copy)
    assert result.is_whole
    committed = Dataset(store).column("status") == COMMITTED
    assert not any(committed[made.episode] for made in result.remade)
    assert_same_tree(store, copy)


def test_only_broken_rows_of_a_block_are_simulated(store: Path, copy: Path) -> None:
    file = copy / "streams/tcp_pose/1.0.0"
    data = bytearray(file.read_bytes())
    data[20] ^= 0xFF
    file.write_bytes(data)
    (broken,) = {problem.episode for problem in verify(copy).problems}
    assert [made.episode for made in repair(copy).remade] == [broken]
    assert_same_tree(store, copy)


def test_missing_rows_are_made(store: Path, copy: Path) -> None:
    for folder in copy.rglob("*"):
        if folder.is_dir() and "packed" not in folder.parts and LABEL not in folder.parts:
            for file in folder.glob("1" if "videos/front" not in str(folder) else "[4567].*"):
                file.unlink()
            for file in folder.glob("1.*" if "videos/front" not in str(folder) else "none"):
                file.unlink()
    result = repair(copy)
    assert result.is_whole
    assert {made.episode for made in result.remade} == {4, 5, 6, 7}
    assert {made.is_same for made in result.remade} == {None}
    assert_same_tree(store, copy)


@pytest.mark.parametrize(("lost", "rows", "is_refused"), [
    (30, 30, False), (31, 31, True), (80, 80, True), (80, 130, False), (1001, 5000, True),
])  # fmt: skip
def test_far_more_lost_rows_than_whole_ones_are_not_simulated(
    *, lost: int, rows: int, is_refused: bool
) -> None:
    with pytest.raises(LimitError) if is_refused else contextlib.nullcontext():
        check_losses(Path("s.zarr"), lost, rows)


def test_all_rows_that_would_be_simulated_are_counted_before_a_recipe_is_sampled(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(refusals, "LOST", dataclasses.replace(LOST, usual=0))
    monkeypatch.setattr(recovery, "sample_spec", lambda config, index: pytest.fail("sampled"))
    for block in (0, 1):
        (copy / f"streams/tcp_pose/{block}.0.0").unlink()
    with pytest.raises(LimitError, match="a number of lost rows beyond that of whole ones"):
        repair(copy)


def test_what_killed_runs_have_left_is_removed_and_nothing_else(store: Path, copy: Path) -> None:
    for name in ("streams/phase/0.0.partial", "labels/.x.creating/zarr.json"):
        (copy / name).parent.mkdir(exist_ok=True)
        (copy / name).write_text("x")
    (copy / "mine.txt").write_text("x")
    (copy / "mine.partial").write_text("x")
    assert repair(copy).is_whole
    for mine in ("mine.txt", "mine.partial"):
        (copy / mine).unlink()
    assert_same_tree(store, copy)


def documents(store: Path) -> list[Path]:
    """Return the metadata of all arrays and groups of the rows."""
    names = [file.relative_to(store) for file in store.rglob("zarr.json")]
    return [
        store / name for name in names if name.parts[0] not in ("zarr.json", "labels", "packed")
    ]


class TestTheNumberOfRows:
    """It is in nothing but the arrays' metadata, where no seal holds it."""

    def test_is_told_by_the_blocks_where_all_metadata_is_lost(
        self, store: Path, copy: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("grasp_factory.factory.block_maker.run_episode", no_simulation)
        for file in documents(copy):
            file.unlink()
        assert verify(copy).episodes == N
        assert repair(copy).is_whole
        assert_same_tree(store, copy)

    @pytest.mark.parametrize("rows", [0, 4, 9])
    def test_is_never_below_what_the_blocks_hold(
        self, store: Path, copy: Path, monkeypatch: pytest.MonkeyPatch, rows: int
    ) -> None:
        monkeypatch.setattr("grasp_factory.factory.block_maker.run_episode", no_simulation)
        for file in documents(copy):
            if "shape" in json.loads(file.read_bytes()):
                set_rows(place_at(file), rows)
        found = verify(copy)
        assert found.episodes == N
        assert f"{rows} rows, the store has {N}" in str(found.problems[0])
        assert repair(copy).is_whole
        assert_same_tree(store, copy)

    def test_is_not_guessed(self, copy: Path, run: Any) -> None:
        for file in documents(copy):
            file.unlink()
        for name in ("status", "checksum", "spec", "seed", "index"):
            cut(f"episodes/{name}/2")(copy)
        before = tree(copy)
        code, out, err = run("repair", copy)
        assert code == 1
        assert "the number of rows cannot be told" in out + err
        assert tree(copy) == before

    def test_of_no_files_at_all_is_not_none(self, copy: Path) -> None:
        shutil.copy(copy / "zarr.json", copy.parent / "root")
        shutil.rmtree(copy)
        copy.mkdir()
        shutil.move(copy.parent / "root", copy / "zarr.json")
        assert not verify(copy).is_whole
        with pytest.raises(StoreError, match="there are no files of blocks"):
            repair(copy)

    def test_is_not_that_of_a_file_that_somebody_has_put_there(self, copy: Path) -> None:
        shutil.copy(copy / "episodes/status/0", copy / "episodes/status/7")
        assert verify(copy).episodes == N


def quarantined(store: Path) -> tuple[int, int]:
    """Return a row that is quarantined beside one that is not, and the number of its block."""
    status = Dataset(store).column("status")
    for i in range(N):
        block = status[i // 4 * 4 : i // 4 * 4 + 4]
        if status[i] == 2 and 1 in block:
            return i, i // 4
    raise AssertionError("no block has both")


@pytest.mark.usefixtures("isolated")
@pytest.mark.parametrize("is_marked", [False, *soak_only(True)])
def test_rows_beside_a_broken_quarantine_are_kept(
    store: Path, copy: Path, monkeypatch: pytest.MonkeyPatch, *, is_marked: bool
) -> None:
    row, block = quarantined(store)
    monkeypatch.setattr(
        "grasp_factory.factory.block_maker.run_episode", no_simulation
    )  # not here: in a worker
    monkeypatch.setattr(sys.modules["grasp_factory.factory.generate"], "generate", no_simulation)
    zarr.open_array(copy / "episodes/error", mode="r+")[row] = "another"
    if not is_marked:
        for name in ("status", "checksum"):
            delete(f"episodes/{name}/{block}")(copy)
    result = repair(copy)
    status = Dataset(store).column("status")[block * 4 : block * 4 + 4]
    lost = {block * 4 + k for k in range(len(status)) if status[k] == 2}
    assert {made.episode for made in result.remade} == ({row} if is_marked else lost)
    assert result.is_whole
    assert_same_tree(store, copy)


@pytest.mark.soak
def test_a_recipe_that_kills_its_worker_is_quarantined_again(copy: Path, tmp_path: Path) -> None:
    row, block = quarantined(copy)
    file = copy / "episodes/error" / str(block)
    file.write_bytes(file.read_bytes()[:-5])
    place = tmp_path / "site"
    place.mkdir()
    deeds = f"if spec.index == {row}: os.kill(os.getpid(), signal.SIGKILL)"
    (place / "sitecustomize.py").write_text(SABOTAGE.format(deeds=deeds))
    subprocess.run(
        [sys.executable, "-m", "grasp_factory", "repair", str(copy), "--workers", "1"],
        env=os.environ | {"PYTHONPATH": f"{place}:{REPOSITORY}"},
        check=True,
    )
    assert Dataset(copy).column("error")[row] == "its worker was lost twice (SIGKILL)"


@pytest.mark.parametrize("is_whole", [True, False])
def test_what_a_killed_repair_has_left_is_removed(store: Path, copy: Path, is_whole: bool) -> None:
    template = copy.with_name(f".{copy.name}.repairing")
    for left in (template, template.with_name(f".{template.name}.creating")):
        left.mkdir()
        shutil.copy(copy / "zarr.json", left)
    if not is_whole:
        delete("streams/zarr.json")(copy)
    assert repair(copy).is_whole
    assert [file.name for file in copy.parent.iterdir() if "repairing" in file.name] == []
    assert_same_tree(store, copy)


def test_a_full_disk_is_said_with_what_stays(
    copy: Path, monkeypatch: pytest.MonkeyPatch, run: Any
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("grasp_factory.curation.repair.template.Template.give_files", full)
    delete("episodes/status/0")(copy)
    before = tree(copy)
    code, _, err = run("repair", copy, "--workers", 1)
    assert code == 1
    assert err == f"Error: {copy}: {os.strerror(errno.ENOSPC)}; {HOW_TO_CONTINUE}\n"
    kept = {name: data for name, data in before.items() if not name.startswith("packed/")}
    assert kept.items() <= tree(copy).items()  # segments are derived


class TestTheRoot:
    def test_that_says_something_else_is_mended_where_that_is_certain(
        self, store: Path, copy: Path
    ) -> None:
        text = (copy / "zarr.json").read_text()
        for a, b in (('"license": "MIT"', '"license": "BSD"'), ('_sha256": "', '_sha256": "f')):
            (copy / "zarr.json").write_text(text.replace(a, b))
            if '"config_sha256": "f' in (copy / "zarr.json").read_text():
                (copy / "zarr.json").write_text(text.replace('data_sha256": "', 'data_sha256": "f'))
            assert repair(copy).is_whole
            assert_same_tree(store, copy)

    def test_is_left_alone_where_it_is_not(self, copy: Path) -> None:
        cut("zarr.json")(copy)
        before = tree(copy)
        result = repair(copy)
        assert not result.is_whole
        assert "copy its zarr.json" in result.failed[0]
        assert tree(copy) == before

    def test_is_mended_by_a_copy_of_an_empty_store_of_the_same_command(
        self, store: Path, copy: Path, tmp_path: Path
    ) -> None:
        delete("zarr.json")(copy)
        generate(CONFIG, 1, tmp_path / "other", workers=1, max_failures=1.0)
        shutil.copy(tmp_path / "other" / "zarr.json", copy / "zarr.json")
        assert verify(copy).is_whole
        assert_same_tree(store, copy)


def test_metadata_is_not_made_again_by_a_version_that_writes_it_otherwise(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut("streams/phase/zarr.json")(copy)
    before = tree(copy)
    monkeypatch.setitem(layout._ZSTD["configuration"], "level", 9)
    result = repair(copy)
    assert not result.is_whole
    assert "is not as this version writes it" in result.failed[0]
    assert tree(copy) == before


def test_rows_are_not_simulated_for_arrays_in_another_layout(copy: Path) -> None:
    gzip = [{"name": "vlen-utf8"}, {"name": "gzip", "configuration": {"level": 5}}]
    coded("episodes/checksum", gzip)(copy, copy)
    before = tree(copy)
    result = repair(copy)
    assert result.remade == ()
    assert result.failed == (
        "rows stay as they are, for episodes/checksum has other chunks or codecs than this version"
        " writes: take what is whole into a new store with grasp-factory split",
    )
    assert tree(copy) == before


@pytest.mark.parametrize(
    "change",
    [
        lambda paths: paths[:-1],
        lambda paths: [*paths[:-1], paths[0]],
        lambda paths: [[path] for path in paths],
        len,
    ],
    ids=["one less", "one twice", "no texts", "no list"],
)
def test_a_list_of_arrays_with_digests_that_is_no_such_list_is_named_and_made_again(
    store: Path, copy: Path, tmp_path: Path, change: Callable[[list[str]], Any]
) -> None:
    file = copy / "episodes" / "array_crc32c" / "zarr.json"
    document = json.loads(file.read_bytes())
    document["attributes"]["arrays"] = change(document["attributes"]["arrays"])
    file.write_text(json.dumps(document))
    seal(place_at(file))
    (problem,) = verify(copy).problems
    assert problem.what == "zarr.json does not list the array of each column"
    with pytest.raises(StoreError, match="no checksums of single arrays"):
        Dataset(copy, checked=True)
    with pytest.warns(GraspFactoryWarning, match="array_crc32c does not name its arrays"):
        assert split(copy, tmp_path / "part", [0]).committed == 1
    assert repair(copy).is_whole
    assert_same_tree(store, copy)


def test_it_is_said_when_an_episode_comes_out_otherwise(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(*args: Any) -> Any:
        episode = run_episode(*args)
        return dataclasses.replace(episode, columns={**episode.columns, "grasp_score": 12.5})

    monkeypatch.setattr("grasp_factory.factory.block_maker.run_episode", other)
    delete("streams/phase/2.0")(copy)
    result = repair(copy)
    assert result.is_whole
    assert {made.is_same for made in result.remade} == {False}
    assert Dataset(copy).value(result.remade[0].episode, "grasp_score") == 12.5


class TestAnAddedLabel:
    def test_without_thresholds_stays_with_advice(self, copy: Path, run: Any) -> None:
        for part in ("", "outcome/", "success/"):
            empty(f"labels/{LABEL}/{part}zarr.json")(copy)
        before = tree(copy)
        code, out, _ = run("repair", copy)
        assert code == 1
        assert f"delete {copy / 'labels' / LABEL}, and run grasp-factory relabel" in out
        assert tree(copy) == before

    def test_is_made_again_beside_what_people_keep_there(self, store: Path, copy: Path) -> None:
        notes = [copy / "labels" / name for name in (f"{LABEL}/notes.txt", "mine/notes.txt")]
        for note in notes:
            note.parent.mkdir(exist_ok=True)
            note.write_text("x")
        cut(f"labels/{LABEL}/outcome/c/0")(copy)
        assert repair(copy).is_whole
        assert [note.read_text() for note in notes] == ["x", "x"]
        shutil.rmtree(notes[1].parent)
        notes[0].unlink()
        assert_same_tree(store, copy)

    def test_of_a_repair_that_was_killed_comes_back(self, store: Path, copy: Path) -> None:
        (copy / "labels" / LABEL).rename(copy / "labels" / f".{LABEL}.damaged")
        assert repair(copy).is_whole
        assert_same_tree(store, copy)


class TestACollectedStore:
    @pytest.fixture
    def collected(self, store: Path, tmp_path: Path) -> Path:
        rows = Dataset(store).committed[1:].tolist()
        split(store, tmp_path / "part", rows)
        return tmp_path / "part"

    @pytest.mark.parametrize(
        "name",
        [
            "streams/phase/0.0",
            "episodes/status/0 episodes/checksum/0",
            *soak_only(
                "episodes/spec/0",
                "episodes/seed/0",
                "episodes/status/0",
                "episodes/checksum/1",
                "episodes/array_crc32c/0.0",
                "streams/phase/zarr.json",
            ),
        ],
    )
    def test_is_mended_from_the_recipes_of_its_rows(
        self, collected: Path, tmp_path: Path, name: str
    ) -> None:
        before = Path(shutil.copytree(collected, tmp_path / "before"))
        assert verify(collected).is_whole
        for file in name.split():
            delete(file)(collected)
        result = repair(collected)
        assert (result.is_whole, result.failed) == (True, ())
        assert_same_tree(before, collected)

    def test_whose_recipes_are_lost_is_left_as_it_is(self, collected: Path) -> None:
        for name in ("spec", "seed", "index"):
            delete(f"episodes/{name}/0")(collected)
        before = tree(collected)
        result = repair(collected)
        assert not result.is_whole
        assert "nothing is left that tells the recipe" in result.failed[0]
        assert tree(collected) == before


def test_a_store_that_is_being_written_is_not_repaired(copy: Path) -> None:
    delete("streams/phase/0.0")(copy)
    with StoreLock(copy), pytest.raises(StoreBusyError):
        repair(copy)


def test_something_in_the_place_of_the_template_is_not_removed(copy: Path) -> None:
    delete("streams/phase/0.0")(copy)
    place = copy.with_name(f".{copy.name}.repairing")
    place.mkdir()
    (place / "mine").write_text("x")
    with pytest.raises(StoreMismatchError, match="in the way"):
        repair(copy)
    assert (place / "mine").exists()


def files_of(store: Path) -> set[str]:
    """Return the files of rows and their metadata that are whole, which none under .partial is."""
    files = (file for file in store.rglob("*") if file.is_file() and file.suffix != ".partial")
    names = {str(file.relative_to(store)) for file in files}
    return {name for name in names if not name.startswith(("packed/", "labels/"))}


KILLED = """
import sys
from grasp_factory.curation.repair import repair
repair(sys.argv[1])
"""


@pytest.mark.filterwarnings("ignore::grasp_factory.errors.StaleLockWarning")
def test_a_repair_that_is_killed_loses_nothing_and_can_be_run_again(
    store: Path, tmp_path: Path
) -> None:
    killed_at_work = 0
    for number in range(scaled(2, 8)):
        copy = Path(shutil.copytree(store, tmp_path / f"store{number}"))
        for name in ("streams/phase/0.0", "episodes/status/1", "episodes/error/1", "imu/zarr.json"):
            delete(name)(copy)
        damaged = files_of(copy)
        process = subprocess.Popen([sys.executable, "-c", KILLED, str(copy)])
        template = copy.with_name(f".{copy.name}.repairing")
        while not template.exists() and process.poll() is None:
            time.sleep(0.01)
        time.sleep(0.1 * number)
        process.send_signal(signal.SIGKILL)
        killed_at_work += process.wait() == -signal.SIGKILL
        left = files_of(copy)
        assert damaged <= left  # no file is gone, and each of them is what it was
        assert all((copy / file).read_bytes() == (store / file).read_bytes() for file in left)
        assert repair(copy).is_whole
        segment_packing.pack(
            copy
        )  # as many blocks to a segment as here, which the command does not do
        assert_same_tree(store, copy)
        assert list(tmp_path.glob(f".*store{number}*")) == []
    assert killed_at_work > 0


class TestTheCommand:
    def test_says_what_it_did_and_exits_with_0(self, store: Path, copy: Path, run: Any) -> None:
        delete("streams/phase/2.0")(copy)
        code, out, err = run("repair", copy, "--workers", 1)
        assert (code, err) == (0, "")
        assert "rows 8 to 9 are whole again" in out
        assert "with the same bytes as before" in out
        assert "no problems left" in out
        assert "nothing to repair" in run("repair", copy)[1]

    def test_exits_with_1_when_something_is_left(self, copy: Path, run: Any) -> None:
        cut("zarr.json")(copy)
        code, out, _ = run("repair", copy)
        assert code == 1
        assert "failed: zarr.json of the root cannot be made again" in out

    def test_prints_json(self, copy: Path, run: Any) -> None:
        delete("streams/phase/2.0")(copy)
        code, out, _ = run("repair", copy, "--json", "--workers", 1)
        found = json.loads(out)
        assert (code, found["is_whole"]) == (0, True)
        assert [made["episode"] for made in found["remade"]] == [8, 9]
        assert found["remade"][0]["is_same"]
        assert found["before"]["problems"]
        assert not found["after"]["problems"]


WORDS = st.sampled_from(["", "x", "zarr", "float32", "string", "NaN", "regular", "..", "labels"])
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(), WORDS, st.just([]),
    st.just({}), st.just([10**9, 10**9]), st.just({"name": "x"}),
)  # fmt: skip


@st.composite
def mutations(draw: st.DrawFn, document: Any) -> Any:
    """Draw a document in which something is another, is missing, or is more."""
    document = json.loads(json.dumps(document))
    node = document
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        if not keys:
            return draw(SCALARS)
        key = draw(st.sampled_from(keys))
        below = node[key]
        if isinstance(below, dict | list) and below and draw(st.integers(0, 3)):
            node = below
            continue
        match draw(st.integers(0, 3)):
            case 0:
                del node[key]
            case 1 if isinstance(node, dict):
                node[draw(WORDS)] = node.pop(key)
            case _:
                node[key] = draw(SCALARS)
        return document


DOCUMENTS = (
    "zarr.json",
    "streams/zarr.json",
    "streams/phase/zarr.json",
    "episodes/status/zarr.json",
    "episodes/spec/zarr.json",
    "episodes/array_crc32c/zarr.json",
    "cameras/front/depth/zarr.json",
    "videos/front/rgb/zarr.json",
    "labels/zarr.json",
    f"labels/{LABEL}/zarr.json",
    f"labels/{LABEL}/outcome/zarr.json",
    "packed/zarr.json",
)


@pytest.fixture(scope="module")
def scratch(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(store, tmp_path_factory.mktemp("mutated") / "store"))


def text(document: Any) -> str:
    """Return a document as text: True and 1 are equal otherwise."""
    return json.dumps(document, sort_keys=True)


def read_all(path: Path) -> None:
    dataset = Dataset(path)
    summarise(dataset)
    for name in dataset.columns:
        dataset.column(name)
    for i in dataset.committed[:3]:
        dataset[int(i)]
    for name in dataset.labels:
        dataset.label(name)
    dataset.arrays()


@pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")
@pytest.mark.parametrize("name", sampled(DOCUMENTS, 4))
@settings(max_examples=scaled(4, 20), suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_metadata_of_any_kind_is_an_error_of_ours_or_harmless(
    store: Path, scratch: Path, name: str, data: st.DataObject
) -> None:
    whole = (store / name).read_bytes()
    document = data.draw(mutations(json.loads(whole)))
    (scratch / name).write_text(json.dumps(document))
    try:
        try:
            read_all(scratch)
        except (StoreError, UsageError):
            pass
        try:
            report = verify(scratch)
            # Words that say no more than how the same values are stored may be another program's.
            is_anew = any("the values are those that were written" in n for n in report.notes)
            is_same = text(document) == text(json.loads(whole))
            assert report.is_whole == (is_same or is_anew)
        except StoreMismatchError:
            assert name == "zarr.json"
    finally:
        (scratch / name).write_bytes(whole)


@pytest.mark.parametrize("name", sampled(DOCUMENTS, 4))
def test_metadata_of_any_kind_is_mended_or_left(store: Path, tmp_path: Path, name: str) -> None:
    """The same for what writes; a mutation of each kind, for each is a repair."""
    whole = json.loads((store / name).read_bytes())
    documents: list[Any] = [[], {}, {**whole, "shape": [0]}, {**whole, "attributes": {}}]
    if not IS_SOAK:
        documents = [documents[DOCUMENTS.index(name) % len(documents)]]
    for number, wrong in enumerate(documents):
        if wrong == whole:
            continue
        copy = Path(shutil.copytree(store, tmp_path / str(number)))
        (copy / name).write_text(json.dumps(wrong))
        before = tree(copy)
        try:
            generate(CONFIG, N, copy, workers=1, max_failures=1.0)
        except GraspFactoryError:
            assert tree(copy) == before
        try:
            mended = repair(copy).is_whole
        except GraspFactoryError:
            assert tree(copy) == before
        else:
            assert mended or name == "zarr.json"
            if mended:
                assert_same_tree(store, copy)


def test_a_config_that_is_another_is_refused(copy: Path) -> None:
    other = FactoryConfig.from_plain(CONFIG.to_plain() | {"seed": 9})
    with pytest.raises(StoreMismatchError):
        generate(other, N, copy, workers=1)


class TestOnAnotherPlatform:
    @pytest.fixture
    def broken(self, copy: Path) -> Path:
        """Return a copy without packed columns, of which row 5 is damaged."""
        shutil.rmtree(copy / "packed")
        cut("streams/tcp_pose/1.0.0")(copy)
        return copy

    def test_what_is_to_be_simulated_is_left_unless_that_is_accepted(
        self, broken: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        move(monkeypatch)
        before = tree(broken)
        result = repair(broken)
        assert not result.is_whole
        (line,) = result.failed
        assert "of another platform and are not simulated here: the fingerprint differs in" in line
        assert "engine (simulation steps); repair where they were made, or add --accept" in line
        assert {name: data for name, data in tree(broken).items() if "packed" not in name} == before

    def test_accepted_the_rows_that_were_remade_say_so_and_the_others_do_not(
        self, broken: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        checksums = Dataset(broken).column("checksum").tolist()
        move(monkeypatch)
        result = repair(broken, accept_other_platform=True)
        assert result.is_whole
        remade = {made.episode for made in result.remade}
        assert remade
        dataset = Dataset(broken)
        assert dataset.column("fingerprint").tolist() == [
            THERE.text if row in remade else HERE.text for row in range(N)
        ]
        assert dataset.column("checksum").tolist() == checksums
        assert any("are of this platform now: the fingerprint" in line for line in result.mended)

    def test_what_no_simulation_needs_is_mended_all_the_same(
        self, broken: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        delete("imu/timestamp/zarr.json")(broken)
        move(monkeypatch)
        result = repair(broken)
        assert "imu/timestamp/zarr.json is made again" in result.mended
        assert {problem.episode for problem in result.after.problems} <= set(range(4, 8))

    def test_rows_of_this_platform_are_simulated_in_a_store_of_another(self, broken: Path) -> None:
        set_attributes(broken, {FINGERPRINT: THERE.parts()})
        assert repair(broken).is_whole

    def test_blocks_that_are_gone_are_left_unless_that_is_accepted(
        self, copy: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for file in rebuild.files_of(place_of(copy), open_pieces(copy)[0], 1):
            file.unlink(missing_ok=True)
        move(monkeypatch)
        (line,) = repair(copy).failed
        assert "rows 4, 5, 6, 7 are of another platform and are not simulated here" in line
        assert "--accept-other-platform" in line

    def test_the_command_says_it_in_one_line_and_exits_with_1(
        self, broken: Path, monkeypatch: pytest.MonkeyPatch, run: Any
    ) -> None:
        move(monkeypatch)
        code, out, _ = run("repair", broken)
        assert code == 1
        assert out.count("--accept-other-platform") == 1
        code, out, _ = run("repair", broken, "--accept-other-platform")
        assert (code, out.splitlines()[-1]) == (0, "no problems left")


class TestAFingerprintThatIsLost:
    @pytest.mark.soak
    def test_is_this_platforms_where_the_episode_has_the_same_bytes_here(self, copy: Path) -> None:
        before = tree(copy)
        shutil.rmtree(copy / "packed")
        set_texts(copy, {1: "nonsense", 4: ""})
        result = repair(copy)
        assert result.is_whole
        assert [(made.episode, made.is_same) for made in result.remade] == [(1, True), (4, True)]
        assert Dataset(copy).column("fingerprint").tolist() == [HERE.text] * N
        assert {k for k, v in before.items() if tree(copy).get(k) != v} == set()

    @pytest.mark.soak
    def test_comes_back_with_its_file_in_one_run(self, copy: Path) -> None:
        before = tree(copy)
        shutil.rmtree(copy / "packed")
        (copy / "episodes/fingerprint/0").unlink()
        assert repair(copy).is_whole
        assert {k for k, v in before.items() if tree(copy).get(k) != v} == set()

    def test_stays_lost_where_the_episode_has_other_bytes_here(
        self, copy: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        shutil.rmtree(copy / "packed")
        set_texts(copy, {1: ""})
        monkeypatch.setattr(
            BlockMaker, "make_row", lambda self, spec, lost: Quarantined(spec, "elsewhere")
        )
        found = tree(copy)
        result = repair(copy, 1)
        assert not result.is_whole
        assert result.remade == ()
        assert (
            "are lost, and the rows have other bytes when they are simulated here"
            in (result.failed[0])
        )
        assert found.items() <= tree(copy).items()
        (problem, *_) = result.after.problems
        assert problem.array == "episodes/fingerprint"

    def test_is_not_made_up_for_a_row_that_never_had_one(self, copy: Path, tmp_path: Path) -> None:
        few = tmp_path / "few"
        split(copy, few, [0, 1])
        set_texts(few, {0: ""})
        poses = zarr.open_array(few, path="streams/tcp_pose", mode="r+")
        poses[1, 0] = np.ones(7)
        result = repair(few)
        assert result.is_whole
        assert [made.episode for made in result.remade] == [1]
        assert Dataset(few).column("fingerprint").tolist() == ["", HERE.text]


class TestAStoreOfAVersionWithoutFingerprints:
    def test_is_mended_without_simulating_and_simulated_only_if_that_is_accepted(
        self, tmp_path: Path
    ) -> None:
        store = old_store(tmp_path)
        cut("streams/tcp_pose/0.0.0")(store)
        (line,) = repair(store).failed
        assert "it was made by a version without fingerprints; repair where" in line
        assert repair(store, accept_other_platform=True).is_whole
        assert "fingerprint" not in Dataset(store).columns
