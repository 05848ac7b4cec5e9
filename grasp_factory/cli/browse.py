"""The command that shows stores in a browser."""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
import secrets
import sys
import threading
import webbrowser
from contextlib import ExitStack
from pathlib import Path

import click

from grasp_factory.errors import Terminated


@click.command()
@click.argument(
    "paths", metavar="PATH...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    help="Where to listen.  [default: 8642, or the next one that is free]",
)
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen at: who can see it."
)
@click.option(
    "--allow-host",
    "names",
    metavar="NAME",
    multiple=True,
    help="Answer under this name, too, such as a proxy's. Repeatable.",
)
@click.option("--no-open", is_flag=True, help="Only print the address; open no browser.")
@click.option(
    "--index", type=click.Path(path_type=Path), help="Index file.  [default: beside the store]"
)
@click.option("--read-only", is_flag=True, help="Nobody can tag, or change anything.")
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
    """Look at stores in a browser: search, compare, tag.

    Serves a page over the stores at PATH, or those of an index file, until Ctrl-C, and prints its
    address. Only this machine reaches it, unless --host says otherwise.
    """
    from grasp_factory.apps.browse import require_server

    require_server()
    from grasp_factory.apps.browse.app import create_app
    from grasp_factory.apps.browse.serving import Server, address, is_loopback, listen, own_names
    from grasp_factory.apps.browse.thumbnails import Thumbnails
    from grasp_factory.cli.progress import counted
    from grasp_factory.dataset.index import fresh

    token = "" if read_only else secrets.token_urlsafe(24)
    thumbnails = Thumbnails()
    with ExitStack() as stack:
        socket = stack.enter_context(listen(host, port))  # before the work of an index
        with counted("on_row") as hooks:
            found = fresh(paths, index, **hooks)  # never closed: an answer may still be at it
        app = create_app(found, token, own_names(host, names), thumbnails=thumbnails)
        server = stack.enter_context(Server(app, socket))
        url = address(host, server.port, token)
        if not is_loopback(host):
            what = f"whoever reaches this machine at {host} can see the data"
            click.echo(f"Warning: {what}; the link lets them tag, too", err=True)
        click.echo(url)
        sys.stdout.flush()
        threading.Thread(target=thumbnails.prune, daemon=True).start()
        if not no_open and _has_screen():
            webbrowser.open(url)
        _wait_for_ctrl_c()


def _wait_for_ctrl_c() -> None:
    try:
        threading.Event().wait()
    except Terminated:
        raise
    except KeyboardInterrupt:
        return


def _has_screen() -> bool:
    """Say whether a browser could show something: one of text would take the terminal."""
    return sys.platform == "darwin" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
