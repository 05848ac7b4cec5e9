"""Episodes with a known grasp in a scene that the overhead camera sees, without a simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from support.fake_episodes import JOINTS, make_episode, small_config
from support.views import brick, photograph

from grasp_factory.core.config.cameras import CAMERAS, CameraConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, matrix_to_quat_xyzw, rotation_about
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

PLACE = (0.60, 0.08, 0.03)
"""Where the known grasp is, metres: beyond the middle of the view and to its left."""
WIDTH = 0.07
"""Its opening, metres."""
DOWN = rotation_about((1.0, 0.0, 0.0), np.pi)
"""Orientation of a TCP that approaches straight down: its x is the world's, its y the world's -y"""
CONFIG = small_config(
    cameras={name: to_plain(CAMERAS[name].config) for name in ("front", "overhead")},
    resolution=(320, 240),
)


def grasp_at_yaw(yaw: float) -> Array:
    """Return the orientation of a grasp from above, turned about the vertical, (3, 3)."""
    return np.asarray(rotation_about((0.0, 0.0, 1.0), yaw) @ DOWN)


def seen_episode(
    yaw: float = 0.0,
    index: int = 0,
    cameras: Mapping[str, CameraConfig] = CONFIG.cameras,
    **changes: Any,
) -> Episode:
    """Return an episode with a brick under the known grasp, turned by ``yaw`` rad; a success."""
    episode = make_episode(CONFIG, index, n_steps=4)
    columns = {
        "grasp_position": np.array(PLACE),
        "grasp_quat_xyzw": matrix_to_quat_xyzw(grasp_at_yaw(yaw)),
        "grasp_width": WIDTH,
    }
    scene = brick(PLACE[0], PLACE[1], yaw)
    return dataclasses.replace(
        episode,
        outcome=Outcome.SUCCESS,
        columns={**episode.columns, **columns, **changes},
        cameras={
            name: _frames(episode.cameras[name], config, scene) for name, config in cameras.items()
        },
    )


def _frames(random: CameraFrames, camera: CameraConfig, scene: Any) -> CameraFrames:
    seen = photograph(camera, scene, CONFIG.resolution)
    return dataclasses.replace(
        random,
        depth=np.stack([seen.depth] * 2),
        segmentation=np.stack([seen.segmentation] * 2),
        intrinsics=seen.intrinsics,
        T_world_camera=np.stack([seen.T_world_camera] * 2),
    )


def store_of(path: Path, episodes: Sequence[Episode]) -> Dataset:
    """Write episodes of ``seen_episode`` to a store."""
    prepare_store(path, CONFIG, JOINTS, len(episodes), {})
    for block in range(0, len(episodes), CONFIG.block_size):
        rows = episodes[block : block + CONFIG.block_size]
        ZarrWriter(path).write_block(block // CONFIG.block_size, rows)
    return Dataset(path)
