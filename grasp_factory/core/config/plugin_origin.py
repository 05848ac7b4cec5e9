"""Where those policies, robots, object sets and sensors come from that this package lacks."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.cache import is_digest
from grasp_factory.core.config.recording import check_name
from grasp_factory.core.serialization import check, normalise, to_plain

KINDS: Mapping[str, str] = {
    "policies": "policy",
    "robots": "robot",
    "object_sets": "object set",
    "sensors": "sensor",
}
"""Tables that plugins of a config add rows to, and what one row is called in messages."""
MOST = 64
"""Plugins of one kind in a config."""
LONGEST = 200
"""Characters of the name of a file, a module or a distribution."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PluginOrigin:
    """The source of a row that is not of this package: a single file, or an installed package.

    It has no path: the same file in another folder makes the same dataset.
    """

    sha256: str
    """SHA-256 of the file, or of the package's files (``entry_points.source_digest``)."""
    attribute: str
    """Name of the object in the file or in the module."""
    file: str = ""
    """Name of the file, without folders; empty for an installed package."""
    module: str = ""
    """Dotted name of the module of an installed package."""
    distribution: str = ""
    """Name of the installed distribution."""
    version: str = ""
    """Version of the distribution."""

    def __post_init__(self) -> None:
        normalise(self)
        check(is_digest(self.sha256), "sha256", self.sha256, "a SHA-256")
        parts = self.attribute.split(".")
        check(all(map(str.isidentifier, parts)), "attribute", self.attribute, "a name of Python")
        texts = (self.attribute, self.file, self.module, self.distribution, self.version)
        for text in texts:
            check(len(text) <= LONGEST and text.isprintable(), "plugins", text, "a short name")
        check(bool(self.file) != bool(self.module), "file", self.file, "a file or a module")
        is_name = "/" not in self.file and (not self.file or self.file.endswith(".py"))
        check(is_name, "file", self.file, "the name of a file that ends in .py, without folders")

    def __str__(self) -> str:
        source = self.file or f"{self.distribution} {self.version}, {self.module}"
        return f"{source}:{self.attribute}"


Plugins = Mapping[str, Mapping[str, PluginOrigin]]
"""Origins by the kind, one of ``KINDS``, then by the row's name."""


def check_plugins(plugins: Plugins, used: Mapping[str, Collection[str]]) -> None:
    """Check the names in a table of plugins.

    Args:
        plugins: the table.
        used: names that the config uses, by kind.

    Raises:
        ConfigError: for an unknown kind, a name that is no word, or that the config does not use.
    """
    for kind, rows in plugins.items():
        check(kind in KINDS, "plugins", kind, ", ".join(KINDS))
        check(len(rows) <= MOST, f"plugins.{kind}", len(rows), f"up to {MOST}")
        for name in rows:
            check_name(f"plugins.{kind}", name)
            valid = ", ".join(used[kind])[:LONGEST]
            check(name in used[kind], f"plugins.{kind}", name, f"names that are used: {valid}")


def listed(plugins: Plugins) -> Iterator[tuple[str, str, PluginOrigin]]:
    """Yield kind, name and origin of each plugin."""
    for kind, rows in plugins.items():
        for name, origin in rows.items():
            yield kind, name, origin


def plain_plugins(plugins: Plugins) -> dict[str, Any]:
    """Return the plugins as plain data, without empty texts."""
    return {
        kind: {
            name: {key: value for key, value in to_plain(origin).items() if value}
            for name, origin in rows.items()
        }
        for kind, rows in plugins.items()
    }


def changed_file(plain: Mapping[str, object], plugins: Plugins) -> str:
    """Return the name of the first file that differs from the one that a stored config names.

    Args:
        plain: the stored config as plain data, which may be damaged.
        plugins: the plugins of a config with which the store is to be continued.

    Returns:
        The file's name; empty if no file has changed.
    """
    stored = plain.get("plugins")
    for kind, name, origin in listed(plugins):
        rows = stored.get(kind) if isinstance(stored, Mapping) else None
        row = rows.get(name) if isinstance(rows, Mapping) else None
        was = row.get("sha256") if isinstance(row, Mapping) else None
        if origin.file and was is not None and was != origin.sha256:
            return origin.file
    return ""
