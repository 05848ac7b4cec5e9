"""Writing objects that are not there yet, of which exactly one of several writers is the first."""

from __future__ import annotations

import contextlib
import hashlib
import time

from grasp_factory.core.object_storage.objects import Objects
from grasp_factory.errors import AccessRefusedError, StorageError, StoreMismatchError, UsageError

TRIES, FIRST_PAUSE_S = 5, 0.2
"""How often an object is put, in addition to the client's own repetitions, and the first pause."""
PROBE = ".put-if-absent"
"""Object of one byte, beside a store's other objects, by which a server is tried."""


def put_once(objects: Objects, key: str, data: bytes) -> bool:
    """Write an object unless it is there; return whether this call has written it.

    An answer that was lost does no harm: the next try finds the object that this one has written.

    Raises:
        StoreMismatchError: if an object with other content is there.
        StorageError: if the server does not answer, or refuses.
    """
    for attempt in range(TRIES):
        try:
            objects.put(key, data)
            return True
        except FileExistsError:
            with contextlib.suppress(FileNotFoundError):  # S3 says so while another one writes it
                if is_there(objects, key, data):
                    return False
                raise StoreMismatchError(
                    f"{objects.path / key}: another content is there"
                ) from None
        except AccessRefusedError:
            raise
        except StorageError:
            if attempt == TRIES - 1:
                raise
        time.sleep(FIRST_PAUSE_S * 2**attempt)
    raise StorageError(
        f"{objects.path / key}: the server says that it is there, and does not find it"
    )


def is_there(objects: Objects, key: str, data: bytes) -> bool:
    """Return whether an object has this content, by size and hash if the server tells one.

    Raises:
        FileNotFoundError: if there is no such object.
        StorageError: if the server does not answer.
    """
    facts = objects.facts(key)
    if facts.size != len(data):
        return False
    if hashlib.md5(data, usedforsecurity=False).hexdigest() in facts.tag:
        return True
    return objects.part(key, 0, len(data)) == data


def check_puts_once(objects: Objects) -> None:
    """Check that a server leaves an object alone when it is put again "if absent".

    Raises:
        UsageError: if it does not: two writers would spoil each other's blocks.
        StorageError: if it does not answer, or refuses.
    """
    try:
        put_once(objects, PROBE, b"1")
        put_once(objects, PROBE, b"2")
    except StoreMismatchError:
        if is_there(objects, PROBE, b"1"):
            return
    raise UsageError(
        f"{objects.path}: this server ignores put-if-absent (If-None-Match), so two writers could"
        " mix their episodes; make the store on a disk and copy it there"
    )
