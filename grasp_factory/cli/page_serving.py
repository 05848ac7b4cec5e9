"""What commands do that serve a page: tell its address, open it, and wait for Ctrl-C."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser

from grasp_factory.cli.printing import say
from grasp_factory.errors import Terminated


def serve_until_ctrl_c(url: str, *, no_open: bool) -> None:
    """Say a page's address, open it in a browser where there is a screen, and wait.

    Raises:
        Terminated: after SIGTERM.
    """
    say(url)
    sys.stdout.flush()
    if not no_open and _has_screen():
        webbrowser.open(url)
    try:
        threading.Event().wait()
    except Terminated:
        raise
    except KeyboardInterrupt:
        return


def _has_screen() -> bool:
    """Return whether there is a screen; without one, a text browser would take the terminal."""
    return sys.platform == "darwin" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
