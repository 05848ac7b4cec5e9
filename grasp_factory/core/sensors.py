"""The table of sensors: what each one records, at which rate, and where its class is.

A new sensor is a file in ``simulation/sensors/`` with its class, and a row of ``SENSORS``. This
module does not import the classes: reading and checking a store needs no simulator.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from grasp_factory.core.enums import Phase, names
from grasp_factory.core.field import LABELS, Field
from grasp_factory.core.real_series import REAL_GROUPS
from grasp_factory.core.series_group import SeriesGroup

if TYPE_CHECKING:
    from grasp_factory.core.config.factory_config import FactoryConfig

MAX_CONTACTS = 12
"""Largest number of contact points per pad and record; the strongest ones are kept."""
_PHASES = tuple(names(Phase))
_PAD = "pad: origin at the pad's centre, axes parallel to the TCP frame's"
_IMU = "imu: at the wrist flange, axes parallel to the TCP frame's"
_SENSOR = "ft_sensor: at the wrist flange, axes parallel to the TCP frame's"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """The description of a sensor: its arrays, and where its class is."""

    name: str
    description: str
    group: SeriesGroup
    """The group of its time series; all sensors of a group are sampled at the same instants."""
    fields: tuple[Field, ...]
    """The arrays that it records. One sensor of each group records ``timestamp``."""
    implementation: str | Callable[[Any], Any]
    """``module:class`` of the ``Sensor``; or the class itself, of a plugin."""


def _imu_capacity(config: FactoryConfig) -> int:
    # A whole number of samples for each record, because the shapes of stores depend on it.
    simulated = config.longest_attempt * config.imu_rate // config.record_hz
    real = config.capture.imu_hz if config.capture else 0
    return max(simulated, math.ceil(config.longest_s * real))


STREAMS = SeriesGroup(
    name="streams",
    title="the streams",
    dim="T",
    dimension_name="step",
    count="n_steps",
    rate=lambda rates: rates.record_hz,
)
IMU = SeriesGroup(
    name="imu",
    title="the IMU's series",
    dim="U",
    dimension_name="imu_step",
    count="n_imu",
    rate=lambda rates: rates.imu_rate,
    capacity=_imu_capacity,
)
VIDEOS = SeriesGroup(
    name="videos",
    title="the videos, where there are any",
    dim="V",
    dimension_name="video_frame",
    count="n_video",
    rate=lambda rates: rates.video_hz,
)

_HERE = "grasp_factory.simulation.sensors"

CLOCK = SensorModel(
    name="clock",
    description="time, phase of the attempt and level of the shake",
    group=STREAMS,
    implementation=f"{_HERE}.clock:Clock",
    fields=(
        STREAMS.series("timestamp", (), "float64", "simulation time since the arm started",
                       units="s", always=True),
        STREAMS.series("phase", (), "uint8", "part of the attempt", names=_PHASES, empty=255),
        STREAMS.series("shake_level", (), "float64", "level of the shake, 0 outside of it",
                       units="9.80665 m/s2"),
    ),
)  # fmt: skip
ENCODERS = SensorModel(
    name="encoders",
    description="joints and gripper, measured and commanded, and the TCP pose that follows",
    group=STREAMS,
    implementation=f"{_HERE}.encoders:Encoders",
    fields=(
        STREAMS.series("joint_positions", ("J",), "float32", "measured", units="rad"),
        STREAMS.series("joint_velocities", ("J",), "float32", "measured", units="rad/s"),
        STREAMS.series("joint_torques", ("J",), "float32", "applied by the motors", units="N m"),
        STREAMS.series("joint_position_targets", ("J",), "float32", "commanded", units="rad"),
        STREAMS.series("gripper_width", (), "float32", "distance between the pads", units="m"),
        STREAMS.series("gripper_width_target", (), "float32", "commanded", units="m"),
        STREAMS.series("gripper_force", (), "float32",
                       "closing force of a finger's motor, mean of two", units="N"),
        STREAMS.series("tcp_pose", (7,), "float32", "position (m) and quat_xyzw", frame="world"),
    ),
)  # fmt: skip
TRACKER = SensorModel(
    name="tracker",
    description="pose of every object: ground truth",
    group=STREAMS,
    implementation=f"{_HERE}.tracker:ObjectTracker",
    fields=(
        STREAMS.series("object_pose", ("M", 7), "float32",
                       "position (m) and quat_xyzw of each object", frame="world"),
    ),
)  # fmt: skip
TACTILE = SensorModel(
    name="tactile",
    description="contact points and forces on both finger pads",
    group=STREAMS,
    implementation=f"{_HERE}.tactile:TactilePads",
    fields=(
        STREAMS.series("tactile_wrench", (2, 6), "float32",
                       "contact wrench of the world on each pad (left, right): force N, torque N m",
                       frame=_PAD),
        STREAMS.series("tactile_position", (2, "P", 3), "float32", "contact points", units="m",
                       frame=_PAD, gaps=True),
        STREAMS.series("tactile_force", (2, "P", 3), "float32", "force on the pad at each point",
                       units="N", frame=_PAD, gaps=True),
        STREAMS.series("tactile_normal", (2, "P", 3), "float32",
                       "unit contact normal, pointing into the pad", frame=_PAD, gaps=True),
        STREAMS.series("tactile_depth", (2, "P"), "float32",
                       "overlap at each point (negative: a gap that closed in the step)",
                       units="m", gaps=True),
        STREAMS.series("tactile_body", (2, "P"), "uint8", "what touches at each point",
                       names=LABELS),
    ),
)  # fmt: skip
HAND = SensorModel(
    name="hand",
    description="force of the robot's other links, palm and finger sides, on the target",
    group=STREAMS,
    implementation=f"{_HERE}.hand:HandContact",
    fields=(
        STREAMS.series("hand_force", (3,), "float32",
                       "force on the target of the robot's links other than the pads: palm, finger"
                       " sides", units="N", frame="world"),
    ),
)  # fmt: skip
WRIST = SensorModel(
    name="wrist",
    description="force-torque sensor at the wrist flange",
    group=STREAMS,
    implementation=f"{_HERE}.wrist:WristForceTorque",
    fields=(
        STREAMS.series("wrist_wrench", (6,), "float32",
                       "load on the flange sensor: tool weight, inertia and contacts; force N,"
                       " torque N m", frame=_SENSOR),
    ),
)  # fmt: skip
WRIST_IMU = SensorModel(
    name="imu",
    description="inertial measurement unit at the wrist flange, at imu_hz",
    group=IMU,
    implementation=f"{_HERE}.imu:WristImu",
    fields=(
        IMU.series("timestamp", (), "float64", "simulation time, the streams' clock", units="s",
                   always=True),
        IMU.series("specific_force", (3,), "float32",
                   "acceleration less gravity, mean since the sample before; at rest 9.81 upwards",
                   units="m/s2", frame=_IMU),
        IMU.series("angular_velocity", (3,), "float32", "of the wrist", units="rad/s", frame=_IMU),
        IMU.constant("T_tcp_imu", (4, 4), "float64", "where the IMU sits in the hand", units="m",
                     frame="tcp"),
    ),
)  # fmt: skip
VIDEO = SensorModel(
    name="video",
    description="frames of every camera during the attempt, at video_hz",
    group=VIDEOS,
    implementation=f"{_HERE}.video:VideoRecorder",
    fields=(
        VIDEOS.series("timestamp", (), "float64",
                      "simulation time, the streams' clock (--video-hz)", units="s", always=True),
        VIDEOS.series("{camera}/rgb", ("H", "W", 3), "uint8", "the attempt, frame by frame"),
        VIDEOS.series("{camera}/T_world_camera", (4, 4), "float64",
                      "camera pose at each frame, OpenCV axes", units="m", frame="world"),
    ),
)  # fmt: skip

SENSORS: dict[str, SensorModel] = {
    model.name: model
    for model in (CLOCK, ENCODERS, TRACKER, TACTILE, HAND, WRIST, WRIST_IMU, VIDEO)
}
"""Sensors by name, in the order of their arrays in the schema."""


PLUGIN_SENSORS: dict[str, SensorModel] = {}
"""Sensors of users' files and of installed packages, by name; ``factory.plugins`` adds them."""


def series_groups() -> tuple[SeriesGroup, ...]:
    """Return the groups of all sensors, each once, in the sensors' order; the real ones last."""
    simulated = dict.fromkeys(model.group for model in SENSORS.values())
    return (*simulated, *REAL_GROUPS)
