"""Serving the page of a session; a failure here is told once, and the session goes on."""

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from grasp_factory.apps.browse import require_server
from grasp_factory.apps.browse.server_threads import signals_elsewhere
from grasp_factory.apps.session_page.session_snapshot import ENDED
from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.errors import UsageError

HOST = "127.0.0.1"
WATCHED_S = 5.0
"""A page counts as open for this many seconds after its last request."""
LAST_WORD_S = 3.0
"""Most seconds that the end waits for the last request of such a page."""


class SessionPage:
    """Serves the page of one session, from ``start`` to the end of its ``with`` block."""

    def __init__(self, port: int | None, tell: Callable[[str], None]) -> None:
        """Take a port; nothing is served before ``start``.

        Args:
            port: where to listen; None for the default, or the next one that is free.
            tell: shows the user a line.

        Raises:
            UsageError: if the port cannot be used, or the server's libraries are not installed.
        """
        require_server()
        from grasp_factory.apps.browse.serving import Server, listen  # noqa: PLC0415

        try:
            self._socket: socket.socket = listen(HOST, port)
        except UsageError as error:
            raise UsageError(str(error).replace("--port", "--live-port")) from None
        self._tell = tell
        self._server: Server | None = None
        self._looked_at = float("-inf")
        self._has_last_word = threading.Event()

    def start(self, recorder: SessionRecorder) -> None:
        """Serve the page of a session, and tell its address."""
        from grasp_factory.apps.browse.guard import Guard  # noqa: PLC0415
        from grasp_factory.apps.browse.serving import (  # noqa: PLC0415
            Server,
            address,
            own_names,
        )
        from grasp_factory.apps.session_page.session_routes import session_app  # noqa: PLC0415

        token = secrets.token_urlsafe(24)
        try:
            with signals_elsewhere():
                app = session_app(recorder, Guard.of(own_names(HOST), token), self._look)
                self._server = Server(app, self._socket).start()
        except Exception as error:
            self._tell(f"the live page cannot be served ({error}); the session goes on")
            return
        self._tell(f"Live page: {address(HOST, self._server.port, token)}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let an open page fetch how the session ended, and stop the server."""
        with contextlib.suppress(KeyboardInterrupt):
            if time.monotonic() - self._looked_at <= WATCHED_S:
                self._has_last_word.wait(LAST_WORD_S)
            if self._server is not None:
                self._server.stop()
        if self._server is None:
            self._socket.close()

    def _look(self, phase: str) -> None:
        self._looked_at = time.monotonic()
        if phase == ENDED:
            self._has_last_word.set()
