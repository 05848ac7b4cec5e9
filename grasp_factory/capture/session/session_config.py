"""The settings of a session, as in ``session.yaml``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import Any

from grasp_factory.capture.devices import DEVICES
from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.session.tolerances import Tolerances
from grasp_factory.core.config.yaml_loader import read_yaml
from grasp_factory.core.serialization import (
    check,
    check_range,
    from_plain,
    is_number,
    normalise,
    to_plain,
)
from grasp_factory.errors import ConfigError, lookup

NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")
"""Names in ROS 2: https://design.ros2.org/articles/topic_and_service_names.html"""
TOPIC = re.compile(rf"(/{NAME.pattern})+")
MOST_DEVICES = 64
LONGEST_TEXT = 10_000
"""Characters of an entry such as the scenario."""


class SessionNames(IntEnum):
    """Who gives folders and topics their names."""

    PLAIN = 0
    """``session_20260131_120000``, and topics below the device's name."""
    ARTICLE = 1
    """``ego_data_20260131_120000``, and the topics of a RealSense driver, ``/imu/data``..."""
    ARTICLE_SYNC = 2
    """``session_1769860800``, the same topics, but ``/imu/data_raw``."""


FOLDERS: Mapping[SessionNames, str] = {
    SessionNames.PLAIN: "session_%Y%m%d_%H%M%S",
    SessionNames.ARTICLE: "ego_data_%Y%m%d_%H%M%S",
    SessionNames.ARTICLE_SYNC: "session_{epoch}",
}
"""The name of a session's folder: ``strftime``, and ``{epoch}`` for whole seconds since 1970."""


class Compression(IntEnum):
    """How the file of a session is compressed; it is lossless."""

    NONE = 0
    """Takes the least of the processor, so it is the last to lose samples."""
    ZSTD = 1
    """Any reader of MCAP knows it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceConfig:
    """A device of a session."""

    driver: str
    """A name in the table of devices."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the driver."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Names of topics that differ from the usual ones, such as ``image: /camera/image_raw``."""
    rate_hz: float | None = None
    """Samples per second that are expected; without it, no alarm watches the rate."""
    calibration: str = ""
    """Calibration file, beside session.yaml or absolute; it is copied into the session."""
    full_scale: Mapping[str, float] = field(default_factory=dict)
    """Largest value of a quantity, such as ``force: 290``; from there on it is saturated."""

    def __post_init__(self) -> None:
        normalise(self)
        if self.rate_hz is not None:
            check_range(self, "rate_hz", 0.001, 100_000, "Hz")
        for role, topic in self.topics.items():
            ok = bool(TOPIC.fullmatch(topic)) and len(topic) <= 200
            check(ok, f"topics.{role}", topic, "a name of ROS such as /camera/image_raw")
        for quantity, value in self.full_scale.items():
            check(value > 0.0, f"full_scale.{quantity}", value, "above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionConfig:
    """All settings of a session. Texts about it are stored as they are."""

    devices: Mapping[str, DeviceConfig]
    """Devices by name; a name is also a ROS name and the frame of its messages."""
    name: str = ""
    """Name of the folder, with ``strftime`` codes and ``{epoch}``; empty for that of ``names``."""
    names: SessionNames = SessionNames.PLAIN
    operator: str = ""
    task: str = ""
    scenario: str = ""
    weather: str = ""
    environment: Mapping[str, Any] = field(default_factory=dict)
    firmware: Mapping[str, Any] = field(default_factory=dict)
    sensor_setup: Mapping[str, Any] = field(default_factory=dict)
    consent: Any = None
    """What the people in the pictures agreed to, and where that is written: a text or a mapping."""
    tags: tuple[str, ...] = ()
    duration_s: float | None = None
    """Length; without it, the session ends with Ctrl-C, with the hook, or from the live page."""
    tolerances: Tolerances = field(default_factory=Tolerances)
    disk_reserve_mb: float = 500.0
    """MB that stay free: with less, the session ends cleanly."""
    queue_s: float = 2.0
    """Seconds of samples of a device that wait for the disk at most; more are dropped, counted."""
    compression: Compression = Compression.NONE
    hook: tuple[str, ...] = ()
    """Command that moves the robot: program and arguments; started and stopped with the session."""

    def __post_init__(self) -> None:
        normalise(self)
        check(0 < len(self.devices) <= MOST_DEVICES, "devices", len(self.devices), "1 to 64")
        for name in self.devices:
            ok = bool(NAME.fullmatch(name)) and len(name) <= 64
            check(ok, f"devices.{name}", name, "a name of ROS: letters, digits, single underscores")
        for key in ("operator", "task", "scenario", "weather"):
            text = getattr(self, key)
            check(len(text) <= LONGEST_TEXT, key, text, f"up to {LONGEST_TEXT} characters")
        for key in ("environment", "firmware", "sensor_setup", "consent"):
            _check_plain(key, getattr(self, key))
        ok = self.consent is None or isinstance(self.consent, str | bool | dict)
        check(ok, "consent", self.consent, "a text, yes, no, or a mapping")
        if self.duration_s is not None:
            check_range(self, "duration_s", 0.1, 7 * 86400, "s")
        check_range(self, "disk_reserve_mb", 0, 1e9, "MB")
        check_range(self, "queue_s", 0.1, 60, "s")
        self.folder_name(datetime(2026, 1, 31, 12, tzinfo=UTC))

    def folder_name(self, start: datetime) -> str:
        """Return the name of the folder of a session that starts then.

        Raises:
            ConfigError: if it is no name of a folder.
        """
        template = self.name or FOLDERS[self.names]
        found = start.strftime(template.replace("{epoch}", str(int(start.timestamp()))))
        ok = bool(re.fullmatch(r"[\w][\w.+-]{0,199}", found))
        check(ok, "name", template, "letters, digits, _ . + -, strftime codes and {epoch}")
        return found


def _check_plain(key: str, value: Any) -> None:
    """Check that a free entry can be stored as JSON.

    Raises:
        ConfigError: naming the value that cannot.
    """
    if isinstance(value, Mapping):
        for name, item in value.items():
            check(isinstance(name, str | int), f"{key}.{name}", name, "a text or a number as key")
            _check_plain(f"{key}.{name}", item)
    elif isinstance(value, list | tuple):
        for place, item in enumerate(value):
            _check_plain(f"{key}[{place}]", item)
    else:
        ok = value is None or isinstance(value, str | bool)
        ok = ok or (is_number(value) and math.isfinite(value))
        check(ok, key, value, "a text, a finite number, yes or no; write a date in quotes")


def read_session_config(path: Path) -> SessionConfig:
    """Return the settings in a YAML file; each driver, and its settings, are checked.

    Raises:
        ConfigError: naming the key, what it got and what is valid.
        UnknownNameError: for a driver that is not there.
    """
    config = from_plain(SessionConfig, read_yaml(path))
    device_models(config)
    return config


def device_models(config: SessionConfig) -> dict[str, DeviceModel]:
    """Return the row of the table of devices of each device.

    Raises:
        UnknownNameError: for a driver that is not there.
        ConfigError: for settings that its driver refuses.
    """
    found = {}
    for name, device in config.devices.items():
        found[name] = lookup(DEVICES, "driver", device.driver)
        from_plain(found[name].settings, device.settings, f"devices.{name}.settings")
    return found


def calibration_files(config: SessionConfig, beside: Path) -> dict[str, Path]:
    """Return the calibration file of each device that has one.

    Args:
        config: the settings.
        beside: the folder that relative paths start at, that of session.yaml.

    Raises:
        ConfigError: if a file is not there.
    """
    found = {}
    for name, device in config.devices.items():
        if device.calibration:
            found[name] = beside / device.calibration
            if not found[name].is_file():
                key = f"devices.{name}.calibration"
                raise ConfigError(f"{key}: got {device.calibration!r}, valid: a file that exists")
    return found


def plain_config(config: SessionConfig) -> dict[str, Any]:
    """Return the settings as plain data, as they are stored."""
    plain: dict[str, Any] = to_plain(config)
    return plain
