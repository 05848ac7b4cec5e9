"""A store carries the objects, trained models and source files that its episodes were made with."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.core.cache import digest
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.plugins.plugin_sources import allowed_source
from grasp_factory.dataset.object_meshes import unpack_objects
from grasp_factory.errors import ConfigError, StoreError
from grasp_factory.objects import find_set
from grasp_factory.objects.folder_archive import pack_folder
from grasp_factory.policies import model_registry
from grasp_factory.writers.zarr.embedded import (
    MODELS,
    OBJECTS,
    PLUGINS,
    embedded_in,
    read_embedded,
)


def packed(config: FactoryConfig) -> dict[str, bytes]:
    """Return the data that a store of this config embeds, by path in the store.

    Raises:
        ConfigError: if this machine has not imported some of it.
    """
    pack = {OBJECTS: pack_folder, MODELS: model_registry.read, PLUGINS: _source}
    return {path: pack[_group(path)](sha256) for path, sha256 in embedded_in(config).items()}


def unpack(path: Path, config: FactoryConfig) -> None:
    """Make sure that this machine has the data that the store at ``path`` embeds, if any.

    Data that its cache lacks are copied from the store, if the store exists already. Source files
    are not: the user names them, or trusts the store (``plugins.trust``).

    Raises:
        StoreError: if the store's copy is damaged.
    """
    for name, sha256 in embedded_in(config).items():
        if _group(name) != PLUGINS and not _is_here(name, sha256):
            content = read_embedded(path, name)
            if content is not None:
                _unpack_whole(path, name, sha256, content)


def how_to_import(path: str) -> str:
    """Return how to import to this machine the data that stores embed at a path."""
    if _group(path) == MODELS:
        return "import its file with grasp-factory generate --model FILE --print-config"
    if _group(path) == PLUGINS:
        return "give its file with --plugin FILE.py"
    return "import its folder with grasp-factory objects DIR"


def _source(sha256: str) -> bytes:
    source = allowed_source(sha256)
    if source is None:
        raise ConfigError(f"the source with the SHA-256 {sha256} was not given: add --plugin FILE")
    return source.content


def _group(path: str) -> str:
    return path.partition("/")[0]


def _is_here(path: str, sha256: str) -> bool:
    group, _, name = path.partition("/")
    try:
        if group == MODELS:
            model_registry.read(sha256)
        else:
            find_set(name, sha256)
    except ConfigError:
        return False
    return True


def _unpack_whole(path: Path, name: str, sha256: str, content: bytes) -> None:
    """Put embedded data into the cache, and check that the config names them."""
    group, _, item = name.partition("/")
    if group == OBJECTS:
        unpack_objects(path, item, sha256, content)
        return
    if digest(content) != sha256:
        raise StoreError(
            f"{path} is damaged: its model of policy {item!r} is not what it was made with"
        )
    model_registry.keep(content)
