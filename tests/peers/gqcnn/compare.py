"""Compares what autolab_core reads with the store."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import deproject_pixels
from grasp_factory.core.geometry import apply, quat_xyzw_to_matrix
from grasp_factory.dataset.dataset import Dataset

FORMAT = "gqcnn"
SETTINGS = {"episodes_per_shard": 4}
GENERATE = ("--camera", "overhead", "--policy", "top_down")
SIDE = 32


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare each pose back in the world, each crop's values and the split."""
    episodes = [episode for episode in dataset if np.isfinite(episode.columns["grasp_width"])]
    assert int(read["count"]) == len(episodes) > SETTINGS["episodes_per_shard"]
    seen = 0
    for k, episode in enumerate(episodes):
        pose, image = read[f"{k}/grasps"].astype(np.float64), read[f"{k}/tf_depth_ims"]
        assert image.shape == (SIDE, SIDE, 1)
        assert float(read[f"{k}/grasp_metrics"]) == episode.success
        frames, columns = episode.cameras["overhead"], episode.columns
        row, column, depth, angle, down, right, width = pose
        at = deproject_pixels(
            np.array([column]), np.array([row]), np.array([depth]), frames.intrinsics
        )
        tcp = apply(frames.T_world_camera[0], at)[0]
        np.testing.assert_allclose(tcp, columns["grasp_position"], atol=1e-5)
        closing = frames.T_world_camera[0, :3, :2] @ [math.cos(angle), math.sin(angle)]
        R = quat_xyzw_to_matrix(columns["grasp_quat_xyzw"])
        assert abs(abs(closing @ R[:, 1]) - 1.0) < 1e-5
        assert abs(width * depth / frames.intrinsics[0, 0] - columns["grasp_width"]) < 1e-5
        centre = frames.intrinsics[(1, 0), 2]
        np.testing.assert_allclose([row - down, column - right], centre, atol=1e-4)
        assert np.isin(image, np.append(frames.depth[0], np.float32(0.0))).all()
        seen += image.size + pose.size + 1
    for name in ("train", "val"):
        wanted = [k for k, episode in enumerate(episodes) if episode.columns["split"] == name]
        assert read[name].tolist() == wanted
    return seen
