"""What is below a directory of a store, and waiting until all of it is on the disk."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from typing import NamedTuple

from grasp_factory.core.limits import DEPTH
from grasp_factory.core.object_storage.object_place import ObjectPlace
from grasp_factory.core.place import Place, fsync_places
from grasp_factory.core.regular_file import irregular


class Entries(NamedTuple):
    """The names in a directory, sorted."""

    folders: list[str]
    files: list[str]
    others: list[str]
    """Links, pipes and devices."""


def entries(place: Place) -> Entries:
    """Return what is in a directory."""
    if isinstance(place, ObjectPlace):
        return Entries(*place.entries(), [])
    out = Entries([], [], [])
    descriptor = place.open_directory()
    try:
        with os.scandir(descriptor) as found:
            for entry in found:
                is_dir = entry.is_dir(follow_symlinks=False)
                is_file = entry.is_file(follow_symlinks=False)
                (out.folders if is_dir else out.files if is_file else out.others).append(entry.name)
    finally:
        os.close(descriptor)
    return Entries(*map(sorted, out))


def file_facts(place: Place) -> Iterator[tuple[str, os.stat_result]]:
    """Yield name and facts of each file in a directory, in no order."""
    if isinstance(place, ObjectPlace):
        yield from place.file_facts()
        return
    descriptor = place.open_directory()
    try:
        with os.scandir(descriptor) as found:
            for entry in found:
                if entry.is_file(follow_symlinks=False):
                    yield entry.name, entry.stat(follow_symlinks=False)
    finally:
        os.close(descriptor)


def files_below(place: Place, without: Collection[str] = ()) -> Iterator[Place]:
    """Yield all files below a directory, at any depth.

    Args:
        place: the directory.
        without: the paths below the root of directories that are left out.

    Raises:
        IrregularFileError: if a link or an irregular file is there.
        LimitError: if directories are nested too deep.
    """
    DEPTH.check(place.inner.count("/"), place.path)
    if isinstance(place, ObjectPlace):
        for file, _ in place.files_below():
            if not any(file.inner.startswith(f"{folder}/") for folder in without):
                yield file
        return
    found = entries(place)
    for name in found.others:
        raise irregular(place.path / name)
    for name in found.folders:
        if (place / name).inner not in without:
            yield from files_below(place / name, without)
    for name in found.files:
        yield place / name


def file_facts_below(place: Place) -> Iterator[tuple[Place, os.stat_result]]:
    """Yield all files below a directory with their facts; see ``files_below``."""
    if isinstance(place, ObjectPlace):
        yield from place.files_below()
        return
    for file in files_below(place):
        yield file, file.stat()


def fsync_tree(place: Place) -> None:
    """Wait until everything below a directory, and the directory itself, is on the disk.

    Raises:
        OSError: if the disk fails.
    """
    fsync_places(_tree(place))


def _tree(place: Place) -> Iterator[Place]:
    for below in place.glob("*"):
        yield from _tree(below)
    yield place
