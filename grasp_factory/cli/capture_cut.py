"""The command that shows a page to cut a recorded session by hand: ``capture cut``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import secrets
from contextlib import ExitStack
from pathlib import Path

import click

from grasp_factory.cli.page_serving import serve_until_ctrl_c
from grasp_factory.cli.params import Command, option
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import from_plain

_PATH = click.Path(path_type=Path)
HOST = "127.0.0.1"


@click.command(
    cls=Command,
    examples=(
        "grasp-factory capture cut session_1",
        "grasp-factory capture cut session_1 --out session_1.csv --no-open",
    ),
)
@click.argument("session", type=_PATH)
@option(
    "--out",
    "file",
    metavar="FILE",
    type=_PATH,
    default="cuts.csv",
    show_default=True,
    help="CSV file of episodes, for `capture import --cuts`. One that exists is shown and changed.",
)
@option("--settings", metavar="FILE", type=_PATH, help="YAML file of import settings.")
@option(
    "--port",
    metavar="PORT",
    type=click.IntRange(1, 65535),
    help="Port of the server.  [default: 8642, or the next free port]",
)
@option("--no-open", is_flag=True, help="Print the address and do not open a browser.")
def cut(
    session: Path, file: Path, *, settings: Path | None, port: int | None, no_open: bool
) -> None:
    """Cut a recorded session into episodes on a page.

    Serves a page until Ctrl-C, and prints its address, which only this machine can open. It shows
    images, curves and events over time. Saving writes FILE; the session is not changed.
    """
    from grasp_factory.apps.browse import require_server

    require("mcap", "rosbags", extra="capture")
    require_server()
    from grasp_factory.apps.browse.guard import Guard
    from grasp_factory.apps.browse.serving import Server, address, listen, own_names
    from grasp_factory.apps.cutting_page.cutting_document import CuttingDocument
    from grasp_factory.apps.cutting_page.cutting_routes import cutting_app
    from grasp_factory.apps.cutting_page.preview_images import Previews
    from grasp_factory.capture.importing.cut_overview import cut_overview
    from grasp_factory.capture.importing.import_settings import ImportSettings
    from grasp_factory.core.config.yaml_loader import read_yaml

    chosen = from_plain(ImportSettings, read_yaml(settings) if settings else {}, "settings")
    document = CuttingDocument.open(file)
    token = secrets.token_urlsafe(24)
    with ExitStack() as stack:
        socket = stack.enter_context(listen(HOST, port))  # fails before the session is read
        overview = cut_overview(session, chosen)
        previews = Previews()
        app = cutting_app(overview, previews, document, Guard.of(own_names(HOST), token))
        server = stack.enter_context(Server(app, socket))
        previews.start(session, overview.start_ns, overview.duration_s)
        serve_until_ctrl_c(address(HOST, server.port, token), no_open=no_open)
