"""Calibration files: YAML of a limited size, read strictly, written as other tools read it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from grasp_factory.core.config.yaml_loader import MAX_BYTES, parse_yaml
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.output_file import written_aside
from grasp_factory.core.regular_file import open_regular, read_part
from grasp_factory.core.serialization import from_plain
from grasp_factory.errors import CaptureError, ConfigError, UsageError, shown

R = TypeVar("R")


def read_bytes(path: Path, most: int = DOCUMENT.usual) -> bytes:
    """Return a file of at most so many bytes.

    Raises:
        UsageError: if it cannot be opened.
        CaptureError: if it is larger.
        IrregularFileError: if it is a link, a pipe or a device.
    """
    try:
        descriptor = open_regular(path, os.O_RDONLY)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from None
    try:
        size = os.fstat(descriptor).st_size
        if size > most:
            raise CaptureError(f"{path}: got {size:,} bytes, valid: up to {most:,}")
        return read_part(descriptor, size)
    finally:
        os.close(descriptor)


def read_document(path: Path) -> dict[str, Any]:
    """Return the mapping that a calibration file holds.

    Raises:
        UsageError: if it cannot be opened.
        CaptureError: if it is too large, is no YAML, or holds no mapping.
    """
    try:
        data = parse_yaml(read_bytes(path, MAX_BYTES).decode("utf-8"), str(path))
    except UnicodeDecodeError:
        raise CaptureError(f"{path} is no calibration file: it is no text in UTF-8") from None
    except ConfigError as error:
        raise CaptureError(str(error)) from None
    if not isinstance(data, dict):
        got = f"got {shown(data)}"
        raise CaptureError(f"{path}: expected a mapping of keys, {got}")
    return data


def record_of(cls: type[R], data: Any, path: Path, where: str = "") -> R:
    """Return a record from the plain data of a file; see ``from_plain``.

    Raises:
        CaptureError: naming the file, the key, what it has and what is valid.
    """
    try:
        return from_plain(cls, data, where)
    except ConfigError as error:
        raise CaptureError(f"{path}: {error}") from None


def write_document(path: Path, data: Mapping[str, Any]) -> None:
    """Write a new YAML file.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
        StoreError: if it cannot be written.
    """
    check_new(path)
    with written_aside(path) as partial:
        partial.write_text(
            yaml.dump(dict(data), Dumper=_Dumper, sort_keys=False, width=1000), encoding="utf-8"
        )


def check_new(path: Path) -> None:
    """Check that a file can be created: nothing is overwritten.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
    """
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist")
    if os.path.lexists(path):
        raise UsageError(
            f"{path} exists, and a calibration overwrites nothing: choose another name"
        )


class _Dumper(yaml.SafeDumper):
    """Writes lists of numbers in one line, as kalibr does."""


def _row(dumper: yaml.SafeDumper, values: Any) -> yaml.Node:
    is_row = all(isinstance(value, int | float | str) for value in values)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=is_row)


_Dumper.add_representer(list, _row)
_Dumper.add_representer(tuple, _row)
