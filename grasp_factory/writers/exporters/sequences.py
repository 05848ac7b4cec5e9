"""Sequences of a robot data collection: images, CSV files and calibration for each camera.

``sequences/<episode>_<camera>/`` holds ``rgb/``, ``depth/`` (PNG, 16 bit, mm), ``segmentation/``,
``data.csv`` in ``imu/``, ``force/``, ``tactile/``, ``robot/`` and ``objects/``, of stores with real
episodes also in ``force_torque/``, ``joints/`` and ``taxels/``,
``calibration/cam_intrinsics.json``, ``calibration/imu_to_cam_extrinsics.yaml`` (kalibr's names),
``metadata.json`` (a list of frames) and ``sync_metadata.json`` (each frame with the IMU's sample
nearest to it). ``annotations/<episode>.json`` holds label and columns, and ``dataset_info.yaml``
describes all of it. Timestamps are seconds since the arm started, or a real episode began.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array
from grasp_factory.core.real_series import REAL_GROUPS
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.camera_calibration import intrinsics, kalibr_camera
from grasp_factory.writers.exporters.csv_series import write_series
from grasp_factory.writers.exporters.images import depth_to_uint16, write_png
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.plain_columns import plain, plain_columns
from grasp_factory.writers.exporters.sequence_reading import read_back
from grasp_factory.writers.exporters.sequence_tables import MM, table_values, tables


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceFrame:
    """An image of a sequence; depth and labels of its pixels exist before and after the attempt."""

    what: str
    """before, video or after."""
    timestamp: float
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32] | None
    segmentation: NDArray[np.uint8] | None
    T_world_camera: Array


def write_part(job: ExportJob, part: ExportPart) -> None:
    """Write the sequences of some episodes."""
    (job.folder / "annotations").mkdir(exist_ok=True)
    for place, episode in part.episodes:
        names = [f"{place:06d}_{camera}" for camera in episode.cameras]
        for name, camera in zip(names, episode.cameras, strict=True):
            _write_sequence(job.folder / "sequences" / name, episode, camera)
        columns = plain_columns(episode.spec, episode.contents())
        annotation = {"sequences": names, "success": episode.success, **columns}
        write_json(job.folder / "annotations" / f"{place:06d}.json", annotation)


def _write_sequence(folder: Path, episode: Episode, camera: str) -> None:
    for name in ("rgb", "depth", "segmentation", "calibration"):
        (folder / name).mkdir(parents=True)
    contents, joints = episode.contents(), episode.streams["joint_positions"].shape[1]
    taxels = contents.get("taxels/pressure", np.empty((0, 0, 0))).shape[1:]
    for name, table in tables(joints, len(episode.spec.objects), taxels).items():
        if values := table_values(table, contents):
            (folder / name).mkdir()
            write_series(folder / name / "data.csv", values)
    calibration = intrinsics(episode, camera)
    write_json(folder / "calibration" / "cam_intrinsics.json", calibration)
    kalibr = yaml.safe_dump({"cam0": kalibr_camera(episode, camera)}, sort_keys=False)
    (folder / "calibration" / "imu_to_cam_extrinsics.yaml").write_text(kalibr, encoding="ascii")
    metadata = [_written(folder, k, frame) for k, frame in enumerate(_frames(episode, camera))]
    write_json(folder / "metadata.json", [row | {"camera_info": calibration} for row in metadata])
    synchronized = [row | {"imu": _imu_at(episode, row["timestamp"])} for row in metadata]
    write_json(folder / "sync_metadata.json", synchronized)


def _frames(episode: Episode, camera: str) -> Iterator[SequenceFrame]:
    """Yield the frames: before the attempt, the video's, after the attempt."""
    images, videos = episode.cameras[camera], episode.videos
    clock = episode.streams["timestamp"]
    last = float(clock[-1]) if len(clock) else 0.0

    def still(k: int, what: str, timestamp: float) -> SequenceFrame:
        return SequenceFrame(
            what=what,
            timestamp=timestamp,
            rgb=images.rgb[k],
            depth=images.depth[k],
            segmentation=images.segmentation[k],
            T_world_camera=images.T_world_camera[k],
        )

    yield still(0, "before", 0.0)
    for k, timestamp in enumerate(videos.get("timestamp", ())):
        yield SequenceFrame(
            what="video",
            timestamp=float(timestamp),
            rgb=videos[f"{camera}/rgb"][k],
            depth=None,
            segmentation=None,
            T_world_camera=videos[f"{camera}/T_world_camera"][k],
        )
    yield still(1, "after", last)


def _written(folder: Path, k: int, frame: SequenceFrame) -> dict[str, Any]:
    """Write the images of a frame; return its entry of the metadata."""
    file = f"{k:06d}.png"
    write_png(folder / "rgb" / file, frame.rgb)
    if frame.depth is not None:
        write_png(folder / "depth" / file, depth_to_uint16(frame.depth, MM))
    if frame.segmentation is not None:
        write_png(folder / "segmentation" / file, frame.segmentation)
    return {
        "frame_id": k,
        "timestamp": frame.timestamp,
        "rgb_path": f"rgb/{file}",
        "depth_path": "" if frame.depth is None else f"depth/{file}",
        "segmentation_path": "" if frame.segmentation is None else f"segmentation/{file}",
        "what": frame.what,
        "T_world_camera": plain(frame.T_world_camera),
    }


def _imu_at(episode: Episode, timestamp: float) -> dict[str, Any] | None:
    """Return the IMU's sample nearest to a time; None if the IMU has no samples."""
    imu = episode.imu
    if not episode.n_imu:
        return None
    k = int(np.argmin(np.abs(imu["timestamp"] - timestamp)))
    return {
        "timestamp": float(imu["timestamp"][k]),
        "angular_velocity": plain(imu["angular_velocity"][k]),
        "linear_acceleration": plain(imu["specific_force"][k]),
    }


def finish(job: ExportJob, parts: Sequence[None]) -> None:
    """Write the description of the dataset."""
    config, episodes = job.episodes.config, job.episodes
    is_real = episodes.is_real
    kinds = [] if is_real.all() else ["simulated"]
    kinds += ["recorded"] if is_real.any() else []
    splits, counts = np.unique(episodes.column("split"), return_counts=True)
    info: Mapping[str, Any] = {
        "name": episodes.sources[0].path.name,
        "description": " and ".join(kinds)
        + " robot grasps: images, IMU, forces, touch, joints and a label",
        "episodes": len(episodes),
        "successes": int(episodes.column("success").sum()),
        "splits": {str(name): int(count) for name, count in zip(splits, counts, strict=True)},
        "cameras": list(config.cameras),
        "resolution": list(config.resolution),
        "rates_hz": {
            "imu": config.imu_rate,
            "video": config.video_hz,
            "force, tactile, robot, objects": config.record_hz,
            **_own_rates(config),
        },
        "units": {
            "timestamp": "s since the arm started",
            "depth": "mm, 0 for no value",
            "ax, ay, az": "m/s2, specific force: at rest 9.81 upwards",
            "wx, wy, wz": "rad/s",
            "f": "N",
            "t": "N m",
            "p": "m, world frame",
            "q": "quaternion x, y, z, w",
            "joint_position": "rad",
            "gripper_width": "m",
        },
    }
    text = yaml.safe_dump(info, sort_keys=False, allow_unicode=True)
    (job.folder / "dataset_info.yaml").write_text(text, encoding="utf-8")


def _own_rates(config: FactoryConfig) -> dict[str, str]:
    """Return what a store says of the rates of real devices."""
    groups = [group for group in REAL_GROUPS if group.rate(config)]
    return {group.name: f"up to {group.rate(config)}; see timestamp" for group in groups}


SEQUENCES = Exporter(
    name="sequences",
    description="image sequences with CSV files and kalibr's calibration, one per camera",
    contents=ExportContents(
        written=(
            *("cameras/*", "videos/*", "imu/*", *REAL_SERIES),
            *(f"streams/{name}" for name in ("timestamp", "joint_*", "gripper_*", "tcp_pose")),
            *(f"streams/{name}" for name in ("phase", "shake_level", "object_pose", "reward")),
            *(f"streams/{name}" for name in ("tactile_wrench", "wrist_wrench", "hand_force")),
        ),
        left_out={
            "streams/*": "no file of the layout is for the sensor of a user",
            "streams/tactile_*": "a CSV file has no place for lists of contact points",
        },
        treatment={
            "depth": "16 bit, mm: rounded to 1 mm; NaN and more than 65.535 m are 0",
            "NaN": "an empty cell of a CSV file, null in JSON",
            "no grasp": "the columns of the grasp are null in the annotation",
            "no attempt": "two frames, before and after, and CSV files without rows",
            "no video": "two frames, before and after",
            REAL_ROWS: "imu, force_torque, joints and taxels have each sample at its own time; a"
            " label or phase of 255 was not measured",
            "T_cam_imu": "constant for a camera on the hand; else that of the first record",
        },
    ),
    write_part=write_part,
    finish=finish,
    read_back=read_back,
)
