"""grasp-factory makes datasets of robot grasps in simulated physics, and reads them back.

Names are loaded when they are first used: importing the package starts neither PyBullet nor Zarr.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.6.0"

if TYPE_CHECKING:
    from grasp_factory.conditions import Range
    from grasp_factory.config import FactoryConfig
    from grasp_factory.dataset import Dataset
    from grasp_factory.episode import Episode, EpisodeSpec
    from grasp_factory.factory import generate
    from grasp_factory.outcome import Outcome, Phase
    from grasp_factory.request import Shard

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
    "Dataset": "dataset",
    "Episode": "episode",
    "EpisodeSpec": "episode",
    "FactoryConfig": "config",
    "Outcome": "outcome",
    "Phase": "outcome",
    "Range": "conditions",
    "Shard": "request",
    "generate": "factory",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
