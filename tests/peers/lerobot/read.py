"""Reads a dataset with LeRobot's own loader: item by item, by episode, in time and in batches."""

import os
import sys
import tempfile

os.environ |= {"HF_HUB_OFFLINE": "1", "HF_HOME": tempfile.mkdtemp()}

import cpu_torchvision  # noqa: F401
import numpy as np
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

export, out = sys.argv[1:]


def dataset(**more):
    return LeRobotDataset("local/grasps", root=export, video_backend="pyav", **more)


whole = dataset()
frames = [whole[i] for i in range(len(whole))]
exact = whole.hf_dataset.with_format("arrow")[:]
columns = {name: exact[name].to_pylist() for name in exact.column_names}
arrays = {"fps": whole.fps, "robot_type": whole.meta.robot_type}
for k in range(whole.num_episodes):
    row = whole.meta.episodes[k]
    own = slice(row["dataset_from_index"], row["dataset_to_index"])
    arrays[f"{k}/task"] = np.array([frame["task"] for frame in frames[own]])
    arrays[f"{k}/success"] = row["success"]
    for name in frames[0]:
        if name == "task":
            continue
        arrays[f"{k}/{name}"] = np.stack([np.asarray(frame[name]) for frame in frames[own]])
        if name in columns and whole.features[name]["dtype"] != "image":
            values = np.array(columns[name][own], whole.features[name]["dtype"])
            arrays[f"{k}/exact/{name}"] = values

last = whole.num_episodes - 1
near = dataset(episodes=[last], delta_timestamps={"action": [0.0, 1 / whole.fps]})
arrays["pairs"] = np.stack([near[i]["action"] for i in range(len(near))])
batches = torch.utils.data.DataLoader(whole, batch_size=7)
arrays["batched"] = np.concatenate([batch["observation.state"] for batch in batches])
for name, stats in whole.meta.stats.items():
    for key, value in stats.items():
        arrays[f"stats/{name}/{key}"] = value
np.savez(out, **arrays)
