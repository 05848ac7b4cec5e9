"""One attempt to write a block: its files become the store's all together, or not at all.

Two processes may write one block at the same time: a process that counts as lost, because its
node was silent, and its replacement. Locks do not help: a stopped process would hold one for ever.
So attempts are numbered. An attempt

1. claims the next free number by creating ``<block>.claim-<number>.partial`` beside the block's
   marker. The file holds a random token;
2. removes the partial files of all attempts with lower numbers. Their names have their tokens;
3. writes all files of the block under partial names with its own token;
4. looks whether its claim is still the highest, and what the block holds now;
5. renames its partial files, the marker last, and removes the claims.

An attempt that stands between 4 and 5 while another one claims a higher number has lost its partial
files by the time the other renames anything. So files of two attempts never mix.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Sequence
from secrets import token_hex
from typing import Self

from grasp_factory.core.atomic_file import PARTIAL
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place, fsync_places
from grasp_factory.errors import RefusedFileError

MOST_CLAIMS = 8
"""Claims of a block that may be there at once: of attempts at work, and of killed ones. The next
number is for the only one who removes what is left of them: see ``remove_attempts``."""
TOKEN_BYTES = 8
_CLAIM = re.compile(r"([0-9]{1,12})\.claim-[0-9]" + re.escape(PARTIAL))
_DIGITS = f"[0-9a-f]{{{2 * TOKEN_BYTES}}}"
_TOKEN = re.compile(_DIGITS.encode())
ATTEMPT_FILE = rf"(\.claim-[0-9]|\.{_DIGITS})?{re.escape(PARTIAL)}"
"""Pattern of the end of a partial file's name, after the name of the block's own file."""


class SupersededError(Exception):
    """Another attempt has claimed the block since."""


class BlockAttempt:
    """An attempt to write a block, which holds a claim until it ends."""

    def __init__(
        self, marker: Place, files: Sequence[Place], numbers: range = range(MOST_CLAIMS)
    ) -> None:
        """Claim the block, and remove the partial files of earlier attempts.

        Args:
            marker: the file that commits the block.
            files: its other files, whether they exist or not.
            numbers: the claim has one of these numbers.

        Raises:
            SupersededError: if there are too many claims.
            OSError: if the disk fails.
        """
        self._marker, self._files = marker, files
        self._token = token_hex(TOKEN_BYTES)
        self._staged: dict[str, Place] = {}
        self._number = self._claim(numbers)
        self._fence()

    def stage(self, file: Place, data: bytes) -> None:
        """Write the content of one of the block's files, or of its marker, under a partial name.

        Raises:
            OSError: if the disk fails.
        """
        partial = self._staged[file.inner] = _of_attempt(file, self._token)
        with os.fdopen(partial.create(), "wb") as out:
            out.write(data)

    def sync(self) -> None:
        """Wait until the staged files are on the disk.

        Raises:
            OSError: if the disk fails.
            SupersededError: if they have been removed.
        """
        with _superseded_if_gone():
            fsync_places(self._staged.values())

    def check(self) -> None:
        """Check that no other attempt has claimed the block since.

        Raises:
            SupersededError: if one has.
        """
        later = range(self._number + 1, MOST_CLAIMS + 1)
        if _token_in(self._claim_at(self._number)) != self._token or any(
            self._claim_at(number).exists() for number in later
        ):
            raise SupersededError

    def publish(self) -> None:
        """Give the staged files their names, the marker last; remove what is not staged.

        Raises:
            SupersededError: if the staged files have been removed.
            OSError: if the disk fails.
        """
        with _superseded_if_gone():
            for file in self._files:
                staged = self._staged.get(file.inner)
                if staged is None:
                    file.unlink(missing_ok=True)
                else:
                    staged.replace(file)
                file.partial.unlink(missing_ok=True)  # of a version that had no attempts
            fsync_places(_folders(self._files))
            self._staged[self._marker.inner].replace(self._marker)
        fsync_places([self._marker.parent])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Remove the partial files of this attempt and its claim; after success, all older claims.

        After an error this is done as far as it can be: the next run does the rest.
        """
        if kind is not None:
            with contextlib.suppress(OSError):
                self._remove_staged()
                if _token_in(self._claim_at(self._number)) == self._token:
                    self._claim_at(self._number).unlink(missing_ok=True)
            return
        self._remove_staged()
        for number in range(self._number + 1):
            self._claim_at(number).unlink(missing_ok=True)

    def _remove_staged(self) -> None:
        for partial in self._staged.values():
            partial.unlink(missing_ok=True)

    def _claim(self, numbers: range) -> int:
        for number in numbers:
            with contextlib.suppress(FileExistsError):
                descriptor = self._claim_at(number).create()
                with os.fdopen(descriptor, "wb") as file:
                    file.write(self._token.encode())
                return number
        raise SupersededError

    def _fence(self) -> None:
        """Remove the partial files of attempts with lower numbers.

        A claim that has no token yet is of an attempt that has no partial file yet, and it will
        find this attempt's claim before it renames one.
        """
        for number in range(self._number):
            token = _token_in(self._claim_at(number))
            for file in (self._marker, *self._files) if token else ():
                _of_attempt(file, token).unlink(missing_ok=True)

    def _claim_at(self, number: int) -> Place:
        return _of_attempt(self._marker, f"claim-{number}")


def claimed_blocks(markers: Place) -> list[int]:
    """Return the blocks with claims, ascending; ``markers`` is the directory of all markers."""
    found = (_CLAIM.fullmatch(name) for name in markers.names())
    return sorted({int(match[1]) for match in found if match})


def remove_attempts(marker: Place, files: Sequence[Place], *, is_complete: bool) -> None:
    """Remove what attempts to write a block have left. Whoever calls this holds the store's lock.

    An attempt that still runs, on a node that counts as lost, cannot commit the block any more.

    Args:
        marker: the file that commits the block.
        files: its other files.
        is_complete: whether the block has all its rows.

    Raises:
        OSError: if the disk fails.
    """
    _of_attempt(marker, f"claim-{MOST_CLAIMS}").unlink(missing_ok=True)
    with BlockAttempt(marker, files, range(MOST_CLAIMS, MOST_CLAIMS + 1)):
        if is_complete:
            marker.partial.unlink(missing_ok=True)


def _folders(files: Sequence[Place]) -> list[Place]:
    """Return the folders of files, each once."""
    return list({file.parent.inner: file.parent for file in files}.values())


def _token_in(claim: Place) -> str:
    """Return the token in a claim; empty if the claim is gone, or has none yet."""
    try:
        content = claim.read_bytes(DOCUMENT)
    except (FileNotFoundError, RefusedFileError):
        return ""
    return content.decode() if _TOKEN.fullmatch(content) else ""


def _of_attempt(file: Place, word: str) -> Place:
    return file.parent / f"{file.name}.{word}{PARTIAL}"


@contextlib.contextmanager
def _superseded_if_gone() -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise SupersededError from None
