"""An episode's series as the page draws them: groups of curves, poses, the arm, touch."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.browse.numbers import rounded
from grasp_factory.apps.browse.open_stores import OpenStore
from grasp_factory.core.elementary import LARGEST_ANGLE
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.plausible import check_joints, pad_size
from grasp_factory.dataset.row_codec import unpadded
from grasp_factory.errors import ConfigError, MissingLibraryError, StoreError
from grasp_factory.robots import ROBOTS, arm_chain
from grasp_factory.robots.kinematics import Chain
from grasp_factory.signals.plot_series import (
    CurveGroup,
    Series,
    curve_groups,
    in_shown_unit,
    phase_spans,
    touch_was_measured,
)
from grasp_factory.signals.touch import taxel_image
from grasp_factory.writers.zarr.header import read_array

TAXELS = (12, 10)
"""Rows along a pad's height, columns along its width."""
_STREAMS = (
    *("timestamp", "phase", "joint_positions", "joint_velocities", "joint_torques"),
    *("gripper_width", "gripper_width_target", "gripper_force", "wrist_wrench"),
    *("tcp_pose", "object_pose"),
)
_TACTILE = ("tactile_position", "tactile_force", "tactile_normal", "tactile_wrench")


def episode_series(opened: OpenStore, row: int) -> dict[str, Any]:
    """Return all records of a committed episode's series as plain values.

    Raises:
        StoreError: if they are damaged.
    """
    dataset = opened.dataset
    streams = dataset.series(row, *_there(opened, *_STREAMS, *_TACTILE))
    imu = _unpadded(opened, row, "n_imu", "imu", "timestamp", "specific_force", "angular_velocity")
    video = _unpadded(opened, row, "n_video", "videos", "timestamp")
    com, rest = dataset.value(row, "object_com")[0], float(dataset.value(row, "rest_height"))
    return {
        "time": rounded(streams["timestamp"]),
        "imu_time": rounded(imu.get("timestamp", ())),
        "video_time": rounded(video.get("timestamp", ())),
        "phases": to_plain(phase_spans(streams)),
        "groups": [_group(in_shown_unit(g)) for g in curve_groups(streams, imu, com, rest)],
        "poses": {
            "tcp": rounded(streams["tcp_pose"]),
            "objects": rounded(np.swapaxes(streams["object_pose"], 0, 1)),
            "gripper_width": rounded(streams["gripper_width"]),
        },
        "links": _links(opened, row, streams),
        "tactile": _touch(opened, streams),
    }


def tactile(opened: OpenStore, row: int) -> bytes:
    """Return the normal force on each taxel over time, float32 (T, 2, rows, columns) newtons.

    Raises:
        StoreError: if it is damaged, or the store does not contain the size of the pads.
    """
    taxels = _taxels(opened, opened.dataset.series(row, *_TACTILE))
    if taxels is None:
        raise StoreError(f"{opened.dataset.path}: its attribute robot has no pad_size of a pad")
    return taxels.astype("<f4").tobytes()


def _touch(opened: OpenStore, streams: Series) -> dict[str, Any] | None:
    taxels = _taxels(opened, streams)
    if taxels is None:
        return None
    most = float(taxels.max(initial=0.0))
    return {"rows": TAXELS[0], "columns": TAXELS[1], "max": most}


def _taxels(opened: OpenStore, streams: Series) -> NDArray[np.float64] | None:
    size = pad_size(opened.dataset.attributes)
    if size is None or not touch_was_measured(streams):
        return None
    return taxel_image(streams, size, *TAXELS)


def _there(opened: OpenStore, *streams: str) -> list[str]:
    """Return the streams that the store has: a store of an older version lacks some."""
    return [name for name in streams if f"streams/{name}" in opened.arrays]


def _unpadded(
    opened: OpenStore, row: int, length: str, group: str, *names: str
) -> dict[str, NDArray[Any]]:
    """Return an episode's values of those series of a group that the store has."""
    there = [name for name in names if f"{group}/{name}" in opened.arrays]
    if not there:
        return {}
    count = opened.dataset.value(row, length)
    stored = {name: read_array(opened.arrays[f"{group}/{name}"], row) for name in there}
    return {n: unpadded(values, count, row, f"episodes/{length}") for n, values in stored.items()}


def _group(group: CurveGroup) -> dict[str, Any]:
    series = [
        {"name": name, "values": values}
        for name, values in zip(group.names, rounded(group.values.T), strict=True)
    ]
    told = {name: getattr(group, name) for name in ("key", "title", "units", "clock")}
    return told | {"series": series}


def _links(opened: OpenStore, row: int, streams: Series) -> dict[str, Any]:
    """Return world positions of the arm's joints and TCP over time; none for an unknown robot.

    Some robot models come with PyBullet. If one is missing because PyBullet is not installed, a
    note says so, and if the arm of a real episode need not be the store's robot.

    Raises:
        StoreError: if the positions are of another number of joints than the robot has.
    """
    dataset, joint_positions = opened.dataset, streams["joint_positions"]
    unknown: dict[str, Any] = {"names": [], "positions": []}
    if len(joint_positions) and np.isnan(streams["tcp_pose"]).all():
        return unknown | {"note": "The arm is not drawn: its kinematics are not known."}
    try:
        chains = _chains(dataset.config.robot)
    except MissingLibraryError:
        why = "its model comes with PyBullet, which is not installed where this page comes from"
        return unknown | {"note": f"The arm is not drawn: {why}."}
    if not chains:
        return unknown
    try:
        check_joints(joint_positions, len(chains[-1].joint_names))
    except ConfigError as error:
        raise StoreError(f"{dataset.path}: episode {row} is damaged: {error}") from None
    q = np.asarray(joint_positions, np.float64)
    q = np.where(np.abs(q) <= LARGEST_ANGLE, q, np.nan)
    places = [chain.fk(q[:, : len(chain.joint_names)])[:, :3, 3] for chain in chains]
    names = ["base", *chains[-1].joint_names, "tcp"]
    return {
        "names": names,
        "positions": rounded(np.stack([np.zeros((len(q), 3)), *places], axis=1)),
    }


@lru_cache
def _chains(robot: str) -> tuple[Chain, ...]:
    """Return the chain to each joint's own frame, and last the chain to the TCP."""
    if robot not in ROBOTS:
        return ()
    whole = arm_chain(ROBOTS[robot])
    parts = [
        dataclasses.replace(
            whole,
            joint_names=whole.joint_names[:count],
            T_previous_joint=whole.T_previous_joint[:count],
            T_joint_tip=np.eye(4),
        )
        for count in range(1, len(whole.joint_names) + 1)
    ]
    return (*parts, whole)
