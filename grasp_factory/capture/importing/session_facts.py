"""What the settings of a session and its checks say of an episode: texts and measures."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from grasp_factory.capture.importing.device_tracks import RecordedTrack, SessionTracks
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import RecordedEvent, SessionContents
from grasp_factory.capture.importing.timeline import EpisodeSpan
from grasp_factory.capture.quality.image_series import ImageMeasures
from grasp_factory.capture.quality.imu_noise import NoiseDensities
from grasp_factory.capture.quality.session_check import (
    inspect_session,
    nominal_rate,
    stream_quality,
)
from grasp_factory.capture.quality.session_quality import SessionInspection
from grasp_factory.capture.session.events import EPISODE_START
from grasp_factory.capture.session_series import DeviceSeries
from grasp_factory.capture.sync.set_spread import synchronise
from grasp_factory.capture.sync.sync_settings import SyncSettings

UNNAMED = "unnamed"
"""The object if nobody says what it is."""
_SETUP = ("devices", "firmware", "sensor_setup")


def texts_of(contents: SessionContents) -> dict[str, str]:
    """Return the columns that are texts of session.yaml."""
    settings = contents.settings
    words = {
        name: str(settings.get(name) or "") for name in ("operator", "task", "scenario", "weather")
    }
    setup = {name: settings[name] for name in _SETUP if settings.get(name)}
    return words | {
        "environment": _json(settings.get("environment") or {}),
        "sensor_setup": _json(setup),
        "consent": _json(settings.get("consent")),
    }


def object_name(events: Sequence[RecordedEvent], start_ns: int, settings: ImportSettings) -> str:
    """Return what is grasped: as the start of the episode says, or the settings, or unnamed."""
    for event in events:
        if event.name == EPISODE_START and event.time_ns == start_ns:
            named = event.fields.get("object")
            if isinstance(named, str) and named:
                return named[:200]
    return settings.object or UNNAMED


def sync_report(tracks: SessionTracks, span: EpisodeSpan, settings: ImportSettings) -> str:
    """Return the spread of paired samples and the fits of clocks as JSON."""
    times = {name: span.own_times(track) for name, track in tracks.named().items()}
    times = {name: each for name, each in times.items() if len(each)}
    clocks = {name: dict(track.clock) for name, track in tracks.named().items() if track.clock}
    spreads = (
        synchronise(times, SyncSettings(slop_s=settings.max_gap_s)).spreads
        if len(times) > 1
        else ()
    )
    pairs = {each.name: {k: v for k, v in asdict(each).items() if k != "name"} for each in spreads}
    return _json({"clocks": clocks, "pairs": pairs})


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeQuality:
    """The measures of an episode, and its score."""

    inspection: SessionInspection
    score: int
    shortcomings: tuple[str, ...]

    def columns(self) -> dict[str, Any]:
        """Return the columns of the store."""
        names = ("sharpness", "exposure", "clipped", "stream_gap", "sync_spread")
        found = {name: _finite(getattr(self.inspection, name)) for name in names}
        return found | {"quality": self.score}


def episode_quality(
    contents: SessionContents,
    tracks: SessionTracks,
    span: EpisodeSpan,
    *,
    images: Mapping[str, ImageMeasures],
    calibrations: Mapping[str, NoiseDensities],
    settings: ImportSettings,
) -> EpisodeQuality:
    """Return the quality of an episode, as ``capture check`` has it of a session."""
    series = [_part(track, span) for track in tracks.named().values()]
    streams = [
        stream_quality(each, nominal_rate(contents.settings, each.device)) for each in series
    ]
    found = inspect_session(series, streams, list(images.values()), calibrations)
    return EpisodeQuality(
        inspection=found,
        score=found.score(settings.quality),
        shortcomings=found.shortcomings(settings.quality),
    )


def _part(track: RecordedTrack, span: EpisodeSpan) -> DeviceSeries:
    """Return a track's samples in an episode, on the host's clock."""
    inside = track.within(span.start_ns, span.end_ns)
    places, series = track.places[inside], track.series
    return replace(
        series,
        log_time_ns=track.times_ns[inside],
        device_ns=None,
        sequence=None if series.sequence is None else series.sequence[places],
        values={n: v[places] if len(v) else v for n, v in series.values.items()},
    )


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan


def _json(value: Any) -> str:
    return json.dumps(_plain(value), sort_keys=True, separators=(",", ":"), default=str)


def _plain(value: Any) -> Any:
    """Return JSON data: numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
