"""List the files of a folder that may be objects, and read only files inside the folder."""

from __future__ import annotations

import contextlib
import os
import stat
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from grasp_factory.errors import UsageError
from grasp_factory.objects.importing.base import Refusal, UnusableError
from grasp_factory.objects.importing.file_kinds import OTHER_SUFFIXES, SUFFIXES

SETTINGS_FILE = "objects.yaml"
NOT_SETTINGS = f"objects.yml is not read: settings are looked for in {SETTINGS_FILE}"
MAX_BYTES = 200 * 2**20
"""Largest size of a file."""
MAX_DEPTH = 16
"""Levels of nested folders."""
MAX_ENTRIES = 100_000
"""Largest number of files and folders."""


@dataclass(frozen=True, slots=True)
class Listing:
    """The files of a folder that may be objects; paths are relative, with slashes."""

    files: tuple[str, ...]
    refused: tuple[Refusal, ...]
    warnings: tuple[str, ...] = ()


def list_files(root: Path) -> Listing:
    """Find all entries below ``root`` whose suffix is that of an object, sorted by path.

    Raises:
        UsageError: if the folder cannot be read, or holds more than ``MAX_ENTRIES``.
    """
    files: list[str] = []
    others: list[str] = []
    refused: list[Refusal] = []
    try:
        for seen, (path, entry) in enumerate(_walk(root, "", 0, refused)):
            if seen >= MAX_ENTRIES:
                raise UsageError(f"{root} holds more than {MAX_ENTRIES} files: split it up")
            if suffix(path) in SUFFIXES:
                reason = _reason_against(path, entry)
                if reason:
                    refused.append(Refusal(file=path, reason=reason))
                else:
                    files.append(path)
            elif suffix(path) in OTHER_SUFFIXES:
                others.append(path)
    except OSError as error:
        raise UsageError(f"the folder {root} cannot be read: {error.strerror}") from None
    warnings = (NOT_SETTINGS,) if os.path.lexists(root / "objects.yml") else ()
    if others:
        warnings = (*warnings, _not_read(sorted(others)))
    return Listing(tuple(sorted(files)), tuple(refused), warnings)


def _not_read(files: Sequence[str]) -> str:
    """Return a warning of files in formats that are not read."""
    named = f"{files[0]} is" if len(files) == 1 else f"{files[0]} and {len(files) - 1} more are"
    return f"{named} not read: convert to one of {', '.join(SUFFIXES)}"


def suffix(path: str) -> str:
    """Return the suffix of a name, in lower case and without the dot."""
    return PurePosixPath(path).suffix.lower().removeprefix(".")


def keys(files: Sequence[str]) -> dict[str, str]:
    """Return an id for each file: its path, without the suffix unless two ids would be equal."""
    stems = {file: str(PurePosixPath(file).with_suffix("")) for file in files}
    counts = Counter(stems.values())
    return {
        file: stem if counts[stem] == 1 and stem not in stems else file
        for file, stem in stems.items()
    }


def read_inside(root: Path, path: str) -> bytes:
    """Return the content of a regular file below ``root``.

    Each part of the path is opened relative to the one before, and no link is followed. So no
    path in a file of the folder, and no renaming meanwhile, can open anything outside.

    Raises:
        UnusableError: if there is no such file, or it cannot be read.
    """
    parts = PurePosixPath(path).parts
    if not parts or path.startswith("/") or ".." in parts or "\0" in path:
        raise UnusableError("it lies outside the folder")
    with contextlib.ExitStack() as stack:
        try:
            at = _open(stack, root, None, os.O_DIRECTORY)
            for part in parts[:-1]:
                at = _open(stack, part, at, os.O_DIRECTORY | os.O_NOFOLLOW)
            at = _open(stack, parts[-1], at, os.O_NOFOLLOW | os.O_NONBLOCK)  # a FIFO would block
            status = os.fstat(at)
            if not stat.S_ISREG(status.st_mode):
                raise UnusableError("it is no regular file")
            if status.st_size > MAX_BYTES:
                raise UnusableError(f"it has more than {MAX_BYTES // 2**20} MiB")
            with open(at, "rb", closefd=False) as file:
                data = file.read(MAX_BYTES + 1)
        except OSError as error:
            raise UnusableError(f"it cannot be read: {error.strerror}") from None
    if len(data) > MAX_BYTES:
        raise UnusableError(f"it has more than {MAX_BYTES // 2**20} MiB")
    return data


def _open(stack: contextlib.ExitStack, path: str | Path, at: int | None, flags: int) -> int:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | flags, dir_fd=at)
    stack.callback(os.close, descriptor)
    return descriptor


def _walk(
    root: Path, below: str, depth: int, refused: list[Refusal]
) -> Iterator[tuple[str, os.DirEntry[str]]]:
    with os.scandir(root / below) as entries:
        found = sorted(entries, key=lambda entry: entry.name)
    for entry in found:
        path = f"{below}/{entry.name}" if below else entry.name
        yield path, entry
        if not entry.is_dir(follow_symlinks=False):
            continue
        if depth >= MAX_DEPTH:
            refused.append(Refusal(file=path, reason=f"more than {MAX_DEPTH} folders deep"))
            continue
        try:
            yield from _walk(root, path, depth + 1, refused)
        except OSError as error:
            refused.append(Refusal(file=path, reason=f"it cannot be read: {error.strerror}"))


def _reason_against(path: str, entry: os.DirEntry[str]) -> str:
    """Return why an entry cannot be an object; empty if it may be one."""
    if entry.is_symlink():
        return "it is a symbolic link, and none is followed: copy the file"
    if entry.is_dir(follow_symlinks=False):
        return "it is a folder"
    if not entry.is_file(follow_symlinks=False):
        return "it is no regular file"
    if not path.isprintable() or len(path) > 500:
        return "its name cannot be printed, or is too long: rename it"
    return ""
