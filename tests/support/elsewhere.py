"""Stores and processes that are of another platform, by a digit of its fingerprint."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.place import place_at
from grasp_factory.core.platforms import FINGERPRINT, Fingerprint
from grasp_factory.simulation import fingerprint as measuring
from grasp_factory.simulation.fingerprint import fingerprint
from grasp_factory.writers.zarr.metadata_checksum import seal

HERE = fingerprint(FactoryConfig())
THERE = replace(HERE, engine=f"{int(HERE.engine, 16) ^ 1:08x}")
"""A platform whose simulation steps are others."""


def move(monkeypatch: pytest.MonkeyPatch, to: Fingerprint = THERE) -> None:
    """Let this process run on another platform, as far as its fingerprint tells."""
    monkeypatch.setattr(measuring, "_measured", lambda renderer: to)


def set_attributes(store: Path, attributes: Mapping[str, object]) -> None:
    """Change root attributes of a store, and seal them again."""
    file = store / "zarr.json"
    document = json.loads(file.read_bytes())
    document["attributes"] |= attributes
    file.write_text(json.dumps(document))
    seal(place_at(file))


def set_texts(store: Path, texts: Mapping[int, str]) -> None:
    """Change the fingerprints of some rows of a store."""
    array = zarr.open_array(store, path="episodes/fingerprint", mode="r+")
    whole = np.asarray(array[:])
    for row, text in texts.items():
        whole[row] = text
    array[:] = whole


def made_there(store: Path, rows: int) -> Path:
    """Let a store be one that was made on the other platform; return it."""
    set_attributes(store, {FINGERPRINT: THERE.parts()})
    set_texts(store, dict.fromkeys(range(rows), THERE.text))
    return store
