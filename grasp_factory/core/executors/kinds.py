"""The kinds of executors: their names, and how each is made."""

from __future__ import annotations

from grasp_factory.core.executors.base import (
    Executor,
    ExecutorKind,
    ExecutorSettings,
    InlineExecutor,
)
from grasp_factory.core.executors.cluster.coordinator import ClusterExecutor
from grasp_factory.core.executors.pool import ProcessExecutor
from grasp_factory.core.plugins.entry_points import installed
from grasp_factory.errors import ConfigError, PluginError, lookup, shown

KIND = "executors"
"""Installed packages offer kinds in the group of entry points ``grasp_factory.executors``."""


def make_executor(workers: int) -> Executor:
    """Return the executor for a number of workers; one worker needs no pool."""
    return InlineExecutor() if workers == 1 else ProcessExecutor(workers)


def _local(settings: ExecutorSettings) -> Executor:
    if settings.is_watched:
        return ProcessExecutor(settings.workers)
    return make_executor(settings.workers)


def _ray(settings: ExecutorSettings) -> Executor:
    from grasp_factory.core.executors.cluster.ray_cluster import RayCluster  # noqa: PLC0415
    from grasp_factory.core.optional import require  # noqa: PLC0415

    require("ray", extra="ray")
    if "://" in settings.address:
        raise ConfigError(
            f"executor: got the address {shown(settings.address)}, valid: HOST:PORT of a cluster"
            " of Ray; run the command on one of its nodes"
        )
    connect = lambda: RayCluster(settings.address)  # noqa: E731
    return ClusterExecutor(connect, settings.workers, settings.tell)


INLINE = ExecutorKind(
    name="inline",
    description="in the process of the command, one job after the other",
    make=lambda settings: InlineExecutor(),
)
LOCAL = ExecutorKind(
    name="local",
    description="worker processes of this machine",
    make=_local,
)
RAY = ExecutorKind(
    name="ray",
    description="worker processes on each node of a Ray cluster; without ADDRESS Ray starts here",
    make=_ray,
    has_nodes=True,
)

EXECUTORS: dict[str, ExecutorKind] = {row.name: row for row in (INLINE, LOCAL, RAY)}


def executor_kind(text: str) -> tuple[ExecutorKind, str]:
    """Return the kind and the address of a text NAME or NAME:ADDRESS.

    The name is that of a row, or one that an installed package offers.

    Raises:
        UnknownNameError: naming the valid names.
        ConfigError: if the kind takes no address.
        PluginError: if a package offers something else by this name.
    """
    name, colon, address = text.partition(":")
    offered = {} if name in EXECUTORS else installed(KIND)
    if name in offered:
        kind = offered[name].load()
        if not isinstance(kind, ExecutorKind) or kind.name != name:
            raise PluginError(
                f"{offered[name].distribution} offers {shown(kind)} as the executor {name!r},"
                " valid: an ExecutorKind of this name"
            )
    else:
        kind = lookup({**EXECUTORS, **offered}, "executor", name)
    if colon and not (kind.has_nodes and address):
        valid = f"{name}:ADDRESS" if kind.has_nodes else name
        raise ConfigError(f"executor: got {shown(text)}, valid: {valid}")
    return kind, address
