"""Learning from a store half imported, half simulated: no leak, and only what was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import JOINTS, make_episode, small_config
from support.grasp_sessions import K, grasps_of

from grasp_factory.apps.learning.comparison import Course, compare, read_splits
from grasp_factory.apps.learning.examples import ExampleReader
from grasp_factory.apps.learning.progress_callback import unwatched
from grasp_factory.apps.learning.training import TrainSettings
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.importing_store import import_session
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.core.serialization import from_plain
from grasp_factory.core.splits import SPLITS, split_of
from grasp_factory.curation.merge import merge
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.signals.grasp_crop import CropShape
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytestmark = pytest.mark.slow

N = 12
"""Simulated episodes, and about as many real ones."""
CROP = CropShape(size=24)
POSE = np.array([[0, -1, 0, 0.5], [-1, 0, 0, 0], [0, 0, -1, 0.8], [0, 0, 0, 1.0]])
"""Of a camera that looks straight down."""


def objects() -> list[str]:
    """Return names of real objects: two of each split."""
    names = [f"cup_{k}" for k in range(200)]
    return [n for s in SPLITS for n in [n for n in names if split_of(f"real/{n}") == s][:2]]


def simulated(row: Episode, index: int) -> Episode:
    """Return an episode with a grasp that a camera sees; each split has an object."""
    name, split = f"procedural/box/{index // 4}", SPLITS[index // 4]
    target = replace(row.spec.objects[0], object_id=name, split=split)
    frames = row.cameras["front"]
    seen = replace(frames, intrinsics=K, T_world_camera=np.stack([POSE, POSE]))
    grasp = {
        "grasp_position": np.array([0.5, 0.0, 0.1]),
        "grasp_quat_xyzw": np.array([1.0, 0.0, 0.0, 0.0]),
        "grasp_width": 0.08,
    }
    return replace(
        row,
        spec=replace(row.spec, objects=(target,)),
        outcome=Outcome.SUCCESS if index % 2 else Outcome.NO_CONTACT,
        columns={**row.columns, **grasp, "object_id": name, "object_ids": np.array([name]),
                 "split": split},
        cameras={"front": seen},
    )  # fmt: skip


@pytest.fixture(scope="module")
def halves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a session ``ses`` and a simulated store ``sim.zarr`` in a folder."""
    folder = tmp_path_factory.mktemp("halves")
    config = small_config(video_hz=0)
    sim = folder / "sim.zarr"
    prepare_store(sim, config, JOINTS, N, {"robot": ROBOTS[config.robot].facts()})
    for block in range(N // config.block_size):
        rows = [simulated(make_episode(config, i), i) for i in range(4 * block, 4 * block + 4)]
        ZarrWriter(sim).write_block(block, rows)
    grasps_of(objects(), folder / "ses")
    return folder


@pytest.fixture(scope="module", params=["calibrated", "not calibrated"])
def both(request: pytest.FixtureRequest, halves: Path) -> Dataset:
    name = request.param
    sim, real, out = (halves / part for part in ("sim.zarr", f"real {name}.zarr", f"{name}.zarr"))
    poses = {"front": POSE.tolist()} if name == "calibrated" else {}
    settings = from_plain(ImportSettings, {"kinematics": True, "T_world_camera": poses})
    import_session(halves / "ses", real, settings, base=Dataset(sim).config)
    merge([sim, real], out)
    return Dataset(out)


def test_both_halves_train_together_and_no_object_leaks(both: Dataset) -> None:
    is_real = both.column("source") == 1
    assert (is_real[both.committed].sum(), (~is_real).sum()) == (N, N)
    course = Course(kinds=["vision"], crop=CROP, settings=TrainSettings(epochs=2))
    splits = read_splits(both, both, ["vision"], course, unwatched)
    parts = {"train": splits.train, "val": splits.val, "test": splits.test}
    for name, part in parts.items():
        assert set(both.column("split")[part.rows].tolist()) == {name}
        assert all(np.isfinite(values).all() for values in part.inputs.values())
        others = [set(o.object_id.tolist()) for n, o in parts.items() if n != name]
        assert not set(part.object_id.tolist()) & set().union(*others)
        calibrated = both.path.stem == "calibrated"
        assert is_real[part.rows].any() == calibrated
    if both.path.stem == "calibrated":
        found = compare(both, both, course)
        scores = found.populations["attempts"].probabilities["vision"]
        assert np.isfinite(scores).all()


def test_touch_that_was_not_measured_is_not_learned_from(both: Dataset) -> None:
    real = np.flatnonzero(both.column("source") == 1)
    with pytest.raises(UsageError, match="no episodes with a grasp to learn from"):
        ExampleReader(dataset=both, uses=["touch"]).usable(real)
