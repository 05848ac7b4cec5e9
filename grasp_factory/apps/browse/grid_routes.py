"""The addresses of the grid: the stores, and the episodes that match a query."""

from __future__ import annotations

from typing import Any

from flask import Blueprint, Response, request

from grasp_factory import __version__
from grasp_factory.apps.browse.image_files import label_colors
from grasp_factory.apps.browse.request_parameters import asked_query, integer
from grasp_factory.apps.browse.responses import json_answer
from grasp_factory.apps.browse.site import Site
from grasp_factory.core.config.quality import QUALITY_WORDS
from grasp_factory.core.enums import Outcome, Phase, label_names, names
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.dataset.annotations import default_who
from grasp_factory.dataset.index import COLUMNS, IndexColumn, IndexedStore, NumberBins, WordBars
from grasp_factory.errors import GraspFactoryError, UsageError

MOST_ROWS, MOST_BINS, MOST_WORDS = 500, 200, 200


def routes(site: Site) -> Blueprint:
    """Return the addresses of the grid."""
    pages = Blueprint("listing", __name__)

    @pages.get("/api/library")
    def library() -> Response:
        return json_answer(_library(site, site.freshness.now()))

    @pages.get("/api/episodes")
    def episodes() -> Response:
        site.freshness.soon()
        offset, limit = integer("offset", 0, 10**9 - 1), integer("limit", 60, MOST_ROWS)
        page = site.index.page(asked_query(), offset, limit)
        rows = [row | {"version": site.version(row["store"], row["row"])} for row in page.rows]
        return json_answer({"total": page.total, "rows": rows})

    @pages.get("/api/ids")
    def ids() -> Response:
        found = site.index.ids(asked_query())
        return json_answer({"ids": [f"{store}:{row}" for store, row in found]})

    @pages.get("/api/histogram")
    def histogram() -> Response:
        column, bins = request.args.get("column", ""), integer("bins", 30, MOST_BINS)
        if not bins:
            raise UsageError(f"bins: got 0, valid: 1 to {MOST_BINS}")
        return json_answer(_histogram(site.index.histogram(column, asked_query(), bins)))

    @pages.get("/api/neighbours/<n:store>/<n:row>")
    def neighbours(store: int, row: int) -> Response:
        site.check_store(store)
        return json_answer(to_plain(site.index.neighbours(asked_query(), store, row)))

    @pages.get("/api/live")
    def live() -> Response:
        return json_answer({"live": False} if site.live is None else site.live.snapshot())

    return pages


def _library(site: Site, trouble: str) -> dict[str, Any]:
    stores = [_store(site, store) for store in site.index.stores]
    most = max((store["objects"] for store in stores), default=1)
    return {
        "version": __version__,
        "stores": stores,
        "trouble": trouble,
        "columns": [_column(site, column) for column in COLUMNS],
        "outcomes": names(Outcome),
        "phases": names(Phase),
        "qualities": QUALITY_WORDS,
        "who": default_who(),
        "live": site.live is not None,
        "writable": bool(site.guard.token),
        "labels": label_colors(label_names(most)),
    }


def _store(site: Site, store: IndexedStore) -> dict[str, Any]:
    """Return the facts of a store.

    If it cannot be read, the facts include the error, and the page still shows the other stores.
    """
    told = {"id": store.id, "name": store.name, "path": str(store.path)}
    told |= {"committed": store.committed, "episodes": store.rows, "error": ""}
    try:
        dataset = site.store(store.id).dataset
    except GraspFactoryError as error:
        nothing = {"cameras": [], "resolution": [0, 0], "video": False, "objects": 1}
        return told | nothing | {"error": str(error)}
    config = dataset.config
    return told | {
        "episodes": len(dataset),
        "cameras": list(config.cameras),
        "resolution": config.resolution,
        "video": bool(config.video_hz),
        "objects": config.clutter.count,
    }


def _column(site: Site, column: IndexColumn) -> dict[str, Any]:
    told: dict[str, Any] = to_plain(column)
    if shown := SHOWN_UNITS.get(column.name):
        told["shown"] = {"unit": shown.unit, "factor": shown.factor, "decimals": shown.decimals}
    if column.kind in ("word", "tags"):
        told["words"] = site.index.words(column.name, MOST_WORDS)
    return told


def _histogram(found: WordBars | NumberBins) -> dict[str, Any]:
    if isinstance(found, WordBars):
        bars = [dict(zip(("value", "count", "successes"), bar, strict=True)) for bar in found.bars]
        return {"column": found.column, "kind": "words", "bars": bars}
    return {"kind": "numbers", **to_plain(found)}
