"""Compares what bop_toolkit reads with the store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import project
from grasp_factory.core.enums import Label
from grasp_factory.core.geometry import apply, inverse, pose_matrices
from grasp_factory.dataset.dataset import Dataset

FORMAT = "bop"
SETTINGS: Mapping[str, Any] = {}
GENERATE = ("--camera", "front", "--camera", "wrist")


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every image, camera, mask, pose and model."""
    numbers = {
        (row["object_id"], row["scale"]): row["number"]
        for row in json.loads((export / "objects.json").read_text())
    }
    seen = 0

    def equal(found: Any, expected: Any, within: float = 0.0) -> None:
        nonlocal seen
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=within)
        seen += np.asarray(expected).size

    for place, episode in enumerate(dataset):
        rest = episode.columns["object_rest_pose"]
        last = episode.streams["object_pose"][-1] if episode.n_steps else rest
        for camera, frames in episode.cameras.items():
            for k, time in enumerate(("before", "after")):
                key = f"{place}/{camera}/{time}"
                T_camera_world = inverse(frames.T_world_camera[k])
                equal(read[f"{key}/rgb"], frames.rgb[k])
                equal(read[f"{key}/depth"], 1000.0 * frames.depth[k], 0.051)
                equal(read[f"{key}/cam_K"], frames.intrinsics)
                equal(read[f"{key}/cam_R_w2c"], T_camera_world[:3, :3])
                equal(read[f"{key}/cam_t_w2c"][:, 0], 1000.0 * T_camera_world[:3, 3], 1e-9)
                for m, recipe in enumerate(episode.spec.objects):
                    mesh = dataset.object_mesh(recipe)
                    number = numbers[recipe.object_id, recipe.scale]
                    T = T_camera_world @ pose_matrices((rest, last)[k][m])
                    points = apply(T, mesh.vertices)
                    equal(read[f"{key}/{m}/mask"], frames.segmentation[k] == Label.TARGET + m)
                    equal(read[f"{key}/{m}/number"], number)
                    if (points[:, 2] > 0.01).all():
                        pixels = project(points, frames.intrinsics)
                        equal(read[f"{key}/{m}/pixels"], pixels, 0.02)
                        equal(*read[f"{key}/{m}/box_obj"], 1.0)
                    equal(*read[f"{key}/{m}/box_visib"])
                    equal(read[f"model/{number}/pts"], 1000.0 * (mesh.vertices - mesh.center), 1e-4)
                    equal(read[f"model/{number}/faces"], mesh.faces)
                    equal(read[f"model/{number}/diameter"], read[f"model/{number}/info"], 1e-3)
    return seen
