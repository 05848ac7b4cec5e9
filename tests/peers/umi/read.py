"""Reads a replay buffer as UMI's UmiDataset does, with its ReplayBuffer and SequenceSampler."""

import sys
from pathlib import Path

import numpy as np
import zarr
from diffusion_policy.common.replay_buffer import ReplayBuffer
from diffusion_policy.common.sampler import SequenceSampler

with zarr.ZipStore(Path(sys.argv[1]) / "replay_buffer.zarr.zip", mode="r") as store:
    buffer = ReplayBuffer.copy_from_store(src_store=store, store=zarr.MemoryStore())
images = [name for name in buffer.keys() if name.endswith("_rgb")]
low_dim = [name for name in buffer.keys() if name.startswith("robot0_")]
keys = [*images, *low_dim, "action"]
shapes = {"obs": {name: {"shape": buffer[name].shape[1:]} for name in (*images, *low_dim)}}
arrays = {f"meta/{name}": values[:] for name, values in buffer.meta.items()}
for place in range(buffer.n_episodes):
    sampler = SequenceSampler(
        shape_meta=shapes,
        replay_buffer=buffer,
        rgb_keys=images,
        lowdim_keys=low_dim,
        key_horizon=dict.fromkeys(keys, 1),
        key_latency_steps=dict.fromkeys(keys, 0),
        key_down_sample_steps=dict.fromkeys(keys, 1),
        episode_mask=np.arange(buffer.n_episodes) == place,
    )
    samples = [sampler.sample_sequence(k) for k in range(len(sampler))]
    for name in keys:
        arrays[f"{place}/{name}"] = np.stack([sample[name][0] for sample in samples])
np.savez(sys.argv[2], **arrays)
