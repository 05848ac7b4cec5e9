"""Packed segments that are no archives of arrays, or expand without end."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from support.hostile.table import ATTACKS, GB, Attack, attack, write


def _zeros_of_deflate(size: int) -> bytes:
    """Return a stream that expands to zeros: a part that refers to nothing before it, repeated."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    part = packer.compress(bytes(2**26)) + packer.flush(zlib.Z_FULL_FLUSH)
    return part * (size // 2**26) + packer.flush(zlib.Z_FINISH)


@attack("a packed segment that expands to 4 GB")
def _(store: Path, outside: Path) -> None:
    with zipfile.ZipFile(store / "packed/0-1.npz") as old:
        names = old.namelist()
    with zipfile.ZipFile(store / "packed/0-1.npz", "w") as new:
        for name in names[:4]:
            new.writestr(name, _zeros_of_deflate(GB))
            info = new.getinfo(name)
            info.compress_type, info.file_size = zipfile.ZIP_DEFLATED, GB


def _npy_header(dtype: str, shape: tuple[int, ...]) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        out, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return out.getvalue()


def _segment(member: Callable[[], bytes]) -> Attack:
    def write(store: Path, outside: Path) -> None:
        with zipfile.ZipFile(store / "packed/0-1.npz") as old:
            names = old.namelist()
        with zipfile.ZipFile(store / "packed/0-1.npz", "w") as new:
            for name in names:
                new.writestr(name, member())

    return write


ATTACKS["a packed segment of pickles"] = _segment(
    lambda: _npy_header("|O", (1,)) + b"cos\nsystem\n(S'touch pickled'\ntR."
)
ATTACKS["a packed segment that claims 2^60 values"] = _segment(lambda: _npy_header("<f8", (2**60,)))
ATTACKS["a packed segment of deep headers"] = _segment(
    lambda: b"\x93NUMPY\x01\x00" + struct.pack("<H", 60000) + b"(" * 60000
)
ATTACKS["a packed segment of negative shape"] = _segment(lambda: _npy_header("<f8", (-5,)))
ATTACKS["a packed segment that is no zip"] = lambda store, outside: write(
    store / "packed/0-1.npz", b"PK\x03\x04" + bytes(1000)
)


def _end(members: int, size: int, start: int) -> bytes:
    """Return the record at the end of a zip file."""
    return b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, members, members, size, start, 0)


@attack("a packed segment with a directory of 3.9 GB that is not on the disk")
def _(store: Path, outside: Path) -> None:
    size = 3_900_000_000
    with (store / "packed/0-1.npz").open("wb") as file:
        file.truncate(size)
        file.seek(size)
        file.write(_end(1, size, 0))


@attack("a packed segment of 1.5 million members")
def _(store: Path, outside: Path) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as new:
        new.writestr("a", b"")
    whole = content.getvalue()
    start = whole.index(b"PK\x01\x02")
    entries = whole[start:-22] * 1_500_000
    write(store / "packed/0-1.npz", whole[:start] + entries + _end(1, len(entries), start))


def _replaced(members: Callable[[str], bytes | None]) -> Attack:
    """Change the members of a segment; None leaves one as it is."""

    def change(store: Path, outside: Path) -> None:
        with zipfile.ZipFile(store / "packed/0-1.npz") as old:
            whole = {name: old.read(name) for name in old.namelist()}
        with zipfile.ZipFile(store / "packed/0-1.npz", "w") as new:
            for name, content in whole.items():
                other = members(name)
                new.writestr(name, content if other is None else other)

    return change


def _bytes(dtype: str, content: bytes) -> bytes:
    return _npy_header(dtype, (len(content),)) + content


_CODES = "episodes/policy.npy"
_WORDS = "episodes/policy.words.npy"


def _many_codes(name: str) -> bytes | None:
    if name == _CODES:
        return _bytes("|u1", bytes(100_000_000))
    return _bytes("|u1", b'["a"]') if name == _WORDS else None


ATTACKS["a packed segment of 100 million codes"] = _replaced(_many_codes)
ATTACKS["a packed segment of 20 million words"] = _replaced(
    lambda name: _bytes("|u1", b"[" + b"[]," * 20_000_000 + b"[]]") if name == _WORDS else None
)


@attack("100 packed segments of the same blocks")
def _(store: Path, outside: Path) -> None:
    ATTACKS["a packed segment of 100 million codes"](store, outside)
    for number in range(2, 100):
        (store / f"packed/{'0' * number}-1.npz").hardlink_to(store / "packed/0-1.npz")
