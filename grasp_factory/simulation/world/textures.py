"""Textures in the engine, which loads them from files only."""

from __future__ import annotations

from functools import cache

import cv2

from grasp_factory.core.textures import texture_image
from grasp_factory.simulation.world.engine import p
from grasp_factory.simulation.world.memory import file_in_memory

NO_TEXTURE = -1


class Textures:
    """The textures of a client; each is loaded once per reset, because the engine keeps all."""

    def __init__(self, client: int) -> None:
        self._client = client
        self.loaded: dict[str, int] = {}

    def find(self, texture: str) -> int:
        """Return the engine's id of a texture; ``NO_TEXTURE`` for an empty name.

        Raises:
            UnknownNameError: if there is no such texture.
        """
        if not texture:
            return NO_TEXTURE
        if texture not in self.loaded:
            file = _file_of(texture)
            self.loaded[texture] = p.loadTexture(file, physicsClientId=self._client)
        return self.loaded[texture]

    def forget(self) -> None:
        """Forget all ids after a reset, which makes them invalid."""
        self.loaded.clear()


@cache
def _file_of(texture: str) -> str:
    """Return the path of a texture's PNG file in memory."""
    ok, data = cv2.imencode(".png", texture_image(texture)[..., ::-1])
    assert ok
    return file_in_memory(texture.replace("/", "_"), data.tobytes())
