"""Stores of real episodes: one of these alone, and one merged of real and simulated ones."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.grasp_sessions import SIZE, session

from grasp_factory.capture.importing.cuts import read_cuts
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.importing_store import import_session
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.serialization import from_plain
from grasp_factory.curation.merge import merge
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate

CUTS = "start,end,outcome\n0.2,0.9,no_contact\n1.0,4.9,success\n5.0,5.5,\n"
"""A failure, a success, and an episode without a label, which is quarantined."""
SETTINGS: dict[str, Any] = {
    "resolution": [SIZE[1], SIZE[0]],
    "block_size": 2,
    "policies": {"top_down": 1.0},
    "video_hz": 10,
}
SIMULATED = 2
"""Number of simulated episodes; in the merged store they are first."""
REAL_ROW = SIMULATED + 1
"""The row of the real success in the merged store."""
SAID = {
    "scenario": "kitchen",
    "sensor_setup": {"front": "on a tripod"},
    "consent": "form 12",
    "tags": ["wet"],
}
"""What the session's operator wrote."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MixedStores:
    """A session and the stores that were made of it."""

    session: Path
    alone: Path
    """A store of real episodes, whose config follows the session."""
    simulated: Path
    real: Path
    """A store of real episodes with the config of ``simulated``."""
    both: Path
    """Both merged: two simulated rows, a real failure, a real success, a quarantined real row."""


def make_mixed_stores(folder: Path) -> MixedStores:
    """Make the stores in an empty folder."""
    cuts, settings = folder / "cuts.csv", from_plain(ImportSettings, {"cut": "list"})
    cuts.write_text(CUTS)
    made = MixedStores(
        session=session(folder / "ses", **SAID),
        alone=folder / "alone.zarr",
        simulated=folder / "sim.zarr",
        real=folder / "real.zarr",
        both=folder / "both.zarr",
    )
    generate(FactoryConfig.from_plain(SETTINGS), SIMULATED, made.simulated, workers=1)
    base, listed = Dataset(made.simulated).config, read_cuts(cuts)
    import_session(made.session, made.alone, settings, listed=listed)
    import_session(made.session, made.real, settings, base=base, listed=listed)
    merge([made.simulated, made.real], made.both)
    return made
