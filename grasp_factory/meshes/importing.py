"""A user's folder of meshes becomes an object set: each file is used, or refused with a reason."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.meshes.base import FolderReport, ImportedObject, Refusal, UnusableError
from grasp_factory.meshes.child import Child, CrashError
from grasp_factory.meshes.job import Converted
from grasp_factory.meshes.listing import SETTINGS_FILE, keys, list_files, read_inside
from grasp_factory.meshes.physical import finished
from grasp_factory.meshes.report import printable
from grasp_factory.meshes.settings import FolderSettings, parse_settings
from grasp_factory.meshes.source import Source, load_source, referenced
from grasp_factory.meshes.units import check_grip, grip_warnings
from grasp_factory.objects.folder import FolderObject, Manifest, load_folder
from grasp_factory.objects.folder_cache import (
    cache_dir,
    digest,
    manifest_path,
    mesh_path,
    read,
    read_checked,
    write,
)
from grasp_factory.records import from_plain, to_plain

Progress = Callable[[int, int, str], None]
"""``progress(done, total, file)`` is called before each file, and at the end with no file."""


def import_folder(
    path: Path, name: str, widest: float, progress: Progress | None = None
) -> FolderReport:
    """Import every object of a folder into this machine's cache.

    Args:
        path: the folder.
        name: of the object set; the ids of its objects begin with it.
        widest: how far the gripper's fingers open, metres.
        progress: called as the import goes on.

    Raises:
        UsageError: if the folder or the cache cannot be used, or the libraries are missing.
        ConfigError: if the folder's ``objects.yaml`` is not valid.
    """
    if not path.is_dir():
        raise UsageError(f"{path} is no folder with meshes")
    root, where = path.resolve(), cache_dir()
    listing = list_files(root)
    refused = list(listing.refused)
    settings = _settings(root, [*listing.files, *(refusal.file for refusal in refused)])
    parts = referenced(root, listing.files)
    files = keys([file for file in listing.files if file not in parts])
    objects: dict[str, FolderObject] = {}
    notes: dict[str, tuple[str, Converted, tuple[str, ...]]] = {}
    with Child() as child:
        for done, (file, key) in enumerate(files.items()):
            if progress:
                progress(done, len(files), file)
            own = settings.of(file)
            try:
                if own.skip:
                    raise UnusableError(f"{SETTINGS_FILE} says to skip it")
                source = load_source(root, file, own, settings.defaults)
                found = _converted(source, child, where)
                check_grip(found.sides, widest)
                objects[key], warnings = finished(source, found, own, settings.defaults)
            except UnusableError as error:
                refused.append(Refusal(file=file, reason=printable(str(error))))
            else:
                notes[key] = file, found, (*warnings, *grip_warnings(found.sides, widest))
    if progress:
        progress(len(files), len(files), "")
    sha256 = _kept(Manifest(objects=objects), where) if objects else ""
    return FolderReport(
        name=name,
        sha256=sha256,
        usable=_usable(name, sha256, notes) if objects else (),
        refused=tuple(sorted(refused, key=lambda refusal: refusal.file)),
        warnings=_doubles(objects),
    )


def _settings(root: Path, files: Sequence[str]) -> FolderSettings:
    if not os.path.lexists(root / SETTINGS_FILE):
        return FolderSettings()
    try:
        data = read_inside(root, SETTINGS_FILE)
    except UnusableError as error:
        raise ConfigError(f"{root / SETTINGS_FILE}: {error}") from None
    settings = parse_settings(data, str(root / SETTINGS_FILE))
    settings.check_files(files, str(root / SETTINGS_FILE))
    return settings


def _converted(source: Source, child: Child, where: Path) -> Converted:
    """Return the conversion that the cache has, or do it and put it there.

    Raises:
        UnusableError: if no object can be made of it; that is kept too, but for a crash.
    """
    path = where / "objects" / f"{source.job.key(source.blobs)}.json"
    known = _known(path, where)
    if known is None:
        try:
            found, files = child.convert(source.job, source.blobs)
            for sha256, data in files.items():
                write(mesh_path(where, sha256), data)
            known = {"converted": to_plain(found)}
        except CrashError:
            raise
        except UnusableError as error:
            known = {"refused": str(error)}
        text = json.dumps(known).encode()
        write(path, digest(text).encode() + b"\n" + text)
    if "refused" in known:
        raise UnusableError(str(known["refused"]))
    return from_plain(Converted, known["converted"])


def _known(path: Path, where: Path) -> dict[str, object] | None:
    """Return what the cache has of a conversion, if it is whole."""
    sha256, _, text = (read(path) or b"").partition(b"\n")
    if digest(text).encode() != sha256:
        return None
    known: dict[str, object] = json.loads(text)
    if "converted" in known:
        try:
            geometry = from_plain(Converted, known["converted"]).geometry
        except ConfigError:  # of another version
            return None
        if any(read_checked(mesh_path(where, file)) is None for file in geometry.files):
            return None
    return known


def _kept(manifest: Manifest, where: Path) -> str:
    """Put a manifest into the cache and return its digest."""
    text = manifest.encoded()
    path = manifest_path(where, digest(text))
    if read_checked(path) is None:
        write(path, text)
    return digest(text)


def _doubles(objects: Mapping[str, FolderObject]) -> tuple[str, ...]:
    """Return a warning for each content that is there under several names."""
    names: dict[str, list[str]] = {}
    for key, item in objects.items():
        names.setdefault(item.source_sha256, []).append(key)
    return tuple(
        f"the same mesh, which is drawn the more often: {', '.join(same)}"
        for same in names.values()
        if len(same) > 1
    )


def _usable(
    name: str, sha256: str, notes: dict[str, tuple[str, Converted, tuple[str, ...]]]
) -> tuple[ImportedObject, ...]:
    models = load_folder(name, sha256).models
    return tuple(
        ImportedObject(
            object_id=f"{name}/{key}",
            file=file,
            sides=found.sides,
            mass=models[f"{name}/{key}"].mass,
            parts=found.geometry.hulls + len(found.geometry.solids),
            split=models[f"{name}/{key}"].split,
            warnings=warnings,
        )
        for key, (file, found, warnings) in notes.items()
    )
