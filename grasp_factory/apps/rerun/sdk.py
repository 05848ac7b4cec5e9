"""The Rerun SDK itself: whether it is installed, the names of its files, and its viewer."""

from __future__ import annotations

import contextlib
import os
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from subprocess import DEVNULL

from grasp_factory.core.optional import require
from grasp_factory.core.output_file import FileKind
from grasp_factory.errors import GraspFactoryError

_FORCES_STATISTICS = {"FORCE_RERUN_ANALYTICS"}

RRD = FileKind(what="a Rerun recording", suffix=".rrd", magic=b"RRF")


def require_rerun() -> None:
    """Check that the Rerun SDK is installed.

    Raises:
        UsageError: if it is not; the message says how to install it.
    """
    require("rerun", extra="rerun")


def default_file(store: Path, index: int) -> Path:
    """Return the default file of an episode's recording, in the current folder."""
    return Path(f"{store.resolve().name.removesuffix('.zarr')}-{index}.rrd")


def open_viewer(file: Path) -> None:
    """Show a recording in the Rerun viewer and wait until its window is closed.

    The viewer gets empty settings folders in which its usage statistics are off, because it sends
    them by default. The user's own settings are neither read nor written.

    Raises:
        UsageError: if the SDK is not installed.
        GraspFactoryError: if the viewer cannot run here.
    """
    with tempfile.TemporaryDirectory() as home, contextlib.suppress(KeyboardInterrupt):
        quiet = viewer_environment(Path(home))
        _run(quiet, "analytics", "disable", stdout=DEVNULL, stderr=DEVNULL)
        try:
            _run(quiet, "--bind", "127.0.0.1", "--port", "auto", str(file.absolute()))
        except GraspFactoryError as error:
            raise GraspFactoryError(
                f"{error}: it needs a screen and Vulkan or OpenGL; {file} is written, open it"
                f" elsewhere with: rerun {file}"
            ) from None


def viewer_environment(home: Path) -> dict[str, str]:
    """Return an environment in which the viewer writes all its files below ``home``."""
    kept = {key: value for key, value in os.environ.items() if key not in _FORCES_STATISTICS}
    places = {f"XDG_{kind}_HOME": str(home / kind.lower()) for kind in ("CONFIG", "DATA", "CACHE")}
    return {**kept, **places}


def viewer() -> Path:
    """Return the path of the viewer's program.

    Raises:
        UsageError: if the SDK is not installed.
    """
    require_rerun()
    spec = find_spec("rerun_cli")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).with_name("rerun")


def _run(environment: Mapping[str, str], *arguments: str, **streams: int) -> None:
    try:
        done = subprocess.run([viewer(), *arguments], env=environment, check=False, **streams)  # type: ignore[call-overload]
    except OSError as error:
        raise GraspFactoryError(f"the Rerun viewer cannot run: {error.strerror}") from None
    if done.returncode:
        raise GraspFactoryError(f"the Rerun viewer ended with {done.returncode}")
