"""What simulated devices play: the series of an episode as payloads with their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

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
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError, lookup
from grasp_factory.signals.touch import taxel_image

ROOM_TEMPERATURE = 25.0
"""Degrees Celsius; episodes have no temperature."""
_MM = 1000.0
_PADS = ("left", "right")


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceTrack(Generic[Payload_co]):
    """Payloads with their times."""

    times: Array
    """(K,) seconds from the start of the attempt, ascending."""
    payloads: Sequence[Payload_co]

    def __post_init__(self) -> None:
        if not len(self.payloads):
            raise UsageError("the episode has no record to play: choose one that was executed")


def instants(times: Array, rate_hz: float) -> Array:
    """Return when to sample a series: at its own times for a rate of 0, else evenly."""
    if not rate_hz or not len(times):
        return times
    return np.arange(times[0], times[-1] + 0.5 / rate_hz, 1.0 / rate_hz)


def resampled(values: NDArray[Any], times: Array, at: Array) -> Array:
    """Return a series (T, ...) at other instants, (K, ...), by linear interpolation."""
    flat = np.asarray(values, np.float64).reshape(len(times), -1)
    columns = [np.interp(at, times, column) for column in flat.T]
    return np.stack(columns, axis=-1).reshape(len(at), *values.shape[1:])


def imu_track(
    episode: Episode, rate_hz: float = 0.0, *, temperature: float = ROOM_TEMPERATURE
) -> DeviceTrack[InertialReading]:
    """Return what an IMU at the wrist reads.

    Args:
        episode: the episode, with or without noise.
        rate_hz: samples per second; 0 for the stored ones.
        temperature: degrees Celsius; NaN for an IMU that does not measure it.

    Raises:
        UsageError: if the attempt has no records; so for all tracks.
    """
    times = episode.imu["timestamp"]
    at = instants(times, rate_hz)
    force = resampled(episode.imu["specific_force"], times, at)
    angular = resampled(episode.imu["angular_velocity"], times, at)
    payloads = [
        InertialReading(specific_force=f, angular_velocity=w, temperature=temperature)
        for f, w in zip(force, angular, strict=True)
    ]
    return DeviceTrack(times=at, payloads=payloads)


def wrench_track(episode: Episode, rate_hz: float = 0.0) -> DeviceTrack[WrenchReading]:
    """Return what a force-torque sensor at the wrist reads; see ``imu_track``."""
    times = episode.streams["timestamp"]
    at = instants(times, rate_hz)
    wrenches = resampled(episode.streams["wrist_wrench"], times, at)
    return DeviceTrack(times=at, payloads=[WrenchReading(wrench=wrench) for wrench in wrenches])


def tactile_track(
    episode: Episode,
    rate_hz: float = 0.0,
    *,
    pad: str,
    pad_size: tuple[float, float],
    shape: tuple[int, int],
) -> DeviceTrack[TactileReading]:
    """Return the normal force on each taxel of a pad, N; see ``imu_track``.

    Args:
        episode: the episode.
        rate_hz: samples per second; 0 for the stored ones.
        pad: left or right.
        pad_size: width and height of the pad, m.
        shape: rows and columns of taxels.
    """
    side = lookup({name: k for k, name in enumerate(_PADS)}, "pad", pad)
    times = episode.streams["timestamp"]
    at = instants(times, rate_hz)
    images = taxel_image(episode.streams, pad_size, *shape)[:, side]
    frames = resampled(images, times, at)
    return DeviceTrack(times=at, payloads=[TactileReading(pressure=frame) for frame in frames])


def joints_track(episode: Episode, rate_hz: float = 0.0) -> DeviceTrack[JointReading]:
    """Return what a robot reports of its joints and gripper; see ``imu_track``."""
    streams = episode.streams
    times = streams["timestamp"]
    at = instants(times, rate_hz)

    def series(name: str) -> Array:
        return resampled(streams[name], times, at)

    columns = zip(
        series("joint_positions"),
        series("joint_velocities"),
        series("joint_torques"),
        series("joint_position_targets"),
        series("gripper_width"),
        series("gripper_width_target"),
        series("gripper_force"),
        strict=True,
    )
    payloads = [
        JointReading(
            positions=positions,
            velocities=velocities,
            torques=torques,
            position_targets=targets,
            gripper_width=float(width),
            gripper_width_target=float(width_target),
            gripper_force=float(force),
        )
        for positions, velocities, torques, targets, width, width_target, force in columns
    ]
    return DeviceTrack(times=at, payloads=payloads)


def without_targets(track: DeviceTrack[JointReading]) -> DeviceTrack[JointReading]:
    """Return the states of a robot that does not report its commands."""
    payloads = [
        replace(
            reading,
            position_targets=np.full(len(reading.positions), np.nan),
            gripper_width_target=np.nan,
        )
        for reading in track.payloads
    ]
    return replace(track, payloads=payloads)


def camera_track(
    episode: Episode, rate_hz: float = 30.0, *, camera: str
) -> DeviceTrack[CameraFrame]:
    """Return what a camera sees.

    It plays the frames of the episode's video, each as long as the next one is not there. An
    episode without video has two images: the one before the attempt is shown during it, and the
    one after it at its end. Depth is that of the nearer one of these two.

    Raises:
        UnknownNameError: naming the cameras.
    """
    frames = lookup(episode.cameras, "camera", camera)
    videos = episode.videos
    times = videos["timestamp"] if videos else episode.streams["timestamp"][[0, -1]]
    images = videos[f"{camera}/rgb"] if videos else frames.rgb
    at = instants(times, rate_hz)
    far = episode.spec.cameras[camera].far
    depths = [millimetres(depth, far) for depth in frames.depth]
    shown_at = np.clip(np.searchsorted(times, at + 1e-9, side="right") - 1, 0, len(times) - 1)
    middle = 0.5 * (times[0] + times[-1])
    payloads = [
        CameraFrame(rgb=images[k], depth=depths[int(time > middle)])
        for k, time in zip(shown_at, at, strict=True)
    ]
    return DeviceTrack(times=at, payloads=payloads)


def millimetres(depth: NDArray[Any], far: float) -> NDArray[np.uint16]:
    """Return depth (H, W), m, as a camera sends it: whole millimetres, 0 for not measured."""
    seen = (depth > 0.0) & (depth < far * (1.0 - 1e-4))
    whole = np.rint(np.where(seen, depth, 0.0) * _MM)
    return np.where(whole < 2**16, whole, 0).astype(np.uint16)


def without_depth(track: DeviceTrack[CameraFrame]) -> DeviceTrack[CameraFrame]:
    """Return the frames of a camera that has no depth."""
    return replace(track, payloads=[CameraFrame(rgb=frame.rgb) for frame in track.payloads])


def frozen(track: DeviceTrack[CameraFrame], after_s: float | None) -> DeviceTrack[CameraFrame]:
    """Return the frames of a camera that repeats its image from a time on; None for never."""
    if after_s is None:
        return track
    last = min(int(np.searchsorted(track.times, track.times[0] + after_s)), len(track.times) - 1)
    payloads = [track.payloads[min(k, last)] for k in range(len(track.times))]
    return replace(track, payloads=payloads)
