"""The one table of the store: every array with its dimensions, type, unit, frame and meaning.

Writers, the reader, the checks and the README's table all follow it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Label, Outcome, Phase, label_names, names

FORMAT = "grasp-factory"
FORMAT_VERSION = 1

LENGTH_COLUMNS: Mapping[str | int, str] = {
    "T": "episodes/n_steps",
    "U": "episodes/n_imu",
    "V": "episodes/n_video",
}
"""By a time series' first dimension: the column that holds its valid length."""
MAX_CONTACTS = 12
"""Contact points kept per pad and record; the strongest stay when there are more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One array of the store; its first dimension, N, is the episode."""

    path: str
    """``{camera}`` stands for each camera's name."""
    dims: tuple[str | int, ...]
    """Dimensions after N; a letter is looked up in ``sizes``."""
    dtype: str
    """A numpy dtype, or ``string``."""
    units: str = ""
    frame: str = ""
    description: str
    names: tuple[str, ...] = ()
    """For coded values: the word whose position is the value."""
    empty: int = 0
    """What an integer array holds where nothing was recorded, if 0 would be taken for a word."""
    gaps: bool = False
    """NaN stands for nothing here, among what was recorded; no other array may have it there."""

    @property
    def fill(self) -> Any:
        """What an array holds where nothing was recorded."""
        if self.dtype == "string":
            return ""
        if self.dtype == "bool":
            return False
        return float("nan") if np.dtype(self.dtype).kind == "f" else self.empty

    @property
    def length_column(self) -> str:
        """For time series, which are padded: the column that holds the valid length; else ''."""
        return LENGTH_COLUMNS.get(self.dims[0], "") if self.dims else ""

    @property
    def is_image(self) -> bool:
        """True for arrays with a frame per chunk."""
        return "H" in self.dims

    @property
    def is_video(self) -> bool:
        """True for images that are a time series: each episode of them is a file of its own."""
        return self.is_image and bool(self.length_column)


def _f(path: str, dims: tuple[str | int, ...], dtype: str, description: str, **more: Any) -> Field:
    return Field(path=path, dims=dims, dtype=dtype, description=description, **more)


_OUTCOMES, _PHASES, _LABELS = (tuple(names(w)) for w in (Outcome, Phase, Label))
_STATUS = ("missing", "committed", "quarantined")
_PAD = "pad: origin at the pad's centre, axes parallel to the TCP frame's"
_IMU = "imu: at the wrist flange, axes parallel to the TCP frame's"
_SENSOR = "ft_sensor: at the wrist flange, axes parallel to the TCP frame's"

STATUS = _f("episodes/status", (), "uint8", "commit marker, written last", names=_STATUS)
CHECKSUM = _f("episodes/checksum", (), "string", "SHA-256 over the episode's contents")
DIGESTS = _f(
    "episodes/array_crc32c",
    ("A",),
    "uint32",
    "CRC-32C of the episode's values of each array that the attribute arrays names",
)
FINGERPRINT = _f(
    "episodes/fingerprint", (), "string", "fingerprint of the platform that made the row"
)
ERROR = _f("episodes/error", (), "string", "why the episode is quarantined")
NOT_IN_AN_EPISODE = (STATUS.path, CHECKSUM.path, DIGESTS.path, FINGERPRINT.path, ERROR.path)
"""Arrays that say something about an episode's contents, and are none of them."""

FIELDS: tuple[Field, ...] = (
    STATUS,
    CHECKSUM,
    DIGESTS,
    FINGERPRINT,
    _f("episodes/success", (), "bool", "the label: outcome is success"),
    _f("episodes/outcome", (), "uint8", "how the attempt ended", names=_OUTCOMES,
       empty=255),
    _f("episodes/spec", (), "string", "JSON recipe: running it gives this episode again"),
    ERROR,
    _f("episodes/seed", (), "int64", "seed of the config that the recipe was drawn from",
       empty=-1),
    _f("episodes/index", (), "int64", "index of the recipe under that seed; in a store that"
       " generate made it is the row's number", empty=-1),
    _f("episodes/n_steps", (), "int32", "valid length of the streams"),
    _f("episodes/n_imu", (), "int32", "valid length of the IMU's series"),
    _f("episodes/n_video", (), "int32", "valid length of the videos, where there are any"),
    _f("episodes/object_id", (), "string", "target object"),
    _f("episodes/object_set", (), "string", "set that the target comes from"),
    _f("episodes/object_family", (), "string", "kind of shape of the target: box, mug, blob"),
    _f("episodes/split", (), "string", "train, val or test, by object"),
    _f("episodes/policy", (), "string", "policy that planned the grasp"),
    _f("episodes/grasp_proposer", (), "string",
       "policy that thought of the grasp: another one for policies that build on others"),
    _f("episodes/object_mass", (), "float64", "mass of the target", units="kg"),
    _f("episodes/object_com", ("M", 3), "float64", "centre of mass", units="m", frame="object"),
    _f("episodes/object_ids", ("M",), "string", "every object, the target first"),
    _f("episodes/object_rest_pose", ("M", 7), "float64",
       "position (m) and quat_xyzw of each object before the attempt", frame="world"),
    _f("episodes/object_settled", ("M",), "bool",
       "whether each object was at rest then; one outside the workspace need not be"),
    _f("episodes/object_displacement", ("M",), "float64",
       "way of each object's centre of mass from its rest to the end of the attempt", units="m",
       gaps=True),
    _f("episodes/object_lift", ("M",), "float64",
       "rise of each object's centre of mass by the end of the hold (or of the attempt)",
       units="m", gaps=True),
    _f("episodes/grasp_position", (3,), "float64", "executed (else first planned) TCP position",
       units="m", frame="world", gaps=True),
    _f("episodes/grasp_quat_xyzw", (4,), "float64", "its orientation: +z approaches, +y closes",
       frame="world", gaps=True),
    _f("episodes/grasp_width", (), "float64", "gripper width before closing", units="m", gaps=True),
    _f("episodes/grasp_score", (), "float64", "the policy's own figure of merit", gaps=True),
    _f("episodes/rest_height", (), "float64", "height of the target's centre of mass at rest",
       units="m", frame="world"),
    _f("episodes/lift_height", (), "float64",
       "rise of the centre of mass by the end of the hold (or of the attempt)", units="m",
       gaps=True),
    _f("episodes/slip_distance", (), "float64",
       "way of the target's centre of mass in the hand from the end of the closing to the end",
       units="m", frame="tcp", gaps=True),
    _f("episodes/slip_angle", (), "float64", "turn of the target in the hand over the same time",
       units="rad", gaps=True),
    _f("episodes/min_grip_force", (), "float64",
       "smallest normal force of either pad on the target during the hold", units="N", gaps=True),
    _f("episodes/hold_duration", (), "float64", "time held by both pads after the lift", units="s"),
    _f("episodes/shake_level", (), "float64", "highest level of the shake that it survived",
       units="9.80665 m/s2"),
    _f("episodes/loss_time", (), "float64",
       "when both pads had touched the target for the last time; NaN if they still do", units="s",
       gaps=True),
    _f("episodes/max_penetration", (), "float64",
       "deepest overlap of a pad and the target during the hold", units="m", gaps=True),
    _f("episodes/contact_area", (), "float64",
       "area that contact points span on a pad at the end of the hold, mean of both; 0 for lines",
       units="m2", gaps=True),
    _f("episodes/table_penetration", (), "float64",
       "deepest overlap of the robot and the table in the attempt", units="m"),
    _f("episodes/collision_body", (), "uint8", "what was touched, for outcome collision",
       names=_LABELS),
    _f("episodes/quality", (), "uint8", "score from 1 to 5, the best, by the config's thresholds"),
    _f("episodes/sharpness", (), "float64",
       "share of the Laplacian's variance that a blur of 3 x 3 pixels takes; worst image before"),
    _f("episodes/exposure", (), "float64",
       "mean grey value, 0 black to 1 white, of the image before that is farthest from 0.5"),
    _f("episodes/clipped", (), "float64", "share of black or white pixels; worst image before"),
    _f("episodes/target_visibility", (), "float64",
       "share of the target that nothing hides before; best camera"),
    _f("episodes/target_pixels", (), "float64", "of the target before; best camera", units="px"),
    _f("episodes/depth_holes", (), "float64", "share of pixels without depth; worst image before"),
    _f("episodes/stream_gap", (), "float64",
       "longest time without a record in any series, in periods of its rate", gaps=True),
    _f("episodes/force_residual", (), "float64",
       "hand's force on the target against m (a - g), mean over the hold, of its weight",
       gaps=True),
    _f("cameras/{camera}/rgb", (2, "H", "W", 3), "uint8", "frame 0 before, 1 after"),
    _f("cameras/{camera}/depth", (2, "H", "W"), "float32", "along the optical axis", units="m"),
    _f("cameras/{camera}/segmentation", (2, "H", "W"), "uint8", "scene labels", names=_LABELS),
    _f("cameras/{camera}/intrinsics", (3, 3), "float64", "K, integer coordinates at pixel samples",
       units="px"),
    _f("cameras/{camera}/T_world_camera", (2, 4, 4), "float64",
       "camera pose at each frame, OpenCV axes", units="m", frame="world"),
    _f("cameras/{camera}/visibility", (2, "M"), "float32",
       "share of each object's pixels in the image that nothing hides"),
    _f("streams/timestamp", ("T",), "float64", "simulation time since the arm started", units="s"),
    _f("streams/phase", ("T",), "uint8", "part of the attempt", names=_PHASES, empty=255),
    _f("streams/shake_level", ("T",), "float64", "level of the shake, 0 outside of it",
       units="9.80665 m/s2"),
    _f("streams/joint_positions", ("T", "J"), "float32", "measured", units="rad"),
    _f("streams/joint_velocities", ("T", "J"), "float32", "measured", units="rad/s"),
    _f("streams/joint_torques", ("T", "J"), "float32", "applied by the motors", units="N m"),
    _f("streams/joint_position_targets", ("T", "J"), "float32", "commanded", units="rad"),
    _f("streams/gripper_width", ("T",), "float32", "distance between the pads", units="m"),
    _f("streams/gripper_width_target", ("T",), "float32", "commanded", units="m"),
    _f("streams/gripper_force", ("T",), "float32", "closing force of a finger's motor, mean of two",
       units="N"),
    _f("streams/tcp_pose", ("T", 7), "float32", "position (m) and quat_xyzw", frame="world"),
    _f("streams/object_pose", ("T", "M", 7), "float32", "position (m) and quat_xyzw of each object",
       frame="world"),
    _f("streams/tactile_wrench", ("T", 2, 6), "float32",
       "contact wrench of the world on each pad (left, right): force N, torque N m", frame=_PAD),
    _f("streams/tactile_position", ("T", 2, "P", 3), "float32", "contact points", units="m",
       frame=_PAD, gaps=True),
    _f("streams/tactile_force", ("T", 2, "P", 3), "float32", "force on the pad at each point",
       units="N", frame=_PAD, gaps=True),
    _f("streams/tactile_normal", ("T", 2, "P", 3), "float32",
       "unit contact normal, pointing into the pad", frame=_PAD, gaps=True),
    _f("streams/tactile_depth", ("T", 2, "P"), "float32",
       "overlap at each point (negative: a gap that closed in the step)", units="m", gaps=True),
    _f("streams/tactile_body", ("T", 2, "P"), "uint8", "what touches at each point", names=_LABELS),
    _f("streams/hand_force", ("T", 3), "float32",
       "force on the target of the robot's links other than the pads: palm, finger sides",
       units="N", frame="world"),
    _f("streams/wrist_wrench", ("T", 6), "float32",
       "load on the flange sensor: tool weight, inertia and contacts; force N, torque N m",
       frame=_SENSOR),
    _f("streams/reward", ("T",), "float32", "1 on the last record of a success, else 0"),
    _f("imu/timestamp", ("U",), "float64", "simulation time, the streams' clock", units="s"),
    _f("imu/specific_force", ("U", 3), "float32",
       "acceleration less gravity, mean since the sample before; at rest 9.81 upwards",
       units="m/s2", frame=_IMU),
    _f("imu/angular_velocity", ("U", 3), "float32", "of the wrist", units="rad/s", frame=_IMU),
    _f("imu/T_tcp_imu", (4, 4), "float64", "where the IMU sits in the hand", units="m",
       frame="tcp"),
    _f("videos/timestamp", ("V",), "float64", "simulation time, the streams' clock (--video-hz)",
       units="s"),
    _f("videos/{camera}/rgb", ("V", "H", "W", 3), "uint8", "the attempt, frame by frame"),
    _f("videos/{camera}/T_world_camera", ("V", 4, 4), "float64",
       "camera pose at each frame, OpenCV axes", units="m", frame="world"),
)  # fmt: skip


def sizes(config: FactoryConfig, joints: int) -> Mapping[str, int]:
    """Return the length of each lettered dimension for a config and a robot's joint count."""
    width, height = config.resolution
    return {
        "T": config.longest_attempt,
        "U": config.longest_attempt * config.imu_rate // config.record_hz,
        "J": joints,
        "V": config.longest_video,
        "M": config.clutter.count,
        "A": len(digested(config)),
        "P": MAX_CONTACTS,
        "H": height,
        "W": width,
    }


def expand(config: FactoryConfig) -> tuple[Field, ...]:
    """Return the fields of a config's store, with one row per camera."""
    return _expand(tuple(config.cameras), config.clutter.count, bool(config.video_hz))


def digested(config: FactoryConfig) -> tuple[str, ...]:
    """Return the paths of the arrays that an episode's contents are made of."""
    return tuple(row.path for row in expand(config) if row.path not in NOT_IN_AN_EPISODE)


@lru_cache
def _expand(cameras: tuple[str, ...], objects: int, has_videos: bool) -> tuple[Field, ...]:
    labels = tuple(label_names(objects))
    out: list[Field] = []
    for camera in ("", *cameras):
        for row in FIELDS:
            if "n_video" in row.path + row.length_column and not has_videos:
                continue
            if ("{camera}" in row.path) is bool(camera):
                words = labels if row.names == _LABELS else row.names
                path = row.path.format(camera=camera)
                out.append(dataclasses.replace(row, path=path, names=words))
    return tuple(out)


def shape(row: Field, size: Mapping[str, int]) -> tuple[int, ...]:
    """Return a field's dimensions after N as numbers."""
    return tuple(size[dim] if isinstance(dim, str) else dim for dim in row.dims)


def markdown_table() -> str:
    """Return the store's table as Markdown, for the README."""
    lines = ["| array | shape | dtype | unit | what |", "|---|---|---|---|---|"]
    for row in FIELDS:
        dims = ", ".join(str(dim) for dim in ("N", *row.dims))
        what = row.description + (f" [{row.frame}]" if row.frame else "")
        lines.append(f"| `{row.path}` | ({dims}) | {row.dtype} | {row.units} | {what} |")
    return "\n".join(lines)
