"""A limit on concurrent index queries, so that files and pictures are still served quickly."""

from __future__ import annotations

import threading

from flask import Flask, abort, g, request

ASKING = 9
"""Threads that may query the index at once; the server has a few more for quick requests."""
WAIT_S = 1.0
"""Seconds that a request waits for one of these threads."""
ANSWER_S = 5.0
"""Maximum seconds of one index query."""
_OF_INDEX = (
    *("/api/library", "/api/episode", "/api/ids", "/api/histogram", "/api/neighbours"),
    "/api/annotations",
)


def install(app: Flask) -> None:
    """Make an app answer at most ``ASKING`` requests at once that read or write the index."""
    places = threading.BoundedSemaphore(ASKING)

    @app.before_request
    def enter() -> None:
        if not request.path.startswith(_OF_INDEX):
            return
        if not places.acquire(timeout=WAIT_S):
            abort(503, "too many ask at once: try again in a few seconds")
        g.has_place = True

    @app.teardown_request
    def leave(_: BaseException | None) -> None:
        if g.pop("has_place", False):
            places.release()
