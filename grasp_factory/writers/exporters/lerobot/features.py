"""Features of a LeRobot dataset, and the values that an episode has for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.field import Field
from grasp_factory.core.mp4_file import even_size
from grasp_factory.writers.exporters.base import ExportFolder
from grasp_factory.writers.exporters.lerobot.even_frames import windowed_groups
from grasp_factory.writers.exporters.lerobot.lerobot_settings import IMAGE
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.steps import EpisodeSteps

IMAGES = "observation.images."
"""Before the name of a camera; also LeRobot's name for an image that policies take."""
MEASURED = (
    *("streams/joint_positions", "streams/joint_velocities", "streams/joint_torques"),
    *("streams/gripper_width", "streams/gripper_force", "streams/tcp_pose"),
    *("streams/tactile_wrench", "streams/wrist_wrench"),
    *("imu/specific_force", "imu/angular_velocity"),
)
"""Series that a robot measures at all times. LeRobot's policies may take them as state:
``dataset_to_policy_features`` selects features by the prefix ``observation``."""
TRUTH = (
    *("streams/object_pose", "streams/hand_force", "streams/tactile_body", "streams/reward"),
    *("streams/phase", "streams/shake_level"),
)
"""Series that no robot measures."""
_SINGLE = (1,)
"""Shape of a feature that is one number: LeRobot stores a scalar."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeRobotFeature:
    """A feature: what a frame has under a name."""

    dtype: str
    """Name of a numpy dtype, or video or image."""
    shape: tuple[int, ...]
    """Shape of a frame's value; (1,) for a scalar."""
    names: tuple[str, ...] | None = None
    """Names of the values of a vector, or of an image's dimensions."""

    @property
    def statistics_shape(self) -> tuple[int, ...]:
        """Shape of the statistics: those of images are of the channels."""
        return (3, 1, 1) if self.dtype in ("image", "video") else self.shape


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowedSeries:
    """A series of the store, of which each frame has the records since the frame before."""

    name: str
    """Name of the feature."""
    field: Field
    per_frame: int
    """Records per frame."""

    def of_frames(self, values: NDArray[Any], frames: int) -> NDArray[Any]:
        """Return the windows of the frames, (frames, per_frame, ...), of a series (records, ...).

        With one record per frame, windows have no axis of their own: (frames, ...).
        """
        records = values[: frames * self.per_frame]
        window = (self.per_frame,) if self.per_frame > 1 else ()
        return records.reshape(frames, *window, *values.shape[1:])

    def after_frames(self, values: NDArray[Any], frames: int) -> NDArray[Any]:
        """Return the records after the last frame."""
        return values[frames * self.per_frame :]


def windowed_series(episodes: Selection | ExportFolder) -> Iterator[WindowedSeries]:
    """Yield the series that are divided among the frames, other than the videos' images."""
    config = episodes.config
    rates = {group.name: group.rate(config) for group in windowed_groups(config)}
    for path, field in episodes.fields.items():
        group = path.partition("/")[0]
        if rates.get(group) and field.length_column and not field.is_video:
            yield WindowedSeries(
                name=_feature_name(path), field=field, per_frame=rates[group] // config.video_hz
            )


def own_series(episodes: Selection | ExportFolder) -> Iterator[Field]:
    """Yield the series at the devices' own times, which no frame has."""
    divided = {group.name for group in windowed_groups(episodes.config)}
    for path, field in episodes.fields.items():
        is_series = field.length_column and not path.startswith("episodes/")
        if is_series and path.partition("/")[0] not in divided:
            yield field


def _feature_name(path: str) -> str:
    if path in MEASURED:
        return f"observation.{path.removeprefix('streams/')}".replace("/", ".")
    if path in TRUTH:
        return f"truth.{path.removeprefix('streams/')}"
    return path.replace("/", ".")


def frame_values(
    episode: Episode, steps: EpisodeSteps, series: Mapping[str, WindowedSeries]
) -> dict[str, NDArray[Any]]:
    """Return the values of an episode's K frames by feature, (K, *shape), without images.

    Args:
        episode: the episode.
        steps: its steps.
        series: the series by path in the store.
    """
    frames = len(steps.timestamp)
    is_last = np.arange(frames) == frames - 1
    contents = episode.contents()
    return {
        "observation.state": steps.state,
        "action": steps.action,
        "timestamp": steps.timestamp.astype(np.float32),
        "frame_index": np.arange(frames),
        "next.reward": (is_last & episode.success).astype(np.float32),
        "next.done": is_last,
        "next.success": is_last & episode.success,
        **{one.name: one.of_frames(contents[path], frames) for path, one in series.items()},
    }


def features_of(
    episodes: Selection, values: Mapping[str, NDArray[Any]], video: str
) -> dict[str, LeRobotFeature]:
    """Return the features of a dataset.

    Args:
        episodes: the episodes.
        values: the values of any episode's frames, with all columns of the data files.
        video: how images are stored, one of ``STORAGES``.
    """
    joints = values["action"].shape[1] - 1
    motors = (*(f"joint_{k + 1}" for k in range(joints)), "gripper_width")
    names = {"observation.state": motors, "action": motors}
    size = episodes.config.resolution
    width, height = size if video == IMAGE else even_size(*size)
    image = LeRobotFeature(
        dtype="image" if video == IMAGE else "video",
        shape=(height, width, 3),
        names=("height", "width", "channels"),
    )
    return {f"{IMAGES}{camera}": image for camera in episodes.config.cameras} | {
        name: LeRobotFeature(
            dtype=array.dtype.name, shape=array.shape[1:] or _SINGLE, names=names.get(name)
        )
        for name, array in values.items()
    }


def constants_of(episodes: Selection, episode: Episode) -> dict[str, NDArray[Any]]:
    """Return the arrays that belong to an episode and to no frame, by path in the store."""
    fields = episodes.fields
    return {
        path: values
        for path, values in episode.contents().items()
        if path in fields and is_constant(fields[path])
    }


def is_constant(field: Field) -> bool:
    """Return whether an array has one value for an episode, and is no column and no image."""
    is_column = field.path.startswith("episodes/")
    return not (is_column or field.length_column or field.is_image)
