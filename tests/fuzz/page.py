"""Parsers of what a browser sends to the page, and of queries."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from flask.testing import FlaskClient
from fuzz.target import Target
from support.places import TINY

from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.dataset.index.opening import fresh
from grasp_factory.dataset.index.query import Query

ADDRESSES = (
    b"/api/episodes?where=policy%3Duniform&sort=-lift_height&limit=60&offset=0",
    b"/api/histogram?column=lift_height&where=success%3Dtrue&bins=20",
    b"/api/neighbours/0/2?sort=-lift_height",
    b"/api/ids?where=tags%3Dodd",
    b"/image/0/1/front/rgb/0.png",
    b"/thumb/0/1.jpg?v=1",
    b"/cloud/0/1/0?camera=front",
    b"/api/series/0/1",
    b"/api/episode/0/2",
    b"/static/main.js",
)
CHANGES = (
    b'{"episodes": [[0, 1], [0, 2]], "who": "ada", "changes": [["tag", "odd"], ["note", "late"]]}',
    b'{"episodes": [[0, 3]], "who": "bo", "changes": [["outcome", "dropped"], ["untag", "odd"]]}',
)


@cache
def client() -> FlaskClient:
    """Return a client of the page over a copy of a store."""
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    store = Path(shutil.copytree(TINY, folder / "s.zarr"))
    index = fresh([store], folder / "index.sqlite")
    app = create_app(index, "token", {"localhost"}, thumbnails=Thumbnails(folder / "thumbnails"))
    return app.test_client()


def get(data: bytes) -> None:
    """Ask for an address."""
    try:
        answer = client().get(data.decode("latin-1"))
    except ValueError:  # no address: the test's client refuses it
        return
    answer.close()
    assert answer.status_code < 500, answer.status


def change(data: bytes) -> None:
    """Send changes of annotations."""
    headers = {"X-Token": "token", "Content-Type": "application/json"}
    answer = client().post("/api/annotations", data=data, headers=headers)
    assert answer.status_code < 500, answer.status


def query(data: bytes) -> None:
    """Parse conditions, a line each, and the order."""
    *where, sort = data.decode("utf-8", "replace").split("\n")
    Query.parse(where, sort)


def examples(*given: bytes) -> Callable[[], list[bytes]]:
    return lambda: list(given)


TARGETS = {
    "address": Target(get, examples(*ADDRESSES)),
    "change of annotations": Target(change, examples(*CHANGES), is_json=True),
    "query": Target(
        query,
        examples(
            b"policy=uniform\n", b"lift_height>0.1\nsuccess=false\n-lift_height",
            b"outcome=lost_in_lift\ncreated_at>=2026-01-01T00:00:00Z\nrow",
        ),
    ),
}  # fmt: skip
