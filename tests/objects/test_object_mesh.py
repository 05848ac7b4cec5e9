"""Surfaces of objects: where they are, and meshes of users from a store."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.fake_episodes import JOINTS, small_config
from support.tiny_archive import VISUAL, archive, manifest

from grasp_factory.core import optional, package_files
from grasp_factory.core.cache import VARIABLE, digest
from grasp_factory.core.episode import ObjectSpec
from grasp_factory.core.geometry import IDENTITY
from grasp_factory.core.limits import MESH
from grasp_factory.core.limits import VARIABLE as LIMITS
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, LimitError, MissingLibraryError, StoreError
from grasp_factory.objects import BLOBS, CLASSIC, PROCEDURAL, ObjectModel
from grasp_factory.objects import object_mesh as object_mesh_module
from grasp_factory.objects.object_mesh import object_mesh
from grasp_factory.writers.zarr.store import prepare_store

SEEN_BEYOND = {"classic/duck": 4e-4, "classic/lego": 3e-4}
"""Metres by which the bounding box of what is seen differs from that of what collides."""
MODELS = [
    *CLASSIC.models.values(),
    *list(BLOBS.models.values())[::150],
    *(PROCEDURAL.model(f"procedural/{family}/7") for family in PROCEDURAL.families),
]


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.object_id)
def test_a_surface_fills_the_bounding_box(model: ObjectModel) -> None:
    mesh = object_mesh(model)
    found = [mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)]
    tolerance = SEEN_BEYOND.get(model.object_id, 5e-5)
    np.testing.assert_allclose(found, [model.lower, model.upper], atol=tolerance)
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert set(mesh.faces.ravel()) == set(range(len(mesh.vertices)))


def recipe(sha256: str, scale: float = 1.0) -> ObjectSpec:
    return ObjectSpec(
        object_set="mine",
        object_id="mine/a",
        family="mesh",
        split="train",
        mass=0.1,
        lateral_friction=0.5,
        drop_pose=IDENTITY,
        folder_sha256=sha256,
        scale=scale,
    )


@pytest.fixture
def sha256() -> str:
    return digest(manifest())


def store_with(path: Path, content: bytes, sha256: str) -> Dataset:
    """Write a store that contains an archive of a user's objects."""
    config = small_config(object_sets={"mine": 1.0}, object_folders={"mine": sha256})
    prepare_store(path, config, JOINTS, 1, {}, carried={"objects/mine": content})
    return Dataset(path)


def test_a_user_s_mesh_comes_from_the_store_at_the_recipe_s_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sha256: str
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    dataset = store_with(tmp_path / "store.zarr", archive(), sha256)
    seen = [line.split()[1:] for line in VISUAL.decode().splitlines() if line[:2] == "v "]
    expected = np.array(seen, float)
    for scale in (1.0, 2.0):
        mesh = dataset.object_mesh(recipe(sha256, scale))
        np.testing.assert_allclose(mesh.vertices[mesh.faces[0]], scale * expected)
        assert mesh.color == (0.5, 0.5, 0.5)


def test_a_folder_that_neither_store_nor_machine_has_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sha256: str
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    dataset = store_with(tmp_path / "store.zarr", archive(), sha256)
    with pytest.raises(ConfigError, match="run `grasp-factory objects DIR`"):
        dataset.object_mesh(recipe("1" * 64))


def test_a_damaged_archive_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sha256: str
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    dataset = store_with(tmp_path / "store.zarr", archive()[:-40], sha256)
    with pytest.raises(StoreError, match="is damaged: its archive of object set 'mine'"):
        dataset.object_mesh(recipe(sha256))


def test_a_mesh_of_too_many_triangles_is_refused_unless_the_limit_is_raised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = PROCEDURAL.model("procedural/box/7")
    monkeypatch.setattr(object_mesh_module, "MESH", replace(MESH, usual=11))
    with pytest.raises(LimitError, match="of 12, valid: up to 11"):
        object_mesh(model)
    monkeypatch.setenv(LIMITS, "triangles=12")
    assert len(object_mesh(model).faces) == 12


def test_a_shape_that_comes_with_pybullet_needs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    package_files.folder_of.cache_clear()
    monkeypatch.setattr(optional, "find_spec", lambda name: None)
    with pytest.raises(MissingLibraryError, match="needs pybullet, which is not installed"):
        object_mesh(CLASSIC.model("classic/duck"))
