"""grasp-factory makes datasets of robot grasps in simulated physics, and reads them back.

Names are loaded when they are first used: importing the package starts neither PyBullet nor Zarr.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.17.0"

if TYPE_CHECKING:
    from grasp_factory.core.config.factory_config import FactoryConfig
    from grasp_factory.core.enums import Outcome, Phase
    from grasp_factory.core.episode import Episode, EpisodeSpec
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.dataset.filters import Range
    from grasp_factory.factory.generate import generate
    from grasp_factory.factory.run_request import Shard

__all__ = [
    "Dataset",
    "Episode",
    "EpisodeSpec",
    "FactoryConfig",
    "Outcome",
    "Phase",
    "Range",
    "Shard",
    "generate",
]

_HOMES = {
    "Dataset": "dataset.dataset",
    "Episode": "core.episode",
    "EpisodeSpec": "core.episode",
    "FactoryConfig": "core.config.factory_config",
    "Outcome": "core.enums",
    "Phase": "core.enums",
    "Range": "dataset.filters",
    "Shard": "factory.run_request",
    "generate": "factory.generate",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
