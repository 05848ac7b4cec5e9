"""The list of episodes that a person makes on the page, and the CSV file that holds it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from grasp_factory.capture.importing.cuts import Cut, check_apart, cuts_text, parsed_cuts, read_text
from grasp_factory.core.atomic_file import write_atomic
from grasp_factory.errors import UsageError


@dataclass(slots=True)
class CuttingDocument:
    """A file of cuts that a page reads and replaces; times are ns from the session's start."""

    file: Path
    _text: str | None = None
    """Its content as it was read or written last; None while there is no file."""
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def open(cls, file: Path) -> CuttingDocument:
        """Read the file, if there is one.

        Raises:
            UsageError: if it cannot be read, is no list of cuts, or cannot be made.
        """
        if not file.parent.is_dir():
            raise UsageError(f"--out {file}: there is no folder {file.parent}; make it first")
        document = cls(file, _content(file))
        document.cuts()
        return document

    def cuts(self) -> tuple[Cut, ...]:
        """Return the episodes of the file."""
        return parsed_cuts(self._text, str(self.file)) if self._text else ()

    def save(self, cuts: Sequence[Cut]) -> None:
        """Write the file.

        Raises:
            UsageError: if two episodes overlap, something else changed the file meanwhile, or it
                cannot be written.
        """
        ordered = sorted(cuts, key=lambda cut: cut.start_ns)
        check_apart(ordered, 0)
        text = cuts_text(ordered)
        with self._lock:
            if _content(self.file) != self._text:
                raise UsageError(
                    f"{self.file} was changed by something else since this page read it; load the"
                    " page again to see it, or move it away"
                )
            try:
                write_atomic(self.file, text.encode(), durable=True)
            except OSError as error:
                raise UsageError(f"{self.file} cannot be written: {error}") from None
            self._text = text


def _content(file: Path) -> str | None:
    return read_text(file) if file.exists() or file.is_symlink() else None
