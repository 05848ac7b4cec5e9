"""What the engine shows: colours, textures, what is hidden, and the render itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasp_factory.camera import Camera, Light
from grasp_factory.world.engine import p

Hidden = list[tuple[int, int, Sequence[float]]]
"""Link, its shape and the shape's colour, to show a body again."""


def set_look(client: int, body: int, color: Sequence[float], texture: int) -> None:
    """Show a body in a colour, multiplied with a texture's."""
    for link in range(-1, p.getNumJoints(body, physicsClientId=client)):
        p.changeVisualShape(
            body,
            link,
            rgbaColor=(*color, 1.0),
            textureUniqueId=texture,
            physicsClientId=client,
        )


def hide(client: int, body: int) -> Hidden:
    """Leave a body out of all renders and return how it looked."""
    hidden: Hidden = []
    for row in p.getVisualShapeData(body, physicsClientId=client):
        link, rgba = row[1], row[7]
        shape = sum(link == other for other, _, _ in hidden)  # they are counted by link
        hidden.append((link, shape, rgba))
        _tint(client, body, (link, shape), (0.0, 0.0, 0.0, 0.0))
    return hidden


def show(client: int, body: int, hidden: Hidden) -> None:
    """Show a body again as it was."""
    for link, shape, rgba in hidden:
        _tint(client, body, (link, shape), rgba)


def render(
    client: int, camera: Camera, light: Light
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
        renderer=p.ER_TINY_RENDERER,
        flags=p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
        physicsClientId=client,
    )
    return rgba[..., :3], zbuffer, mask


def _tint(client: int, body: int, place: tuple[int, int], rgba: Sequence[float]) -> None:
    link, shape = place
    p.changeVisualShape(body, link, shapeIndex=shape, rgbaColor=rgba, physicsClientId=client)
