"""Simulated bags: what a sensor of an episode would have published, as a topic of a ROS 2 bag."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.samples import (
    CameraFrame,
    InertialReading,
    JointReading,
    Payload_co,
    TactileReading,
    WrenchReading,
)
from grasp_factory.capture.simulators.recordings import SimulatedRecording
from grasp_factory.capture.simulators.tactile_array import PAD_SIZE, SHAPE
from grasp_factory.capture.simulators.tracks import (
    DeviceTrack,
    camera_track,
    frozen,
    imu_track,
    joints_track,
    tactile_track,
    without_targets,
    wrench_track,
)
from grasp_factory.core.episode import Episode

TOPIC, DEPTH_TOPIC = "/sensor", "/sensor/depth"
START_NS = 1_700_000_000 * 10**9
"""Stamp of the first message."""
_FRAME = "sensor"


class SimulatedRosbag(SimulatedRecording[Payload_co]):
    """Writes an MCAP bag; see ``SimulatedDevice`` for the arguments."""

    resolution = 1e-6
    """Of float32."""
    kind: str
    """Type of the messages."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        return {"path": str(self.path), "topic": TOPIC, "speed": self.speed}

    @abstractmethod
    def fields(self, make: Any, payload: Any) -> Mapping[str, Any]:
        """Return the fields of a payload's message; ``make`` is a ``MessageMaker``."""

    def contents(self, make: Any, payload: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Yield the topics and fields of a payload's messages."""
        yield TOPIC, self.fields(make, payload)

    def write(self, path: Path) -> None:
        """See ``SimulatedRecording.write``."""
        from grasp_factory.writers.exporters.rosbag.bag_files import (  # noqa: PLC0415
            write_ros2_bag,
        )

        write_ros2_bag(path, "mcap", self._messages())

    def _messages(self) -> Iterator[Any]:
        from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types  # noqa: PLC0415
        from grasp_factory.writers.exporters.rosbag.message_maker import (  # noqa: PLC0415
            MessageMaker,
        )
        from grasp_factory.writers.exporters.rosbag.topics import (  # noqa: PLC0415
            StampedMessage,
            Topic,
        )

        make, times = MessageMaker(ros2_types()), self.track.times - self.track.times[0]
        period = times[-1] * len(times) / max(len(times) - 1, 1)
        for turn in range(self.repeats):
            for offset, payload in zip(times, self.track.payloads, strict=True):
                stamp = START_NS + round((turn * period + float(offset)) * 1e9)
                for name, fields in self.contents(make, payload):
                    message = make(self.kind, header=make.header(stamp, _FRAME), **fields)
                    yield StampedMessage(stamp, Topic(name=name, kind=self.kind), message)


class SimulatedRosbagCamera(SimulatedRosbag[CameraFrame]):
    """Images and depth at 30 Hz, unless another rate is given."""

    kind = "sensor_msgs/msg/Image"

    def __init__(self, episode: Episode, *, camera: str = "", **playing: Any) -> None:
        self._camera = camera or next(iter(episode.cameras))
        super().__init__(episode, **playing)
        self.track = frozen(self.track, self.faults.frozen_after_s)

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        return {**super().settings, "depth_topic": DEPTH_TOPIC}

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[CameraFrame]:
        """See ``SimulatedDevice.track_of``."""
        return camera_track(episode, rate_hz or 30.0, camera=self._camera)

    def fields(self, make: Any, payload: CameraFrame) -> Mapping[str, Any]:
        """See ``SimulatedRosbag.fields``."""
        return image_fields(payload.rgb, "rgb8")

    def contents(self, make: Any, payload: CameraFrame) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """See ``SimulatedRosbag.contents``."""
        yield TOPIC, self.fields(make, payload)
        if payload.depth is not None:
            yield DEPTH_TOPIC, image_fields(payload.depth, "16UC1")


class SimulatedRosbagImu(SimulatedRosbag[InertialReading]):
    """The IMU at the wrist."""

    kind = "sensor_msgs/msg/Imu"

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[InertialReading]:
        """See ``SimulatedDevice.track_of``."""
        return imu_track(episode, rate_hz, temperature=float("nan"))

    def fields(self, make: Any, payload: InertialReading) -> Mapping[str, Any]:
        """See ``SimulatedRosbag.fields``."""
        return {
            "linear_acceleration": make.vector(payload.specific_force.tolist()),
            "angular_velocity": make.vector(payload.angular_velocity.tolist()),
        }


class SimulatedRosbagForceTorque(SimulatedRosbag[WrenchReading]):
    """The wrist's force-torque sensor."""

    kind = "geometry_msgs/msg/WrenchStamped"

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[WrenchReading]:
        """See ``SimulatedDevice.track_of``."""
        return wrench_track(episode, rate_hz)

    def fields(self, make: Any, payload: WrenchReading) -> Mapping[str, Any]:
        """See ``SimulatedRosbag.fields``."""
        force, torque = (make.vector(part.tolist()) for part in np.split(payload.wrench, 2))
        return {"wrench": make("geometry_msgs/msg/Wrench", force=force, torque=torque)}


class SimulatedRosbagTactile(SimulatedRosbag[TactileReading]):
    """The taxels of the left pad."""

    kind = "sensor_msgs/msg/Image"
    resolution = 1e-4
    """Of float32, at 1000 N."""

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[TactileReading]:
        """See ``SimulatedDevice.track_of``."""
        return tactile_track(episode, rate_hz, pad="left", pad_size=PAD_SIZE, shape=SHAPE)

    def fields(self, make: Any, payload: TactileReading) -> Mapping[str, Any]:
        """See ``SimulatedRosbag.fields``."""
        return image_fields(payload.pressure.astype("<f4"), "32FC1")


class SimulatedRosbagJoints(SimulatedRosbag[JointReading]):
    """Joints and gripper; the message has no commands."""

    kind = "sensor_msgs/msg/JointState"

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[JointReading]:
        """See ``SimulatedDevice.track_of``."""
        return without_targets(joints_track(episode, rate_hz))

    def fields(self, make: Any, payload: JointReading) -> Mapping[str, Any]:
        """See ``SimulatedRosbag.fields``."""
        names = [f"joint_{k + 1}" for k in range(len(payload.positions))]
        return {
            "name": [*names, "gripper"],
            "position": np.append(payload.positions, payload.gripper_width),
            "velocity": np.append(payload.velocities, 0.0),
            "effort": np.append(payload.torques, payload.gripper_force),
        }


def image_fields(image: NDArray[Any], encoding: str) -> Mapping[str, Any]:
    """Return the fields of an image's message."""
    rows = np.ascontiguousarray(image)
    return {
        "height": rows.shape[0],
        "width": rows.shape[1],
        "encoding": encoding,
        "step": rows.nbytes // rows.shape[0],
        "data": rows.reshape(-1).view(np.uint8),
    }
