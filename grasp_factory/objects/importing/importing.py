"""Import a user's folder of meshes: each file becomes an object or is refused with a reason."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.cache import cache_dir, digest, read, read_checked, write
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.core.text_format import escaped
from grasp_factory.errors import ConfigError, UsageError, shown
from grasp_factory.objects.folder import FolderObject, Manifest, load_folder
from grasp_factory.objects.folder_cache import manifest_path, mesh_path
from grasp_factory.objects.importing.base import (
    FolderReport,
    ImportedObject,
    Refusal,
    UnusableError,
)
from grasp_factory.objects.importing.child import Child, CrashError
from grasp_factory.objects.importing.folder_listing import (
    SETTINGS_FILE,
    keys,
    list_files,
    read_inside,
    suffix,
)
from grasp_factory.objects.importing.messages import Converted
from grasp_factory.objects.importing.object_source import ObjectSource, load_source, referenced
from grasp_factory.objects.importing.physical import finished
from grasp_factory.objects.importing.settings import FolderSettings, Settings, parse_settings
from grasp_factory.objects.importing.units import check_grip, grip_warnings

ImportProgress = Callable[[int, int, str], None]
"""``progress(done, total, file)`` is called before each file, and at the end with no file."""


def import_folder(
    path: Path, name: str, widest: float, progress: ImportProgress | None = None
) -> FolderReport:
    """Import every object of a folder into this machine's cache.

    Args:
        path: the folder.
        name: name of the object set; the ids of its objects begin with it.
        widest: how far the gripper's fingers open, metres.
        progress: called during the import.

    Raises:
        UsageError: if the folder or the cache cannot be used, or the libraries are missing.
        ConfigError: if the folder's ``objects.yaml`` is not valid.
    """
    if not os.path.isdir(path):
        raise UsageError(f"{shown(str(path))} is no folder with meshes")
    root, where = Path(os.path.realpath(path)), cache_dir()
    listing = list_files(root)
    refused = list(listing.refused)
    settings = _settings(root, [*listing.files, *(refusal.file for refusal in refused)])
    with Child() as child:
        run = _Run(root, where, settings, widest, child)
        # URDFs first: only after their import it is known which meshes they use.
        for done, file in enumerate(sorted(listing.files, key=_is_mesh)):
            if progress:
                progress(done, len(listing.files), file)
            run.add(file)
    if progress:
        progress(len(listing.files), len(listing.files), "")
    names = keys([file for file in listing.files if file not in run.parts])
    results = {key: (file, run.used[file]) for file, key in names.items() if file in run.used}
    objects = {key: result.item for key, (_, result) in results.items()}
    sha256 = _into_cache(Manifest(objects=objects), where) if objects else ""
    return FolderReport(
        name=name,
        sha256=sha256,
        usable=_usable(name, sha256, results) if objects else (),
        refused=tuple(sorted([*refused, *run.refused], key=lambda refusal: refusal.file)),
        warnings=(*listing.warnings, *_doubles(objects)),
    )


@dataclass(frozen=True, slots=True)
class _Result:
    """An object that can be used."""

    item: FolderObject
    found: Converted
    warnings: tuple[str, ...]


class _Run:
    """The import of one folder, with its results so far."""

    def __init__(
        self, root: Path, where: Path, settings: FolderSettings, widest: float, child: Child
    ) -> None:
        self._root = root
        self._where = where
        self._settings = settings
        self._widest = widest
        self._child = child
        self._claimed: dict[str, str] = {}
        self.used: dict[str, _Result] = {}
        self.refused: list[Refusal] = []
        self.parts: set[str] = set()
        """Meshes of imported URDFs; they are not objects themselves."""

    def add(self, file: str) -> None:
        """Import a file; meshes must be added after all URDFs."""
        if file in self.parts:
            return
        own = self._settings.of(file)
        try:
            if own.skip:
                raise UnusableError(f"{SETTINGS_FILE} says to skip it")
            if file in self._claimed:
                urdf = self._claimed[file]
                raise UnusableError(
                    f"it is a part of {urdf}, which is refused; skip that to use it"
                )
            self.used[file] = self._result(file, own)
        except UnusableError as error:
            self.refused.append(Refusal(file=file, reason=escaped(str(error))))
            if suffix(file) == "urdf" and not own.skip:
                self._claimed |= dict.fromkeys(referenced(self._root, file), file)

    def _result(self, file: str, own: Settings) -> _Result:
        defaults = self._settings.defaults
        source = load_source(self._root, file, own, defaults)
        found = _converted(source, self._child, self._where)
        check_grip(found.sides, self._widest)
        item, warnings = finished(source, found, own, defaults)
        self.parts.update(source.files)
        return _Result(item, found, (*warnings, *grip_warnings(found.sides, self._widest)))


def _is_mesh(file: str) -> bool:
    return suffix(file) != "urdf"


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


def _converted(source: ObjectSource, child: Child, where: Path) -> Converted:
    """Return the cached conversion, or convert the object and cache the result.

    Raises:
        UnusableError: if no object can be made from it; this is cached too, unless it is a crash.
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
    """Return the cached result of a conversion; None if it is missing, damaged or incomplete."""
    sha256, _, text = (read(path) or b"").partition(b"\n")
    if digest(text).encode() != sha256:
        return None
    known: dict[str, object] = json.loads(text)
    if "converted" in known:
        try:
            geometry = from_plain(Converted, known["converted"]).geometry
        except ConfigError:  # written by another version
            return None
        if any(read_checked(mesh_path(where, file)) is None for file in geometry.files):
            return None
    return known


def _into_cache(manifest: Manifest, where: Path) -> str:
    """Put a manifest into the cache and return its digest."""
    text = manifest.encoded()
    path = manifest_path(where, digest(text))
    if read_checked(path) is None:
        write(path, text)
    return digest(text)


def _doubles(objects: Mapping[str, FolderObject]) -> tuple[str, ...]:
    """Return a warning for each shape that occurs under several names."""
    names: dict[str, list[str]] = {}
    for key, item in objects.items():
        names.setdefault(item.shape_sha256, []).append(key)
    return tuple(
        f"the same mesh, which is drawn the more often: {', '.join(same)}"
        for same in names.values()
        if len(same) > 1
    )


def _usable(
    name: str, sha256: str, results: Mapping[str, tuple[str, _Result]]
) -> tuple[ImportedObject, ...]:
    models = load_folder(name, sha256).models
    return tuple(
        ImportedObject(
            object_id=f"{name}/{key}",
            file=file,
            sides=result.found.sides,
            mass=models[f"{name}/{key}"].mass,
            parts=result.found.geometry.hulls + len(result.found.geometry.solids),
            split=models[f"{name}/{key}"].split,
            warnings=result.warnings,
        )
        for key, (file, result) in results.items()
    )
