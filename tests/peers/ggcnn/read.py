"""Reads images and grasps with GG-CNN's own dataset and its own rectangles."""

import sys

import numpy as np

np.int, np.float = int, float  # GG-CNN's names, which NumPy 1.24 removed

from utils.data.jacquard_data import JacquardDataset  # noqa: E402
from utils.dataset_processing.grasp import GraspRectangles  # noqa: E402
from utils.dataset_processing.image import DepthImage, Image  # noqa: E402

dataset = JacquardDataset(sys.argv[1], include_rgb=True)
arrays = {"count": np.array(len(dataset))}
for i in range(len(dataset)):
    place = dataset.get_jname(i).split("_")[0]
    (rectangle,) = GraspRectangles.load_from_jacquard_file(dataset.grasp_files[i])
    arrays[f"{place}/corners"] = rectangle.points
    arrays[f"{place}/grasp"] = np.array([rectangle.angle, rectangle.length, rectangle.width])
    arrays[f"{place}/depth"] = np.asarray(DepthImage.from_tiff(dataset.depth_files[i]).img)
    arrays[f"{place}/rgb"] = np.asarray(Image.from_file(dataset.rgb_files[i]).img)
    images, (quality, cos, sin, width), *_ = dataset[i]
    arrays[f"{place}/shape"] = np.array(images.shape)
    arrays[f"{place}/good"] = np.argwhere(quality[0].numpy() == 1.0)
    where = tuple(arrays[f"{place}/good"].mean(axis=0).astype(int))
    arrays[f"{place}/label"] = np.array([cos[0][where], sin[0][where], width[0][where]])
np.savez(sys.argv[2], **arrays)
