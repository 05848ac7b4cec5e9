"""The records of an episode: recipe, view of the scene, grasp plan, images and streams."""

from __future__ import annotations

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
from grasp_factory.core.config.recording import check_recording
from grasp_factory.core.config.scene import MAX_OBJECTS, WorkspaceConfig
from grasp_factory.core.config.shake import ShakeConfig
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode_display import DisplayedEpisode
from grasp_factory.core.geometry import Array, Pose
from grasp_factory.core.gripper import Gripper
from grasp_factory.core.json_text import parsed
from grasp_factory.core.recording_source import RecordingSource
from grasp_factory.core.schema import FIELDS
from grasp_factory.core.sensors import series_groups
from grasp_factory.core.serialization import check, check_range, from_parsed_json, to_plain

Streams = Mapping[str, NDArray[Any]]
"""Time series that share a clock, by name, each (samples, ...)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSpec:
    """One object of a recipe and how it is dropped."""

    object_set: str
    object_id: str
    family: str
    """The kind of shape."""
    split: str
    """train, val or test; it depends on the object, not on the episode."""
    mass: float | None
    """kg; None, as the next two, if it was not measured: of a real object."""
    lateral_friction: float | None
    """Coulomb coefficient; a contact has the product of both bodies' coefficients."""
    drop_pose: Pose | None
    """Pose of the object's frame in the world frame when it starts to fall."""
    folder_sha256: str = ""
    """SHA-256 of the contents of a user's folder of objects; empty for built-in objects."""
    scale: float = 1.0
    """Factor on the model's size."""
    linear_damping: float = 0.0
    """Bullet's damping: share of the velocity that is lost per second."""
    angular_damping: float = 0.0
    color: Color | None = None
    """None for the model's own colour."""
    texture: str = ""
    """An id of ``textures``; empty for the model's own appearance."""

    def __post_init__(self) -> None:
        if self.mass is not None:
            check_range(self, "mass", 1e-6, 1000.0, "kg")
        if self.lateral_friction is not None:
            check_range(self, "lateral_friction", 0.0, 100.0)
        check_range(self, "scale", 0.01, 100.0)
        check_range(self, "linear_damping", 0.0, 1.0)
        check_range(self, "angular_damping", 0.0, 1.0)
        if self.drop_pose is not None:
            is_near = all(abs(x) <= 100.0 for x in self.drop_pose.position)
            check(is_near, "drop_pose", self.drop_pose.position, "within 100 m of the origin")


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeSpec:
    """The complete recipe of one episode: running it, or importing it, makes the same bytes."""

    index: int
    seed: int
    robot: str
    policy: str
    policy_parameters: Mapping[str, Any]
    """All settings of the policy."""
    objects: tuple[ObjectSpec, ...]
    """The first one is the target."""
    surroundings: Surroundings
    cameras: Mapping[str, CameraConfig]
    resolution: tuple[int, int]
    record_hz: int
    imu_hz: int
    video_hz: int
    """Frame rate of each camera's video of the attempt, Hz; 0 for no video."""
    workspace: WorkspaceConfig
    physics: PhysicsConfig
    motion: MotionConfig
    shake: ShakeConfig
    label: LabelConfig
    quality: QualityConfig
    recording: RecordingSource | None = None
    """What a real episode was cut from; None for a simulated one."""
    sensors: tuple[str, ...] = ()
    """Sensors of plugins that record, too."""

    def __post_init__(self) -> None:
        check_range(self, "seed", 0, 2**63 - 1)
        check_range(self, "index", 0, 2**63 - 1)
        count = len(self.objects)
        check(1 <= count <= MAX_OBJECTS, "objects", count, f"1 to {MAX_OBJECTS} objects")
        check_recording(self)
        known = [(each.mass, each.lateral_friction, each.drop_pose) for each in self.objects]
        ok = self.recording is not None or not any(None in each for each in known)
        check(ok, "objects", "null", "mass, friction and drop_pose, unless of a real object")

    @property
    def capture(self) -> None:
        """None: real devices have no rate of their own in a recipe."""

    @property
    def imu_rate(self) -> int:
        """Rate of the IMU, Hz; the same name as in a config."""
        return self.imu_hz

    def to_json(self) -> str:
        """Return the recipe as canonical JSON."""
        optional = ("recording", "sensors")
        plain = {key: v for key, v in to_plain(self).items() if v or key not in optional}
        return json.dumps(plain, sort_keys=True, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> EpisodeSpec:
        """Return the recipe from the JSON that ``to_json`` returned.

        Raises:
            ConfigError: naming the key that is wrong.
        """
        return from_parsed_json(cls, parsed(text), "spec")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraImage:
    """The images of one camera at one instant."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.float32]
    """(H, W) metres along the optical axis; the camera's ``far`` where no body is visible."""
    segmentation: NDArray[np.uint8]
    """(H, W), values of ``Label``."""
    intrinsics: Array
    """K, (3, 3) pixels."""
    T_world_camera: Array
    """(4, 4), OpenCV axes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneView:
    """The input of a policy: plain arrays, without access to the simulator."""

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
    """A TCP pose at which the gripper closes.

    The TCP frame: +z approaches, +y closes, the origin is between the pads.
    """

    T_world_tcp: Array
    """(4, 4)."""
    width: float
    """Distance between the pads before closing, metres."""
    score: float = 0.0
    """The policy's own figure of merit; higher is better."""
    proposer: str = ""
    """Name of the policy that proposed the grasp; empty for the episode's policy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspPlan:
    """Grasps in order of preference; the robot executes the first that it can reach."""

    grasps: tuple[Grasp, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFrames:
    """The images of one camera in an episode: frame 0 is before the attempt, frame 1 after it."""

    rgb: NDArray[np.uint8]
    """(2, H, W, 3)."""
    depth: NDArray[np.float32]
    """(2, H, W) metres along the optical axis."""
    segmentation: NDArray[np.uint8]
    """(2, H, W)."""
    intrinsics: Array
    """(3, 3) pixels."""
    T_world_camera: Array
    """(2, 4, 4), OpenCV axes; both are equal unless the camera moves with the hand."""
    visibility: NDArray[np.float32]
    """(2, M): the visible share of each object's pixels in the image, without occluded pixels."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Episode(DisplayedEpisode):
    """One attempt: recipe, label, the measurements that the label follows from, images, streams."""

    spec: EpisodeSpec
    outcome: Outcome
    columns: Mapping[str, Any]
    """Other scalars and small arrays, by column name in the store (``schema.py``)."""
    cameras: Mapping[str, CameraFrames]
    streams: Streams
    """The time series at the record rate, each (n_steps, ...), without padding."""
    own_rate: Mapping[str, Streams]
    """Time series at other rates, by group in the store (``sensors.py``), without padding."""

    @property
    def is_real(self) -> bool:
        """True if it was recorded with real devices."""
        return self.spec.recording is not None

    @property
    def success(self) -> bool:
        """True if the outcome is success: the target was held through lift, hold and shake."""
        return self.outcome is Outcome.SUCCESS

    @property
    def imu(self) -> Streams:
        """The IMU's time series, each (n_imu, ...), and ``T_tcp_imu`` (4, 4)."""
        return self.own_rate["imu"]

    @property
    def videos(self) -> Streams:
        """The time series of the videos, each (n_video, ...); empty for a recipe without video.

        The names are ``timestamp`` and, for each camera, ``<name>/rgb`` and
        ``<name>/T_world_camera``.
        """
        return self.own_rate.get("videos", {})

    @property
    def series(self) -> Mapping[str, Streams]:
        """All time series by group in the store; ``streams`` is first."""
        return {"streams": self.streams, **self.own_rate}

    @property
    def n_steps(self) -> int:
        """Number of records in each stream."""
        return len(self.streams["timestamp"])

    @property
    def n_imu(self) -> int:
        """Number of samples of the IMU."""
        return len(self.imu["timestamp"])

    def contents(self) -> dict[str, NDArray[Any]]:
        """Return all values of the episode as arrays, by path in the store."""
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
        """Return the ``checksum`` (SHA-256 in hex) of the episode's contents."""
        return checksum(self.contents())


_COLUMN_DTYPES = {row.path: row.dtype for row in FIELDS if row.dtype != "string"}
"""Types of columns in the store; ``Episode.columns`` may contain Python numbers."""
