"""Answers: JSON, bytes that a browser may cache, and errors as JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flask import Flask, Response, request
from werkzeug.exceptions import HTTPException

from grasp_factory.apps.browse.numbers import json_bytes
from grasp_factory.core.cache import digest
from grasp_factory.errors import GraspFactoryError, UsageError

BYTES = "application/octet-stream"
_YEAR = "private, max-age=31536000, immutable"
_ASK = "private, no-cache"


def json_answer(value: Any, code: int = 200) -> Response:
    """Return a value as JSON."""
    return Response(json_bytes(value), code, content_type="application/json")


def cached_answer(current: str, kind: str, make: Callable[[], bytes]) -> Response:
    """Return bytes that depend only on an episode; they are not made if the browser has them.

    If the address contains the episode's version as ``?v=``, the browser caches the answer for a
    year. Otherwise it asks each time, and gets status 304 if nothing has changed.

    Args:
        current: The episode's version; see ``OpenStore.version``.
        kind: Content type.
        make: Makes the bytes.
    """
    tag = digest(f"{current} {request.path} {request.query_string!r}".encode())[:32]
    is_named = bool(current) and request.args.get("v") == current
    if request.if_none_match.contains(tag):
        answer = Response(status=304)
    else:
        answer = Response(make(), content_type=kind)
    answer.set_etag(tag)
    answer.headers["Cache-Control"] = _YEAR if is_named else _ASK
    return answer


def tell_errors_as_json(app: Flask) -> None:
    """Make an app answer every error with its text as JSON; a bug's traceback goes to stderr."""

    @app.errorhandler(HTTPException)
    def http(error: HTTPException) -> Response:
        answer = json_answer({"error": error.description}, error.code or 500)
        if isinstance(allowed := getattr(error, "valid_methods", None), list | tuple | set):
            answer.headers["Allow"] = ", ".join(sorted(allowed))
        return answer

    @app.errorhandler(GraspFactoryError)
    def ours(error: GraspFactoryError) -> Response:
        return json_answer({"error": str(error)}, 400 if isinstance(error, UsageError) else 503)

    @app.errorhandler(Exception)
    def bug(error: Exception) -> Response:
        app.logger.error("%s %s", request.method, request.path, exc_info=error)
        return json_answer({"error": "the server failed; the terminal it runs in says why"}, 500)
