"""Publishing of a folder that is killed at one of its calls; a spawned process imports it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from unittest import mock

from grasp_factory.core.output_folder import publish

CALLS = ("mkdir", "replace", "rename", "rmdir")


def publish_until_killed(folder: Path, calls: int, is_done: bool) -> None:
    """Publish, and be killed before, or after, one of the calls that change the folder."""
    left = iter(range(calls))

    def call(real: Callable[..., object], *args: object, **more: object) -> None:
        is_last = next(left, None) is None
        if not is_last or is_done:
            real(*args, **more)
        if is_last:
            os.kill(os.getpid(), signal.SIGKILL)

    def killing(name: str) -> Callable[..., None]:
        real = getattr(os, name)
        return lambda *args, **more: call(real, *args, **more)

    for name in CALLS:
        mock.patch.object(os, name, killing(name)).start()
    publish(folder / "built", folder / "out", "a test")
