"""Addresses of stores, and reading objects of a server that lies, is slow, or says no."""

from __future__ import annotations

import pickle
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from grasp_factory.core.limits import DOCUMENT, LISTED, OBJECT, Limit
from grasp_factory.core.object_storage import bounded_answer
from grasp_factory.core.object_storage import client as clients
from grasp_factory.core.object_storage import objects as reading
from grasp_factory.core.object_storage.address import RemotePath, is_remote, store_path
from grasp_factory.core.object_storage.joined_parts import joined_parts
from grasp_factory.core.object_storage.objects import Objects
from grasp_factory.core.place import place_of
from grasp_factory.errors import LimitError, StorageError, UsageError

pytest.importorskip("obstore")


def address(text: str = "s3://bucket/folder/grasps.zarr") -> RemotePath:
    path = store_path(text)
    assert isinstance(path, RemotePath)
    return path


def test_an_address_goes_where_paths_go() -> None:
    path = address("s3://bucket/folder/grasps.zarr/")
    assert str(path) == "s3://bucket/folder/grasps.zarr"
    assert str(path / "episodes" / "status") == f"{path}/episodes/status"
    assert str(path.with_name("other.zarr")) == "s3://bucket/folder/other.zarr"
    assert pickle.loads(pickle.dumps(path / "x")) == path / "x"
    assert is_remote(path / "x") and is_remote(path.parent) and not is_remote(Path("s3"))
    assert store_path("grasps.zarr") == Path("grasps.zarr")


@pytest.mark.parametrize(
    "text",
    [
        "s3://bucket",
        "s3://bucket/",
        "s3://bucket/../other/x.zarr",
        "s3://bucket/a//b.zarr",
        "s3://bucket/a\n.zarr",
        "s3://bucket/a.zarr?x=1",
        "s3://b/a.zarr",
        "http://bucket/a.zarr",
        "file:///etc/passwd",
        f"s3://bucket/{'a' * 1024}",
    ],
)
def test_an_address_that_cannot_be_one_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="valid: s3://BUCKET/STORE"):
        store_path(text)


def test_a_key_in_an_address_is_refused_and_not_shown() -> None:
    with pytest.raises(UsageError, match="environment") as caught:
        store_path("s3://me:hunter2@bucket/a.zarr")
    assert "hunter2" not in str(caught.value)


def test_what_needs_a_disk_is_refused_in_one_line() -> None:
    for use in (Path.read_bytes, Path.mkdir, Path.unlink, open):
        with pytest.raises(UsageError, match=r"^s3://bucket/.*copy the store to a disk"):
            use(address())


class Liar:
    """A server that sends the same bytes to everybody, and then what it likes, without end."""

    def __init__(self, answer: bytes, then: bytes = b"") -> None:
        self._answer, self._then = answer, then
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                peer, _ = self._socket.accept()
            except OSError:
                return
            threading.Thread(target=self._talk, args=(peer,), daemon=True).start()

    def _talk(self, peer: socket.socket) -> None:
        try:
            with peer:
                peer.recv(1 << 16)
                peer.sendall(self._answer)
                for _ in range(64 if self._then else 0):
                    peer.sendall(self._then)
                peer.recv(1 if self._then else 0)  # until the other end closes it
        except OSError:
            pass

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "TRIES", 1)
    monkeypatch.setattr(clients, "PATIENCE_S", 1)
    monkeypatch.setattr(bounded_answer, "ANSWER_S", 0.3)


def objects_of(liar: Liar, patch: pytest.MonkeyPatch) -> Objects:
    patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{liar.port}")
    patch.setenv("AWS_ACCESS_KEY_ID", "test")
    patch.setenv("AWS_SECRET_ACCESS_KEY", "hunter2")
    patch.setenv("AWS_REGION", "us-east-1")
    return Objects(address())


HEAD = (
    b'HTTP/1.1 200 OK\r\nLast-Modified: Tue, 24 Nov 2026 10:00:00 GMT\r\nETag: "x"\r\n'
    b"Connection: close\r\n"
)


@pytest.fixture
def liars() -> Iterator[list[Liar]]:
    made: list[Liar] = []
    yield made
    for liar in made:
        liar.close()


def test_an_object_is_not_read_beyond_its_limit(
    liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    liars.append(Liar(HEAD + b"Content-Length: 1099511627776\r\n\r\n", b"x" * 65536))
    with pytest.raises(LimitError, match=r"a JSON document of 1\.1 TB"):
        objects_of(liars[0], monkeypatch).get("zarr.json", DOCUMENT)


@pytest.mark.parametrize(
    "answer",
    [
        HEAD + b"Content-Length: 100\r\n\r\nshort",
        HEAD + b"Content-Length: 5\r\nContent-Range: bytes 0-4/5\r\n\r\nshort",
        b"HTTP/1.1 206 Partial Content\r\nLast-Modified: Tue, 24 Nov 2026 10:00:00 GMT\r\n"
        b'ETag: "x"\r\nConnection: close\r\nContent-Range: bytes 7-9/10\r\n'
        b"Content-Length: 5000\r\n\r\n" + b"x" * 5000,
        b"nonsense",
        b"",
    ],
)
def test_a_part_of_another_size_is_an_error_of_the_server(
    answer: bytes, liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    liars.append(Liar(answer))
    with pytest.raises(StorageError, match=r"^s3://bucket/folder/grasps.zarr/a: ") as caught:
        objects_of(liars[0], monkeypatch).part("a", 7, 10)
    assert "\n" not in str(caught.value)
    assert "hunter2" not in str(caught.value)


def page(keys: list[str], token: str = "") -> bytes:
    prefix = "folder/grasps.zarr/"
    rows = "".join(
        f"<Contents><Key>{prefix}{key}</Key><Size>1</Size><ETag>x</ETag>"
        "<LastModified>2026-11-24T10:00:00.000Z</LastModified></Contents>"
        for key in keys
    )
    more = f"<NextContinuationToken>{token}</NextContinuationToken>" if token else ""
    cut = str(bool(token)).lower()
    xml = f"<ListBucketResult><IsTruncated>{cut}</IsTruncated>{rows}{more}</ListBucketResult>"
    return HEAD + f"Content-Length: {len(xml)}\r\n\r\n{xml}".encode()


def test_a_listing_without_end_ends(
    liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    liars += [Liar(page([], "again")), Liar(page([f"a/{k}" for k in range(500)], "again"))]
    with pytest.raises(StorageError, match="no page of the listing within"):
        list(objects_of(liars[0], monkeypatch).below(""))
    few = Limit(LISTED.name, 800, LISTED.what, is_count=True)
    monkeypatch.setattr(reading, "LISTED", few)
    monkeypatch.setattr(Limit, "most", property(lambda limit: limit.usual))
    with pytest.raises(LimitError, match="a number of listed objects of 1,000"):
        list(objects_of(liars[1], monkeypatch).below(""))


def test_a_page_of_a_listing_without_end_takes_bounded_memory(
    liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    monkeypatch.setattr(bounded_answer, "ANSWER_S", 60.0)
    monkeypatch.setattr(bounded_answer, "ANSWER_BYTES", 2**25)
    liars.append(Liar(HEAD + b"Content-Length: 1000000000\r\n\r\n<ListBucketResult>", b" " * 2**20))
    with pytest.raises(StorageError, match="a page of the listing has more than 32 MiB"):
        list(objects_of(liars[0], monkeypatch).below(""))


def test_parts_close_together_are_one_request_and_every_part_is_in_one() -> None:
    parts = [(900_000, 900_010), (10, 20), (0, 5), (5_000_000, 5_000_001), (12, 300_000)]
    requests = list(joined_parts(parts))
    assert [(each.start, each.stop) for each in requests] == [
        (0, 300_000),
        (900_000, 900_010),
        (5_000_000, 5_000_001),
    ]
    assert sorted(k for each in requests for k in each.members) == list(range(len(parts)))
    for each in requests:
        assert all(each.start <= parts[k][0] <= parts[k][1] <= each.stop for k in each.members)
    close = [(k * 2**20, k * 2**20 + 2**20) for k in range(10)]
    assert [len(each.members) for each in joined_parts(close)] == [4, 4, 2]
    assert list(joined_parts([])) == []


@pytest.mark.parametrize("key", ["a/../../x", "k" * 2000, "a//b", "a/&#10;b", "./a", "&#27;[2J"])
def test_names_that_no_store_has_are_refused(
    key: str, liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    liars.append(Liar(page([key])))
    with pytest.raises(StorageError) as caught:
        list(objects_of(liars[0], monkeypatch).below(""))
    assert str(caught.value).isprintable()


def test_caches_know_an_object_by_its_server(
    liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    marks = set()
    for _ in range(2):
        liars.append(Liar(page(["zarr.json"])))
        objects = objects_of(liars[-1], monkeypatch)
        (facts,) = objects.below("")
        marks.add(objects.mark(facts))
    assert len(marks) == 2


def test_nobody_at_the_address_is_one_line(
    liars: list[Liar], monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    liars.append(Liar(b""))
    objects = objects_of(liars[0], monkeypatch)
    liars[0].close()
    with pytest.raises(StorageError, match="cannot be reached"):
        objects.get("a", OBJECT)


def test_http_is_for_loopback_only(monkeypatch: pytest.MonkeyPatch, impatient: None) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://192.0.2.1")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hunter2")
    with pytest.raises(StorageError, match="use https"):
        Objects(address()).get("a", OBJECT)


def test_a_place_in_object_storage_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    place = place_of(address()) / "a"
    for change in (
        lambda: place.write(b""),
        place.create,
        place.mkdir,
        place.unlink,
        place.open_for_sync,
        lambda: place.replace(place),
    ):
        with pytest.raises(UsageError, match="copy the store to a disk"):
            change()
