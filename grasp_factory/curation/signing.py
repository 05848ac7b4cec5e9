"""Signing a store: who made its bytes.

Checksums tell whether bytes have changed; anybody can compute them again. A signature is made with
a private key. It covers a list of the SHA-256 of every file, in the format of ``sha256sum``, and is
made and checked by ``ssh-keygen -Y`` of OpenSSH 8.1 or newer, which needs no network.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.disk_usage import bytes_on_disk
from grasp_factory.core.limits import DOCUMENT, SIGNED
from grasp_factory.core.place import Place, fsync_places, place_of
from grasp_factory.core.place_tree import files_below
from grasp_factory.core.text_format import size_text
from grasp_factory.errors import MissingLibraryError, StoreError, UsageError, shown
from grasp_factory.writers.zarr.header import read_attributes
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.placeholder import write_placeholder

FOLDER = "signature"
SUMS, SIGNATURE = "SHA256SUMS", "SHA256SUMS.sig"
NAMESPACE = "grasp-factory-store"
"""Keeps a signature of something else, such as a Git commit, from being used for a store."""
_DESCRIPTION = "SHA-256 of every other file of this store, and an SSH signature of that list"
_SIGNER = "signer"
_KEY = re.compile(r"(sk-)?(ssh|ecdsa)-[a-z0-9@.-]+ [A-Za-z0-9+/=]+")
_LINE = re.compile(rb"([0-9a-f]{64})  ([^\n]{1,4096})\n")
_MOST_MISSING = 1000
"""Files that a list has and a store has not: so many are named."""
_PART = 2**20
_LARGE, _MOST_SPARSE = 64 * 2**20, 64


@dataclass(frozen=True, slots=True, kw_only=True)
class SignatureReport:
    """What a signature says of a store."""

    files: int
    """Files that are as they were signed."""
    problems: tuple[str, ...]
    """Why the store is not the signed one; empty if it is."""


def sign(
    store: Path,
    key: Path,
    on_start: Callable[[int], None] = lambda files: None,
    on_file: Callable[[], None] = lambda: None,
) -> int:
    """Sign the files of a store with a private key; return their number.

    Args:
        store: the path of the store; nothing may write to it meanwhile.
        key: the path of a private SSH key, or of a public key whose private key an agent holds.
        on_start: called with the number of files to read.
        on_file: called after each file.

    Raises:
        StoreMismatchError: if there is no store.
        StoreError: if it cannot be read or written, or is in use.
        UsageError: if the key cannot sign.
    """
    read_attributes(store)
    if key.exists() and not key.is_file():
        raise UsageError(f"{key} cannot sign: it is no file; name a private SSH key")
    with StoreLock(store):
        place = place_of(store)
        is_first = not (place / FOLDER).exists()
        write_placeholder(place, FOLDER, _DESCRIPTION)
        lines = [
            f"{digest}  {name}\n" for name, digest in _digests(_files(place), on_start, on_file)
        ]
        text = "".join(lines).encode()
        signature = _ssh_keygen("sign", "-q", "-f", str(key), "-n", NAMESPACE, given=text)
        if signature.returncode:
            if is_first:
                (place / FOLDER).rmtree()
            raise UsageError(f"{key} cannot sign: {_said(signature)}; name a private SSH key")
        try:
            (place / FOLDER / SUMS).write(text, durable=True)
            (place / FOLDER / SIGNATURE).write(signature.stdout, durable=True)
            fsync_places([place / FOLDER])
        except OSError as error:
            what = f"{store / FOLDER} cannot be written"
            raise StoreError(f"{what}: {error.strerror or error}") from None
    return len(lines)


def check_signature(
    store: Path,
    key: Path,
    on_start: Callable[[int], None] = lambda files: None,
    on_file: Callable[[], None] = lambda: None,
) -> SignatureReport:
    """Compare a store with what the owner of a key has signed.

    Args:
        store: the path of the store.
        key: the path of the signer's public SSH key, a file like ``id_ed25519.pub``.
        on_start: called with the number of files to read.
        on_file: called after each file.

    Raises:
        StoreMismatchError: if there is no store.
        StoreError: if the store cannot be read.
        UsageError: if there is no public key at ``key``.
    """
    read_attributes(store)
    place, public = place_of(store), _public_key(key)
    try:
        text = (place / FOLDER / SUMS).read_bytes(SIGNED)
        signature = (place / FOLDER / SIGNATURE).read_bytes(DOCUMENT)
    except (FileNotFoundError, NotADirectoryError):
        return SignatureReport(files=0, problems=("the store is not signed",))
    if not _is_by(public, text, signature):
        return SignatureReport(files=0, problems=(f"the signature is not by the key {key}",))
    here = _files(place)
    signed, missing = _signed(io.BytesIO(text), here)
    if signed is None:
        return SignatureReport(
            files=0, problems=("its list of files is not in the form of sha256sum",)
        )
    known = {name: file for name, file in here.items() if name in signed}
    digests = dict(_digests(known, on_start, on_file))
    changed = [name for name, digest in digests.items() if digest != signed[name]]
    found = (
        ("missing", missing),
        ("changed since it was signed", changed),
        ("not signed", [name for name in here if name not in signed]),
    )
    problems = tuple(f"{shown(name)} is {what}" for what, names in found for name in names)
    return SignatureReport(files=len(known) - len(changed), problems=problems)


def _signed(
    lines: Iterable[bytes], here: Collection[str]
) -> tuple[dict[str, str] | None, list[str]]:
    """Return the digests of files that are here by name, and the names of the first others.

    The digests are None if a line is not in the form of ``sha256sum``. The maker of a list may have
    put millions of names in it.
    """
    digests: dict[str, str] = {}
    missing: list[str] = []
    for line in lines:
        found = _LINE.fullmatch(line)
        if found is None:
            return None, []
        name = found[2].decode("utf-8", "replace")
        if name in here:
            digests[name] = found[1].decode("ascii")
        elif len(missing) < _MOST_MISSING:
            missing.append(name)
    return digests, missing


def _files(store: Place) -> dict[str, Place]:
    """Return the files of a store by path in it, except the signature's own.

    Raises:
        StoreError: if a name cannot be in a list of lines.
    """
    own = {f"{FOLDER}/{SUMS}", f"{FOLDER}/{SIGNATURE}"}
    files = {name: file for file in files_below(store) if (name := file.below(store)) not in own}
    for name in files:
        if not name.isprintable():
            raise StoreError(f"{store}: a file has the name {shown(name)}: remove it")
    return files


def _digests(
    files: Mapping[str, Place], on_start: Callable[[int], None], on_file: Callable[[], None]
) -> Iterator[tuple[str, str]]:
    """Yield path and SHA-256 of each file."""
    on_start(len(files))
    for name, file in files.items():
        yield name, _digest(file)
        on_file()


def _digest(file: Place) -> str:
    found = hashlib.sha256()
    with os.fdopen(file.open(), "rb") as opened:
        _check_dense(opened.fileno(), file)
        while part := opened.read(_PART):
            found.update(part)
    return found.hexdigest()


def _check_dense(descriptor: int, file: Place) -> None:
    """Check that reading a file takes no longer than writing it did.

    Raises:
        StoreError: if it is large, and nearly all of it is not on the disk.
    """
    found = os.fstat(descriptor)
    stored = bytes_on_disk(found)
    if found.st_size > _LARGE and stored < found.st_size // _MOST_SPARSE:
        what = f"{size_text(found.st_size)}, of which {size_text(stored)} are on the disk"
        raise StoreError(f"{file} has {what}, and no store has such a file: remove it")


def _public_key(file: Path) -> str:
    """Return type and key of a public key's file, or of a pipe that a shell has opened."""
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        os.set_blocking(descriptor, True)  # a pipe without a writer is at its end
        with os.fdopen(descriptor, "rb") as opened:
            text = opened.read(DOCUMENT.usual).decode("utf-8", "replace")
    except OSError as error:
        raise UsageError(f"key {file} cannot be read: {error.strerror}") from None
    found = _KEY.match(text)
    if not found:
        what = "is no public SSH key, valid: one line such as `ssh-ed25519 AAAA...`"
        raise UsageError(f"{file} {what}; ssh-keygen -y -f PRIVATE_KEY prints it")
    return found[0]


def _is_by(public: str, text: bytes, signature: bytes) -> bool:
    """Return whether a text was signed with the private key of a public key."""
    with tempfile.TemporaryDirectory() as folder:
        signers, signed = Path(folder, "signers"), Path(folder, "signature")
        signers.write_text(f'{_SIGNER} namespaces="{NAMESPACE}" {public}\n')
        signed.write_bytes(signature)
        options = ("-f", str(signers), "-I", _SIGNER, "-n", NAMESPACE, "-s", str(signed))
        return _ssh_keygen("verify", *options, given=text).returncode == 0


def _ssh_keygen(what: str, *options: str, given: bytes) -> subprocess.CompletedProcess[bytes]:
    program = shutil.which("ssh-keygen")
    if program is None:
        raise MissingLibraryError(
            "signatures need ssh-keygen, which is not installed: install OpenSSH 8.1 or newer"
        )
    command = [program, "-Y", what, *options]
    return subprocess.run(command, input=given, capture_output=True, check=False)


def _said(done: subprocess.CompletedProcess[bytes]) -> str:
    """Return what a command has printed to stderr, in a line."""
    return shown(" ".join(done.stderr.decode("utf-8", "replace").split()))
