"""Logging the recorded motion of the robot's joints and of the objects.

If PyBullet is not installed, robots and objects whose shapes come with PyBullet are left out.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import rerun as rr

from grasp_factory.apps.playback.track import Track
from grasp_factory.apps.rerun.clock import poses, seconds
from grasp_factory.apps.rerun.robot_urdf import log_urdf
from grasp_factory.core.enums import Label, label_names
from grasp_factory.core.episode import Episode, ObjectSpec
from grasp_factory.core.geometry import Array
from grasp_factory.core.package_files import folder_of
from grasp_factory.errors import GraspFactoryWarning, MissingLibraryError, lookup
from grasp_factory.objects import UrdfFile, find_set, visual_parts
from grasp_factory.robots import ROBOTS, RobotModel

ROBOT = "robot"
OBJECTS = "world/objects"


def has_motion(episode: Episode) -> bool:
    """Return whether the robot's motion is known: of a real one, if its kinematics are."""
    streams = episode.streams
    names = ("joint_positions", "gripper_width", "tcp_pose")
    return not episode.is_real or all(np.isfinite(streams[name]).all() for name in names)


def log_robot(recording: rr.RecordingStream, robot: str, track: Track, folder: Path) -> None:
    """Log a robot from its URDF, with the motion of its joints."""
    model = lookup(ROBOTS, "robot", robot)
    with _left_out_where_missing(f"robot {robot}"):
        _log_joints(recording, model, track, folder)


def _log_joints(
    recording: rr.RecordingStream, model: RobotModel, track: Track, folder: Path
) -> None:
    tree = log_urdf(recording, model.path(), folder, ROBOT)
    root = rr.Transform3D(parent_frame="tf#/", child_frame=f"{ROBOT}/{model.base_link}")
    recording.log(f"{ROBOT}/base", root, static=True)
    half = track.gripper_width / 2.0
    values: dict[str, Array] = dict(zip(model.finger_joints, (half, half), strict=True))
    values |= dict(zip(model.arm_joints, track.joint_positions.T, strict=True))
    for name, positions in values.items():
        joint = tree.get_joint_by_name(name)
        assert joint is not None
        columns = joint.compute_transform_columns(positions.tolist(), clamp=False)
        recording.send_columns(f"{ROBOT}/joints/{name}", [seconds(track.timestamp)], columns)


def log_objects(
    recording: rr.RecordingStream, episode: Episode, track: Track, folder: Path
) -> None:
    """Log every object's shape and motion, under its name in the segmentation."""
    words = label_names(len(episode.spec.objects))[Label.TARGET :]
    for m, (word, recipe) in enumerate(zip(words, episode.spec.objects, strict=True)):
        entity = f"{OBJECTS}/{word}"
        recording.send_columns(entity, [seconds(track.timestamp)], poses(track.objects[:, m]))
        with _left_out_where_missing(f"shape of {word} {recipe.object_id}"):
            _log_shape(recording, recipe, word, folder)


@contextlib.contextmanager
def _left_out_where_missing(what: str) -> Iterator[None]:
    try:
        yield
    except MissingLibraryError:
        why = "its model comes with PyBullet, which is not installed"
        warnings.warn(f"{what} is left out: {why}", GraspFactoryWarning, stacklevel=4)


def _log_shape(recording: rr.RecordingStream, recipe: ObjectSpec, word: str, folder: Path) -> None:
    model = find_set(recipe.object_set, recipe.folder_sha256).model(recipe.object_id)
    color, entity = recipe.color or model.color, f"{OBJECTS}/{word}"
    if isinstance(model.body, UrdfFile):
        tree = log_urdf(
            recording, folder_of("pybullet_data") / model.body.path, folder, word, color
        )
        placed = rr.Transform3D(
            scale=model.body.scale * recipe.scale,
            parent_frame=f"tf#/{entity}",
            child_frame=f"{word}/{tree.root_link().name}",
        )
        recording.log(f"{word}/base", placed, static=True)
        return
    paint = None if color is None else [round(255 * value) for value in color]
    for i, part in enumerate(visual_parts(model.body)):
        placed = rr.Transform3D(
            translation=[recipe.scale * v for v in part.pose.position],
            quaternion=rr.Quaternion(xyzw=part.pose.quat_xyzw),
            scale=[recipe.scale * v for v in part.size],
        )
        mesh = rr.Asset3D(path=part.shape, albedo_factor=paint)
        recording.log(f"{entity}/part_{i}", placed, mesh, static=True)
