"""The application that every page of this package begins with."""

from __future__ import annotations

from flask import Flask

from grasp_factory.apps.browse.guard import Guard, install
from grasp_factory.apps.browse.responses import tell_errors_as_json


def guarded_app(name: str, guard: Guard) -> Flask:
    """Return an application without addresses that a guard protects and that tells errors as JSON.

    Args:
        name: its import name.
        guard: decides who may look, and who may write.
    """
    app = Flask(name, static_folder=None)
    app.config["PROVIDE_AUTOMATIC_OPTIONS"] = False
    app.url_map.merge_slashes = False  # an address with double slashes is refused
    install(app, guard)
    tell_errors_as_json(app)
    return app
