"""The browse page: a local web server over an index of stores. It needs the ``[browse]`` extra."""

from __future__ import annotations

from grasp_factory.core.optional import require


def require_server() -> None:
    """Check that the libraries that serve pages are installed.

    Raises:
        UsageError: if some are missing; the message says which, and how to install them.
    """
    require("flask", "waitress", extra="browse")
