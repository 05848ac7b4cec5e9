"""Simulated episodes in a store that may also hold real ones: what they have no values for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.real_columns import SIMULATED_COLUMNS


def with_room_for_real(episode: Episode, config: FactoryConfig) -> Episode:
    """Return a simulated episode with the columns and series of real ones, which are empty.

    An episode that has them, or that is for a store without them, is returned as it is.

    Args:
        episode: the episode.
        config: of the store that it is for.
    """
    if config.capture is None or "source" in episode.columns:
        return episode
    size = schema.sizes(config, episode.streams["joint_positions"].shape[1])
    series: dict[str, dict[str, np.ndarray]] = {}
    for row in schema.expand(config):
        if row.is_real and row.length_column:
            group, name = row.path.split("/", 1)
            empty = np.empty((0, *schema.shape(row, size)[1:]), row.dtype)
            series.setdefault(group, {})[name] = empty
    columns = {**episode.columns, **SIMULATED_COLUMNS}
    return replace(episode, columns=columns, own_rate={**episode.own_rate, **series})
