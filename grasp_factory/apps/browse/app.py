"""The browse page's server as a WSGI application."""

from __future__ import annotations

from collections.abc import Collection

from flask import Flask

from grasp_factory.apps.browse import (
    annotation_routes,
    episode_routes,
    grid_routes,
    query_limit,
    static_files,
)
from grasp_factory.apps.browse.clips import Clips
from grasp_factory.apps.browse.guard import Guard
from grasp_factory.apps.browse.guarded_app import guarded_app
from grasp_factory.apps.browse.open_stores import OpenStores
from grasp_factory.apps.browse.request_parameters import Number
from grasp_factory.apps.browse.site import Live, Site
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.dataset.index import Index


def create_app(
    index: Index,
    token: str,
    hosts: Collection[str],
    live: Live | None = None,
    thumbnails: Thumbnails | None = None,
) -> Flask:
    """Return the application.

    Args:
        index: The index of the stores to show.
        token: The token that a request needs to change anything; empty for a read-only page.
        hosts: The names and addresses, without port, that a Host header may have.
        live: A run that is making episodes; None if there is no such run.
        thumbnails: Where small pictures and clips are stored; None for the cache folder.
    """
    index.patience_s = query_limit.ANSWER_S
    cache = thumbnails or Thumbnails()
    site = Site(
        index=index,
        guard=Guard.of(hosts, token),
        stores=OpenStores(index.stores),
        thumbnails=cache,
        clips=Clips(cache),
        live=live,
    )
    app = guarded_app("grasp_factory.apps.browse", site.guard)
    app.url_map.converters["n"] = Number
    query_limit.install(app)
    app.before_request(site.freshness.restore)
    for part in (
        static_files.routes(),
        grid_routes.routes(site),
        episode_routes.routes(site),
        annotation_routes.routes(site),
    ):
        app.register_blueprint(part)
    return app
