"""The interface of exporters: each writes chosen episodes in the format of another tool."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.optional import require
from grasp_factory.core.schema import Field
from grasp_factory.core.serialization import from_plain


class EpisodeSource(Protocol):
    """The part of a dataset that exporters may use; ``Dataset`` implements and describes it.

    Reading raises ``StoreError`` where the store is damaged; an exporter does not catch it.
    """

    @property
    def path(self) -> Path:
        """Where the store is, for messages."""

    @property
    def config(self) -> FactoryConfig:
        """The settings that the episodes were made from."""

    @property
    def attributes(self) -> Mapping[str, Any]:
        """The root attributes of the store: robot, conventions, versions."""

    @property
    def fields(self) -> Mapping[str, Field]:
        """The store's arrays by path: dimensions, type, unit, frame, words of coded values."""

    @property
    def columns(self) -> Sequence[str]:
        """Names for ``column`` and ``value``."""

    @property
    def labels(self) -> Sequence[str]:
        """Names of the labels that were added to the store's own, for ``label``."""

    @property
    def annotations(self) -> Mapping[int, Any]:
        """The annotations of episodes, by row; ``to_plain`` converts each to plain data."""

    def __getitem__(self, index: int) -> Episode:
        """Return the episode at a row."""

    def spec(self, index: int) -> EpisodeSpec:
        """Return the recipe of an episode."""

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of all rows, (N, ...)."""

    def value(self, index: int, column: str) -> Any:
        """Return one column's value of one episode."""

    def label(self, name: str) -> NDArray[np.uint8]:
        """Return an added label's outcomes; rows added later have none, so it may be shorter."""

    def image(self, index: int, camera: str, kind: str, frame: int) -> NDArray[Any]:
        """Return one image: kind rgb, depth or segmentation; frame 0 before, 1 after."""

    def series(self, index: int, *names: str) -> dict[str, NDArray[Any]]:
        """Return some streams of one episode, unpadded, such as ``tcp_pose``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportJob:
    """The task of an exporter."""

    source: EpisodeSource
    rows: tuple[int, ...]
    """Rows that hold an episode, one or more, each once, in the order of the export."""
    out: Path
    """The file or folder to create. It does not exist yet, and its parent does."""
    settings: Any
    """An instance of the exporter's ``parameters``."""
    on_episode: Callable[[], None] = lambda: None
    """The exporter calls it after each episode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportContents:
    """Which of the store's contents an export has, and why it lacks the others.

    A name is an array's path in the store, ``labels/<name>`` or ``annotations``; ``*`` matches
    any text, as in ``cameras/*/rgb``. If a name with ``*`` in ``left_out`` also matches what
    ``written`` names, ``written`` takes precedence.
    """

    written: tuple[str, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    """A short reason for each name."""

    def not_mentioned(self, source: EpisodeSource) -> list[str]:
        """Return the dataset's contents that are neither written nor left out for a reason."""
        there = [*source.fields, *(f"labels/{name}" for name in source.labels), "annotations"]
        names = (*self.written, *self.left_out)
        return [path for path in there if not any(fnmatchcase(path, name) for name in names)]


@dataclass(frozen=True, slots=True, kw_only=True)
class NoSettings:
    """Settings of an exporter that has none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exporter:
    """One format to export to."""

    name: str
    description: str
    write: Callable[[ExportJob], ExportContents]
    """Creates ``job.out`` and nothing else, the same bytes for the same rows and settings.

    It may raise ``UsageError`` for episodes that the format cannot hold."""
    parameters: type[Any] = NoSettings
    """A frozen dataclass whose fields, all with defaults, are the format's settings."""
    suffix: str = ""
    """Suffix of a file in this format, lower case, such as ``.h5``; empty for a folder."""
    libraries: Sequence[str] = ()
    """Top-level modules that ``write`` imports; the extra ``extra`` installs them."""
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
