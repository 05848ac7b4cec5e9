"""S3 on loopback in a thread of this process, small and fast, with faults put before it.

With GRASP_FACTORY_S3 the faults are put before a server of another program: see ``s3_behind``.
"""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import contextmanager
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit
from xml.sax.saxutils import escape

import pytest
from support.s3_behind import ADDRESS, KEY_ID, SECRET, ConnectionBehind, ObjectsBehind

BUCKET = "bucket"
SLOW_S = 0.05
Fault = Callable[[str, str], str]
"""Returns what happens to a request of a method for a key: nothing (""), an HTTP status such as
"503 SlowDown", "lost" (done, but nobody gets the answer), "slow", or "gone" (nothing is done)."""


class ObjectServer:
    """A server of one bucket.

    Servers at the same time share the bucket of the server behind, if there is one.

    Attributes:
        objects: content by key.
        fault: decides on each request; None for no faults.
        ignores_conditions: whether put-if-absent replaces what is there.
        requests: method and key of each request so far.
    """

    running = 0

    def __init__(self) -> None:
        self.objects: MutableMapping[str, bytes] = ObjectsBehind(BUCKET) if ADDRESS else {}
        if not ObjectServer.running:
            self.objects.clear()
        ObjectServer.running += 1
        self.fault: Fault | None = None
        self.ignores_conditions = False
        self.requests: list[tuple[str, str]] = []
        self.lock = threading.Lock()
        handler = type("Handler", (_Handler,), {"of": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def close(self) -> None:
        """End the server."""
        ObjectServer.running -= 1
        self._server.shutdown()
        self._server.server_close()

    def set_environment(self, patch: pytest.MonkeyPatch) -> None:
        """Let clients of this process and its children find the server."""
        set_environment(patch, self.url)

    @contextmanager
    def faulty(self, fault: Fault) -> Iterator[None]:
        """Have faults meanwhile."""
        self.fault = fault
        try:
            yield
        finally:
            self.fault = None

    def take(self, folder: Path, prefix: str) -> None:
        """Copy the files of a store into the bucket, as any tool does."""
        for file in folder.rglob("*"):
            if file.is_file():
                self.objects[f"{prefix}/{file.relative_to(folder)}"] = file.read_bytes()


@contextmanager
def moto_server() -> Iterator[str]:
    """Yield the address of moto's S3, another program than the one above, with the bucket."""
    from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import WSGIRequestHandler, make_server

    class Silent(WSGIRequestHandler):
        def log(self, *_: object, **__: object) -> None:
            """Print nothing."""

    app = DomainDispatcherApplication(create_backend_app)
    server = make_server("127.0.0.1", 0, app, True, request_handler=Silent)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}"
    try:
        with pytest.MonkeyPatch.context() as patch:
            set_environment(patch, url)
            make_bucket(url, BUCKET)
        yield url
    finally:
        server.shutdown()
        server.server_close()


def make_bucket(url: str, name: str) -> None:
    """Make a bucket with the credentials of the environment; it may be there."""
    import boto3

    boto3.client("s3", endpoint_url=url).create_bucket(Bucket=name)


def set_environment(patch: pytest.MonkeyPatch, url: str) -> None:
    """Let clients of this process and its children find the server at an address."""
    patch.setenv("AWS_ENDPOINT_URL", url)
    patch.setenv("AWS_ACCESS_KEY_ID", KEY_ID)
    patch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    patch.setenv("AWS_REGION", "us-east-1")


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    wbufsize = 1 << 16
    disable_nagle_algorithm = True
    of: ObjectServer

    def log_message(self, *_: object) -> None:
        """Print nothing."""

    def do_GET(self) -> None:
        """Answer with an object, a part of one, or a listing."""
        self._serve(self._forward if ADDRESS else self._get)

    do_HEAD = do_GET

    def do_PUT(self) -> None:
        """Keep an object."""
        self._serve(self._forward if ADDRESS else self._put)

    def _serve(self, answer: Callable[[str], None]) -> None:
        url = urlsplit(self.path)
        bucket, _, key = unquote(url.path).lstrip("/").partition("/")
        self.body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        self.of.requests.append((self.command, key))
        what = self.of.fault(self.command, key) if self.of.fault else ""
        self.is_lost = what in ("lost", "gone")
        if what == "slow":
            time.sleep(SLOW_S)
        if what == "gone":
            self.close_connection = True
        elif what not in ("", "slow", "lost"):
            self._error(*what.split())
        elif bucket != BUCKET and not ADDRESS:
            self._error("404", "NoSuchBucket")
        else:
            answer(key)

    def _forward(self, key: str) -> None:
        if self.of.ignores_conditions and "If-None-Match" in self.headers:
            self.of.objects.pop(key, None)
        answer = self.behind.ask(self.command, self.path, self.headers, self.body)
        if self.is_lost:
            self.close_connection = True
            return
        self.send_response_only(answer.status)
        length = [] if self.command == "HEAD" else [("Content-Length", str(len(answer.body)))]
        for name, value in (*answer.headers, *length):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.body)

    @cached_property
    def behind(self) -> ConnectionBehind:
        """The connection to the server behind."""
        return ConnectionBehind()

    def finish(self) -> None:
        """End both connections."""
        if ADDRESS:
            self.behind.close()
        super().finish()

    def _get(self, key: str) -> None:
        query = parse_qs(urlsplit(self.path).query)
        if not key:
            self._list(query.get("prefix", [""])[0], query.get("continuation-token", [""])[0])
            return
        data = self.of.objects.get(key)
        if data is None:
            self._error("404", "NoSuchKey")
            return
        asked = self.headers.get("Range", "").removeprefix("bytes=")
        first, _, last = asked.partition("-")
        start = max(len(data) - int(last), 0) if asked and not first else int(first or 0)
        stop = min(int(last) + 1, len(data)) if first and last else len(data)
        more = {"Content-Range": f"bytes {start}-{stop - 1}/{len(data)}"} if asked else {}
        self._send(206 if asked else 200, data[start:stop], _tagged(data) | more)

    def _put(self, key: str) -> None:
        with self.of.lock:
            is_conditional = "If-None-Match" in self.headers and not self.of.ignores_conditions
            if is_conditional and key in self.of.objects:
                self._error("412", "PreconditionFailed")
                return
            self.of.objects[key] = self.body
        self._send(200, b"", _tagged(self.body))

    def _list(self, prefix: str, after: str) -> None:
        keys = sorted(k for k in list(self.of.objects) if k.startswith(prefix) and k > after)
        rows = "".join(
            f"<Contents><Key>{escape(key)}</Key><Size>{len(self.of.objects[key])}</Size>"
            f"<ETag>{_tagged(self.of.objects[key])['ETag']}</ETag>"
            "<LastModified>2026-11-24T10:00:00.000Z</LastModified></Contents>"
            for key in keys[:100]
        )
        token = f"<NextContinuationToken>{keys[99]}</NextContinuationToken>" if keys[100:] else ""
        cut = str(bool(token)).lower()
        text = f"<ListBucketResult><IsTruncated>{cut}</IsTruncated>{rows}{token}</ListBucketResult>"
        self._send(200, text.encode(), {"Content-Type": "application/xml"})

    def _error(self, status: str, code: str) -> None:
        text = f"<Error><Code>{code}</Code><Message>{SECRET}</Message></Error>"
        self._send(int(status), text.encode(), {})

    def _send(self, status: int, body: bytes, headers: dict[str, str]) -> None:
        if self.is_lost:
            self.close_connection = True
            return
        self.send_response(status)
        for name, value in {**headers, "Content-Length": str(len(body))}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)


def _tagged(data: bytes) -> dict[str, str]:
    """Return the headers that an object's content gives."""
    return {
        "ETag": f'"{hashlib.md5(data).hexdigest()}"',
        "Last-Modified": "Tue, 24 Nov 2026 10:00:00 GMT",
    }
