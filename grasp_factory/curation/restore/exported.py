"""An export on disk: its record and the lines of its episodes. It may come from a stranger."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from grasp_factory.core import schema
from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT, EMBEDDED, ROWS
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.serialization import check, is_integer
from grasp_factory.curation.merge.label_transfer import CopiedLabel
from grasp_factory.curation.restore.added_data import changes_of, labels_of
from grasp_factory.dataset.annotations import Change
from grasp_factory.errors import RefusedFileError, StoreError, UsageError, lookup, shown
from grasp_factory.robots import ROBOTS
from grasp_factory.writers.exporters import EXPORTERS, Exporter, ExportFolder
from grasp_factory.writers.exporters.export_record import EMBEDDED as EMBEDDED_FOLDER
from grasp_factory.writers.exporters.export_record import EPISODES, RECORD, VERSION
from grasp_factory.writers.zarr.embedded import embedded_in

DAMAGE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What plain data raises where it is used, if it has another form than an export writes."""
MOST_JOINTS = 64
"""Joints of a robot that is not of this package."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedEpisodes:
    """The export in a folder."""

    path: Path
    exporter: Exporter
    folder: ExportFolder
    attributes: tuple[Mapping[str, Any], ...]
    """Root attributes of its stores."""
    lines: tuple[int, ...]
    """Where the line of each episode begins, in bytes."""
    labels: tuple[CopiedLabel, ...]
    changes: list[Change]
    """Those that make the annotations, in the order of time."""

    @contextmanager
    def reading(self) -> Iterator[BinaryIO]:
        """Yield the open file of the lines, for ``line``."""
        with os.fdopen((self.folder.place / EPISODES).open(), "rb") as file:
            yield file

    def line(self, file: BinaryIO, place: int) -> dict[str, Any]:
        """Return the line of an episode.

        Raises:
            StoreError: if it is damaged.
        """
        file.seek(self.lines[place])
        return _object(_line(file, self.path), f"{self.path / EPISODES}: episode {place}")

    def embedded(self) -> dict[str, bytes]:
        """Return the data that the stores embed, by path in them.

        Raises:
            StoreError: if some is missing.
        """
        folder = self.folder.place / EMBEDDED_FOLDER
        try:
            names = embedded_in(self.folder.config)
            return {path: (folder / path).read_bytes(EMBEDDED) for path in names}
        except OSError as error:
            raise StoreError(f"{self.path}: {EMBEDDED_FOLDER}: {error.strerror}") from None


def open_export(path: Path) -> ExportedEpisodes:
    """Open the export in a folder.

    Raises:
        UsageError: if it is no export, or one that cannot be read back.
        StoreError: if its record is damaged.
        IrregularFileError: if a link is in the way.
        LimitError: if a file is too large.
    """
    place, record = read_record(path)
    try:
        return _opened(path, place, record)
    except DAMAGE as error:
        raise StoreError(f"{path / RECORD} is damaged: {error}") from None


def read_record(path: Path) -> tuple[Place, dict[str, Any]]:
    """Return the place of an export and its record; see ``open_export`` for what is raised."""
    try:
        place = place_of(path)
        data = (place / RECORD).read_bytes(DOCUMENT)
    except (FileNotFoundError, NotADirectoryError):
        raise UsageError(
            f"{path} is no export: it has no {RECORD}; valid: a folder that `grasp-factory export`"
            " wrote"
        ) from None
    except RefusedFileError:
        raise
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}") from None
    return place, _object(data, f"{path / RECORD}")


def _opened(path: Path, place: Place, record: Mapping[str, Any]) -> ExportedEpisodes:
    if not is_integer(record["version"]) or record["version"] > VERSION:
        raise UsageError(
            f"{path} has version {record['version']}, this version of grasp-factory reads up to"
            f" {VERSION}: install a newer one"
        )
    exporter = lookup(EXPORTERS, "format", str(record["format"]))
    if exporter.read_back is None:
        valid = ", ".join(name for name, row in EXPORTERS.items() if row.read_back)
        raise UsageError(f"{path}: {exporter.name} cannot be imported, valid: {valid}")
    exporter.check_libraries()
    stores = tuple(store["attributes"] for store in record["stores"])
    config = _config(path, stores)
    known, listed = {row.path: row for row in schema.expand(config)}, set(record["arrays"])
    lines = _line_starts(place / EPISODES, record["episodes"])
    return ExportedEpisodes(
        path=path,
        exporter=exporter,
        folder=ExportFolder(
            place=place,
            episodes=len(lines),
            settings=exporter.settings(record["settings"]),
            config=config,
            fields={name: row for name, row in known.items() if name in listed},
            joints=_joints(stores[0], config),
        ),
        attributes=stores,
        lines=lines,
        labels=labels_of(path, record, len(lines)),
        changes=changes_of(record, len(lines)),
    )


def _config(path: Path, stores: tuple[Mapping[str, Any], ...]) -> FactoryConfig:
    """Return the first store's config; the others may differ in the seed only."""
    first, *others = (FactoryConfig.from_plain(attributes["config"]) for attributes in stores)
    for other in others:
        found = first_difference(first.to_plain(), other.to_plain() | {"seed": first.seed})
        if found:
            raise UsageError(
                f"{path}: its stores differ in more than the seed ({found}): export and import"
                " them one by one"
            )
    return first


def _joints(attributes: Mapping[str, Any], config: FactoryConfig) -> int:
    """Return the number of joints of a config's robot; that of a plugin is in the attributes."""
    if config.robot not in config.plugins.get("robots", ()):
        return len(lookup(ROBOTS, "robot", config.robot).arm_joints)
    count = len(attributes["robot"]["joint_names"])
    check(1 <= count <= MOST_JOINTS, "joint_names", count, f"1 to {MOST_JOINTS} names")
    return count


def _line_starts(place: Place, episodes: Any) -> tuple[int, ...]:
    """Return where each line of a file begins, in the order of the episodes' numbers."""
    valid = shown(episodes)
    starts: dict[int, int] = {}
    count = 0
    try:
        with os.fdopen(place.open(), "rb") as file:
            while data := _line(file, place.path):
                count += 1
                ROWS.check(count, place.path)
                if count > episodes:
                    raise StoreError(f"{place.path} has more lines than {valid}, its episodes")
                number: Any = _object(data, str(place.path)).get("episode")
                starts[number if is_integer(number) else -1] = file.tell() - len(data)
    except RefusedFileError:
        raise
    except OSError as error:
        raise StoreError(f"{place.path} cannot be read: {error.strerror}") from None
    if count != episodes:
        raise StoreError(f"{place.path} has {count} lines for {valid} episodes")
    if sorted(starts) != list(range(count)):
        raise StoreError(f"{place.path} is damaged: it does not number the episodes from 0")
    return tuple(starts[number] for number in range(len(starts)))


def _line(file: BinaryIO, path: Path) -> bytes:
    data = file.readline(DOCUMENT.most + 1)
    DOCUMENT.check(len(data), path)
    return data


def _object(data: bytes, where: str) -> dict[str, Any]:
    try:
        found = parsed(data)
    except ValueError as error:
        raise StoreError(f"{where} is damaged: {error}") from None
    if not isinstance(found, dict):
        raise StoreError(f"{where} is damaged: it is no object of JSON")
    return found
