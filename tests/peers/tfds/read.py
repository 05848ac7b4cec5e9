"""Reads a data set with TensorFlow Datasets."""

import sys

import numpy as np
import tensorflow_datasets as tfds


def flat(tree, path=""):
    """Yield the names and values of nested dicts."""
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from flat(value, f"{path}{name}/")
        else:
            yield f"{path}{name}", value


builder = tfds.builder_from_directory(sys.argv[1])
arrays = {}
for split, info in builder.info.splits.items():
    episodes = list(tfds.as_numpy(builder.as_dataset(split)))
    assert len(episodes) == info.num_examples
    for episode in episodes:
        place = episode["episode_metadata"]["episode"]
        arrays[f"{place}/split"] = np.array(split)
        for name, value in flat(episode["episode_metadata"]):
            arrays[f"{place}/episode_metadata/{name}"] = value
        steps = [dict(flat(step)) for step in episode["steps"]]
        for name in steps[0]:
            arrays[f"{place}/steps/{name}"] = np.stack([step[name] for step in steps])
texts = {name: value for name, value in arrays.items() if np.asarray(value).dtype.kind in "OS"}
for name, value in texts.items():
    arrays[name] = np.vectorize(bytes.decode, otypes=[str])(value)
np.savez(sys.argv[2], **arrays)
