"""Textures in the engine, which loads them from files only."""

from __future__ import annotations

import os
from functools import cache

import cv2

from grasp_factory.textures import texture_image
from grasp_factory.world.engine import p


def load_texture(client: int, texture: str) -> int:
    """Return the engine's id of a texture, which holds until the next reset.

    Raises:
        UnknownNameError: if there is no such texture.
    """
    loaded: int = p.loadTexture(_file_of(texture), physicsClientId=client)
    return loaded


@cache
def _file_of(texture: str) -> str:
    """Return a PNG file in memory, which stays open as long as the process.

    The loader caches images by their file's name, so no other may ever come under this one.
    """
    ok, data = cv2.imencode(".png", texture_image(texture)[..., ::-1])
    assert ok
    file = os.memfd_create(texture.replace("/", "_"))
    os.write(file, data.tobytes())
    return f"/proc/self/fd/{file}"
