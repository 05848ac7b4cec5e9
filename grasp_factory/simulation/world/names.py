"""Names of mesh files, as each renderer needs them."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

from grasp_factory.core.renderer import Renderer
from grasp_factory.objects import Compound, visual_parts


class MeshNames:
    """The names under which one world opens files.

    The OpenGL plugin identifies a mesh by its file's name: it would show all meshes of one file in
    the size of the first, and hide them together. So for the plugin, each mesh gets its own name.
    """

    def __init__(self, renderer: Renderer) -> None:
        self._are_own = renderer is Renderer.EGL
        self._times: Counter[Path] = Counter()

    def forget(self) -> None:
        """Forget all names after a reset, which removes all meshes."""
        self._times.clear()

    def of(self, file: Path) -> Path:
        """Return the name under which the engine opens a file."""
        if not self._are_own:
            return file
        number = self._times[file]
        self._times[file] += 1
        return Path(f"/proc/self/fd/{_descriptor(file.parent, number)}/{file.name}")

    def within(self, body: Compound) -> Compound:
        """Return a body in which each visual mesh has such a name."""
        if not self._are_own:
            return body
        parts = (replace(part, shape=str(self.of(Path(part.shape)))) for part in visual_parts(body))
        return replace(body, visual=tuple(parts))


@cache
def _descriptor(directory: Path, number: int) -> int:
    """Return descriptor ``number`` of a directory.

    It stays open for all worlds of the process, because the engine keeps files by their name.
    """
    return os.open(directory, os.O_PATH)
