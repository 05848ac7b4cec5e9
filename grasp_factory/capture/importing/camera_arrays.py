"""The images of a real episode: which are wanted, and their arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.importing.device_tracks import RecordedTrack, SessionTracks
from grasp_factory.capture.importing.image_pass import FoundImages, Frame, WantedImages
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import SessionContents
from grasp_factory.capture.importing.timeline import EpisodeSpan
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.geometry import Array
from grasp_factory.errors import CaptureError
from grasp_factory.signals.timeline import Ticks

_MM = 0.001


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPlan:
    """The images of an episode by camera of the store."""

    before_after: Mapping[str, tuple[Frame, Frame]]
    depths: Mapping[str, tuple[Frame | None, Frame | None]]
    """None where no depth was measured near the image."""
    video: Mapping[str, tuple[Frame, ...]]
    """Empty for a store without videos."""
    video_times: Array
    """(V,) seconds since the start: those of the first camera."""
    wanted: WantedImages


def plan_images(
    tracks: SessionTracks,
    devices: Mapping[str, str],
    span: EpisodeSpan,
    settings: ImportSettings,
    *,
    has_video: bool,
) -> CameraPlan:
    """Return which images an episode needs.

    Those before and after are the nearest to its start and its end. A video has every image of the
    first camera, and of the others the nearest to each.

    Raises:
        CaptureError: if a camera has no image in the episode.
    """
    ends = np.array([span.start_ns, span.end_ns])
    slop = round(settings.max_gap_s * 1e9)
    shown, depths, video, measured = {}, {}, {}, {}
    reference = tracks.cameras[next(iter(devices.values()))]
    instants = reference.times_ns[reference.within(span.start_ns, span.end_ns)]
    for name, device in devices.items():
        track = tracks.cameras[device]
        inside = track.within(span.start_ns, span.end_ns)
        if inside.stop == inside.start:
            raise CaptureError(f"camera {device} has no image in the episode")
        within = track.places[inside]
        first, last = (int(place) for place in _nearest(track, ends)[0])
        shown[name] = _frame(track, first), _frame(track, last)
        times = track.times_ns[[first, last]]
        depths[name] = _depths(tracks.depths.get(device), times, slop)
        if has_video:
            video[name] = tuple(_frame(track, k) for k in _nearest(track, instants)[0].tolist())
        measured[track.series.topic] = int(within[0]), int(within[-1]) + 1
    frames = {frame for pair in (*shown.values(), *depths.values()) for frame in pair if frame}
    frames |= {frame for several in video.values() for frame in several}
    return CameraPlan(
        before_after=shown,
        depths=depths,
        video=video,
        video_times=(instants - span.start_ns) / 1e9,
        wanted=WantedImages(frames=frozenset(frames), measured=measured),
    )


def camera_arrays(
    plan: CameraPlan,
    found: FoundImages,
    contents: SessionContents,
    devices: Mapping[str, str],
    *,
    config: FactoryConfig,
    settings: ImportSettings,
) -> dict[str, dict[str, NDArray[Any]]]:
    """Return the arrays of each camera; segmentation and visibility are not measured.

    Raises:
        CaptureError: if images have another size than the store's.
    """
    width, height = config.resolution
    out: dict[str, dict[str, NDArray[Any]]] = {}
    for name, device in devices.items():
        images = [found.frames[frame] for frame in plan.before_after[name]]
        if any(image.shape != (height, width, 3) for image in images):
            raise CaptureError(f"images of camera {device} are not of {width} x {height} pixels")
        arrays: dict[str, NDArray[Any]] = {"rgb": np.stack(images)}
        arrays["depth"] = np.stack([
            _metres(found.frames[frame] if frame else None, (height, width), device)
            for frame in plan.depths[name]
        ])  # fmt: skip
        if device in contents.intrinsics:
            arrays["intrinsics"] = contents.intrinsics[device]
        if name in settings.T_world_camera:
            arrays["T_world_camera"] = np.array([settings.T_world_camera[name]] * 2)
        out[name] = arrays
    return out


def video_series(
    plan: CameraPlan, found: FoundImages, settings: ImportSettings
) -> dict[str, NDArray[Any]]:
    """Return the series of the group ``videos``; empty without video."""
    if not plan.video:
        return {}
    out: dict[str, NDArray[Any]] = {"timestamp": plan.video_times}
    for name, frames in plan.video.items():
        out[f"{name}/rgb"] = np.stack([found.frames[frame] for frame in frames])
        if name in settings.T_world_camera:
            pose = np.array(settings.T_world_camera[name])
            out[f"{name}/T_world_camera"] = np.repeat(pose[None], len(frames), axis=0)
    return out


def _frame(track: RecordedTrack, place: int) -> Frame:
    return track.series.topic, int(track.places[place])


def _nearest(track: RecordedTrack, at: Ticks) -> tuple[NDArray[np.int64], Ticks]:
    """Return the place in the track of the nearest sample to each instant, and its distance."""
    after = np.clip(np.searchsorted(track.times_ns, at), 0, len(track.times_ns) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(at - track.times_ns[before]) <= np.abs(track.times_ns[after] - at)
    places = np.where(is_before, before, after)
    return places, np.abs(track.times_ns[places] - at)


def _depths(
    track: RecordedTrack | None, times: Ticks, slop_ns: int
) -> tuple[Frame | None, Frame | None]:
    if track is None:
        return None, None
    places, away = _nearest(track, times)
    first, last = (
        _frame(track, int(place)) if distance <= slop_ns else None
        for place, distance in zip(places, away, strict=True)
    )
    return first, last


def _metres(depth: NDArray[Any] | None, shape: tuple[int, int], device: str) -> NDArray[np.float32]:
    """Return depth in m; NaN where it was not measured."""
    if depth is None:
        return np.full(shape, np.nan, np.float32)
    if depth.shape != shape:
        raise CaptureError(f"depths of camera {device} are of another size than its colours")
    return np.where(depth > 0, depth * _MM, np.nan).astype(np.float32)
