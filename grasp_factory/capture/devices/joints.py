"""Driver of a robot's joints, commands, gripper and emergency stop: JSON datagrams over UDP.

The robot's controller, or a small program beside it, sends one datagram for each cycle::

    {"sequence": 17, "time_ns": 34000000, "positions": [...], "velocities": [...],
     "torques": [...], "position_targets": [...], "gripper_width": 0.08,
     "gripper_width_target": 0.08, "gripper_force": 0.0, "stopped": false}

Lists have a number for each joint, rad, rad/s, N m. Only ``positions`` is needed; what is missing
or null is recorded as not measured. ``time_ns`` is the robot's own clock.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.serial_device import LONGEST_WAIT_S
from grasp_factory.capture.devices.udp_device import UdpDevice
from grasp_factory.capture.samples import DeviceKind, JointReading, Sample, Vector
from grasp_factory.capture.transport.udp_socket import Datagram, UdpSocket
from grasp_factory.core.serialization import check, check_range, is_integer, is_number, normalise

PORT = 5680
_MOST_BYTES = 8192
_MOST_JOINTS = 64
_LATEST_NS = 2**63


@dataclass(frozen=True, slots=True, kw_only=True)
class JointsSettings:
    """The settings of the driver ``joints``."""

    joint_names: tuple[str, ...] = tuple(f"joint_{k}" for k in range(1, 8))
    """Names of the arm's joints, in the order of the lists."""
    listen: str = "127.0.0.1"
    """Address of this machine to listen at. Another machine reaches only its own network's."""
    port: int = PORT
    sender: str = ""
    """Address of the only machine that is listened to; empty for any."""
    reconnect_s: float = 10.0
    """How long a silent robot is waited for."""

    def __post_init__(self) -> None:
        normalise(self)
        names = self.joint_names
        is_right = 0 < len(names) <= _MOST_JOINTS and len(set(names)) == len(names)
        is_right = is_right and all(0 < len(n) <= 100 and n.isprintable() for n in names)
        is_right = is_right and "gripper" not in names
        valid = f"1 to {_MOST_JOINTS} different names, none of them gripper"
        check(is_right, "joint_names", names, valid)
        for name in ("listen", "sender"):
            text = getattr(self, name)
            is_address = len(text) <= 253 and text.isprintable() and " " not in text
            check(is_address and (text or name == "sender"), name, text, "an address")
        check_range(self, "port", 1, 65_535)
        check_range(self, "reconnect_s", 0.0, LONGEST_WAIT_S, "s")


class JointStates(UdpDevice[JointReading]):
    """The driver."""

    def __init__(self, settings: JointsSettings) -> None:
        socket = UdpSocket(listen=(settings.listen, settings.port))
        super().__init__(socket, connect_s=None, reconnect_s=settings.reconnect_s)
        self._sender, self._joints = settings.sender, len(settings.joint_names)

    def decode(self, datagram: Datagram) -> Sample[JointReading] | None:
        """See ``UdpDevice.decode``. What is no message of the protocol counts as implausible."""
        if self._sender and datagram.sender != self._sender:
            return None
        try:
            message = parsed(datagram.data)
            payload = reading(message, self._joints)
            raw, device_ns = _whole(message, "sequence"), _whole(message, "time_ns")
        except ValueError:
            self.counters.implausible += 1
            return None
        sequence = None
        if raw is not None:
            sequence = self.number(raw % 2**32)
            if sequence is None:
                return None
        return Sample(
            device_ns=device_ns, host_ns=datagram.host_ns, sequence=sequence, payload=payload
        )


def parsed(data: bytes) -> Mapping[str, Any]:
    """Return the message in a datagram.

    Raises:
        ValueError: if it is no object of JSON.
    """
    if len(data) > _MOST_BYTES:
        raise ValueError(f"{len(data)} bytes, valid: up to {_MOST_BYTES}")
    try:
        message = json.loads(data)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(message, dict):
        raise ValueError("no object")
    return message


def reading(message: Mapping[str, Any], joints: int) -> JointReading:
    """Return the state and command of a message.

    Raises:
        ValueError: if a value is missing, or has a wrong type or length.
    """
    if message.get("positions") is None:
        raise ValueError("positions are missing")
    stopped = message.get("stopped", False)
    if not isinstance(stopped, bool):
        raise ValueError("stopped is neither true nor false")
    return JointReading(
        positions=_list(message, "positions", joints),
        velocities=_list(message, "velocities", joints),
        torques=_list(message, "torques", joints),
        position_targets=_list(message, "position_targets", joints),
        gripper_width=_number(message.get("gripper_width")),
        gripper_width_target=_number(message.get("gripper_width_target")),
        gripper_force=_number(message.get("gripper_force")),
        is_stopped=stopped,
    )


def _list(message: Mapping[str, Any], name: str, joints: int) -> Vector:
    values = message.get(name)
    if values is None:
        return np.full(joints, np.nan)
    if not isinstance(values, list) or len(values) != joints:
        raise ValueError(f"{name} is no list of {joints}")
    return np.array([_number(value) for value in values])


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if not is_number(value) or not abs(value) < 1e9:
        raise ValueError("no finite number")
    return float(value)


def _whole(message: Mapping[str, Any], name: str) -> int | None:
    value = message.get(name)
    if value is None:
        return None
    if not is_integer(value) or not 0 <= value < _LATEST_NS:
        raise ValueError(f"{name} is no whole number")
    return int(value)


JOINTS_MODEL = DeviceModel(
    name="joints",
    kind=DeviceKind.JOINTS,
    description="a robot's joints, commands, gripper and emergency stop, JSON over UDP",
    settings=JointsSettings,
    implementation="grasp_factory.capture.devices.joints:JointStates",
    simulator="grasp_factory.capture.simulators.joints:SimulatedJoints",
)
