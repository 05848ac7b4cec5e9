"""Facts of the latest episodes, from columns of committed blocks that read fast, and disk space."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from grasp_factory.core.sensors import series_groups
from grasp_factory.dataset.block_version import block_version
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.block_job import Made
from grasp_factory.labels.image_metrics import exposure, grey
from grasp_factory.labels.quality import MEASURED
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.sizes import bytes_of_blocks
from grasp_factory.writers.zarr.writer import COMMITTED, QUARANTINED

FRAMES = ("before", "after")


@dataclass(frozen=True, slots=True, kw_only=True)
class Brightness:
    """How bright an image is."""

    mean: float
    """Grey value, 0 black to 1 white."""
    clipped: float
    """Share of black or white pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeFacts:
    """The facts that are read from a committed episode."""

    row: int
    outcome: str
    object_id: str = ""
    version: str = ""
    """See ``block_version``."""
    quality: int | None = None
    lengths: Mapping[str, int] = field(default_factory=dict)
    """Samples of each group of time series, by its column: ``n_steps``, ``n_imu``, ..."""
    measured: Mapping[str, float] = field(default_factory=dict)
    """Inputs of the quality score by column, those that the store has."""
    images: Mapping[str, Brightness] = field(default_factory=dict)
    """By camera and frame, as ``front before``; empty if the episode's images were not read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disk:
    """Free space on the store's disk and the size of an episode, bytes."""

    free: int
    per_episode: float
    """Size of an episode, measured on a committed block; 0 if no block is committed yet."""


class BlockFacts:
    """Reads facts of a store while it is written; it keeps no file open that a run replaces."""

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``.

        Raises:
            GraspFactoryError: if it cannot be opened.
        """
        self._dataset, self._columns = Dataset(path), Columns.open(path)
        names = set(self._columns.names)
        self._lengths = [group.count for group in series_groups() if group.count in names]
        self._measured = [name for name in MEASURED if name in names]
        self._more = [name for name in ("object_id", "quality") if name in names]

    def committed(self, made: Sequence[Made]) -> bool:
        """Return whether a block's episodes are committed with the statuses that were reported."""
        first, last = made[0].index, made[-1].index
        statuses = self._columns.read_rows("status", first, last + 1)
        return all(
            int(statuses[m.index - first])
            == (QUARANTINED if m.outcome == "quarantined" else COMMITTED)
            for m in made
        )

    def read(self, made: Sequence[Made]) -> list[EpisodeFacts]:
        """Return the facts of a block's episodes, ascending, without the quarantined ones."""
        first, last = made[0].index, made[-1].index
        names = (*self._lengths, *self._measured, *self._more)
        values = {name: self._columns.read_rows(name, first, last + 1) for name in names}
        version = block_version(self._columns.place, first // self._dataset.config.block_size)
        out = []
        for m in made:
            if m.outcome != "quarantined":
                own = {name: values[name][m.index - first] for name in names}
                out.append(
                    EpisodeFacts(
                        row=m.index,
                        outcome=m.outcome,
                        object_id=str(own.get("object_id", "")),
                        version=version,
                        quality=int(own["quality"]) if "quality" in own else None,
                        lengths={name: int(own[name]) for name in self._lengths},
                        measured={name: float(own[name]) for name in self._measured},
                    )
                )
        return out

    def images(self, row: int) -> dict[str, Brightness]:
        """Return the brightness of an episode's images, of all cameras, before and after."""
        out = {}
        for camera in self._dataset.config.cameras:
            for frame, name in enumerate(FRAMES):
                mean, clipped = exposure(grey(self._dataset.image(row, camera, "rgb", frame)))
                out[f"{camera} {name}"] = Brightness(mean=mean, clipped=clipped)
        return out

    def disk(self, block: int | None) -> Disk:
        """Return the free disk space and the size of an episode, measured on a committed block."""
        free = shutil.disk_usage(self._columns.path).free
        if block is None:
            return Disk(free=free, per_episode=0.0)
        start, stop = self._columns.rows(block)
        return Disk(free=free, per_episode=bytes_of_blocks(self._columns, [block]) / (stop - start))
