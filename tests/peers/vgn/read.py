"""Reads both folders with VGN's own code; Open3D makes the grids again from the depth images."""

import sys
from pathlib import Path

import numpy as np
from vgn.dataset import Dataset
from vgn.io import read_df, read_grasp, read_sensor_data, read_setup
from vgn.perception import create_tsdf

raw, training = (Path(sys.argv[1]) / name for name in ("raw", "training"))
size, intrinsic, max_opening_width, finger_depth = read_setup(raw)
arrays = {"setup": np.array([size, max_opening_width, finger_depth]), "K": intrinsic.K}
assert np.isclose(size, 6.0 * finger_depth)  # as scripts/construct_dataset.py
table, dataset = read_df(raw), Dataset(training)
assert len(table) == len(dataset)
for i in range(len(dataset)):
    scene, grasp, label = read_grasp(table, i)
    place = int(scene.removeprefix("episode_"))
    depth, extrinsics = read_sensor_data(raw, scene)
    arrays[f"{place}/depth"], arrays[f"{place}/extrinsics"] = depth, extrinsics
    arrays[f"{place}/pose"] = grasp.pose.as_matrix()
    arrays[f"{place}/width"], arrays[f"{place}/label"] = np.array(grasp.width), np.array(label)
    # The ends of the fingers, as src/vgn/vis.py draws them.
    ends = [[0.0, side * grasp.width / 2.0, finger_depth] for side in (-1, 1)]
    arrays[f"{place}/ends"] = np.array([grasp.pose.transform_point(end) for end in ends])
    grid, (target, rotations, width), index = dataset[i]
    arrays[f"{place}/grid"], arrays[f"{place}/target"] = grid, np.array(target)
    arrays[f"{place}/rotations"], arrays[f"{place}/voxels"] = rotations, np.array(width)
    arrays[f"{place}/index"] = index
    arrays[f"{place}/open3d"] = create_tsdf(size, 40, depth, intrinsic, extrinsics).get_grid()
np.savez(sys.argv[2], **arrays)
