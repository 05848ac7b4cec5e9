"""The contract of devices: open, yield samples, close; what was lost is counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Generic, Protocol

from grasp_factory.capture.samples import (
    CameraFrame,
    DeviceKind,
    InertialReading,
    JointReading,
    Payload,
    Payload_co,
    Sample,
    TactileReading,
    WrenchReading,
)
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import from_plain


@dataclass(slots=True, kw_only=True)
class DeviceCounters:
    """What a driver saw since it was opened. Only the driver's own thread changes it."""

    samples: int = 0
    lost: int = 0
    """Samples that the device's own count says were made and did not arrive."""
    bad_checksums: int = 0
    implausible: int = 0
    """Samples that a plausibility check refused."""
    flagged: int = 0
    """Samples that the device itself marked as doubtful; they are yielded."""
    skipped_bytes: int = 0
    """Bytes that were in no valid packet."""
    reconnects: int = 0


class Device(Protocol, Generic[Payload_co]):
    """A driver of one device. One thread uses it; ``stop`` may be called from any thread."""

    counters: DeviceCounters

    def open(self) -> None:
        """Connect.

        Raises:
            CaptureError: if the device is not there, or does not answer.
        """

    def samples(self) -> Iterator[Sample[Payload_co]]:
        """Yield samples until ``stop`` is called or a recording that is played has ended.

        A device that goes away is waited for, and connected again, up to the setting
        ``reconnect_s``.

        Raises:
            CaptureError: if it does not come back.
        """

    def stop(self) -> None:
        """End ``samples`` within 0.2 s."""

    def close(self) -> None:
        """Let the device go; a second call does nothing."""


CameraDevice = Device[CameraFrame]
ImuDevice = Device[InertialReading]
ForceTorqueDevice = Device[WrenchReading]
TactileDevice = Device[TactileReading]
JointsDevice = Device[JointReading]


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceModel:
    """A row of the table of devices: what a driver reads, its settings, and where its class is."""

    name: str
    kind: DeviceKind
    description: str
    settings: type[Any]
    """A frozen dataclass; the driver's constructor takes it."""
    implementation: str
    """``module:class`` of the driver."""
    simulator: str = ""
    """``module:class`` of a simulator that plays an episode over the real transport."""
    modules: tuple[str, ...] = ()
    """Import names of the optional libraries that it needs."""
    extra: str = ""
    """The optional dependency group that installs them."""

    def make(self, settings: Mapping[str, Any]) -> Device[Payload]:
        """Return a driver that is not yet open.

        Raises:
            ConfigError: if a setting is unknown or out of range.
            MissingLibraryError: if a library that it needs is not installed.
        """
        record = from_plain(self.settings, settings, self.name)
        if self.modules:
            require(*self.modules, extra=self.extra)
        driver: Callable[[Any], Device[Payload]] = class_at(self.implementation)
        return driver(record)


def class_at(path: str) -> Any:
    """Return the class at ``module:class``."""
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
