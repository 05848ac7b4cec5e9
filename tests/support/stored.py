"""Small stores that several tests look at: shipped, simulated once for all, or quarantined."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import pytest
from support.fake_episodes import JOINTS, make_rows, small_config

from grasp_factory import __version__
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.serialization import to_plain
from grasp_factory.factory.generate import generate
from grasp_factory.writers.zarr import made_with
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

OLD = Path(__file__).parent / "made_by_0.4.0.zip"
"""A store of four rows, the last quarantined, of a version without fingerprints."""


@cache
def varied() -> Path:
    """Return a store of another robot, with clutter, a camera on the hand, and videos."""
    plain = {
        "seed": 3,
        "resolution": [96, 72],
        "block_size": 4,
        "robot": "panda",
        "policies": {"top_down": 1.0},
        "object_sets": {"classic": 1.0, "procedural": 1.0},
        "cameras": {name: to_plain(CAMERAS[name].config) for name in ("front", "wrist")},
        "clutter": {"count": 2},
        "video_hz": 10,
    }
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    generate(FactoryConfig.from_plain(plain), 2, folder / "varied.zarr", workers=1)
    return folder / "varied.zarr"


def old_store(folder: Path) -> Path:
    """Unpack the store that version 0.4.0 made into a folder, and return where it is."""
    with zipfile.ZipFile(OLD) as file:
        file.extractall(folder / "old.zarr")
    return folder / "old.zarr"


def made_here_but_for_our_version(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let this environment be the one that made a store, with another version of this package."""
    recorded = json.loads((store / "zarr.json").read_text())["attributes"]
    versions = recorded["versions"] | {"grasp_factory": __version__}
    here = recorded | {"versions": versions}
    monkeypatch.setattr(made_with, "root_attributes", lambda config, more: here)


def with_a_quarantined_row(path: Path) -> Path:
    """Write a store there whose episode 1 is quarantined, and return where it is."""
    config = small_config()
    prepare_store(path, config, JOINTS, 4, {})
    ZarrWriter(path).write_block(0, make_rows(config, 0, 4, quarantined=(1,)))
    return path
