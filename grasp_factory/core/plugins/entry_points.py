"""Rows that installed packages offer by entry points, such as ``grasp_factory.policies``."""

from __future__ import annotations

import contextlib
import hashlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from grasp_factory.errors import PluginError

GROUP = "grasp_factory.{kind}"
"""Name of the group of entry points of a kind."""
COVERED = (".py", ".urdf", ".obj", ".stl", ".dae", ".ply", ".mtl")
"""Endings of the files of a package that decide what its rows do."""


@dataclass(frozen=True, slots=True)
class InstalledPlugin:
    """An entry point of an installed distribution."""

    entry_point: EntryPoint

    @property
    def name(self) -> str:
        """The name under which the package offers it."""
        return self.entry_point.name

    @property
    def description(self) -> str:
        """One line that says where it comes from; nothing is imported for it."""
        return f"of the installed package {self.distribution} {self.version}"

    @property
    def module(self) -> str:
        """Dotted name of its module."""
        return self.entry_point.module

    @property
    def attribute(self) -> str:
        """Name of the object in the module."""
        return self.entry_point.attr

    @property
    def distribution(self) -> str:
        """Name of the distribution."""
        return self.entry_point.dist.name if self.entry_point.dist else ""

    @property
    def version(self) -> str:
        """Version of the distribution."""
        return self.entry_point.dist.version if self.entry_point.dist else ""

    def load(self) -> Any:
        """Import the module and return the object. What it prints goes to stderr.

        Raises:
            PluginError: if that fails.
        """
        try:
            with contextlib.redirect_stdout(sys.stderr):
                return self.entry_point.load()
        except (Exception, SystemExit) as error:
            text = " ".join(str(error).split())[:300]
            raise PluginError(
                f"{self.entry_point.value} of {self.distribution} {self.version} cannot be loaded:"
                f" {type(error).__name__}: {text}; install another version of"
                f" {self.distribution}, or uninstall it"
            ) from None


def installed(kind: str) -> Mapping[str, InstalledPlugin]:
    """Return what installed packages offer for a table, by name; nothing is imported.

    Raises:
        PluginError: if two packages offer the same name.
    """
    found: dict[str, InstalledPlugin] = {}
    for entry_point in entry_points(group=GROUP.format(kind=kind)):
        plugin = InstalledPlugin(entry_point)
        other = found.setdefault(plugin.name, plugin)
        if other.entry_point.value != entry_point.value:
            raise PluginError(
                f"{other.distribution} and {plugin.distribution} both offer {plugin.name!r} in"
                f" {GROUP.format(kind=kind)}: uninstall one of them"
            )
    return found


def source_digest(module: str) -> str:
    """Return the SHA-256 of the source of an installed module, which is not imported.

    It covers names and content of the Python files, URDFs and meshes of the top-level package, or
    the module's file if it is in none.

    Raises:
        PluginError: if the source is not found.
    """
    top = module.partition(".")[0]
    spec = find_spec(top)
    files = [] if spec is None else sorted(_files(spec, module))
    if not files:
        raise PluginError(f"the source of module {module} is not found; valid: Python files")
    total = hashlib.sha256()
    for name, file in files:
        content = file.read_bytes()
        total.update(f"{name}\0{len(content)}\0".encode())
        total.update(content)
    return total.hexdigest()


def _files(spec: ModuleSpec, module: str) -> Iterator[tuple[str, Path]]:
    """Yield the names and paths of the files that a digest covers."""
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    if spec.origin is not None and folders:
        folder = Path(spec.origin).parent
        found = (file for file in folder.rglob("*") if file.suffix.lower() in COVERED)
        for file in filter(Path.is_file, found):
            yield file.relative_to(folder).as_posix(), file
    elif spec.origin is not None:
        yield Path(spec.origin).name, Path(spec.origin)
    else:  # a namespace: its folders may belong to several distributions
        inner = "/".join(module.split(".")[1:])
        for folder in folders:
            for file in (folder / f"{inner}.py", folder / inner / "__init__.py"):
                if file.is_file():
                    yield f"{inner}.py", file
