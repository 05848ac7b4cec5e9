"""An S3 server of another program behind the one of the tests, which then only adds the faults.

It is named by GRASP_FACTORY_S3, with its credentials in the usual variables: see bin/check-s3.
"""

from __future__ import annotations

import http.client
import os
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from urllib.parse import urlsplit

ADDRESS = os.environ.get("GRASP_FACTORY_S3", "")
"""Of the server behind; empty if the tests have a server of their own."""
KEY_ID, SECRET = (
    (os.environ["AWS_ACCESS_KEY_ID"], os.environ["AWS_SECRET_ACCESS_KEY"])
    if ADDRESS
    else ("test", "a-secret-that-appears-nowhere")
)
OF_A_CONNECTION = ("connection", "keep-alive", "transfer-encoding", "content-length")
LONGEST_S = 60.0


class ObjectsBehind(MutableMapping[str, bytes]):
    """The objects of a bucket by key; asked for each time."""

    def __init__(self, bucket: str) -> None:
        """Make the bucket, if it is not there."""
        self._bucket = {"Bucket": bucket}
        self._client.create_bucket(**self._bucket)

    @cached_property
    def _client(self) -> Any:
        import boto3
        from botocore.config import Config

        plain: Any = {key: "when_required" for key in
                      ("request_checksum_calculation", "response_checksum_validation")}  # fmt: skip
        return boto3.client(
            "s3", endpoint_url=ADDRESS, region_name="us-east-1", config=Config(**plain),
            aws_access_key_id=KEY_ID, aws_secret_access_key=SECRET,
        )  # fmt: skip

    def __getitem__(self, key: str) -> bytes:
        try:
            answer = self._client.get_object(Key=key, **self._bucket)
        except self._client.exceptions.NoSuchKey:
            raise KeyError(key) from None
        data: bytes = answer["Body"].read()
        return data

    def __setitem__(self, key: str, data: bytes) -> None:
        self._client.put_object(Key=key, Body=data, **self._bucket)

    def __delitem__(self, key: str) -> None:
        self._client.delete_object(Key=key, **self._bucket)

    def __iter__(self) -> Iterator[str]:
        for page in self._client.get_paginator("list_objects_v2").paginate(**self._bucket):
            yield from (found["Key"] for found in page.get("Contents", []))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def clear(self) -> None:
        """Remove all objects."""
        for key in list(self):
            del self[key]


@dataclass(frozen=True, slots=True)
class Answer:
    """What the server behind said."""

    status: int
    headers: tuple[tuple[str, str], ...]
    body: bytes


class ConnectionBehind:
    """A connection to the server behind, which is kept."""

    def __init__(self) -> None:
        self._connection = http.client.HTTPConnection(urlsplit(ADDRESS).netloc, timeout=LONGEST_S)

    def ask(self, method: str, path: str, headers: Mapping[str, str], body: bytes) -> Answer:
        """Send a request as it is, so that its signature holds; once more after an idle time."""
        try:
            return self._ask(method, path, headers, body)
        except (http.client.HTTPException, OSError):
            self._connection.close()
            return self._ask(method, path, headers, body)

    def _ask(self, method: str, path: str, headers: Mapping[str, str], body: bytes) -> Answer:
        ask = self._connection
        ask.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in headers.items():
            if name.lower() not in ("connection", "expect"):
                ask.putheader(name, value)
        ask.endheaders(body)
        found = ask.getresponse()
        kept = [
            (name, value)
            for name, value in found.getheaders()
            if method == "HEAD" or name.lower() not in OF_A_CONNECTION
        ]
        return Answer(found.status, tuple(kept), found.read())

    def close(self) -> None:
        """End the connection."""
        self._connection.close()
