"""The folder of a card: which files a card wrote, so that only unchanged ones are replaced.

The README ends with a comment that has the digest of every file of the card and of its own text.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import Place
from grasp_factory.errors import StoreError, UsageError
from grasp_factory.writers.zarr.files import cannot_write, locate

README = "README.md"
_HEAD = "<!-- Written by grasp-factory card, which replaces these files until somebody changes one:"
_DIGEST = re.compile(r"([0-9a-f]{64})  (.+)")


def check_folder(out: Path, store: Path) -> None:
    """Check that a card may be written to a folder.

    Raises:
        UsageError: if it is a file, or inside a Zarr store, whose readers warn of foreign files.
    """
    out = locate(out)
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out}: is a file, valid: a folder, which may be a new one")
    for folder in (out, *out.parents):
        if folder == locate(store) or (folder / "zarr.json").exists():
            what = (
                f"--out {out}: lies in the Zarr store {folder}, whose readers warn of other files"
            )
            raise UsageError(f"{what}, valid: a folder beside it")


def foreign_files(out: Place, names: Iterable[str]) -> list[str]:
    """Return the names of existing files that no card has written, or that were changed since.

    Raises:
        StoreError: if one cannot be read, or is a link.
    """
    there = [name for name in names if (out / name).exists()]
    if not there:
        return []
    try:
        sealed = _sealed(out / README)
        return [name for name in there if sealed.get(name) != _digest_in(out, name)]
    except OSError as error:
        raise StoreError(f"{error.filename} cannot be read: {error.strerror}") from None


def place(files: Mapping[str, Path], out: Place) -> None:
    """Move finished files to their names in a folder. Nothing outside of it is written.

    Raises:
        StoreError: if the disk or its permissions do not allow it.
    """
    try:
        for name, file in files.items():
            target = out / name
            target.parent.mkdir(exist_ok=True)
            with target.above() as (above, leaf):
                os.replace(file, leaf, dst_dir_fd=above)
    except OSError as error:
        raise cannot_write(out.path, error) from None


def seal(text: str, digests: Mapping[str, str]) -> str:
    """Return a README's text with the digests of all files at its end.

    Args:
        text: The README's text without digests; it ends with a newline.
        digests: SHA-256 of the other files by name.
    """
    own = {README: hashlib.sha256(text.encode()).hexdigest()}
    lines = [f"{digest}  {name}" for name, digest in sorted({**digests, **own}.items())]
    return "\n".join([text, _HEAD, *lines, "-->"]) + "\n"


def digest(file: Path) -> str:
    """Return the SHA-256 of a file."""
    with file.open("rb") as data:
        return hashlib.file_digest(data, "sha256").hexdigest()


def _sealed(readme: Place) -> dict[str, str]:
    """Return the digests in a README; empty if no card has written it."""
    if not readme.is_file():
        return {}
    _, head, rest = readme.read_bytes(DOCUMENT).decode(errors="replace").rpartition(_HEAD)
    lines = rest.splitlines() if head else []
    found = [match for line in lines if (match := _DIGEST.fullmatch(line))]
    return {match[2]: match[1] for match in found}


def _digest_in(out: Place, name: str) -> str:
    file = out / name
    if not file.is_file():
        return "no file"
    if name != README:
        with open(file.open(), "rb") as data:
            return hashlib.file_digest(data, "sha256").hexdigest()
    text, _, end = file.read_bytes(DOCUMENT).rpartition(f"\n{_HEAD}\n".encode())
    is_whole = re.fullmatch(rb"([0-9a-f]{64}  [^\n]+\n)+-->\n", end) is not None
    return hashlib.sha256(text).hexdigest() if is_whole else "no digests, or more than these"
