"""Policies, robots, object sets and sensors of the user's files and of installed packages.

A config names them as ``FILE.py:NAME``, or by the name of an entry point. ``with_plugins`` replaces
these names by words and notes the origins; ``activate`` adds the rows to the tables of a process.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from grasp_factory.core.cache import digest
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.plugin_origin import KINDS, PluginOrigin, listed
from grasp_factory.core.config.sensor_array import SensorArray, array_of
from grasp_factory.core.plugins.entry_points import InstalledPlugin, installed, source_digest
from grasp_factory.core.plugins.file_loading import FileReference, attribute_of, file_reference
from grasp_factory.core.plugins.plugin_sources import (
    PluginSource,
    allow,
    allow_file,
    allowed,
    allowed_source,
)
from grasp_factory.core.sensors import SensorModel
from grasp_factory.core.serialization import check
from grasp_factory.errors import PluginError, StoreError, shown
from grasp_factory.factory.plugin_rows import TABLES, PluginRow, row_of
from grasp_factory.robots import RobotModel
from grasp_factory.writers.zarr.embedded import PLUGINS, read_embedded

_ACTIVE: dict[tuple[str, str], PluginOrigin] = {}
"""Origins of the rows that this process has added to its tables, by kind and name."""


def with_plugins(config: FactoryConfig) -> FactoryConfig:
    """Return a config whose plugins are named by words, with their origins.

    A name ``FILE.py:NAME`` is an object of a file, which is run. A name that no table has may be an
    entry point of an installed package.

    Raises:
        PluginError: if a plugin cannot be loaded, or is not of the kind that it is used as.
        ConfigError: if two plugins have the same name.
    """
    origins = {kind: dict(rows) for kind, rows in config.plugins.items()}

    def named(kind: str, name: str) -> str:
        found = None if name in config.plugins.get(kind, ()) else find_plugin(kind, name)
        if found is None:
            return name
        row, origin = found
        origins.setdefault(kind, {})[row.name] = origin
        return row.name

    def renamed(kind: str, table: Mapping[str, Any]) -> dict[str, Any]:
        out = {named(kind, name): value for name, value in table.items()}
        ok = len(out) == len(table)
        check(ok, kind, list(table), f"names of which each is another {KINDS[kind]}")
        return out

    policies, robot = renamed("policies", config.policies), named("robots", config.robot)
    sets = renamed("object_sets", config.object_sets)
    sensors = renamed("sensors", config.sensors)
    known = origins.get("sensors", {})
    for name in sensors:
        valid = "FILE.py:NAME, or a sensor of an installed package"
        check(name in known, "sensors", name, valid)
        if name in TABLES["sensors"]:
            sensors[name] = _arrays(TABLES["sensors"][name])
    if not origins:
        return config
    return dataclasses.replace(
        config,
        policies=policies,
        policy_parameters=renamed("policies", config.policy_parameters),
        robot=robot,
        object_sets=sets,
        sensors=sensors,
        plugins=origins,
    )


def activate(config: FactoryConfig) -> None:
    """Add the plugins of a config to the tables of this process; without plugins, do nothing.

    Raises:
        PluginError: if one is missing, has changed, or cannot be loaded.
    """
    check_given(config)
    for kind, name, origin in listed(config.plugins):
        if _ACTIVE.get((kind, name)) != origin:
            if origin.module:
                row = _installed_row(kind, name, origin)
            else:
                row = _row_of_file(kind, allowed_source(origin.sha256), origin)
            if row.name != name:
                raise PluginError(f"{origin} is named {row.name!r}, and the config names {name!r}")
            if isinstance(row, SensorModel) and _arrays(row) != config.sensors[name]:
                raise PluginError(f"sensor {name}: the config has other arrays than {origin}")
            _add(kind, row, origin)


def check_given(config: FactoryConfig) -> None:
    """Check that the source files of a config's plugins may be run; nothing is run.

    Raises:
        PluginError: naming those that were not given, or are others.
    """
    missing = [
        (kind, name, origin)
        for kind, name, origin in listed(config.plugins)
        if origin.file and allowed_source(origin.sha256) is None
    ]
    if missing:
        raise _not_given(missing)


def trust(store: Path, config: FactoryConfig) -> list[PluginSource]:
    """Let this process run the source files in a store, but for those that it has already.

    Args:
        store: its path.
        config: its config.

    Returns:
        The sources of the store.

    Raises:
        StoreError: if the store is damaged, or a source is not what its config names.
        LimitError: if a source is too large.
    """
    found = []
    for _, _, origin in listed(config.plugins):
        if origin.file and allowed_source(origin.sha256) is None:
            found.append(carried_source(store, origin))
            allow(found)
    return found


def carried_source(store: Path, origin: PluginOrigin) -> PluginSource:
    """Return a source file that a store carries, without running it.

    Raises:
        StoreError: if the store lacks it, or has another one.
        LimitError: if it is too large.
    """
    content = read_embedded(store, f"{PLUGINS}/{origin.sha256}")
    if content is None or digest(content) != origin.sha256:
        what = "lacks" if content is None else "has another source as"
        raise StoreError(f"{store} {what} {origin.file}, which its config names: give that file")
    return PluginSource(name=origin.file, content=content)


def find_plugin(kind: str, name: str) -> tuple[PluginRow, PluginOrigin] | None:
    """Return the row and the origin of a plugin that a name stands for; None for other names.

    The row is in the table then.

    Raises:
        PluginError: if it cannot be loaded, or is not of the kind.
    """
    reference = file_reference(name)
    if reference is not None:
        return _from_file(kind, reference)
    if name.endswith(".py"):
        raise PluginError(f"{KINDS[kind]} {shown(name)}: valid: FILE.py:NAME, such as {name}:plan")
    if (kind, name) in _ACTIVE:
        return TABLES[kind][name], _ACTIVE[kind, name]
    if name in TABLES[kind] or name not in (offered := installed(kind)):
        return None
    plugin = offered[name]
    origin = PluginOrigin(
        sha256=source_digest(plugin.module),
        attribute=plugin.attribute,
        module=plugin.module,
        distribution=plugin.distribution,
        version=plugin.version,
    )
    row = _checked(kind, plugin)
    _add(kind, row, origin)
    return row, origin


def _from_file(kind: str, reference: FileReference) -> tuple[PluginRow, PluginOrigin]:
    source = allow_file(reference.path)
    origin = PluginOrigin(sha256=source.sha256, attribute=reference.attribute, file=source.name)
    row = _row_of_file(kind, source, origin)
    _add(kind, row, origin)
    return row, origin


def _arrays(row: SensorModel) -> tuple[SensorArray, ...]:
    return tuple(array_of(field, row.name) for field in row.fields)


def _row_of_file(kind: str, source: PluginSource | None, origin: PluginOrigin) -> PluginRow:
    """Return the row of a file; the function ``plan`` of ``my_file.py`` is ``my_file_plan``."""
    assert source is not None
    name = re.sub(r"\W", "_", f"{PurePath(origin.file).stem}_{origin.attribute}")
    row = row_of(kind, attribute_of(source, origin.attribute), origin, name)
    if isinstance(row, RobotModel) and (PurePath(row.urdf).is_absolute() or ".." in row.urdf):
        raise PluginError(
            f"{origin}: urdf {shown(row.urdf)}, valid: one of this package or of"
            " pybullet_data; a URDF of your own belongs in an installed package"
        )
    return row


def _not_given(missing: Sequence[tuple[str, str, PluginOrigin]]) -> PluginError:
    """Return the error for source files that this process may not run."""
    here = {source.name: source for source in allowed()}
    for kind, name, origin in missing:
        if origin.file in here:
            return PluginError(
                f"{origin.file} has changed: {KINDS[kind]} {name} was made with the SHA-256"
                f" {origin.sha256[:12]}..., and this file has {here[origin.file].sha256[:12]}...;"
                " give the old file, or leave --plugin out and add --trust to run the copy in the"
                " store"
            )
    rows = ", ".join(f"{KINDS[kind]} {name}" for kind, name, _ in missing)
    files = dict.fromkeys(origin.file for _, _, origin in missing)
    options = " ".join(f"--plugin {file}" for file in files)
    return PluginError(
        f"{rows}: this is code of {', '.join(files)}, which was not given: add {options}, or"
        " --trust to run the copy in the store"
    )


def _installed_row(kind: str, name: str, origin: PluginOrigin) -> PluginRow:
    """Return the row of an installed package, if it is the one that a config names."""
    plugin = installed(kind).get(name)
    wanted = f"{origin.distribution} {origin.version}"
    if plugin is None or (plugin.module, plugin.attribute) != (origin.module, origin.attribute):
        raise PluginError(
            f"{KINDS[kind]} {name} is of the package {wanted}, which is not installed:"
            f" pip install '{origin.distribution}=={origin.version}'"
        )
    if source_digest(plugin.module) != origin.sha256:
        here = f"{plugin.distribution} {plugin.version}"
        raise PluginError(
            f"{KINDS[kind]} {name} was made with {wanted}, and the source of {here}, which is"
            f" installed, is another: install {wanted} as it was then, or make a new store"
        )
    return _checked(kind, plugin)


def _checked(kind: str, plugin: InstalledPlugin) -> PluginRow:
    row = row_of(kind, plugin.load(), plugin.entry_point.value, plugin.name)
    if row.name != plugin.name:
        raise PluginError(
            f"{plugin.distribution} offers {plugin.name!r}, and it is named {row.name!r}: the names"
            " must be the same"
        )
    return row


def _add(kind: str, row: PluginRow, origin: PluginOrigin) -> None:
    """Add a row to its table.

    Raises:
        PluginError: if this package has a row of this name.
    """
    if row.name in TABLES[kind] and (kind, row.name) not in _ACTIVE:
        raise PluginError(
            f"{origin} has the name {row.name!r}, which is one of this package: choose another"
        )
    TABLES[kind][row.name] = row
    _ACTIVE[kind, row.name] = origin
