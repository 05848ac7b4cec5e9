"""No network is shown its own label: nothing that is known only after the attempt is an input."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numpy.typing import NDArray

from grasp_factory.apps.learning.examples import ExampleReader, Examples
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Phase
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate
from grasp_factory.policies.networks import KINDS, TOUCH

pytestmark = pytest.mark.slow

N = 4
KNOWN_BEFORE = {
    *("episodes/status", "episodes/spec", "episodes/seed", "episodes/index"),
    *("episodes/grasp_position", "episodes/grasp_quat_xyzw", "episodes/grasp_width"),
}
"""Columns of the plan, the recipe and the bookkeeping; every other one is overwritten."""
CLOCK = {"streams/timestamp", "streams/phase"}
"""What says when the lift began."""
each_kind = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store with two cameras, one of which moves with the hand."""
    config = FactoryConfig.from_plain(
        {
            "resolution": [96, 72],
            "block_size": 2,
            "cameras": {name: to_plain(CAMERAS[name].config) for name in ("front", "wrist")},
            "video_hz": 10,
        }
    )
    path = tmp_path_factory.mktemp("leaks") / "store"
    generate(config, N, path, workers=1)
    return path


@pytest.fixture
def store(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "store"))


def read(path: Path, kind: str, rows: NDArray[np.int64] | None = None) -> Examples:
    reader = ExampleReader(dataset=Dataset(path), uses=KINDS[kind])
    return reader.read(reader.usable() if rows is None else rows)


def garbage(values: NDArray[Any], rng: np.random.Generator) -> NDArray[Any]:
    """Return other values of the same shape and type."""
    match values.dtype.kind:
        case "T" | "O" | "U":
            return np.full(values.shape, "garbage", dtype=values.dtype)
        case "b":
            return ~values
        case "f":
            return rng.normal(0.0, 100.0, values.shape).astype(values.dtype)
        case _:
            return (values + rng.integers(1, 100, values.shape)).astype(values.dtype)


def overwrite_what_came_later(path: Path) -> list[str]:
    """Overwrite all of a store's arrays but for what was known when the lift began."""
    rng = np.random.default_rng(0)
    phase = np.asarray(zarr.open_group(path, mode="r")["streams/phase"][:])
    n_steps = Dataset(path).column("n_steps")
    changed = []
    for name, array in Dataset(path).arrays().items():
        writable: Any = zarr.open_group(path, mode="r+")[name]
        values = np.asarray(array[:])
        before = values.copy()
        group, leaf = name.split("/")[0], name.split("/")[-1]
        if name in KNOWN_BEFORE or leaf == "intrinsics":
            continue
        if name == "episodes/n_steps":
            values = np.array([lift_of(row, n) + 1 for row, n in zip(phase, n_steps, strict=True)])
        elif group == "cameras" and leaf in {"rgb", "depth", "segmentation", "T_world_camera"}:
            values[:, 1] = garbage(values[:, 1], rng)
        elif group == "streams":
            for row, (codes, n) in enumerate(zip(phase, n_steps, strict=True)):
                first = lift_of(codes, n) + (name in CLOCK)
                values[row, first:] = garbage(values[row, first:], rng)
            if name == "streams/phase":
                values = np.where(values == phase, phase, Phase.SHAKE).astype(values.dtype)
        else:
            values = garbage(values, rng)
        writable[:] = values.astype(before.dtype)
        if before.tobytes() != values.astype(before.dtype).tobytes():
            changed.append(name)
    shutil.rmtree(path / "packed", ignore_errors=True)
    return changed


def lift_of(phase: NDArray[np.uint8], n_steps: int) -> int:
    """Return the record at which the lift begins, ``n_steps`` if it does not."""
    lifting = np.flatnonzero(phase[:n_steps] >= Phase.LIFT)
    return int(lifting[0]) if len(lifting) else int(n_steps)


@pytest.fixture(scope="module")
def overwritten(made: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Return a copy of the store in which all that came later is other, and the arrays."""
    copy = Path(shutil.copytree(made, tmp_path_factory.mktemp("overwritten") / "store"))
    return copy, overwrite_what_came_later(copy)


@each_kind
def test_inputs_stay_the_same_whatever_came_after(
    made: Path, overwritten: tuple[Path, list[str]], kind: str
) -> None:
    before = read(made, kind)
    store, changed = overwritten
    assert {
        *("episodes/success", "episodes/outcome", "episodes/lift_height", "episodes/quality"),
        *("episodes/object_lift", "episodes/grasp_score", "episodes/target_visibility"),
        *("cameras/front/rgb", "cameras/front/depth", "cameras/wrist/segmentation"),
        *("cameras/wrist/T_world_camera", "streams/tactile_wrench", "streams/tcp_pose"),
        *("streams/gripper_width", "streams/object_pose", "streams/phase"),
    } <= set(changed)
    after = read(store, kind, before.rows)
    assert after.success.tolist() != before.success.tolist()
    assert after.inputs.keys() == before.inputs.keys() == set(KINDS[kind])
    for name, values in before.inputs.items():
        assert after.inputs[name].tobytes() == values.tobytes(), name
    if TOUCH not in KINDS[kind]:
        assert read(store, kind).rows.tolist() == before.rows.tolist()


CHANGES = {
    "cameras/front/depth": ("image", lambda values: values[:, 0] * 0.99),
    "cameras/wrist/segmentation": ("image", lambda values: values[:, 0] + 1),
    "cameras/wrist/T_world_camera": ("image", lambda values: values[:, 0] + 0.01),
    "episodes/grasp_width": ("width", lambda values: values * 0.5),
    "streams/tactile_wrench": ("touch", lambda values: values + 1.0),
}
"""What was known before: array to the input that it makes, and to what it is changed."""


@pytest.mark.parametrize("array", CHANGES)
def test_inputs_change_with_what_came_before(store: Path, array: str) -> None:
    """Without this the test above could not fail."""
    before = read(store, "both")
    name, change = CHANGES[array]
    writable: Any = zarr.open_group(store, mode="r+")[array]
    values = np.asarray(writable[:])
    if values.ndim > 1 and values.shape[1] == 2 and name == "image":
        values[:, 0] = change(values)
    else:
        values = change(values)
    writable[:] = values
    after = read(store, "both", before.rows)
    for key, was in before.inputs.items():
        assert (after.inputs[key].tobytes() == was.tobytes()) == (key != name)
