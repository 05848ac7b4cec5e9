"""That many questions at once leave room for files and pictures."""

from __future__ import annotations

import threading

from flask import Flask, abort, g, request

ASKING = 9
"""Threads that may look things up at once; the server has a few more for what is quick."""
WAIT_S = 1.0
"""How long a request waits for one of them."""
ANSWER_S = 5.0
"""How long the index may look for an answer."""
_OF_INDEX = (
    *("/api/library", "/api/episode", "/api/ids", "/api/histogram", "/api/neighbours"),
    "/api/annotations",
)


def install(app: Flask) -> None:
    """Make an app answer only so many requests of the index, or to it, at once."""
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
