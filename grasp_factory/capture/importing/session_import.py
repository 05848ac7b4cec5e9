"""A session that is ready to be imported: its episodes are made one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.capture.importing.camera_arrays import (
    CameraPlan,
    camera_arrays,
    plan_images,
    video_series,
)
from grasp_factory.capture.importing.cuts import Cut, cuts_of, shifted
from grasp_factory.capture.importing.device_tracks import (
    SessionTracks,
    gripper_series,
    tracks_of,
)
from grasp_factory.capture.importing.episode_building import Measured, build_episode
from grasp_factory.capture.importing.grasp_columns import closings_of, grasp_columns
from grasp_factory.capture.importing.gripper_motion import GripperClosing
from grasp_factory.capture.importing.image_pass import FoundImages, WantedImages, read_images
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.outcome_labels import (
    RealLabels,
    force_label,
    gripper_label,
    operator_label,
)
from grasp_factory.capture.importing.real_recipe import real_recipe, span_of
from grasp_factory.capture.importing.session_contents import SessionContents, read_contents
from grasp_factory.capture.importing.session_facts import (
    EpisodeQuality,
    episode_quality,
    object_name,
    sync_report,
    texts_of,
)
from grasp_factory.capture.importing.store_config import config_for, devices_of_cameras
from grasp_factory.capture.importing.timeline import EpisodeSpan, own_series, stream_arrays
from grasp_factory.capture.quality.imu_calibration import noise_calibrations
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import UNKNOWN, Outcome
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.real_columns import Source
from grasp_factory.core.recording_source import RecordingSource
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import CaptureError, lookup
from grasp_factory.robots import ROBOTS
from grasp_factory.writers.base import Quarantined


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionImport:
    """A session with its episodes and the config of its store."""

    session: Path
    contents: SessionContents
    tracks: SessionTracks
    settings: ImportSettings
    cuts: tuple[Cut, ...]
    closings: tuple[GripperClosing, ...]
    config: FactoryConfig

    def specs(self) -> list[EpisodeSpec]:
        """Return the recipe of each episode."""
        untils = [*(cut.start_ns for cut in self.cuts[1:]), self.contents.span[1] + 1]
        return [
            real_recipe(
                self.config,
                index,
                RecordingSource(
                    session=self.contents.name,
                    path=self.contents.path,
                    sha256=self.contents.sha256,
                    start_ns=cut.start_ns,
                    end_ns=cut.end_ns,
                    label_until_ns=until,
                    calibration_sha256=self.contents.calibration_sha256,
                    label=cut.outcome,
                    settings=to_plain(self.settings),
                ),
                object_name(self.contents.events, cut.start_ns, self.settings),
            )
            for index, (cut, until) in enumerate(zip(self.cuts, untils, strict=True))
        ]

    def make(
        self, specs: Sequence[EpisodeSpec], on_row: Callable[[int, Episode | Quarantined], None]
    ) -> None:
        """Make episodes, in the order of their starts; all images are read in one pass.

        An episode that cannot be used is quarantined, with the reason.

        Raises:
            CaptureError: if the session is damaged.
        """
        devices = devices_of_cameras(self.config, self.tracks, self.settings)
        calibrations = noise_calibrations(self.session)
        plans: list[CameraPlan | CaptureError] = []
        for spec in specs:
            try:
                plans.append(
                    plan_images(
                        self.tracks, devices, span_of(spec), self.settings,
                        has_video=self.config.video_hz > 0,
                    )
                )  # fmt: skip
            except CaptureError as error:
                plans.append(error)
        nothing = WantedImages(frames=frozenset(), measured={})
        wanted = [nothing if isinstance(p, CaptureError) else p.wanted for p in plans]

        def take(found: FoundImages) -> None:
            spec, plan = specs[found.episode], plans[found.episode]
            if isinstance(plan, CaptureError):
                on_row(found.episode, Quarantined(spec, str(plan)))
                return
            span = span_of(spec)
            quality = episode_quality(
                self.contents,
                self.tracks,
                span,
                images=found.measures,
                calibrations=calibrations,
                settings=self.settings,
            )
            try:
                row: Episode | Quarantined = self._episode(spec, plan, found, quality)
            except CaptureError as error:
                row = Quarantined(spec, str(error))
            on_row(found.episode, row)

        read_images(self.session, wanted, take)

    def _episode(
        self, spec: EpisodeSpec, plan: CameraPlan, found: FoundImages, quality: EpisodeQuality
    ) -> Episode:
        least = self.settings.quality.min_score
        if quality.score < least:
            why = "; ".join(quality.shortcomings)
            raise CaptureError(f"quality {quality.score} is below min_score {least}: {why}")
        span, contents, config = span_of(spec), self.contents, self.config
        joints = len(ROBOTS[config.robot].arm_joints)
        closing = next(
            (c for c in self.closings if span.start_ns <= c.begins_ns < span.end_ns), None
        )
        labels = self._labels(spec, closing)
        if labels.outcome is None:
            raise CaptureError(
                "no label: neither operator, gripper width nor wrist force says how it ended"
            )
        count = int(span.duration_s * config.record_hz)
        at = np.arange(1, count + 1) / config.record_hz
        streams = stream_arrays(contents, self.tracks, span, at, self.settings, robot=config.robot)
        series: dict[str, dict[str, Any]] = {"streams": {"timestamp": at, **streams}}
        series |= own_series(contents, self.tracks, span, joints)
        video = video_series(plan, found, self.settings)
        series |= {"videos": video} if video else {}
        devices = devices_of_cameras(config, self.tracks, self.settings)
        cameras = camera_arrays(
            plan, found, contents, devices, config=config, settings=self.settings
        )
        columns = self._columns(spec, labels, span) | quality.columns()
        columns |= grasp_columns(closing, gripper_series(self.tracks), streams, at, span)
        columns["depth_holes"] = max(
            float(np.isnan(arrays["depth"][0]).mean()) for arrays in cameras.values()
        )
        measured = Measured(columns=columns, cameras=cameras, series=series)
        return build_episode(spec, labels.outcome, measured, config, joints)

    def _labels(self, spec: EpisodeSpec, closing: GripperClosing | None) -> RealLabels:
        source = spec.recording
        assert source
        contents, tracks = self.contents, self.tracks
        forces = None
        if tracks.force_torque:
            values = tracks.force_torque.values("wrench")[:, :3]
            forces = tracks.force_torque.times_ns, values
        grip, end_ns = gripper_series(tracks), source.end_ns
        width = gripper_label(closing, grip, end_ns, self.settings.min_width_m)
        force = force_label(closing, forces, end_ns, self.settings)
        cut = Cut(start_ns=source.start_ns, end_ns=end_ns, outcome=source.label)
        operator = operator_label(contents.events, cut, source.label_until_ns, (width, force))
        return RealLabels(operator=operator, gripper=width, force=force)

    def _columns(self, spec: EpisodeSpec, labels: RealLabels, span: EpisodeSpan) -> dict[str, Any]:
        target, source = spec.objects[0], spec.recording
        assert source
        ids = np.full(self.config.clutter.count, "", f"<U{max(1, len(target.object_id))}")
        ids[0] = target.object_id
        return {
            "object_id": target.object_id,
            "object_set": target.object_set,
            "object_family": target.family,
            "split": target.split,
            "policy": spec.policy,
            "grasp_proposer": spec.policy,
            "object_ids": ids,
            "source": int(Source.REAL),
            "session": source.session,
            "recording": source.path,
            "started": source.start_ns / 1e9,
            "duration": span.duration_s,
            "calibration_sha256": source.calibration_sha256,
            "label_operator": _code(labels.operator),
            "label_gripper": _code(labels.gripper),
            "label_force": _code(labels.force),
            "sync": sync_report(self.tracks, span, self.settings),
            **texts_of(self.contents),
        }


def open_import(
    session: Path,
    settings: ImportSettings,
    *,
    base: FactoryConfig | None = None,
    listed: Sequence[Cut] = (),
) -> SessionImport:
    """Read a session but for its images, and find its episodes.

    Args:
        session: its folder.
        settings: of the import.
        base: the config of the store; None to follow the session.
        listed: the list of cuts, for that method.

    Raises:
        CaptureError: if it is no session, damaged, or has no episode.
        UsageError: if it does not fit the config.
    """
    contents = read_contents(session)
    tracks = tracks_of(contents, settings)
    _check_names(settings, contents, list(base.cameras) if base else list(tracks.cameras))
    found = closings_of(contents, tracks, settings)
    at = shifted(listed, contents.span[0])
    cuts = cuts_of(contents.events, found, contents.span, settings, at)
    return SessionImport(
        session=session,
        contents=contents,
        tracks=tracks,
        settings=settings,
        cuts=cuts,
        closings=found,
        config=config_for(base, contents, tracks, cuts, settings),
    )


def _check_names(
    settings: ImportSettings, contents: SessionContents, cameras: Sequence[str]
) -> None:
    """Check that settings by name are of devices of the session and cameras of the store.

    Raises:
        UnknownNameError: for a name that is not there.
    """
    devices = dict.fromkeys(each.device for each in contents.series.values() if each.device)
    for name in settings.latency_s:
        lookup(devices, "device in latency_s", name)
    for key in ("cameras", "T_world_camera"):
        for name in getattr(settings, key):
            lookup(dict.fromkeys(cameras), f"camera in {key}", name)


def _code(label: Outcome | None) -> int:
    return UNKNOWN if label is None else int(label)
