"""Reads tar files with webdataset's own pipeline."""

import sys
from pathlib import Path

import numpy as np
import webdataset

arrays = {}
shards = sorted(str(path) for path in Path(sys.argv[1]).glob("*.tar"))
for sample in webdataset.WebDataset(shards, shardshuffle=False).decode("rgb8"):
    place = int(sample["__key__"])
    for key, value in sample.items():
        if key.endswith((".png", ".npy", "cls")):
            arrays[f"{place}/{key}"] = np.asarray(value)
    arrays[f"{place}/outcome"] = np.asarray(sample["json"]["outcome"])
np.savez(sys.argv[2], **arrays)
