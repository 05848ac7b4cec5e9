"""Objects below an address: reads of bounded size, bounded listings, and writing what is absent."""

from __future__ import annotations

import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

from grasp_factory.core.limits import LISTED, Limit
from grasp_factory.core.object_storage.address import MOST_CHARACTERS, RemotePath
from grasp_factory.core.object_storage.bounded_answer import bounded_answer
from grasp_factory.core.object_storage.client import client, endpoint, explained
from grasp_factory.core.object_storage.joined_parts import joined_parts
from grasp_factory.errors import LimitError, StorageError, shown

if TYPE_CHECKING:
    from obstore import GetResult
    from obstore.store import ObjectStore

S = TypeVar("S")
T = TypeVar("T")
AT_ONCE = 8
"""Requests of one read that are on their way at a time."""
KEPT_BYTES, MOST_KEPT_BYTES = 64 * 2**20, 4 * 2**20
"""Bytes of small objects and of indexes that are kept in memory, and of the largest of them."""
PAGE = 1000
"""Objects of one listing's answer."""
_PART = 4 * 2**20
_NO_NAMES = ("..", ".", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectFacts:
    """What a server says of an object."""

    key: str
    """Below the address."""
    size: int
    modified_ns: int
    tag: str
    """Text that changes when the object is written again."""


class Objects:
    """The objects below an address.

    Small objects that were read are kept: in a store, an object is written once.

    Attributes:
        path: the address.
    """

    def __init__(self, path: RemotePath) -> None:
        """Connect to nothing yet.

        Raises:
            MissingLibraryError: without obstore.
            StorageError: if the environment lacks something.
        """
        self.path = path
        self._made_by, self._store = client(path)
        self._kept: OrderedDict[tuple[str, int], tuple[bytes, int]] = OrderedDict()
        self._kept_bytes, self._lock = 0, threading.Lock()

    def _client(self) -> ObjectStore:
        """Return the client.

        Raises:
            StorageError: in a forked process: it would wait for threads of its parent without end.
        """
        if self._made_by != os.getpid():
            raise StorageError(
                f"{self.path}: a process that was forked cannot use its parent's connections; start"
                " it in another way, such as DataLoader(..., multiprocessing_context='spawn')"
            )
        return self._store

    def get(self, key: str, limit: Limit) -> bytes:
        """Return an object's content.

        Raises:
            FileNotFoundError: if there is no such object.
            LimitError: if it is larger than the limit; nothing of it is read then.
            StorageError: if the server does not answer.
        """
        kept = self._find(key, 0)
        if kept is None:
            result = self._ask(key, {})
            size = int(result.meta["size"])
            limit.check(size, self.path / key)
            kept = self._keep(key, 0, bytes(self._content(result, key, size)), size)
        limit.check(len(kept[0]), self.path / key)
        return kept[0]

    def fetch(self, keys: Sequence[str], limit: Limit) -> None:
        """Get objects that are read soon, several at a time, to keep them in memory.

        One that is missing or larger than the limit is left to its reader.

        Raises:
            StorageError: if the server does not answer.
        """

        def fetch_one(key: str) -> None:
            with suppress(FileNotFoundError, LimitError):
                self.get(key, limit)

        self.at_once(fetch_one, keys)

    def is_kept(self, key: str) -> bool:
        """Return whether an object is in memory as a whole."""
        return self._find(key, 0) is not None

    def tail(self, key: str, length: int) -> tuple[bytes, int]:
        """Return the last bytes of an object, and the size of all of it; see ``get``."""
        kept = self._find(key, length)
        if kept is not None:
            return kept
        if self.path.scheme == "az":  # it has no requests for the end of an object
            size = self.facts(key).size
            return self._keep(key, length, self.part(key, max(size - length, 0), size), size)
        result = self._ask(key, {"range": {"suffix": length}})
        size = int(result.meta["size"])
        data = bytes(self._content(result, key, min(length, size)))
        return self._keep(key, length, data, size)

    def part(self, key: str, start: int, stop: int) -> bytes:
        """Return bytes of an object; see ``get``. The caller bounds their number."""
        return bytes(self._part(key, start, stop))

    def _part(self, key: str, start: int, stop: int) -> memoryview:
        if stop <= start:
            return memoryview(b"")
        result = self._ask(key, {"range": (start, stop)})
        return self._content(result, key, stop - start)

    def parts(self, key: str, parts: Sequence[tuple[int, int]]) -> Iterator[tuple[int, memoryview]]:
        """Yield index and content of parts of an object, each from its start to its stop.

        Parts that are close together are one request; ``AT_ONCE`` requests go at a time.
        """
        requests = joined_parts(parts)
        while together := list(islice(requests, AT_ONCE)):
            found = self.at_once(lambda each: self._part(key, each.start, each.stop), together)
            for request, data in zip(together, found, strict=True):
                for k in request.members:
                    start, stop = (edge - request.start for edge in parts[k])
                    yield k, data[start:stop]

    def at_once(self, function: Callable[[S], T], items: Sequence[S]) -> list[T]:
        """Return what a function that asks the server returns for each of some items.

        Raises:
            what the function raises, after the requests that were on their way.
        """
        if len(items) < 2:
            return [function(item) for item in items]
        with ThreadPoolExecutor(min(AT_ONCE, len(items))) as pool:
            return list(pool.map(function, items))

    def facts(self, key: str) -> ObjectFacts:
        """Return what the server says of an object; see ``get``."""
        from obstore import head  # noqa: PLC0415

        with explained(self.path / key):
            return _facts(key, head(self._client(), key))

    def below(self, folder: str) -> Iterator[ObjectFacts]:
        """Yield all objects below a folder, at any depth, in the order of their keys.

        Raises:
            LimitError: if they are too many.
            StorageError: if the server does not answer, or names what no store has.
        """
        from obstore import list as listing  # noqa: PLC0415

        with explained(self.path / folder):
            stream = listing(self._client(), folder or None, chunk_size=PAGE)
        count = 0
        while True:
            with explained(self.path / folder):
                page = bounded_answer(lambda: next(stream, None), self.path / folder)
            if not page:
                return
            count += len(page)
            LISTED.check(count, self.path / folder)
            for meta in page:
                key = str(meta["path"])
                is_long = len(key) > MOST_CHARACTERS
                parts = set() if is_long else set(key.split("/"))
                if is_long or not key.isprintable() or not parts.isdisjoint(_NO_NAMES):
                    raise StorageError(f"{self.path}: an object has the name {shown(key)}")
                yield _facts(key, meta)

    def put(self, key: str, data: bytes) -> None:
        """Write an object that is not there yet; see ``put_once``.

        Raises:
            FileExistsError: if one is there.
            StorageError: if the server does not answer, or refuses; it may have written it.
        """
        from obstore import put  # noqa: PLC0415

        with explained(self.path / key):
            put(self._client(), key, data, mode="create", use_multipart=False)

    def mark(self, facts: ObjectFacts) -> int:
        """Return a number of 126 bits that changes when an object is written again.

        It depends on the server and the address. So whoever fills another store, whatever its
        content, does not get the numbers of this one.
        """
        named = (endpoint(self.path), str(self.path), facts.key, facts.tag, facts.modified_ns)
        return int.from_bytes(hashlib.sha256(repr(named).encode()).digest()[:16], "big") >> 2

    def _ask(self, key: str, options: Any) -> GetResult:
        from obstore import get  # noqa: PLC0415

        with explained(self.path / key):
            return get(self._client(), key, options=options)

    def _content(self, result: GetResult, key: str, size: int) -> memoryview:
        """Return the content of an answer; it must have ``size`` bytes, whatever the server says.

        Raises:
            StorageError: if it has more or fewer.
        """
        parts, left = [], size
        with explained(self.path / key):
            for part in result.stream(min_chunk_size=min(max(size, 1), _PART)):
                left -= len(part)
                if left < 0:
                    break
                parts.append(memoryview(part))
        if left:
            raise StorageError(f"{self.path / key}: the answer has not the {size} bytes it should")
        return parts[0] if len(parts) == 1 else memoryview(b"".join(parts))

    def _find(self, key: str, tail: int) -> tuple[bytes, int] | None:
        with self._lock:
            kept = self._kept.get((key, tail))
            if kept is not None:
                self._kept.move_to_end((key, tail))
            return kept

    def _keep(self, key: str, tail: int, data: bytes, size: int) -> tuple[bytes, int]:
        if len(data) <= MOST_KEPT_BYTES:
            with self._lock:
                if (key, tail) not in self._kept:
                    self._kept[key, tail] = (data, size)
                    self._kept_bytes += len(data)
                while self._kept_bytes > KEPT_BYTES:
                    self._kept_bytes -= len(self._kept.popitem(last=False)[1][0])
        return data, size


def _facts(key: str, meta: Any) -> ObjectFacts:
    return ObjectFacts(
        key=key,
        size=int(meta["size"]),
        modified_ns=int(meta["last_modified"].timestamp()) * 10**9,
        tag=f"{meta['e_tag']} {meta['version']}",
    )
