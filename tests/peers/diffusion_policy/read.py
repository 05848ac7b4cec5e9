"""Reads a replay buffer with Diffusion Policy's ReplayBuffer and SequenceSampler."""

import sys
from pathlib import Path

import numpy as np
from diffusion_policy.common.replay_buffer import ReplayBuffer
from diffusion_policy.common.sampler import SequenceSampler

buffer = ReplayBuffer.copy_from_path(str(Path(sys.argv[1]) / "replay_buffer.zarr.zip"))
arrays = {f"meta/{name}": values for name, values in buffer.meta.items()}
for place in range(buffer.n_episodes):
    mask = np.arange(buffer.n_episodes) == place
    sampler = SequenceSampler(buffer, sequence_length=2, pad_after=1, episode_mask=mask)
    samples = [sampler.sample_sequence(k) for k in range(len(sampler))]
    for name in buffer.keys():
        arrays[f"{place}/{name}"] = np.stack([sample[name][0] for sample in samples])
        arrays[f"{place}/{name}/next"] = np.stack([sample[name][1] for sample in samples])
np.savez(sys.argv[2], **arrays)
