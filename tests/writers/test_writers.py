"""What the Zarr writer promises beyond the contract of every writer."""

from __future__ import annotations

import dataclasses
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from support.fake_episodes import JOINTS, make_episode, make_rows, make_spec, small_config
from support.helpers import assert_same_tree, pending_blocks, tree
from support.places import TESTS
from support.scale import scaled, soak_only

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.place import Place
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr import block_attempt
from grasp_factory.writers.zarr import writer as zarr_module
from grasp_factory.writers.zarr.block_attempt import BlockAttempt
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = pytest.mark.slow

CONFIG = small_config(block_size=2)
N = 5  # blocks 0, 1 and a short 2
ROOM = schema.sizes(CONFIG, JOINTS)["T"]


def write_all(path: Path, config: FactoryConfig, n: int, order: list[int] | None = None) -> None:
    prepare_store(path, config, JOINTS, n, {})
    writer = ZarrWriter(path)
    for block in order or pending_blocks(path, n):
        writer.write_block(block, make_rows(config, block, n, quarantined=(1,)))


def test_the_same_input_gives_the_same_bytes_in_any_order_of_blocks(tmp_path: Path) -> None:
    write_all(tmp_path / "a", CONFIG, N)
    write_all(tmp_path / "elsewhere", CONFIG, N, order=[2, 1, 0])
    assert_same_tree(tmp_path / "a", tmp_path / "elsewhere")


def test_plain_zarr_reads_it_with_units_words_and_dimension_names(tmp_path: Path) -> None:
    write_all(tmp_path / "out", CONFIG, N)
    root: Any = zarr.open(tmp_path / "out", mode="r")
    episode = make_episode(CONFIG, 0)
    np.testing.assert_array_equal(root["cameras/front/rgb"][0], episode.cameras["front"].rgb)
    assert root["cameras/front/depth"].attrs["units"] == "m"
    assert root["cameras/front/depth"].metadata.dimension_names == (
        *("episode", "depth_1"),
        *("row", "column"),
    )
    assert root["episodes/outcome"].attrs["names"][0] == "success"
    assert root["episodes/spec"][0] == episode.spec.to_json()
    assert root["episodes/status"][:].tolist() == [1, 2, 1, 1, 1]
    assert root["streams/tcp_pose"].attrs["frame"] == "world"


def test_images_have_a_frame_per_chunk_and_streams_an_episode_per_chunk(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, N, {})
    root: Any = zarr.open(tmp_path / "out", mode="r")
    rgb, torques = root["cameras/front/rgb"], root["streams/joint_torques"]
    assert (rgb.chunks, rgb.shards) == ((1, 1, 24, 32, 3), (2, 2, 24, 32, 3))
    assert (torques.chunks, torques.shards) == ((1, ROOM, 7), (2, ROOM, 7))
    assert (root["episodes/spec"].chunks, root["episodes/spec"].shards) == ((2,), None)


def test_no_codec_can_run_code(tmp_path: Path) -> None:
    write_all(tmp_path / "out", CONFIG, N)
    root: Any = zarr.open(tmp_path / "out", mode="r")
    names = set()
    for row in schema.expand(CONFIG):
        for codec in root[row.path].metadata.to_dict()["codecs"]:
            names.add(codec["name"])
            names |= {inner["name"] for inner in codec.get("configuration", {}).get("codecs", ())}
    assert names == {"bytes", "zstd", "sharding_indexed", "vlen-utf8"}


def test_streams_are_padded_with_nan_and_codes_with_no_word(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 2, {})
    rows = [make_episode(CONFIG, 0, n_steps=3), make_episode(CONFIG, 1, n_steps=ROOM)]
    ZarrWriter(tmp_path / "out").write_block(0, rows)
    streams: Any = zarr.open(tmp_path / "out", mode="r")["streams"]
    assert np.isnan(streams["tactile_force"][0, 3:]).all()
    assert (streams["phase"][0, 3:] == 255).all()
    np.testing.assert_array_equal(streams["phase"][1], rows[1].streams["phase"])


def test_rows_without_an_episode_have_no_outcome_word(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 4, {})
    ZarrWriter(tmp_path / "out").write_block(0, make_rows(CONFIG, 0, 2, quarantined=(1,)))
    episodes: Any = zarr.open(tmp_path / "out", mode="r")["episodes"]
    assert episodes["outcome"][1:].tolist() == [255, 255, 255]
    assert episodes["checksum"][2:].tolist() == ["", ""]


def test_a_reason_that_is_no_valid_text_is_kept_readable(tmp_path: Path) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 1, {})
    rows = [Quarantined(make_spec(CONFIG, 0), "file \udcff is bad")]
    ZarrWriter(tmp_path / "out").write_block(0, rows)
    assert Dataset(tmp_path / "out").column("error").tolist() == ["file ? is bad"]


def changed(**more: Any) -> Episode:
    return dataclasses.replace(make_episode(CONFIG, 0, n_steps=9), **more)


def without(mapping: Any, name: str) -> dict[str, Any]:
    return {key: value for key, value in mapping.items() if key != name}


EPISODE = make_episode(CONFIG, 0, n_steps=9)
POSE = "streams/tcp_pose"
MISFITS = {
    "a missing column": (
        changed(columns=without(EPISODE.columns, "grasp_width")),
        "episodes/grasp_width is missing",
    ),
    "an unknown column": (
        changed(columns=EPISODE.columns | {"colour": 3}),
        "episodes/colour has no array in the store",
    ),
    "a column that is the writer's": (
        changed(columns=EPISODE.columns | {"status": 1}),
        "episodes/status has no array in the store",
    ),
    "a missing camera": (changed(cameras={}), "cameras/front/rgb is missing"),
    "the wrong type": (
        changed(streams=EPISODE.streams | {"tcp_pose": np.zeros((9, 7))}),
        f"{POSE}: got float64 (9, 7), valid: float32 (9, 7)",
    ),
    "the wrong shape": (
        changed(streams=EPISODE.streams | {"tcp_pose": np.zeros((9, 6), np.float32)}),
        f"{POSE}: got float32 (9, 6), valid: float32 (9, 7)",
    ),
    "streams of unequal length": (
        changed(streams=EPISODE.streams | {"tcp_pose": np.zeros((8, 7), np.float32)}),
        f"{POSE}: got float32 (8, 7), valid: float32 (9, 7)",
    ),
    "too long an attempt": (
        make_episode(CONFIG, 0, n_steps=ROOM + 1),
        f"streams/timestamp: got float64 ({ROOM + 1},), valid: float64 ({ROOM},)",
    ),
}


@pytest.mark.parametrize("what", MISFITS)
def test_an_episode_that_does_not_fit_is_refused_and_leaves_no_trace(
    tmp_path: Path, what: str
) -> None:
    episode, message = MISFITS[what]
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 1, {})
    before = tree(tmp_path / "out")
    with pytest.raises(StoreError) as caught:
        ZarrWriter(tmp_path / "out").write_block(0, [episode])
    assert str(caught.value) == f"episode 0: {message}"
    assert tree(tmp_path / "out") == before


class Crash(Exception):
    pass


def test_a_crash_before_any_array_leaves_the_block_pending_and_redone_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_all(tmp_path / "want", CONFIG, 2)
    write_all(tmp_path / "out", CONFIG, 2)
    writer, rows = ZarrWriter(tmp_path / "out"), make_rows(CONFIG, 0, 2, quarantined=(1,))
    replace, left = Place.replace, 0

    def crash_when_none_is_left(file: Place, target: Place) -> None:
        nonlocal left
        if left == 0:
            raise Crash
        left -= 1
        replace(file, target)

    arrays = len(schema.expand(CONFIG))
    for survivors in sorted({*range(0, arrays, scaled(4, 1)), arrays - 1}):
        left = survivors
        (tmp_path / "out/episodes/status/0").unlink(missing_ok=True)  # else its rows are kept
        with monkeypatch.context() as patch, pytest.raises(Crash):
            patch.setattr(Place, "replace", crash_when_none_is_left)
            writer.write_block(0, rows)
        assert pending_blocks(tmp_path / "out", 2) == [0], f"after {survivors} arrays"
        if survivors % 8 == 0 or survivors == arrays - 1:
            writer.write_block(0, rows)
            assert_same_tree(tmp_path / "want", tmp_path / "out")


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from support.fake_episodes import make_rows, small_config
from grasp_factory.writers import ZarrWriter
writer, rows = ZarrWriter(Path({path!r})), make_rows(small_config(block_size=2), 0, 2, (1,))
left, replace = {survivors}, os.replace
def kill_when_none_is_left(*names, **folders):  # the file is written aside and gets its name now
    global left
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    left -= 1
    return replace(*names, **folders)
os.replace = kill_when_none_is_left
writer.write_block(0, rows)
"""


@pytest.mark.parametrize("survivors", [*soak_only(0), 25, -1])
def test_a_process_killed_while_writing_leaves_nothing_that_stays(
    tmp_path: Path, survivors: int
) -> None:
    write_all(tmp_path / "want", CONFIG, 2)
    path, tests = tmp_path / "out", str(TESTS)
    prepare_store(path, CONFIG, JOINTS, 2, {})
    survivors %= len(schema.expand(CONFIG))
    code = KILLED.format(tests=tests, path=str(path), survivors=survivors)
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == -signal.SIGKILL
    left = len(schema.expand(CONFIG)) - survivors
    assert len(list(path.rglob("*.partial"))) == left + 1  # and the claim
    assert pending_blocks(path, 2) == [0]
    ZarrWriter(path).write_block(0, make_rows(CONFIG, 0, 2, quarantined=(1,)))
    assert_same_tree(tmp_path / "want", path)


def test_what_was_left_of_a_video_goes_when_the_episode_has_none_any_more(tmp_path: Path) -> None:
    config = small_config(block_size=2, video_hz=5, resolution=(16, 16))
    write_all(tmp_path / "want", config, 2)  # 1 is quarantined
    write_all(tmp_path / "out", config, 2)
    (tmp_path / "out/episodes/status/0").unlink()
    (tmp_path / "out/videos/front/rgb/1.0.0.0.0").touch()
    (tmp_path / "out/videos/front/rgb/1.0.0.0.0.partial").touch()
    ZarrWriter(tmp_path / "out").write_block(0, make_rows(config, 0, 2, quarantined=(1,)))
    assert_same_tree(tmp_path / "want", tmp_path / "out")


SHARED = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from support.fake_episodes import make_rows, small_config
from grasp_factory.writers import ZarrWriter
writer = ZarrWriter(Path({path!r}))
for block in range(int(sys.argv[1]), 8, 2):
    writer.write_block(block, make_rows(small_config(block_size=2), block, 16, (1,)))
"""


def test_two_processes_with_their_own_blocks_lose_nothing(tmp_path: Path) -> None:
    write_all(tmp_path / "want", CONFIG, 16)
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 16, {})
    code = SHARED.format(tests=str(TESTS), path=str(tmp_path / "out"))
    both = [subprocess.Popen([sys.executable, "-c", code, first]) for first in "01"]
    assert [process.wait(60) for process in both] == [0, 0]
    assert_same_tree(tmp_path / "want", tmp_path / "out")


def test_everything_is_on_the_disk_before_the_block_is_committed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 2, {})
    writer, events = ZarrWriter(tmp_path / "out"), []
    replace, sync = Place.replace, block_attempt.fsync_places

    def log_replace(file: Place, target: Place) -> None:
        events.append(("name", target.inner))
        replace(file, target)

    def log_sync(places: Any) -> None:
        places = list(places)
        events.extend(("sync", re.sub(r"\.[0-9a-f]{16}\.partial", "", p.inner)) for p in places)
        sync(places)

    monkeypatch.setattr(Place, "replace", log_replace)
    monkeypatch.setattr(block_attempt, "fsync_places", log_sync)
    writer.write_block(0, make_rows(CONFIG, 0, 2))
    marker, files = "episodes/status/0", set(tree(tmp_path / "out"))
    files = {name for name in files if not name.endswith("zarr.json")}
    folders = {name.rpartition("/")[0] for name in files - {marker}}
    first, commit = len(files), events.index(("name", marker))
    assert {name for _, name in events[:first]} == files
    assert {what for what, _ in events[:first]} == {"sync"}
    assert {name for what, name in events[first:commit] if what == "name"} == files - {marker}
    assert {name for what, name in events[commit - len(folders) : commit]} == folders
    assert events[commit + 1 :] == [("sync", "episodes/status")]


def test_a_block_that_goes_on_says_so_durably_before_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare_store(tmp_path / "out", CONFIG, JOINTS, 2, {})
    ZarrWriter(tmp_path / "out").write_block(0, make_rows(CONFIG, 0, 1))
    marker, synced = tmp_path / "out/episodes/status/0.partial", []

    def log_sync(places: Any) -> None:
        synced.extend(place.inner for place in places)

    def check(attempt: BlockAttempt) -> None:
        assert marker.exists()
        assert synced == ["episodes/status"]
        publish(attempt)

    publish = BlockAttempt.publish
    monkeypatch.setattr(BlockAttempt, "publish", check)
    monkeypatch.setattr(zarr_module, "fsync_places", log_sync)
    ZarrWriter(tmp_path / "out").write_block(0, make_rows(CONFIG, 0, 2))
    assert not marker.exists()


def test_it_opens_only_what_is_a_store(tmp_path: Path) -> None:
    with pytest.raises(StoreMismatchError) as caught:
        ZarrWriter(tmp_path / "none")
    assert str(caught.value) == f"there is no store at {tmp_path / 'none'}"
