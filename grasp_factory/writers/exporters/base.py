"""The interface of exporters: each writes chosen episodes in the format of another tool."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.field import Field
from grasp_factory.core.optional import require
from grasp_factory.core.place import Place
from grasp_factory.core.real_series import REAL_GROUPS
from grasp_factory.core.serialization import from_plain
from grasp_factory.writers.exporters.selection import Selection

REAL_SERIES = tuple(f"{group.name}/*" for group in REAL_GROUPS)
"""The time series that only real episodes have, for ``ExportContents``."""
REAL_ROWS = "real episodes"
"""In ``ExportContents.treatment``: what the format does with them, apart from all others."""
EPISODES_PER_PART = 8
"""Default for ``Exporter.split``: small, so that workers share the work evenly to its end, and the
default of ``block_size``, because the series of a block are stored together."""
_FILES, _MOST_PER_FILE = 8, 64


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportContents:
    """Which of the store's arrays a format has, and why it lacks the others.

    A name is an array's path in the store; ``*`` matches any text, as in ``cameras/*/rgb``. If a
    name with ``*`` in ``left_out`` also matches what ``written`` names, ``written`` takes
    precedence. Every export has what is neither an image nor a time series: see
    ``export_record.py``.
    """

    written: tuple[str, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    """A short reason for each name."""
    treatment: Mapping[str, str] = field(default_factory=dict)
    """What the format does with NaN, episodes without a grasp and other special cases."""

    def shown_left_out(self) -> dict[str, str]:
        """Return ``left_out`` for people: ``other streams/*`` where some of them are written."""
        return {
            f"other {name}" if any(fnmatchcase(each, name) for each in self.written) else name: why
            for name, why in self.left_out.items()
        }

    def not_mentioned(self, fields: Iterable[Field]) -> list[str]:
        """Return the images and time series that are neither written nor left out for a reason."""
        names = (*self.written, *self.left_out)
        paths = [field.path for field in fields if field.is_image or field.length_column]
        return [path for path in paths if not any(fnmatchcase(path, name) for name in names)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportJob:
    """The task of an exporter."""

    episodes: Selection
    folder: Path
    """The folder to fill. It exists and is empty at first; all parts write to it."""
    aside: Path
    """Another folder, for files that the export does not keep."""
    settings: Any
    """An instance of the exporter's ``parameters``."""
    prepared: Any = None
    """What ``Exporter.prepare`` returned."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportPart:
    """Some episodes of an export, which one process writes."""

    number: int
    """Parts are numbered from 0, in the order of ``Exporter.split``."""
    places: tuple[int, ...]
    """Numbers of the episodes in the export."""
    episodes: Iterable[tuple[int, Episode]]
    """The number and the record of each; they can be read once, and one at a time is in memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFolder:
    """An export that is read back. It may come from a stranger."""

    place: Place
    """The folder: files are read through it, with limits, and no link is followed."""
    episodes: int
    """Number of its episodes."""
    settings: Any
    """The settings that it was written with."""
    config: FactoryConfig
    """The first store's config."""
    fields: Mapping[str, Field]
    """The arrays of its stores, by path."""
    joints: int
    """Number of joints of the robot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoSettings:
    """Settings of an exporter that has none."""


def no_exclusions(episodes: Selection, settings: Any) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude no episode; the default for ``Exporter.excludes``."""
    return {}


def nothing(episodes: Selection, settings: Any) -> None:
    """Prepare nothing; the default for ``Exporter.prepare``."""


def nothing_more(job: ExportJob, parts: Sequence[Any]) -> None:
    """Write no more files; the default for ``Exporter.finish``."""


def equal_parts(episodes: Selection, settings: Any) -> list[range]:
    """Split the episodes into parts of ``EPISODES_PER_PART``; the last may be smaller."""
    return parts_of(len(episodes), EPISODES_PER_PART)


def episodes_of_each_file(n: int, chosen: int) -> int:
    """Return how many of n episodes each file shall hold, for formats whose parts are files.

    With 0 there are eight files, or more: workers share them here, and those of a data loader
    later. None has fewer than ``EPISODES_PER_PART`` episodes, but for the last, or more than 64.

    Args:
        n: number of all episodes.
        chosen: what the user asks for; 0 if nothing.
    """
    return chosen or min(max(math.ceil(n / _FILES), EPISODES_PER_PART), _MOST_PER_FILE)


def parts_of(n: int, size: int) -> list[range]:
    """Split n episodes into parts of a size; the last may be smaller."""
    return [range(start, min(start + size, n)) for start in range(0, n, size)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exporter:
    """One format to export to.

    The export is split into parts. ``write_part`` runs for each part, in worker processes and in
    any order; ``finish`` runs once, at the end, in the calling process. The files must not depend
    on the number of workers: the same episodes and settings yield the same bytes.
    """

    name: str
    description: str
    contents: ExportContents
    write_part: Callable[[ExportJob, ExportPart], Any]
    """Writes files of a part to ``job.folder``, and returns what ``finish`` needs to know: small,
    picklable data. Two parts write no file of the same name."""
    series: Sequence[str] | None = None
    """Paths of the time series that ``write_part`` needs, such as ``streams/object_pose``; None for
    all. Of the others an episode has ``timestamp`` alone. Without the videos, much less is read."""
    finish: Callable[[ExportJob, Sequence[Any]], None] = nothing_more
    """Writes the files that describe all episodes, from what the parts returned, in their order."""
    excludes: Callable[[Selection, Any], Mapping[str, NDArray[np.bool_]]] = no_exclusions
    """Returns the episodes that the format cannot hold, as one mask (n,) for each reason. It may
    raise ``UsageError`` for episodes or settings that cannot be exported together."""
    prepare: Callable[[Selection, Any], Any] = nothing
    """Returns what each part needs to know of all episodes, such as the numbers of classes: small,
    picklable data. It runs once, before the parts, on the episodes that are not excluded, and may
    raise ``UsageError`` as ``excludes`` does."""
    split: Callable[[Selection, Any], Sequence[Sequence[int]]] = equal_parts
    """Returns the parts: places of episodes, each in one part."""
    read_back: Callable[[ExportFolder, int], Mapping[str, NDArray[Any]]] | None = None
    """Returns the images and time series of an episode by path, those that the format holds, with
    the store's types and without padding. It raises ``ValueError``, ``KeyError`` or ``OSError``
    for files that are not as they were written. None if the format cannot be read back."""
    parameters: type[Any] = NoSettings
    """A frozen dataclass whose fields, all with defaults, are the format's settings."""
    libraries: Sequence[str] = ()
    """Top-level modules that it imports; the extra ``extra`` installs them."""
    extra: str = ""

    def settings(self, plain: Mapping[str, Any]) -> Any:
        """Return ``parameters`` from plain data; settings that are left out have their defaults.

        Raises:
            ConfigError: naming the key, what it got and what is valid.
        """
        return from_plain(self.parameters, plain, self.name)

    def check_libraries(self) -> None:
        """Check that the libraries are installed.

        Raises:
            UsageError: naming those that are missing, and how to install them.
        """
        require(*self.libraries, extra=self.extra)
