"""Sensors: what is measured while the arm moves. A new one is one file and one row below."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from grasp_factory.simulation.robot import Robot
from grasp_factory.simulation.sensors.base import Sensor, Tick
from grasp_factory.simulation.sensors.clock import Clock
from grasp_factory.simulation.sensors.encoders import Encoders
from grasp_factory.simulation.sensors.hand import HandContact
from grasp_factory.simulation.sensors.images import Render, develop, make_camera, render
from grasp_factory.simulation.sensors.imu import WristImu
from grasp_factory.simulation.sensors.tactile import TactilePads
from grasp_factory.simulation.sensors.tracker import ObjectTracker, object_frame
from grasp_factory.simulation.sensors.video import VideoRecorder
from grasp_factory.simulation.sensors.wrist import WristForceTorque
from grasp_factory.simulation.world import World

LabelOf = Callable[[int, int], int]
"""(body, link) -> ``Label``."""

SENSORS: Mapping[str, Callable[[World, Robot, tuple[int, ...], LabelOf], Sensor]] = {
    "clock": lambda world, robot, objects, label_of: Clock(),
    "encoders": lambda world, robot, objects, label_of: Encoders(robot),
    "tracker": lambda world, robot, objects, label_of: ObjectTracker(world, objects),
    "tactile": lambda world, robot, objects, label_of: TactilePads(robot, label_of),
    "hand": lambda world, robot, objects, label_of: HandContact(robot, objects[0]),
    "wrist": lambda world, robot, objects, label_of: WristForceTorque(world, robot),
}

__all__ = [
    "SENSORS",
    "LabelOf",
    "Render",
    "Sensor",
    "Tick",
    "VideoRecorder",
    "WristImu",
    "develop",
    "make_camera",
    "object_frame",
    "render",
]
