"""The browse page: a local web server over an index of stores. It needs the ``[browse]`` extra."""

from __future__ import annotations

from importlib.util import find_spec

from grasp_factory.errors import UsageError


def require_server() -> None:
    """Check that the libraries that serve pages are there.

    Raises:
        UsageError: naming those that are not, and how to install them.
    """
    missing = [name for name in ("flask", "waitress") if find_spec(name) is None]
    if missing:
        raise UsageError(
            f"this needs {', '.join(missing)}, not installed: pip install 'grasp-factory[browse]'"
        )
