"""A store carries the users' objects that its episodes drop, so that it never loses them."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.config import FactoryConfig
from grasp_factory.errors import ConfigError, StoreError
from grasp_factory.objects import find_set
from grasp_factory.objects.folder_archive import pack_folder, unpack_folder
from grasp_factory.writers.objects import read_objects


def packed(config: FactoryConfig) -> dict[str, bytes]:
    """Return an archive of each user's folder that a config names, by the name of its set.

    Raises:
        ConfigError: if this machine has not imported one of them.
    """
    return {name: pack_folder(sha256) for name, sha256 in config.object_folders.items()}


def unpack(path: Path, config: FactoryConfig) -> None:
    """Make sure that this machine has the users' objects of the store at ``path``, if any.

    What its cache lacks is taken from the store, where there is one already.

    Raises:
        StoreError: if the store's copy is damaged.
    """
    for name, sha256 in config.object_folders.items():
        try:
            find_set(name, sha256)
        except ConfigError:
            data = read_objects(path, name)
            if data is not None:
                _unpack_whole(path, name, sha256, data)


def _unpack_whole(path: Path, name: str, sha256: str, data: bytes) -> None:
    """Put an archive into the cache if it is the one that the config names."""
    try:
        found = unpack_folder(data)
    except StoreError as error:
        raise StoreError(f"{path} is damaged: its objects of set {name!r}: {error}") from None
    if found != sha256:
        what = f"its objects of set {name!r} are not those that it was made with"
        raise StoreError(f"{path} is damaged: {what}")
