"""Serving a run while it makes episodes: the browse page, with the watch's snapshot at /api/live.

All of it runs in its own threads and must not disturb the run: a failure here is reported once, and
the run goes on.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any

from grasp_factory.apps.browse import require_server
from grasp_factory.apps.browse.server_threads import signals_elsewhere
from grasp_factory.apps.live.watch import FAILED, FINISHED, RUNNING, RunWatch, in_a_line
from grasp_factory.errors import UsageError
from grasp_factory.factory.block_job import Made

if TYPE_CHECKING:
    from grasp_factory.apps.browse.serving import Server
    from grasp_factory.dataset.index import Index
    from grasp_factory.factory.run_records import RunPlan

HOST = "127.0.0.1"
LONGEST_ERROR = 500
WATCHED_S = 5.0
"""A page counts as open for this many seconds after its last request."""
LAST_WORD_S = 3.0
"""Maximum seconds that the end of a run waits for the last request of such a page."""
LAST_PICTURES_S = 0.7
"""Seconds that the page then has to load its last pictures."""
OPENING_S = 60.0
"""Maximum seconds that the end of a run waits until its index is made."""


class LiveView:
    """Serves one run, from ``start`` to the end of its ``with`` block.

    The run calls ``episode`` and ``loss``, which feed the watch.
    """

    def __init__(
        self,
        port: int | None,
        tell: Callable[[str], None],
        announce: Callable[[str], None],
    ) -> None:
        """Take a port; nothing is served before ``start``.

        Args:
            port: where to listen; None for the default, or the next one that is free.
            tell: shows the user a line about an alarm or about a problem of the view.
            announce: shows the address.

        Raises:
            UsageError: if the port cannot be used, or the server's libraries are not installed.
        """
        require_server()
        from grasp_factory.apps.browse.serving import listen

        try:
            self._socket: socket.socket | None = listen(HOST, port)
        except UsageError as error:
            why = str(error).partition(": ")[2].replace("--port", "--live-port")
            raise UsageError(f"--live-port {port}: {why}") from None
        self._tell, self._announce = tell, announce
        self._watch: RunWatch | None = None
        self._index: Index | None = None
        self._server: Server | None = None
        self._opener = threading.Thread(target=self._open, name="live view", daemon=True)
        self._token = secrets.token_urlsafe(24)
        self._asked_at = float("-inf")
        self._has_last_word = threading.Event()

    def start(self, plan: RunPlan) -> None:
        """Watch the run of a plan and announce the page's URL; do nothing if the plan is empty."""
        if not plan.blocks or self._socket is None:
            return
        from grasp_factory.apps.browse.serving import address

        url = address(HOST, self._socket.getsockname()[1], self._token)
        with self._warning_instead("cannot be started"), signals_elsewhere():
            watch = RunWatch(plan, self._tell)
            watch.begin()
            self._watch = watch
            self._opener.start()
            self._announce(f"Live view: {url}&to=live")

    def episode(self, made: Made) -> None:
        """Receive an episode that was made."""
        if self._watch is not None:
            self._watch.episode(made)

    def loss(self, text: str) -> None:
        """Receive the message that a worker was lost."""
        if self._watch is not None:
            self._watch.loss(text)

    def snapshot(self) -> dict[str, Any]:
        """Return the state of the run for the page; see ``RunWatch.snapshot``."""
        assert self._watch is not None  # the server starts after the watch
        self._asked_at = time.monotonic()
        found = self._watch.snapshot()
        if found["phase"] != RUNNING:
            self._has_last_word.set()
        return found

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Let an open page fetch how the run ended, and stop the server.

        A run that is stopped by Ctrl-C or SIGTERM ends at once: its page loses the server.
        """
        if isinstance(error, KeyboardInterrupt):
            return
        with contextlib.suppress(KeyboardInterrupt):  # raised while this waits: the run is done
            if self._watch is not None:
                text = " ".join(str(error).split())[:LONGEST_ERROR] if error else ""
                self._watch.end(FAILED if error else FINISHED, text)
                if self._opener.is_alive():
                    self._opener.join(timeout=OPENING_S)
                self._wait_for_pages()
            if self._server is not None:
                self._server.stop()
            if self._index is not None:
                self._index.close()
        if self._server is None and self._socket is not None:
            self._socket.close()

    def _open(self) -> None:
        """Make the index and serve; this runs in a thread, because a large store takes long."""
        assert self._watch is not None
        assert self._socket is not None
        with self._warning_instead("cannot be served"):
            from grasp_factory.apps.browse.app import create_app
            from grasp_factory.apps.browse.serving import Server, own_names
            from grasp_factory.dataset.index import fresh

            self._index = fresh([self._watch.path])
            app = create_app(self._index, self._token, own_names(HOST), live=self)
            self._server = Server(app, self._socket).start()

    @contextlib.contextmanager
    def _warning_instead(self, trouble: str) -> Iterator[None]:
        """Report an exception instead of raising it: the run does not need the view."""
        try:
            yield
        except Exception as error:
            self._tell(f"the live view {trouble} ({in_a_line(error)}); the run goes on")

    def _wait_for_pages(self) -> None:
        is_watched = time.monotonic() - self._asked_at <= WATCHED_S
        if is_watched and self._has_last_word.wait(LAST_WORD_S):
            time.sleep(LAST_PICTURES_S)
