"""The quality of a session: its streams, its images, and the score."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.capture.privacy.camera_images import camera_image, is_camera_image
from grasp_factory.capture.quality.image_series import ImageMeasures, median
from grasp_factory.capture.quality.imu_calibration import noise_calibrations
from grasp_factory.capture.quality.imu_noise import NoiseDensities, noise_densities
from grasp_factory.capture.quality.session_quality import (
    SessionInspection,
    SessionQualityConfig,
)
from grasp_factory.capture.quality.streams import (
    longest_gap,
    lost_share,
    measured_rate,
    saturated_share,
)
from grasp_factory.capture.quality.sync_spread import host_times, widest_spread
from grasp_factory.capture.ros_messages import IMAGE, IMU, JOINT_STATE, WRENCH
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_reader import opened_session
from grasp_factory.capture.session_series import SESSION_LIMITS, DeviceSeries, SeriesBuilder
from grasp_factory.capture.session_settings import session_settings
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.serialization import is_number
from grasp_factory.errors import CaptureError
from grasp_factory.labels.image_metrics import MID_GREY

_REGULAR = (IMAGE, IMU, WRENCH, JOINT_STATE)
"""Types of messages that come at a rate; others, such as events and temperatures, may not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamQuality:
    """Measures of one topic; NaN where it cannot be known."""

    topic: str
    device: str
    samples: int
    rate: float
    """Hz, as measured."""
    nominal_rate: float
    """Hz, as session.yaml has it; NaN without."""
    gap: float
    """Longest time without a sample, in periods."""
    lost: float
    """Share of the samples."""
    saturated: float
    """Share of the samples of a force-torque sensor or IMU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionCheck:
    """What the check of a session found."""

    streams: tuple[StreamQuality, ...]
    inspection: SessionInspection
    score: int
    """1 to 5."""
    shortcomings: tuple[str, ...]
    """A text for each tolerance that is missed."""


def check_session(session: Path, thresholds: SessionQualityConfig | None = None) -> SessionCheck:
    """Measure the quality of a session; a process with limits reads it.

    Args:
        session: its folder.
        thresholds: bounds of the criteria; None for the default ones.

    Raises:
        CaptureError: if it is no session, damaged, or without samples.
        StoreError: if it needs too much memory or time.
    """
    bounds = thresholds or SessionQualityConfig()
    settings = session_settings(session)
    calibrations = noise_calibrations(session)
    series, images = in_import_process(_read, session, session, limits=SESSION_LIMITS)
    if not any(each.device for each in series):
        raise CaptureError(f"{session} has no samples of a device: there is nothing to check")
    streams = [stream_quality(each, nominal_rate(settings, each.device)) for each in series]
    found = inspect_session(series, streams, images, calibrations)
    return SessionCheck(
        streams=tuple(streams),
        inspection=found,
        score=found.score(bounds),
        shortcomings=found.shortcomings(bounds),
    )


def _read(session: Path, report: SendMessage) -> tuple[list[DeviceSeries], list[ImageMeasures]]:
    builders: dict[str, SeriesBuilder] = {}
    images: dict[str, ImageMeasures] = {}
    with opened_session(session) as reader:
        for message in reader.messages():
            topic = message.topic
            builders.setdefault(topic.name, SeriesBuilder(topic)).add(message)
            if is_camera_image(topic):
                image = camera_image(message)
                if not image.is_depth:
                    images.setdefault(topic.name, ImageMeasures()).add(image.rgb())
    return [builders[name].series() for name in sorted(builders)], list(images.values())


def stream_quality(series: DeviceSeries, nominal: float = math.nan) -> StreamQuality:
    """Return the measures of one stream.

    Args:
        series: its samples.
        nominal: the rate that it should have, Hz; NaN if unknown.
    """
    times = series.log_time_ns if series.device_ns is None else series.device_ns
    rate = measured_rate(times, series.sequence)
    known = None if math.isnan(nominal) else nominal
    is_regular = series.message_type in _REGULAR
    return StreamQuality(
        topic=series.topic,
        device=series.device,
        samples=len(series),
        rate=rate if is_regular else math.nan,
        nominal_rate=nominal,
        gap=longest_gap(times, known or rate) if is_regular else math.nan,
        lost=lost_share(times, series.sequence, known) if is_regular else math.nan,
        saturated=_worst(
            saturated_share(series.values[name])
            for name in ("wrench", "specific_force", "angular_velocity")
            if name in series.values
        ),
    )


def inspect_session(
    series: list[DeviceSeries],
    streams: list[StreamQuality],
    images: list[ImageMeasures],
    calibrations: Mapping[str, NoiseDensities],
) -> SessionInspection:
    """Return the measures behind the score, from arrays alone.

    The worst camera and the worst stream count.

    Args:
        series: samples of all topics, of a session or a part of it.
        streams: their ``stream_quality``, in the same order.
        images: measures of the images of each camera.
        calibrations: noise of the IMUs by topic; the only one is that of the only IMU. An IMU
            without one is not compared.
    """
    imus = [each for each in series if "specific_force" in each.values]
    noise = [_noise_ratios(each, _calibration_of(each, imus, calibrations)) for each in imus]
    exposures = [median(each.exposure) for each in images]
    return SessionInspection(
        sharpness=min((median(each.sharpness) for each in images), default=math.nan),
        exposure=max(exposures, key=lambda mean: abs(mean - MID_GREY), default=math.nan),
        clipped=_worst(median(each.clipped) for each in images),
        frozen=_worst(float(each.frozen) for each in images),
        stream_gap=_worst(stream.gap for stream in streams),
        lost=_worst(stream.lost for stream in streams),
        accelerometer_noise=_worst(ratio.accelerometer for ratio in noise),
        gyroscope_noise=_worst(ratio.gyroscope for ratio in noise),
        saturated=_worst(stream.saturated for stream in streams),
        sync_spread=_spread(series, streams),
    )


def nominal_rate(settings: Mapping[str, Any], device: str) -> float:
    """Return the rate that session.yaml gives a device: ``devices.NAME.rate_hz``; NaN without."""
    devices = settings.get("devices")
    found = devices.get(device) if isinstance(devices, Mapping) else None
    rate: Any = found.get("rate_hz") if isinstance(found, Mapping) else None
    return float(rate) if is_number(rate) and 0 < rate < 1e9 else math.nan


def _calibration_of(
    imu: DeviceSeries, imus: list[DeviceSeries], calibrations: Mapping[str, NoiseDensities]
) -> NoiseDensities | None:
    if len(imus) == len(calibrations) == 1:
        return next(iter(calibrations.values()))
    return calibrations.get(imu.topic)


def _noise_ratios(series: DeviceSeries, known: NoiseDensities | None) -> NoiseDensities:
    """Return the noise at rest as a multiple of the calibration; NaN if it cannot be known."""
    if known is None or len(series) < 2:
        return NoiseDensities(math.nan, math.nan)
    times = series.log_time_ns if series.device_ns is None else series.device_ns
    rate = measured_rate(times, series.sequence)
    found = noise_densities(
        series.values["specific_force"], series.values["angular_velocity"], rate
    )
    return NoiseDensities(
        found.accelerometer / known.accelerometer, found.gyroscope / known.gyroscope
    )


def _spread(series: list[DeviceSeries], streams: list[StreamQuality]) -> float:
    times = {each.topic: host_times(each.log_time_ns, each.device_ns) for each in series}
    kinds = {each.topic: each.kind for each in series}
    cameras = {name: times[name] for name, kind in kinds.items() if kind is DeviceKind.CAMERA}
    others = {
        stream.topic: (times[stream.topic], stream.rate)
        for stream in streams
        if kinds[stream.topic] not in (None, DeviceKind.CAMERA) and not math.isnan(stream.rate)
    }
    return widest_spread(cameras, others)


def _worst(values: Any) -> float:
    """Return the greatest of the values that are known; NaN without any."""
    return max((value for value in values if not math.isnan(value)), default=math.nan)
