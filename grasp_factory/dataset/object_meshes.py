"""The shapes of a store's objects: built-in ones, or those of a user's folder in the store."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from grasp_factory.core.cache import cache_dir
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import ObjectSpec
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.errors import ConfigError, StoreError
from grasp_factory.objects import find_set
from grasp_factory.objects.folder_archive import unpack_folder
from grasp_factory.objects.object_mesh import object_mesh
from grasp_factory.writers.zarr.embedded import OBJECTS, read_embedded

MESHES = 64
"""Number of meshes that are kept in memory."""


def recipe_mesh(store: Path, config: FactoryConfig, recipe: ObjectSpec) -> TriangleMesh:
    """Return the surface of an object of a recipe in its own frame, metres.

    The objects of a user's folder that this machine lacks are copied from the store to its cache.

    Raises:
        UnknownNameError: if there is no such object.
        MissingLibraryError: if its shape comes with PyBullet, which is not installed.
        ConfigError: if neither the store nor this machine has the user's folder.
        StoreError: if the store's copy is damaged.
        LimitError: if the mesh is too large.
    """
    name, sha256 = recipe.object_set, recipe.folder_sha256
    if sha256 and config.object_folders.get(name) == sha256:
        _ensure_folder(store, name, sha256)
    cache = cache_dir() if sha256 else None
    return _mesh(name, sha256, recipe.object_id, cache).scaled(recipe.scale)


@lru_cache(maxsize=MESHES)
def _mesh(name: str, sha256: str, object_id: str, cache: Path | None) -> TriangleMesh:
    """Return an object's surface; the cache is named because users' folders are in it."""
    return object_mesh(find_set(name, sha256).model(object_id))


def _ensure_folder(store: Path, name: str, sha256: str) -> None:
    try:
        find_set(name, sha256)
    except ConfigError:
        content = read_embedded(store, f"{OBJECTS}/{name}")
        if content is not None:
            unpack_objects(store, name, sha256, content)


def unpack_objects(store: Path, name: str, sha256: str, content: bytes) -> None:
    """Put the archive of a set of user's objects into the cache of this machine.

    Args:
        store: the store that has the archive, for messages.
        name: the name of the set.
        sha256: the digest that the config names.
        content: the archive.

    Raises:
        StoreError: if it is damaged, or it is not what the config names.
    """
    what = f"{store} is damaged: its archive of object set {name!r}"
    try:
        found = unpack_folder(content)
    except StoreError as error:
        raise StoreError(f"{what}: {error}") from None
    if found != sha256:
        raise StoreError(f"{what} is not what it was made with")
