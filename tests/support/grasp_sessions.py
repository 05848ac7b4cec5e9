"""A session of grasps: a gripper closes and lifts, seen by a camera, an IMU and a wrist sensor."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from support.sessions import JOINTS, START, STRING, Channel, Recorded, SessionMaker

SIZE = (24, 32)
"""Height and width of the images, pixels."""
INFO = "sensor_msgs/msg/CameraInfo"
K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])
"""Intrinsics of the camera, pixels."""
SECONDS = 6.0
"""Length of the session."""


def width_at(times: Any) -> Any:
    """Return a gripper's width: it closes on 30 mm from 2 to 2.5 s, and opens at 5 s."""
    return np.interp(times, [2.0, 2.5, 5.0, 5.3], [0.08, 0.03, 0.03, 0.08])


def force_at(times: Any) -> Any:
    """Return the force at the wrist: 2 N more from 3 to 5 s."""
    return 5.0 + np.interp(times, [2.8, 3.0, 5.0, 5.1], [0.0, 2.0, 2.0, 0.0])


def event(made: SessionMaker, name: str, seconds: float, **fields: Any) -> None:
    text = json.dumps({"event": name, **fields})
    at = START + round(seconds * 1e9)
    channel = Channel(topic="/events", kind=STRING)
    made.messages.append(Recorded(channel=channel, log_ns=at, fields={"data": text}))


def repeated_width_at(times: Any) -> Any:
    """Return a gripper's width: it closes on 30 mm in the middle of each second."""
    return np.interp(np.mod(times, 1.0), [0.3, 0.5, 0.8, 0.9], [0.08, 0.03, 0.03, 0.08])


def grasps_of(objects: Sequence[str], folder: Path, **settings: Any) -> Path:
    """Write a session with a success and a failure of each object, of a second each.

    The camera has intrinsics.
    """
    seconds = 2.0 * len(objects)
    made = recorded_grasps(seconds, repeated_width_at, **settings)
    fields = {"height": SIZE[0], "width": SIZE[1], "k": K.ravel(), "distortion_model": "plumb_bob"}
    channel = Channel(topic="/front/camera_info", kind=INFO, device="front", device_kind="camera")
    made.messages.append(Recorded(channel=channel, log_ns=START, fields=fields))
    for k in range(int(seconds)):
        event(made, "episode_start", k + 0.02, object=objects[k // 2])
        event(made, "episode_end", k + 0.95, success=k % 2 == 0)
    return made.write(folder)


def session(folder: Path, *, label: str | None = None, marks: bool = True, **settings: Any) -> Path:
    """Write a session of one grasp."""
    made = recorded_grasps(SECONDS, width_at, **settings)
    if marks:
        event(made, "episode_start", 1.0, object="cup")
        event(made, "episode_end", 4.9)
    if label:
        event(made, "label", 5.2, outcome=label)
    return made.write(folder)


def recorded_grasps(seconds: float, width: Callable[[Any], Any], **settings: Any) -> SessionMaker:
    """Return samples of a camera, an IMU, a force-torque sensor and an arm with a gripper."""
    rng = np.random.default_rng(0)
    made = SessionMaker(settings={"operator": "op1", "task": "pick", "weather": "rain", **settings})
    frames = [rng.integers(0, 255, (*SIZE, 3), np.uint8) for _ in range(int(seconds * 10))]
    depths = [np.full(SIZE, 700 + k, np.uint16) for k in range(len(frames))]
    depths[0][0, 0] = 0
    made.camera(frames, rate=10.0, name="front", depth=depths)
    count = int(seconds * 200)
    made.imu(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), 200.0, clock=1.00002)
    at = np.arange(int(seconds * 500)) / 500.0
    wrench = np.zeros((len(at), 6))
    wrench[:, 2] = force_at(at)
    made.wrench(wrench, 500.0)
    arm = Channel(topic="/arm/joint_states", kind=JOINTS, device="arm", device_kind="joints")
    for k in range(int(seconds * 100)):
        at_s = k / 100.0
        position = np.append(np.full(7, 0.1 * at_s), width(at_s))
        fields = {
            "name": [*(f"joint_{j}" for j in range(1, 8)), "gripper"],
            "position": position,
            "velocity": np.full(8, np.nan),
            "effort": np.full(8, np.nan),
        }
        at_ns = START + round(at_s * 1e9)
        made.messages.append(Recorded(channel=arm, log_ns=at_ns, fields=fields))
    return made
