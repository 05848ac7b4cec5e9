"""The format `webdataset`, read with tarfile; `bin/check-exports webdataset` reads with its own."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.stored import varied

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError


def samples(out: Path) -> dict[str, dict[str, bytes]]:
    """Return the files of each sample; those of a sample follow each other."""
    found: dict[str, dict[str, bytes]] = {}
    for shard in sorted(out.glob("*.tar")):
        with tarfile.open(shard) as tar:
            for member in tar:
                key, _, kind = member.name.partition(".")
                assert key in found or not found or key > max(found)
                file = tar.extractfile(member)
                assert file
                assert member.mtime == 0
                found.setdefault(key, {})[kind] = file.read()
    return found


def test_every_array_is_read_back(tmp_path: Path) -> None:
    dataset = Dataset(varied())
    out = dataset.export("webdataset", tmp_path / "out", episodes_per_shard=1).path
    assert len(list(out.glob("*.tar"))) == len(dataset.committed)
    found = samples(out)
    assert list(found) == [f"{place:08d}" for place in range(len(dataset.committed))]
    for episode, files in zip(dataset, found.values(), strict=True):
        assert json.loads(files.pop("json"))["outcome"] == episode.outcome.name.lower()
        assert files.pop("cls") == str(int(episode.success)).encode()
        for path, values in episode.contents().items():
            group, _, name = path.partition("/")
            if group == "episodes":
                continue
            key = f"{group.removesuffix('s')}_{name}".replace("/", "_").lower()
            if f"{key}.npy" in files:
                read = np.load(io.BytesIO(files.pop(f"{key}.npy")))
                np.testing.assert_array_equal(read, values, strict=True)
                continue
            for image, time in zip(values, ("before", "after"), strict=True):
                data = np.frombuffer(files.pop(f"{key}_{time}.png"), np.uint8)
                pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
                np.testing.assert_array_equal(
                    pixels[..., ::-1] if image.ndim == 3 else pixels, image
                )
        assert files == {}


@pytest.mark.parametrize("size", [-1, 10**9])
def test_a_number_of_episodes_of_a_shard_is_checked(tmp_path: Path, size: int) -> None:
    with pytest.raises(ConfigError, match=r"episodes_per_shard: got .*, valid: 0 to 1000000"):
        Dataset(varied()).export("webdataset", tmp_path / "out", episodes_per_shard=size)
