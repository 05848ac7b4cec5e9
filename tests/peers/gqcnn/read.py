"""Reads the tensors with autolab_core's TensorDataset.

GQ-CNN itself wants TensorFlow 1; it reads its training data with this class.
"""

import sys

import numpy as np
from autolab_core import TensorDataset

dataset = TensorDataset.open(sys.argv[1])
train, val, _ = dataset.split("object_wise")
arrays = {"train": train, "val": val, "count": np.array(dataset.num_datapoints)}
for k in range(dataset.num_datapoints):
    for name, values in dataset[k].items():
        arrays[f"{k}/{name}"] = np.asarray(values)
np.savez(sys.argv[2], **arrays)
