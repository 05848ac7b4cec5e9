"""The command that shows stores in a web browser: ``browse``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import secrets
import threading
from contextlib import ExitStack
from pathlib import Path

import click

from grasp_factory.cli.page_serving import serve_until_ctrl_c
from grasp_factory.cli.params import STORE_PATH, Command, option
from grasp_factory.cli.printing import say


@click.command(
    cls=Command,
    examples=(
        "grasp-factory browse grasps.zarr",
        "grasp-factory browse grasps.zarr --read-only --no-open --port 8700",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True, type=STORE_PATH)
@option(
    "--port",
    metavar="PORT",
    type=click.IntRange(1, 65535),
    help="Port of the server.  [default: 8642, or the next free port]",
)
@option(
    "--host",
    metavar="ADDRESS",
    default="127.0.0.1",
    show_default=True,
    help="Address that the server listens on; 0.0.0.0 lets other machines connect.",
)
@option(
    "--allow-host",
    "names",
    metavar="NAME",
    multiple=True,
    help="Also answer requests to this host name, such as a proxy's. Repeatable.",
)
@option("--no-open", is_flag=True, help="Print the address and do not open a browser.")
@option(
    "--index",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Index file.  [default: in the cache]",
)
@option("--read-only", is_flag=True, help="Do not allow tags or other changes.")
def browse(
    paths: tuple[Path, ...],
    port: int | None,
    host: str,
    names: tuple[str, ...],
    *,
    no_open: bool,
    index: Path | None,
    read_only: bool,
) -> None:
    """Search, view and tag episodes in a web browser.

    Serves a page for the stores at PATH, or for the stores of an index file, until Ctrl-C, and
    prints its address. Only this machine can open it unless --host is set.
    """
    from grasp_factory.apps.browse import require_server

    require_server()
    from grasp_factory.apps.browse.app import create_app
    from grasp_factory.apps.browse.serving import Server, address, is_loopback, listen, own_names
    from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
    from grasp_factory.cli.bars import counted
    from grasp_factory.dataset.index import fresh

    token = "" if read_only else secrets.token_urlsafe(24)
    thumbnails = Thumbnails()
    with ExitStack() as stack:
        socket = stack.enter_context(listen(host, port))  # fails before the index is built
        with counted("on_row") as hooks:
            found = fresh(paths, index, **hooks)  # never closed: a request may still read it
        app = create_app(found, token, own_names(host, names), thumbnails=thumbnails)
        server = stack.enter_context(Server(app, socket))
        url = address(host, server.port, token)
        if not is_loopback(host):
            what = f"everybody who can connect to {host} can see the data"
            more = "" if read_only else "; everybody with the link can add tags"
            say(f"Warning: {what}{more}", err=True)
        threading.Thread(target=thumbnails.prune, daemon=True).start()
        serve_until_ctrl_c(url, no_open=no_open)
