"""The HTTP server: its socket, its threads, and the address that users open."""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import logging
import socket
import threading
from collections.abc import Iterable
from typing import Any, Self

from flask import Flask
from waitress import wasyncore  # type: ignore[import-untyped]
from waitress.channel import HTTPChannel  # type: ignore[import-untyped]
from waitress.parser import HTTPRequestParser, ParsingError  # type: ignore[import-untyped]
from waitress.server import create_server  # type: ignore[import-untyped]
from waitress.task import ErrorTask  # type: ignore[import-untyped]

from grasp_factory.apps.browse.clips import WAITING as CLIPS_WAITING
from grasp_factory.apps.browse.guard import ANY_ADDRESS, HEADERS, MOST_BODY
from grasp_factory.apps.browse.numbers import json_bytes
from grasp_factory.apps.browse.query_limit import ASKING
from grasp_factory.errors import UsageError, shown

PORT = 8642
PORTS_TRIED = 100
"""Number of ports to try from ``PORT`` on, if the user asks for no port."""
THREADS = ASKING + CLIPS_WAITING + 3
MOST_CONNECTIONS = 500
IDLE_S = 30
"""Seconds after which an idle connection is closed."""
MOST_HEADER = 32 * 1024
"""Maximum bytes of a request's header; URLs with many conditions are long."""
PATIENCE_S = 2.0
"""Seconds to wait for running answers when the server is stopped."""
_LOG = logging.getLogger("waitress")


class Server:
    """The server of an application, in its own threads; a context manager that stops it.

    Attributes:
        port: the TCP port that it listens on.
    """

    def __init__(self, app: Flask, listening: socket.socket) -> None:
        """Use a socket from ``listen``; it is closed when the server is stopped."""
        logging.getLogger("waitress.queue").setLevel(logging.ERROR)  # a full queue is normal
        self.port: int = listening.getsockname()[1]
        self._sockets: dict[int, Any] = {}
        self._server = create_server(
            app,
            map=self._sockets,
            sockets=[listening],
            threads=THREADS,
            connection_limit=MOST_CONNECTIONS,
            channel_timeout=IDLE_S,
            cleanup_interval=IDLE_S // 3,
            asyncore_use_poll=True,
            ident=None,
            max_request_body_size=MOST_BODY + 1,  # larger bodies are refused
            max_request_header_size=MOST_HEADER,
            clear_untrusted_proxy_headers=True,
            channel_request_lookahead=1,  # an answer can ask whether its client has left
        )
        self._server.channel_class = _Channel
        self._thread = threading.Thread(target=self._server.run, name="browse", daemon=True)

    def start(self) -> Self:
        """Begin to answer, and return."""
        _LOG.setLevel(logging.WARNING)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Wait for running answers, close all connections, and end the threads."""
        _LOG.setLevel(logging.CRITICAL)  # answers that take longer are no error
        # The answering threads end first: otherwise they would write to closed connections.
        self._server.task_dispatcher.shutdown(timeout=PATIENCE_S)
        with contextlib.suppress(OSError):
            self._server.trigger.pull_trigger(self._close)
        self._thread.join(PATIENCE_S)

    def _close(self) -> None:
        """Close all sockets in the thread that uses them; it ends when no socket is left."""
        wasyncore.close_all(self._sockets)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()


class _Refusal(ErrorTask):  # type: ignore[misc]
    """The answer to a malformed request: with the usual headers, and without the request's text."""

    def execute(self) -> None:
        """Write the answer."""
        error = self.request.error
        body = json_bytes({"error": f"{error.reason}: the request is malformed"})
        self.status = f"{error.code} {error.reason}"
        self.response_headers.extend([("Content-Type", "application/json"), *HEADERS.items()])
        self.set_close_on_finish()
        self.content_length = len(body)
        self.write(body)


class _Parser(HTTPRequestParser):  # type: ignore[misc]
    """Parses requests, and also refuses requests whose URL cannot be parsed."""

    def parse_header(self, header_plus: bytes) -> None:
        """Read a request's header.

        Raises:
            ParsingError: if it is malformed.
        """
        try:
            super().parse_header(header_plus)
        except ValueError:  # from urlsplit; waitress does not catch it
            raise ParsingError("Bad URI") from None
        if self.proxy_scheme or self.proxy_netloc:  # an absolute URL: its host replaces Host
            self.headers["HOST"] = self.proxy_netloc


class _Channel(HTTPChannel):  # type: ignore[misc]
    parser_class = _Parser
    error_task_class = _Refusal


def listen(host: str, port: int | None = None) -> socket.socket:
    """Return a socket that listens on ``port``, or on the first free port from ``PORT`` on.

    Raises:
        UsageError: if this machine has no such address, or the port is in use or not allowed.
    """
    ports = [*range(PORT, PORT + PORTS_TRIED)] if port is None else [port]
    while True:
        number = ports.pop(0)
        try:
            return _bound(host, number)
        except OSError as error:
            if error.errno != errno.EADDRINUSE or not ports:
                raise UsageError(_trouble(host, number, error)) from None


def address(host: str, port: int, token: str) -> str:
    """Return the URL to open; the token is in the fragment, which browsers do not send.

    Args:
        host: The address that the server is bound to.
        port: Its port.
        token: The token that writing needs; empty for none.
    """
    name = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    name = f"[{name}]" if ":" in name else name
    return f"http://{name}:{port}/" + (f"#token={token}" if token else "")


def own_names(host: str, more: Iterable[str] = ()) -> frozenset[str]:
    """Return the host names that requests to a server bound to ``host`` may have."""
    machine = {socket.gethostname()} if host in ANY_ADDRESS else set()
    return frozenset({host, "localhost", *machine, *more})


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached only from this machine."""
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host.lower() == "localhost"


def _bound(host: str, port: int) -> socket.socket:
    family, kind, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    listening = socket.socket(family, kind)
    try:
        # A port that was closed a moment ago is free; one that is in use is still refused.
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(where)
        listening.listen()
    except BaseException:
        listening.close()
        raise
    return listening


def _trouble(host: str, port: int, error: OSError) -> str:
    where = f"--host {shown(host)} --port {port}"
    if error.errno == errno.EADDRINUSE:
        return f"{where}: something else listens there; leave out --port, and a free one is taken"
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return f"{where}: this machine has no such address, valid: 127.0.0.1, or one of its own"
    return f"{where}: {error.strerror}; valid: ports 1024 to 65535"
