"""Clients of the engine, with PyBullet's own renderer or its eglRenderer plugin (OpenGL)."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import grasp_factory
from grasp_factory.core.renderer import Renderer
from grasp_factory.errors import GraspFactoryError, UsageError
from grasp_factory.simulation.world.engine import muted, p

WARM_UP_FRAMES = 2
"""The colours of the first two images after the start differ from all later ones (measured)."""
PATIENCE_S = 120
"""Time limit for loading, seconds: it takes 2, but much longer after a boot or under load."""
_loaded = set[int]()
"""The clients that loaded the plugin. It always renders for the one that loaded it last."""
_IN_A_CHILD = (
    "from grasp_factory.simulation.world.engine import p\n"
    "from grasp_factory.simulation.world.connection import load_plugin\n"
    "load_plugin(p.connect(p.DIRECT))\n"
)


@cache
def check_renderer(renderer: Renderer) -> None:
    """Check, once in a process, that a renderer can be loaded here.

    The check runs in a child process, because without OpenGL the plugin ends its process.

    Raises:
        UsageError: if it cannot be loaded; the message says what to install.
    """
    if renderer is not Renderer.EGL:
        return
    _plugin_file()
    here = str(Path(grasp_factory.__file__).parent.parent)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _IN_A_CHILD],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            timeout=PATIENCE_S,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([here, *filter(None, sys.path)])},
        )
    except subprocess.TimeoutExpired:
        raise _cannot_be_loaded(f"no image within {PATIENCE_S} s") from None
    if done.returncode:
        raise _cannot_be_loaded(_cause(done.returncode, done.stderr.decode(errors="replace")))


def connect(renderer: Renderer) -> int:
    """Return a new client that renders its images with a renderer.

    Raises:
        UsageError: if the renderer cannot be loaded here.
        GraspFactoryError: if another client of this process uses OpenGL.
    """
    check_renderer(renderer)
    if renderer is Renderer.EGL and _loaded:
        raise GraspFactoryError("a second world with renderer egl: close the first one before")
    client: int = p.connect(p.DIRECT)
    if renderer is Renderer.EGL:
        with muted(1), muted(2):  # the plugin prints a message
            load_plugin(client)
        _loaded.add(client)
    return client


def load_plugin(client: int) -> None:
    """Load the plugin into a client; without OpenGL, it ends the process."""
    plugin = p.loadPlugin(_plugin_file(), "_eglRendererPlugin", physicsClientId=client)
    if plugin < 0:
        raise _cannot_be_loaded("loadPlugin failed")
    for _ in range(WARM_UP_FRAMES):
        p.getCameraImage(16, 16, physicsClientId=client)


def disconnect(client: int) -> None:
    """Disconnect a client, and unload its plugin if it has one."""
    with muted(1):  # the plugin prints a message
        p.disconnect(physicsClientId=client)
    _loaded.discard(client)


def _plugin_file() -> str:
    found = importlib.util.find_spec("eglRenderer")
    if found is None or found.origin is None:
        raise _cannot_be_loaded("this pybullet came without eglRenderer")
    return found.origin


def _cause(code: int, errors: str) -> str:
    if code < 0:
        return signal.Signals(-code).name
    lines: Sequence[str] = errors.strip().splitlines() or [f"exit code {code}"]
    return lines[-1].strip(" .")


def _cannot_be_loaded(cause: str) -> UsageError:
    return UsageError(
        f"renderer: got 'egl', but OpenGL cannot be loaded here ({cause}): install libegl1 and"
        " libgl1-mesa-dri or the GPU's driver, or take --renderer tiny"
    )
