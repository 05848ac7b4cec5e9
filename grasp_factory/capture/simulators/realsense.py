"""A simulated RealSense camera: librealsense's own software device shows an episode's images."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count
from threading import Lock
from typing import Any

import numpy as np

from grasp_factory.capture.devices.realsense import SOFTWARE_DEVICES
from grasp_factory.capture.samples import CameraFrame
from grasp_factory.capture.simulators.base import SimulatedSender
from grasp_factory.capture.simulators.tracks import DeviceTrack, camera_track, frozen
from grasp_factory.core.episode import Episode

RATE_HZ = 30
_PERIOD_NS = 10**9 // RATE_HZ
_SERIALS = count(1)
_DEPTH_UNITS = 0.001
"""Metres of one count."""


class SimulatedRealSense(SimulatedSender[CameraFrame]):
    """Plays at 30 Hz; depth is in the view of the colour camera already.

    Args:
        episode: the episode.
        camera: name of its camera; empty for the first one.
        playing: see ``SimulatedDevice``.
    """

    resolution = 0.0

    def __init__(self, episode: Episode, *, camera: str = "", **playing: Any) -> None:
        self._camera = camera or next(iter(episode.cameras))
        super().__init__(episode, **playing)
        self.track = frozen(self.track, self.faults.frozen_after_s)
        self._serial, self._lock = f"simulated-{next(_SERIALS)}", Lock()
        self._streams: list[tuple[Any, Any, int]] = []
        self._held: list[tuple[int, int, int]] = []

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        height, width = self.track.payloads[0].rgb.shape[:2]
        return {
            "serial": self._serial,
            "width": width,
            "height": height,
            "fps": RATE_HZ,
            "align": False,
        }

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[CameraFrame]:
        """See ``SimulatedDevice.track_of``."""
        return camera_track(episode, rate_hz or RATE_HZ, camera=self._camera)

    def plug(self) -> None:
        """See ``SimulatedDevice.plug``."""
        import pyrealsense2 as rs

        device = rs.software_device()
        device.register_info(rs.camera_info.serial_number, self._serial)
        depth, colour = device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")
        depth.add_read_only_option(rs.option.depth_units, _DEPTH_UNITS)
        depth_profile = depth.add_video_stream(self._stream(rs.stream.depth, rs.format.z16, 2))
        profile = colour.add_video_stream(self._stream(rs.stream.color, rs.format.rgb8, 3))
        same_place = rs.extrinsics()
        same_place.rotation, same_place.translation = np.eye(3).ravel().tolist(), [0.0] * 3
        depth_profile.register_extrinsics_to(profile, same_place)
        device.create_matcher(rs.matchers.dlr_c)
        with self._lock:
            self._streams = [(depth, depth_profile, 2), (colour, profile, 3)]
            SOFTWARE_DEVICES[self._serial] = device

    def unplug(self) -> None:
        """See ``SimulatedDevice.unplug``."""
        with self._lock:
            self._streams = []
            SOFTWARE_DEVICES.pop(self._serial, None)

    def play(self) -> None:
        """See ``SimulatedDevice.play``; librealsense pairs streams after a first frame of both."""
        self._show([(0, self.faults.counter_start, 0)])
        super().play()

    def send(self, place: int, number: int, device_ns: int) -> bool:
        """See ``SimulatedSender.send``."""
        self._held.append((place, number + 1, device_ns + _PERIOD_NS))
        if not self.faults.batch_s:
            self.flush()
        return bool(self._streams)

    def flush(self) -> None:
        """See ``SimulatedSender.flush``."""
        held, self._held = self._held, []
        self._show(held)

    def _show(self, frames: Sequence[tuple[int, int, int]]) -> None:
        """Show frames: the place in the track, the number and the device's time of each."""
        with self._lock:
            for place, number, device_ns in frames:
                frame = self.track.payloads[place]
                images = (frame.depth, frame.rgb)
                for (sensor, profile, size), image in zip(self._streams, images, strict=False):
                    sensor.on_video_frame(_frame(image, size, profile, number, device_ns))

    def _stream(self, kind: Any, pixels: Any, size: int) -> Any:
        import pyrealsense2 as rs

        height, width = self.track.payloads[0].rgb.shape[:2]
        intrinsics = rs.intrinsics()
        intrinsics.width, intrinsics.height = width, height
        intrinsics.fx = intrinsics.fy = float(width)
        intrinsics.ppx, intrinsics.ppy = width / 2, height / 2
        intrinsics.model, intrinsics.coeffs = rs.distortion.none, [0.0] * 5
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.uid, stream.index = kind, pixels, size, 0
        stream.width, stream.height, stream.fps, stream.bpp = width, height, RATE_HZ, size
        stream.intrinsics = intrinsics
        return stream


def _frame(image: Any, size: int, profile: Any, number: int, device_ns: int) -> Any:
    import pyrealsense2 as rs

    frame = rs.software_video_frame()
    frame.pixels = np.ascontiguousarray(image)
    frame.bpp, frame.stride = size, size * image.shape[1]
    frame.timestamp, frame.domain = device_ns * 1e-6, rs.timestamp_domain.hardware_clock
    frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
    frame.depth_units = _DEPTH_UNITS
    return frame
