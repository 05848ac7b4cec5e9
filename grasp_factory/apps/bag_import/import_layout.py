"""The interface of layouts to import to."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from grasp_factory.apps.bag_import.bag_topics import BagTopic


class ImportLayout(ABC):
    """Writes the messages of chosen topics to a new folder.

    Attributes:
        left_out: chosen topics that have no place in the layout, with the reason.
    """

    left_out: dict[str, str]

    @abstractmethod
    def add(self, topic: BagTopic, stamp_ns: int, message: Any) -> None:
        """Write what a message holds.

        Raises:
            ValueError: if it cannot be decoded; nothing is written.
            OSError: if the disk fails.
        """

    @abstractmethod
    def finish(self) -> None:
        """Write what describes all of it.

        Raises:
            OSError: if the disk fails.
        """

    @abstractmethod
    def close(self) -> None:
        """Close all files, also after an error."""
