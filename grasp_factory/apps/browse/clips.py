"""Clips of attempts, made on request in a process with limits, and kept in the cache.

A recipe may come from a stranger: it is read and rendered in the worker process alone. Only one
clip is made at a time. The process ends when nobody waits for its clip any more.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NoReturn

from flask import abort

from grasp_factory import __version__
from grasp_factory.apps.browse.open_stores import OpenStore
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.core.cache import digest
from grasp_factory.core.executors import Check
from grasp_factory.core.executors.pool import CHECK_S
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation import isolation
from grasp_factory.errors import StoreError
from grasp_factory.factory.plugins import check_given

SIZES = {"small": (200, 24), "large": (480, 60)}
"""Longer side in pixels and maximum number of images: of cards, and of an episode's page."""
PRUNED_AFTER = 50
"""Clips that are made before the cache is pruned: a server may run for long."""
WAITING = 3
"""Requests for clips at once: one is made, the others wait."""
SUFFIX = ".clip"

IsGone = Callable[[], bool]
"""Returns whether nobody waits for the answer any more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WantedClip:
    """A clip of a committed episode."""

    opened: OpenStore
    row: int
    version: str
    """The row's; see ``OpenStore.version``."""
    camera: str
    """One of the episode's."""
    size: str
    """One of ``SIZES``."""

    @property
    def key(self) -> str:
        """A text that changes with all that the clip depends on."""
        config = digest(json.dumps(to_plain(self.opened.dataset.config), sort_keys=True).encode())
        shown = f"{self.version} {self.row} {self.camera} {SIZES[self.size]}"
        return f"{__version__} {config} {shown}"


@dataclass(frozen=True, slots=True)
class Clips:
    """Makes clips, one at a time."""

    cache: Thumbnails
    _made_before: Iterator[int] = field(default_factory=lambda: count(1))
    _making: threading.Lock = field(default_factory=threading.Lock)
    _places: threading.BoundedSemaphore = field(
        default_factory=lambda: threading.BoundedSemaphore(WAITING)
    )

    def get(self, wanted: WantedClip, is_gone: IsGone) -> bytes:
        """Return a clip, as ``clip.packed`` does, or abort with 503 if too many are wanted.

        Args:
            wanted: which clip.
            is_gone: asked several times a second; the worker process ends when it is true.

        Raises:
            StoreError: if the episode is damaged, or making the clip ends the process.
            LimitError: if it needs more memory or time than the limits allow.
            PluginError: if it needs code of the user that was not given.
        """
        return self.cache.get(wanted.key, lambda: self._made(wanted, is_gone), SUFFIX)

    def _prune_at_times(self) -> None:
        if next(self._made_before) % PRUNED_AFTER == 0:
            self.cache.prune()

    def _made(self, wanted: WantedClip, is_gone: IsGone) -> bytes:
        def check() -> None:
            if is_gone():
                abort(503, "nobody waits for this clip any more")

        check_given(wanted.opened.dataset.config)
        if not self._places.acquire(blocking=False):
            abort(503, "other clips are being made: try again in a few seconds")
        try:
            while not self._making.acquire(timeout=CHECK_S):
                check()
            try:
                self._prune_at_times()
                return _rendered(wanted, check)
            finally:
                self._making.release()
        finally:
            self._places.release()


def no_clip(why: str) -> bytes:
    """Return the clip of an episode that cannot be rendered: no images, and then the reason."""
    return bytes(4) + why.encode()


def _rendered(wanted: WantedClip, check: Check) -> bytes:
    from grasp_factory.apps.playback.clip import ClipJob, make_clip  # noqa: PLC0415 (PyBullet)

    path = wanted.opened.dataset.path

    def lost(job: Any, why: str) -> NoReturn:
        raise StoreError(f"episode {wanted.row} of {path}: {isolation.ended(why)}")

    side, most = SIZES[wanted.size]
    job = ClipJob(path=path, row=wanted.row, camera=wanted.camera, side=side, most=most)
    (made,) = isolation.isolated(check=check).run(
        make_clip, [job], _ignore, lost, isolation.patience
    )
    return made


def _ignore(message: Any) -> None:
    """The times of images are reported so that the worker is known to work."""
