"""Pack an imported folder into one file, so that a dataset can contain its objects."""

from __future__ import annotations

import io
import zipfile

from grasp_factory.core.cache import cache_dir, digest, read_checked, write
from grasp_factory.errors import ConfigError, StoreError
from grasp_factory.objects.folder import Manifest, read_manifest
from grasp_factory.objects.folder_cache import manifest_path, mesh_path
from grasp_factory.objects.plain_mesh import check_plain_mesh

MANIFEST = "manifest.json"
MAX_BYTES = 2**31
"""Largest size of an archive."""
_LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""The earliest date of the zip format; with a fixed date, equal objects make equal archives."""


def pack_folder(sha256: str) -> bytes:
    """Return the manifest with that digest and its meshes, as a zip file without compression.

    Raises:
        ConfigError: if this machine's cache does not have all of them undamaged.
    """
    where = cache_dir()
    manifest = read_manifest(sha256, where)
    members = {MANIFEST: manifest.encoded()}
    for file in manifest.files:
        data = read_checked(mesh_path(where, file))
        if data is None:
            raise ConfigError(f"the cache {where} has lost the mesh {file}; import it again")
        members[f"{file}.obj"] = data
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), data)
    return buffer.getvalue()


def unpack_folder(data: bytes) -> str:
    """Put the objects of an archive into this machine's cache and return their digest.

    The archive is not trusted: it cannot choose where files are written, and a mesh is accepted
    only if it has the hash in the manifest and the plain form that imports write.

    Raises:
        StoreError: naming what is wrong with the archive.
    """
    try:
        members = _members(data)
        text = members.pop(MANIFEST, b"")
        manifest = Manifest.decoded(text)
        if manifest.encoded() != text:
            raise StoreError("its manifest is not in the form that imports write")
        if sorted(members) != [f"{file}.obj" for file in manifest.files]:
            raise StoreError("its files are not those that its manifest names")
        for file in manifest.files:
            _check_mesh(file, members[f"{file}.obj"])
    except (ConfigError, StoreError) as error:
        raise StoreError(f"an archive of objects cannot be used: {error}") from None
    where = cache_dir()
    for file in manifest.files:
        write(mesh_path(where, file), members[f"{file}.obj"])
    write(manifest_path(where, digest(text)), text)
    return digest(text)


def _members(data: bytes) -> dict[str, bytes]:
    if len(data) > MAX_BYTES:
        raise StoreError(f"it has {len(data)} bytes, valid: up to {MAX_BYTES}")
    members: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            room = len(data)
            for info in archive.infolist():
                room -= info.file_size  # members that share bytes would be a zip bomb
                plain = info.compress_type == zipfile.ZIP_STORED and not info.flag_bits & 1
                if not plain or room < 0 or info.filename in members:
                    raise StoreError("a member is compressed, encrypted, too long or there twice")
                members[info.filename] = archive.read(info)
    except (zipfile.BadZipFile, OSError, ValueError, EOFError, NotImplementedError) as error:
        raise StoreError(f"it is no zip file: {error}") from None
    return members


def _check_mesh(sha256: str, data: bytes) -> None:
    if digest(data) != sha256:
        raise StoreError(f"mesh {sha256} has another content than its name says")
    check_plain_mesh(sha256, data)
