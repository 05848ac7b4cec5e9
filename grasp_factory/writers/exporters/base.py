"""What an exporter is: it writes chosen episodes of a dataset in the format of another tool."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import from_plain


class EpisodeSource(Protocol):
    """What an exporter reads from: ``Dataset`` is one."""

    @property
    def config(self) -> FactoryConfig:
        """The settings that the episodes were made from."""

    @property
    def attributes(self) -> Mapping[str, Any]:
        """The root attributes of the store: robot, conventions, versions."""

    def __getitem__(self, index: int) -> Episode:
        """Return the episode at a row."""

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of all rows, (N, ...)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportJob:
    """What an exporter is asked to do."""

    source: EpisodeSource
    rows: tuple[int, ...]
    """Rows that hold an episode, in the order in which they are exported."""
    out: Path
    """The file or folder to create. It does not exist yet, and its parent does."""
    settings: Any
    """An instance of the exporter's ``parameters``."""
    on_episode: Callable[[], None] = lambda: None
    """To be called after each episode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportContents:
    """What an exporter wrote, for people: each thing in a few words."""

    written: tuple[str, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    """What the dataset has and the export has not, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoSettings:
    """Settings of an exporter that has none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exporter:
    """One format to export to."""

    name: str
    description: str
    write: Callable[[ExportJob], ExportContents]
    """Creates ``job.out``. It may raise ``UsageError`` for episodes that the format cannot hold."""
    parameters: type[Any] = NoSettings
    """A frozen dataclass whose fields, all with defaults, are the format's settings."""
    suffix: str = ""
    """How the name of a file in this format ends, such as ``.h5``; empty for a folder."""
    libraries: Sequence[str] = ()
    """Modules that ``write`` imports, of the extra ``extra``."""
    extra: str = ""

    def settings(self, plain: Mapping[str, Any]) -> Any:
        """Return ``parameters`` from plain data; what is left out takes its default.

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
