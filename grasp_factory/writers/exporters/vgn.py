"""The data sets of VGN and GIGA: grasps in a cube of voxels, and the depth images they come from.

- ``raw/``: setup.json, scenes/<id>.npz (depth_imgs, extrinsics) and grasps.csv in metres.
- ``training/``: scenes/<id>.npz (grid, a TSDF) and grasps.csv in voxels.

VGN trains on the second folder; GIGA takes both. Layout: https://github.com/ethz-asl/vgn,
src/vgn/io.py and dataset.py. ``vgn_cube.py`` describes the frames.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Intrinsics
from grasp_factory.core.config.cameras import Mount
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, Pose, inverse, transform
from grasp_factory.core.linear import product
from grasp_factory.robots import gripper_of
from grasp_factory.signals.tsdf import DepthView, tsdf_grid
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.images import camera_of
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.overhead_view import without_grasp
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.vgn_cube import (
    RESOLUTION,
    VgnSettings,
    cube_origin,
    finger_root,
)

PLACES = {"raw": "x,y,z", "training": "i,j,k"}
"""The folders, and the names of the position in their tables."""


def cameras_of(episodes: Selection, settings: VgnSettings) -> list[str]:
    """Return the names of the cameras to use.

    Raises:
        UnknownNameError: for an unknown camera.
    """
    if settings.cameras:
        return [camera_of(episodes, name) for name in settings.cameras]
    cameras = episodes.config.cameras
    return [name for name, c in cameras.items() if c.mount is Mount.WORLD] or list(cameras)


def excludes(episodes: Selection, settings: VgnSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude episodes without a grasp or a calibration, and those whose grasp has no voxel.

    Raises:
        UnknownNameError: for an unknown camera.
    """
    cameras = cameras_of(episodes, settings)
    pose = (episodes.column("grasp_position"), episodes.column("grasp_quat_xyzw"))
    with np.errstate(invalid="ignore"):
        voxel = np.round(finger_root(*pose, episodes.config, settings) / settings.voxel)
        outside = np.any((voxel < 0) | (voxel >= RESOLUTION), axis=1)
    return {**without_grasp(episodes, cameras), "the grasp is outside the cube": outside}


def write_part(job: ExportJob, part: ExportPart) -> None:
    """Write the scenes of some episodes; their rows of the tables go aside."""
    names = cameras_of(job.episodes, job.settings)
    scenes = {place: job.folder / place / "scenes" for place in PLACES}
    for folder in scenes.values():
        folder.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[str]] = {place: [] for place in PLACES}
    for number, episode in part.episodes:
        scene = f"episode_{number:08d}"  # pandas would read a number without its zeros
        views = [view(job, episode.cameras[name]) for name in names]
        np.savez_compressed(
            scenes["raw"] / f"{scene}.npz",
            depth_imgs=np.stack([each.depth for each in views]),
            extrinsics=np.array([extrinsic(each.T_camera_cube) for each in views]),
        )
        grid = tsdf_grid(views, job.settings.size, RESOLUTION)
        np.savez_compressed(scenes["training"] / f"{scene}.npz", grid=grid[None])
        rows["raw"].append(row(scene, episode, job, 1.0))
        rows["training"].append(row(scene, episode, job, job.settings.voxel))
    for place, lines in rows.items():
        (job.aside / f"{place}-{part.number:08d}").write_text("".join(lines), encoding="ascii")


def view(job: ExportJob, frames: CameraFrames) -> DepthView:
    """Return what a camera saw before the attempt, with the intrinsics that all images have."""
    T_world_cube = transform(np.eye(3), cube_origin(job.episodes.config, job.settings))
    K = intrinsics(job.episodes, job.settings).matrix()
    return DepthView(
        depth=with_intrinsics(frames.depth[0], frames.intrinsics, K),
        K=K,
        T_camera_cube=product(inverse(frames.T_world_camera[0]), T_world_cube),
    )


def intrinsics(episodes: Selection, settings: VgnSettings) -> Intrinsics:
    """Return the intrinsics of all images: those of the first camera, as in the config."""
    config, first = episodes.config, cameras_of(episodes, settings)[0]
    fov_y = math.radians(config.cameras[first].fov_y_deg)
    return Intrinsics.from_fov(*config.resolution, fov_y, config.renderer)


def with_intrinsics(depth: NDArray[np.float32], K: Array, wanted: Array) -> NDArray[np.float32]:
    """Return the depth image (H, W) that other intrinsics would have seen; 0 means no depth.

    Each pixel has the value of the nearest one.
    """
    known = np.where(np.isfinite(depth), depth, np.float32(0.0))
    if np.array_equal(K, wanted):
        return known
    rows, columns = (
        np.rint((np.arange(n) - wanted[i, 2]) / wanted[i, i] * K[i, i] + K[i, 2])
        for i, n in ((1, depth.shape[0]), (0, depth.shape[1]))
    )
    inside = [(at >= 0) & (at < n) for at, n in zip((rows, columns), depth.shape, strict=True)]
    nearest = [
        np.where(ok, at, 0).astype(np.intp) for ok, at in zip(inside, (rows, columns), strict=True)
    ]
    moved = known.take(nearest[0], 0).take(nearest[1], 1)
    return np.where(inside[0][:, None] & inside[1], moved, np.float32(0.0))


def extrinsic(T_camera_cube: Array) -> list[float]:
    """Return a transform as VGN lists it: quat_xyzw, then the translation in metres."""
    pose = Pose.from_matrix(T_camera_cube)
    return [*pose.quat_xyzw, *pose.position]


def row(scene: str, episode: Episode, job: ExportJob, unit: float) -> str:
    """Return an episode's row of a table whose lengths are in units of ``unit`` metres."""
    columns, config = episode.columns, job.episodes.config
    quat = np.asarray(columns["grasp_quat_xyzw"])
    root = finger_root(columns["grasp_position"], quat, config, job.settings)
    lengths = np.append(root, held_width(episode, config)) / unit
    values = [*quat.tolist(), *lengths.tolist(), int(episode.success)]
    return ",".join([scene, *map(repr, values)]) + "\n"


def held_width(episode: Episode, config: FactoryConfig) -> float:
    """Return the width, metres, that VGN stores: between the pads after a success.

    After a failure it is that of the open gripper: src/vgn/simulation.py, execute_grasp.
    """
    widths = episode.streams["gripper_width"]
    is_held = episode.success and len(widths) and np.isfinite(widths[-1])
    return float(widths[-1]) if is_held else gripper_of(config.robot).max_width


def finish(job: ExportJob, parts: Sequence[None]) -> None:
    """Write the tables and setup.json."""
    for place, position in PLACES.items():
        with (job.folder / place / "grasps.csv").open("wb") as table:
            table.write(f"scene_id,qx,qy,qz,qw,{position},width,label\n".encode("ascii"))
            for path in sorted(job.aside.glob(f"{place}-*")):
                with path.open("rb") as rows:
                    shutil.copyfileobj(rows, table)
    write_json(job.folder / "raw" / "setup.json", setup(job.episodes, job.settings))


def setup(episodes: Selection, settings: VgnSettings) -> dict[str, Any]:
    """Return what VGN knows of the cube, the camera and the gripper."""
    camera = intrinsics(episodes, settings)
    return {
        "size": settings.size,
        "intrinsic": {
            "width": camera.width,
            "height": camera.height,
            "K": camera.matrix().ravel().tolist(),
        },
        "max_opening_width": gripper_of(episodes.config.robot).max_width,
        "finger_depth": settings.finger_depth,
    }


VGN = Exporter(
    name="vgn",
    description="grasps in a cube of TSDF voxels, and depth images, for VGN and GIGA",
    contents=ExportContents(
        written=("cameras/*/depth", "cameras/*/T_world_camera", "cameras/*/intrinsics"),
        left_out={
            "cameras/*/rgb": "the networks see depth only",
            "cameras/*/segmentation": "the networks see depth only",
            "cameras/*/visibility": "the networks see depth only",
            "streams/*": "the layout has no time series, but the width at the end of a success",
            **dict.fromkeys(("imu/*", *REAL_SERIES), "the layout has no time series"),
            "videos/*": "the layout has no videos",
        },
        treatment={
            "images": "depth before the attempt, of the cameras that do not move; if intrinsics"
            " differ, each pixel has the value of the nearest one under those of the first camera",
            "missing depth": "0 in depth_imgs",
            "position": "of the roots of the fingers, as in VGN: finger_depth behind their ends",
            "width": "between the pads after a success; of the open gripper after a failure",
            "other objects": "the label is about the target; VGN's also counts another object",
            "no grasp": "the episode is left out",
            REAL_ROWS: "left out if the grasp's pose was not measured, or a camera not calibrated",
            "grasp outside the cube": "the episode is left out; a larger size has room for it",
        },
    ),
    excludes=excludes,
    write_part=write_part,
    series=("streams/gripper_width",),
    finish=finish,
    parameters=VgnSettings,
)
