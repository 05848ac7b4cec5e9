"""The source files that this process may run: the user named them, or trusts the store with them.

Nothing else is run. A worker process gets the sources of the process that starts it, so it does not
read the files again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.cache import digest
from grasp_factory.core.limits import SOURCE
from grasp_factory.errors import PluginError


@dataclass(frozen=True, slots=True, kw_only=True)
class PluginSource:
    """The source of a single file."""

    name: str
    """Name of the file, without folders."""
    content: bytes
    path: str = ""
    """Where it was read; empty if it came with a store."""

    @property
    def sha256(self) -> str:
        """The SHA-256 of the content."""
        return digest(self.content)


_ALLOWED: dict[str, PluginSource] = {}


def read_source(path: Path | str) -> PluginSource:
    """Return the source in a file of the user.

    Raises:
        PluginError: if it cannot be read, or is no Python file.
        LimitError: if it is larger than the limit.
    """
    path = Path(path)
    if path.suffix != ".py" or not path.is_file():
        why = "is not there" if path.suffix == ".py" else "is no Python file"
        raise PluginError(f"{path} {why}, valid: the path of a file that ends in .py")
    try:
        with path.open("rb") as file:
            content = file.read(SOURCE.most + 1)
    except OSError as error:
        raise PluginError(f"{path} cannot be read: {error.strerror}") from None
    SOURCE.check(len(content), path)
    return PluginSource(name=path.name, content=content, path=str(path.absolute()))


def allow(sources: Iterable[PluginSource]) -> None:
    """Let this process and the worker processes that it starts run these sources."""
    for source in sources:
        _ALLOWED[source.sha256] = source


def allow_file(path: Path | str) -> PluginSource:
    """Let this process run a file of the user, and return its source; see ``read_source``."""
    source = read_source(path)
    allow([source])
    return source


def allowed() -> tuple[PluginSource, ...]:
    """Return the sources that this process may run."""
    return tuple(_ALLOWED.values())


def allowed_source(sha256: str) -> PluginSource | None:
    """Return a source that this process may run; None if it may not."""
    return _ALLOWED.get(sha256)
