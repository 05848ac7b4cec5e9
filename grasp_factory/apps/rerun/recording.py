"""Writing a stored attempt as a Rerun recording."""

from __future__ import annotations

import tempfile
from pathlib import Path

import rerun as rr

from grasp_factory.apps.playback.track import Track
from grasp_factory.apps.rerun.cameras import is_calibrated, log_cameras, log_clouds, log_labels
from grasp_factory.apps.rerun.layout import blueprint
from grasp_factory.apps.rerun.recorded_motion import has_motion, log_objects, log_robot
from grasp_factory.apps.rerun.scenery import log_scenery
from grasp_factory.apps.rerun.sdk import RRD
from grasp_factory.apps.rerun.series import log_phases, log_series
from grasp_factory.apps.rerun.words import episode_text
from grasp_factory.core.episode import Episode
from grasp_factory.core.output_file import check_out, written_aside
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory import embedded_assets
from grasp_factory.signals.plot_series import curve_groups, phase_spans

APPLICATION = "grasp_factory"


def write_recording(dataset: Dataset, index: int, out: Path) -> None:
    """Write all stored data of an attempt as a Rerun recording.

    Of a real episode, what was not measured is left out, and so are the shapes of objects.

    Args:
        dataset: The dataset with the attempt.
        index: Index of the episode, which must be in the store.
        out: Output file, ending in .rrd; an existing recording is replaced.

    Raises:
        UsageError: if a recording may not be written to ``out``.
        StoreError: if the episode is quarantined or cannot be read, or the file cannot be written.
        RecipeError: if an object of the episode does not exist any more.
    """
    check_out(out, [RRD])
    episode = dataset[index]
    embedded_assets.unpack(dataset.path, dataset.config)
    with written_aside(out) as partial:
        _write(dataset, index, episode, partial)


def _write(dataset: Dataset, index: int, episode: Episode, file: Path) -> None:
    streams, columns = episode.streams, episode.columns
    groups = curve_groups(
        streams, episode.imu, columns["object_com"][0], float(columns["rest_height"])
    )
    track = Track.of(episode) if has_motion(episode) else None
    times = [0.0, float(streams["timestamp"][-1])] if episode.n_steps else [0.0]
    is_placed = all(map(is_calibrated, episode.cameras.values()))
    seen = times if is_placed else []
    clouds = [dataset.point_cloud(index, frame=frame) for frame in range(len(seen))]
    rr.set_strict_mode(True)
    recording = rr.RecordingStream(
        APPLICATION, recording_id=episode.checksum(), send_properties=False
    )
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    with recording, tempfile.TemporaryDirectory() as folder:
        recording.save(file, blueprint(list(episode.cameras), groups))
        recording.send_recording_name(f"{dataset.path.name} {index}")
        text = rr.TextDocument(episode_text(episode), media_type=rr.MediaType.MARKDOWN)
        recording.log("episode", text, static=True)
        log_labels(recording, len(episode.spec.objects))
        log_scenery(recording, episode)
        if track:
            log_robot(recording, episode.spec.robot, track, Path(folder))
        if track and not episode.is_real:
            log_objects(recording, episode, track, Path(folder))
        log_cameras(recording, episode, times)
        log_clouds(recording, clouds, seen)
        log_series(recording, episode, groups)
        log_phases(recording, episode, phase_spans(streams))
