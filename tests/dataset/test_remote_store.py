"""A store in object storage is read as the same store on a disk; moto's S3 answers in a thread."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import assert_same_tree
from support.object_server import SECRET, ObjectServer

from grasp_factory.apps.learning.examples import AT_ONCE
from grasp_factory.core.object_storage import client as clients
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import place_of
from grasp_factory.curation.merge import merge
from grasp_factory.curation.pack import pack_store
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.block_version import block_version
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import fresh
from grasp_factory.errors import StorageError, StoreError, StoreMismatchError
from grasp_factory.torch import GraspDataset
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytest.importorskip("obstore")

ROWS = 10
ADDRESS = "s3://bucket/data/grasps.zarr"
_DATE = re.compile(r"\d{4}-\d\d-\d\dT[\d:]+Z")
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def server() -> Iterator[ObjectServer]:
    made = ObjectServer()
    yield made
    made.close()


@pytest.fixture(scope="module")
def here(server: ObjectServer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a store with a quarantined row and a tag, and a copy of it in the bucket."""
    path = tmp_path_factory.mktemp("stores") / "grasps.zarr"
    config = small_config()
    prepare_store(path, config, JOINTS, ROWS, {})
    for block in range(3):
        rows = make_rows(config, block, ROWS, quarantined=(5,))
        ZarrWriter(path).write_block(block, rows)
    AnnotationLog(path).append("me", [2], [("tag", "fine")])
    server.take(path, "data/grasps.zarr")
    return path


@pytest.fixture(autouse=True)
def environment(server: ObjectServer, monkeypatch: pytest.MonkeyPatch) -> None:
    server.set_environment(monkeypatch)


@pytest.fixture
def impatient(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have clients that ask only twice."""
    monkeypatch.setattr(clients, "TRIES", 1)
    monkeypatch.setattr(clients, "PATIENCE_S", 1)
    monkeypatch.setenv("AWS_REQUEST_PAYER", "true")  # others are kept by their environment


def test_every_value_is_that_of_the_store_on_the_disk(here: Path) -> None:
    ours, theirs = Dataset(here), Dataset(ADDRESS, checked=True)
    assert theirs.committed.tolist() == ours.committed.tolist()
    for mine, other in zip(ours, theirs, strict=True):
        assert mine.contents().keys() == other.contents().keys()
        for path, values in mine.contents().items():
            np.testing.assert_array_equal(values, other.contents()[path])
    for name in ours.columns:
        np.testing.assert_array_equal(ours.column(name), theirs.column(name))
    assert theirs.annotations == ours.annotations
    assert all(theirs.verify(int(i)) for i in theirs.committed)


def test_commands_say_the_same(here: Path, run: Run) -> None:
    for command in (["info", "--json"], ["query", "--where", "tags=fine", "--json"]):
        name, *options = command
        told = [run(name, path, *options) for path in (here, ADDRESS)]
        assert [code for code, _, _ in told] == [0, 0]
        texts = [_DATE.sub("", text.replace(str(here), ADDRESS)) for _, text, _ in told]
        assert texts[0] == texts[1]
    assert verify(ADDRESS).problems == verify(here).problems


def test_merging_and_packing_from_there_make_the_same_files(here: Path, tmp_path: Path) -> None:
    for source, out in ((here, tmp_path / "a"), (ADDRESS, tmp_path / "b")):
        out.mkdir()
        merge([source], out / "merged.zarr")
        pack_store(source, out / "packed.zarr", 8)
    for name in ("merged.zarr", "packed.zarr"):
        assert_same_tree(tmp_path / "a" / name, tmp_path / "b" / name)


@pytest.mark.parametrize(
    "command",
    [
        ["tag", ADDRESS, "--add", "x", "--episodes", "1"],
        ["relabel", ADDRESS, "--name", "firm"],
        ["repair", ADDRESS],
        ["snapshot", ADDRESS, "-m", "text"],
        ["merge", "s3://bucket/data/grasps.zarr2", "{here}"],
    ],
)
def test_what_would_change_a_store_there_is_refused_in_a_line(
    command: list[str], here: Path, run: Run, server: ObjectServer
) -> None:
    server.requests.clear()
    code, out, err = run(*(word.format(here=here) for word in command))
    assert (code, out) == (2, "")
    assert err.startswith("Error: s3://bucket/data/grasps.zarr")
    assert "copy the store to a disk" in err and err.count("\n") == 1
    assert not [found for found in server.requests if found[0] not in ("GET", "HEAD")]


def test_an_episode_costs_a_request_for_each_image_when_indexes_are_known(
    here: Path, server: ObjectServer
) -> None:
    dataset = Dataset(ADDRESS)

    def read(row: int) -> None:
        dataset.image(row, "front", "rgb", 0)
        dataset.image(row, "front", "depth", 0)
        dataset.value(row, "success")

    read(0)
    server.requests.clear()
    read(1)
    assert len(server.requests) == 2


def test_images_of_a_block_are_one_request_for_each_kind(here: Path, server: ObjectServer) -> None:
    dataset, rows = Dataset(ADDRESS), [3, 0, 2]
    dataset.scenes([0], ("rgb", "depth"))
    server.requests.clear()
    scenes = dataset.scenes(rows, ("rgb", "depth"))
    assert sum("/rgb/" in key or "/depth/" in key for _, key in server.requests) == 2
    for scene, other in zip(scenes, Dataset(here).scenes(rows, ("rgb", "depth")), strict=True):
        np.testing.assert_array_equal(scene["front"].rgb, other["front"].rgb)
        np.testing.assert_array_equal(scene["front"].depth, other["front"].depth)


def test_an_example_brings_those_beside_it(here: Path, server: ObjectServer) -> None:
    near, far = GraspDataset(here), GraspDataset(ADDRESS)
    assert 2 < len(far) == len(near) <= AT_ONCE
    far[len(far) - 1]
    asked = len(server.requests)
    for ours, theirs in zip(near, far, strict=True):
        assert ours["row"] == theirs["row"]
        assert torch.equal(ours["image"], theirs["image"])
    assert len(server.requests) == asked


def test_a_damaged_example_spoils_no_other(
    here: Path, server: ObjectServer, tmp_path: Path
) -> None:
    damaged, row = tmp_path / "damaged.zarr", int(GraspDataset(here).rows[0])
    shutil.copytree(here, damaged)
    for file in (damaged / "cameras/front/depth").glob(f"{row // 4}.*"):
        file.write_bytes(b"no image")
    server.take(damaged, "data/damaged.zarr")
    far = GraspDataset("s3://bucket/data/damaged.zarr")
    whole = [k for k, of in enumerate(far.rows.tolist()) if of // 4 != row // 4]
    assert whole
    for k in whole:
        assert torch.equal(far[k]["image"], GraspDataset(here)[k]["image"])
    with pytest.raises(StoreError, match="cannot be read"):
        far[0]


def test_opening_asks_for_the_description_of_each_array_once(
    here: Path, server: ObjectServer
) -> None:
    server.requests.clear()
    dataset = Dataset(ADDRESS)
    asked = [key for _, key in server.requests if key.endswith("/zarr.json")]
    for path in dataset.features:
        assert asked.count(f"data/grasps.zarr/{path}/zarr.json") == 1, path


def test_a_block_without_a_marker_is_not_there(here: Path, server: ObjectServer) -> None:
    def hidden(method: str, key: str) -> str:
        return "404 NoSuchKey" if key.endswith("episodes/status/1") else ""

    with server.faulty(hidden):
        dataset = Dataset(ADDRESS)
        assert dataset.status.tolist()[4:8] == [0] * 4
    assert Dataset(ADDRESS).status.tolist()[4:8] != [0] * 4


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("403 ExpiredToken", "access was refused (403"),
        ("503 SlowDown", "the server answered with an error (503"),
    ],
)
def test_a_server_that_does_not_answer_is_no_damage(
    answer: str, words: str, run: Run, server: ObjectServer, impatient: None
) -> None:
    with server.faulty(lambda method, key: answer if key.endswith("status/1") else ""):
        for command in ("info", "verify"):
            code, out, err = run(command, ADDRESS)
            assert (code, out) == (1, "")
            assert words in err and err.count("\n") == 1
            assert SECRET not in err


def test_a_busy_server_is_asked_again(here: Path, server: ObjectServer) -> None:
    refused: set[str] = set()

    def once(method: str, key: str) -> str:
        if key in refused or len(refused) > 5:
            return ""
        refused.add(key)
        return "503 SlowDown" if len(refused) % 2 else "gone"

    with server.faulty(once):
        assert len(Dataset(ADDRESS).committed) == ROWS - 1


def test_a_missing_store_or_bucket_is_one_line(run: Run, here: Path) -> None:
    for address, code, words in (
        ("s3://bucket/nothing.zarr", 2, "is not a grasp-factory store"),
        ("s3://no-such-bucket/a.zarr", 1, "there is no such bucket"),
    ):
        found, out, err = run("info", address)
        assert (found, out, err.count("\n")) == (code, "", 1)
        assert words in err
    with pytest.raises(StoreMismatchError):
        Dataset("s3://bucket/data")


def test_caches_take_each_server_for_itself(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = block_version(place_of(store_path(ADDRESS)), 0)
    other = ObjectServer()
    try:
        other.set_environment(monkeypatch)
        other.take(here, "data/grasps.zarr")
        assert block_version(place_of(store_path(ADDRESS)), 0) != before
        with fresh([store_path(ADDRESS)]) as index:
            assert len(index.stores) == 1
    finally:
        other.close()


def test_a_forked_process_is_told_to_start_in_another_way(here: Path) -> None:
    dataset = Dataset(ADDRESS)
    dataset.image(0, "front", "rgb", 0)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            dataset.image(1, "front", "rgb", 0)
        except StorageError as error:
            os.write(writing, str(error).encode())
        os._exit(0)
    os.close(writing)
    os.waitpid(child, 0)
    with open(reading, encoding="utf-8") as said:
        assert "multiprocessing_context='spawn'" in said.read()


def test_no_secret_is_in_what_is_made_from_a_store(
    here: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GRASP_FACTORY_CACHE", str(tmp_path / "cache"))
    assert run("index", ADDRESS)[0] == 0
    assert run("card", ADDRESS, "--out", tmp_path / "card")[0] == 0
    assert run("export", ADDRESS, tmp_path / "out", "--to", "coco")[0] == 0
    merge([ADDRESS], tmp_path / "merged.zarr")
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert len(files) > 50
    assert not [file for file in files if SECRET.encode() in file.read_bytes()]
    assert SECRET not in json.dumps(dict(Dataset(ADDRESS).attributes))
