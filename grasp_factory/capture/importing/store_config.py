"""The config of the store that a session is imported into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from grasp_factory.capture.importing.cuts import Cut
from grasp_factory.capture.importing.device_tracks import RecordedTrack, SessionTracks
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import SessionContents
from grasp_factory.capture.quality.streams import measured_rate
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.capture import FASTEST_HZ, CaptureConfig
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.errors import UsageError

_SPARE = 1.05
"""Factor on a rate or a length that was measured."""
_BLOCK_GB = 0.25
"""Colour videos of a block of episodes, which are in memory together, GB."""


def devices_of_cameras(
    config: FactoryConfig | None, tracks: SessionTracks, settings: ImportSettings
) -> dict[str, str]:
    """Return the device of each camera of the store.

    Raises:
        UsageError: if a camera has no device in the session.
    """
    names = list(config.cameras) if config else list(tracks.cameras)
    found = {name: settings.cameras.get(name, name) for name in names}
    if len(found) == len(tracks.cameras) == 1:
        found = {name: settings.cameras.get(name, next(iter(tracks.cameras))) for name in found}
    for name, device in found.items():
        if device not in tracks.cameras:
            valid = ", ".join(tracks.cameras) or "none"
            raise UsageError(
                f"camera {name} of the store: the session has no camera {device!r}, valid:"
                f" {valid}; name it in the setting cameras"
            )
    if not found:
        raise UsageError("the session has no camera: an episode needs images before and after")
    return found


def config_for(
    base: FactoryConfig | None,
    contents: SessionContents,
    tracks: SessionTracks,
    cuts: Sequence[Cut],
    settings: ImportSettings,
) -> FactoryConfig:
    """Return a store's config, whose seed is taken from the recording's SHA-256.

    Args:
        base: what the user chose, such as the config of a simulated store; None to follow the
            session. If it has no ``capture``, that follows the session, too.
        contents: the session.
        tracks: its devices.
        cuts: its episodes.
        settings: of the import.

    Raises:
        UsageError: if cameras or images do not fit.
        ConfigError: if the session needs more than a store can hold.
    """
    devices = devices_of_cameras(base, tracks, settings)
    sizes = {contents.image_sizes[tracks.cameras[d].series.topic] for d in devices.values()}
    if len(sizes) > 1:
        raise UsageError(f"images of {sorted(sizes)} pixels: cameras of a store have one size")
    (size,) = sizes
    if base and base.resolution != size:
        got, wanted = ("x".join(map(str, pair)) for pair in (size, base.resolution))
        raise UsageError(f"images are {got} pixels, the store's are {wanted}: choose its config")
    seed = int(contents.sha256[:15], 16)
    capture = base.capture if base and base.capture else _room(tracks, contents, cuts)
    if base:
        return replace(base, seed=seed, capture=capture)
    plain = FactoryConfig(
        seed=seed,
        cameras={name: CAMERAS["front"].config for name in devices},
        resolution=size,
        capture=capture,
    )
    video_hz = _video_rate(plain, [tracks.cameras[device] for device in devices.values()])
    per_episode = plain.longest_s * video_hz * len(devices) * size[0] * size[1] * 3 / 1e9
    block = max(1, min(plain.block_size, int(_BLOCK_GB / per_episode)))
    return replace(plain, video_hz=video_hz, block_size=block)


def _room(tracks: SessionTracks, contents: SessionContents, cuts: Sequence[Cut]) -> CaptureConfig:
    rows, columns = 1, 1
    if tracks.taxels:
        _, rows, columns = contents.taxels[tracks.taxels.series.topic].shape
    longest = max(cut.end_ns - cut.start_ns for cut in cuts) / 1e9
    return CaptureConfig(
        force_torque_hz=_rate(tracks.force_torque),
        joints_hz=_rate(tracks.joint_states),
        taxels_hz=_rate(tracks.taxels),
        imu_hz=_rate(tracks.imu),
        taxel_rows=rows,
        taxel_columns=columns,
        longest_s=math.ceil(longest * _SPARE + 0.1),
    )


def _rate(track: RecordedTrack | None) -> int:
    if track is None:
        return 0
    rate = measured_rate(track.times_ns, None)
    return 1 if math.isnan(rate) else min(FASTEST_HZ, math.ceil(rate * _SPARE) + 1)


def _video_rate(config: FactoryConfig, cameras: Sequence[RecordedTrack]) -> int:
    """Return the rate of videos that has room for the frames of the fastest camera, Hz."""
    rates = [measured_rate(track.times_ns, None) for track in cameras]
    fastest = max((rate for rate in rates if not math.isnan(rate)), default=1.0)
    whole = math.gcd(config.physics.free_hz, config.physics.contact_hz)
    valid = [rate for rate in range(1, min(whole, 240) + 1) if whole % rate == 0]
    valid.sort(key=lambda rate: (config.record_hz % rate != 0, rate))
    return next((rate for rate in valid if rate >= 0.99 * fastest), valid[-1])
