"""The appearance of bodies: colours, textures, hidden links, and rendering."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Camera, Light
from grasp_factory.core.renderer import Renderer
from grasp_factory.errors import RecipeError
from grasp_factory.simulation.world.engine import p
from grasp_factory.simulation.world.textures import Textures

Hidden = list[tuple[int, int, Sequence[float]]]
"""Rows of a link, the index of one of its shapes and the shape's colour, for ``Visuals.show``."""


class Visuals:
    """Sets the appearance of a client's bodies, and renders them."""

    def __init__(self, client: int, renderer: Renderer, textures: Textures) -> None:
        self._client = client
        self._renderer = renderer
        self._textures = textures
        self._colors: dict[int, Sequence[float]] = {}

    def forget(self) -> None:
        """Forget all colours after a reset, which removes all bodies."""
        self._colors.clear()

    def set_look(self, body: int, color: Sequence[float], texture: str) -> None:
        """Set a body's colour, multiplied by a texture's colour if one is named.

        Raises:
            UnknownNameError: if there is no such texture.
            RecipeError: if the renderer does not support textures.
        """
        if texture and not self._renderer.has_textures:
            raise RecipeError(f"texture {texture!r}: renderer {self._renderer.value} has none")
        self._colors[body] = rgba = (*color, 1.0)
        for link in range(-1, p.getNumJoints(body, physicsClientId=self._client)):
            p.changeVisualShape(
                body,
                link,
                rgbaColor=rgba,
                textureUniqueId=self._textures.find(texture),
                physicsClientId=self._client,
            )

    def hide(self, body: int, links: Container[int] | None = None) -> Hidden:
        """Hide a body, or some of its links, in all renders; return what ``show`` needs."""
        hidden: Hidden = []
        for row in p.getVisualShapeData(body, physicsClientId=self._client):
            if links is not None and row[1] not in links:
                continue
            link, rgba = row[1], self._colors.get(body, row[7])  # OpenGL: [7] is the file's colour
            shape = sum(link == other for other, _, _ in hidden)  # counted per link
            hidden.append((link, shape, rgba))
            self._tint(body, (link, shape), (0.0, 0.0, 0.0, 0.0))
        return hidden

    def show(self, body: int, hidden: Hidden) -> None:
        """Show a body again as it was."""
        for link, shape, rgba in hidden:
            self._tint(body, (link, shape), rgba)

    def render(
        self, camera: Camera, light: Light
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
        """Return RGB (H, W, 3), the z-buffer (H, W) and body + (link + 1) * 2^24 (H, W)."""
        _, _, rgba, zbuffer, mask = p.getCameraImage(
            camera.intrinsics.width,
            camera.intrinsics.height,
            viewMatrix=camera.opengl_view().T.ravel().tolist(),
            projectionMatrix=camera.opengl_projection().T.ravel().tolist(),
            lightDirection=light.direction,
            lightColor=light.color,
            lightDistance=2.0,
            shadow=0,
            lightAmbientCoeff=light.ambient,
            lightDiffuseCoeff=light.diffuse,
            lightSpecularCoeff=light.specular,
            renderer=p.ER_TINY_RENDERER,  # a loaded plugin renders instead
            flags=p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
            physicsClientId=self._client,
        )
        return rgba[..., :3], zbuffer, mask

    def _tint(self, body: int, place: tuple[int, int], rgba: Sequence[float]) -> None:
        link, shape = place
        p.changeVisualShape(
            body, link, shapeIndex=shape, rgbaColor=rgba, physicsClientId=self._client
        )
