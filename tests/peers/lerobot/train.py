"""Trains LeRobot's ACT policy on an export for a short time: train.py EXPORT [STEPS].

It prints the mean loss of each tenth of the steps; the last one must be below half of the first.
Run it with the peer's Python, which `python -m peers.run lerobot` installs.
"""

import os
import sys
import tempfile
import time

os.environ |= {"HF_HUB_OFFLINE": "1", "HF_HOME": tempfile.mkdtemp()}

import cpu_torchvision  # noqa: F401
import numpy as np
import torch
from lerobot.configs.types import FeatureType
from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.utils import dataset_to_policy_features
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors

CHUNK, BATCH, TENTHS = 8, 8, 10
export, steps = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 200

torch.manual_seed(0)
meta = LeRobotDatasetMetadata("local/grasps", root=export)
features = dataset_to_policy_features(meta.features)
outputs = {name: ft for name, ft in features.items() if ft.type is FeatureType.ACTION}
config = ACTConfig(
    input_features={name: ft for name, ft in features.items() if name not in outputs},
    output_features=outputs,
    chunk_size=CHUNK,
    n_action_steps=CHUNK,
    pretrained_backbone_weights=None,
    dim_model=128,
    dim_feedforward=256,
    device="cpu",
)
print("inputs:", ", ".join(config.input_features))
policy = ACTPolicy(config)
policy.train()
before, _ = make_pre_post_processors(config, dataset_stats=meta.stats)
dataset = LeRobotDataset(
    "local/grasps",
    root=export,
    video_backend="pyav",
    delta_timestamps={"action": [k / meta.fps for k in range(CHUNK)]},
)
items = [dataset[i] for i in range(len(dataset))]  # few enough for the memory
optimizer = torch.optim.AdamW(policy.get_optim_params(), lr=1e-4)
losses, began = [], time.monotonic()
while len(losses) < steps:
    for batch in torch.utils.data.DataLoader(items, batch_size=BATCH, shuffle=True):
        loss, _ = policy(before(batch))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
        if len(losses) % (steps // TENTHS) == 0:
            print(f"{len(losses)} {np.mean(losses[-steps // TENTHS :]):.3f}", flush=True)
        if len(losses) == steps:
            break
first, *_, last = (float(np.mean(part)) for part in np.array_split(losses, TENTHS))
print(f"{steps} steps in {time.monotonic() - began:.0f} s: loss {first:.3f} to {last:.3f}")
sys.exit(0 if last < first / 2 else 1)
