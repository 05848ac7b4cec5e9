"""The page itself: the files in ``static``, which come with the package, and its colours."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from flask import Blueprint, Response, abort, send_from_directory

from grasp_factory.apps.browse.palette_css import palette_css

FOLDER = Path(__file__).parent / "static"
TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".png": "image/png",
    ".svg": "image/svg+xml",
}
"""Content type by suffix of the files that are served; the machine's MIME table is not used."""


def routes(first: str = "index.html") -> Blueprint:
    """Return the addresses of the page's files.

    Args:
        first: the file that the server shows first.
    """
    pages = Blueprint("files", __name__)

    @pages.get("/")
    def page() -> Response:
        return _file(first)

    @pages.get("/static/palette.css")
    def colors() -> Response:
        answer = Response(palette_css(), content_type="text/css; charset=utf-8")
        answer.headers["Cache-Control"] = "no-cache"
        return answer

    @pages.get("/static/<path:name>")
    def static(name: str) -> Response:
        return _file(name)

    @pages.get("/favicon.ico")
    def icon() -> Response:
        return _file("icon.svg")

    return pages


def _file(name: str) -> Response:
    path = PurePosixPath(name)
    kind = TYPES.get(path.suffix)
    if kind is None or str(path) != name:
        abort(404, "there is no such file")
    answer = send_from_directory(FOLDER, name, mimetype=kind)
    answer.headers["Cache-Control"] = "no-cache"
    return answer
