"""Serving a run while it makes episodes: the browse page, with the watch's snapshot at /api/live.

Everything of it runs in threads beside the run, which must not notice: whatever fails here is told
once, and the episodes go on.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import contextlib
import secrets
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any

from grasp_factory.apps.browse import require_server
from grasp_factory.apps.live.watch import FAILED, FINISHED, RUNNING, RunWatch, in_a_line
from grasp_factory.errors import UsageError
from grasp_factory.factory.block_job import Made

if TYPE_CHECKING:
    from grasp_factory.apps.browse.serving import Server
    from grasp_factory.factory.generate import RunPlan

HOST = "127.0.0.1"
LONGEST_ERROR = 500
WATCHED_S = 5.0
"""Seconds since a page last asked, within which somebody is taken to look at it."""
LAST_WORD_S = 3.0
"""Seconds that the end of a run waits, at most, for such a page to ask once more."""
LAST_PICTURES_S = 0.7
"""Seconds that it then has for its last pictures."""
OPENING_S = 60.0
"""Seconds that the end of a run waits for its index, which is being made."""


class LiveView:
    """Serves one run, from ``start`` to the end of its ``with`` block; its hooks feed the watch."""

    def __init__(
        self,
        port: int | None,
        tell: Callable[[str], None],
        announce: Callable[[str], None],
    ) -> None:
        """Take a port; nothing is served yet, and nothing has been made.

        Args:
            port: where to listen; None for the default, or the next one that is free.
            tell: shows a person a line, of an alarm or of trouble with the view.
            announce: shows the address.

        Raises:
            UsageError: if the port cannot be had, or what serves pages is not installed.
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
        self._server: Server | None = None
        self._opener = threading.Thread(target=self._open, name="live view", daemon=True)
        self._token = secrets.token_urlsafe(24)
        self._asked_at = float("-inf")
        self._has_last_word = threading.Event()

    def start(self, plan: RunPlan) -> None:
        """Watch what a plan makes, and tell where it can be seen; nothing if it makes nothing."""
        if not plan.blocks or self._socket is None:
            return
        from grasp_factory.apps.browse.serving import address

        url = address(HOST, self._socket.getsockname()[1], self._token)
        with self._costing_nothing("cannot be started"), _signals_elsewhere():
            watch = RunWatch(plan, self._tell)
            watch.begin()
            self._watch = watch
            self._opener.start()
            self._announce(f"Live view: {url}&to=live")

    def episode(self, made: Made) -> None:
        """Hear of an episode that was made."""
        if self._watch is not None:
            self._watch.episode(made)

    def loss(self, text: str) -> None:
        """Hear that a worker was lost."""
        if self._watch is not None:
            self._watch.loss(text)

    def snapshot(self) -> dict[str, Any]:
        """Return how the run stands, for the page; see ``RunWatch.snapshot``."""
        assert self._watch is not None  # the server starts after it
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
        """Let a page that is open learn how the run ended, and end the server.

        A run that is stopped by Ctrl-C or SIGTERM ends at once: its page finds the server gone.
        """
        if isinstance(error, KeyboardInterrupt):
            return
        with contextlib.suppress(KeyboardInterrupt):  # of the wait: the run is done
            if self._watch is not None:
                text = " ".join(str(error).split())[:LONGEST_ERROR] if error else ""
                self._watch.end(FAILED if error else FINISHED, text)
                if self._opener.is_alive():
                    self._opener.join(timeout=OPENING_S)
                self._wait_for_pages()
            if self._server is not None:
                self._server.stop()
        if self._server is None and self._socket is not None:
            self._socket.close()

    def _open(self) -> None:
        """Make the index and serve. Runs in a thread: an index of a large store takes a while."""
        assert self._watch is not None
        assert self._socket is not None
        with self._costing_nothing("cannot be served"):
            from grasp_factory.apps.browse.app import create_app
            from grasp_factory.apps.browse.serving import Server, own_names
            from grasp_factory.dataset.index import fresh

            index = fresh([self._watch.path])
            app = create_app(index, self._token, own_names(HOST), live=self)
            self._server = Server(app, self._socket).start()

    @contextlib.contextmanager
    def _costing_nothing(self, trouble: str) -> Iterator[None]:
        """Tell what fails instead of raising it: the run does not need the view."""
        try:
            yield
        except Exception as error:
            self._tell(f"the live view {trouble} ({in_a_line(error)}); the run goes on")

    def _wait_for_pages(self) -> None:
        is_watched = time.monotonic() - self._asked_at <= WATCHED_S
        if is_watched and self._has_last_word.wait(LAST_WORD_S):
            time.sleep(LAST_PICTURES_S)


@contextlib.contextmanager
def _signals_elsewhere() -> Iterator[None]:
    """Have threads that are started meanwhile never take Ctrl-C: the main thread has to wake."""
    ours = {signal.SIGINT, signal.SIGTERM, signal.SIGALRM}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ours)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
