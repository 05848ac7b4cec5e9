"""What networks are shown, as named arrays: an image of the crop, the width, touch over time.

Nothing here is measured later than the start of the lift, and of the images only those before the
attempt are used.
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
"""By name, the first axis is the grasp: ``image`` (K, 3, S, S), ``width`` (K, 1),
``touch`` (K, 2, 6, R)."""

IMAGE, WIDTH, TOUCH = "image", "width", "touch"
KINDS: Mapping[str, tuple[str, ...]] = {
    "vision": (IMAGE, WIDTH),
    "touch": (TOUCH,),
    "both": (IMAGE, WIDTH, TOUCH),
}
"""Kind of network to the names of its inputs."""

DEEPEST = 0.1
"""Metres above and below the TCP at which heights are cut off: twice a pad's length."""
HEIGHT_UNIT = 0.05
"""Metres that are 1 in the image."""
WIDTH_UNIT = 0.1
"""Metres that are 1."""
FORCE_UNIT, TORQUE_UNIT = 10.0, 0.1
"""N and N m that are 1: half the default grip, and that at a centimetre's lever."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchWindow:
    """The last part of the closing, up to the start of the lift."""

    seconds: float = 0.5
    samples: int = 60

    def __post_init__(self) -> None:
        check_range(self, "seconds", 0.01, 10.0, "s")
        check(is_integer(self.samples) and 2 <= self.samples <= 1024, "samples", self.samples,
              "2 to 1024")  # fmt: skip


def image_of(crop: GraspCrop | GraspRelief) -> NDArray[np.float32]:
    """Return (3, S, S): height in units of 50 mm, whether anything is seen, whether the target."""
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

    Before the first record they are 0, as they are before the first contact.

    Args:
        streams: ``timestamp``, ``phase`` and ``tactile_wrench`` of an attempt that got to the lift.
        window: Which instants.

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
        view: What is seen.
        T_world_tcp: The grasps, (K, 4, 4).
        widths: Before closing, (K,) metres.
        shape: Of the crops.
    """
    views = tuple(view.images.values())
    images = np.stack([image_of(grasp_relief(views, T, shape)) for T in T_world_tcp])
    return {IMAGE: images, WIDTH: width_of(widths)}


def take(inputs: Inputs, rows: Any) -> dict[str, NDArray[np.float32]]:
    """Return the inputs of some grasps, chosen by indices, a slice or a mask."""
    return {name: values[rows] for name, values in inputs.items()}


def mirrored(inputs: Inputs, x: NDArray[np.bool_], y: NDArray[np.bool_]) -> Inputs:
    """Return the inputs of the scenes mirrored across the gripper's planes of symmetry.

    A parallel gripper is its own mirror image, and physics has no handedness, so the label stays
    as it is; both at once are a half turn about the approach. Forces are vectors and torques are
    pseudovectors; mirroring y swaps the pads.

    Args:
        inputs: Of K grasps.
        x: Which to mirror along the TCP's x, (K,).
        y: Which to mirror along y, the closing direction, (K,).
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
