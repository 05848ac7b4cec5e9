"""Clients of object storage: one for each bucket and process, set up by the environment alone."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import lru_cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from grasp_factory.core.object_storage.address import RemotePath
from grasp_factory.core.optional import require
from grasp_factory.errors import AccessRefusedError, StorageError

if TYPE_CHECKING:
    from obstore.store import ObjectStore

TRIES, PATIENCE_S = 6, 45
"""Most repetitions of a request, and seconds for all of them."""
REQUEST_S, CONNECT_S = 120, 5
"""Seconds for one answer, and for a connection."""
_VARIABLES = ("AWS_", "AZURE_", "GOOGLE_")
_ENDPOINTS = {
    "s3": ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT"),
    "gs": ("GOOGLE_BASE_URL",),
    "az": ("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT", "AZURE_STORAGE_ACCOUNT_NAME"),
}
_STATUS = re.compile(r"status code: (\d{3})\b")
_CODE = re.compile(r"<Code>([A-Za-z]{1,64})</Code>")
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def endpoint(path: RemotePath) -> str:
    """Return who answers for an address: the server that the environment names, or nothing."""
    found = (os.environ.get(name, "") for name in _ENDPOINTS[path.scheme])
    return next(filter(None, found), "")


def client(path: RemotePath) -> tuple[int, ObjectStore]:
    """Return the client whose keys are those below an address, and the process that has made it.

    Credentials, region and server come from the environment variables of the storage, such as
    ``AWS_ACCESS_KEY_ID``; none of them is kept, shown or written.

    Raises:
        MissingLibraryError: without obstore.
        StorageError: if the environment lacks something.
    """
    require("obstore", extra="s3")
    values = sorted((k, v) for k, v in os.environ.items() if k.startswith(_VARIABLES))
    return _client(path, hashlib.sha256(repr(values).encode()).digest())


@lru_cache(maxsize=32)
def _client(path: RemotePath, environment: bytes) -> tuple[int, ObjectStore]:
    from obstore import store as stores  # noqa: PLC0415

    _, bucket, *folders = path.parts
    server = urlsplit(endpoint(path))
    settings: dict[str, Any] = {
        "prefix": "/".join(folders) or None,
        "client_options": {
            "timeout": timedelta(seconds=REQUEST_S),
            "connect_timeout": timedelta(seconds=CONNECT_S),
        },
        "retry_config": {
            "max_retries": TRIES,
            "retry_timeout": timedelta(seconds=PATIENCE_S),
            "backoff": {
                "init_backoff": timedelta(seconds=0.1),
                "max_backoff": timedelta(seconds=5),
                "base": 2,
            },
        },
    }
    if server.scheme == "http" and server.hostname in _LOOPBACK:
        settings["client_options"]["allow_http"] = True
    makers = {"s3": stores.S3Store, "gs": stores.GCSStore, "az": stores.AzureStore}
    with explained(path):
        return os.getpid(), makers[path.scheme](bucket, **settings)


@contextmanager
def explained(path: object) -> Iterator[None]:
    """Raise a StorageError for what a request raises; a missing object is a FileNotFoundError.

    The library's own text is not shown: it may hold a signature.
    """
    try:
        yield
    except FileNotFoundError as error:
        if "NoSuchBucket" in str(error):
            raise StorageError(f"{path}: there is no such bucket") from None
        raise FileNotFoundError(2, "no such object", str(path)) from None
    except Exception as error:
        from obstore import exceptions  # noqa: PLC0415

        if not isinstance(error, exceptions.BaseError):
            raise
        if isinstance(error, exceptions.AlreadyExistsError | exceptions.PreconditionError):
            raise FileExistsError(17, "an object is there", str(path)) from None
        kind, text = type(error).__name__, str(error)
        meant = AccessRefusedError if _is_refusal(kind, text) else StorageError
        raise meant(f"{path}: {_reason(kind, text)}") from None


def _is_refusal(kind: str, text: str) -> bool:
    """Return whether an error is about the credentials."""
    status = _STATUS.search(text)
    is_named = kind in ("PermissionDeniedError", "UnauthenticatedError")
    return is_named or bool(status and status[1] in ("400", "401", "403"))


def _reason(kind: str, text: str) -> str:
    """Return what an error means, in words of this package."""
    status, code = _STATUS.search(text), _CODE.search(text)
    got = " ".join(found[1] for found in (status, code) if found)
    what = f" ({got})" if got else ""
    if _is_refusal(kind, text):
        return f"access was refused{what}; check the credentials in the environment and their date"
    if status:
        return f"the server answered with an error{what} after all repetitions; try again later"
    if kind == "InvalidPathError":
        return "the server names objects in a way that is not read"
    if "builder error" in text:
        return "the server's address is http and no loopback: use https, or set AWS_ALLOW_HTTP=true"
    if "redential" in text.partition("Debug source")[0]:
        return "no credentials were found: set them in the environment, such as AWS_ACCESS_KEY_ID"
    return "the server cannot be reached, or ends its answers early; check its address, try again"
