"""The records that flow through the factory: recipe, view, plan, episode."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.appearance import Color, Surroundings
from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.config.motion import MotionConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.config.quality import QualityConfig
from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.config.shake import ShakeConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.geometry import Array, Pose
from grasp_factory.core.gripper import Gripper
from grasp_factory.core.schema import FIELDS
from grasp_factory.core.sensors import series_groups
from grasp_factory.core.serialization import from_plain, to_plain

Streams = Mapping[str, NDArray[Any]]
"""Time series with one clock, by name, each (samples, ...)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSpec:
    """One object to drop."""

    object_set: str
    object_id: str
    family: str
    """The kind of shape."""
    split: str
    """train, val or test: a property of the object, never of the episode."""
    mass: float
    """kg."""
    lateral_friction: float
    """Coulomb coefficient; the pair's value is the product with the other body's."""
    drop_pose: Pose
    """Pose of the object's own frame in the world when it starts to fall."""
    folder_sha256: str = ""
    """For an object of a user's folder: the digest of its contents; empty for built-in objects."""
    scale: float = 1.0
    """Factor on the model's size."""
    linear_damping: float = 0.0
    """Share of the velocity lost per second, as Bullet counts it."""
    angular_damping: float = 0.0
    color: Color | None = None
    """None for the model's own."""
    texture: str = ""
    """An id of ``textures``; empty for the model's own appearance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeSpec:
    """The complete recipe of one episode: running it makes the same episode, byte for byte."""

    index: int
    seed: int
    robot: str
    policy: str
    policy_parameters: Mapping[str, Any]
    """All of the policy's own settings."""
    objects: tuple[ObjectSpec, ...]
    """The first one is the target."""
    surroundings: Surroundings
    cameras: Mapping[str, CameraConfig]
    resolution: tuple[int, int]
    record_hz: int
    imu_hz: int
    video_hz: int
    """Frames per second of the video that each camera takes of the attempt; 0 for none."""
    workspace: WorkspaceConfig
    physics: PhysicsConfig
    motion: MotionConfig
    shake: ShakeConfig
    label: LabelConfig
    quality: QualityConfig

    @property
    def imu_rate(self) -> int:
        """Rate of the IMU, Hz, under the name that a config has for it."""
        return self.imu_hz

    def to_json(self) -> str:
        """Return the spec as canonical JSON."""
        return json.dumps(to_plain(self), sort_keys=True, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> EpisodeSpec:
        """Read what ``to_json`` wrote.

        Raises:
            ConfigError: naming the key that is wrong.
        """
        return from_plain(cls, json.loads(text), "spec")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraImage:
    """One camera's images of one instant."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.float32]
    """(H, W) metres along the optical axis; ``far`` where nothing is seen."""
    segmentation: NDArray[np.uint8]
    """(H, W), values of ``Label``."""
    intrinsics: Array
    """K, (3, 3) pixels."""
    T_world_camera: Array
    """(4, 4), OpenCV axes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneView:
    """Everything that a policy may use: plain arrays, never the simulator."""

    images: Mapping[str, CameraImage]
    joint_positions: Array
    """(J,) rad."""
    T_world_tcp: Array
    """(4, 4)."""
    gripper: Gripper
    workspace: WorkspaceConfig
    """World frame; the table top is z = 0."""
    target_label: int
    """The target's value in the segmentation images."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasp:
    """A TCP pose to close at: +z approaches, +y closes, the origin lies between the pads."""

    T_world_tcp: Array
    """(4, 4)."""
    width: float
    """Metres between the pads before closing."""
    score: float = 0.0
    """The policy's own figure of merit; higher is better."""
    proposer: str = ""
    """The policy that proposed it, if that is not the episode's policy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspPlan:
    """Grasps in order of preference; the first that the robot can reach is executed."""

    grasps: tuple[Grasp, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFrames:
    """One camera over an episode: frame 0 is before the attempt, 1 after."""

    rgb: NDArray[np.uint8]
    """(2, H, W, 3)."""
    depth: NDArray[np.float32]
    """(2, H, W) metres along the optical axis."""
    segmentation: NDArray[np.uint8]
    """(2, H, W)."""
    intrinsics: Array
    """(3, 3) pixels."""
    T_world_camera: Array
    """(2, 4, 4), OpenCV axes; both frames have the same unless the camera moves with the hand."""
    visibility: NDArray[np.float32]
    """(2, M): the share of each object's pixels in the image that nothing hides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One attempt: its recipe, its label, the measurements behind it, images and streams."""

    spec: EpisodeSpec
    outcome: Outcome
    columns: Mapping[str, Any]
    """The row's other scalars and small arrays, by the store's column name (``schema.py``)."""
    cameras: Mapping[str, CameraFrames]
    streams: Streams
    """The time series of the records, each (n_steps, ...), unpadded."""
    own_rate: Mapping[str, Streams]
    """Time series at their own rate, by their group in the store (``sensors.py``), unpadded."""

    @property
    def success(self) -> bool:
        """True if the object was held through lift, hold and shake."""
        return self.outcome is Outcome.SUCCESS

    @property
    def imu(self) -> Streams:
        """The IMU's time series, each (n_imu, ...), and ``T_tcp_imu`` (4, 4)."""
        return self.own_rate["imu"]

    @property
    def videos(self) -> Streams:
        """The videos' series, each (n_video, ...); empty for a recipe without video.

        They are ``timestamp``, and for each camera ``<name>/rgb`` and ``<name>/T_world_camera``.
        """
        return self.own_rate.get("videos", {})

    @property
    def series(self) -> Mapping[str, Streams]:
        """All time series, by their group in the store; ``streams`` comes first."""
        return {"streams": self.streams, **self.own_rate}

    @property
    def n_steps(self) -> int:
        """Records in each stream."""
        return len(self.streams["timestamp"])

    @property
    def n_imu(self) -> int:
        """Samples of the IMU."""
        return len(self.imu["timestamp"])

    def contents(self) -> dict[str, NDArray[Any]]:
        """Return every value of the episode as an array, by path in the store."""
        out: dict[str, NDArray[Any]] = {
            "episodes/success": np.asarray(self.success),
            "episodes/outcome": np.asarray(int(self.outcome), np.uint8),
            "episodes/spec": np.asarray(self.spec.to_json()),
            "episodes/seed": np.asarray(self.spec.seed, np.int64),
            "episodes/index": np.asarray(self.spec.index, np.int64),
        }
        series = self.series
        for group in series_groups():
            if group.name in series:
                samples = len(series[group.name]["timestamp"])
                out[group.length_column] = np.asarray(samples, np.int32)
        for name, value in self.columns.items():
            path = f"episodes/{name}"
            out[path] = np.asarray(value, _COLUMN_DTYPES.get(path))
        for camera, frames in self.cameras.items():
            for name in frames.__slots__:
                out[f"cameras/{camera}/{name}"] = getattr(frames, name)
        for name, arrays in series.items():
            out |= {f"{name}/{array}": values for array, values in arrays.items()}
        return out

    def checksum(self) -> str:
        """Return the ``checksum`` of the episode's contents."""
        return checksum(self.contents())


def checksum(contents: Mapping[str, NDArray[Any]]) -> str:
    """Return a SHA-256 over names, types, shapes and bytes of an episode's contents, as hex.

    It does not depend on padding, chunking or compression.
    """
    digest = hashlib.sha256()
    for path, array in sorted(contents.items()):
        kind = "string" if array.dtype.kind == "U" else array.dtype.newbyteorder("<").str
        digest.update(f"{path} {kind} {array.shape}\n".encode())
        digest.update(content_bytes(array))
    return digest.hexdigest()


def content_bytes(array: NDArray[Any]) -> bytes | memoryview:
    """Return the bytes of an array of an episode's contents; words are joined by NUL."""
    if array.dtype.kind == "U":
        return "\0".join(array.ravel().tolist()).encode()
    return np.ascontiguousarray(array).data


_COLUMN_DTYPES = {row.path: row.dtype for row in FIELDS if row.dtype != "string"}
"""A column may hold Python numbers; this is what they are in the store."""
