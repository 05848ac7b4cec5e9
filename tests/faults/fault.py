"""A fault: a mistake that somebody could make, as a change of one text in the package."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

PACKAGE = "grasp_factory"
_ROOM_OF_ROOT = {"torch.py": "apps", "__main__.py": "cli"}
"""Which room's tests are about a module of the package's root."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A change after which the package still imports, and does something wrong."""

    name: str
    file: str
    """Below the package."""
    old: str
    """It occurs exactly once in the file."""
    new: str
    tests: tuple[str, ...]
    """Files or folders below ``tests`` that should catch it."""

    @property
    def room(self) -> str:
        """The folder below ``tests`` that is about the file."""
        first = Path(self.file).parts[0]
        return _ROOM_OF_ROOT.get(first, first)

    @property
    def module(self) -> str:
        """Name of the changed module; of a file that is not Python, the package's."""
        if not self.is_python:
            return PACKAGE
        return f"{PACKAGE}.{self.file.removesuffix('.py').replace('/', '.')}"

    @property
    def is_python(self) -> bool:
        """Whether the changed file is a module."""
        return self.file.endswith(".py")

    def text(self, repository: Path) -> str:
        """Return the file as it is."""
        return (repository / PACKAGE / self.file).read_text(encoding="utf-8")

    def changed(self, text: str) -> str:
        """Return the file's text with the fault in it.

        Raises:
            ValueError: if the old text does not occur exactly once.
        """
        count = text.count(self.old)
        if count != 1:
            raise ValueError(f"{self.name}: its text occurs {count} times in {self.file}")
        return text.replace(self.old, self.new)

    def seed(self, repository: Path) -> None:
        """Write the fault into a copy of the repository."""
        text = self.changed(self.text(repository))
        (repository / PACKAGE / self.file).write_text(text, encoding="utf-8")
