"""Making stores in object storage: killed anywhere, by two at a time, with faults of the server."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.fake_episodes import JOINTS, make_rows, small_config
from support.object_server import SECRET, ObjectServer, moto_server, set_environment
from support.scale import scaled

from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.object_storage import client as clients
from grasp_factory.core.object_storage import put_once as putting
from grasp_factory.core.object_storage.address import RemotePath, store_path
from grasp_factory.core.object_storage.put_once import PROBE
from grasp_factory.curation.upload import generate_there, pack_there, upload
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import (
    AccessRefusedError,
    GraspFactoryError,
    StorageError,
    StoreMismatchError,
    UsageError,
)
from grasp_factory.factory.run_records import Summary
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytest.importorskip("obstore")

ROWS = 7
NAME = "data/grasps.zarr"
DEATHS = range(1, 260, scaled(23, 1))
RACES = range(scaled(5, 100))


def make_store(path: Path, n: int = ROWS, size: int = 4, shift: int = 0) -> Path:
    """Make a store whose block 1 depends on ``shift``."""
    config = small_config(block_size=size)
    prepare_store(path, config, JOINTS, n, {})
    for block in range(-(-n // size)):
        quarantined = (5,) if shift else (2,)
        ZarrWriter(path).write_block(block, make_rows(config, block, n, quarantined=quarantined))
    return path


def contents(folder: Path) -> dict[str, bytes]:
    """Return the objects of a store, by key."""
    files = (file for file in folder.rglob("*") if file.is_file())
    objects = {f"{NAME}/{file.relative_to(folder)}": file.read_bytes() for file in files}
    return objects | {f"{NAME}/{PROBE}": b"1"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = make_store(tmp_path_factory.mktemp("made") / "grasps.zarr")
    AnnotationLog(path).append("me", [0], [("tag", "fine")])
    return path


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_store(tmp_path_factory.mktemp("other") / "grasps.zarr", shift=1)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[ObjectServer]:
    found = ObjectServer()
    found.set_environment(monkeypatch)
    monkeypatch.setattr(putting, "FIRST_PAUSE_S", 0.001)
    yield found
    found.close()


@pytest.fixture
def impatient(server: ObjectServer, monkeypatch: pytest.MonkeyPatch) -> ObjectServer:
    """Return a server whose clients soon give up."""
    monkeypatch.setattr(clients, "TRIES", 1)
    monkeypatch.setattr(putting, "TRIES", 2)
    monkeypatch.setenv("AWS_REQUEST_PAYER", "true")  # clients are kept by their environment
    return server


def address(name: str = NAME) -> RemotePath:
    path = store_path(f"s3://bucket/{name}")
    assert isinstance(path, RemotePath)
    return path


def check_blocks_are_whole(server: ObjectServer) -> None:
    """Read every row that a reader sees at this moment."""
    try:
        dataset = Dataset(address(), checked=True)
    except StoreMismatchError:
        return
    for index in dataset.committed.tolist():
        assert dataset.verify(index)


def test_the_objects_are_the_files(server: ObjectServer, made: Path) -> None:
    sent = upload(made, address())
    assert (sent.rows, sent.blocks, sent.there_before) == (ROWS, 2, 0)
    assert server.objects == contents(made)
    order = [key for method, key in server.requests if method == "PUT"]
    assert order[-2].endswith("annotations/log.jsonl")
    for block in range(2):
        own = [k for k in order if k.split("/")[-1].split(".")[0] == str(block)]
        assert own[0].endswith(f"episodes/checksum/{block}")
        assert own[-1].endswith(f"episodes/status/{block}")
    assert upload(made, address()).there_before == 2
    assert server.objects == contents(made)


@pytest.mark.parametrize("end", ["gone", "lost"])
def test_a_writer_that_is_killed_at_a_put_leaves_whole_blocks_and_is_continued(
    end: str, server: ObjectServer, made: Path
) -> None:
    for death in DEATHS:
        server.objects.clear()
        with server.faulty(_death(death, end)):
            try:
                upload(made, address())
            except AccessRefusedError:
                pass
        check_blocks_are_whole(server)
        upload(made, address())
        assert server.objects == contents(made)


def _death(number: int, end: str) -> Callable[[str, str], str]:
    """Return a fault: the writer's PUT of a number is its last request."""
    count = 0
    lock = threading.Lock()

    def fault(method: str, key: str) -> str:
        nonlocal count
        with lock:
            count += method == "PUT"
            if count > number or (count == number and method != "PUT"):
                return "403 Dead"
            return end if count == number else ""

    return fault


def test_two_writers_of_the_same_episodes_both_end(server: ObjectServer, made: Path) -> None:
    for _ in RACES:
        server.objects.clear()
        assert _race([made, made]) == [None, None]
        assert server.objects == contents(made)


def test_of_two_writers_of_different_episodes_one_ends_and_one_gets_a_line(
    server: ObjectServer, made: Path, other: Path
) -> None:
    stores = [made, other]
    for _ in RACES:
        server.objects.clear()
        errors = _race(stores)
        (loser,) = [k for k, error in enumerate(errors) if error is not None]
        assert str(errors[loser]) == (
            f"{address()}: block 0 is there with other episodes, of another writer; choose another"
            " address"
        )
        assert server.objects == contents(stores[1 - loser])


def _race(stores: list[Path]) -> list[Exception | None]:
    errors: list[Exception | None] = [None] * len(stores)
    start = threading.Barrier(len(stores))

    def write(k: int) -> None:
        start.wait()
        try:
            upload(stores[k], address())
        except StoreMismatchError as error:
            errors[k] = error

    threads = [threading.Thread(target=write, args=(k,)) for k in range(len(stores))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return errors


def test_a_server_with_all_kinds_of_faults_gets_all_of_it(server: ObjectServer, made: Path) -> None:
    rng = random.Random(3)
    kinds = ["503 SlowDown", "500 InternalError", "409 ConditionalRequestConflict", "lost", "slow"]

    def fault(method: str, key: str) -> str:
        return rng.choice(kinds) if rng.random() < 0.06 else ""

    with server.faulty(fault):
        upload(made, address())
    assert server.objects == contents(made)


@pytest.mark.parametrize(
    ("answer", "kind", "words"),
    [
        ("403 ExpiredToken", AccessRefusedError, r"access was refused \(403 ExpiredToken\)"),
        ("400 ExpiredToken", AccessRefusedError, r"access was refused \(400 ExpiredToken\)"),
        ("503 SlowDown", StorageError, r"answered with an error \(503 SlowDown\)"),
        (
            "409 ConditionalRequestConflict",
            StorageError,
            "says that it is there, and does not find it",
        ),
        ("gone", StorageError, "cannot be reached, or ends its answers early"),
    ],
)
def test_a_server_that_says_no_to_the_end_is_one_line_and_nothing_is_lost(
    answer: str,
    kind: type[StorageError],
    words: str,
    impatient: ObjectServer,
    made: Path,
) -> None:
    server = impatient

    def fault(method: str, key: str) -> str:
        return answer if method == "PUT" and key.endswith("outcome/1") else ""

    with server.faulty(fault):
        with pytest.raises(kind, match=words) as caught:
            upload(made, address())
    assert "\n" not in str(caught.value) and SECRET not in str(caught.value)
    check_blocks_are_whole(server)
    assert upload(made, address()).there_before == 1
    assert server.objects == contents(made)


def test_a_server_without_put_if_absent_is_refused(server: ObjectServer, made: Path) -> None:
    server.ignores_conditions = True
    with pytest.raises(UsageError, match="ignores put-if-absent"):
        upload(made, address())
    assert server.objects.keys() == {f"{NAME}/{PROBE}"}


def test_another_store_at_the_address_stays_as_it_is(
    server: ObjectServer, made: Path, tmp_path: Path
) -> None:
    upload(made, address())
    longer = make_store(tmp_path / "longer.zarr", n=ROWS + 1)
    with pytest.raises(StoreMismatchError, match="another store is there, or one of another"):
        upload(longer, address())
    assert server.objects == contents(made)


def test_packing_to_an_address_gives_the_objects_of_a_packed_store(
    server: ObjectServer, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with server.faulty(_death(90, "gone")), pytest.raises(AccessRefusedError):
        pack_there(made, address(), 8)
    packed = pack_there(made, address(), 8)
    assert (packed.rows, packed.blocks, packed.block_size) == (ROWS, 1, 8)
    expected = contents(make_store(tmp_path / "direct.zarr", size=8))
    found = {k: v for k, v in server.objects.items() if "/annotations/" not in k}
    assert found.pop(f"{NAME}.origin.json")
    assert found == expected
    assert not list((tmp_path / "uploads").iterdir())


@pytest.fixture
def request_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Request:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return Request(config=small_config(block_size=8), n=ROWS, out=address())


def fake_make(request: Request) -> Summary:
    """Make a store as ``generate`` does, or look at the one that is there."""
    if not request.out.exists():
        make_store(request.out, request.n, request.config.block_size)
    return Summary(
        asked=ROWS,
        made=ROWS,
        already_there=0,
        seconds=1.0,
        episodes_per_second=1.0,
        quarantined={},
        failed=False,
        store=summarise(Dataset(request.out)),
    )


def any_platform(store: Dataset, config: FactoryConfig) -> None:
    """Check nothing: the stores of these tests do not say which platform made them."""


def test_generate_goes_on_where_a_killed_run_ended_and_then_has_nothing_to_do(
    server: ObjectServer, request_there: Request, tmp_path: Path
) -> None:
    with server.faulty(_death(100, "lost")), pytest.raises(AccessRefusedError):
        generate_there(request_there, fake_make, any_platform)
    summary = generate_there(request_there, fake_make, any_platform)
    assert summary.store.path == str(address())
    there = Dataset(address())
    assert (len(there), there.config.block_size) == (ROWS, 512)
    assert not list((tmp_path / "cache" / "uploads").iterdir())

    def never(request: Request) -> Summary:
        raise AssertionError

    again = generate_there(request_there, never, any_platform)
    assert (again.made, again.already_there, list(again.quarantined)) == (0, ROWS, [2])
    for change, words in (
        ({"retry_quarantined": True}, "1 quarantined episode cannot be tried again"),
        ({"n": ROWS + 1}, "does not grow"),
        ({"config": replace(request_there.config, seed=9)}, "another store .seed: 0 against 9."),
    ):
        changed: Any = change
        with pytest.raises(UsageError, match=words):
            generate_there(replace(request_there, **changed), never, any_platform)


def test_no_secret_is_in_the_cache_or_the_objects(
    server: ObjectServer, request_there: Request, tmp_path: Path
) -> None:
    with server.faulty(_death(100, "gone")), pytest.raises(GraspFactoryError) as caught:
        generate_there(request_there, fake_make, any_platform)
    files = [file for file in (tmp_path / "cache").rglob("*") if file.is_file()]
    assert len(files) > 50
    for data in (
        *map(Path.read_bytes, files),
        *server.objects.values(),
        str(caught.value).encode(),
    ):
        assert SECRET.encode() not in data


def test_another_program_that_speaks_s3_takes_and_gives_the_same(
    made: Path, other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("moto")
    with moto_server() as url:
        set_environment(monkeypatch, url)
        assert _race([made, made]) == [None, None]
        dataset = Dataset(address(), checked=True)
        assert [i for i in dataset.committed.tolist() if not dataset.verify(i)] == []
        with pytest.raises(StoreMismatchError, match="block 0 is there with other episodes"):
            upload(other, address())
