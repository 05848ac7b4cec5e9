"""The arrays of an episode from its line in an export and from the export's files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.enums import UNKNOWN
from grasp_factory.core.episode import Episode
from grasp_factory.core.field import Field
from grasp_factory.core.limits import WORD
from grasp_factory.core.sensors import series_groups
from grasp_factory.core.text_format import size_text
from grasp_factory.dataset.plausible import check_plausible
from grasp_factory.dataset.row_codec import assemble
from grasp_factory.writers.exporters import ExportFolder


def episode_of(
    line: Mapping[str, Any],
    held: Mapping[str, NDArray[Any]],
    folder: ExportFolder,
) -> Episode:
    """Return an episode; what the export does not hold has the fill value.

    Args:
        line: its line in ``grasp_factory_episodes.jsonl``.
        held: its images and time series by path, without padding.
        folder: the export.

    Raises:
        KeyError, TypeError, ValueError: if the line or an array is damaged.
    """
    size = dict(schema.sizes(folder.config, folder.joints))
    lengths = {group.dim: _length(group.name, held) for group in series_groups()}
    columns = {f"episodes/{name}": value for name, value in line["columns"].items()}
    columns |= {
        group.length_column: lengths[group.dim]
        for group in series_groups()
        if group.length_column in columns
    }
    columns["episodes/spec"] = json.dumps(columns["episodes/spec"])
    row: dict[str, NDArray[Any]] = {}
    for path, field in folder.fields.items():
        if path in schema.NOT_IN_AN_EPISODE:
            continue
        shape = schema.shape(field, size | lengths if field.length_column else size)
        if path in held:
            row[path] = _checked(held[path], field, shape)
        elif path in columns or path in line["arrays"]:
            row[path] = _array(columns.get(path, line["arrays"].get(path)), field, shape)
        else:
            row[path] = np.full(shape, field.fill, field.dtype)
    episode = assemble(row, folder.config.cameras)
    check_plausible(episode, folder.config)
    return episode


def _length(group: str, held: Mapping[str, NDArray[Any]]) -> int:
    """Return the number of samples of a group of time series; 0 if the export has none."""
    return len(held.get(f"{group}/timestamp", ()))


def _checked(values: NDArray[Any], field: Field, shape: tuple[int, ...]) -> NDArray[Any]:
    if (values.dtype.name, values.shape) != (field.dtype, shape):
        got = f"{values.dtype.name} {values.shape}"
        raise ValueError(f"{field.path}: got {got}, valid: {field.dtype} {shape}")
    return values


def check_text(text: str) -> None:
    """Check that a text can be stored: JSON may have halves of characters, and long texts.

    Raises:
        ValueError: if it cannot.
    """
    if len(text.encode()) > WORD.most:
        most = size_text(WORD.most)
        raise ValueError(f"a text of {len(text):,} characters, valid: up to {most}")


def _array(value: Any, field: Field, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the array of a value of JSON: words become codes; None is NaN or a code."""
    if field.names:
        value = UNKNOWN if value is None else field.names.index(value)
    values = np.asarray(value, np.str_ if field.dtype == "string" else field.dtype)
    if values.shape != shape:
        raise ValueError(f"{field.path}: got {values.shape}, valid: {shape}")
    if field.dtype == "string":
        check_text("".join(values.ravel().tolist()))
    return values
