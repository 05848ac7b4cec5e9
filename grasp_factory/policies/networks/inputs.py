"""The inputs of networks, as named arrays: an image of the crop, the width, touch over time.

All data is from before the start of the lift, and all images are from before the attempt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label, Phase
from grasp_factory.core.episode import SceneView
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check, check_range, is_integer
from grasp_factory.signals.grasp_crop import CropShape, GraspCrop, GraspRelief, grasp_relief

Inputs = Mapping[str, NDArray[np.float32]]
"""Arrays of K grasps by name: ``image`` (K, 3, S, S), ``width`` (K, 1), ``touch`` (K, 2, 6, R)."""

IMAGE, WIDTH, TOUCH = "image", "width", "touch"
KINDS: Mapping[str, tuple[str, ...]] = {
    "vision": (IMAGE, WIDTH),
    "touch": (TOUCH,),
    "both": (IMAGE, WIDTH, TOUCH),
}
"""Kind of network to the names of its inputs."""

DEEPEST = 0.1
"""Heights are clipped to this distance above and below the TCP, metres: twice a pad's length."""
HEIGHT_UNIT = 0.05
"""Height, in metres, that has the value 1 in the image."""
WIDTH_UNIT = 0.1
"""Gripper width, in metres, that has the value 1."""
FORCE_UNIT, TORQUE_UNIT = 10.0, 0.1
"""Force (N) and torque (N m) with the value 1: half the default grip force, and that at 1 cm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchWindow:
    """The time window of the touch input: it ends at the start of the lift."""

    seconds: float = 0.5
    """Duration of the window."""
    samples: int = 60
    """Number of instants in the window."""

    def __post_init__(self) -> None:
        check_range(self, "seconds", 0.01, 10.0, "s")
        check(is_integer(self.samples) and 2 <= self.samples <= 1024, "samples", self.samples,
              "2 to 1024")  # fmt: skip


def image_of(crop: GraspCrop | GraspRelief) -> NDArray[np.float32]:
    """Return (3, S, S): height in units of 50 mm, 1 where a surface is visible, 1 at the target."""
    seen = np.isfinite(crop.height)
    out = np.empty((3, *seen.shape), np.float32)
    out[0] = np.where(seen, np.clip(crop.height, -DEEPEST, DEEPEST), -DEEPEST) / HEIGHT_UNIT
    out[1], out[2] = seen, crop.label == Label.TARGET
    return out


def width_of(widths: Array) -> NDArray[np.float32]:
    """Return gripper widths (K,), metres, as (K, 1) in units of 0.1 m."""
    return np.asarray(widths / WIDTH_UNIT, dtype=np.float32)[:, None]


def touch_of(streams: Mapping[str, NDArray[Any]], window: TouchWindow) -> NDArray[np.float32]:
    """Return (2, 6, R): force and torque on each pad at R instants before the lift.

    Instants before the first record have the value 0, like those before the first contact.

    Args:
        streams: ``timestamp``, ``phase`` and ``tactile_wrench`` of an attempt with a lift.
        window: Duration and number of the instants.

    Raises:
        ValueError: if the attempt ended before the lift.
    """
    lifting = np.flatnonzero(streams["phase"] >= Phase.LIFT)
    if not len(lifting):
        raise ValueError("the attempt ended before the lift")
    before = slice(0, int(lifting[0]))
    time = streams["timestamp"][before]
    at = streams["timestamp"][lifting[0]] - window.seconds * np.arange(window.samples, 0, -1) / (
        window.samples
    )
    wrench = streams["tactile_wrench"][before].reshape(len(time), 12)
    series = np.array([np.interp(at, time, axis, left=0.0) for axis in wrench.T], dtype=np.float32)
    units = np.array([FORCE_UNIT] * 3 + [TORQUE_UNIT] * 3, np.float32)
    return np.asarray(series.reshape(2, 6, window.samples) / units[:, None])


def grasp_inputs(view: SceneView, T_world_tcp: Array, widths: Array, shape: CropShape) -> Inputs:
    """Return the inputs of ``vision`` for planned grasps, from all cameras of a view.

    Args:
        view: The view of the scene.
        T_world_tcp: Poses of the grasps, (K, 4, 4).
        widths: Distances between the pads before closing, (K,) metres.
        shape: Shape of the crops.
    """
    views = tuple(view.images.values())
    images = np.stack([image_of(grasp_relief(views, T, shape)) for T in T_world_tcp])
    return {IMAGE: images, WIDTH: width_of(widths)}


def take(inputs: Inputs, rows: Any) -> dict[str, NDArray[np.float32]]:
    """Return the inputs of some grasps, selected by indices, a slice or a mask."""
    return {name: values[rows] for name, values in inputs.items()}


def mirrored(inputs: Inputs, x: NDArray[np.bool_], y: NDArray[np.bool_]) -> Inputs:
    """Return the inputs of the scenes mirrored across the gripper's planes of symmetry.

    A parallel gripper is symmetric and so are the laws of physics, so the label does not change.
    Both reflections together are a half turn about the approach axis. Forces are vectors and
    torques are pseudovectors; the reflection along y swaps the pads.

    Args:
        inputs: The inputs of K grasps.
        x: Whether to mirror each grasp along the TCP's x axis, (K,).
        y: Whether to mirror each grasp along the TCP's y axis (closing direction), (K,).
    """
    out = dict(inputs)
    if IMAGE in out:
        image = np.where(x[:, None, None, None], out[IMAGE][:, :, ::-1], out[IMAGE])
        out[IMAGE] = np.where(y[:, None, None, None], image[:, :, :, ::-1], image)
    if TOUCH in out:
        touch = out[TOUCH] * np.where(x[:, None], _MIRROR_X, 1.0)[:, None, :, None]
        swapped = touch[:, ::-1] * _MIRROR_Y[:, None]
        out[TOUCH] = np.where(y[:, None, None, None], swapped, touch).astype(np.float32)
    return out


_MIRROR_X = np.array([-1, 1, 1, 1, -1, -1], np.float32)
_MIRROR_Y = np.array([1, -1, 1, -1, 1, -1], np.float32)
"""Signs of force x, y, z and torque x, y, z."""
