"""The format `article`, read as the tutorial's readers do: np.load, cv2.imread."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from support.stored import old_store, varied

from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UnknownNameError
from grasp_factory.writers.exporters.article import label


@pytest.mark.parametrize("camera", ["front", "wrist"])
def test_every_value_is_read_back(tmp_path: Path, camera: str) -> None:
    dataset = Dataset(varied())
    out = dataset.export("article", tmp_path / "out", camera=camera).path
    for i, episode in enumerate(dataset):
        frames = episode.cameras[camera]
        for k, time in enumerate(("before", "after")):
            bgr = cv2.imread(str(out / f"rgb/{time}_{i}.png"))
            np.testing.assert_array_equal(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), frames.rgb[k])
            depth = np.load(out / f"depth/depth_{time}_{i}.npy")
            np.testing.assert_array_equal(depth, frames.depth[k])
            seg = np.load(out / f"seg/seg_{time}_{i}.npy")
            np.testing.assert_array_equal(seg, frames.segmentation[k])
        found = np.load(out / f"label_{i}.npy")
        check_label(found, i, episode)
    assert len(list(out.rglob("*.npy"))) == 5 * len(dataset.committed)


def check_label(found: np.ndarray, i: int, episode: Episode) -> None:
    assert found.shape == ()
    assert (int(found["index"]), bool(found["success"])) == (i, episode.success)
    assert found["object_id"] == episode.columns["object_id"]
    np.testing.assert_array_equal(found["grasp_position"], episode.columns["grasp_position"])
    np.testing.assert_array_equal(found["grasp_orientation"], episode.columns["grasp_quat_xyzw"])


@pytest.mark.parametrize("name", ["", "a/../b", "\U0001f600 mug", "x" * 300])
def test_any_object_id_is_in_the_label_and_in_no_file_name(name: str) -> None:
    episode = Dataset(varied())[0]
    episode.columns["object_id"] = name  # type: ignore[index]
    found = label(7, episode)
    assert found["object_id"] == name
    assert found["index"] == 7


def test_an_unknown_camera_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown camera 'side' \(valid: front, wrist\)"):
        Dataset(varied()).export("article", tmp_path / "out", camera="side")
    assert list(tmp_path.iterdir()) == []


def test_a_store_of_an_older_version_is_exported(tmp_path: Path) -> None:
    dataset = Dataset(old_store(tmp_path))
    found = dataset.export("article", tmp_path / "out")
    assert found.episodes == len(dataset.committed) == 3
