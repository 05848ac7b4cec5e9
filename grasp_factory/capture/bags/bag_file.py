"""A bag of ROS 1 or ROS 2 from anybody, opened by rosbags."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from grasp_factory.capture.bags.topic_bounds import METADATA, bound_topics, check_texts
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import GraspFactoryError, StoreError, UsageError, shown

_MCAP = b"\x89MCAP0\r\n"
"""The first and the last bytes of a file."""
_SUFFIXES = {b"#ROSBAG V2.0\n": ".bag", _MCAP: ".mcap", b"SQLite format 3\0": ".db3"}
"""Suffixes that rosbags tells the formats by, by how files of the formats begin."""
_VALID = (
    "valid: a .bag of ROS 1 (version 2.0), .mcap, .db3, a folder with metadata.yaml, or an export"
)
_URI_SIGNS = "%?#"
"""SQLite's reader takes a file's name for a part of a URI, in which these have a meaning."""


def bag_suffix(bag: Path) -> str:
    """Return the suffix that belongs to a bag's content; empty for a folder.

    Raises:
        UsageError: if it is no bag, a folder with links or other irregular files, or a database
            of SQLite that lacks changes which are in a file beside it.
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
        _check_settled(Path(os.path.realpath(bag)))  # SQLite writes beside what a link leads to
    except OSError as error:
        raise UsageError(f"{bag} cannot be read: {error.strerror or error}; {_VALID}") from None
    for magic, suffix in _SUFFIXES.items():
        if head.startswith(magic):
            return suffix
    raise UsageError(f"{bag} is no ROS bag and no export: it begins with {shown(head)}; {_VALID}")


def _check_folder(bag: Path) -> None:
    with os.scandir(bag) as entries:
        found = {entry.name: entry.is_file(follow_symlinks=False) for entry in entries}
    if "zarr.json" in found:
        raise UsageError(f"{bag} is a store, which is no bag and no export; {_VALID}")
    if METADATA not in found:
        raise UsageError(f"{bag} has no {METADATA}: name the .mcap or .db3 file in it; {_VALID}")
    for name, is_regular in sorted(found.items()):
        if not is_regular:
            raise UsageError(f"{bag / name} is a link, a folder or no regular file: remove it")
        if set(name) & set(_URI_SIGNS):
            raise UsageError(f"{bag / name}: got a name with one of {_URI_SIGNS}: rename it")
        _check_settled(bag / name)


def _check_settled(file: Path) -> None:
    """Check that a database of SQLite is complete without the files that SQLite keeps beside it.

    rosbags reads the database only. A write-ahead log has changes that are not in it yet; a
    rollback journal says how to undo changes of a writer that was killed, unless its first byte is
    zero (https://www.sqlite.org/fileformat2.html#the_rollback_journal).
    """
    log, journal = (Path(f"{file}{ending}") for ending in ("-wal", "-journal"))
    for beside, is_settled in ((log, b""), (journal, b"\0")):
        if _first_byte(beside) not in (b"", is_settled):
            raise UsageError(
                f"{beside} has changes that {file.name} lacks, as after a recorder was killed: let"
                " SQLite take them over, such as by: sqlite3 FILE.db3 'pragma quick_check'"
            )


def _first_byte(file: Path) -> bytes:
    """Return the first byte of a regular file; nothing if it is empty or not there."""
    if not file.is_file():
        return b""
    with file.open("rb") as opened:
        return opened.read(1)


def _check_end(bag: Path) -> None:
    """Check that a file of MCAP was written to its end."""
    with reading(bag), bag.open("rb") as file:
        file.seek(-len(_MCAP), os.SEEK_END)
        is_whole = file.read() == _MCAP
    if not is_whole:
        raise StoreError(
            f"{bag} cannot be read: it has no end, as after a recorder was killed; make it whole"
            " with `mcap recover`, or a session's folder with `grasp-factory capture recover`"
        )


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
    suffix = bag_suffix(bag)
    if suffix == ".mcap":
        _check_end(bag)
    with reading(bag):
        check_texts(bag, suffix)
    name = f"bag{suffix}"  # rosbags goes by the suffix
    (aside / name).symlink_to(bag.absolute())
    with contextlib.ExitStack() as stack:
        stack.enter_context(_temporary_files_in(aside))
        descriptor = os.open(aside, os.O_RDONLY | os.O_DIRECTORY)
        stack.callback(os.close, descriptor)
        link = Path("/proc/self/fd", str(descriptor), name)  # a path without _URI_SIGNS
        with reading(bag, link):
            humble = get_typestore(Stores.ROS2_HUMBLE)
            reader = AnyReader([link], default_typestore=humble)
            for part in reader.readers:
                bound_topics(bag, part)
            stack.enter_context(reader)
        for connection in reader.connections:
            _check_connection(bag, connection)
        yield reader


def _check_connection(bag: Path, connection: Connection) -> None:
    """Check the types of what rosbags passes on as it is in a database or in metadata.yaml."""
    topic: Any
    kind: Any
    topic, kind = connection.topic, connection.msgtype
    if not (isinstance(topic, str) and isinstance(kind, str) and is_integer(connection.msgcount)):
        got = shown((topic, kind, connection.msgcount))
        raise StoreError(
            f"{bag} is damaged: a topic: got {got}, valid: name, type and a number of messages"
        )


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
        with reading(bag, Path(str(reader.paths[0]))):
            found = next(messages, None)
        if found is None:
            return
        connection, time, _ = found
        if not is_integer(time):
            raise StoreError(
                f"{bag} is damaged: a message of {connection.topic} has the time {shown(time)},"
                " valid: an integer of nanoseconds"
            )
        yield found


@contextlib.contextmanager
def _temporary_files_in(folder: Path) -> Iterator[None]:
    """Let rosbags expand compressed files in a folder that is removed whatever happens."""
    before, tempfile.tempdir = tempfile.tempdir, str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = before
