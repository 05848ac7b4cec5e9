"""The address that receives users' tags and notes: the only one that changes anything."""

from __future__ import annotations

import contextlib
import json
from typing import Any

from flask import Blueprint, Response, request

from grasp_factory.apps.browse.responses import json_answer
from grasp_factory.apps.browse.site import Site
from grasp_factory.core.serialization import is_integer, to_plain
from grasp_factory.errors import GraspFactoryError, UsageError, shown

MOST_CHANGES = 20_000
"""Maximum changes per request, summed over its episodes."""
_VALID = '{"episodes": [[store, row], ...], "who": name, "changes": [[kind, value], ...]}'


def routes(site: Site) -> Blueprint:
    """Return the address of changes."""
    pages = Blueprint("changing", __name__)

    @pages.post("/api/annotations")
    def annotate() -> Response:
        site.guard.check_writing(request)
        rows_of, who, changes = _asked(request.get_data())
        logs = {store: site.store(store).log for store in rows_of}
        told = []
        for store, rows in rows_of.items():
            written = logs[store].append(who, rows, changes)
            with contextlib.suppress(GraspFactoryError):  # the log has the change in any case
                site.index.annotated(store, written)
            told += [
                {"store": store, "row": row, "annotation": to_plain(annotation)}
                for row, annotation in written.items()
            ]
        return json_answer({"annotations": told})

    return pages


def _asked(body: bytes) -> tuple[dict[int, list[int]], str, list[tuple[str, Any]]]:
    """Return the rows by store, the author and the changes in a request's body.

    Raises:
        UsageError: if the body has another form.
    """
    try:
        asked = json.loads(body)
        episodes, who, changes = (asked[key] for key in ("episodes", "who", "changes"))
    except (ValueError, RecursionError, KeyError, TypeError):
        raise UsageError(f"the body is not of the form {_VALID}") from None
    for name, value in (("episodes", episodes), ("changes", changes)):
        pairs = isinstance(value, list) and all(isinstance(v, list) and len(v) == 2 for v in value)
        if not (pairs and value):
            raise UsageError(f"{name}: got {shown(value)}, valid: one pair or more, as in {_VALID}")
    if len(episodes) * len(changes) > MOST_CHANGES:
        got = f"got {len(changes)} changes of {len(episodes)} episodes"
        raise UsageError(f"{got}, valid: up to {MOST_CHANGES} in all; send them in parts")
    if not isinstance(who, str):
        raise UsageError(f"who: got {shown(who)}, valid: a name")
    rows_of: dict[int, list[int]] = {}
    for store, row in episodes:
        if not (_is_small(store) and _is_small(row)):
            raise UsageError(f"episodes: got {shown([store, row])}, valid: [store, row]")
        rows_of.setdefault(store, []).append(row)
    for kind, _ in changes:
        if not isinstance(kind, str):
            raise UsageError(f"changes: got {shown(kind)}, valid: the name of a change")
    return rows_of, who, [(kind, value) for kind, value in changes]


def _is_small(value: Any) -> bool:
    return is_integer(value) and 0 <= value < 10**9
