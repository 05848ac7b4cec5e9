"""The browse page's server as a WSGI application."""

from __future__ import annotations

from collections.abc import Collection

from flask import Flask

from grasp_factory.apps.browse import changing, crowd, files, listing, viewing
from grasp_factory.apps.browse.answers import tell_errors_as_json
from grasp_factory.apps.browse.asking import Number
from grasp_factory.apps.browse.guard import Guard, install
from grasp_factory.apps.browse.shelf import Shelf
from grasp_factory.apps.browse.site import Live, Site
from grasp_factory.apps.browse.thumbnails import Thumbnails
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
        index: Of the stores to show.
        token: What a request must have to change anything; empty for a page that only reads.
        hosts: The names and addresses, without port, that it may be asked for.
        live: A run that makes episodes meanwhile.
        thumbnails: Where small pictures are kept; None for the cache.
    """
    index.patience_s = crowd.ANSWER_S
    site = Site(
        index=index,
        guard=Guard.of(hosts, token),
        shelf=Shelf(index.stores),
        thumbnails=thumbnails or Thumbnails(),
        live=live,
    )
    app = Flask("grasp_factory.apps.browse", static_folder=None)
    app.config["PROVIDE_AUTOMATIC_OPTIONS"] = False
    app.url_map.merge_slashes = False  # an address that is not quite right is refused, not mended
    app.url_map.converters["n"] = Number
    install(app, site.guard)
    crowd.install(app)
    app.before_request(site.freshness.restore)
    tell_errors_as_json(app)
    for part in (files.routes(), listing.routes(site), viewing.routes(site), changing.routes(site)):
        app.register_blueprint(part)
    return app
