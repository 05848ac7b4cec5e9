"""The check of a cluster's node before it works: it must make the bytes that this process makes."""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from secrets import token_hex

from grasp_factory.core.atomic_file import PARTIAL
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import place_of
from grasp_factory.core.platforms import ACCEPT, Fingerprint, difference
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.plugins import activate
from grasp_factory.simulation.fingerprint import fingerprint
from grasp_factory.simulation.world.connection import check_renderer
from grasp_factory.writers.zarr.header import root_attributes

_PROBE = ".probe-"


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeCheck:
    """Called on a node; it carries what this process knows of itself."""

    path: Path
    """The store; every node must see it by this path."""
    config: FactoryConfig
    probe: str
    """Name of a file in the store, whose content is the same text."""
    versions: Mapping[str, str]
    platform: Fingerprint
    accept_other_platform: bool

    def __call__(self) -> None:
        """Check this node, and copy to its cache what the store carries.

        Raises:
            StoreMismatchError: if the node sees another file system, or makes other bytes.
            UsageError: if it lacks something that the config needs.
            StoreError: if the store cannot be read here.
        """
        here = platform.node()
        if self._read_probe() != self.probe:
            raise StoreMismatchError(
                f"{self.path} is not the same folder on {here}: --executor needs a file system that"
                " all nodes share, mounted at the same path; without one use --shard, a store for"
                " each node, and merge"
            )
        own = versions(self.config)
        wanted = self.versions.items()
        other = [f"{name} {own.get(name)}, not {v}" for name, v in wanted if own.get(name) != v]
        if other:
            raise StoreMismatchError(
                f"{here} has {', '.join(other)}: install the same versions on all nodes"
            )
        embedded_assets.unpack(self.path, self.config)
        activate(self.config)
        check_renderer(self.config.renderer)
        found = difference(self.platform, fingerprint(self.config))
        if found and not self.accept_other_platform:
            raise StoreMismatchError(
                f"{here} is another platform: {found}, so bytes of episodes differ; leave the node"
                f" out, or add {ACCEPT}"
            )

    def _read_probe(self) -> str:
        try:
            return (place_of(self.path) / self.probe).read_bytes(DOCUMENT).decode()
        except (OSError, StoreError, UnicodeDecodeError):
            return ""


@contextlib.contextmanager
def node_check(
    path: Path, config: FactoryConfig, *, accept: bool, is_alone: bool
) -> Iterator[NodeCheck]:
    """Yield the check of a run's nodes; meanwhile a file is in the store that they look for.

    Args:
        path: the store, absolute.
        config: its config.
        accept: whether nodes of other platforms may work.
        is_alone: whether no other run is at work on the store, so that what a killed one has left
            is removed.

    Raises:
        OSError: if the store cannot be written.
    """
    store = place_of(path)
    name = f"{_PROBE}{token_hex(8)}{PARTIAL}"
    for left in store.glob(f"{_PROBE}*{PARTIAL}") if is_alone else ():
        left.unlink(missing_ok=True)
    probe = store / name
    probe.write(name.encode())
    try:
        yield NodeCheck(
            path=path,
            config=config,
            probe=name,
            versions=versions(config),
            platform=fingerprint(config),
            accept_other_platform=accept,
        )
    finally:
        probe.unlink(missing_ok=True)


def versions(config: FactoryConfig) -> dict[str, str]:
    """Return the versions that a store of this config records."""
    return dict(root_attributes(config, {})["versions"])
