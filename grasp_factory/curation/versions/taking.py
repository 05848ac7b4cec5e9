"""Taking a snapshot of a store."""

from __future__ import annotations

import contextlib
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from grasp_factory import __version__
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.dataset.annotations.log import default_who
from grasp_factory.dataset.annotations.values import checked_who
from grasp_factory.dataset.snapshots import PresentVersion, Snapshot, SnapshotFolder
from grasp_factory.dataset.snapshots.snapshot import LONGEST_COMMAND, LONGEST_MESSAGE
from grasp_factory.dataset.snapshots.snapshot_folder import SegmentWriter, latest
from grasp_factory.errors import StoreError, UsageError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.header import read_attributes
from grasp_factory.writers.zarr.lock import StoreLock

_GIT_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """A snapshot of a store as it is."""

    id: str
    is_new: bool
    """False if the newest snapshot already has this content; then nothing was written."""
    rows: int
    committed: int
    quarantined: int
    parent: str | None
    contents_sha256: str
    bytes_written: int


def take_snapshot(store: Path | str, message: str, *, who: str = "") -> Taken:
    """Record the content of every row of a store in a new snapshot, beside the store.

    Args:
        store: path of the store; no run may write to it meanwhile.
        message: what is special about this state.
        who: name of the person; by default ``$GRASP_FACTORY_USER`` or the account's.

    Raises:
        UsageError: for an invalid message or name, or if there is no store.
        StoreError: if the store or a snapshot is damaged, a run writes to it, or the disk fails.
    """
    path, name = store_path(store), checked_who(who or default_who())
    text = _checked_message(message)
    read_attributes(path)
    folder = SnapshotFolder.of(path)
    with StoreLock(path):
        history = folder.history()
        new = SegmentWriter(folder)
        with _naming(folder):
            contents = PresentVersion(path, new.write).contents
        parent = latest(history)
        if parent is not None and history[0][1].contents == contents:
            return _taken(parent, history[0][1], size=0, is_new=False)
        snapshot = Snapshot(
            parent=parent,
            message=text,
            who=name,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            store=locate(path).name,
            revision=source_revision(),
            command=shlex.join(sys.argv)[:LONGEST_COMMAND],
            grasp_factory=__version__,
            contents=contents,
        )
        with _naming(folder):
            folder.add(snapshot, new.written)
    return _taken(snapshot.id, snapshot, size=new.bytes + len(snapshot.to_bytes()), is_new=True)


@contextlib.contextmanager
def _naming(folder: SnapshotFolder) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(f"{folder.place} cannot be written: {error.strerror}") from None


def source_revision() -> str:
    """Return the commit of the current directory's Git repository; empty without one.

    Changes that are not committed are not seen.
    """
    git = shutil.which("git")
    if git is None:
        return ""
    command = [git, "rev-parse", "--verify", "--quiet", "HEAD"]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_GIT_S)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.decode("ascii", "replace").strip()[:64] if not done.returncode else ""


def _taken(name: str, snapshot: Snapshot, *, size: int, is_new: bool) -> Taken:
    contents = snapshot.contents
    return Taken(
        id=name,
        is_new=is_new,
        rows=contents.rows,
        committed=contents.committed,
        quarantined=contents.quarantined,
        parent=snapshot.parent,
        contents_sha256=contents.sha256,
        bytes_written=size,
    )


def _checked_message(message: str) -> str:
    text = message.strip()
    ok = text and len(text) <= LONGEST_MESSAGE
    ok = ok and all(line.replace("\t", " ").isprintable() for line in text.splitlines())
    if not ok:
        raise UsageError(f"-m: valid: a text of 1 to {LONGEST_MESSAGE} printable characters")
    return text
