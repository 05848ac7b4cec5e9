"""A bag of ROS 1 or ROS 2 from anybody, opened by rosbags."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from grasp_factory.errors import GraspFactoryError, StoreError, UsageError, shown

_SUFFIXES = {b"#ROSBAG V2.0\n": ".bag", b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\0": ".db3"}
"""Suffixes that rosbags tells the formats by, by how files of the formats begin."""
_METADATA = "metadata.yaml"
_VALID = "valid: a .bag of ROS 1 (version 2.0), .mcap, .db3, or a folder with metadata.yaml"
_URI_SIGNS = "%?#"
"""SQLite's reader takes a file's name for a part of a URI, in which these have a meaning."""


def bag_suffix(bag: Path) -> str:
    """Return the suffix that belongs to a bag's content; empty for a folder.

    Raises:
        UsageError: if it is no bag, or a folder with links or other irregular files.
    """
    try:
        mode = bag.stat().st_mode
        if stat.S_ISDIR(mode):
            _check_folder(bag)
            return ""
        if not stat.S_ISREG(mode):
            raise UsageError(f"{bag} is no regular file; {_VALID}")
        with bag.open("rb") as file:
            head = file.read(max(map(len, _SUFFIXES)))
    except OSError as error:
        raise UsageError(f"{bag} cannot be read: {error.strerror or error}; {_VALID}") from None
    for magic, suffix in _SUFFIXES.items():
        if head.startswith(magic):
            return suffix
    raise UsageError(f"{bag} is no ROS bag: it begins with {shown(head)}; {_VALID}")


def _check_folder(bag: Path) -> None:
    with os.scandir(bag) as entries:
        found = {entry.name: entry.is_file(follow_symlinks=False) for entry in entries}
    if _METADATA not in found:
        raise UsageError(f"{bag} has no {_METADATA}: name the .mcap or .db3 file in it; {_VALID}")
    for name, is_regular in sorted(found.items()):
        if not is_regular:
            raise UsageError(f"{bag / name} is a link, a folder or no regular file: remove it")
        if set(name) & set(_URI_SIGNS):
            raise UsageError(f"{bag / name}: got a name with one of {_URI_SIGNS}: rename it")


@contextlib.contextmanager
def opened(bag: Path, aside: Path) -> Iterator[AnyReader]:
    """Yield a reader of a bag.

    Args:
        bag: the bag.
        aside: a folder for temporary files.

    Raises:
        UsageError: if it is no bag.
        StoreError: if it is damaged.
    """
    link = aside / f"bag{bag_suffix(bag)}"  # rosbags goes by the suffix, and SQLite by a URI
    link.symlink_to(bag.absolute())
    with contextlib.ExitStack() as stack:
        stack.enter_context(_temporary_files_in(aside))
        with reading(bag, link):
            humble = get_typestore(Stores.ROS2_HUMBLE)
            reader = stack.enter_context(AnyReader([link], default_typestore=humble))
        yield reader


@contextlib.contextmanager
def reading(bag: Path, link: Path | None = None) -> Iterator[None]:
    """Turn whatever a library raises at a damaged bag into one error.

    Raises:
        StoreError: naming the bag.
    """
    try:
        yield
    except (MemoryError, GraspFactoryError):
        raise
    except Exception as error:
        text = str(error).replace(str(link or bag), str(bag))
        raise StoreError(f"{bag} cannot be read: {type(error).__name__}: {text[:300]}") from None


def raw_messages(
    bag: Path, reader: AnyReader, connections: Sequence[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield connection, time of arrival (ns) and bytes of the messages of some connections.

    Raises:
        StoreError: if the bag is damaged.
    """
    if not connections:  # to rosbags it means all of them
        return
    messages = reader.messages(connections=connections)
    while True:
        with reading(bag):
            found = next(messages, None)
        if found is None:
            return
        yield found


@contextlib.contextmanager
def _temporary_files_in(folder: Path) -> Iterator[None]:
    """Let rosbags expand compressed files in a folder that is removed whatever happens."""
    before, tempfile.tempdir = tempfile.tempdir, str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = before
