"""Reads a file with robomimic's SequenceDataset, and runs its script get_dataset_info."""

import runpy
import sys
from pathlib import Path

import h5py
import numpy as np
import robomimic
from robomimic.utils import obs_utils
from robomimic.utils.dataset import SequenceDataset

path = str(Path(sys.argv[1]) / "demo.hdf5")
script = Path(robomimic.__file__).parent / "scripts/get_dataset_info.py"
sys.argv[1:], out = ["--dataset", path, "--verbose"], sys.argv[2]
runpy.run_path(str(script), run_name="__main__")

with h5py.File(path) as file:
    keys = sorted(next(iter(file["data"].values()))["obs"])
images = [key for key in keys if key.endswith("_image")]
low_dim = [key for key in keys if key not in images]
obs_utils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": low_dim, "rgb": images}})
arrays = {}
for name in (None, "train", "valid", "test", "success"):
    dataset = SequenceDataset(
        hdf5_path=path,
        obs_keys=keys,
        dataset_keys=("actions", "actions_absolute", "rewards", "dones"),
        filter_by_attribute=name,
        seq_length=2,
        hdf5_cache_mode=None,
    )
    arrays[f"mask/{name}"] = np.array(dataset.demos, dtype=np.str_)
    if name:
        continue
    for index in range(len(dataset)):
        demo = dataset._index_to_demo_id[index]
        step = index - dataset._demo_id_to_start_indices[demo]
        sample = dataset[index]
        for key in ("actions", "actions_absolute", "rewards", "dones"):
            arrays[f"{demo}/{step}/{key}"] = sample[key][0]
        for group in ("obs", "next_obs"):
            for key, values in sample[group].items():
                arrays[f"{demo}/{step}/{group}/{key}"] = values[0]
np.savez(out, **arrays)
